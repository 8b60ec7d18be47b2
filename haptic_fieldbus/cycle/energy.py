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
what friction takes is not granted, and stays a margin.

Accounts. Credit does not outlive a contact: each contact, from the first force in one direction to the last, opens an
account of its own, in which nothing counts that a damper took before. Elements that cannot state what they hold from
where the handle is (virtual masses, elements of other packages) keep their credit until the handle has rested without
force for a turn of their slowest mode. They are judged by the force of the scene: a virtual mass does not know that its
force was cut, and gives back what it would have taken. Their leak is −ΔF·Δx·(½ + τ/T) in each period, with its sign,
because their force also changes while the handle stands still.

A live change fades from one set of elements to another, and the stored energy with them: what it grows by where the
handle is at that time, Δs·(U_new − U_old) for a step Δs of the share, is granted and booked. While the limit fades in,
and under a cap after a gap, the force follows no law that is passive; what it gives then, beyond
what is stored, is booked by the contact, and not judged; an account of its own begins when the law is followed again.

Controller. A scene with passivity = "controller" also has its excess taken back, by damping: each period

    X ← max(−reserve, X + work + ΔU),   F ← F − a·B·v,   a = min(1, X/(R·T·B·v²)),   B = 2·K·(T/2 + τ)

The reference is the stored energy itself, so that a contact is damped as it leaks, and not at its end (Ryu, Preusche,
Hannaford & Hirzinger, Time domain passivity control with reference energy following, IEEE Trans. Control Systems
Technology 13(5), 2005, 737, doi:10.1109/TCST.2005.847336). B, twice the damping that the leak needs, bounds the force;
R periods to take an excess back keep the delay from answering twice. The force goes through the limits with all others.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from haptic_fieldbus.cycle.safety import Permission
from haptic_fieldbus.cycle.sensing import PeriodStep
from haptic_fieldbus.cycle.state import AxisState, Sensed
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
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element

RECOVERY = 4.0
"""Periods in which the controller takes an excess back; the damping of one period is seen two periods later."""
LEAKS = 2.0
"""Largest damping of the controller, in dampings that make up for the leak."""
FADE_IN, CHANGE, GAP = "fade-in", "change", "gap"
"""Reasons for which energy is booked: a change is granted, the others are not judged."""

TripOff = Callable[[float, float], None]
"""Takes the torque away: (energy given beyond what is granted, its limit) [J]."""


@dataclass(slots=True)
class Tally:
    """What a ledger has seen; energies in J."""

    limit: float
    largest: float = 0.0
    """Most that an account was above what is granted."""
    booked: dict[str, float] = field(default_factory=dict)
    """Energy given while the force followed no passive law, by the reason."""
    taken: float = 0.0
    """Energy that the controller's damping took from the handle."""
    strongest: float = 0.0
    """Largest force of the controller on the first axis [N or N·m]."""
    damped: int = 0
    """Periods in which the controller damped."""

    def book(self, reason: str, energy: float) -> None:
        if energy > 0.0:
            self.booked[reason] = self.booked.get(reason, 0.0) + energy


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
        trip: TripOff,
    ) -> None:
        self.ports, self.period = tuple(ports), period
        self.axes = tuple(port.axis for port in ports)
        self.tally = Tally(self.axes[0].limits.energy)
        self._trip = trip
        self._ramp, self._done = 0, 0
        self._origin = 0.0
        self.reason: str | None = None
        """Reason for which the open account is booked, and not judged."""
        self.reopen: PeriodStep = lambda: None
        """Makes the bound step follow a change that begins; the step itself sets it."""
        self.terms, self.memory, self._after = self._of(elements, couplings)
        self._before = self._after

    @property
    def is_plain(self) -> bool:
        """Whether `bind_alone` will do: one axis, whose elements state what they hold and whose torque acts at once."""
        return len(self.ports) == 1 and not self.memory.silence and not shares(self.axes[0], self.period)[0]

    def stored(self, positions: Sequence[float]) -> float:
        """Return the energy that the elements store at these positions of the axes [J]; on the way the mix of both."""
        if not self._ramp:
            return self._after(positions)
        old, share = self._before(positions), min(1.0, self._done / self._ramp)
        return old + (self._after(positions) - old) * share

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
            if not permission.unchanged:
                return FADE_IN if permission.fade < 1.0 else GAP
        return None

    @property
    def lawful(self) -> bool:
        """Whether the force has followed its law since the account was opened, and does now."""
        return self.reason is None and self.unsettled() is None

    @property
    def settles(self) -> bool:
        """Whether the force follows its law again, which it did not when the account was opened."""
        return self.reason is not None and self.unsettled() is None

    def open(self, positions: Sequence[float]) -> None:
        """Open an account at these positions."""
        self._origin, self.reason = self.stored(positions), self.unsettled()

    def close(self, energy: float, positions: Sequence[float]) -> None:
        """Judge the open account, which shows `energy` [J]; book it where the force did not follow its law."""
        reason = self.reason or self.unsettled()
        if reason is not None:
            self.tally.book(reason, energy + self.stored(positions) - self._origin)
        elif energy > self.tally.largest:
            self.judge(energy, positions)

    def judge(self, energy: float, positions: Sequence[float]) -> float:
        """Return what of `energy` [J] remains above the stored energy that was given back; trip above the limit."""
        tally, stored = self.tally, self.stored(positions)
        if stored < self._origin:
            energy -= self._origin - stored
            self._origin = stored
        excess = energy - self.memory.reserve
        tally.largest = max(tally.largest, excess)
        if excess > tally.limit:
            self._trip(excess, tally.limit)
        return energy

    def _of(
        self, elements: Sequence[Sequence[Element]], couplings: Sequence[CouplingElement]
    ) -> tuple[list[AxisTerms], MemoryTerms, Callable[[Sequence[float]], float]]:
        every: list[AnyElement] = [*(each for of in elements for each in of), *couplings]
        terms = [axis_terms(axis, of, couplings, self.period) for axis, of in zip(self.axes, elements, strict=True)]
        return terms, memory_terms(every, self.period), bind_stored(self.axes, elements, couplings)


