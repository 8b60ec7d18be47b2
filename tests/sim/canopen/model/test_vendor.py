"""Simulated drives of vendors' EDS files: the dictionary is the file's, the behaviour the simulated drive's."""

import re
import struct
from dataclasses import replace
from pathlib import Path

import can
import pytest

import haptic_fieldbus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType, NodeOffset, eds_text
from haptic_fieldbus.errors import BusConfigurationError, PlanError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.eds_values import data_type
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.model import BENCH_VALUES
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Entry
from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.eds.peculiar import DRIVES, FORCE
from tests.eds.sheets import changed, generic, own, without, without_member
from tests.eds.vendor_files import both, eds_of, facts_of, path_of
from tests.protocols.canopen.test_from_eds import NO_DRIVE, UNUSABLE, USABLE, of_vendors
from tests.sim.bench import NODE, DriveBench, Refusal

INVALID = 1 << 31
NO_RTR = 1 << 30
READ_ONLY, WRITE_ONLY, NO_OBJECT = (
    Refusal(code.value) for code in (AbortCode.READ_ONLY, AbortCode.WRITE_ONLY, AbortCode.NO_OBJECT)
)


def bench_of(eds: Eds, mode: int | None = None) -> DriveBench:
    return DriveBench(profile_from_eds(eds, mode))


def entry_of(bench: DriveBench, index: int, subindex: int = 0) -> Entry:
    return bench.drive.dictionary.find(index, subindex)


