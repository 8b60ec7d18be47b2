"""Profiles out of EDS files: what is taken, what is assumed, and files that cannot be used."""

import contextlib
from collections.abc import Iterable
from pathlib import Path

import pytest

from haptic_fieldbus.drive.cia402 import IdentitySection, MappedObject, OptionCode, VelocitySection, WrittenObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.eds import DeviceInfo, Eds, EdsEntry, EdsType, eds_text
from haptic_fieldbus.errors import EdsError
from haptic_fieldbus.protocols.canopen.eds_values import data_type
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile, profile_from_eds
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.catalogue import load_profile
from tests.builders import canopen
from tests.eds.peculiar import FORCE, SHEETS
from tests.eds.sheets import changed, generic, without, without_member
from tests.eds.vendor_files import FILES, both, eds_of, needs_files, path_of

PERMILLE = "permille_of_rated_torque"


def refusals(eds: Eds, mode: int | None = None) -> list[str]:
    """Messages about a file that describes no drive of CiA 402, or one that is not usable for force."""
    try:
        profile = profile_from_eds(eds, mode)
    except EdsError as error:
        return [fault.message.removeprefix("not a CiA 402 drive: ") for fault in error.faults]
    lacks = [lack for lack, _ in profile.lacks]
    assert profile.drive.usable is not bool(lacks)
    assert profile.sources.get("drive.usable", "") == "; ".join(lacks)
    return lacks


def test_the_profile_says_what_the_file_says() -> None:
    profile = profile_from_eds(generic())
    assert (profile.name, profile.title, profile.drive.evidence) == ("own", "generic CiA 402", "vendor-data")
    assert profile.torque.mode_of_operation == 10
    assert profile.torque.target == MappedObject(0x6071, DataType.INT16, unit=PERMILLE)
    assert profile.torque.actual == MappedObject(0x6077, DataType.INT16, unit=PERMILLE)
    assert profile.torque.rated == MappedObject(0x6076, DataType.UINT32, unit="mN·m")
    assert (profile.pdo.rpdos, profile.pdo.tpdos, profile.pdo.entries) == (4, 4, 8)
    assert profile.link_loss.heartbeat_consumer == 0x1016
    assert profile.link_loss.abort_connection_option == OptionCode(0x6007, 2)
    assert profile.link_loss.fault_reaction_option == OptionCode(0x605E, 0)


@pytest.mark.parametrize(
    ("gone", "consumer", "guarded"),
    [((), 0x1016, False), ((0x1016,), None, True), ((0x1016, 0x100C), None, False), ((0x1016, 0x100D), None, False)],
)
def test_the_guard_is_the_heartbeat_consumer_else_life_guarding(
    gone: tuple[int, ...], consumer: int | None, guarded: bool
) -> None:
    link_loss = profile_from_eds(without(generic(), *gone)).link_loss
    assert (link_loss.heartbeat_consumer, link_loss.life_guarding) == (consumer, guarded)


def test_the_echo_is_demand_else_actual_else_the_target_that_can_be_read() -> None:
    neither = without(generic(), 0x6074, 0x6077)
    assert profile_from_eds(generic()).torque.echo == "demand"
    assert profile_from_eds(without(generic(), 0x6074)).torque.echo == "actual"
    assert profile_from_eds(neither).torque.echo == "asked"
    assert profile_from_eds(changed(neither, 0x6071, access="wo")).torque.echo == "none"


@pytest.mark.parametrize(
    "name", both(["no_option_codes.eds", "fixed_mappings.eds"], ["ingenia_everest_xcr.eds", "nanotec_c5_e_1_09.eds"])
)
def test_drives_of_vendors_without_1016h_have_life_guarding(name: str) -> None:
    assert profile_from_eds(eds_of(name)).link_loss.life_guarding


