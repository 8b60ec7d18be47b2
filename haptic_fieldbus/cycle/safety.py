"""Limits of the force between a scene and a hand, and the trips.

Until the motor direction is confirmed (`cycle.sign`), small torque pulses alternate with the force of the scene. This
force is limited to the holding force, which a hand can bear for any time; `limits.unseen` bounds both. From then on the
force passes three gates, in this order:

1. The limit. It rises from 0 to the effort limit of the axis within the fade-in time, and bounds the force from both
   sides. The limit fades in, not the force, so that a large force at the start grows no faster than a small one could.
2. The cap. It is set after a long gap in the feedback, after a doubt about the motor direction, and after counts stood
   still under torque for long. The force stays at or below the cap until contact is left: until the scene asks for no
   force, or for a force in the other direction.
3. The slew limit. It bounds the change from one period to the next, whatever the first two gates do.

Between the second and the third gate, pulses may be added that test an encoder whose counts stand still
(`cycle.standstill`). The pulses stay within limit and cap, and do not count as force of the scene.

Feedback that is missing for one period changes nothing: the torque is held, as it is held between any two periods. From
the second missing period on the held torque fades to zero. If the torque then returned to its old value, it would do
work on the hand that the hand never did on the handle. When feedback returns, the law of the scene therefore goes on
from its place before the gap (`cycle.gaps`). A gap is long if it lasts longer than half of the age at which feedback is
a trip. The motion of the hand in a long gap is unknown, so the force before the gap is the cap too.

A trip is final: torque is zero from that period on, and only a new run enables again.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from haptic_fieldbus.planning.limits import EffortLimits, fade_periods, soon_periods
from haptic_fieldbus.signals import LinkFlag


class TripKind(Enum):
    """Reason for a trip; the value is the name that users and scripts see."""

    EMERGENCY = "emergency"
    DRIVE_FAULT = "drive fault"
    DRIVE_DISABLED = "drive disabled"
    NODE_RESET = "node reset"
    NODE_NOT_OPERATIONAL = "node not operational"
    NO_SIGN_OF_LIFE = "heartbeat lost"
    FEEDBACK_LOST = "feedback lost"
    FEEDBACK_SPARSE = "feedback lost too often"
    PERIODS_MISSED = "periods missed"
    BUS_OFF = "bus off"
    BUS_EXCEPTION = "bus exception"
    NOT_FINITE = "force not finite"
    ELEMENT_FAILED = "element failed"
    START_FORCE = "force at the start"
    SPEED = "speed limit"
    ACCELERATION = "acceleration limit"
    POWER = "power limit"
    ENERGY = "energy limit"
    FORGIVEN = "energy forgiven"
    HELD = "energy of held torque"
    POSITION = "position limit"
    DRIFT = "position drift"
    SET_POINTS_DEAD = "set-points do not act"
    SET_POINTS_FOREIGN = "set-points of another master"
    SIGN = "motion against the torque"
    SIGN_HIDDEN = "no motion that shows the sign"
    CLOCK = "clock went back"
    ENCODER_STILL = "encoder stands still"
    FOREIGN_MASTER = "foreign master"
    DUPLICATE_NODE = "duplicate node"


LINK_TRIPS = {
    LinkFlag.BUS_OFF: TripKind.BUS_OFF,
    LinkFlag.FOREIGN: TripKind.FOREIGN_MASTER,
    LinkFlag.DUPLICATE: TripKind.DUPLICATE_NODE,
    LinkFlag.EMERGENCY: TripKind.EMERGENCY,
    LinkFlag.BOOT_UP: TripKind.NODE_RESET,
    LinkFlag.NO_SIGN_OF_LIFE: TripKind.NO_SIGN_OF_LIFE,
    LinkFlag.NOT_OPERATIONAL: TripKind.NODE_NOT_OPERATIONAL,
    LinkFlag.EXCEPTION: TripKind.BUS_EXCEPTION,
}
"""Trip for each link fault, the root cause first."""


@dataclass(frozen=True)
class Trip:
    """Reason and instant of the loss of torque: `value` exceeded `limit` (None: no limit) on `axis` at `t_ns`."""

    kind: TripKind
    axis: str
    t_ns: int
    value: float
    limit: float | None = None
    detail: str = ""
    position: float = 0.0
    """Position of the handle at that time [m or rad]."""


class TripOff(Protocol):
    """Function that records a trip and takes the torque away."""

    def __call__(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None: ...


@dataclass(slots=True)
class GapCounts:
    """Cost of feedback gaps for one axis."""

    long: int = 0
    """Number of gaps after which a cap was set."""
    capped: int = 0
    """Periods in which the cap of a gap cut the force."""
    short: int = 0
    """Number of short gaps, after which the scene went on from its place before the gap."""
    shifted: int = 0
    """Periods with a sample in which the scene was shifted."""
    farthest: float = 0.0
    """Largest shift of the scene [m or rad]."""


def _nothing() -> None:
    """Do nothing: no ledger follows this axis."""


@dataclass(slots=True)
class Permission:
    """Force that one axis is permitted at present [N or N·m]; the module docstring describes its automaton."""

    fade: float = 0.0
    """Share of the effort limit that the fade-in has reached, 0 to 1."""
    cap: float = math.inf
    side: float = 0.0
    """Sign of the force that the cap cuts; 0 until the scene asks for a force under this cap."""
    before: float = 0.0
    """Permitted force of the period before."""
    held: float = 0.0
    """Permitted force before the present gap."""
    proof: Callable[[float], float] | None = None
    """Function from the force of the scene to the force until the motor direction is confirmed; None afterwards."""
    unchanged: bool = False
    """Whether no fade-in, cap, gap or pulse is at work, so that only effort and slew limit the force."""
    pulses: Callable[[float, float], float] | None = None
    """Function from the permitted force and its bound to the force with an encoder pulse; None: no encoder test."""
    pulse: float = 0.0
    """Part of the encoder pulse in the force of the period before [N or N·m]."""
    given: float = 0.0
    """Largest energy that encoder pulses may have given to the hand since the energy ledger last read it [J]."""
    clipped: int = 0
    """Periods in which effort, fade-in or cap cut the force."""
    checked: int = 0
    """Periods in which the motor direction check took the place of a force of the scene."""
    asked: float = 0.0
    """Largest force that the scene asked for beyond the effort limit, once force has faded in."""
    blind: bool = False
    """Whether feedback is missing, or the force has not yet returned to that of the scene after a gap."""
    is_long: bool = False
    """Whether the present gap, or the last one, left a cap."""
    returning: int = 0
    """Periods in which the force has been coming back."""
    shift: float = 0.0
    """Shift of the scene after gaps: position of the handle minus place of the law [m or rad]."""
    beside: bool = False
    """Whether the place of the law needs an update in each period: `blind`, a `shift`, or the cap of a gap."""
    gaps: GapCounts = field(default_factory=GapCounts)
    astray: bool = False
    """Whether the shift is beyond its bound: a cap then stays."""
    after_gap: bool = False
    """Whether the present cap is that of a gap."""
    after_doubt: bool = False
    """Whether the present cap is that of a doubt about the sign."""
    loosened: Callable[[], None] = _nothing
    """Tells the energy ledger that the sent force may differ from the law from now on."""

    def loosen(self) -> None:
        """Note that more than effort and slew limit the force from now on."""
        self.unchanged = False
        self.loosened()

    @property
    def lawful(self) -> bool:
        """Whether the force is that of the scene, apart from encoder pulses."""
        return self.unchanged or (self.pulses is not None and self.free)

    @property
    def free(self) -> bool:
        """Whether no fade-in, cap or gap is at work."""
        return self.fade >= 1.0 and self.cap == math.inf and not self.blind and self.proof is None

    @property
    def capped(self) -> bool:
        """Whether the cap of a gap is at work."""
        return self.after_gap and self.cap < math.inf

    @property
    def pauses(self) -> bool:
        """Whether the law of the scene pauses, because of a gap that is not over."""
        return self.blind and self.proof is None

    def cap_at(self, cap: float, side: float) -> None:
        """Permit no more than `cap` in the direction `side` until contact is left."""
        self.cap, self.side, self.after_gap, self.after_doubt = cap, side, False, False
        self.loosen()

    def cap_after_gap(self, cap: float, side: float) -> None:
        """Permit no more than before a gap in the feedback, until contact is left."""
        self.gaps.long += 1
        self.cap_at(cap, side)
        self.after_gap = True

    def give_up_place(self) -> None:
        """Permit no more than the force before the gap, because the shift would be too large."""
        held = self.held - self.pulse
        self.cap_after_gap(min(self.cap, abs(held)), math.copysign(1.0, held) if held else 0.0)

    def cap_after_doubt(self, cap: float) -> None:
        """Permit no more than `cap` until the handle leaves its present contact, if it is in contact."""
        self.cap_at(min(self.cap, cap), 0.0)
        self.after_doubt = True

    def begin_gap(self) -> None:
        """Begin a gap: a second period passes without feedback."""
        self.blind = self.beside = True
        self.is_long, self.returning = False, 0
        self.loosen()

    def come_back(self, *, arrived: bool, longest: int) -> None:
        """Count a period with feedback; end the gap when the force has `arrived` at the scene's, or after `longest`
        periods."""
        self.gaps.short += not self.returning and not self.is_long
        self.returning += 1
        self.blind = not arrived and self.returning < longest

    def leave_contact(self, asked: float, least: float) -> None:
        """Remove the cap when the scene asks for no force (at most `least`), or for one against the side of the cap.

        While the shift is too large, only the side is reset.
        """
        if self.side == 0.0 and abs(asked) > least:
            self.side = math.copysign(1.0, asked)
        if abs(asked) <= least or asked * self.side < 0.0:
            self.cap, self.side = self.cap if self.astray else math.inf, 0.0


def whole_steps(effort: float, step: float) -> float:
    """Return the largest effort in whole steps of the drive's torque that is not above `effort`; a step of 0 is none.

    So rounding to steps cannot exceed a limit.
    """
    return math.floor(effort / step + 1e-9) * step if step else effort


def bind_limiter(
    limits: EffortLimits, period: float, permission: Permission, least: float = 0.0
) -> Callable[[float], float]:
    """Return a limiter for one run [effort → effort]: limit, cap, slew; `least` is one step of the drive's torque.

    A force that is not finite is returned as not-a-number, and the loop trips. No comparison holds for not-a-number, so
    it never counts as a force within the limits.
    """
    effort, largest_change = whole_steps(limits.effort, least), limits.slew * period
    unseen = min(effort, limits.unseen)
    growth, fading = period / limits.fade_in, fade_periods(period)

    def limit(force: float) -> float:
        before = permission.before
        if permission.unchanged and -effort <= force <= effort and -largest_change <= force - before <= largest_change:
            permission.before = force
            return force
        return beyond(force)

    def bounded(force: float, highest: float) -> float:
        bound = min(highest, permission.cap)
        if -bound <= force <= bound:
            return force
        permission.clipped += 1
        if bound == effort:
            permission.asked = max(permission.asked, abs(force))
        permission.gaps.capped += permission.after_gap and permission.cap < highest
        return math.copysign(bound, force)

    def beyond(force: float) -> float:
        if not math.isfinite(force):
            return math.nan
        # The scene alone defines contact: neither a pulse of the proof nor its pause leaves a contact.
        permission.leave_contact(force, least)
        if permission.proof is not None:
            permission.checked += abs(force) >= least
            force, permission.blind, permission.pulse = bounded(permission.proof(force), unseen), False, 0.0
        else:
            fade = permission.fade = min(1.0, permission.fade + growth)
            lawful = force = bounded(force, effort * fade)
            if permission.pulses is not None:
                force = permission.pulses(lawful, min(effort * fade, permission.cap))
            permission.pulse = force - lawful
        before, whole = permission.before, force
        if not -largest_change <= force - before <= largest_change:
            force = before + math.copysign(largest_change, force - before)
        if permission.blind:
            permission.come_back(arrived=abs(force - whole) <= least, longest=fading)
        permission.unchanged = permission.free and permission.pulses is None
        permission.before = force
        return force

    return limit


def bind_hold(limits: EffortLimits, period: float, permission: Permission) -> Callable[[int], float]:
    """Return a function: number of consecutive periods without feedback → permitted force.

    While the motor direction is tested, the cap of a long gap is `limits.before_sign`: the force before may be a pulse.
    """
    fading, soon = fade_periods(period), soon_periods(period, limits.age)

    def hold(missing: int) -> float:
        if missing == 1:
            permission.held = permission.before
            return permission.before
        if missing == 2:
            permission.begin_gap()
        if permission.blind and missing > soon and not permission.is_long:
            permission.is_long = True
            if permission.proof is None:
                permission.give_up_place()
            else:
                permission.cap_after_gap(min(permission.cap, limits.before_sign), 0.0)
        share = max(0.0, 1.0 - (missing - 1) / fading)
        permission.before = permission.held * share
        return permission.before

    return hold
