"""The ledger's step for tied axes, virtual states, long delays and the controller; its theory is in `energy`."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.cycle.energy import LEAKS, RECOVERY, Ledger, LedgerAxis, bind_alone, shares
from haptic_fieldbus.cycle.sensing import PeriodStep
from haptic_fieldbus.planning.energy import AxisTerms


@dataclass(slots=True)
class _Side:
    """One axis between two periods; forces in N or N·m."""

    port: LedgerAxis
    sent: deque[float]
    """Forces of the last periods that do not act yet, the newest first."""
    share: float
    by_law: bool
    """Whether the force of the scene counts, before any limit: elements with virtual states do not know it."""
    unit: float
    most: float
    """Largest force that is permitted."""
    last: float
    acting: float = 0.0
    """Force at the end of the period."""
    changed: float = 0.0
    """How much it differs from the one at its begin."""
    way: float = 0.0
    direction: float = 0.0
    """Sign of the force at which the account was opened."""
    path: float = 0.0
    """Length of the way since the last change began, while it is on its way."""

    def passed(self) -> float:
        """Take in the period that has passed, and return the work that was done on the handle in it [J]."""
        state, before = self.port.state, self.acting
        self.sent.appendleft(state.force if self.by_law else state.target * self.unit)
        self.acting = acting = self.sent.pop()
        self.changed = changed = acting - before
        here = state.position
        self.way, self.last = here - self.last, here
        return self.way * (acting - self.share * changed)


def bind_ledger(ledger: Ledger, render: PeriodStep, *, controls: bool) -> PeriodStep:
    """Return the shortest step that will do for `ledger`: it looks at the period that has passed, and then renders."""
    if ledger.is_plain and not controls:
        return bind_alone(ledger, render)
    return bind_tied(ledger, render, controls=controls)


def bind_tied(ledger: Ledger, render: PeriodStep, *, controls: bool) -> PeriodStep:
    """Return the step of all axes of `ledger`, and then `render`; with the controller's damping if it `controls`."""
    sides = [_side(port, ledger) for port in ledger.ports]
    account = _Account(ledger, sides)
    control = _Controller(ledger, sides) if controls else None

    def step() -> None:
        work = 0.0
        for side in sides:
            work += side.passed()
        account.take(work)
        if control is not None:
            control.damp(work)
        render()

    ledger.reopen = account.reopen
    return step


def _side(port: LedgerAxis, ledger: Ledger) -> _Side:
    whole, share = shares(port.axis, ledger.period)
    by_law, unit, most = ledger.memory.silence > 0, port.axis.effort_unit, port.axis.limits.effort
    return _Side(port, deque([0.0] * whole), share, by_law, unit, most, port.state.position)


class _Account:
    """Energy given since the account was opened, and what was granted for leak, friction and active elements [J]."""

    def __init__(self, ledger: Ledger, sides: Sequence[_Side]) -> None:
        self._ledger, self._sides = ledger, sides
        self._given = self._granted = 0.0
        self._silent = 0
        ledger.open(self._positions)

    def take(self, work: float) -> None:
        """Book the work of a period, judge the account, and open another one when contact is left."""
        self._given += work
        for side, terms in zip(self._sides, self._ledger.terms, strict=True):
            self._granted += terms.active * abs(side.way)
            if side.by_law:
                self._given += side.changed * side.way * terms.age
                if side.port.state.steps > 1:  # after a gap the law went through the way, which the held force did not
                    self._given -= 2.0 * terms.damping / (terms.age * self._ledger.period) * side.way * side.way
                self._given -= self._begun(side, terms)
            else:
                self._granted += terms.damping / self._ledger.period * side.way * side.way
        energy = self._given - self._granted
        if energy > self._ledger.tally.largest + self._ledger.memory.reserve:
            self._judge(energy)
        for side in self._sides:
            if side.acting * side.direction > 0.0 and not self._ledger.settles:
                break
        else:  # no axis has a force any more in the direction in which the account was opened
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
        if self._ledger.lawful:
            self._given = self._granted + self._ledger.judge(energy, self._positions)
        else:
            self._ledger.close(energy, self._positions)
            self._given = self._granted = 0.0
            self._ledger.open(self._positions)

    def _begin(self) -> None:
        """Drop the credit; that of elements which do not state what they hold ends with a silence."""
        ledger = self._ledger
        forced = any(side.acting for side in self._sides)
        self._silent = 0 if forced or any(side.way for side in self._sides) else self._silent + 1
        if not ledger.memory.silence or self._silent >= ledger.memory.silence:
            ledger.close(self._given - self._granted, self._positions)
            self._given = 0.0
        else:
            self._given = min(self._given, 0.0)
        self._granted = 0.0
        for side in self._sides:
            side.direction = side.acting
        ledger.open(self._positions)


class _Controller:
    """Takes back what the scene gives beyond its stored energy."""

    def __init__(self, ledger: Ledger, sides: Sequence[_Side]) -> None:
        self._ledger, self._sides = ledger, sides
        self._excess = 0.0
        self._stored = ledger.stored([side.last for side in sides])

    def damp(self, work: float) -> None:
        """Set the damping forces of the coming period."""
        ledger, sides = self._ledger, self._sides
        before, self._stored = self._stored, ledger.stored([side.last for side in sides])
        # A force that follows no law, or is cut, differs from it for reasons that no damping should answer.
        off, free, granted, most = ledger.unsettled() is not None, True, 0.0, 0.0
        for side, terms in zip(sides, ledger.terms, strict=True):
            off = off or not -side.most <= side.port.state.force <= side.most
            free = free and not side.acting
            granted += terms.active * abs(side.way)
            most += LEAKS * terms.damping * side.way * side.way
        floor = -math.inf if ledger.memory.silence else -ledger.memory.reserve
        self._excess = 0.0 if off or free else max(floor, self._excess + work + self._stored - before - granted)
        most /= ledger.period  # the energy that the whole damping takes in a period
        share = min(1.0, self._excess / (RECOVERY * most)) if most and self._excess > 0.0 else 0.0
        for side, terms in zip(sides, ledger.terms, strict=True):
            side.port.sensed.damped = -share * LEAKS * terms.damping * side.way / ledger.period
        if share:
            tally = ledger.tally
            tally.taken += share * most
            tally.damped += 1
            tally.strongest = max(tally.strongest, abs(sides[0].port.sensed.damped))