class TestStorage:
    """Objects that the drive does not know are stored as the file describes them."""

    def stored(self, **changes: object) -> DriveBench:
        return bench_of(changed(generic(), 0x2100, 0, **changes))

    def test_it_holds_what_is_written(self) -> None:
        bench = self.stored(default=7)
        assert bench.read(0x2100) == 7
        assert bench.write(0x2100, 0, 8, "H") is None
        assert bench.read(0x2100) == 8

    def test_power_on_brings_the_default_back(self) -> None:
        bench = self.stored(default=7)
        assert bench.write(0x2100, 0, 8, "H") is None
        bench.nmt(129)
        bench.run(100_000_000)
        assert bench.read(0x2100) == 7

    def test_a_default_that_follows_the_node_id_does(self) -> None:
        assert self.stored(default=NodeOffset(0x300)).read(0x2100) == 0x305

    def test_values_follow_the_node_id_where_the_file_says_so_and_nowhere_else(self) -> None:
        eds = changed(changed(generic(), 0x2100, default=NodeOffset(0x300)), 0x1800, 1, default=0x181)
        dictionary = bench_of(eds).drive.dictionary
        dictionary.renumber(3)
        assert dictionary.find(0x2100).default == 0x305 + 3
        assert dictionary.find(0x1800, 1).default == 0x181
        assert dictionary.find(0x1801, 1).default & 0x7FF == 0x280 + NODE + 3

    @pytest.mark.parametrize("access", ["ro", "const"])
    def test_what_is_read_only_is_not_written(self, access: str) -> None:
        bench = self.stored(access=access, default=7)
        assert bench.write(0x2100, 0, 8, "H") == READ_ONLY
        assert bench.read(0x2100) == 7

    def test_what_is_write_only_is_not_read(self) -> None:
        bench = self.stored(access="wo")
        assert bench.write(0x2100, 0, 8, "H") is None
        assert bench.read(0x2100) == WRITE_ONLY

    def test_limits_are_kept(self) -> None:
        bench = self.stored(low=2, high=9)
        assert bench.read(0x2100) == 2, "the value next to 0 that the limits allow"
        assert bench.write(0x2100, 0, 10, "H") == Refusal(AbortCode.VALUE_TOO_HIGH.value)
        assert bench.write(0x2100, 0, 1, "H") == Refusal(AbortCode.VALUE_TOO_LOW.value)

    @pytest.mark.parametrize("limits", [(9, 2), (0, 0), (8, 9)])
    def test_limits_that_contradict_themselves_or_the_default_are_none(self, limits: tuple[int, int]) -> None:
        bench = self.stored(low=limits[0], high=limits[1], default=7)
        assert bench.write(0x2100, 0, 10, "H") is None

    @pytest.mark.parametrize(
        ("type", "default", "octets"),
        [
            (EdsType.REAL32, 10.0, struct.pack("<f", 10.0)),
            (EdsType.REAL32, None, bytes(4)),
            (EdsType.REAL64, 1.5, struct.pack("<d", 1.5)),
            (EdsType.BOOLEAN, 1, b"\1"),
            (EdsType.BOOLEAN, None, b"\0"),
            (EdsType.INTEGER64, -2, struct.pack("<q", -2)),
            (EdsType.UNSIGNED24, 0x010203, b"\3\2\1"),
            (EdsType.VISIBLE_STRING, "servo", b"servo"),
            (EdsType.VISIBLE_STRING, None, b""),
            (EdsType.UNICODE_STRING, "né", "né".encode("utf-16-le")),
            (EdsType.OCTET_STRING, b"\1\2", b"\1\2"),
            (EdsType.DOMAIN, None, b""),
            (None, None, bytes(4)),
            (None, 5, b"\5\0\0\0"),
            (EdsType.INTEGER8, -1, b"\xff"),
        ],
    )
    def test_each_type_starts_with_its_default(self, type: EdsType | None, default: object, octets: bytes) -> None:
        assert entry_of(self.stored(type=type, default=default), 0x2100).read() == octets

    def test_octets_of_a_fixed_size_come_all_at_once(self) -> None:
        entry = entry_of(self.stored(type=EdsType.INTEGER64, default=1), 0x2100)
        with pytest.raises(AccessRefused) as short:
            entry.write(bytes(7))
        with pytest.raises(AccessRefused) as long:
            entry.write(bytes(9))
        assert (short.value.code, long.value.code) == (AbortCode.TOO_SHORT.value, AbortCode.TOO_LONG.value)
        entry.write(bytes(8))
        assert entry.read() == bytes(8)

    def test_strings_and_domains_have_room(self) -> None:
        for type, octets in ((EdsType.VISIBLE_STRING, 256), (EdsType.DOMAIN, 32 * 1024), (None, 8)):
            entry = entry_of(self.stored(type=type), 0x2100)
            entry.write(bytes(octets))
            assert len(entry.read()) == octets

    @pytest.mark.parametrize(
        ("access", "received", "sent"),
        [("rw", True, True), ("rww", True, False), ("rwr", False, True), ("ro", False, True), ("wo", True, False)],
    )
    def test_mappability_is_that_of_the_access_type(self, access: str, received: bool, sent: bool) -> None:
        """CiA 306-1: rwr is mapped to be sent only, rww to be received only."""
        bench = self.stored(access=access, mappable=True)
        for number, (base, expected) in enumerate(((0x1600, received), (0x1A00, sent))):
            communication = base - 0x200
            cob_id = 0x200 + NODE if not number else 0x180 + NODE
            assert bench.write(communication, 1, cob_id | INVALID, "I") is None
            assert bench.write(base, 0, 0, "B") is None
            answer = bench.write(base, 1, 0x2100_0010, "I")
            assert answer == (None if expected else Refusal(AbortCode.NOT_MAPPABLE.value))

    def test_what_is_not_mappable_stays_so(self) -> None:
        bench = self.stored(access="rw")
        assert bench.write(0x1601, 0, 0, "B") is None
        assert bench.write(0x1601, 1, 0x2100_0010, "I") == Refusal(AbortCode.NOT_MAPPABLE.value)