def test_every_value_of_it_has_its_source() -> None:
    sources = profile_from_eds(without(generic(), 0x6007)).sources
    assert sources["torque.target.type"] == "own.eds, [6071] DataType"
    assert "ASSUMED" in sources["torque.target.unit"]
    assert "ASSUMED" not in sources["torque.target.object"]
    assert sources["link_loss.abort_connection_option"] == "left out: own.eds has no writable 6007h"
    assert sources["link_loss.fault_reaction_option.object"] == "own.eds, [605E]"


@pytest.mark.parametrize(
    ("modes", "mode"), [(0x200, 10), (0x208, 10), (0x008, 4), (0x06D, 4), (0, 10), (909, 10), (0x0003_03EF, 10)]
)
def test_the_mode_is_cyclic_torque_or_profile_torque_as_6502h_offers(modes: int, mode: int) -> None:
    assert profile_from_eds(changed(generic(), 0x6502, default=modes)).torque.mode_of_operation == mode


def test_a_mode_may_be_named_against_6502h() -> None:
    eds = changed(generic(), 0x6502, default=0x65)
    assert refusals(eds) == ["6502h supported drive modes 65h names no torque mode"]
    assert profile_from_eds(eds, -5).torque.mode_of_operation == -5


@pytest.mark.parametrize(
    ("index", "name"),
    [
        (0x6040, "controlword"),
        (0x6041, "statusword"),
        (0x6060, "modes of operation"),
        (0x6061, "modes of operation display"),
        (0x6071, "target torque"),
    ],
)
def test_a_missing_object_is_named(index: int, name: str) -> None:
    assert refusals(without(generic(), index)) == [f"there is no {index:04X}h {name}"]


def test_all_that_is_missing_is_told_at_once() -> None:
    eds = without(generic(), 0x6071, *range(0x1400, 0x1404), *range(0x1A00, 0x1A04))
    eds = changed(eds, 0x6502, default=1)
    assert refusals(eds) == [
        "there is no 6071h target torque",
        "there is no RPDO (1400h and 1600h)",
        "there is no TPDO (1800h and 1A00h)",
        "6502h supported drive modes 1h names no torque mode",
    ]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"type": EdsType.REAL32}, "6071h target torque is REAL32, expected INTEGER16 or INTEGER32"),
        ({"type": None}, "6071h target torque is of an unknown type, expected INTEGER16 or INTEGER32"),
        ({"mappable": False}, "6071h target torque cannot be received in a PDO"),
        ({"access": "ro"}, "6071h target torque cannot be received in a PDO"),
        ({"access": "rwr"}, "6071h target torque cannot be received in a PDO"),
    ],
)
def test_a_target_torque_that_cannot_be_used_is_told(changes: dict[str, object], message: str) -> None:
    assert refusals(changed(generic(), 0x6071, **changes)) == [message]


def test_a_position_that_cannot_be_sent_is_told() -> None:
    assert refusals(changed(generic(), 0x6064, mappable=False)) == [
        "6064h position actual value cannot be sent in a PDO"
    ]


def test_axes_in_sub_indices_are_recognised_and_the_key_for_them_is_named() -> None:
    """As in a node with two motors, whose positions are 6064h:01 and 6064h:02."""
    eds = generic()
    for subindex in (1, 2):
        eds = changed(eds, 0x6064, subindex, type=EdsType.INTEGER32, access="ro", mappable=True)
    eds = changed(eds, 0x6064, 0, type=EdsType.UNSIGNED8, access="const", default=2, mappable=False)
    first, second = refusals(eds)
    assert first.startswith("6064h position actual value is UNSIGNED8")
    assert second == (
        "several axes share this node, each in its own sub-index (6064h:01 and :02): write one profile per "
        "axis, with subindex = 1, 2 … in position.actual, torque.target and torque.actual"
    )
    assert not any("several axes" in each for each in refusals(without(generic(), 0x6064)))


