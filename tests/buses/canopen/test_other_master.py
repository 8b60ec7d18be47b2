"""Frames of somebody else, forged on the wire between our own: the header that the cycle gets, and the warnings."""

import struct

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.buses.canopen.other_master import OneMaster, Severity
from haptic_fieldbus.errors import ForeignMasterError
from haptic_fieldbus.planning.image import AXIS_HEADER
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import plan_of, scene_of
from tests.buses.canopen.benches import LISTENING_NS, NODE, TORQUE_FREE, TPDO, Bench

PERIOD_NS = 1_000_000
OTHER = 0x55
"""A node that is none of ours."""
COMMANDS = {
    "SYNC": (0x080, b""),
    "SYNC with counter": (0x080, b"\x07"),
    "our heartbeat": (0x77F, b"\x05"),
    "boot-up of our node-ID": (0x77F, b"\x00"),
    "set-point 1": (0x200 + NODE, bytes(4)),
    "set-point 2": (0x300 + NODE, bytes(8)),
    "set-point 3": (0x400 + NODE, b""),
    "set-point 4": (0x500 + NODE, b"\x0f"),
    "NMT to our node": (0x000, bytes((0x80, NODE))),
    "NMT to all": (0x000, bytes((0x80, 0))),
    "NMT without a node": (0x000, b"\x80"),
    "SDO download": (0x600 + NODE, b"\x2b\x40\x60\x00\x0f\x00\x00\x00"),
    "SDO download of a segment": (0x600 + NODE, bytes(8)),
    "SDO block download": (0x600 + NODE, b"\xc6" + bytes(7)),
    "SDO request without an octet": (0x600 + NODE, b""),
}
QUESTIONS = {
    "SDO upload": (0x600 + NODE, b"\x40\x41\x60\x00" + bytes(4), "SDO request to node 1 (601h)"),
    "SDO upload of a segment": (0x600 + NODE, b"\x60" + bytes(7), "SDO request to node 1 (601h)"),
    "SDO abort": (0x600 + NODE, b"\x80" + bytes(7), "SDO request to node 1 (601h)"),
}
HARMLESS = {
    "heartbeat of another node": (0x700 + OTHER, b"\x05"),
    "set-point of another node": (0x200 + OTHER, bytes(4)),
    "NMT to another node": (0x000, bytes((0x80, OTHER))),
    "SDO download to another node": (0x600 + OTHER, b"\x2b" + bytes(7)),
    "emergency of another node": (0x080 + OTHER, bytes(8)),
    "time stamp": (0x100, bytes(6)),
}


def _header(bench: Bench, axis: int = 0) -> tuple[LinkFlag, int]:
    image = bench.bus.read(bench.clock.now_ns() + PERIOD_NS)
    _, flags, code = AXIS_HEADER.unpack_from(image, bench.plan.image.axes[axis].header)
    return LinkFlag(flags), code


def _opened() -> Bench:
    bench = Bench().open()
    assert _header(bench) == (LinkFlag(0), 0)
    return bench


