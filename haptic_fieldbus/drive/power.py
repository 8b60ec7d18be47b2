"""Power states of a drive as the master reads and commands them: a table with one row for each state.

The automaton is in the drive. The master derives the state from the statusword, and answers with the controlword that
requests the next transition on the way to *operation enabled*. It never resets a fault, and it never goes from *quick
stop active* back to *operation enabled*: both are decisions of a person. The table of the standard is in
`protocols.cia402`. A drive with a mode register or an opcode has a table of its own; its status and command are called
statusword and controlword all the same.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property, reduce
from operator import or_
from typing import Annotated

from annotated_types import Len

from haptic_fieldbus.drive.fields import Table, UInt32


class PowerState(Enum):
    """Power states, by their names in the standard."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


ENERGISED = (
    PowerState.SWITCHED_ON,
    PowerState.OPERATION_ENABLED,
    PowerState.QUICK_STOP_ACTIVE,
    PowerState.FAULT_REACTION_ACTIVE,
    PowerState.UNKNOWN,
)
"""States in which the power stage may feed the motor, for all that is known of them."""


@dataclass(frozen=True)
class PowerRow(Table):
    """A state, the statusword `bits` under `mask` that stand for it, and the controlword to be sent in it."""

    mask: UInt32
    bits: UInt32
    state: PowerState
    controlword: UInt32
    transition: int | None = None
    """Number in the standard of the transition that the controlword requests; None when it requests none."""


@dataclass(frozen=True)
class PowerTable(Table):
    """All power states of a drive; a statusword that fits no row is *unknown*, and is answered with `off`."""

    rows: Annotated[tuple[PowerRow, ...], Len(1)]
    off: UInt32 = 0
    """Controlword that disables the voltage in every state."""

    @cached_property
    def mask(self) -> int:
        """Bits of a statusword that any row depends on."""
        return reduce(or_, (row.mask for row in self.rows))

    def state(self, statusword: int) -> PowerState:
        """Return the state of a statusword, by the first row that fits; UNKNOWN when none does."""
        return next((row.state for row in self.rows if statusword & row.mask == row.bits), PowerState.UNKNOWN)

    def answer(self, state: PowerState) -> int:
        """Return the controlword for a state, on the way to *operation enabled*; `off` when no row has the state."""
        return next((row.controlword for row in self.rows if row.state is state), self.off)
