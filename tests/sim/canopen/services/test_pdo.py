"""CiA 301, 7.5.2.35 to 38: how PDOs are configured and refused, and when they are sent and act."""

import struct
from itertools import pairwise

import pytest

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.canopen.services.basics import INVALID
from haptic_fieldbus.sim.canopen.services.pdo import PdoDefaults, Rpdo, Tpdo
from haptic_fieldbus.sim.drive.dictionary import Access, AccessRefused, Dictionary, Entry, Mappable
from tests.sim.bench import MS, DriveBench, Refusal, profile

TPDO1, RPDO1 = 0x185, 0x205
STATUS, POSITION, CONTROL, TARGET = 0x6041_0010, 0x6064_0020, 0x6040_0010, 0x6071_0010
UNSUPPORTED, NOT_MAPPABLE, TOO_LONG = Refusal(0x0601_0000), Refusal(0x0604_0041), Refusal(0x0604_0042)
INVALID_VALUE = Refusal(0x0609_0030)


class TestPowerOn:
    """The predefined connection set."""

    def test_the_first_pdo_of_each_direction_exists_and_the_others_do_not(self) -> None:
        bench = DriveBench()
        for base, first in ((0x1400, 0x200), (0x1800, 0x180)):
            ids = [bench.read(base + number, 1) for number in range(4)]
            assert all(isinstance(value, int) for value in ids)
            assert [value & 0x7FF for value in ids if isinstance(value, int)] == [
                first + 0x100 * number + 5 for number in range(4)
            ]
            assert [bool(value & INVALID) for value in ids if isinstance(value, int)] == [False, True, True, True]
            assert bench.read(base, 2) == 255

    def test_statusword_and_controlword_are_mapped_first(self) -> None:
        bench = DriveBench()
        assert (bench.read(0x1A00), bench.read(0x1A00, 1)) == (1, STATUS)
        assert (bench.read(0x1600), bench.read(0x1600, 1)) == (1, CONTROL)
        assert (bench.read(0x1A01), bench.read(0x1A01, 2)) == (2, POSITION)

    def test_the_inhibit_time_is_that_of_the_profile(self) -> None:
        assert DriveBench(profile("maxon_epos4")).read(0x1800, 3) == 10

    def test_a_pdo_beyond_those_of_the_profile_does_not_exist(self) -> None:
        bench = DriveBench()
        assert bench.read(0x1804, 1) == Refusal(0x0602_0000)
        assert bench.read(0x1800, 4) == Refusal(0x0609_0011)
        assert bench.read(0x1400, 3) == Refusal(0x0609_0011)

    def test_a_drive_with_more_than_four_pdos_has_the_others_without_identifier(self) -> None:
        dictionary = Dictionary()
        pdo = Tpdo(dictionary, PdoDefaults(5, INVALID), lambda: None)
        assert not pdo.valid
        assert dictionary.value(0x1804, 1) == INVALID