class TestTakenOver:
    """An object that the drive works with keeps its behaviour and takes the rest from the file."""

    def test_a_drive_of_its_own_sheet_is_the_same_drive(self) -> None:
        assert own(profile_from_eds(generic())).objects == generic().objects

    def test_what_the_file_does_not_have_is_not_there(self) -> None:
        bench = bench_of(without_member(without(generic(), 0x1016, 0x6072, 0x5FF0), 0x1018, 4))
        assert [bench.read(index, 1) for index in (0x1016, 0x6072, 0x5FF0)] == [NO_OBJECT] * 3
        assert bench.read(0x1018, 4) == Refusal(AbortCode.NO_SUBINDEX.value)
        bench.enable()

    def test_a_drive_without_sync_objects_still_follows_sync(self) -> None:
        bench = bench_of(without(generic(), 0x1005, 0x1006, 0x1007, 0x1014, 0x1019, 0x1029, 0x1200))
        bench.operational()
        bench.sent.clear()
        bench.sync()
        assert len(bench.take(0x180 + NODE)) == 1

    def test_defaults_and_access_are_the_files(self) -> None:
        eds = changed(changed(generic(), 0x605A, default=6), 0x1005, access="const")
        bench = bench_of(eds)
        assert bench.read(0x605A) == 6
        assert bench.write(0x1005, 0, 0x80, "I") == READ_ONLY

    def test_the_name_is_the_files(self) -> None:
        entry = entry_of(bench_of(changed(generic(), 0x1008, default="Push 1")), 0x1008)
        assert entry.read() == b"Push 1"

    def test_measured_values_are_the_drives_own(self) -> None:
        bench = bench_of(changed(changed(generic(), 0x6041, default=0xFFFF), 0x6061, default=3))
        assert bench.status() & 0x6F == 0x40 | 0x20 & bench.status()
        assert bench.read(0x6061) == 0

    @pytest.mark.parametrize("index", sorted(BENCH_VALUES & {0x6075, 0x6076, 0x6084}))
    def test_values_of_the_bench_are_the_rigs(self, index: int) -> None:
        eds = generic()
        own_value = bench_of(eds).read(index)
        assert bench_of(changed(eds, index, default=1)).read(index) == own_value

    def test_a_torque_limit_of_the_file_acts(self) -> None:
        """6072h = 0, as Nanotec delivers the C5-E: enabled, but without torque (bit 11, internal limit active)."""
        bench = bench_of(changed(generic(), 0x6072, default=0))
        bench.enable()
        bench.control(0x0F, 500)
        bench.run(2_000_000)
        assert bench.read(0x6074) == 0
        assert bench.status() & 0x0800
        assert bench.write(0x6072, 0, 1000, "H") is None
        bench.control(0x0F, 500)
        assert bench.read(0x6074) == 500

    def test_a_wider_type_of_the_file_is_taken(self) -> None:
        bench = bench_of(changed(generic(), 0x60B2, type=EdsType.INTEGER32, low=-32767, high=32767))
        assert bench.write(0x60B2, 0, -100, "i") is None
        assert bench.write(0x60B2, 0, 40000, "i") == Refusal(AbortCode.VALUE_TOO_HIGH.value)

    @pytest.mark.parametrize(("limit", "asked", "shown"), [(-1000, -500, -500), (-300, -500, -300), (300, 0, 300)])
    def test_a_signed_limit_downwards_is_the_lowest_torque(self, limit: int, asked: int, shown: int) -> None:
        """60E1h as INTEGER16 of −1000 (Ingenia Everest XCR); CiA 402-2 has an UNSIGNED16 there."""
        bench = bench_of(changed(generic(), 0x60E1, type=EdsType.INTEGER16, default=-1000))
        assert bench.read(0x60E1) == 0x10000 - 1000
        assert bench.write(0x60E1, 0, limit, "h") is None
        bench.enable()
        bench.control(0x0F, asked)
        assert bench.read(0x6074) == shown % 0x10000

    def test_another_type_of_what_is_measured_is_stored_as_the_file_has_it(self) -> None:
        bench = bench_of(changed(generic(), 0x6078, type=EdsType.INTEGER32, default=3))
        assert bench.read(0x6078) == 3

    def test_the_modes_are_those_of_6502h(self) -> None:
        bench = bench_of(changed(generic(), 0x6502, default=0x208))
        answers = {mode: bench.write(0x6060, 0, mode, "b") for mode in (1, 3, 4, 8, 9, 10)}
        assert [mode for mode, answer in answers.items() if answer is None] == [4, 10]

    def test_named_modes_go_before_6502h(self) -> None:
        bench = DriveBench(profile_from_eds(generic()), settings=DriveSettings(modes=frozenset({10})))
        assert bench.write(0x6060, 0, 4, "b") is not None


