"""PDOs with mappings that cannot be written: which are used, what they cost, what is said where they do not suffice."""

from pathlib import Path

import pytest

from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError, ImageTooLargeError, ProfileError
from haptic_fieldbus.protocols.canopen.eds_check import compare
from haptic_fieldbus.protocols.canopen.fitting import fitted, uploaded
from haptic_fieldbus.protocols.canopen.from_eds import draft_of, profile_from_eds
from haptic_fieldbus.protocols.canopen.pdo import Direction, FixedPdo, Pdo, bits_beyond, lay_out
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.traffic import PdoTraffic
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Signal
from tests.builders import PROFILE, canopen
from tests.eds.fixed_mapping import (
    CONTROLWORD,
    MODE,
    POSITION,
    RPDOS,
    STATUSWORD,
    TARGET_TORQUE,
    TARGET_VELOCITY,
    TORQUE,
    TPDOS,
    VELOCITY,
    Mappings,
    fixed_eds,
    fixed_profile,
)
from tests.eds.sheets import changed, without, without_member
from tests.protocols.canopen.test_fitting import ALL, Octets

IN = (Signal.STATUSWORD, Signal.POSITION, Signal.TORQUE_ACTUAL)
OUT = (Signal.CONTROLWORD, Signal.TARGET_TORQUE)
GENERIC = canopen("generic_cia402")


def fixed(pdos: Mappings) -> tuple[FixedPdo, ...]:
    return tuple(FixedPdo(number, maps) for number, maps in pdos.items())


def laid_out(
    pdos: Mappings, *signals: Signal, room: dict[int, int] | None = None, direction: Direction = Direction.TPDO
) -> tuple[Pdo, ...]:
    return lay_out(
        direction, PROFILE.entries(), signals, node=5, transmission_type=1, room=room or {}, fixed=fixed(pdos)
    )


class TestLayout:
    def test_those_are_used_that_carry_the_signals_with_the_fewest_bits(self) -> None:
        third, fifth = laid_out(TPDOS, *IN)
        assert (third.name, third.signals, third.fixed) == ("TPDO3", (Signal.STATUSWORD, Signal.POSITION), True)
        assert (fifth.name, fifth.signals) == ("TPDO5", (None, Signal.TORQUE_ACTUAL))
        (only,) = laid_out(RPDOS, *OUT, direction=Direction.RPDO)
        assert (only.name, only.signals, only.entries[1]) == ("RPDO5", OUT, PROFILE.entries()[Signal.TARGET_TORQUE])

    def test_a_pdo_without_a_cob_id_of_its_own_takes_that_of_one_that_is_not_used(self) -> None:
        """The predefined connection set (CiA 301 7.3.5) has four PDOs of each direction."""
        assert [pdo.cob_id for pdo in laid_out(TPDOS, *IN)] == [0x385, 0x185]
        assert [pdo.mapping_index for pdo in laid_out(TPDOS, *IN)] == [0x1A02, 0x1A04]
        (only,) = laid_out(RPDOS, *OUT, direction=Direction.RPDO)
        assert (only.cob_id, only.mapping_index) == (0x205, 0x1604)

    def test_a_mapping_of_our_own_comes_first_where_it_takes_no_more_bits(self) -> None:
        (pdo,) = laid_out(TPDOS, *IN, room={6: 8, 1: 8})
        assert (pdo.name, pdo.fixed, pdo.signals) == ("TPDO1", False, IN)

    def test_fixed_and_free_mappings_complement_each_other(self) -> None:
        first, third = laid_out({3: (STATUSWORD, POSITION)}, *IN, room={1: 1})
        assert (first.signals, first.fixed) == ((Signal.TORQUE_ACTUAL,), False)
        assert (third.signals, third.fixed) == (IN[:2], True)

    def test_of_pdos_that_carry_the_same_the_shortest_is_used(self) -> None:
        (pdo,) = laid_out({1: (STATUSWORD, VELOCITY), 2: (STATUSWORD,), 3: (STATUSWORD, 0x60610008)}, Signal.STATUSWORD)
        assert pdo.name == "TPDO2"

    def test_a_controlword_never_comes_twice(self) -> None:
        """A second one would be sent as it was read before the run."""
        pdos = laid_out({1: (CONTROLWORD,), 2: (TARGET_TORQUE,), 4: (CONTROLWORD, MODE)}, *OUT,
                        direction=Direction.RPDO)  # fmt: skip
        assert [pdo.name for pdo in pdos] == ["RPDO1", "RPDO2"]

    def test_what_no_pdo_carries_is_named_with_what_they_map(self) -> None:
        with pytest.raises(ImageTooLargeError) as refused:
            laid_out({3: (CONTROLWORD, TARGET_VELOCITY)}, *OUT, direction=Direction.RPDO)
        assert str(refused.value) == (
            "no RPDO of node 5 carries 6071h:00 target torque, and the mapping is fixed: RPDO3 6040h:00 + 60FFh:00"
        )

    def test_an_object_of_another_length_is_another_object(self) -> None:
        with pytest.raises(ImageTooLargeError, match="carries 6071h:00 target torque"):
            laid_out({3: (CONTROLWORD, 0x60710020)}, *OUT, direction=Direction.RPDO)

    def test_the_octets_of_each_object_are_known(self) -> None:
        (pdo,) = laid_out({1: (0x60610008, STATUSWORD, VELOCITY)}, Signal.STATUSWORD)
        assert [place for *_, place in pdo.needed] == [slice(1, 3)]
        assert pdo.unneeded == (
            (ObjectEntry(0x6061, DataType.UINT8), slice(0, 1)),
            (ObjectEntry(0x606C, DataType.UINT32), slice(3, 7)),
        )
        assert (pdo.size, pdo.image_size) == (7, 2)


