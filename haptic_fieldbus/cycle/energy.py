"""The energy ledger: how much energy the loop has given to the handle, how much it may have given, and what follows.

Work. A torque computed from the sample at t_k acts from t_k + τ to t_{k+1} + τ, τ the transport delay and the lag of
the torque loop. Its work is therefore paired with the way *after* it: of the way from t_{k−1} to t_k, with the handle
on a straight line between samples and τ = n·T + δ, the share δ/T went under F_{k−2−n} and the rest under F_{k−1−n}. F
is what was sent: permitted, rounded, after saturation. Paired with the way before it, the same torque shows the leak
with the opposite sign. (Hannaford & Ryu, Time-domain passivity control of haptic interfaces, IEEE Trans. Robotics and
Automation 18(1), 2002, 1, doi:10.1109/70.988969; for the pairing Ryu, Kim & Hannaford, Stability guaranteed control:
time domain passivity approach, IEEE Trans. Control Systems Technology 12(6), 2004, 860, doi:10.1109/TCST.2004.833648.)

Passivity. Elements that are passive in continuous time give back what they stored, U, and no more. The held torque
leaks, K·(T/2 + τ)·v² in a spring K (Colgate & Schenkel, J. Robotic Systems 14(1), 1997, 37,
doi:10.1002/(SICI)1097-4563(199701)14:1<37::AID-ROB4>3.0.CO;2-V). So from one moment to a later one

    given ≤ U(then) − U(now) + ∫K·(T/2 + τ)·v² dt + ∫Fa·|v| dt + reserve

with the largest force Fa of elements that are active by intention (they are bounded by power, speed and travel, not
here), and the energy that memories such as a friction's bristle can hold. A loop that gives more than that and a limit
is active, and the run ends. All of it is said of the measured motion alone, so it holds on any bench and in any hand;
what friction takes is not granted, and stays a margin. K is the slope of the linear model. Where some place is steeper,
as deep in a body that stiffens, K is the largest slope between the places of the period and of the sample behind it.

Accounts. Credit does not outlive a contact: each contact, from the first force in one direction to the last, opens an
account of its own, in which nothing counts that a damper took before. Elements that cannot state what they hold from
where the handle is (virtual masses, elements of other packages) keep their credit until the handle has rested without
force for a turn of their slowest mode. They are judged by the force of the scene: a virtual mass does not know that its
force was cut, and gives back what it would have taken. Their work is Σ ½·(F_k + F_{k+1})·Δx, one sample late. A held
force has no leak in this sum.

A live change fades from one set of elements to another, and the stored energy with them: what it grows by where the
handle is at that time, Δs·(U_new − U_old) for a step Δs of the share, is granted and booked. So
is the most that pulses may give which ask an encoder (`cycle.standstill`): their size times the way.

Another force than that of the law. While the limit fades in, after a stall and while the sign is looked for, less is
sent than the law asks for. Two things are then looked at apart from each other. The law itself is judged on, by an
account of what it asks for along the samples that it saw, by the trapezoid,

    Σ ½·(F_k + F_{k+1})·Δx ≤ U(then) − U(now) + Σ ¼·K·Δx² + Σ Fa·|Δx| + reserve

which holds whatever is sent: the work of a law with the slope K along a way Δx is off by at most ¼·K·Δx². It takes the
open account over, and gives it back when the law is followed again. Of the way through a gap the law asked for nothing;
there U is moved along. And what is sent gives the hand what the law alone would not: the force was less on the way in
than on the way out. This energy, beyond all that the contact took and that fell of U, is forgiven: it is booked by its
reason, and ends the run above a budget for each second (`planning.energy.forgiven_limit`). When the law is followed
again within a contact, what it owes is booked too, at most the force limit times the way since the account was opened.
Virtual masses are judged by the law anyhow; where the loop was late it is led along a straight line, and they with it.

Gaps. In a gap the law of the scene pauses (`cycle.gaps`): it stores U(x − δ), and a weight U(x). From the second
missing sample until the force is that of the law again, also under the cap of a long gap, the torque is granted
nothing. What it gives on a straight way, beyond the fall of the stored energy, is charged to one account over all gaps,

    Q ← max(−Fmax·|δ|, Q − P·t + given + U(now) − U(then)),   P = 2 mW, and Q − P·t no lower than 0

which trips above 50 mJ. While the law stands beside its place, Q may be below 0: a hand that was let
into a wall by gaps has paid what other gaps give it on the way out, F times the shift. What the stored energy falls by
when the law is drawn back is credited to Q, and taken from the open account. The stored energy of elements with a
memory is not exactly that of their force. Where there are such elements, or some that do not state what they store, the
work of the law along the way of x − δ takes the place of the fall of U: a passive law gives no more on it than it
holds. Friction loses most of that work. Its memories take up their reserve at most, and the fall of U less that reserve
counts where it is more than the work of the law. A virtual mass that is given the velocity alone has no place at which
it could pause: of its held torque, which takes energy while the handle speeds up, what is given while it slows down is
forgiven. While a law that does not resist is still being drawn back, F·δ is not held against the run.

Controller. A scene with passivity = "controller" also has its excess taken back, by damping: each period

    X ← max(−reserve, X + work + ΔU),   F ← F − a·B·v,   a = min(1, X/(R·T·B·v²)),   B = 2·K·(T/2 + τ)

The reference is the stored energy itself, so that a contact is damped as it leaks, and not at its end (Ryu, Preusche,
Hannaford & Hirzinger, Time domain passivity control with reference energy following, IEEE Trans. Control Systems
Technology 13(5), 2005, 737, doi:10.1109/TCST.2005.847336). B, twice the damping that the leak needs, bounds the force;
R periods to take an excess back keep the delay from answering twice. The force goes through the limits with all others.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from haptic_fieldbus.cycle.laws import AxisState, PeriodStep, Sensed, is_placed, is_static
from haptic_fieldbus.cycle.safety import Permission, TripKind
from haptic_fieldbus.numerics.sampled import split_delay
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.energy import (
    AxisTerms,
    MemoryTerms,
    axis_terms,
    bind_stored,
    larger_of,
    memory_terms,
)
from haptic_fieldbus.planning.limits import HELD_ENERGY, HELD_POWER
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, abilities

RECOVERY = 4.0
"""Periods in which the controller takes an excess back; the damping of one period is seen two periods later."""
LEAKS = 2.0
"""Largest damping of the controller, in dampings that make up for the leak."""
FADE_IN, CHANGE, STALL, SIGN, ECHO, PULSES = "fade-in", "change", "stall", "sign", "echo", "pulses"
"""Reasons for which energy is booked: changes and pulses are granted, the others are forgiven within a budget."""
HELD = "held torque"
"""Reason for which energy is charged to the account of all gaps."""
SECOND_NS = 1_000_000_000
LIPSCHITZ = 0.25
"""Of K·Δx², by which the trapezoid of a law of the slope K is off at most."""


class EnergyTrip(Protocol):
    """Takes the torque away: energy given beyond what is granted, or forgiven within a second, and its limit [J]."""

    def __call__(self, energy: float, limit: float, kind: TripKind = ..., /) -> None: ...


@dataclass(slots=True)
class EnergyRecord:
    """Figures of a ledger; energies in J."""

    limit: float
    budget: float = math.inf
    """Of what is forgiven within a second."""
    largest: float = 0.0
    """Most that an account was above what is granted."""
    booked: dict[str, float] = field(default_factory=dict)
    """Energy that was granted to changes or forgiven, by the reason."""
    most: float = 0.0
    """Most that was forgiven within a second."""
    recent: deque[tuple[int, float]] = field(default_factory=deque)
    """Energy forgiven within the last second, with its time [ns]."""
    held: float = 0.0
    """Energy of held torque over all gaps, less the fall of the stored energy and the power that nobody feels."""
    held_most: float = 0.0
    held_ns: int = 0
    """When that was charged last."""
    taken: float = 0.0
    """Energy that the controller's damping took from the handle."""
    strongest: float = 0.0
    """Largest force of the controller on the first axis [N or N·m]."""
    damped: int = 0
    """Periods in which the controller damped."""

    def book(self, reason: str, energy: float) -> None:
        if energy > 0.0:
            self.booked[reason] = self.booked.get(reason, 0.0) + energy

    def forgive(self, reason: str, energy: float, t_ns: int) -> float:
        """Book what is not judged, and return how much that was within the last second."""
        self.book(reason, energy)
        self.recent.append((t_ns, energy))
        while self.recent[0][0] <= t_ns - SECOND_NS:
            self.recent.popleft()
        second = sum(each for _, each in self.recent)
        self.most = max(self.most, second)
        return second

    def charge(self, energy: float, least: float, t_ns: int) -> float:
        """Charge what held torque gave, and return the sum over all gaps; it is `least` at least."""
        passed = HELD_POWER * 1e-9 * (t_ns - self.held_ns)
        self.held, self.held_ns = max(least, min(self.held, max(0.0, self.held - passed)) + energy), t_ns
        self.held_most = max(self.held_most, self.held)
        return self.held