class TestPdos:
    """PDOs after power-on are those of the file."""

    def test_mapping_type_and_identifier_are_the_files(self) -> None:
        eds = changed(generic(), 0x1A00, 0, default=2)
        eds = changed(changed(eds, 0x1A00, 2, default=0x6064_0020), 0x1800, 2, default=1)
        bench = bench_of(changed(eds, 0x1800, 1, default=NodeOffset(0x280)))
        bench.nmt(1)
        bench.sync()
        (data,) = bench.take(0x280 + NODE)
        assert len(data) == 6

    def test_what_the_file_maps_itself_can_be_mapped(self) -> None:
        eds = changed(generic(), 0x2100, default=0x1234)
        bench = bench_of(changed(changed(eds, 0x1A00, 1, default=0x2100_0010), 0x1800, 2, default=1))
        assert bench.slave.not_taken_over == ()
        bench.nmt(1)
        bench.sync()
        assert bench.take(0x180 + NODE) == [b"\x34\x12"]

    def test_dummies_may_be_mapped_to_be_received(self) -> None:
        bench = bench_of(changed(generic(), 0x1600, 1, default=0x0006_0010))
        assert bench.slave.not_taken_over == ()

    def test_a_missing_identifier_leaves_the_pdo_off(self) -> None:
        """Elmo Gold: RPDO2 and TPDO2 have a COB-ID without a value."""
        bench = bench_of(changed(changed(generic(), 0x1801, 1, default=None), 0x1801, 2, default=None))
        assert bench.read(0x1801, 1) == INVALID
        assert bench.read(0x1801, 2) == 255

    @pytest.mark.parametrize(
        ("changes", "reason"),
        [
            ({"default": 0x2FFF_0010}, "1A00h: 2FFF0010h names an object that does not exist"),
            ({"default": 0x6041_0020}, "1A00h: 60410020h has another length than its object"),
            ({"default": 0x1008_0020}, "1A00h: 10080020h has another length than its object"),
            ({"default": 0x6041_0010, "subindex": 0}, "1A00h: there are fewer than 9 entries"),
        ],
    )
    def test_a_mapping_that_cannot_work_is_told_and_left_empty(self, changes: dict[str, int], reason: str) -> None:
        eds = changed(generic(), 0x1A00, 1, default=changes["default"])
        if "subindex" in changes:
            eds = changed(eds, 0x1A00, 0, default=9)
            for subindex in range(2, 9):
                eds = changed(eds, 0x1A00, subindex, default=0x1001_0008)
        bench = bench_of(eds)
        assert bench.slave.not_taken_over == (f"{reason}; this PDO is left without objects",)
        assert bench.read(0x1A00) == 0
        assert bench.read(0x1800, 1) == INVALID | NO_RTR | 0x180 + NODE

    def test_more_than_eight_octets_are_told(self) -> None:
        eds = changed(generic(), 0x1A00, 0, default=3)
        for subindex in (1, 2, 3):
            eds = changed(eds, 0x1A00, subindex, default=0x6064_0020)
        assert "96 bits do not fit into a PDO" in bench_of(eds).slave.not_taken_over[0]

    def test_each_pdo_has_the_entries_of_its_own_record(self) -> None:
        bench = bench_of(without_member(generic(), 0x1600, 8))
        assert bench.read(0x1600, 8) == Refusal(AbortCode.NO_SUBINDEX.value)
        assert bench.read(0x1601, 8) == bench.read(0x1A00, 8) == 0

    def test_a_missing_pdo_is_no_end_of_the_list(self) -> None:
        eds = without(generic(), 0x1801, 0x1A01)
        bench = bench_of(changed(changed(eds, 0x1A02, 0, default=1), 0x1A02, 1, default=0x6041_0010))
        assert bench.read(0x1801, 1) == NO_OBJECT
        bench.map(3, 1, [0x6041_0010], tpdo=True)
        bench.nmt(1)
        bench.sync()
        assert len(bench.take(0x380 + NODE)) == 1

    def test_a_record_without_its_other_one_is_no_pdo_and_is_told(self) -> None:
        bench = bench_of(without(generic(), 0x1401, 0x1A02))
        assert bench.slave.not_taken_over == (
            "1601h: the other record of this PDO is missing; the PDO is omitted",
            "1802h: the other record of this PDO is missing; the PDO is omitted",
        )
        assert bench.read(0x1601) == bench.read(0x1802, 1) == NO_OBJECT

    def test_a_fixed_mapping_is_not_written(self) -> None:
        bench = bench_of(changed(generic(), 0x1A00, 0, access="const"))
        assert bench.write(0x1800, 1, 1 << 31, "I") is None
        assert bench.write(0x1A00, 0, 0, "B") == READ_ONLY

    def test_entries_that_the_file_lacks_are_out_of_reach_and_have_no_effect(self) -> None:
        """Without 1A00h:00 nothing is mapped, and without 1801h:01 there is no identifier."""
        bench = bench_of(without_member(without_member(generic(), 0x1A00, 0), 0x1801, 1))
        assert bench.read(0x1A00) == bench.read(0x1801, 1) == Refusal(AbortCode.NO_SUBINDEX.value)
        bench.nmt(1)
        bench.sync()
        assert bench.take(0x180 + NODE) == []

    def test_what_every_device_has_is_there_without_the_file(self) -> None:
        bench = bench_of(without(generic(), 0x1000, 0x1001, 0x1018))
        assert isinstance(bench.read(0x1000), int)
        assert bench.read(0x1018, 1) == 0
        assert bench.read(0x1018, 2) == Refusal(AbortCode.NO_SUBINDEX.value)


