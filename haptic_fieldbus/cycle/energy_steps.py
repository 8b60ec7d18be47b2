"""Steps of the ledger, with the theory in `energy`: a plain step for a single axis, and a general step.

The general step serves coupled axes, virtual states, long delays and the controller.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.cycle.energy import HELD, LEAKS, RECOVERY, Ledger, LedgerAxis, SentTorque, shares
from haptic_fieldbus.cycle.laws import PeriodStep
from haptic_fieldbus.planning.energy import AxisTerms


@dataclass(slots=True)
class _Side:
    """One axis between two periods; forces in N or N·m."""

    port: LedgerAxis
    sent: deque[float]
    """Forces of the last periods that do not act yet, newest first."""
    share: float
    by_law: bool
    """Whether the force of the scene before any limit counts: limits do not affect elements with virtual states."""
    unit: float
    most: float
    """Largest permitted force."""
    places: deque[float]
    """Positions from which the acting force was computed, and positions of the motion in the period, newest first."""
    sent_torque: SentTorque
    acting: float = 0.0
    """Force at the end of the period."""
    way: float = 0.0
    """Motion of the handle, or of the law if the force of the law counts."""
    moved: float = 0.0
    """Motion of the handle."""
    shift: float = 0.0
    direction: float = 0.0
    """Sign of the force at which the account was opened."""
    path: float = 0.0
    """Length of the path since the last change began, while it is being faded in."""
    work: float = 0.0
    """Work in the period [J]; if the force of the scene counts, work in the period before, by the trapezoidal rule."""
    force: float = 0.0
    pending: float = 0.0
    """`force`: force of the scene at the begin of the motion before; `pending`: this motion."""

    def passed(self) -> float:
        """Add the last period, and return the work done on the handle in it [J]."""
        state, places, before = self.port.state, self.places, self.acting
        here = state.position
        self.moved = self.way = way = here - places[0]
        places.appendleft(here)
        if not self.by_law:
            acting = state.target * self.unit
        else:
            acting, shift, self.shift = state.force, self.shift, self.port.permission.shift
            self.way = way = way - (self.shift - shift)
            self.work = 0.5 * (self.force + acting) * self.pending
            self.force, self.pending = acting, way
            if state.steps > 1:
                # The law was stepped along a straight line over several periods; this motion has no leak.
                self.acting = state.led_force
                self.sent = deque([self.acting] * len(self.sent))
                self.work, self.force, self.pending = self.work + state.led_work, self.acting, 0.0
                return state.led_work
        if self.sent:
            self.sent.appendleft(acting)
            acting = self.sent.pop()
        self.acting = acting
        done = way * (acting - self.share * (acting - before))
        if not self.by_law:
            self.work = done
        return done

    @property
    def last(self) -> float:
        """Return the last position [m or rad]."""
        return self.places[0]

    def damping(self, terms: AxisTerms) -> float:
        """Return the damping that compensates the leak of the period, at the places of the law [N·s/m or N·m·s/rad]."""
        if not terms.by_place:
            return terms.damping
        shift = self.port.permission.shift
        return terms.damping_between(min(self.places) - shift, max(self.places) - shift)


def bind_ledger(ledger: Ledger, *, controls: bool) -> PeriodStep:
    """Return the shortest step that is enough for `ledger`: it judges the last period, before the force of the next.

    `controls` adds the controller's damping.
    """
    if ledger.is_plain and not controls:
        return PlainAccount(ledger).bind()
    sides = [_side(port, ledger) for port in ledger.ports]
    account, control = _Account(ledger, sides), _Controller(ledger, sides) if controls else None

    def step() -> None:
        work = 0.0
        for side in sides:
            work += side.passed()
        account.take(work)
        if control is not None:
            control.damp(work)

    ledger.reopen = account.reopen
    for port in ledger.ports:
        port.permission.loosened = account.loosen
    (side, *others) = sides
    return step if others or control or side.sent or not side.by_law else account.bind_alone(side, step)


class PlainAccount:
    """The open account of a plain ledger; `cycle.ordinary` adds the work of ordinary periods to it."""

    def __init__(self, ledger: Ledger) -> None:
        (port,) = ledger.ports
        self._ledger, self._port, self._terms = ledger, port, ledger.terms[0]
        share, unit = shares(port.axis, ledger.period)[1], port.axis.effort_unit
        self.early, self.late = share * unit, (1.0 - share) * unit
        """Weights of the second last and of the last target in the mean force of a period [N or N·m for each step]."""
        self.energy = self.limit = 0.0
        """Energy given above the energy granted since the opening, and the energy at which it is judged [J]."""
        self.older = self.side = self._kept = 0
        """Second last target; sign of the targets of this contact, and of the last contact that was followed."""
        self.settles = True
        """Whether the account is looked at in each period, and not only when contact begins or ends."""
        self.last = self.behind = port.state.position
        """Last position and the one before [m or rad]."""
        self.leak = self.active = 0.0
        """Energy granted for a motion: leak·way² + active·|way| [J]."""
        self.by_place = bool(self._terms.by_place)
        """Whether the leak depends on the place."""

    def bind(self) -> PeriodStep:
        """Open the account at the present position; return the step that judges the last period."""
        state, ledger, early, late, begin = self._port.state, self._ledger, self.early, self.late, self._begin
        self.last = self.behind = state.position
        ledger.open((self.last,))
        self._port.permission.loosened, ledger.reopen = self._loosen, self._reopen

        def step() -> None:
            before, here, last, older = state.target, state.position, self.last, self.older
            if here != last:
                way = here - last
                if self.by_place:  # the force was computed at the sample before the motion
                    places, shift = (here, last, self.behind), self._port.permission.shift
                    leak = self._terms.damping_between(min(places) - shift, max(places) - shift)
                    self.leak = leak / ledger.period
                self.last, self.behind, active = here, last, self.active
                self.energy = energy = self.energy + (
                    way * (early * older + late * before - self.leak * way)
                    - (active * way if way > 0.0 else -active * way)
                )
                if energy > self.limit:
                    self.energy = ledger.judge(energy, (here,))
            if before != older or self.settles:
                self.older = before
                if before * self.side <= 0:
                    begin(before)

        return step

    def _begin(self, before: int) -> None:
        """Open a new account when contact begins or ends; judge the law in periods in which the sent force differs."""
        ledger = self._ledger
        if ledger.changing:
            ledger.tick((self.last,))
            self._grant()
            if before * self._kept > 0 and ledger.reason is None:
                self.side, self.settles = 0 if ledger.changing else self._kept, ledger.changing
                return
        if ledger.reason is not None and not ledger.law.take():
            if ledger.settles:
                self.energy, self.settles = ledger.settle(self.energy, (self.last,)), ledger.changing
                self.side, self._kept = 0 if self.settles else before, before
            return
        ledger.close(self.energy, (self.last,))
        ledger.open((self.last,))
        self.energy, self.settles = 0.0, ledger.reason is not None or ledger.changing
        self.side, self._kept = 0 if self.settles else before, before
        self._grant()
        self.limit = ledger.tally.limit + ledger.memory.reserve

    def _grant(self) -> None:
        self._terms = terms = self._ledger.terms[0]
        self.leak, self.active, self.by_place = terms.damping / self._ledger.period, terms.active, bool(terms.by_place)

    def _loosen(self) -> None:
        if self._ledger.reason is None:
            self._ledger.loosen(self.energy, (self.last,))
            self.side, self.settles = 0, True

    def _reopen(self) -> None:
        self.side, self._kept, self.settles = 0, self.side, True


def _side(port: LedgerAxis, ledger: Ledger) -> _Side:
    whole, share = shares(port.axis, ledger.period)
    by_law, unit, most = ledger.memory.silence > 0, port.axis.effort_unit, port.axis.limits.effort
    places = deque([port.state.position] * (whole + 3), maxlen=whole + 3)
    return _Side(port, deque([0.0] * whole), share, by_law, unit, most, places, SentTorque(port))


class _Account:
    """Energy given since the account was opened, and energy granted for leak, friction and active elements [J]."""

    def __init__(self, ledger: Ledger, sides: Sequence[_Side]) -> None:
        self._ledger, self._sides = ledger, sides
        self._given = self._granted = 0.0
        self._sent = self._beyond = 0.0
        """Work of the sent force, and its excess over the work of the law, if the law is always judged."""
        self._silent = 0
        ledger.open(self._positions)

    def take(self, work: float) -> None:
        """Book the work of a period, judge the account, and open another one when contact is left."""
        ledger, given, granted = self._ledger, self._given, self._granted
        changing, period = ledger.changing, ledger.period
        for side, terms in zip(self._sides, ledger.terms, strict=True):
            way = side.way
            given += side.work
            granted += terms.active * abs(way)
            if not side.by_law:
                granted += (side.damping(terms) if terms.by_place else terms.damping) / period * way * way
                continue
            if side.port.state.steps > 1:  # each period of the straight line has the error of a motion of its own
                stiffness = side.damping(terms) / (terms.age * period)
                given -= stiffness * way * way / side.port.state.steps
            if changing:
                given -= self._begun(side, terms)
        self._given, self._granted, energy = given, granted, given - granted
        if energy > ledger.tally.largest + ledger.memory.reserve:
            self._given = granted + ledger.judge(energy, self._positions)
        if ledger.reason is not None:
            self._loose(work)
        else:
            for side in self._sides:
                if side.acting * side.direction > 0.0:
                    break
            else:  # no axis still has a force in the direction in which the account was opened
                self._begin()
        if changing:
            ledger.tick(self._positions)

    def bind_alone(self, side: _Side, step: PeriodStep) -> PeriodStep:
        """Return a shorter step for an only axis with virtual masses: periods within a contact of the law alone.

        All other periods go to `step`. The sums are the same, in the same order.
        """
        ledger, places, state = self._ledger, side.places, side.port.state

        def alone() -> None:
            here, force = state.position, state.force
            way, work = here - places[0], 0.5 * (side.force + force) * side.pending
            given, granted = self._given + work, self._granted + ledger.terms[0].active * abs(way)
            if (
                state.steps != 1
                or side.shift  # the place of the law shifts while there is a reason, and is followed until it is back
                or ledger.reason is not None
                or ledger.changing
                or not force * side.direction > 0.0
                or not given - granted <= ledger.tally.largest + ledger.memory.reserve
            ):
                step()
                return
            places.appendleft(here)
            side.moved = side.way = side.pending = way
            side.force = side.acting = force
            side.work, self._given, self._granted = work, given, granted

        return alone

    def loosen(self) -> None:
        """Note that the sent force may differ from the law from now on."""
        if self._ledger.reason is None:
            for side in self._sides:
                side.sent_torque.begin()
            self._ledger.loosen(self._given - self._granted, self._positions)

    def _loose(self, work: float) -> None:
        """Follow the contact of the law while the sent force may differ; `work` is the work of the period."""
        ledger = self._ledger
        if ledger.memory.silence:
            sent = -sum(side.sent_torque.given for side in self._sides)
            for side in self._sides:
                side.sent_torque.take()
            sent += sum(side.sent_torque.given for side in self._sides)
            self._sent += sent
            self._beyond += sent - work
            if ledger.reason == HELD:  # active elements and weights go on while the law pauses
                for side, terms in zip(self._sides, ledger.terms, strict=True):
                    self._beyond -= terms.active * max(0.0, abs(side.moved) - abs(side.way))
                self._beyond -= ledger.fallen([side.places[1] for side in self._sides])
            left = not any(side.acting * side.direction > 0.0 for side in self._sides)
        else:
            left = ledger.law.take()
        if left:
            self._begin()
        elif ledger.settles:
            self._settle()

    def _settle(self) -> None:
        """Follow the law again within a contact."""
        ledger = self._ledger
        if ledger.memory.silence:
            if ledger.reason == HELD:
                self._forgive()
            ledger.reason = None
        else:
            self._given, self._granted = ledger.settle(self._given - self._granted, self._positions), 0.0

    def _forgive(self) -> None:
        """Book the energy that was given because the sent force differed from a law that is always judged.

        Energy that was taken instead stays as credit, as with the law. Torque held in gaps is charged to its account.
        """
        if self._ledger.reason == HELD and self._ledger.charges:
            self._ledger.charge(self._beyond)
            self._sent = self._beyond = 0.0
            return
        energy = min(self._sent, self._beyond)
        self._ledger.forgive(energy, self._ledger.reason or HELD)
        if energy > 0.0 or self._silent >= self._ledger.memory.silence:
            self._sent = self._beyond = 0.0

    def reopen(self) -> None:
        """Follow a change that begins."""
        for side in self._sides:
            side.path = 0.0

    def _begun(self, side: _Side, terms: AxisTerms) -> float:
        """Return the largest energy that a new virtual mass may have taken in this period of a change [J].

        The mass begins at rest at the handle with its full force; the handle feels a share of it. Its spring is never
        longer than twice the path s of the handle since then, so it takes at most K·(2s)·ds, K·s² in all.
        """
        side.path += abs(side.way)
        stiffness = terms.damping / (terms.age * self._ledger.period)
        return 2.0 * stiffness * side.path * abs(side.way)

    @property
    def _positions(self) -> list[float]:
        return [side.last for side in self._sides]

    def _begin(self) -> None:
        """Drop the credit; the credit of elements that do not state their stored energy ends only after a silence."""
        ledger = self._ledger
        forced = any(side.acting for side in self._sides)
        self._silent = 0 if forced or any(side.way for side in self._sides) else self._silent + 1
        self._forgive()
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
    """Takes back the energy that the scene gives beyond its stored energy."""

    def __init__(self, ledger: Ledger, sides: Sequence[_Side]) -> None:
        self._ledger, self._sides = ledger, sides
        self._excess = 0.0
        self._stored = ledger.stored([side.last for side in sides])

    def damp(self, work: float) -> None:
        """Set the damping forces of the coming period."""
        ledger, sides = self._ledger, self._sides
        before, self._stored = self._stored, ledger.stored([side.last for side in sides])
        # A force that follows no law, or is cut, differs from the law for reasons to which damping must not react.
        off, free, granted, most = ledger.unsettled() is not None, True, 0.0, 0.0
        for side, terms in zip(sides, ledger.terms, strict=True):
            off = off or not -side.most <= side.port.state.force <= side.most
            free = free and not side.acting
            granted += terms.active * abs(side.way)
            most += LEAKS * side.damping(terms) * side.way * side.way
        floor = -math.inf if ledger.memory.silence else -ledger.memory.reserve
        self._excess = 0.0 if off or free else max(floor, self._excess + work + self._stored - before - granted)
        most /= ledger.period  # the energy that the full damping takes in a period
        share = min(1.0, self._excess / (RECOVERY * most)) if most and self._excess > 0.0 else 0.0
        for side, terms in zip(sides, ledger.terms, strict=True):
            side.port.sensed.damped = -share * LEAKS * side.damping(terms) * side.way / ledger.period
        if share:
            tally = ledger.tally
            tally.taken += share * most
            tally.damped += 1
            tally.strongest = max(tally.strongest, abs(sides[0].port.sensed.damped))