@pytest.mark.parametrize(
    ("code", "unit"),
    [
        (None, "counts/s"),
        (0x00B4_4700, "rpm"),
        (0xFFB4_4700, "0.1 rpm"),
        (0xFEB4_4700, "0.01 rpm"),
        (0xFDB4_4700, "0.001 rpm"),
        (0x00B5_0300, "counts/s"),
    ],
)
def test_without_a_position_the_velocity_stands_in_in_the_unit_of_60a9h(code: int | None, unit: str) -> None:
    eds = without(generic(), 0x6064)
    if code is not None:
        eds = changed(eds, 0x60A9, type=EdsType.UNSIGNED32, default=code)
    profile = profile_from_eds(eds)
    assert profile.position is None
    assert profile.velocity == VelocitySection(MappedObject(0x606C, DataType.INT32, unit=unit))
    assert ("ASSUMED" in profile.sources["velocity.actual.unit"]) is (code is None)
    assert "position.actual.unit" not in profile.sources


def test_a_velocity_beside_a_position_is_not_read() -> None:
    assert profile_from_eds(generic()).velocity is None


def test_without_a_position_a_velocity_that_cannot_be_used_does_not_stand_in() -> None:
    missing, unit = without(generic(), 0x6064), {"type": EdsType.UNSIGNED32, "default": 0x0001_0300}
    useless = [
        without(missing, 0x606C),
        changed(missing, 0x606C, type=EdsType.REAL32),
        changed(missing, 0x606C, mappable=False),
        changed(missing, 0x606C, access="wo"),
        changed(missing, 0x60A9, **unit),
    ]
    for eds in useless:
        assert refusals(eds) == ["there is no 6064h position actual value"]


@needs_files
@pytest.mark.parametrize(
    ("name", "unit"),
    [("maxon_epos4_70_15.eds", "rpm"), ("nanotec_pd4_c6018.eds", "rpm"), ("ingenia_everest_xcr.eds", "counts/s")],
)
def test_vendors_name_units_of_velocity_that_are_known(name: str, unit: str) -> None:
    """The drive without its position object: 60A9h as the vendor's file has it."""
    eds = without(eds_of(name), 0x6064)
    velocity = profile_from_eds(eds, 10).velocity
    assert velocity is not None
    assert velocity.actual.unit == unit


@pytest.mark.parametrize(
    ("code", "unit"), [(None, "counts"), (0, "counts"), (0x00B5_0000, "counts"), (0xFF41_0000, "0.1 deg")]
)
def test_the_position_is_in_the_unit_of_60a8h(code: int | None, unit: str) -> None:
    eds = generic() if code is None else changed(generic(), 0x60A8, type=EdsType.UNSIGNED32, default=code)
    profile = profile_from_eds(eds)
    assert profile.position is not None
    assert profile.position.actual.unit == unit
    assert ("ASSUMED" in profile.sources["position.actual.unit"]) is (not code)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"default": 0xFF41_0000}, 0xFF41_0000),
        ({"default": -0x00BF_0000}, 0xFF41_0000),
        ({"default": 0x00B5_0000}, 0x00B5_0000),
        ({"default": 0}, None),
        ({"default": 0x0001_0000}, None),
        ({"default": 0xFF41_0000, "access": "ro"}, None),
        ({"default": 0xFF41_0000, "access": "wo"}, None),
        ({"default": 0xFF41_0000, "type": EdsType.UNSIGNED16}, None),
    ],
)
def test_the_unit_of_position_that_the_file_names_is_set_up(given: dict[str, object], code: int | None) -> None:
    eds = changed(generic(), 0x60A8, **{"type": EdsType.UNSIGNED32, "access": "rw", **given})
    profile = profile_from_eds(eds)
    written = () if code is None else (WrittenObject(0x60A8, DataType.UINT32, code),)
    assert profile.setup.writes == written
    assert ("setup.writes" in profile.sources) is bool(written)


