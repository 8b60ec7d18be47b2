"""CiA 402-2 (IEC 61800-7-201), sentence by sentence, on the wire: automaton, option codes, bits of the statusword.

The tables are written from the standard and know nothing of the drive's own.
"""

import pytest

from tests.sim.drive.sentences import (
    COUNTS,
    ENABLE,
    HALT,
    INERTIA,
    QUICK_STOP,
    RATED,
    RESET,
    SHUTDOWN,
    SPEED_COUNTS,
    SWITCH_ON,
    VOLTAGE_OFF,
    Clause,
    Step,
    absent,
    bits,
    clause,
    control,
    emergency,
    enabled,
    fault,
    inputs,
    mode,
    nmt,
    refused,
    run,
    shows,
    state,
    sto,
    table,
    turning,
    write,
)

PP, PV, TQ, HM, CSP, CSV, CST = 1, 3, 4, 6, 8, 9, 10

# How each state is reached from power-on.
WAYS: dict[str, tuple[Step, ...]] = {
    "switch on disabled": (),
    "ready to switch on": (control(SHUTDOWN),),
    "switched on": (control(SHUTDOWN, SWITCH_ON),),
    "operation enabled": (control(SHUTDOWN, SWITCH_ON, ENABLE),),
    "quick stop active": (control(SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP),),
    "fault reaction active": (control(SHUTDOWN, SWITCH_ON, ENABLE), fault()),
    "fault": (fault(),),
}

# Table "command coding" and figure "state machine": from, controlword, number(s), to.
TRANSITIONS = [
    ("switch on disabled", SHUTDOWN, "2", "ready to switch on"),
    ("ready to switch on", SWITCH_ON, "3", "switched on"),
    ("ready to switch on", ENABLE, "3 and 4", "operation enabled"),
    ("switched on", ENABLE, "4", "operation enabled"),
    ("operation enabled", SWITCH_ON, "5", "switched on"),
    ("switched on", SHUTDOWN, "6", "ready to switch on"),
    ("ready to switch on", VOLTAGE_OFF, "7", "switch on disabled"),
    ("ready to switch on", QUICK_STOP, "7", "switch on disabled"),
    ("operation enabled", SHUTDOWN, "8", "ready to switch on"),
    ("operation enabled", VOLTAGE_OFF, "9", "switch on disabled"),
    ("switched on", VOLTAGE_OFF, "10", "switch on disabled"),
    ("switched on", QUICK_STOP, "10", "switch on disabled"),
    ("operation enabled", QUICK_STOP, "11", "quick stop active"),
    ("quick stop active", VOLTAGE_OFF, "12", "switch on disabled"),
    ("fault", RESET, "15", "switch on disabled"),
    ("quick stop active", ENABLE, "16", "operation enabled"),
]
COMMANDS = (SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, RESET)
STAYING_STOP, DISABLING = write(0x605A, 6), write(0x605C, 0)


@table(
    [
        turning(f"transition {number}: {begin}, {word:02X}h → {end}",
                STAYING_STOP, DISABLING, *WAYS[begin], state(begin), control(word), state(end))
        for begin, word, number, end in TRANSITIONS
    ]
)  # fmt: skip
def test_transition(row: Clause) -> None:
    row.show()


@table(
    [
        turning(f"{begin} is not left by {word:02X}h",
                STAYING_STOP, DISABLING, *WAYS[begin], control(word), state(begin))
        for begin in WAYS
        for word in COMMANDS
        if (begin, word) not in {(known, at) for known, at, *_ in TRANSITIONS}
    ]
)  # fmt: skip
def test_no_other_transition(row: Clause) -> None:
    row.show()


RAMP = round(SPEED_COUNTS / 0.2)
"""Slow down ramp: to rest in 0.2 s; the quick stop ramp takes half of that."""
LIMIT = 100
"""Of torque [‰] while braking on the current limit."""
RAMPS = (write(0x6084, RAMP), write(0x6085, 2 * RAMP), write(0x6072, LIMIT))