@dataclass(frozen=True, slots=True)
class LedgerAxis:
    """One axis of a ledger: its plan, and what the cycle remembers of it."""

    axis: AxisPlan
    state: AxisState
    sensed: Sensed
    permission: Permission


class Ledger:
    """The ledger of one axis, or of axes that couplings tie together; raises nothing, and calls `trip` once."""

    def __init__(
        self,
        ports: Sequence[LedgerAxis],
        elements: Sequence[Sequence[Element]],
        couplings: Sequence[CouplingElement],
        period: float,
        trip: EnergyTrip,
    ) -> None:
        self.ports, self.period = tuple(ports), period
        self.axes = tuple(port.axis for port in ports)
        self.tally = EnergyRecord(self.axes[0].limits.energy, self.axes[0].limits.forgiven)
        self._trip = trip
        self._ramp, self._done = 0, 0
        self._origin, self._clipped = 0.0, 0
        self._opened: Sequence[float] = ()
        """Stored energy left as credit, periods cut so far, and places, when the account was opened."""
        self.reason: str | None = None
        """Reason for which another force may be sent than that of the law, since the account was opened."""
        self.law = LawAccount(self)
        self.reopen: PeriodStep = lambda: None
        """Makes the bound step follow a change that begins; the step itself sets it."""
        self.terms, self.memory, self._after = self._of(elements, couplings)
        self._before = self._after

    @property
    def is_plain(self) -> bool:
        """Whether `bind_alone` will do: one axis, whose elements state what they hold and whose torque acts at once."""
        return len(self.ports) == 1 and not self.memory.silence and not shares(self.axes[0], self.period)[0]

    @property
    def booked(self) -> dict[str, float]:
        """Return the energy that was booked, by the reason, with that of pulses in the open account [J]."""
        self._origin += self._of_pulses()
        return dict(self.tally.booked)

    def stored(self, positions: Sequence[float], weights: Sequence[float] | None = None) -> float:
        """Return the energy that the elements store at these positions of the axes [J]; on the way the mix of both.

        What does not depend on the place stores by the positions `weights`, if they are given.
        """
        places = [here - port.permission.shift for here, port in zip(positions, self.ports, strict=True)]
        if self.memory.silence:  # then all is counted along the way of the law
            positions = places
        positions = positions if weights is None else weights
        if not self._ramp:
            return self._after(positions, places)
        old, share = self._before(positions, places), min(1.0, self._done / self._ramp)
        return old + (self._after(positions, places) - old) * share

    @property
    def here(self) -> list[float]:
        """Present positions of the axes [m or rad]."""
        return [port.state.position for port in self.ports]

    def exchange(
        self, elements: Sequence[Sequence[Element]], couplings: Sequence[CouplingElement], periods: int
    ) -> None:
        """Go over to these elements, which are faded in within `periods`; until then the larger terms are granted."""
        self._before = self._after
        terms, memory, self._after = self._of(elements, couplings)
        self.terms = [larger_of(old, new) for old, new in zip(self.terms, terms, strict=True)]
        self.memory = MemoryTerms(max(memory.reserve, self.memory.reserve), max(memory.silence, self.memory.silence))
        self._next = terms, memory
        self._ramp, self._done = periods, 0
        self.reopen()

    def tick(self, positions: Sequence[float]) -> None:
        """Go on with a change by a period: grant and book how much more, or less, is stored at these positions."""
        stored = self.stored(positions)
        self._done += 1
        change = self.stored(positions) - stored
        self._origin += change
        self.law.origin += change
        self.tally.book(CHANGE, change)
        if self._done > self._ramp:  # the loop begins its own ramp in the period after
            self._ramp = 0
            self.terms, self.memory = self._next

    @property
    def changing(self) -> bool:
        """Whether a change is on its way."""
        return self._ramp > 0

    def unsettled(self) -> str | None:
        """Return the reason for which the force follows no passive law in this period."""
        for port in self.ports:
            permission = port.permission
            if not permission.lawful:
                if permission.proof is not None:
                    return SIGN
                if permission.fade < 1.0:
                    return FADE_IN
                if math.isfinite(permission.cap) and not permission.after_gap:
                    return SIGN if permission.after_doubt else STALL
                return HELD
        return None

    @property
    def settles(self) -> bool:
        """Whether the force follows its law again, which it did not since the account was opened."""
        return self.reason is not None and self.unsettled() is None

    def open(self, positions: Sequence[float]) -> None:
        """Open an account at these positions."""
        self._of_pulses()
        before, self.reason = self.reason, self.unsettled()
        self._origin, self._opened, self._clipped = self.stored(positions), positions, self._cut()
        if self.reason is not None and before is None:
            self.law.open(0.0, self._origin)

    def loosen(self, energy: float, positions: Sequence[float]) -> None:
        """Judge the law itself from here on; it takes over the open account, which shows `energy` [J].

        An account whose force was cut at the effort limit took less than the law asked for, and is none of the law.
        """
        self._origin += self._of_pulses()
        self.reason = self.unsettled()
        if self._cut() == self._clipped:
            self.law.open(energy, self._origin)
        else:
            self.law.open(0.0, self.stored(positions))

    def settle(self, energy: float, positions: Sequence[float]) -> float:
        """Forgive what the account owes, and return what that of the law shows, by which it goes on [J]."""
        self._origin += self._of_pulses()
        if self.reason == HELD:
            self.charge(self.law.held())
        else:
            ways = zip(self.axes, positions, self._opened, strict=True)
            back = sum(axis.limits.effort * abs(here - there) for axis, here, there in ways)
            self.forgive(energy + min(self.stored(positions) - self._origin, back), self.reason or HELD)
        shown = self.law.finished()
        self.reason, self._origin, self._clipped = None, self.law.origin, self._cut()
        return shown

    def close(self, energy: float, positions: Sequence[float]) -> None:
        """Judge the open account, which shows `energy` [J]; forgive it where another force was sent."""
        if self.reason == HELD:
            self.charge(self.law.held())
        elif self.reason is not None or energy > self.tally.largest:
            self.judge(energy, positions)

    def judge(self, energy: float, positions: Sequence[float]) -> float:
        """Return what of `energy` [J] remains above the stored energy that was given back; trip above the limit.

        Where another force is sent than that of the law, what remains is forgiven.
        """
        self._origin += self._of_pulses()
        if self.reason == HELD:  # charged when contact is left or the law is followed again
            return energy
        energy, self._origin = self.remaining(energy, self._origin, self.stored(positions))
        if self.reason is None or self.memory.silence:
            self.compare(energy - self.memory.reserve)
            return energy
        self.forgive(energy - self.memory.reserve, self.reason)
        return min(energy, self.memory.reserve)

    def remaining(self, energy: float, origin: float, stored: float) -> tuple[float, float]:
        """Return what of `energy` is above the stored energy that fell below `origin`, and how much is left there."""
        return (energy - (origin - stored), stored) if stored < origin else (energy, origin)

    def compare(self, excess: float) -> None:
        """Keep what is given beyond all that is granted [J], and trip when it is above the limit."""
        tally = self.tally
        tally.largest = max(tally.largest, excess)
        if excess > tally.limit:
            self._trip(excess, tally.limit)

    def moved_by(self, permission: Permission, state: AxisState) -> Callable[[float], None]:
        """Return what takes in that the law of one axis was drawn back, from a shift before [m or rad].

        The law gives up energy then, which the handle does not get.
        """

        def moved(before: float) -> None:
            if self.reason is not None:
                return
            now = permission.shift
            if self.exact:
                after, permission.shift = self.stored(self.here), before
                given_up, permission.shift = self.stored(self.here) - after, now
                self._origin -= given_up
            else:
                given_up = max(0.0, state.force * (before - now))
            self.charge(-given_up)

        return moved

    def fallen(self, before: Sequence[float]) -> float:
        """Return by how much a weight fell since these positions [J]; a faded one gives between nothing and that."""
        here = self.here
        return max(0.0, self._after(before, here) - self._after(here, here))

    def charge(self, energy: float) -> None:
        """Charge what held torque gave in a gap beyond the fall of the stored energy [J], and trip above the limit.

        A law that does not resist is on its way back, and gives up about its force times the shift.
        """
        least = -sum(port.axis.limits.effort * abs(port.permission.shift) for port in self.ports)
        pending = sum(max(0.0, port.state.force * port.permission.shift) for port in self.ports)
        held = self.tally.charge(energy, least, max(port.state.moved_ns for port in self.ports)) - pending
        if held > HELD_ENERGY:
            self._trip(held, HELD_ENERGY, TripKind.HELD)

    def doubted(self, energy: float) -> None:
        """Forgive what a drive gave beyond what it was sent, by its echo [J]."""
        self.forgive(energy, ECHO)

    def forgive(self, energy: float, reason: str) -> None:
        """Book energy [J] that the law alone would not have given, and trip above what is forgiven within a second."""
        if energy > 0.0:
            t_ns = max(port.state.moved_ns for port in self.ports)
            second = self.tally.forgive(reason, energy, t_ns)
            if second > self.tally.budget:
                self._trip(second, self.tally.budget, TripKind.FORGIVEN)

    def _cut(self) -> int:
        """Return in how many periods so far a limit cut the force."""
        periods = 0
        for port in self.ports:
            periods += port.permission.clipped
        return periods

    def _of_pulses(self) -> float:
        """Return the most that pulses which ask an encoder may have given since the last look [J], and book it."""
        given = 0.0
        for port in self.ports:
            given += port.permission.given
            port.permission.given = 0.0
        self.tally.book(PULSES, given)
        return given

    def _of(
        self, elements: Sequence[Sequence[Element]], couplings: Sequence[CouplingElement]
    ) -> tuple[list[AxisTerms], MemoryTerms, Callable[[Sequence[float], Sequence[float]], float]]:
        own = [each for of in elements for each in of]
        every: list[AnyElement] = [*own, *couplings]
        placed = [each for each in own if is_placed(each)]
        self.exact = all(abilities(each).stored for each in (*placed, *couplings)) and all(map(is_static, placed))
        """Whether the stored energy is that of the force."""
        self.charges = (
            all(map(is_placed, own)) or not memory_terms([each for each in own if not is_placed(each)], 1.0).silence
        )
        """Whether torque held in gaps is charged: a virtual mass without a place does not pause."""
        terms = [axis_terms(axis, of, couplings, self.period) for axis, of in zip(self.axes, elements, strict=True)]
        return terms, memory_terms(every, self.period), bind_stored(self.axes, elements, couplings)


