"""The table of docs/reference/simulated_drive.md, "When the link ends": every cell, and what goes with a fault.

The page says what is to come; CiA 402-2 and CiA 301 are its sources. Here each cell is a conversation of frames.
"""

import re
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from haptic_fieldbus.sim.drive.power import STATUS_BITS, State
from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.sim.bench import MS, DriveBench, profile

TEXT = (Path(__file__).resolve().parents[3] / "docs" / "reference" / "simulated_drive.md").read_text(encoding="utf-8")
EMERGENCY, HEARTBEAT, MASTER = 0x85, 0x705, 0x77F
START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
OPTIONS = range(4)
NO_ERROR = bytes(8)
CODE = 0x4310
"""Of a fault that has nothing to do with the link: temperature of the drive."""
RESET = 0x80
TURNING = 60.0
"""[rad/s]: the ramp of a fault reaction then takes longer than an NMT command."""
CONTROLWORDS: dict[State, tuple[int, ...]] = {
    State.SWITCH_ON_DISABLED: (),
    State.READY_TO_SWITCH_ON: (0x06,),
    State.SWITCHED_ON: (0x06, 0x07),
    State.OPERATION_ENABLED: (0x06, 0x0F),
    State.QUICK_STOP_ACTIVE: (0x06, 0x0F, 0x02),
    State.FAULT_REACTION_ACTIVE: (0x06, 0x0F),
    State.FAULT: (0x06,),
}


def _rows() -> dict[State, list[str]]:
    """The cells of the table by state: start, stop and reset of communication by option, reset of the node."""
    lines = re.findall(r"^\| ([a-z ]+?) \| (.*) \|$", TEXT.partition("## When the link ends")[2], re.MULTILINE)
    states = {state.value: state for state in State}
    return {states[name]: cells.split(" | ") for name, cells in lines if name in states}


ROWS = _rows()


def _cells() -> Iterator[tuple[State, int, int, State]]:
    """State, NMT command, 6007h, and the state of the table."""
    columns = {START: (0,) * 4, PRE_OPERATIONAL: (0,) * 4, STOP: (1, 2, 3, 4), RESET_COMMUNICATION: (1, 2, 3, 4)}
    columns[RESET_NODE] = (5,) * 4
    for before, cells in ROWS.items():
        for command, places in columns.items():
            for option in OPTIONS:
                cell = cells[places[option]]
                yield before, command, option, before if cell == "stays" else State(cell)


def _bench(before: State, option: int, *, operational: bool = True) -> DriveBench:
    """A drive in this state, turning where it is enabled; a quick stop holds it in its state (605Ah = 6)."""
    bench = DriveBench(profile("generic_cia402"), settings=DriveSettings(velocity=TURNING))
    for index, value in ((0x6007, option), (0x605A, 6), (0x605E, 2)):
        assert bench.write(index, 0, value, "h") is None
    bench.operational()
    for controlword in CONTROLWORDS[before]:
        bench.control(controlword)
    if before in (State.FAULT, State.FAULT_REACTION_ACTIVE):
        bench.drive.fault(CODE, bench.t_ns)
    assert _state(bench) is before
    if not operational:
        bench.nmt(PRE_OPERATIONAL)
    return bench


def _state(bench: DriveBench) -> State:
    word = bench.drive.dictionary.value(0x6041)
    return next(state for state, bits in STATUS_BITS.items() if word & 0x6F == bits)


def _told(bench: DriveBench) -> list[bytes]:
    return [frame.data for _, frame in bench.sent if frame.can_id == EMERGENCY]


def _history(bench: DriveBench) -> list[int]:
    count = bench.read(0x1003)
    assert isinstance(count, int)
    codes = [bench.read(0x1003, number) for number in range(1, count + 1)]
    return [code for code in codes if isinstance(code, int)]


def _talk(bench: DriveBench, command: int) -> None:
    """The command, time for a reset and a stop, and then the way back to where SDO works."""
    bench.nmt(command)
    bench.run(2000 * MS)
    if command == STOP:
        bench.nmt(PRE_OPERATIONAL)


def test_the_page_has_a_row_for_every_state_that_a_master_meets() -> None:
    assert set(ROWS) == set(State) - {State.NOT_READY_TO_SWITCH_ON} == set(CONTROLWORDS)
    assert {len(cells) for cells in ROWS.values()} == {6}