def test_the_unit_of_velocity_is_set_up_where_no_position_is_read() -> None:
    eds = changed(generic(), 0x60A8, type=EdsType.UNSIGNED32, access="rw", default=0xFF41_0000)
    eds = changed(eds, 0x60A9, type=EdsType.UNSIGNED32, access="rw", default=0x00B4_4700)
    assert profile_from_eds(without(eds, 0x6064)).setup.writes == (WrittenObject(0x60A9, DataType.UINT32, 0xB4_4700),)
    assert [each.object for each in profile_from_eds(eds).setup.writes] == [0x60A8]


def test_a_position_in_another_unit_is_refused() -> None:
    metres = changed(generic(), 0x60A8, type=EdsType.UNSIGNED32, default=0x0001_0000)
    (refused,) = refusals(metres)
    assert "60A8h SI unit position is 00010000h, expected 00B50000h (counts)" in refused


@pytest.mark.parametrize(
    ("changes", "powers", "values"),
    [
        ({}, (-3,), (1, 255)),
        ({"low": -6, "high": 0}, (-3, -4, -5, -6), (1, 255)),
        ({"default": -4}, (-4,), (1, 255)),
        ({"access": "ro"}, None, None),
    ],
)
def test_the_period_is_told_in_the_objects_and_values_that_the_file_has(
    changes: dict[str, object], powers: tuple[int, ...] | None, values: tuple[int, int] | None
) -> None:
    sync = profile_from_eds(changed(generic(), 0x60C2, 2, **{"low": None, "high": None, **changes})).sync
    if powers is None:
        assert sync.interpolation_time is None
    else:
        assert (sync.interpolation_time, sync.powers, sync.values) == (0x60C2, powers, values)
    assert sync.cycle_period == 0x1006
    assert profile_from_eds(without(generic(), 0x1006)).sync.cycle_period is None


def test_limits_of_the_period_are_the_files() -> None:
    assert profile_from_eds(changed(generic(), 0x60C2, 1, low=0, high=100)).sync.values == (1, 100)


def test_a_torque_slope_is_as_steep_as_the_file_allows_in_profile_torque_mode_alone() -> None:
    ramped = changed(generic(), 0x6502, default=0x008)
    assert profile_from_eds(generic()).torque.slope is None
    assert profile_from_eds(ramped).torque.slope == WrittenObject(0x6087, DataType.UINT32, 1_000_000)
    assert profile_from_eds(changed(ramped, 0x6087, high=5000)).torque.slope == WrittenObject(
        0x6087, DataType.UINT32, 5000
    )
    assert profile_from_eds(without(ramped, 0x6087)).torque.slope is None


@pytest.mark.parametrize("changes", [{"mappable": False}, {"type": EdsType.REAL32}])
def test_an_actual_torque_that_cannot_be_sent_is_left_out(changes: dict[str, object]) -> None:
    assert profile_from_eds(changed(generic(), 0x6077, **changes)).torque.actual is None


def test_what_the_file_lacks_the_profile_leaves_out() -> None:
    profile = profile_from_eds(without(generic(), 0x1016, 0x6007, 0x605E, 0x6076, 0x6077, 0x1018))
    assert profile.link_loss.heartbeat_consumer is None
    assert profile.link_loss.abort_connection_option is None
    assert profile.link_loss.fault_reaction_option is None
    assert profile.torque.rated is None
    assert profile.torque.actual is None
    assert profile.identity == IdentitySection()


def test_the_identity_is_that_of_1018h_or_of_the_device() -> None:
    eds = changed(changed(generic(), 0x1018, 1, default=0xFB), 0x1018, 2, default=0)
    eds = Eds(eds.objects, DeviceInfo(vendor_number=1, product_number=0x6150_0000))
    profile = profile_from_eds(eds)
    assert profile.identity == IdentitySection(0xFB, (0x6150_0000,))
    assert (profile.drive.vendor, profile.drive.model) == ("unknown vendor", "unknown model")