@pytest.mark.parametrize("when", ["between exchanges", "during one"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_of_somebody_else_is_flagged_with_its_cob_id_and_stays_so(name: str, when: str) -> None:
    bench = _opened()
    can_id, data = COMMANDS[name]
    bench.can.reply(can_id, data, delay_ns=0 if when == "between exchanges" else 10_000)
    for _ in range(3):
        assert _header(bench) == (LinkFlag.FOREIGN, can_id)
    assert bench.bus.warnings == []


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_question_of_somebody_else_is_told_once(name: str) -> None:
    bench = _opened()
    can_id, data, words = QUESTIONS[name]
    for _ in range(3):
        bench.can.reply(can_id, data, delay_ns=0)
        assert _header(bench) == (LinkFlag(0), 0)
    assert bench.bus.warnings == [f"another program sends requests to our drives: {words}. Torque was not affected"]


@pytest.mark.parametrize("name", HARMLESS)
def test_what_concerns_neither_our_drives_nor_our_name_is_nobodys_fault(name: str) -> None:
    bench = _opened()
    bench.can.reply(*HARMLESS[name], delay_ns=0)
    assert _header(bench) == (LinkFlag(0), 0)
    assert bench.bus.warnings == []


def test_node_guarding_by_somebody_else_is_told_and_other_remote_and_error_frames_are_not_his_commands() -> None:
    bench = _opened()
    for can_id in (0x700 + NODE, 0x080, 0x200 + NODE, 0x77F):
        bench.can.later(0, can.Message(arbitration_id=can_id, is_extended_id=False, is_remote_frame=True))
    bench.can.later(0, can.Message(arbitration_id=0x080, is_extended_id=True))
    bench.can.later(0, can.Message(arbitration_id=0x080, is_extended_id=False, is_error_frame=True, data=bytes(8)))
    assert _header(bench) == (LinkFlag(0), 0)
    assert bench.bus.warnings == [
        "another program sends requests to our drives: node guarding request to node 1 (701h). Torque was not affected"
    ]


def test_every_axis_of_the_bus_is_flagged() -> None:
    scene = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))
    bench = Bench(plan_of(scene)).open()
    bench.can.reply(0x202, bytes(4), delay_ns=0)
    assert [_header(bench, axis) for axis in (0, 1)] == [(LinkFlag.FOREIGN, 0x202)] * 2


def test_a_foreign_master_is_told_rather_than_the_emergency_that_it_causes() -> None:
    bench = _opened()
    bench.can.reply(0x000, bytes((0x80, 0)), delay_ns=0)
    bench.drive.emergency(0x8130)
    flags, code = _header(bench)
    assert flags == LinkFlag.FOREIGN | LinkFlag.EMERGENCY
    assert code == 0x000


@pytest.mark.parametrize("can_id", [0x080, 0x77F, 0x200 + NODE, 0x000])
def test_frames_that_the_interface_marks_as_sent_by_us_are_ours(can_id: int) -> None:
    bench = _opened()
    bench.can.later(0, can.Message(arbitration_id=can_id, is_extended_id=False, data=bytes(2), is_rx=False))
    assert _header(bench) == (LinkFlag(0), 0)


class TestDuplicates:
    @staticmethod
    def second_node(bench: Bench, delay_ns: int) -> None:
        bench.can.reply(TPDO, struct.pack("<Hih", 0x40, 5, 0), delay_ns)

    @pytest.mark.parametrize("delay_ns", [50_000, 900_000], ids=["before ours", "after ours"])
    def test_feedback_that_comes_twice_for_one_sync_is_flagged(self, delay_ns: int) -> None:
        bench = _opened()
        flags = []
        for _ in range(4):
            self.second_node(bench, delay_ns)
            flags.append(_header(bench))
            bench.clock.sleep_until(bench.clock.now_ns() + PERIOD_NS)
        assert (LinkFlag.DUPLICATE, TPDO) in flags[:3]

    def test_feedback_that_is_late_is_not_doubled(self) -> None:
        """The answer to one SYNC comes in the next period, beside the answer to its own."""
        bench = _opened()
        bench.drive.mute_tpdos = True
        assert _header(bench)[0] is LinkFlag.STALE
        bench.drive.mute_tpdos = False
        self.second_node(bench, 150_000)
        for _ in range(5):
            assert LinkFlag.DUPLICATE not in _header(bench)[0]

    @pytest.mark.parametrize("lost", [1, 2, 29])
    def test_lost_feedback_excuses_no_more_of_a_second_node_than_was_lost(self, lost: int) -> None:
        bench = _opened()
        bench.drive.mute_tpdos = True
        for _ in range(lost):
            _header(bench)
        bench.drive.mute_tpdos = False
        assert self.told_after(bench) <= lost + 4

    def test_lost_feedback_excuses_no_second_node_two_seconds_later(self) -> None:
        bench = _opened()
        for _ in range(20):
            bench.drive.mute_tpdos = True
            _header(bench)
            bench.drive.mute_tpdos = False
            _header(bench)
        for _ in range(2 * round(1.0 / bench.plan.period)):
            _header(bench)
        assert self.told_after(bench) <= 4

    def test_from_the_first_answers_on_a_single_one_too_many_is_told(self) -> None:
        """One that nobody asked for, as a node becomes operational, comes before them; it excused one for a second."""
        bench = _opened()
        for _ in range(3):
            _header(bench)
        self.second_node(bench, 900_000)
        assert LinkFlag.DUPLICATE not in _header(bench)[0]
        bench.clock.sleep_until(bench.clock.now_ns() + PERIOD_NS)
        assert _header(bench) == (LinkFlag.DUPLICATE, TPDO)

    def told_after(self, bench: Bench) -> int:
        """Number of SYNCs that a second node has answered until it is noticed."""
        for number in range(1, 100):
            self.second_node(bench, 50_000)
            if LinkFlag.DUPLICATE in _header(bench)[0]:
                return number
        return 100

    @pytest.mark.parametrize("late", [2, 3, 10, 25, 300])
    def test_answers_to_many_syncs_that_come_in_a_burst_are_of_one_node(self, late: int) -> None:
        """A drive, or an adapter on USB, that was busy; 3 of them were once taken for two nodes."""
        bench = _opened()
        bench.drive.mute_tpdos = True
        for _ in range(late):
            _header(bench)
        bench.drive.mute_tpdos = False
        for each in range(late):
            self.second_node(bench, each * 1000)
        for _ in range(5):
            assert LinkFlag.DUPLICATE not in _header(bench)[0]

    @pytest.mark.parametrize("delay_ns", [0, 50_000], ids=["before SYNC", "after SYNC"])
    def test_a_tpdo_on_becoming_operational_is_nothing_to_wonder_about(self, delay_ns: int) -> None:
        bench = Bench().open()
        self.second_node(bench, delay_ns)
        for _ in range(9):
            assert _header(bench) == (LinkFlag(0), 0)