def rate(way: int) -> float:
    """Deceleration of each way to slow down [counts/s²]: 1 slow down ramp, 2 quick stop ramp, 3 and 4 torque limit."""
    limit = LIMIT * 1e-3 * RATED / INERTIA * COUNTS / 6.283185307179586
    return {0: 0.0, 1: RAMP, 2: 2 * RAMP, 3: limit, 4: limit}[way]


def slows(way: int, milliseconds: float = 20.0) -> tuple[Step, ...]:
    """After some time the speed is what the ramp says, within a hundredth of the speed at the start."""
    return run(milliseconds), shows(0x606C, SPEED_COUNTS - rate(way) * milliseconds * 1e-3, 0.01 * SPEED_COUNTS)


def rests() -> tuple[Step, ...]:
    return run(400), shows(0x606C, 0, 0.01 * SPEED_COUNTS)


OPERATING = control(SHUTDOWN, SWITCH_ON, ENABLE)
CODES = (1, 2, 3, 4)
OPTION_ROWS = [
    turning("605Ah = 0: disable drive function, then switch on disabled",
            *RAMPS, write(0x605A, 0), OPERATING, control(QUICK_STOP), state("switch on disabled"), *slows(0)),
    *(turning(f"605Ah = {code}: slow down by way {code}, then switch on disabled",
              *RAMPS, write(0x605A, code), OPERATING, control(QUICK_STOP), state("quick stop active"), *slows(code),
              state("quick stop active"), *rests(), state("switch on disabled")) for code in CODES),
    *(turning(f"605Ah = {code + 4}: slow down by way {code} and stay in quick stop active",
              *RAMPS, write(0x605A, code + 4), OPERATING, control(QUICK_STOP), *slows(code), *rests(),
              state("quick stop active"), control(ENABLE), state("operation enabled")) for code in CODES),
    turning("605Ah = 1 to 4: a quick stop that ends is not taken back by enable operation",
            *RAMPS, OPERATING, control(QUICK_STOP, ENABLE), state("quick stop active")),
    turning("605Bh = 0: shutdown disables the drive function",
            *RAMPS, write(0x605B, 0), OPERATING, control(SHUTDOWN), state("ready to switch on"), *slows(0)),
    turning("605Bh = 1: shutdown slows down on the slow down ramp, then ready to switch on",
            *RAMPS, write(0x605B, 1), OPERATING, control(SHUTDOWN), state("operation enabled"), *slows(1),
            state("operation enabled"), *rests(), state("ready to switch on")),
    turning("605Ch = 0: disable operation disables the drive function",
            *RAMPS, write(0x605C, 0), OPERATING, control(SWITCH_ON), state("switched on"), *slows(0)),
    turning("605Ch = 1: disable operation slows down on the slow down ramp, then switched on",
            *RAMPS, write(0x605C, 1), OPERATING, control(SWITCH_ON), state("operation enabled"), *slows(1),
            *rests(), state("switched on")),
    turning("605Ch = 1: enable operation takes it back, disable voltage frees the shaft at once",
            *RAMPS, mode(CST), OPERATING, control(SWITCH_ON), bits(0x1000, 0), run(5), control(ENABLE),
            bits(0x1000, 0x1000), run(400), state("operation enabled"), control(SWITCH_ON), run(5),
            control(VOLTAGE_OFF), state("switch on disabled"), shows(0x6074, 0)),
    turning("605Ch = 1: a quick stop on the way goes before",
            *RAMPS, OPERATING, control(SWITCH_ON), run(5), control(QUICK_STOP), state("quick stop active")),
    *(turning(f"605Dh = {code}: halt slows down by way {code} and stays in operation enabled",
              *RAMPS, write(0x605D, code), enabled(TQ), control(HALT), *slows(code), state("operation enabled"),
              *rests(), state("operation enabled"), bits(0x0400, 0x0400)) for code in CODES),
    turning("605Eh = 0: a fault disables the drive function",
            *RAMPS, write(0x605E, 0), OPERATING, fault(), state("fault"), *slows(0)),
    *(turning(f"605Eh = {code}: a fault slows down by way {code}",
              *RAMPS, write(0x605E, code), OPERATING, fault(), state("fault reaction active"), *slows(code),
              *rests(), state("fault")) for code in CODES),
    turning("605Eh: a drive that was not energised does not brake",
            *RAMPS, write(0x605E, 2), control(SHUTDOWN, SWITCH_ON), fault(), state("fault"), *slows(0)),
    turning("6007h = 0: a lost link changes nothing",
            write(0x6007, 0), OPERATING, nmt(2), state("operation enabled")),
    turning("6007h = 1: a lost link is a fault",
            write(0x6007, 1), write(0x605E, 0), OPERATING, nmt(2), state("fault")),
    turning("6007h = 2: a lost link disables voltage",
            write(0x6007, 2), OPERATING, nmt(2), state("switch on disabled")),
    turning("6007h = 3: a lost link is a quick stop",
            write(0x6007, 3), OPERATING, nmt(2), state("quick stop active")),
    clause("reserved option codes are refused",
           refused(0x605A, 9, 0x0609_0030), refused(0x605B, 2, 0x0609_0030), refused(0x605C, -1, 0x0609_0030),
           refused(0x605D, 0, 0x0609_0030), refused(0x605D, 5, 0x0609_0030), refused(0x605E, 5, 0x0609_0030),
           refused(0x6007, 4, 0x0609_0030)),
    clause("defaults of the option codes",
           shows(0x605A, 2), shows(0x605B, 0), shows(0x605C, 1), shows(0x605D, 1), shows(0x605E, 2), shows(0x6007, 1)),
]  # fmt: skip