class TestPositionDrives:
    """Drives without torque are simulated too: a program that positions has a drive to be tested with."""

    def test_modes_without_6502h_are_those_whose_target_is_there(self) -> None:
        bench = bench_of(without(generic(), 0x6502, 0x6071, 0x60FF))
        answers = {mode: bench.write(0x6060, 0, mode, "b") for mode in (1, 3, 4, 6, 8, 9, 10)}
        assert [mode for mode, answer in answers.items() if answer is None] == [1, 6, 8]

    @pytest.mark.parametrize("gone", [(0x6071,), (0x6071, 0x6060, 0x6061), (0x6071, *range(0x1400, 0x1C00))])
    def test_a_drive_without_torque_goes_to_operation_enabled(self, gone: tuple[int, ...]) -> None:
        enable_by_sdo(bench_of(without(generic(), *gone)))


def enable_by_sdo(bench: DriveBench) -> None:
    """To *operation enabled* by 6040h, without PDOs."""
    for controlword in (0x06, 0x07, 0x0F):
        assert bench.write(0x6040, 0, controlword, "H") is None
        bench.run(5_000_000)
    assert bench.status() & 0x6F == 0x27


# Vendors' files.


EVERY = both(FORCE, of_vendors(USABLE))


@pytest.fixture(scope="module", params=EVERY)
def vendor(request: pytest.FixtureRequest) -> tuple[Eds, DriveBench]:
    eds = eds_of(request.param)
    return eds, bench_of(eds)


def test_a_vendors_drive_has_every_object_of_its_file_and_no_other(vendor: tuple[Eds, DriveBench]) -> None:
    eds, bench = vendor
    theirs = {(entry.index, entry.subindex): entry for entry in eds}
    ours = {(entry.index, entry.subindex): entry for entry in bench.drive.dictionary}
    assert ours.keys() == theirs.keys()
    assert bench.slave.not_taken_over == ()
    for key, entry in ours.items():
        assert (entry.access.value, entry.access is Access.RW) == (
            theirs[key].access[:2] if theirs[key].access.startswith("rw") else theirs[key].access,
            theirs[key].access.startswith("rw"),
        )


def test_a_vendors_drive_answers_with_the_values_and_lengths_of_its_file(vendor: tuple[Eds, DriveBench]) -> None:
    eds, bench = vendor
    for described in eds:
        entry = entry_of(bench, described.index, described.subindex)
        if described.access == "wo" or (described.index == 0x1003 and described.subindex):
            continue  # the history is empty: SDO abort 0800 0024h
        octets = entry.read()
        if described.type is not None and described.type.size is not None:
            assert len(octets) == described.type.size
        if _is_the_files(described):
            assert int.from_bytes(octets, "little") == _number(described), f"{described.index:04X}h"


def _is_the_files(described: EdsEntry) -> bool:
    """An integer with a value whose place is not measured and not the bench's."""
    writable = described.access in ("rw", "rww", "rwr", "const")
    standard = described.index < 0x2000 or described.index >= 0x6000
    value = described.value(NODE)
    known = isinstance(value, int) and data_type(described) is not None
    return known and described.index not in BENCH_VALUES and (writable or not standard)


