"""The power state of a drive as seen and commanded by the master: a table, one row a state.

The drive owns the automaton; the master reads the state from the statusword and answers with the controlword that asks
for the next transition on the way to *operation enabled*. It never resets a fault and never leaves *quick stop active*
upwards: those are for a person to ask for. `protocols.cia402` has the standard's table; a drive with a mode register or
an opcode instead has another one, and its status and command are called statusword and controlword all the same.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property, reduce
from operator import or_
from typing import Annotated, ClassVar

from annotated_types import Len

from haptic_fieldbus.drive.fields import STRICT, UInt32


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
class PowerRow:
    """The statusword bits under `mask` that make up a state, and the controlword that is answered in it."""

    mask: UInt32
    bits: UInt32
    state: PowerState
    controlword: UInt32
    transition: int | None = None
    """The standard's number of the transition that the answer asks for."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class PowerTable:
    """All states of a drive; a statusword that no row fits is *unknown*, and is answered with `off`."""

    rows: Annotated[tuple[PowerRow, ...], Len(1)]
    off: UInt32 = 0
    """The controlword that takes voltage away in every state."""
    __pydantic_config__: ClassVar = STRICT

    @cached_property
    def mask(self) -> int:
        """The bits of a statusword that matter to any row."""
        return reduce(or_, (row.mask for row in self.rows))

    def state(self, statusword: int) -> PowerState:
        """The state that a statusword names; bits outside the masks do not matter."""
        return next((row.state for row in self.rows if statusword & row.mask == row.bits), PowerState.UNKNOWN)

    def answer(self, state: PowerState) -> int:
        """The controlword on the way to *operation enabled*."""
        return next((row.controlword for row in self.rows if row.state is state), self.off)
