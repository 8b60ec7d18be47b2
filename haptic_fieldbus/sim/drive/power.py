"""The power drive automaton of CiA 402-2, as the drive runs it.

Theory (CiA 402-2, 8.2): bits 0, 1, 2, 3 and 7 of the controlword form a command. A command or an event makes a numbered
transition where the table has one from the present state; otherwise it has no effect. Transitions 0 and 1 follow by
themselves at power-on, 13 from any state on a fault, 14 when the fault reaction is complete, 12 also when a quick stop
is complete. A fault reset makes 15 only when no cause of the fault is present any more; otherwise a later reset needs a
new rising edge. *Switch on and enable operation* from *ready to switch on* makes 3 and then 4. An option code may defer
a transition until the motor stands still (5 by 605Ch, 8 by 605Bh). It is held, and `complete` makes it. While the power
stage is locked (safe torque off), *switch on disabled* is not left. Only `_make` changes the state.
"""

from collections.abc import Callable, Container
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache


class State(Enum):
    """A state of the automaton; the value is its name in the standard."""

    NOT_READY_TO_SWITCH_ON = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"


class Cause(Enum):
    """Commands of the controlword and internal events."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on"
    ENABLE_OPERATION = "enable operation"
    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"
    DISABLE_OPERATION = "disable operation"
    FAULT_RESET = "fault reset"
    SELF_TEST_PASSED = "self-test passed"
    INITIALISED = "initialised"
    STOPPED = "quick stop complete"
    FAULT = "fault detected"
    REACTION_COMPLETE = "fault reaction complete"


# CiA 402-2, statusword: bits 0 to 3, 5 and 6 by state. Bit 5 is 0 while a quick stop is acting.
STATUS_BITS = {
    State.NOT_READY_TO_SWITCH_ON: 0x0000,
    State.SWITCH_ON_DISABLED: 0x0060,
    State.READY_TO_SWITCH_ON: 0x0021,
    State.SWITCHED_ON: 0x0023,
    State.OPERATION_ENABLED: 0x0027,
    State.QUICK_STOP_ACTIVE: 0x0007,
    State.FAULT_REACTION_ACTIVE: 0x002F,
    State.FAULT: 0x0028,
}

# CiA 402-2, command coding: (mask, bits, commands). The state decides whether 0111b is *switch on* or *disable
# operation*.
COMMANDS = (
    (0x87, 0x06, (Cause.SHUTDOWN,)),
    (0x8F, 0x07, (Cause.SWITCH_ON, Cause.DISABLE_OPERATION)),
    (0x8F, 0x0F, (Cause.ENABLE_OPERATION,)),
    (0x82, 0x00, (Cause.DISABLE_VOLTAGE,)),
    (0x86, 0x02, (Cause.QUICK_STOP,)),
)
FAULT_RESET_BIT = 0x80


@dataclass(frozen=True)
class Transition:
    """A numbered transition of the automaton."""

    number: int
    start: State
    cause: Cause
    end: State


# CiA 402-2, state transition table. Start states that share a number have an entry each.
TRANSITIONS = (
    Transition(0, State.NOT_READY_TO_SWITCH_ON, Cause.SELF_TEST_PASSED, State.NOT_READY_TO_SWITCH_ON),
    Transition(1, State.NOT_READY_TO_SWITCH_ON, Cause.INITIALISED, State.SWITCH_ON_DISABLED),
    Transition(2, State.SWITCH_ON_DISABLED, Cause.SHUTDOWN, State.READY_TO_SWITCH_ON),
    Transition(3, State.READY_TO_SWITCH_ON, Cause.SWITCH_ON, State.SWITCHED_ON),
    Transition(3, State.READY_TO_SWITCH_ON, Cause.ENABLE_OPERATION, State.SWITCHED_ON),
    Transition(4, State.SWITCHED_ON, Cause.ENABLE_OPERATION, State.OPERATION_ENABLED),
    Transition(5, State.OPERATION_ENABLED, Cause.DISABLE_OPERATION, State.SWITCHED_ON),
    Transition(6, State.SWITCHED_ON, Cause.SHUTDOWN, State.READY_TO_SWITCH_ON),
    Transition(7, State.READY_TO_SWITCH_ON, Cause.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(7, State.READY_TO_SWITCH_ON, Cause.QUICK_STOP, State.SWITCH_ON_DISABLED),
    Transition(8, State.OPERATION_ENABLED, Cause.SHUTDOWN, State.READY_TO_SWITCH_ON),
    Transition(9, State.OPERATION_ENABLED, Cause.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(10, State.SWITCHED_ON, Cause.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(10, State.SWITCHED_ON, Cause.QUICK_STOP, State.SWITCH_ON_DISABLED),
    Transition(11, State.OPERATION_ENABLED, Cause.QUICK_STOP, State.QUICK_STOP_ACTIVE),
    Transition(12, State.QUICK_STOP_ACTIVE, Cause.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(12, State.QUICK_STOP_ACTIVE, Cause.STOPPED, State.SWITCH_ON_DISABLED),
    *(
        Transition(13, state, Cause.FAULT, State.FAULT_REACTION_ACTIVE)
        for state in State
        if state not in (State.FAULT, State.FAULT_REACTION_ACTIVE)
    ),
    Transition(14, State.FAULT_REACTION_ACTIVE, Cause.REACTION_COMPLETE, State.FAULT),
    Transition(15, State.FAULT, Cause.FAULT_RESET, State.SWITCH_ON_DISABLED),
    Transition(16, State.QUICK_STOP_ACTIVE, Cause.ENABLE_OPERATION, State.OPERATION_ENABLED),
)
_TABLE = {(transition.start, transition.cause): transition for transition in TRANSITIONS}


@lru_cache(maxsize=256)
def commands_of(controlword: int) -> tuple[Cause, ...]:
    """Return the commands that a controlword may mean; none while its fault reset bit is set."""
    for mask, bits, commands in COMMANDS:
        if controlword & mask == bits:
            return commands
    return ()


class PowerAutomaton:
    """The state and its transitions; every method returns the numbers of the transitions made."""

    def __init__(self) -> None:
        self.state = State.NOT_READY_TO_SWITCH_ON
        self.stays_in_quick_stop = False
        """Whether 605Ah allows transition 16."""
        self.locked = False
        """Whether the power stage cannot be switched on: transition 2 is not made."""
        self.has_fault: Callable[[], bool] = lambda: False
        """Whether a cause of a fault is present, so that transition 15 is not made."""
        self.deferred: Container[int] = ()
        """Numbers of the transitions that a controlword only starts; `complete` makes them."""
        self.held: Transition | None = None
        """The started transition that waits for `complete`; None without one."""
        self._controlword = 0

    def start(self) -> tuple[int, ...]:
        """Power on: make transitions 0 and 1."""
        self.state = State.NOT_READY_TO_SWITCH_ON
        self.held = None
        self._controlword = 0
        return self.event(Cause.SELF_TEST_PASSED) + self.event(Cause.INITIALISED)

    def controlword(self, value: int) -> tuple[int, ...]:
        """Handle a controlword; it cancels or repeats a held transition of an earlier controlword."""
        self.held = None
        # A fault is reset by the rising edge of bit 7.
        reset = value & ~self._controlword & FAULT_RESET_BIT
        self._controlword = value
        if reset and (made := self._command(Cause.FAULT_RESET)):
            return made
        for command in commands_of(value):
            if made := self._command(command):
                # Operation is enabled by the same command once *switched on* is reached.
                return made + self._command(command) if made == (3,) else made
        return ()

    def complete(self) -> tuple[int, ...]:
        """Make the held transition, as the motor stands."""
        return self._make(self.held) if self.held is not None else ()

    def event(self, cause: Cause) -> tuple[int, ...]:
        """Handle an event inside the drive."""
        transition = _TABLE.get((self.state, cause))
        return self._make(transition) if transition is not None else ()

    def _command(self, cause: Cause) -> tuple[int, ...]:
        transition = _TABLE.get((self.state, cause))
        refused = {2: self.locked, 15: self.has_fault(), 16: not self.stays_in_quick_stop}
        if transition is None or refused.get(transition.number):
            return ()
        if transition.number in self.deferred:
            self.held = transition
            return ()
        return self._make(transition)

    def _make(self, transition: Transition) -> tuple[int, ...]:
        self.held = None
        self.state = transition.end
        return (transition.number,)