@table(OPTION_ROWS)
def test_option_code(row: Clause) -> None:
    row.show()


FAULT_ROWS = [
    turning("transition 13: 603Fh tells the error, an emergency is sent; 14 follows the reaction",
            write(0x605E, 2), OPERATING, fault(0x4310), emergency(0x4310), shows(0x603F, 0x4310),
            state("fault reaction active"), run(400), state("fault")),
    clause("transition 15: a rising edge of bit 7 resets, and 603Fh is 0 again",
           OPERATING, control(RESET), fault(), run(2), control(RESET), state("fault"), control(0, RESET),
           state("switch on disabled"), shows(0x603F, 0)),
    clause("bit 4, voltage enabled, and bit 9, remote, are set", bits(0x0210, 0x0210)),
    clause("bit 5, quick stop, is 0 while one is acting and 1 in ready to switch on, switched on, operation enabled",
           write(0x605A, 6), control(SHUTDOWN), bits(0x20, 0x20), control(ENABLE), bits(0x20, 0x20),
           control(QUICK_STOP), bits(0x20, 0)),
]  # fmt: skip


@table(FAULT_ROWS)
def test_fault(row: Clause) -> None:
    row.show()


STO_ROWS = [
    turning("safe torque off frees the shaft at once: switch on disabled, no fault, interlock in 60FDh",
            enabled(CST), write(0x6071, 100), run(1), sto(True), state("switch on disabled"), shows(0x6074, 0),
            shows(0x60FD, 8), shows(0x603F, 0)),
    *(turning(f"safe torque off in {begin} leads to switch on disabled",
              STAYING_STOP, *WAYS[begin], sto(True), state("switch on disabled"))
      for begin in ("switch on disabled", "ready to switch on", "switched on", "quick stop active")),
    clause("while it is open switch on disabled is not left; once closed, the next shutdown leads on",
           sto(True), control(SHUTDOWN, ENABLE, SHUTDOWN), state("switch on disabled"), sto(False),
           state("switch on disabled"), control(SHUTDOWN), state("ready to switch on"), shows(0x60FD, 0)),
    turning("safe torque off ends a fault reaction",
            OPERATING, fault(), state("fault reaction active"), sto(True), state("fault")),
    clause("a fault while it is open has no ramp, and reset leads to switch on disabled",
           sto(True), fault(), state("fault"), control(RESET, SHUTDOWN), state("switch on disabled")),
    turning("with an error code it is a fault while torque is made",
            OPERATING, sto(True), emergency(0x5443), state("fault"), shows(0x603F, 0x5443), shows(0x6074, 0),
            sto_error=0x5443),
    clause("with an error code it is none while no torque is made",
           control(SHUTDOWN, SWITCH_ON), sto(True), state("switch on disabled"), shows(0x603F, 0), sto_error=0x5443),
    clause("a restart of the node does not close it",
           sto(True), nmt(129), run(100), shows(0x60FD, 8), control(SHUTDOWN), state("switch on disabled")),
    clause("60FDh shows the digital inputs", inputs(0x0003_0005), shows(0x60FD, 0x0003_0005)),
]  # fmt: skip