def _number(described: EdsEntry) -> int:
    value = described.value(NODE)
    assert isinstance(value, int)
    assert described.type is not None
    return value % (1 << 8 * (described.type.size or 0))


def test_a_vendors_drive_is_enabled_in_its_torque_mode_and_makes_torque(vendor: tuple[Eds, DriveBench]) -> None:
    _, bench = vendor
    bench = DriveBench(profile_from_eds(vendor[0]))
    mode = bench.drive.objects.torque_mode
    bench.map(1, 1, [0x6041_0010, 0x6064_0020], tpdo=True)
    bench.map(1, 255, [0x6040_0010, 0x6071_0010], tpdo=False)
    assert bench.write(0x6060, 0, mode, "b") is None
    bench.nmt(1)
    for controlword in (0x06, 0x07, 0x0F):
        bench.control(controlword)
    assert bench.status() & 0x6F == 0x27
    assert bench.read(0x6061) == mode
    if isinstance(bench.read(0x6072), int):
        assert bench.write(0x6072, 0, 1000, "H") is None
    bench.control(0x0F, 100)
    bench.run(20_000_000)
    bench.drive.servo.advance(bench.t_ns)
    assert bench.drive.plant.torque > 0.0


PDO = re.compile(r"([RT])(\d+) ([0-9A-F]+) (\(off\) )?tt=(\d+) \[(.*?)\]")
PDOS = {
    "cyclic_torque.dcf": "R1 205 tt=1 [6040:0 6060:0]; R2 0 (off) tt=255 [6040:0 6071:0]; R3 405 (off) tt=255 []; "
    "T1 185 tt=255 [6041:0 6064:0]; T2 0 (off) tt=255 []; T3 385 (off) tt=255 []",
    "profile_torque.eds": "R1 205 tt=255 [6040:0]; R2 305 (off) tt=255 [6040:0 6071:0]; T1 185 tt=255 [6041:0]",
    "no_option_codes.eds": "R1 205 (off) tt=255 [6040:0]; T1 185 tt=255 [6041:0]",
    "capitals.eds": "T1 185 tt=0 [6041:0]; T2 285 (off) tt=253 [6041:0 6064:0]",
    "fixed_mappings.eds": "R1 205 tt=255 [6040:0]; R2 305 (off) tt=255 [6040:0]; T2 285 (off) tt=255 [6041:0 6064:0]",
    "positions.eds": "R1 205 tt=255 [6040:0]; R3 405 (off) tt=255 []; T3 385 (off) tt=255 []",
}
"""After power-on as node 5, in the files of our own."""


@pytest.mark.parametrize("name", both(PDOS, of_vendors(USABLE)))
def test_pdos_after_power_on_are_those_another_reader_found_in_the_file(name: str) -> None:
    bench = bench_of(eds_of(name))
    found = PDO.findall(PDOS.get(name) or facts_of(name).line("Default"))
    assert found
    for way, number, cob_id, off, type, mapped in found:
        communication = (0x1400 if way == "R" else 0x1800) + int(number) - 1
        value = bench.read(communication, 1)
        assert isinstance(value, int)
        assert (value & 0x7FF, bool(value & INVALID)) == (int(cob_id, 16), bool(off))
        assert bench.read(communication, 2) == int(type)
        count = bench.read(communication + 0x200)
        assert isinstance(count, int)
        entries = [bench.read(communication + 0x200, position) for position in range(1, count + 1)]
        names = [f"{entry >> 16:04X}:{entry >> 8 & 0xFF:X}" for entry in entries if isinstance(entry, int)]
        assert names == mapped.split()


def test_an_eds_is_put_on_the_simulated_bus_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "push1.eds"
    path.write_text(eds_text(changed(generic(), 0x2100, default=0x1234)), encoding="utf-8")
    with can.Bus(interface="haptic_sim", channel=f"{path}@{NODE}", clock=VirtualClock()) as bus:
        request = bytes((0x40, 0x00, 0x21, 0, 0, 0, 0, 0))
        bus.send(can.Message(arbitration_id=0x600 + NODE, data=request, is_extended_id=False))
        message = bus.recv(0.01)
        assert message is not None
        assert bytes(message.data) == bytes((0x4B, 0x00, 0x21, 0, 0x34, 0x12, 0, 0))


