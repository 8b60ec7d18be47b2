"""The power state of a CiA 402 drive as seen and commanded by the master.

The drive owns the automaton; the master reads the state from the statusword and answers with the controlword that asks
for the next transition on the way to *operation enabled*. It never resets a fault and never leaves *quick stop active*
upwards: those are for a person to ask for.

Reference: IEC 61800-7-201 (CiA 402-2), table of statusword states and of controlword commands.
"""

from dataclasses import dataclass
from enum import Enum


class PowerState(Enum):
    """The states of the standard, by their names there."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class StatusPattern:
    """The statusword bits under `mask` that make up a state."""

    mask: int
    bits: int
    state: PowerState


STATUS_PATTERNS = (
    StatusPattern(0x4F, 0x00, PowerState.NOT_READY),
    StatusPattern(0x4F, 0x40, PowerState.SWITCH_ON_DISABLED),
    StatusPattern(0x6F, 0x21, PowerState.READY),
    StatusPattern(0x6F, 0x23, PowerState.SWITCHED_ON),
    StatusPattern(0x6F, 0x27, PowerState.OPERATION_ENABLED),
    StatusPattern(0x6F, 0x07, PowerState.QUICK_STOP_ACTIVE),
    StatusPattern(0x4F, 0x0F, PowerState.FAULT_REACTION_ACTIVE),
    StatusPattern(0x4F, 0x08, PowerState.FAULT),
)

DISABLE_VOLTAGE = 0x0000
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F


@dataclass(frozen=True)
class Answer:
    """What the master answers in a state, and the standard's number of the transition that it asks for."""

    controlword: int
    transition: int | None


TOWARDS_OPERATION_ENABLED = {
    PowerState.NOT_READY: Answer(DISABLE_VOLTAGE, None),
    PowerState.SWITCH_ON_DISABLED: Answer(SHUTDOWN, 2),
    PowerState.READY: Answer(SWITCH_ON, 3),
    PowerState.SWITCHED_ON: Answer(ENABLE_OPERATION, 4),
    PowerState.OPERATION_ENABLED: Answer(ENABLE_OPERATION, None),
    PowerState.QUICK_STOP_ACTIVE: Answer(DISABLE_VOLTAGE, 12),
    PowerState.FAULT_REACTION_ACTIVE: Answer(DISABLE_VOLTAGE, None),
    PowerState.FAULT: Answer(DISABLE_VOLTAGE, None),
    PowerState.UNKNOWN: Answer(DISABLE_VOLTAGE, None),
}

RELEVANT_BITS = 0x6F


def power_state(statusword: int) -> PowerState:
    """The state that a statusword names; bits outside the patterns do not matter."""
    for pattern in STATUS_PATTERNS:
        if statusword & pattern.mask == pattern.bits:
            return pattern.state
    return PowerState.UNKNOWN


STATE_OF_BITS = tuple(power_state(bits) for bits in range(RELEVANT_BITS + 1))
"""`STATE_OF_BITS[statusword & RELEVANT_BITS]`: the look-up for the loop."""