def test_the_cost_is_the_bits_of_what_nobody_needs() -> None:
    """By Davis et al. 2007 a frame of n octets takes 55 + 10 n bits: 6 and 4 octets instead of 8."""
    assert bits_beyond(laid_out(TPDOS, *IN)) == (55 + 60) + (55 + 40) - (55 + 80)
    assert bits_beyond(laid_out(RPDOS, *OUT, direction=Direction.RPDO)) == 0


def test_the_plan_names_the_vendors_pdos_and_their_cost() -> None:
    traffic = PdoTraffic(5, laid_out(TPDOS, *IN), laid_out(RPDOS, *OUT, direction=Direction.RPDO))
    assert [mapped.signal for mapped in traffic.incoming] == list(IN)
    lines = [text.strip() for _, text in traffic.lines()]
    assert lines[0] == "TPDO3 385h, type 1 (every SYNC), 6 octets, fixed mapping"
    assert "6041h:00 statusword (not needed)" in lines
    assert "cost of fixed mappings (TPDO3, TPDO5): 75 unneeded bits per period" in lines
    assert sum("cost" in line for line in lines) == 1
    assert list(traffic.summary())[1] == "in  TPDO5 torque actual"
    (_, fifth, _) = traffic.to_json("bus")["pdos"]
    assert isinstance(fifth, dict)
    assert (fifth["fixed"], fifth["not_needed"]) == (True, ["6041h:00 statusword"])


class TestFromTheVendorsFile:
    def test_mappings_that_suffice_are_taken_over_and_the_echo_is_what_they_carry(self) -> None:
        profile = fixed_profile()
        assert profile.drive.usable
        assert profile.pdo.rpdo_fixed == fixed(RPDOS)
        assert profile.pdo.tpdo_fixed == fixed(TPDOS)
        assert (profile.torque.echo, profile.torque.demand) == ("actual", None)
        assert profile.pdo.room(Direction.RPDO) == dict.fromkeys(RPDOS, 0)

    @pytest.mark.parametrize(
        ("pdos", "message"),
        [
            ({"rpdos": {**RPDOS, 5: (CONTROLWORD, MODE)}}, "active RPDO carries 6071h target torque"),
            ({"tpdos": {1: (STATUSWORD,)}}, "active TPDO carries 6064h position actual value"),
        ],
    )
    def test_what_no_mapping_carries_is_named(self, pdos: dict[str, Mappings], message: str) -> None:
        profile = fixed_profile(**pdos)
        assert not profile.drive.usable
        assert [lack.partition(",")[0] for lack, _ in profile.lacks] == [f"no {message}"]

    def test_what_a_fixed_mapping_has_need_not_be_mappable(self) -> None:
        eds = changed(changed(fixed_eds(), 0x6071, mappable=False), 0x6064, mappable=False)
        profile = profile_from_eds(eds)
        assert profile.drive.usable
        assert not compare(profile, eds).faults

    def test_without_a_position_the_velocity_of_a_fixed_mapping_stands_in(self) -> None:
        eds = changed(without(fixed_eds(), 0x6064), 0x606C, mappable=False)
        assert profile_from_eds(eds).velocity is not None
        assert profile_from_eds(changed(eds, 0x1A03, 2, default=TORQUE)).velocity is None

    @pytest.mark.parametrize(("index", "subindex", "changes"), [
        (0x1404, 1, {"access": "ro"}),
        (0x1404, 2, {"access": "ro", "default": 1}),
        (0x1604, 0, {"default": None}),
        (0x1604, 1, {"default": 0x60400001}),
        (0x1604, 2, {"default": None}),
    ])  # fmt: skip
    def test_a_pdo_that_cannot_be_switched_on_or_is_not_known_is_not_used(
        self, index: int, subindex: int, changes: dict[str, object]
    ) -> None:
        profile = profile_from_eds(changed(fixed_eds(), index, subindex, **changes))
        assert [each.number for each in profile.pdo.rpdo_fixed] == [1, 2, 3, 4]

    def test_a_transmission_type_that_is_right_need_not_be_writable(self) -> None:
        eds = changed(changed(fixed_eds(), 0x1404, 2, access="ro"), 0x1802, 2, access="const", default=1)
        assert profile_from_eds(eds).drive.usable
        assert not profile_from_eds(changed(eds, 0x1802, 2, default=255)).drive.usable

    def test_a_pdo_without_a_transmission_type_is_not_used(self) -> None:
        eds = without_member(fixed_eds(), 0x1404, 2)
        assert 5 not in [each.number for each in profile_from_eds(eds).pdo.rpdo_fixed]

    def test_the_draft_has_them_and_agrees_with_the_file(self, tmp_path: Path) -> None:
        path = tmp_path / "drafted.toml"
        path.write_text(draft_of(fixed_profile(), "own.eds").text, encoding="utf-8")
        drafted = canopen(path)
        assert drafted.pdo == fixed_profile().pdo
        assert "pdo.rpdo_fixed" in drafted.sources
        found = compare(drafted, fixed_eds())
        assert not found.faults
        assert any(each.key == "pdo.rpdo_fixed" and "60400010h, 60710010h" in each.shows for each in found.agreed)

    def test_a_mapping_that_the_file_has_otherwise_is_a_fault(self) -> None:
        found = compare(fixed_profile(), fixed_eds({**RPDOS, 5: (CONTROLWORD, MODE, TARGET_TORQUE)}))
        (fault,) = found.faults
        assert fault.key == "pdo.rpdo_fixed"
        assert "RPDO5 60400010h, 60710010h; 1604h maps 60400010h, 60600008h, 60710010h" in fault.message
        (fault,) = [each for each in compare(fixed_profile(), fixed_eds(access="rw")).faults if "RPDO5" in each.message]
        assert "1604h maps nothing" in fault.message