@table(STO_ROWS)
def test_safe_torque_off_and_inputs(row: Clause) -> None:
    row.show()


def test_every_numbered_transition_has_a_row() -> None:
    numbers = {int(number) for *_, numbered, _ in TRANSITIONS for number in numbered.split(" and ")}
    assert numbers == set(range(2, 17)) - {13, 14}  # 0 and 1 are power-on, 13 and 14 stand among the faults


def test_power_on_ends_in_switch_on_disabled() -> None:
    clause("transitions 0 and 1", state("switch on disabled")).show()


@pytest.mark.thorough("7 cases of one rule", quick=2)
@pytest.mark.parametrize("number", [PP, PV, TQ, HM, CSP, CSV, CST])
def test_a_quick_stop_slows_down_in_every_mode_and_operation_goes_on(number: int) -> None:
    turning(f"mode {number}", *RAMPS, STAYING_STOP, enabled(number), control(QUICK_STOP), run(400),
            shows(0x606C, 0, 0.01 * SPEED_COUNTS), control(ENABLE), state("operation enabled")).show()  # fmt: skip


MODE_ROWS = [
    clause("6502h lists the modes that work", shows(0x6502, 0b11_1010_1101)),
    clause("6060h takes each of them, and 0; 6061h follows",
           *(step for number in (PP, PV, TQ, HM, CSP, CSV, CST, 0) for step in (mode(number), shows(0x6061, number)))),
    clause("a mode that 6502h does not list is refused",
           *(refused(0x6060, number, 0x0609_0030) for number in (2, 5, 7, 11, -1, 127))),
    clause("6061h follows when the mode-change time is over, and the mode before goes on until then",
           enabled(CST), run(6), write(0x6071, 100), mode(PV), run(4), shows(0x6061, CST), shows(0x6074, 100),
           run(2), shows(0x6061, PV), mode_change_ns=5_000_000),
    clause("a mode that is asked for again in time is not left",
           enabled(CST), run(6), mode(PV), run(2), mode(CST), run(10), shows(0x6061, CST), mode_change_ns=5_000_000),
    clause("another wish starts the mode-change time anew",
           mode(PV), run(3), mode(TQ), run(3), shows(0x6061, 0), run(3), shows(0x6061, TQ), mode_change_ns=5_000_000),
    clause("a mode may be changed while the motor is halted",
           enabled(PV), control(HALT), mode(TQ), shows(0x6061, TQ), mode(CST), shows(0x6061, CST),
           bits(0x1000, 0x1000)),
    clause("no mode assigned: the drive does not follow, no torque",
           write(0x6071, 100), enabled(0), shows(0x6074, 0), bits(0x3C00, 0)),
    clause("a drive lists and takes only the modes of its settings and its torque mode, with their objects",
           shows(0x6502, 1 << 2 | 1 << 9), refused(0x6060, PP, 0x0609_0030), absent(0x607A, 0x6065, 0x6098, 0x6087),
           shows(0x60FF, 0), shows(0x6083, 3_259_493, 1), mode(PV), shows(0x6061, PV), modes=frozenset((PV,))),
    clause("objects that the settings leave out are not there, and the drive works without them",
           absent(0x6072, 0x608F, 0x605A, 0x60E0), enabled(CST), write(0x6071, 100), run(1), shows(0x6074, 100),
           without=frozenset((0x6072, 0x608F, 0x605A, 0x60E0))),
    clause("the cyclic modes have no halt: their controlword has no bits of its own",
           enabled(CST), control(HALT), write(0x6071, 50), shows(0x6074, 50), bits(0x1000, 0x1000)),
]  # fmt: skip


@table(MODE_ROWS)
def test_modes_of_operation(row: Clause) -> None:
    row.show()