def test_pdos_of_one_room_are_told_by_their_number() -> None:
    pdo = profile_from_eds(changed(changed(generic(), 0x1800, 3, default=1000), 0x1801, 3, default=300)).pdo
    assert (pdo.rpdos, pdo.tpdos, pdo.entries, pdo.rpdo_entries, pdo.tpdo_entries) == (4, 4, 8, (), ())
    assert pdo.inhibit_time_default == pytest.approx(0.1)


def test_each_pdo_has_its_own_room_and_a_missing_one_is_no_end_of_the_list() -> None:
    eds = without_member(without(generic(), 0x1801), 0x1601, 8)
    for subindex in range(2, 9):
        eds = without_member(eds, 0x1A03, subindex)
    pdo = profile_from_eds(eds).pdo
    assert (pdo.rpdos, pdo.tpdos, pdo.entries) == (4, 3, 8)
    assert pdo.rpdo_entries == (8, 7, 8, 8)
    assert pdo.tpdo_entries == (8, 0, 8, 1)
    assert pdo.room(Direction.TPDO) == {1: 8, 2: 0, 3: 8, 4: 1}


@pytest.mark.parametrize(
    ("index", "subindex", "changes"),
    [
        (0x1A00, 0, {"access": "ro"}),
        (0x1A00, 1, {"access": "const"}),
        (0x1800, 1, {"access": "ro"}),
    ],
)
def test_a_mapping_that_cannot_be_written_has_no_room(index: int, subindex: int, changes: dict[str, object]) -> None:
    pdo = profile_from_eds(changed(generic(), index, subindex, **changes)).pdo
    assert pdo.tpdo_entries == (0, 8, 8, 8)


def test_the_number_of_entries_may_be_limited() -> None:
    assert profile_from_eds(changed(generic(), 0x1A01, 0, high=2)).pdo.tpdo_entries == (8, 2, 8, 8)


def test_a_drive_whose_mappings_are_all_fixed_is_usable_when_they_carry_what_force_needs() -> None:
    """After power-on the simulated drive has the statusword in TPDO1 and both in TPDO2, and the others are empty."""
    eds = generic()
    for number in range(4):
        eds = changed(eds, 0x1A00 + number, 0, access="const")
    assert refusals(eds) == []
    assert refusals(changed(eds, 0x1A01, 0, default=1)) == [
        "no active TPDO carries 6064h position actual value, and no TPDO can be remapped: their "
        "records are read-only (1800h and 1A00h and on)"
    ]


def test_transmission_types_are_those_of_the_standard_within_the_limits_and_those_of_the_file() -> None:
    eds = changed(generic(), 0x1800, 2, low=0, high=254, default=253)
    pdo = profile_from_eds(eds).pdo
    assert (pdo.tpdo_types, pdo.rpdo_types) == ((1, 253, 254, 255), (1, 254, 255))


def test_types_without_a_name_in_profiles_have_none() -> None:
    assert data_type(EdsEntry(0x2000, 0, "gain", EdsType.REAL32, "rw")) is None
    assert data_type(EdsEntry(0x2000, 0, "gain", None, "rw")) is None