class TestOfTheDriveItself:
    """Result of uploads: a record without a mapping entry beyond those that it uses is fixed."""

    @staticmethod
    def on(rpdos: Mappings = RPDOS, tpdos: Mappings = TPDOS, *, free: bool = False) -> CanopenProfile:
        octets: Octets = {key: value for key, value in ALL.items() if not 0x1400 <= key[0] < 0x1C00}
        for first, pdos in ((0x1400, rpdos), (0x1800, tpdos)):
            for number, maps in pdos.items():
                index = first + number - 1
                octets[index, 1] = bytes(4)
                octets[index + 0x200, 0] = bytes((len(maps),))
                entries = (*maps, 0) if free else maps
                octets |= {(index + 0x200, n): each.to_bytes(4, "little") for n, each in enumerate(entries, start=1)}
        return fitted(GENERIC, uploaded(GENERIC, lambda index, subindex: octets.get((index, subindex))))

    def test_records_without_a_free_entry_that_suffice_are_used_as_they_are(self) -> None:
        profile = self.on()
        assert (profile.pdo.rpdo_fixed, profile.pdo.tpdo_fixed) == (fixed(RPDOS), fixed(TPDOS))
        assert profile.drive.usable
        # Torque demand cannot be sent then, and the torque actual value is the echo.
        assert (profile.torque.demand, profile.torque.echo) == (None, "actual")
        assert profile.sources["pdo.rpdo_fixed"].startswith("the drive, [1600] to [1604]")

    def test_records_with_a_free_entry_are_mapped_anew(self) -> None:
        assert self.on(free=True).pdo.rpdo_fixed == ()

    def test_records_that_do_not_suffice_are_mapped_anew(self) -> None:
        """Some drives show no entry beyond those in use, and take more all the same."""
        assert self.on({1: (CONTROLWORD,)}).pdo.rpdo_fixed == ()
        assert self.on(tpdos={1: (STATUSWORD,)}).pdo.tpdo_fixed == ()

    def test_a_refusal_of_any_kind_is_no_free_entry(self) -> None:
        def upload(index: int, subindex: int) -> bytes | None:
            if index == 0x1600 and subindex == 2:
                raise BusConfigurationError("abort 08000000h")
            held = {(0x1400, 1): bytes(4), (0x1600, 0): b"\x01", (0x1600, 1): CONTROLWORD.to_bytes(4, "little")}
            return held.get((index, subindex), ALL.get((index, subindex)) if index >= 0x6000 else None)

        assert 0x1600 in uploaded(GENERIC, upload).objects


@pytest.mark.parametrize(
    ("maps", "message"),
    [
        ("[{ number = 1, maps = [0x60400001] }]", "rpdo_fixed[0].maps: not a PDO mapping"),
        ("[{ number = 1, maps = [0x60400020, 0x60710020, 0x60FF0020] }]", "64 together"),
        ("[{ number = 2, maps = [0x60400010] }, { number = 2, maps = [0x60710010] }]", "2 is already used"),
        ("[1]", "rpdo_fixed"),
        ("[{ number = 1, maps = 7 }]", "maps"),
        ("7", "rpdo_fixed"),
    ],
)
def test_a_fixed_mapping_that_is_none_is_a_fault_of_the_profile(maps: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    text = Path(GENERIC.source).read_text(encoding="utf-8")
    path.write_text(text.replace("[pdo]\n", f"[pdo]\nrpdo_fixed = {maps}\n"), encoding="utf-8")
    with pytest.raises(ProfileError) as refused:
        load_profile(path)
    assert message in str(refused.value)
