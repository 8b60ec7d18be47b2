"""Command and status of a drive that has no controlword: a mode register or an opcode, by the rows of its profile.

Theory: the rows of the profile are the automaton of such a drive as a table. In each of its states the drive shows the
bits of the row, and the command of that row takes it to the next state of the table on the way to *operation enabled*.
The profile's `off` frees the shaft in every state, and its `reset` clears a fault. Every other command is refused.
Inside is the drive of CiA 402, which gets the controlwords of the way that the command stands for.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.power import PowerRow
from haptic_fieldbus.protocols.modbus.profile import PowerSection
from haptic_fieldbus.sim.drive.dictionary import Access, Entry, one_of
from haptic_fieldbus.sim.drive.power import State

_WAY = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED)
_WORDS = (0x00, 0x06, 0x07, 0x0F)
"""Controlwords that lead to the states of the way, one after the other."""
_FAULT_RESET = 0x80
"""Controlword that clears a fault."""
_BEHIND = {State.FAULT_REACTION_ACTIVE: State.FAULT, State.QUICK_STOP_ACTIVE: State.OPERATION_ENABLED}
"""States that a table may lack, and those as which they are shown then."""


class Front:
    """The entries of command and status, in the place of controlword and statusword."""

    def __init__(self, power: PowerSection, state: Callable[[], State], obey: Callable[[int], None]) -> None:
        """`state` returns the state of the drive inside, `obey` gives it a controlword."""
        self._state, self._obey, self._off, self._reset = state, obey, power.off, power.reset
        self._rows = {State(row.state.value): row for row in power.rows}
        self.status = Entry(0, 0, power.status.type)
        self.status.fetch = lambda: self._row().bits
        commands = [power.off, *(row.controlword for row in power.rows)]
        commands += [] if power.reset is None else [power.reset]
        self.command = Entry(0, 0, power.command.type, power.off, Access.RW, accept=one_of(commands))
        self.command.changed = self._commanded

    def _row(self) -> PowerRow:
        """Return the row that the drive shows: that of its state, else of the last one that it has passed."""
        state = self._state()
        state = state if state in self._rows else _BEHIND.get(state, state)
        if state in self._rows:
            return self._rows[state]
        passed = reversed(_WAY[: _WAY.index(state)] if state in _WAY else ())
        return next(self._rows[each] for each in (*passed, *_WAY) if each in self._rows)

    def _commanded(self) -> None:
        command, row = self.command.value, self._row()
        if command == self._off:
            self._obey(_WORDS[0])
        elif command == self._reset:
            self._obey(_FAULT_RESET)
        elif command == row.controlword and self._state() in _WAY:
            self._go_on(_WAY.index(self._state()))

    def _go_on(self, place: int) -> None:
        """Go to the next state of the table on the way."""
        for state, word in zip(_WAY[place + 1 :], _WORDS[place + 1 :], strict=True):
            self._obey(word)
            if state in self._rows:
                return