def shares(axis: AxisPlan, period: float) -> tuple[int, float]:
    """Return (n, δ/T) of the delay from a sample to the motor's torque: n·T + δ."""
    whole, fraction = split_delay(axis.delay.total, period)
    return whole, fraction / period


def bind_alone(ledger: Ledger, render: PeriodStep) -> PeriodStep:
    """Return the step of a plain ledger: it looks at the period that has passed, and then renders the coming one."""
    (port,) = ledger.ports
    state, unit = port.state, port.axis.effort_unit
    share = shares(port.axis, ledger.period)[1]
    early, late = share * unit, (1.0 - share) * unit
    last, older, energy, side, kept, settles = state.position, 0, 0.0, 0, 0, True
    leak = active = limit = 0.0
    ledger.open((last,))

    def step() -> None:
        nonlocal last, older, energy
        before, here = state.target, state.position
        if here != last:
            way = here - last
            last = here
            energy += way * (early * older + late * before - leak * way) - (
                active * way if way > 0.0 else -active * way
            )
            if energy > limit:
                judge()
        if before != older or settles:
            older = before
            if before * side <= 0:
                begin(before)
        render()

    def begin(before: int) -> None:
        """Contact is left, or begins, or its force follows the law again: open another account."""
        nonlocal energy, side, kept, settles, leak, active, limit
        if ledger.changing:
            ledger.tick((last,))
            leak, active = ledger.terms[0].damping / ledger.period, ledger.terms[0].active
            if before * kept > 0 and ledger.reason is None:
                side, settles = 0 if ledger.changing else kept, ledger.changing
                return
        if ledger.reason and before * kept > 0 and not ledger.settles:
            return
        ledger.close(energy, (last,))
        ledger.open((last,))
        energy, settles = 0.0, ledger.reason is not None or ledger.changing
        side, kept = 0 if settles else before, before
        leak, active = ledger.terms[0].damping / ledger.period, ledger.terms[0].active
        limit = ledger.tally.limit + ledger.memory.reserve

    def judge() -> None:
        nonlocal energy, side, settles
        if ledger.lawful:
            energy = ledger.judge(energy, (last,))
            return
        ledger.close(energy, (last,))
        ledger.open((last,))
        energy, side, settles = 0.0, 0, True

    def reopen() -> None:
        nonlocal side, kept, settles
        side, kept, settles = 0, side, True

    ledger.reopen = reopen
    return step