@pytest.mark.thorough("3 cases of one rule", quick=2)
@pytest.mark.parametrize("suffix", [".eds", ".EDS", ".dcf"])
def test_a_profile_is_loaded_from_the_path_of_an_eds(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"Push 1{suffix}"
    path.write_text(eds_text(generic()), encoding="utf-8")
    profile = load_profile(path)
    assert isinstance(profile, EdsProfile)
    assert (profile.name, profile.source) == ("Push 1", str(path))
    assert load_profile(str(path)) == profile


# Vendors' files.

USABLE = {name: SHEETS[name].mode for name in FORCE} | {
    "delta_asda_a2.eds": 4,
    "elmo_gold_drive.dcf": 10,
    "eyou_yiyouservo_v1_4.eds": 10,
    "ingenia_everest_xcr.eds": 10,
    "maxon_epos4_70_15.eds": 10,
    "maxon_epos4_compact_50_5_can.eds": 10,
    "maxon_epos4_module_50_5_6150h.eds": 10,
    "maxon_epos4_module_50_5_older.eds": 10,
    "nanotec_c5_e_1_09.eds": 10,
    "nanotec_pd4_c6018.eds": 10,
    "nanotec_pd4_cb59.eds": 10,
    "orientalmotor_blvd_kbrd_v300.eds": 4,
    "orientalmotor_blvd_krd_v400.eds": 4,
    "zeroerr_erob_v1_5.eds": 10,
}
"""Files with all that force needs, and their torque mode."""
NO_TARGET = "there is no 6071h target torque"
UNUSABLE = {name: sheet.lack for name, sheet in SHEETS.items() if sheet.lack} | {
    "faulhaber_605_3150_52_v.eds": NO_TARGET,
    "faulhaber_605_3150_55_d.eds": NO_TARGET,
    "faulhaber_605_3150_60_b.eds": NO_TARGET,
    "faulhaber_605_3150_68_b.eds": NO_TARGET,
    "faulhaber_mclm3002p_co.eds": NO_TARGET,
    "igus_dryve_d1.eds": NO_TARGET,
    "maxon_epos2_50_5_347717.eds": NO_TARGET,
    "maxon_epos2_70_10.eds": NO_TARGET,
    "pilz_prbt_0_1.dcf": NO_TARGET,
    "roboteq_v60.eds": "there is no 6040h controlword",
    "schunk_erb415_ros.eds": NO_TARGET,
    "schunk_lwa4p_0_63.dcf": NO_TARGET,
    "technosoft_ipos.eds": "6502h supported drive modes 1F0065h names no torque mode",
    "trinamic_tmcm_1270.eds": NO_TARGET,
    "xeryon_xla_5.eds": NO_TARGET,
}

NO_DRIVE = {"no_drive.eds", "roboteq_v60.eds"}
"""Files without the objects of CiA 402."""


def of_vendors(names: Iterable[str]) -> list[str]:
    """Return the names of vendors' files among others."""
    return [name for name in names if name not in SHEETS]


@needs_files
def test_every_vendor_file_is_either_usable_or_not() -> None:
    unknown = {*FILES} - USABLE.keys() - UNUSABLE.keys()
    for name in unknown:
        with contextlib.suppress(EdsError):
            assert profile_from_eds(eds_of(name)).name
    if unknown:
        pytest.skip(f"USABLE and UNUSABLE do not say whether it is usable: {', '.join(sorted(unknown))}")


@pytest.mark.parametrize("name", both(FORCE, of_vendors(USABLE)))
def test_a_vendor_file_with_torque_makes_a_profile(name: str) -> None:
    profile = canopen(path_of(name))
    assert profile.torque.mode_of_operation == USABLE[name]
    assert profile.drive.usable


@pytest.mark.parametrize("name", both([name for name in SHEETS if name not in FORCE], of_vendors(UNUSABLE)))
def test_a_vendor_file_without_torque_is_refused_with_what_is_missing(name: str) -> None:
    assert UNUSABLE[name] in refusals(eds_of(name))


@needs_files
@pytest.mark.parametrize(
    ("name", "inhibit_time", "consumer"),
    [
        ("ingenia_everest_xcr.eds", 0.1, None),
        ("nanotec_c5_e_1_09.eds", 0.01, None),
        ("nanotec_pd4_c6018.eds", 0.01, 0x1016),
        ("maxon_epos4_70_15.eds", 0.001, 0x1016),
    ],
)
def test_inhibit_times_and_heartbeat_consumers_are_those_of_the_files(
    name: str, inhibit_time: float, consumer: int | None
) -> None:
    profile = profile_from_eds(eds_of(name))
    assert profile.pdo.inhibit_time_default == pytest.approx(inhibit_time)
    assert profile.link_loss.heartbeat_consumer == consumer