def test_an_eds_of_no_drive_is_refused_on_the_simulated_bus(tmp_path: Path) -> None:
    path = tmp_path / "push1.eds"
    path.write_text(eds_text(without(generic(), 0x6041)), encoding="utf-8")
    with pytest.raises(can.CanInitializationError, match="not a CiA 402 drive: there is no 6041h statusword"):
        can.Bus(interface="haptic_sim", channel=f"{path}@{NODE}", clock=VirtualClock())


def test_a_drive_without_torque_is_refused_for_force_alone(tmp_path: Path) -> None:
    path = tmp_path / "push1.eds"
    path.write_text(eds_text(without(generic(), 0x6071)), encoding="utf-8")
    with pytest.raises(PlanError, match="is not usable for force: there is no 6071h target torque"):
        haptic_fieldbus.plan("wall", drive=str(path))


PROFILE_POSITION = 1
VENDORS = sorted({*of_vendors([*USABLE, *UNUSABLE])} - NO_DRIVE)


@pytest.mark.parametrize("name", both(DRIVES, VENDORS))
def test_every_vendors_drive_can_be_positioned_if_the_vendor_says_so(name: str) -> None:
    """A position master, by SDO: mode 1, a target, the new set-point bit; the shaft goes there."""
    bench = bench_of(eds_of(name))
    assert bench.slave.not_taken_over == ()
    assert PROFILE_POSITION in bench.drive.objects.modes
    assert bench.write(0x6060, 0, PROFILE_POSITION, "b") is None
    for limit, value, code in ((0x6072, 1000, "H"), (0x607F, 100_000, "I"), (0x6080, 5000, "I")):
        if bench.read(limit) == 0:  # as delivered such a drive does not move
            assert bench.write(limit, 0, value, code) is None
    enable_by_sdo(bench)
    assert bench.write(0x607A, 0, 400, "i") is None
    assert bench.write(0x6040, 0, 0x1F, "H") is None
    bench.run(1_500_000_000)
    assert abs(signed(bench.read(0x6064)) - 400) < 20


def signed(value: int | Refusal) -> int:
    assert isinstance(value, int)
    return value - (1 << 32) * (value >> 31)


GUARDLESS = {"no_option_codes.eds", "ingenia_everest_xcr.eds"}
"""Without a reaction to a lost master: force needs an emergency stop that cuts the power, and stays small."""
SOFT = {"wall.stiffness": "400"}
"""For a drive in profile torque mode, whose slope delays."""


def rig_with(name: str, **changes: object) -> Rig:
    """The shipped bench with a vendor's drive, and an endless way for one that gives little force."""
    axis = default_axis(Workspace.LINEAR, bus="bus", node=NODE, profile=str(path_of(name)))
    axis = replace(axis, limits=replace(axis.limits, position=None))
    return Rig({"bus": CanSection("haptic_sim", "sim")}, {"handle": replace(axis, **changes)})  # type: ignore[arg-type]


@pytest.mark.thorough("a run on every drive", quick=("profile_torque.eds",))
@pytest.mark.parametrize("name", EVERY)
def test_a_wall_is_felt_on_every_vendors_drive_with_a_torque_mode(name: str) -> None:
    guardless = name in GUARDLESS
    rig = rig_with(name, **{"emergency_stop": "power"} if guardless else {})
    settings = SOFT if USABLE[name] == 4 else {}
    result = haptic_fieldbus.run("wall", rig=rig, duration=1.5, seed=1, settings=settings)
    assert result.missed_cycles == 0
    assert not result.trips
    assert result.verdict is not None
    assert result.verdict.startswith("Feels right: ") or guardless, result.verdict


@pytest.mark.parametrize("name", both(["no_option_codes.eds"], ["ingenia_everest_xcr.eds"]))
def test_a_vendors_drive_that_cannot_be_trusted_is_refused_with_a_sentence(name: str) -> None:
    with pytest.raises((BusConfigurationError, PlanError), match="has no watchdog that switches the torque off"):
        haptic_fieldbus.run("wall", rig=rig_with(name, raise_max_torque=False), duration=0.1)