@pytest.mark.thorough("two hundred and eighty conversations", quick=1)
@pytest.mark.parametrize("before", list(ROWS), ids=[state.value for state in ROWS])
def test_every_cell(before: State) -> None:
    for start, command, option, after in _cells():
        for operational in (True, False) if start is before else ():
            bench = _bench(start, option, operational=operational)
            already = _told(bench)
            assert already == ([_emergency(CODE)] if before in (State.FAULT, State.FAULT_REACTION_ACTIVE) else [])
            bench.sent.clear()
            _talk(bench, command)
            told = already + _told(bench)
            cell = f"{start.value}, NMT {command}, 6007h = {option}, operational: {operational}"
            assert _state(bench) is after, cell
            code = bench.read(0x603F)
            if after is State.FAULT:
                assert code == (CODE if already else 0x8100), cell
                assert isinstance(code, int)
                assert told == [_emergency(code)], cell
                assert (bench.read(0x1001), _history(bench)) == (_emergency(code)[2], [code]), cell
            else:
                assert (code, bench.read(0x1001), _history(bench)) == (0, 0, []), cell
                assert told == already, cell


def _emergency(code: int) -> bytes:
    """By CiA 301, tables 26 and 46: generic error, with temperature or communication."""
    return struct.pack("<HB5x", code, 0x01 | {0x4: 0x08, 0x8: 0x10}[code >> 12])


@pytest.mark.parametrize("option", OPTIONS)
def test_a_heartbeat_that_is_missed_at_rest_is_told_and_is_no_fault(option: int) -> None:
    bench = _watched(_bench(State.SWITCH_ON_DISABLED, option))
    bench.run(51 * MS)
    assert _told(bench) == [_emergency(0x8130)]
    assert (_state(bench), bench.read(0x603F)) == (State.SWITCH_ON_DISABLED, 0)
    bench.give(MASTER, b"\5")
    assert bench.take(EMERGENCY) == [NO_ERROR]


def _watched(bench: DriveBench) -> DriveBench:
    assert bench.write(0x1016, 1, 0x7F << 16 | 50, "I") is None
    bench.give(MASTER, b"\5")
    bench.sent.clear()
    return bench


class TestAFaultThatIsReset:
    """CiA 402-2, transition 15: only when no fault is present; *error reset* comes with it and not before."""

    def _reset(self, bench: DriveBench) -> State:
        for controlword in (0x00, RESET):
            assert bench.write(0x6040, 0, controlword, "H") is None
        return _state(bench)

    def test_stays_while_the_heartbeat_is_missing(self) -> None:
        bench = _watched(_bench(State.OPERATION_ENABLED, 1))
        bench.run(2000 * MS)
        assert _state(bench) is State.FAULT
        assert self._reset(bench) is State.FAULT
        assert bench.read(0x603F) == 0x8130
        bench.sent.clear()
        bench.give(MASTER, b"\5")
        assert _told(bench) == []
        assert bench.read(0x1001) == 0x11
        assert self._reset(bench) is State.SWITCH_ON_DISABLED
        assert (bench.read(0x603F), bench.read(0x1001)) == (0, 0)

    def test_says_no_error_once_when_it_is_reset(self) -> None:
        bench = _bench(State.FAULT, 1)
        bench.sent.clear()
        assert bench.write(0x6040, 0, 0x00, "H") is None
        bench.give(0x605, bytes.fromhex("2B 40 60 00 80 00 00 00"))
        assert _told(bench) == [NO_ERROR]

    def test_a_reset_of_communication_ends_the_monitoring_and_then_it_goes(self) -> None:
        bench = _watched(_bench(State.OPERATION_ENABLED, 1))
        bench.run(2000 * MS)
        bench.nmt(RESET_COMMUNICATION)
        bench.run(100 * MS)
        assert (_state(bench), bench.read(0x1001), _history(bench)) == (State.FAULT, 0x11, [0x8130])
        assert self._reset(bench) is State.SWITCH_ON_DISABLED
        assert bench.read(0x1001) == 0

    def test_stays_while_an_rpdo_is_missing_and_has_its_code(self) -> None:
        bench = _bench(State.OPERATION_ENABLED, 1)
        assert bench.write(0x1400, 5, 20, "H") is None
        bench.control(0x0F)
        bench.sent.clear()
        bench.run(2000 * MS)
        assert _told(bench) == [_emergency(0x8250)]
        assert bench.read(0x603F) == 0x8250
        bench.nmt(START)
        assert self._reset(bench) is State.FAULT
        bench.control(0x00)
        assert self._reset(bench) is State.SWITCH_ON_DISABLED

    def test_stays_while_safe_torque_off_is_open(self) -> None:
        bench = DriveBench(settings=DriveSettings(sto_error=0x5441))
        bench.enable()
        bench.drive.sto(True, bench.t_ns)
        bench.run(2000 * MS)
        assert self._reset(bench) is State.FAULT
        bench.drive.sto(False, bench.t_ns)
        assert self._reset(bench) is State.SWITCH_ON_DISABLED
        assert bench.read(0x1001) == 0