class TestConfiguration:
    """Order and limits of a remap."""

    def test_a_mapping_cannot_be_changed_while_the_pdo_exists(self) -> None:
        bench = DriveBench()
        assert bench.write(0x1A00, 0, 0, "B") == UNSUPPORTED
        assert bench.write(0x1A00, 1, POSITION, "I") == UNSUPPORTED

    def test_entries_cannot_be_written_before_their_number_is_zero(self) -> None:
        bench = DriveBench()
        assert bench.write(0x1800, 1, INVALID | TPDO1, "I") is None
        assert bench.write(0x1A00, 1, POSITION, "I") == UNSUPPORTED
        assert bench.write(0x1A00, 0, 0, "B") is None
        assert bench.write(0x1A00, 1, POSITION, "I") is None

    @pytest.mark.parametrize(
        ("entry", "refusal"),
        [
            (0x7777_0010, Refusal(0x0602_0000)),
            (0x6041_0110, Refusal(0x0609_0011)),
            (0x1017_0010, NOT_MAPPABLE),
            (0x6041_0020, NOT_MAPPABLE),
            (0x6041_0008, NOT_MAPPABLE),
            (0x0006_0010, Refusal(0x0602_0000)),
        ],
        ids=["no object", "no sub-index", "not for PDOs", "too long", "too short", "dummy in a TPDO"],
    )
    def test_what_cannot_be_mapped_is_refused(self, entry: int, refusal: Refusal) -> None:
        bench = DriveBench()
        bench.write(0x1800, 1, INVALID | TPDO1, "I")
        bench.write(0x1A00, 0, 0, "B")
        assert bench.write(0x1A00, 1, entry, "I") == refusal

    def test_measured_values_cannot_be_received(self) -> None:
        bench = DriveBench()
        bench.write(0x1400, 1, INVALID | RPDO1, "I")
        bench.write(0x1600, 0, 0, "B")
        assert bench.write(0x1600, 1, POSITION, "I") == NOT_MAPPABLE

    def test_more_than_eight_octets_are_refused(self) -> None:
        bench = DriveBench()
        bench.write(0x1800, 1, INVALID | TPDO1, "I")
        bench.write(0x1A00, 0, 0, "B")
        for position, entry in enumerate((POSITION, POSITION, STATUS), start=1):
            assert bench.write(0x1A00, position, entry, "I") is None
        assert bench.write(0x1A00, 0, 3, "B") == TOO_LONG
        assert bench.write(0x1A00, 0, 2, "B") is None

    def test_more_entries_than_the_drive_has_are_refused(self) -> None:
        bench = DriveBench()
        entries = profile().pdo.entries
        bench.write(0x1800, 1, INVALID | TPDO1, "I")
        assert bench.write(0x1A00, 0, entries + 1, "B") == TOO_LONG
        assert bench.write(0x1A00, entries + 1, STATUS, "I") == Refusal(0x0609_0011)

    def test_an_unused_entry_may_be_zero_and_cannot_be_counted(self) -> None:
        bench = DriveBench()
        bench.write(0x1800, 1, INVALID | TPDO1, "I")
        bench.write(0x1A00, 0, 0, "B")
        assert bench.write(0x1A00, 2, 0, "I") is None
        assert bench.write(0x1A00, 0, 2, "B") == Refusal(0x0602_0000)

    @pytest.mark.parametrize("can_id", [0x000, 0x07F, 0x101, 0x180, 0x581, 0x67F, 0x6E0, 0x701, 0x7FF])
    def test_identifiers_of_restricted_use_are_refused(self, can_id: int) -> None:
        bench = DriveBench()
        bench.write(0x1800, 1, INVALID | TPDO1, "I")
        assert bench.write(0x1800, 1, can_id, "I") == INVALID_VALUE
        assert bench.write(0x1800, 1, INVALID | can_id, "I") is None

    def test_an_identifier_cannot_be_changed_while_the_pdo_exists(self) -> None:
        bench = DriveBench()
        assert bench.write(0x1800, 1, 0x1C5, "I") == INVALID_VALUE
        assert bench.write(0x1800, 1, TPDO1, "I") is None

    def test_extended_identifiers_are_refused(self) -> None:
        assert DriveBench().write(0x1800, 1, INVALID | 1 << 29 | TPDO1, "I") == INVALID_VALUE

    @pytest.mark.parametrize("type_", [241, 251])
    def test_reserved_transmission_types_are_refused(self, type_: int) -> None:
        bench = DriveBench()
        assert bench.write(0x1800, 2, type_, "B") == INVALID_VALUE
        assert bench.write(0x1400, 2, type_, "B") == INVALID_VALUE

    @pytest.mark.parametrize("type_", [252, 253])
    def test_only_what_is_sent_can_be_asked_for(self, type_: int) -> None:
        bench = DriveBench()
        assert bench.write(0x1800, 2, type_, "B") is None
        assert bench.write(0x1400, 2, type_, "B") == INVALID_VALUE

    @pytest.mark.parametrize("type_", [0, 1, 240, 254, 255])
    def test_the_other_transmission_types_are_taken(self, type_: int) -> None:
        bench = DriveBench()
        assert bench.write(0x1800, 2, type_, "B") is None
        assert bench.read(0x1800, 2) == type_

    def test_the_inhibit_time_is_fixed_while_the_pdo_exists(self) -> None:
        bench = DriveBench()
        assert bench.write(0x1800, 3, 0, "H") == UNSUPPORTED
        bench.write(0x1800, 1, INVALID | TPDO1, "I")
        assert bench.write(0x1800, 3, 0, "H") is None


