"""CiA 402-2: the automaton against the standard's figure, written here once more as states reached by command."""

import pytest

from haptic_fieldbus.sim.drive.power import STATUS_BITS, TRANSITIONS, Cause, PowerAutomaton, State, commands_of
from tests.cases import every

S = State
SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, RESET = 0x06, 0x07, 0x0F, 0x00, 0x02, 0x80

# Rows: state; columns: where each controlword leads from there.
FIGURE = {
    S.NOT_READY_TO_SWITCH_ON: {},
    S.SWITCH_ON_DISABLED: {SHUTDOWN: S.READY_TO_SWITCH_ON},
    S.READY_TO_SWITCH_ON: {
        SWITCH_ON: S.SWITCHED_ON,
        ENABLE: S.OPERATION_ENABLED,
        VOLTAGE_OFF: S.SWITCH_ON_DISABLED,
        QUICK_STOP: S.SWITCH_ON_DISABLED,
    },
    S.SWITCHED_ON: {
        ENABLE: S.OPERATION_ENABLED,
        SHUTDOWN: S.READY_TO_SWITCH_ON,
        VOLTAGE_OFF: S.SWITCH_ON_DISABLED,
        QUICK_STOP: S.SWITCH_ON_DISABLED,
    },
    S.OPERATION_ENABLED: {
        SWITCH_ON: S.SWITCHED_ON,
        SHUTDOWN: S.READY_TO_SWITCH_ON,
        VOLTAGE_OFF: S.SWITCH_ON_DISABLED,
        QUICK_STOP: S.QUICK_STOP_ACTIVE,
    },
    S.QUICK_STOP_ACTIVE: {VOLTAGE_OFF: S.SWITCH_ON_DISABLED},
    S.FAULT_REACTION_ACTIVE: {},
    S.FAULT: {RESET: S.SWITCH_ON_DISABLED},
}
COMMANDS = (SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, RESET)

# Statusword masks of the standard (mask, value).
STATUS = {
    S.NOT_READY_TO_SWITCH_ON: (0x4F, 0x00),
    S.SWITCH_ON_DISABLED: (0x4F, 0x40),
    S.READY_TO_SWITCH_ON: (0x6F, 0x21),
    S.SWITCHED_ON: (0x6F, 0x23),
    S.OPERATION_ENABLED: (0x6F, 0x27),
    S.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    S.FAULT_REACTION_ACTIVE: (0x4F, 0x0F),
    S.FAULT: (0x4F, 0x08),
}


def _in(state: State) -> PowerAutomaton:
    automaton = PowerAutomaton()
    automaton.state = state
    return automaton


@every("state", State)
@every("controlword", COMMANDS)
def test_each_command_leads_where_the_figure_says(state: State, controlword: int) -> None:
    automaton = _in(state)
    automaton.controlword(controlword)
    assert automaton.state is FIGURE[state].get(controlword, state)


def _plain(controlword: int, state: State) -> int | None:
    """The command that a controlword is by the standard's coding, bit by bit."""
    bit = [bool(controlword >> position & 1) for position in range(8)]
    if bit[7]:
        return RESET if state is S.FAULT else None
    if not bit[1]:
        return VOLTAGE_OFF
    if not bit[2]:
        return QUICK_STOP
    if not bit[0]:
        return SHUTDOWN
    return ENABLE if bit[3] else SWITCH_ON


@pytest.mark.parametrize("state", State)
def test_bits_that_a_command_does_not_name_change_nothing(state: State) -> None:
    for controlword in range(256):
        automaton = _in(state)
        automaton.controlword(controlword)
        plain = _plain(controlword, state)
        expected = state if plain is None else FIGURE[state].get(plain, state)
        assert automaton.state is expected, hex(controlword)


@pytest.mark.parametrize("state", State)
def test_the_statusword_matches_the_mask_of_its_state_and_of_no_other(state: State) -> None:
    matching = [other for other, (mask, value) in STATUS.items() if STATUS_BITS[state] & mask == value]
    assert matching == [state]


def test_power_on_goes_through_transitions_0_and_1() -> None:
    automaton = PowerAutomaton()
    assert automaton.start() == (0, 1)
    assert automaton.state is S.SWITCH_ON_DISABLED


def test_enable_operation_from_ready_makes_3_and_4() -> None:
    assert _in(S.READY_TO_SWITCH_ON).controlword(ENABLE) == (3, 4)


@pytest.mark.parametrize("state", State)
def test_a_fault_is_entered_from_every_state_but_its_own(state: State) -> None:
    automaton = _in(state)
    made = automaton.event(Cause.FAULT)
    if state in (S.FAULT, S.FAULT_REACTION_ACTIVE):
        assert made == ()
        assert automaton.state is state
    else:
        assert made == (13,)
        assert automaton.event(Cause.REACTION_COMPLETE) == (14,)
        assert automaton.state is S.FAULT


class TestFaultReset:
    """Transition 15 wants a rising edge of bit 7."""

    def test_a_bit_that_was_set_before_the_fault_does_not_reset_it(self) -> None:
        automaton = _in(S.OPERATION_ENABLED)
        automaton.controlword(RESET)
        automaton.event(Cause.FAULT)
        automaton.event(Cause.REACTION_COMPLETE)
        assert automaton.controlword(RESET) == ()
        assert automaton.controlword(0) == ()
        assert automaton.controlword(RESET) == (15,)

    def test_a_set_bit_hides_the_other_commands(self) -> None:
        automaton = _in(S.FAULT)
        assert automaton.controlword(RESET | SHUTDOWN) == (15,)
        assert automaton.controlword(RESET | SHUTDOWN) == ()
        assert automaton.controlword(SHUTDOWN) == (2,)

    def test_power_on_forgets_the_bit(self) -> None:
        automaton = _in(S.FAULT)
        automaton.controlword(RESET)
        automaton.start()
        automaton.state = S.FAULT
        assert automaton.controlword(RESET) == (15,)


def test_a_quick_stop_is_left_to_operation_only_where_605ah_allows_it() -> None:
    automaton = _in(S.QUICK_STOP_ACTIVE)
    assert automaton.controlword(ENABLE) == ()
    automaton.stays_in_quick_stop = True
    assert automaton.controlword(ENABLE) == (16,)
    assert automaton.state is S.OPERATION_ENABLED


def test_a_complete_quick_stop_switches_on_disabled() -> None:
    automaton = _in(S.QUICK_STOP_ACTIVE)
    assert automaton.event(Cause.STOPPED) == (12,)
    assert automaton.state is S.SWITCH_ON_DISABLED


def test_all_transitions_of_the_standard_are_in_the_table_once_a_start_and_cause() -> None:
    assert {transition.number for transition in TRANSITIONS} == set(range(17))
    assert len({(transition.start, transition.cause) for transition in TRANSITIONS}) == len(TRANSITIONS)


def test_a_controlword_with_the_reset_bit_names_no_command() -> None:
    assert commands_of(0x86) == ()