class LawAccount:
    """Judges what the law of the scene asks for while another force is sent; its theory is at the beginning.

    It is one sample late: the force at a place is known when the next place is.
    """

    def __init__(self, ledger: Ledger) -> None:
        self.origin = 0.0
        """Stored energy that is left as credit [J]."""
        self._ledger = ledger
        self._energy = 0.0
        self._places, self._here = list[float](), list[float]()
        self._forces, self._sides = list[float](), list[float]()
        """At the sample before the last: places and forces; places of the last one; signs when contact began."""
        self._stored = self._stored_before = 0.0
        """Stored energy at the last place, and at the one before [J]."""
        self._shifts = list[float]()
        self._work = 0.0
        """Of the law along its way since the torque was looked at [J]."""
        self._unseen = False
        """Whether samples are missing on the way to the last place, or the law was drawn back there."""
        self._torques = [SentTorque(port) for port in ledger.ports]

    def open(self, energy: float, origin: float) -> None:
        """Begin at the present places with what an account shows, and the credit that it has left [J]."""
        self._energy, self.origin = energy, origin
        self._here = self._ledger.here
        self._places, self._forces, self._sides, self._unseen = self._here, [], [], False
        self._stored = self._stored_before = self._ledger.stored(self._here)
        self._shifts = [port.permission.shift for port in self._ledger.ports]
        self._begin_gap()

    def take(self) -> bool:
        """Take in the force at the last place, and the place of this period; return whether contact was left."""
        ledger, states = self._ledger, [port.state for port in self._ledger.ports]
        forces = [state.force for state in states]
        for torque in self._torques:
            torque.take()
        if self._unseen:
            self._move()
        elif self._forces:
            self._add(forces)
        left = not any(force * side > 0.0 for force, side in zip(forces, self._sides or forces, strict=True))
        if left:
            self._energy, self.origin, self._sides = 0.0, self._stored, forces
        self._sides = self._sides or forces
        self._places, self._forces, self._here = self._here, forces, ledger.here
        self._stored_before, self._stored = self._stored, ledger.stored(self._here)
        shifts, self._shifts = self._shifts, [port.permission.shift for port in ledger.ports]
        moves = zip(ledger.terms, self._here, self._places, self._shifts, shifts, forces, strict=True)
        for terms, here, there, now, before, force in moves:
            way = here - there - (now - before)
            self._work += force * way - terms.active * abs(way)
        self._unseen = any(state.steps > 1 for state in states) or shifts != self._shifts
        return left

    def _add(self, forces: Sequence[float]) -> None:
        """Add the work between the last two places, less what is granted, and judge it."""
        ledger = self._ledger
        for terms, shift, there, here, before, force in zip(
            ledger.terms, self._shifts, self._places, self._here, self._forces, forces, strict=True
        ):
            way, low = here - there, min(there, here) - shift
            stiffness = terms.damping_between(low, low + abs(way)) / (terms.age * ledger.period)
            self._energy += way * (0.5 * (before + force) - LIPSCHITZ * stiffness * way) - terms.active * abs(way)
        if self._energy > ledger.tally.largest + ledger.memory.reserve:
            self._energy, self.origin = ledger.remaining(self._energy, self.origin, self._stored)
            ledger.compare(self._energy - ledger.memory.reserve)

    def finished(self) -> float:
        """Return what the account shows, with the way to the present places under the last force [J].

        That force is held, so what it leaks is granted as in any period whose force is sent.
        """
        if self._unseen:
            self._move()
            return self._energy
        last = zip(self._ledger.terms, self._places, self._here, self._forces, strict=True)
        return self._energy + sum(
            (here - there) * (force - leak * (here - there)) - terms.active * abs(here - there)
            for terms, there, here, force in last
            for leak in [terms.damping_between(min(there, here), max(there, here)) / self._ledger.period]
        )

    def _move(self) -> None:
        """Move the credit with the stored energy along a way that was not seen."""
        self.origin += self._stored - self._stored_before

    def held(self) -> float:
        """Return what the torque held in a gap gave since the last look, beyond the fall of the stored energy [J]."""
        given = sum(
            torque.given - terms.active * torque.path
            for torque, terms in zip(self._torques, self._ledger.terms, strict=True)
        )
        ledger = self._ledger
        work = self._stored_at_gap - ledger.stored(ledger.here, self._here_at_gap)
        if not ledger.exact:  # friction loses most of its work, and holds its reserve at most
            work = max(self._work, work - ledger.memory.reserve)
        given -= work + ledger.fallen(self._here_at_gap)
        self._begin_gap()
        return given

    def _begin_gap(self) -> None:
        self._work, self._here_at_gap = 0.0, self._ledger.here
        self._stored_at_gap = self._ledger.stored(self._here_at_gap)
        for torque in self._torques:
            torque.begin()