class TestSynchronousTpdo:
    """Types 0 to 240."""

    def test_type_1_is_sent_after_every_sync(self) -> None:
        bench = DriveBench()
        bench.operational(tpdo_type=1)
        for _ in range(3):
            bench.sync()
        assert len(bench.take(TPDO1)) == 3

    def test_type_n_is_sent_after_every_nth_sync(self) -> None:
        bench = DriveBench()
        bench.operational(tpdo_type=3)
        counts = []
        for _ in range(9):
            bench.sync()
            counts.append(len(bench.take(TPDO1)))
        assert counts == [0, 0, 1] * 3

    def test_type_0_is_sent_at_the_sync_after_a_change_only(self) -> None:
        bench = DriveBench()
        bench.operational(tpdo_type=0)
        bench.sync()
        assert len(bench.take(TPDO1)) == 1
        bench.sync()
        assert bench.take(TPDO1) == []
        bench.control(0x06)
        assert bench.take(TPDO1) == []
        bench.sync()
        assert [data[:2] for data in bench.take(TPDO1)] == [b"\x31\x02"]

    def test_the_octets_are_little_endian_in_the_order_of_the_mapping(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.drive.servo.jump(-2)
        bench.sync()
        assert bench.take(TPDO1) == [struct.pack("<Hi", 0x0270, -2)]

    def test_sync_is_counted_from_the_entry_into_operational(self) -> None:
        bench = DriveBench()
        bench.operational(tpdo_type=2)
        bench.sync()
        bench.nmt(128)
        bench.nmt(1)
        bench.sync()
        assert bench.take(TPDO1) == []
        bench.sync()
        assert len(bench.take(TPDO1)) == 1


class TestEventDrivenTpdo:
    """Types 254 and 255: on change, not sooner than the inhibit time, and by the event timer."""

    def _bench(self, *, inhibit: int = 0, timer: int = 0) -> DriveBench:
        bench = DriveBench()
        assert bench.write(0x1800, 5, timer, "H") is None
        assert bench.write(0x1800, 1, INVALID | TPDO1, "I") is None
        assert bench.write(0x1800, 3, inhibit, "H") is None
        bench.operational(tpdo_type=255)
        bench.run(MS)
        bench.sent.clear()
        return bench

    def test_the_present_values_are_sent_once_on_entering_operational(self) -> None:
        bench = DriveBench()
        bench.operational(tpdo_type=255)
        bench.run(20 * MS)
        assert len(bench.take(TPDO1)) == 1

    def test_it_is_sent_when_a_mapped_value_changes_and_not_after_sync(self) -> None:
        bench = self._bench()
        bench.sync()
        assert bench.take(TPDO1) == []
        bench.drive.servo.jump(1)
        bench.run(10 * MS)
        assert len(bench.take(TPDO1)) == 1

    def test_changes_are_held_back_by_the_inhibit_time(self) -> None:
        bench = self._bench(inhibit=50)
        for _ in range(40):
            bench.drive.servo.jump(1)
            bench.run(400_000)
        times = [t_ns for t_ns, frame in bench.sent if frame.can_id == TPDO1]
        assert len(times) == pytest.approx(16 / 5, abs=1)
        assert min(b - a for a, b in pairwise(times)) >= 5 * MS

    def test_the_event_timer_sends_without_a_change(self) -> None:
        bench = self._bench(timer=10)
        bench.run(100 * MS)
        assert len(bench.take(TPDO1)) == pytest.approx(10, abs=1)

    def test_nothing_is_sent_outside_operational(self) -> None:
        bench = self._bench(timer=10)
        bench.nmt(128)
        bench.run(100 * MS)
        assert bench.take(TPDO1) == []


class TestRpdo:
    """When received values act."""

    def test_an_event_driven_rpdo_acts_when_it_is_received(self) -> None:
        bench = DriveBench()
        bench.operational(rpdo_type=255)
        bench.control(0x06)
        assert bench.status() & 0x6F == 0x21

    def test_a_synchronous_rpdo_acts_at_the_next_sync(self) -> None:
        bench = DriveBench()
        bench.operational(rpdo_type=1)
        bench.control(0x06)
        assert bench.status() & 0x6F == 0x60
        bench.sync()
        assert bench.status() & 0x6F == 0x21

    def test_of_two_synchronous_rpdos_the_later_one_acts(self) -> None:
        bench = DriveBench()
        bench.operational(rpdo_type=0)
        bench.control(0x06)
        bench.control(0x00)
        bench.sync()
        assert bench.status() & 0x6F == 0x60

    def test_measured_values_are_latched_before_received_ones_act(self) -> None:
        bench = DriveBench()
        bench.operational(rpdo_type=1)
        bench.control(0x06)
        bench.sync()
        bench.sync()
        assert [data[:2].hex() for data in bench.take(TPDO1)] == ["7002", "3102"]

    def test_a_synchronous_rpdo_that_waits_is_forgotten_on_leaving_operational(self) -> None:
        bench = DriveBench()
        bench.operational(rpdo_type=1)
        bench.control(0x06)
        bench.nmt(128)
        bench.nmt(1)
        bench.sync()
        assert bench.status() & 0x6F == 0x60

    def test_a_frame_that_is_too_long_is_used_up_to_its_length(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.give(RPDO1, bytes.fromhex("06 00 00 00 ff ff"))
        assert bench.status() & 0x6F == 0x21

    def test_a_frame_that_is_too_short_is_ignored_and_reported_until_a_good_one_comes(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.give(RPDO1, b"\x06\x00\x00")
        bench.give(RPDO1, b"\x06")
        assert bench.take(0x85) == [bytes.fromhex("10 82 11 00 00 00 00 00")]
        assert bench.status() & 0x6F == 0x60
        bench.control(0x06)
        assert bench.take(0x85) == [bytes(8)]

    def test_an_rpdo_does_nothing_outside_operational(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.nmt(128)
        bench.control(0x06)
        assert bench.status() & 0x6F == 0x60

    def test_dummy_entries_leave_space(self) -> None:
        bench = DriveBench()
        bench.map(1, 255, [0x0005_0008, 0x0007_0020, CONTROL], tpdo=False)
        bench.nmt(1)
        bench.give(RPDO1, bytes.fromhex("aa bb bb bb bb 06 00"))
        assert bench.status() & 0x6F == 0x21


def test_a_described_pdo_that_maps_text_is_none_until_it_maps_numbers() -> None:
    """As some vendors' files have it: the drive starts all the same, and sends nothing."""
    text = Entry(0x1008, 0, None, text=b"name", mappable=Mappable.TPDO, access=Access.CONST)
    dictionary = Dictionary([text, Entry(0x6041, 0, DataType.UINT16, 0, Access.RO, mappable=Mappable.TPDO)])
    pdo = Tpdo(dictionary, PdoDefaults(1, 0x181, (0x1008_0020,)), lambda: None)
    assert pdo.exists
    assert not pdo.valid
    assert pdo.mapped == []
    with pytest.raises(AccessRefused, match="06040041h"):
        written(dictionary, 0x1008_0020)
    written(dictionary, STATUS)
    assert pdo.valid


def written(dictionary: Dictionary, mapping: int) -> None:
    """TPDO 1 mapped to one object, in the order of CiA 301, 7.5.2.36."""
    for index, subindex, value in (
        (0x1800, 1, 0x181 | INVALID), (0x1A00, 0, 0), (0x1A00, 1, mapping), (0x1A00, 0, 1), (0x1800, 1, 0x181)
    ):  # fmt: skip
        entry = dictionary.find(index, subindex)
        entry.write(value.to_bytes(entry.bits // 8, "little"))


def test_a_compiled_rpdo_writes_signed_values() -> None:
    dictionary = Dictionary([Entry(0x6071, 0, DataType.INT16, mappable=Mappable.RPDO, access=Access.RW)])
    pdo = Rpdo(dictionary, PdoDefaults(1, 0x201, (TARGET,), max_entries=1), lambda: None)
    pdo.apply(b"\xff\xff\x00")
    assert dictionary.value(0x6071) == -1


class TestDeadline:
    """1400h:05, the event timer of an RPDO; what the standard leaves to the application: 6007h."""

    def _bench(self) -> DriveBench:
        bench = DriveBench(profile("generic_cia402"))
        assert bench.write(0x1400, 5, 20, "H") is None
        bench.enable()
        bench.sent.clear()
        return bench

    def test_a_missed_deadline_is_a_lost_link(self) -> None:
        bench = self._bench()
        assert bench.write(0x6007, 0, 2, "h") is None
        bench.control(0x0F)
        bench.run(19 * MS)
        assert bench.status() & 0x6F == 0x27
        bench.run(MS)
        assert bench.status() & 0x6F == 0x60

    def test_a_pdo_that_is_taken_away_has_none(self) -> None:
        bench = self._bench()
        assert bench.write(0x6007, 0, 0, "h") is None
        bench.run(20 * MS)
        assert bench.read(0x1001) == 0x11
        assert bench.write(0x1400, 1, INVALID | RPDO1, "I") is None
        assert bench.read(0x1001) == 0
        bench.sent.clear()
        bench.run(100 * MS)
        assert bench.take(0x85) == []

    def test_a_frame_that_is_too_short_does_not_keep_it(self) -> None:
        bench = self._bench()
        bench.control(0x0F)
        bench.run(10 * MS)
        bench.give(RPDO1, b"\0")
        bench.run(10 * MS)
        assert [data[:2] for data in bench.take(0x85)] == [b"\x10\x82", b"\x50\x82"]