class TestBeforeTheLoop:
    """Between listening and the first exchange: while a person reads the question, and while drives are written to."""

    def test_a_master_that_came_while_a_person_thought_is_refused_before_anything_is_written(self) -> None:
        bench = Bench()
        bench.bus.inspect(bench.plan, bytearray(bench.plan.image.input_size))
        bench.can.reply(0x080, b"", 0)
        with pytest.raises(ForeignMasterError, match=r"received SYNC \(080h\) during setup.*one rig.*Nothing was wr"):
            bench.bus.configure(bench.plan)
        assert bench.written() == []
        assert bench.can.of(0x000) == []

    @pytest.mark.parametrize("name", COMMANDS)
    def test_a_master_that_comes_while_we_configure_is_refused_before_anything_is_enabled(self, name: str) -> None:
        bench = Bench()
        bench.can.reply(*COMMANDS[name], LISTENING_NS + 5_000_000)
        with pytest.raises(ForeignMasterError, match=r"during setup.*Nothing was"):
            bench.open()
        assert bytes((0x01, NODE)) not in bench.can.of(0x000)
        assert set(bench.can.of(0x200 + NODE)) <= {TORQUE_FREE}


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_a_frame_matters_only_by_what_the_standard_makes_of_it(can_id: int, data: bytes) -> None:
    """Written again by octets: function code, node-ID and command specifier (CiA 301 7.3.5, 7.2.4, 7.2.8)."""
    function, node = can_id >> 7, can_id & 0x7F
    ours = node in (1, 9)
    expected = Severity.NOTHING
    if (
        can_id in (0x080, 0x77F)
        or (function in (4, 6, 8, 10) and ours)
        or (can_id == 0 and (len(data) < 2 or data[1] in (0, 1, 9)))
    ):
        expected = Severity.COMMAND
    elif function == 12 and ours:
        expected = Severity.COMMAND if not data or data[0] & 0xE0 in (0x00, 0x20, 0xC0) else Severity.QUESTION
    one = OneMaster((1, 9), 127)
    assert one.weigh(can_id, data) is expected
    assert expected is Severity.NOTHING or can_id in one.watched
