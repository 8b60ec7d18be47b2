"""The energy ledger: the energy that the loop gave to the handle, the energy that it may give, and the trip above it.

Work. A torque computed from the sample at t_k acts from t_k + τ to t_{k+1} + τ, where τ is the transport delay plus the
lag of the torque loop. Its work is therefore the torque times the motion *after* the sample. Let the handle move on a
straight line between samples, and let τ = n·T + δ. In the motion from t_{k−1} to t_k, F_{k−2−n} acted on the share δ/T,
and F_{k−1−n} on the rest. F is the torque sent: permitted, rounded, after saturation. The torque times the motion
before the sample would show the leak with the wrong sign. (Hannaford & Ryu, Time-domain passivity control of haptic
interfaces, IEEE Trans. Robotics and Automation 18(1), 2002, 1, doi:10.1109/70.988969; for the pairing Ryu, Kim &
Hannaford, Stability guaranteed control: time domain passivity approach, IEEE Trans. Control Systems Technology 12(6),
2004, 860, doi:10.1109/TCST.2004.833648.)

Passivity. Elements that are passive in continuous time give back at most their stored energy U. The held torque leaks
K·(T/2 + τ)·v² in a spring K (Colgate & Schenkel, J. Robotic Systems 14(1), 1997, 37,
doi:10.1002/(SICI)1097-4563(199701)14:1<37::AID-ROB4>3.0.CO;2-V). From one instant (then) to a later one (now) therefore

    given ≤ U(then) − U(now) + ∫K·(T/2 + τ)·v² dt + ∫Fa·|v| dt + reserve

Fa is the largest force of elements that are active by intention; limits of power, speed and travel bound these
elements. The reserve is the energy that memories can hold, such as the bristle of a friction. If the energy given
exceeds this sum by more than a limit, the loop is active, and the run ends. The condition uses the measured motion
alone, so it holds on any bench and with any hand. The energy that friction takes is not granted, and stays a margin. K
is the slope of the linear model. If the slope is larger at some place, such as deep in a body that stiffens, K is the
largest slope between the places of the period and of the sample before it.

An element with a memory, such as tissue that has relaxed, may hold less than the largest energy that it states for a
place. U(then) is therefore the largest energy, and U(now) that of the elements without a memory alone.

Accounts. Credit ends with its contact. Each contact, from the first force in one direction to the last, opens an
account of its own; energy that a damper took earlier does not count in it. Some elements cannot state their stored
energy as a function of the position (virtual masses, elements of other packages). They keep their credit until the
handle has rested without force for one oscillation of their slowest mode. They are judged by the force of the scene:
cutting the force does not change the motion of a virtual mass, which later gives back energy as if the whole force had
acted. Their work is Σ ½·(F_k + F_{k+1})·Δx, one sample late. A held force has no leak in this sum.

A live change fades from one set of elements to another, and so does the stored energy. Its growth at the present
position, Δs·(U_new − U_old) for a step Δs of the share, is granted and booked; in gaps the ramp pauses with the law.
Pulses that test an encoder (`cycle.standstill`) are granted and booked with their size times the motion.

Reduced force. While the limit fades in, after a stall, and while the motor direction is tested, the force sent is
smaller than the force of the law. Law and sent torque are then judged separately. The law has an account of its own
force along its samples, by the trapezoidal rule,

    Σ ½·(F_k + F_{k+1})·Δx ≤ U(then) − U(now) + Σ ¼·K·Δx² + Σ Fa·|Δx| + reserve

which holds for any sent force: for a law with the slope K the rule is wrong by at most ¼·K·Δx² on a motion Δx. This
account begins with the balance of the open account, and returns its own when the force follows the law again. On the
motion through a gap the law asks for no force; there the credit changes with U. The sent torque can give the hand
energy that the law alone would not give, because the force was smaller on the way in than on the way out. The part of
this energy above all that the contact took, and above the fall of U, is forgiven: it is booked by its reason, and the
run ends above a budget for each second (`planning.energy.forgiven_limit`). When the force follows the law again within
a contact, the debt of the account is booked too, at most the force limit times the distance since the account was
opened. Virtual masses are always judged by the force of the law. Where the loop was late, the law is stepped along a
straight line, with its virtual masses.

Gaps. In a gap the law of the scene pauses (`cycle.gaps`): its stored energy is U(x − δ), and that of a weight U(x).
From the second missing sample until the force is that of the law again, also under the cap of a long gap, no energy is
granted to the torque. The energy that it gives on a straight path, above the fall of the stored energy, is charged to
one account over all gaps,

    Q ← max(−Fmax·|δ|, Q − P·t + given + U(now) − U(then)),   P = 2 mW, and Q − P·t no lower than 0

which trips above 50 mJ. While the shift δ is not 0, Q may be below 0: a hand that moved into a wall in gaps did the
work F times the shift, and other gaps may give this energy back on the way out. When the law is drawn back, the fall of
the stored energy is credited to Q, and subtracted from the open account. For elements with a memory, U is not exactly
the energy of their force. If there are such elements, or elements that do not state their stored energy, the work of
the law along the path of x − δ replaces the fall of U: a passive law gives no more work on it than it holds. Friction
loses most of that work. Its memories take up at most their reserve, so the fall of U minus that reserve counts if it is
larger than the work of the law. A virtual mass with the velocity as its only input has no place at which it could
pause. Its held torque takes energy while the handle speeds up; the energy that it gives while the handle slows down is
forgiven. While a law that does not resist is still being drawn back, F·δ is not counted against the run.

Controller. In a scene with passivity = "controller" damping also takes the excess back. In each period

    X ← max(−reserve, X + work + ΔU),   F ← F − a·B·v,   a = min(1, X/(R·T·B·v²)),   B = 2·K·(T/2 + τ)

The reference is the stored energy itself, so a contact is damped while it leaks, and not at its end (Ryu, Preusche,
Hannaford & Hirzinger, Time domain passivity control with reference energy following, IEEE Trans. Control Systems
Technology 13(5), 2005, 737, doi:10.1109/TCST.2005.847336). B, twice the damping that compensates the leak, bounds the
force. The excess is taken back over R periods, so that the controller does not react twice because of the delay. The
force passes the same limits as all other forces.
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
from haptic_fieldbus.planning.energy import AxisTerms, MemoryTerms, axis_terms, bind_stored, larger_of, memory_terms
from haptic_fieldbus.planning.limits import HELD_ENERGY, HELD_POWER
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, abilities

RECOVERY = 4.0
"""Periods in which the controller takes an excess back; the damping of one period is seen two periods later."""
LEAKS = 2.0
"""Largest damping of the controller, as a multiple of the damping that compensates the leak."""
FADE_IN, CHANGE, STALL, SIGN, ECHO, PULSES = "fade-in", "change", "stall", "sign", "echo", "pulses"
"""Reasons of booked energy: changes and pulses are granted, the others are forgiven within a budget."""
HELD = "held torque"
"""Reason of energy that is charged to the account of all gaps."""
SECOND_NS = 1_000_000_000
LIPSCHITZ = 0.25
"""Largest error of the trapezoidal rule for a law with the slope K, as a share of K·Δx²."""


StoredAt = Callable[[Sequence[float], Sequence[float]], float]
"""Positions of the axes and places of their laws [m or rad] → stored energy [J]."""


class EnergyTrip(Protocol):
    """Function that takes the torque away; it gets the energy (excess, or forgiven in a second) and its limit [J]."""

    def __call__(self, energy: float, limit: float, kind: TripKind = ..., /) -> None: ...


@dataclass(slots=True)
class EnergyRecord:
    """Figures of a ledger; energies in J."""

    limit: float
    budget: float = math.inf
    """Largest energy that may be forgiven within a second."""
    largest: float = 0.0
    """Largest energy of an account above the granted energy."""
    booked: dict[str, float] = field(default_factory=dict)
    """Energy that was granted to changes or forgiven, by the reason."""
    most: float = 0.0
    """Largest energy that was forgiven within a second."""
    recent: deque[tuple[int, float]] = field(default_factory=deque)
    """Energy forgiven within the last second, with its time [ns]."""
    held: float = 0.0
    """Energy of held torque over all gaps, minus the fall of the stored energy and minus `HELD_POWER` · time."""
    held_most: float = 0.0
    held_ns: int = 0
    """Time of the last charge to `held`."""
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
        """Book forgiven energy, and return the energy forgiven within the last second."""
        self.book(reason, energy)
        self.recent.append((t_ns, energy))
        while self.recent[0][0] <= t_ns - SECOND_NS:
            self.recent.popleft()
        second = sum(each for _, each in self.recent)
        self.most = max(self.most, second)
        return second

    def charge(self, energy: float, least: float, t_ns: int) -> float:
        """Charge the energy that held torque gave, and return the sum over all gaps, at least `least`."""
        passed = HELD_POWER * 1e-9 * (t_ns - self.held_ns)
        self.held, self.held_ns = max(least, min(self.held, max(0.0, self.held - passed)) + energy), t_ns
        self.held_most = max(self.held_most, self.held)
        return self.held


@dataclass(frozen=True, slots=True)
class LedgerAxis:
    """One axis of a ledger: its plan and its state in the cycle."""

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
        self._grown = 0.0
        """Energy by which changes have raised the stored energy so far [J]."""
        self._origin, self._clipped = 0.0, 0
        self._opened: Sequence[float] = ()
        """Places at which the account was opened. `_origin` is the stored energy left as credit, `_clipped` the periods
        cut so far."""
        self.reason: str | None = None
        """Reason why the sent force may differ from the law since the account was opened; None: it follows the law."""
        self.law = LawAccount(self)
        self.reopen: PeriodStep = lambda: None
        """Prepares the bound step for a change that begins; the step itself sets it."""
        self.terms, self.memory, self._after = self._of(elements, couplings)
        self._before = self._after

    @property
    def is_plain(self) -> bool:
        """Whether `bind_alone` is enough: one axis, elements that state their energy, and a delay below one period."""
        return len(self.ports) == 1 and not self.memory.silence and not shares(self.axes[0], self.period)[0]

    @property
    def booked(self) -> dict[str, float]:
        """Return the booked energy by its reason, with the pulses of the open account [J]."""
        self._origin += self._of_pulses()
        return dict(self.tally.booked)

    def stored(self, positions: Sequence[float], weights: Sequence[float] | None = None) -> float:
        """Return the largest stored energy at these positions of the axes [J]; during a change the mix of both sets.

        The growth by changes is left out, because no motion gave it: so a change is a step for no account. Elements
        that do not depend on the place, such as a weight, use the positions `weights` if these are given.
        """
        return self._mixed(self._energies(0, positions, weights))

    def kept(self, positions: Sequence[float]) -> float:
        """Return the least stored energy, as `stored` does the largest: a memory may have lost what it stored."""
        return self._mixed(self._energies(1, positions))

    def _mixed(self, energies: tuple[float, float]) -> float:
        before, after = energies
        return before + (after - before) * self._share - self._grown

    def _energies(
        self, which: int, positions: Sequence[float], weights: Sequence[float] | None = None
    ) -> tuple[float, float]:
        """Return the energies [J] of the elements before a change and after it; `which` 0: largest, 1: least."""
        places = [here - port.permission.shift for here, port in zip(positions, self.ports, strict=True)]
        if self.memory.silence:  # then everything is counted along the path of the law
            positions = places
        positions = positions if weights is None else weights
        after = self._after[which](positions, places)
        return (self._before[which](positions, places) if self._ramp else after), after

    @property
    def _share(self) -> float:
        """Return the share of the new elements."""
        return min(1.0, self._done / self._ramp) if self._ramp else 1.0

    @property
    def here(self) -> list[float]:
        """Present positions of the axes [m or rad]."""
        return [port.state.position for port in self.ports]

    def exchange(
        self, elements: Sequence[Sequence[Element]], couplings: Sequence[CouplingElement], periods: int
    ) -> None:
        """Fade to these elements within `periods`; until then the larger terms of both are granted."""
        self._before = self._after
        terms, memory, self._after = self._of(elements, couplings)
        self.terms = [larger_of(old, new) for old, new in zip(self.terms, terms, strict=True)]
        self.memory = MemoryTerms(max(memory.reserve, self.memory.reserve), max(memory.silence, self.memory.silence))
        self._next = terms, memory
        self._ramp, self._done = periods, 0
        self.reopen()

    def tick(self, positions: Sequence[float]) -> None:
        """Advance a change as far as its ramp: grant and book the change of the stored energy at these positions."""
        share = self._share
        self._done += self._called()
        (_, largest), (least, _) = self._energies(0, positions), self._energies(1, positions)
        change = (self._share - share) * (largest - least)
        self._grown += change
        self.tally.book(CHANGE, change)
        if self._done > self._ramp:  # the loop begins its own ramp in the period after
            self._ramp = 0
            self.terms, self.memory = self._next

    def _called(self) -> int:
        """Return how often the law is called in this period; the ramp of a coupling takes a step in each period."""
        if len(self.ports) > 1:
            return 1
        (port,) = self.ports
        return min(1, port.state.steps) if port.permission.pauses else port.state.steps

    @property
    def changing(self) -> bool:
        """Whether a change is being faded in."""
        return self._ramp > 0

    def unsettled(self) -> str | None:
        """Return why the sent force does not follow the law in this period; None if it does."""
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
        """Whether the force follows its law again, after it did not within this account."""
        return self.reason is not None and self.unsettled() is None

    def open(self, positions: Sequence[float]) -> None:
        """Open an account at these positions."""
        self._of_pulses()
        before, self.reason = self.reason, self.unsettled()
        self._origin, self._opened, self._clipped = self.stored(positions), positions, self._cut()
        if self.reason is not None and before is None:
            self.law.open(0.0, self._origin)

    def loosen(self, energy: float, positions: Sequence[float]) -> None:
        """Judge the law itself from here on; its account begins with `energy` [J], the balance of the open account.

        If the effort limit cut the force, the open account took less than the law asked for. The account of the law
        then begins at 0.
        """
        self._origin += self._of_pulses()
        self.reason = self.unsettled()
        if self._cut() == self._clipped:
            self.law.open(energy, self._origin)
        else:
            self.law.open(0.0, self.stored(positions))

    def settle(self, energy: float, positions: Sequence[float]) -> float:
        """Forgive the debt of the account, and return the balance of the law's account, with which it continues [J]."""
        self._origin += self._of_pulses()
        if self.reason == HELD:
            self.charge(self.law.held())
        else:
            ways = zip(self.axes, positions, self._opened, strict=True)
            back = sum(axis.limits.effort * abs(here - there) for axis, here, there in ways)
            self.forgive(energy + min(self.kept(positions) - self._origin, back), self.reason or HELD)
        shown = self.law.finished()
        self.reason, self._origin, self._clipped = None, self.law.origin, self._cut()
        return shown

    def close(self, energy: float, positions: Sequence[float]) -> None:
        """Judge the open account with the balance `energy` [J]; forgive it if the sent force differed from the law."""
        if self.reason == HELD:
            self.charge(self.law.held())
        elif self.reason is not None or energy > self.tally.largest:
            self.judge(energy, positions)

    def judge(self, energy: float, positions: Sequence[float]) -> float:
        """Return the part of `energy` [J] above the stored energy that was given back; trip above the limit.

        If the sent force differs from the law, this part is forgiven.
        """
        self._origin += self._of_pulses()
        if self.reason == HELD:  # charged when contact is left or the law is followed again
            return energy
        energy, self._origin = self.remaining(energy, self._origin, self.kept(positions))
        if self.reason is None or self.memory.silence:
            self.compare(energy - self.memory.reserve)
            return energy
        self.forgive(energy - self.memory.reserve, self.reason)
        return min(energy, self.memory.reserve)

    def remaining(self, energy: float, origin: float, stored: float) -> tuple[float, float]:
        """Return the part of `energy` above the fall of `stored` below `origin`, and the credit that is left."""
        return (energy - (origin - stored), stored) if stored < origin else (energy, origin)

    def compare(self, excess: float) -> None:
        """Keep the largest excess above the granted energy [J], and trip above the limit."""
        tally = self.tally
        tally.largest = max(tally.largest, excess)
        if excess > tally.limit:
            self._trip(excess, tally.limit)

    def moved_by(self, permission: Permission, state: AxisState) -> Callable[[float], None]:
        """Return a function that books that the law of one axis was drawn back, from the shift before [m or rad].

        The law then loses energy, which the handle does not get.
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
        """Return the energy that weights lost since these positions [J]; a faded weight gives 0 up to this energy."""
        here = self.here
        after, _ = self._after
        return max(0.0, after(before, here) - after(here, here))

    def charge(self, energy: float) -> None:
        """Charge the energy of held torque in a gap above the fall of the stored energy [J], and trip above the limit.

        A law that does not resist is being drawn back, and loses about its force times the shift.
        """
        least = -sum(port.axis.limits.effort * abs(port.permission.shift) for port in self.ports)
        pending = sum(max(0.0, port.state.force * port.permission.shift) for port in self.ports)
        held = self.tally.charge(energy, least, max(port.state.moved_ns for port in self.ports)) - pending
        if held > HELD_ENERGY:
            self._trip(held, HELD_ENERGY, TripKind.HELD)

    def doubted(self, energy: float) -> None:
        """Forgive the energy [J] of torque that the echo shows beyond the set-points."""
        self.forgive(energy, ECHO)

    def forgive(self, energy: float, reason: str) -> None:
        """Book energy [J] that the law alone would not have given, and trip above the budget for a second."""
        if energy > 0.0:
            t_ns = max(port.state.moved_ns for port in self.ports)
            second = self.tally.forgive(reason, energy, t_ns)
            if second > self.tally.budget:
                self._trip(second, self.tally.budget, TripKind.FORGIVEN)

    def _cut(self) -> int:
        """Return the number of periods so far in which a limit cut the force."""
        return sum([port.permission.clipped for port in self.ports])

    def _of_pulses(self) -> float:
        """Return the largest energy that encoder pulses may have given since the last call [J], and book it."""
        given = 0.0
        for port in self.ports:
            given += port.permission.given
            port.permission.given = 0.0
        self.tally.book(PULSES, given)
        return given

    def _of(
        self, elements: Sequence[Sequence[Element]], couplings: Sequence[CouplingElement]
    ) -> tuple[list[AxisTerms], MemoryTerms, tuple[StoredAt, StoredAt]]:
        """Return the terms of these elements, and the largest and the least energy that they store."""
        own = [each for of in elements for each in of]
        every: list[AnyElement] = [*own, *couplings]
        placed = [each for each in own if is_placed(each)]
        self.exact = all(abilities(each).stored for each in (*placed, *couplings)) and all(map(is_static, placed))
        """Whether the stored energy is exactly the energy of the force."""
        self.charges = not memory_terms([each for each in own if not is_placed(each)], 1.0).silence
        """Whether torque held in gaps is charged: a virtual mass without a place does not pause."""
        terms = [axis_terms(axis, of, couplings, self.period) for axis, of in zip(self.axes, elements, strict=True)]
        certain = [[each for each in of if is_static(each)] for of in elements]
        stored = bind_stored(self.axes, elements, couplings), bind_stored(self.axes, certain, couplings)
        return terms, memory_terms(every, self.period), stored


class LawAccount:
    """Judges the force of the law while the sent force differs from it; the theory is in the module docstring.

    It is one sample late: the force at a place is known together with the next place.
    """

    def __init__(self, ledger: Ledger) -> None:
        self.origin = 0.0
        """Stored energy that is left as credit [J]."""
        self._ledger = ledger
        self._energy = 0.0
        self._places, self._here = list[float](), list[float]()
        self._forces, self._sides = list[float](), list[float]()
        """`_places`, `_forces`: at the sample before the last; `_here`: last places; `_sides`: signs at first
        contact."""
        self._stored = self._stored_before = self._kept = 0.0
        """Largest stored energy at the last place, and at the one before; least stored energy at the last place [J]."""
        self._shifts = list[float]()
        self._work = 0.0
        """Work of the law along its path since the last call of `held` [J]."""
        self._unseen = False
        """Whether samples are missing on the motion to the last place, or the law was drawn back there."""
        self._torques = [SentTorque(port) for port in ledger.ports]

    def open(self, energy: float, origin: float) -> None:
        """Begin at the present places with the balance of an account, and its remaining credit [J]."""
        self._energy, self.origin = energy, origin
        self._here = self._ledger.here
        self._places, self._forces, self._sides, self._unseen = self._here, [], [], False
        self._stored = self._stored_before = self._ledger.stored(self._here)
        self._kept = self._ledger.kept(self._here)
        self._shifts = [port.permission.shift for port in self._ledger.ports]
        self._begin_gap()

    def take(self) -> bool:
        """Add the force at the last place and the place of this period; return whether contact was left."""
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
        self._kept = ledger.kept(self._here)
        shifts, self._shifts = self._shifts, [port.permission.shift for port in ledger.ports]
        moves = zip(ledger.terms, self._here, self._places, self._shifts, shifts, forces, strict=True)
        for terms, here, there, now, before, force in moves:
            way = here - there - (now - before)
            self._work += force * way - terms.active * abs(way)
        self._unseen = any(state.steps > 1 for state in states) or shifts != self._shifts
        return left

    def _add(self, forces: Sequence[float]) -> None:
        """Add the work between the last two places, minus the granted energy, and judge the sum."""
        ledger = self._ledger
        for terms, shift, there, here, before, force in zip(
            ledger.terms, self._shifts, self._places, self._here, self._forces, forces, strict=True
        ):
            way, low = here - there, min(there, here) - shift
            stiffness = terms.damping_between(low, low + abs(way)) / (terms.age * ledger.period)
            self._energy += way * (0.5 * (before + force) - LIPSCHITZ * stiffness * way) - terms.active * abs(way)
        if self._energy > ledger.tally.largest + ledger.memory.reserve:
            self._energy, self.origin = ledger.remaining(self._energy, self.origin, self._kept)
            ledger.compare(self._energy - ledger.memory.reserve)

    def finished(self) -> float:
        """Return the balance of the account, with the motion to the present places under the last force [J].

        This force is held, so its leak is granted as in any period.
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
        """Change the credit with the stored energy along a motion without samples."""
        self.origin += self._stored - self._stored_before

    def held(self) -> float:
        """Return the energy of torque held in a gap since the last call, above the fall of the stored energy [J]."""
        given = sum(
            torque.given - terms.active * torque.path
            for torque, terms in zip(self._torques, self._ledger.terms, strict=True)
        )
        ledger = self._ledger
        work = self._stored_at_gap - ledger.stored(ledger.here, self._here_at_gap)
        if not ledger.exact:  # friction loses most of its work, and holds at most its reserve
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
    """Energy of the torque sent to one axis, since a begin."""

    def __init__(self, port: LedgerAxis) -> None:
        self._port, self._unit = port, port.axis.effort_unit
        self.begin()

    def begin(self) -> None:
        """Begin at the present position."""
        self.given = self.path = 0.0
        """Energy [J] and length of the path [m or rad]."""
        self._last = self._port.state.position
        self._sum, self._periods = 0.0, 0

    def take(self) -> None:
        """Add the torque of the last period; on the motion through a gap the mean torque counts."""
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
