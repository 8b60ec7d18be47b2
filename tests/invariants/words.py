"""CANopen and CiA 402 as the checker reads them: written down from the standards, and used by nothing else.

CiA 301 7.3.5 (identifiers of the predefined connection set) and 7.2.7.1 (error codes);
IEC 61800-7-201 (statusword, controlword, transitions).
"""

from enum import Enum


class State(Enum):
    """A state of the power drive system."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTION = "fault reaction active"
    FAULT = "fault"


ARROWS: dict[int, tuple[frozenset[State], State]] = {
    0: (frozenset({State.NOT_READY}), State.NOT_READY),
    1: (frozenset({State.NOT_READY}), State.DISABLED),
    2: (frozenset({State.DISABLED}), State.READY),
    3: (frozenset({State.READY}), State.SWITCHED_ON),
    4: (frozenset({State.SWITCHED_ON}), State.ENABLED),
    5: (frozenset({State.ENABLED}), State.SWITCHED_ON),
    6: (frozenset({State.SWITCHED_ON}), State.READY),
    7: (frozenset({State.READY}), State.DISABLED),
    8: (frozenset({State.ENABLED}), State.READY),
    9: (frozenset({State.ENABLED}), State.DISABLED),
    10: (frozenset({State.SWITCHED_ON}), State.DISABLED),
    11: (frozenset({State.ENABLED}), State.QUICK_STOP),
    12: (frozenset({State.QUICK_STOP}), State.DISABLED),
    13: (frozenset(State) - {State.FAULT, State.REACTION}, State.REACTION),
    14: (frozenset({State.REACTION}), State.FAULT),
    15: (frozenset({State.FAULT}), State.DISABLED),
    16: (frozenset({State.QUICK_STOP}), State.ENABLED),
}
"""Transitions by their numbers: from which states, and to which."""

RESET_FAULT = 15
"""The transition by which a fault is cleared."""
MAKES_TORQUE = frozenset({State.ENABLED, State.QUICK_STOP, State.REACTION})

_BY_BITS = {
    0x4F: {0x00: State.NOT_READY, 0x40: State.DISABLED, 0x0F: State.REACTION, 0x08: State.FAULT},
    0x6F: {0x21: State.READY, 0x23: State.SWITCHED_ON, 0x27: State.ENABLED, 0x07: State.QUICK_STOP},
}


def state_of(statusword: int) -> State | None:
    """The state that a statusword shows; None for bits that the standard does not know."""
    for mask, states in _BY_BITS.items():
        if statusword & mask in states:
            return states[statusword & mask]
    return None


class Command(Enum):
    """A command of the controlword."""

    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"
    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on"
    ENABLE_OPERATION = "enable operation"
    FAULT_RESET = "fault reset"


def command_of(controlword: int) -> Command:
    """The command that a controlword gives."""
    if controlword & 0x80:
        return Command.FAULT_RESET
    if not controlword & 0x02:
        return Command.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return Command.QUICK_STOP
    if not controlword & 0x01:
        return Command.SHUTDOWN
    return Command.ENABLE_OPERATION if controlword & 0x08 else Command.SWITCH_ON


STEP: dict[State, frozenset[Command]] = {
    State.NOT_READY: frozenset({Command.DISABLE_VOLTAGE}),
    State.DISABLED: frozenset({Command.DISABLE_VOLTAGE, Command.SHUTDOWN}),
    State.READY: frozenset({Command.DISABLE_VOLTAGE, Command.SHUTDOWN, Command.SWITCH_ON}),
    State.SWITCHED_ON: frozenset(
        {Command.DISABLE_VOLTAGE, Command.SHUTDOWN, Command.SWITCH_ON, Command.ENABLE_OPERATION}
    ),
    State.ENABLED: frozenset(
        {Command.DISABLE_VOLTAGE, Command.QUICK_STOP, Command.SHUTDOWN, Command.SWITCH_ON, Command.ENABLE_OPERATION}
    ),
    State.QUICK_STOP: frozenset({Command.DISABLE_VOLTAGE, Command.QUICK_STOP}),
    State.REACTION: frozenset({Command.DISABLE_VOLTAGE, Command.FAULT_RESET}),
    State.FAULT: frozenset({Command.DISABLE_VOLTAGE, Command.FAULT_RESET}),
}
"""Commands that skip no state of the automaton, by the state that the drive has shown."""

NMT, EMERGENCY, HEARTBEAT = 0x000, 0x080, 0x700
LOST_MASTER = 0x8130
"""Error code of a drive whose life guard or heartbeat consumer has acted."""
EVERY_NODE = 0x00
CONTROLWORD, STATUSWORD = "6040h", "6041h"
TARGETS = ("6071h", "201Ch", "2030h")
"""Target torque, and the objects in its place in drives with a torque or current mode of their own."""
OCTETS = {
    CONTROLWORD: 2, STATUSWORD: 2, "6071h": 2, "201Ch": 4, "2030h": 2, "6064h": 4, "6077h": 2, "6074h": 2, "606Ch": 4,
    "606Bh": 4, "2031h": 2, "6078h": 2, "6060h": 1, "6061h": 1,
}  # fmt: skip
"""Octets of the objects that a plan may map; those of CiA 402 have a fixed type."""
