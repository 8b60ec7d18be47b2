"""The ledger's step for tied axes, virtual states, long delays and the controller; its theory is in `energy`."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.cycle.energy import LEAKS, RECOVERY, Ledger, Port, shares
from haptic_fieldbus.cycle.sensing import PeriodStep
from haptic_fieldbus.planning.energy import AxisTerms


@dataclass(slots=True)
class _Side:
    """One axis between two periods; `sent` holds the forces of the last periods, the newest first [N or N·m]."""

    port: Port
    sent: deque[float]
    whole: int
    share: float
    by_law: bool
    """Whether the force of the scene counts, before any limit: elements with virtual states do not know it."""
    last: float
    way: float = 0.0
    direction: float = 0.0
    """Sign of the force at which the account was opened."""
    path: float = 0.0
    """Length of the way since the last change began, while it is on its way."""

    def passed(self) -> float:
        """Take in the period that has passed, and return the work that was done on the handle in it [J]."""
        state = self.port.state
        self.sent.appendleft(state.force if self.by_law else state.target * self.port.axis.effort_unit)
        self.way, self.last = state.position - self.last, state.position
        return self.way * (self.share * self.sent[self.whole + 1] + (1.0 - self.share) * self.acting)

    @property
    def is_cut(self) -> bool:
        """Whether a limit cuts the force of the scene."""
        return abs(self.port.state.force) > self.port.axis.limits.effort

    @property
    def changed(self) -> float:
        """Change of the acting force from one period to the next."""
        return self.sent[self.whole] - self.sent[self.whole + 1]

    @property
    def acting(self) -> float:
        """The force at the end of the period."""
        return self.sent[self.whole]

    @property
    def left(self) -> bool:
        """Whether this axis has no force any more in the direction in which the account was opened."""
        return self.acting * self.direction <= 0.0


def bind_tied(ledger: Ledger, render: PeriodStep, *, controls: bool) -> PeriodStep:
    """Return the step of all axes of `ledger`, and then `render`; with the controller's damping if it `controls`."""
    sides = [_side(port, ledger) for port in ledger.ports]
    account = _Account(ledger, sides)
    control = _Controller(ledger, sides) if controls else None

    def step() -> None:
        work = sum([side.passed() for side in sides])
        account.take(work)
        if control is not None:
            control.damp(work)
        render()

    ledger.reopen = account.reopen
    return step


def _side(port: Port, ledger: Ledger) -> _Side:
    whole, share = shares(port.axis, ledger.period)
    sent = deque([0.0] * (whole + 2), maxlen=whole + 2)
    return _Side(port, sent, whole, share, ledger.memory.silence > 0, port.state.position)


class _Account:
    """Energy given since the account was opened, and what was granted for leak, friction and active elements [J]."""

    def __init__(self, ledger: Ledger, sides: Sequence[_Side]) -> None:
        self._ledger, self._sides = ledger, sides
        self._given = self._granted = 0.0
        self._silent = 0

    def take(self, work: float) -> None:
        """Book the work of a period, judge the account, and open another one when contact is left."""
        self._given += work
        for side, terms in zip(self._sides, self._ledger.terms, strict=True):
            self._granted += terms.active * abs(side.way)
            if side.by_law:
                self._given += side.changed * side.way * terms.age
                self._given -= self._begun(side, terms)
            else:
                self._granted += terms.damping / self._ledger.period * side.way * side.way
        energy = self._given - self._granted
        if energy > self._ledger.tally.largest + self._ledger.memory.reserve:
            self._judge(energy)
        if all(side.left for side in self._sides):
            self._begin()
        if self._ledger.changing:
            self._ledger.tick(self._positions)

    def reopen(self) -> None:
        """Follow a change that begins."""
        for side in self._sides:
            side.path = 0.0

    def _begun(self, side: _Side, terms: AxisTerms) -> float:
        """Return what a new virtual mass may have taken in this period of a change [J].

        It begins at rest at the handle, with all of its force, while the handle feels a share of it. The spring is
        never longer than twice the way of the handle since then, so it takes at most K·(2s)·ds, in all K·s².
        """
        if not self._ledger.changing:
            return 0.0
        side.path += abs(side.way)
        stiffness = terms.damping / (terms.age * self._ledger.period)
        return 2.0 * stiffness * side.path * abs(side.way)

    @property
    def _positions(self) -> list[float]:
        return [side.last for side in self._sides]

    def _judge(self, energy: float) -> None:
        reason = self._ledger.unsettled()
        if reason is None:
            self._given = self._granted + self._ledger.judge(energy, self._positions)
        else:
            self._ledger.tally.book(reason, energy)
            self._given = self._granted = 0.0
            self._ledger.open(self._positions)

    def _begin(self) -> None:
        """Drop the credit; that of elements which do not state what they hold ends with a silence."""
        ledger, reason = self._ledger, self._ledger.unsettled()
        forced = any(side.acting for side in self._sides)
        self._silent = 0 if forced or any(side.way for side in self._sides) else self._silent + 1
        if not ledger.memory.silence or self._silent >= ledger.memory.silence:
            if reason is not None:
                ledger.tally.book(reason, self._given - self._granted)
            self._given = 0.0
        else:
            self._given = min(self._given, 0.0)
        self._granted = 0.0
        for side in self._sides:
            side.direction = 0.0 if reason is not None else side.acting
        ledger.open(self._positions)


class _Controller:
    """Takes back what the scene gives beyond its stored energy."""

    def __init__(self, ledger: Ledger, sides: Sequence[_Side]) -> None:
        self._ledger, self._sides = ledger, sides
        self._excess = 0.0
        self._stored = ledger.stored([side.last for side in sides])
        self._share = 0.0

    def damp(self, work: float) -> None:
        """Set the damping forces of the coming period."""
        ledger, tally = self._ledger, self._ledger.tally
        stored = ledger.stored([side.last for side in self._sides])
        free = not any(side.acting for side in self._sides)
        memory = ledger.memory
        floor = -math.inf if memory.silence else -memory.reserve
        # A force that follows no law, or is cut, differs from it for reasons that no damping should answer.
        off = free or ledger.unsettled() is not None or any(side.is_cut for side in self._sides)
        granted = sum(terms.active * abs(side.way) for side, terms in zip(self._sides, ledger.terms, strict=True))
        self._excess = 0.0 if off else max(floor, self._excess + work + stored - self._stored - granted)
        self._stored = stored
        dampings = [LEAKS * terms.damping for terms in ledger.terms]
        most = (
            sum(damping * side.way * side.way for damping, side in zip(dampings, self._sides, strict=True))
            / ledger.period
        )  # the energy that the whole damping takes in a period
        share = min(1.0, self._excess / (RECOVERY * most)) if most and self._excess > 0.0 else 0.0
        for side, damping in zip(self._sides, dampings, strict=True):
            side.port.sensed.damped = -share * damping * side.way / ledger.period
        tally.taken += share * most
        tally.damped += share > 0.0
        tally.strongest = max(tally.strongest, abs(self._sides[0].port.sensed.damped))