class SentTorque:
    """Energy of the torque that is sent to one axis, from a moment on."""

    def __init__(self, port: LedgerAxis) -> None:
        self._port, self._unit = port, port.axis.effort_unit
        self.begin()

    def begin(self) -> None:
        """Begin at the present position."""
        self.given = self.path = 0.0
        """Energy [J] and length of the way [m or rad]."""
        self._last = self._port.state.position
        self._sum, self._periods = 0.0, 0

    def take(self) -> None:
        """Take in the torque of the period that has passed; of a way through a gap the mean torque counts."""
        state, torque = self._port.state, self._port.state.target * self._unit
        if not state.steps:
            self._sum, self._periods = self._sum + torque, self._periods + 1
            return
        unknown = max(0, state.steps - self._periods - 1)  # periods before the account began
        way = state.position - self._last
        mean = (self._sum + torque + unknown * self._port.permission.held) / (self._periods + 1 + unknown)
        self.given, self.path, self._last = self.given + way * mean, self.path + abs(way), state.position
        self._sum, self._periods = 0.0, 0


def shares(axis: AxisPlan, period: float) -> tuple[int, float]:
    """Return (n, δ/T) of the delay from a sample to the motor's torque: n·T + δ."""
    whole, fraction = split_delay(axis.delay.total, period)
    return whole, fraction / period
