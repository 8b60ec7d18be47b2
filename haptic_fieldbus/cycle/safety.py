"""The limits between a scene and a hand, and the reasons to take torque away.

Until the sign from torque to motion has been seen (`cycle.sign`), pulses of a small torque take turns with a force of
the scene that stays within what a hand may hold for ever; `limits.unseen` bounds both. From then on the force passes
three gates, in this order:

1. The limit. It rises from 0 to the effort limit of the axis within the fade-in time, and bounds the force from both
   sides. The limit fades in, not the force, so that a large force at the start grows no faster than a small one could.
2. What a disturbance leaves until contact is left, that is until the scene asks for no force or for one in the other
   direction. After a long gap in the feedback, after a doubt about the sign, and after counts that stood still under
   torque for long, a cap: the force stays at or below it. After a short gap a deficit, which is taken from what the
   scene asks for.
3. The slew limit, which bounds the change from one period to the next whatever the first two gates do.

Between the second and the third gate pulses may be added that ask an encoder whose counts stand still
(`cycle.standstill`). They stay within limit and cap, and neither cap nor deficit counts them as force of the scene.

Feedback that is missing for one period changes nothing: the torque is held, as it is held between any two periods. From
the second missing period on the held torque fades to zero. Letting it return to any value would do work on the hand
that the hand never did on the handle. When feedback returns soon, within half of the age at which it ends a run, force
therefore goes on from its value before the gap: what the scene asks for beyond it is the deficit, as if the wall stood
where the handle is now. That is the same law less a constant force, so it gives back no more than the hand brings in.
When feedback returns later, nobody knows what the hand did meanwhile, and the value before the gap is the cap.

A trip is final: torque is zero from that period on, and only a new run enables again.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

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
"""The trip for each fault of the link, the most telling first."""


CONSIDERABLE = 0.05
"""Share of a force that is worth counting; a hand notices 8 %."""


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
    """Of the handle then [m or rad]."""


@dataclass(slots=True)
class GapTally:
    """What gaps in the feedback cost one axis."""

    long: int = 0
    """How often feedback was missing for so long that a cap followed."""
    capped: int = 0
    """Periods in which such a cap cut the force."""
    short: int = 0
    """How often feedback that came back soon left a deficit, or a larger one."""
    lessened: int = 0
    """Periods in which a deficit took a considerable share of the force."""
    most: float = 0.0
    """Most that a deficit took from the force [N or N·m]."""

    def note(self, asked: float, taken: float) -> None:
        """Note a period in which a deficit took so much of what was asked."""
        self.most = max(self.most, taken)
        self.lessened += taken > CONSIDERABLE * asked


def _nothing() -> None:
    """Do nothing: no ledger follows this axis."""


@dataclass(slots=True)
class Permission:
    """How much force one axis is permitted at present [N or N·m]; its automaton is the first half of this file."""

    fade: float = 0.0
    """Share of the effort limit that is reached, 0 to 1."""
    cap: float = math.inf
    side: float = 0.0
    """Sign of the force that cap or deficit cut; 0 while none has been asked for since they came."""
    before: float = 0.0
    """The permitted force of the period before."""
    held: float = 0.0
    """The permitted force before the present gap."""
    proof: Callable[[float], float] | None = None
    """Takes the force of the scene and returns what is given until the sign has been seen; None from then on."""
    unchanged: bool = False
    """Whether no fade-in, cap, deficit or pulse is at work, so that only effort and slew limit the force."""
    pulses: Callable[[float, float], float] | None = None
    """Takes the permitted force and its bound, and returns it with a pulse that asks the encoder; None: not asked."""
    pulse: float = 0.0
    """How much such a pulse has added to the force of the period before."""
    given: float = 0.0
    """Most that such pulses may have given to the hand since the energy ledger looked [J]."""
    clipped: int = 0
    """Periods in which effort, fade-in or cap cut the force."""
    asked: float = 0.0
    """Largest force that the scene asked for beyond the effort limit, once force has faded in."""
    blind: bool = False
    """Whether feedback is missing, or was until now, but not for long."""
    deficit: float = 0.0
    """What short gaps take from the force until contact is left."""
    gaps: GapTally = field(default_factory=GapTally)
    after_gap: bool = False
    """Whether the present cap is that of a gap."""
    after_doubt: bool = False
    """Whether the present cap is that of a doubt about the sign."""
    loosened: Callable[[], None] = _nothing
    """Tells the energy ledger that from now on another force may be sent than that of the law."""

    def loosen(self) -> None:
        """Note that more than effort and slew limit the force from now on."""
        self.unchanged = False
        self.loosened()

    @property
    def lawful(self) -> bool:
        """Whether the force is that of the scene, apart from pulses that ask the encoder."""
        return self.unchanged or (self.pulses is not None and not self.blind and self.free)

    @property
    def free(self) -> bool:
        """Whether no fade-in, cap or deficit is at work."""
        return self.fade >= 1.0 and self.cap == math.inf and not self.deficit and self.proof is None

    def cap_at(self, cap: float, side: float) -> None:
        """Permit no more than `cap` in the direction `side` until contact is left."""
        self.cap, self.side, self.after_gap, self.after_doubt = cap, side, False, False
        self.loosen()

    def cap_after_gap(self, cap: float, side: float) -> None:
        """Permit no more than before a gap in the feedback, until contact is left."""
        self.gaps.long += 1
        self.cap_at(cap, side)
        self.after_gap, self.blind = True, False

    def cap_after_doubt(self, cap: float) -> None:
        """Permit no more than `cap` until the contact is left in which the handle is now, if it is in one."""
        self.cap_at(min(self.cap, cap), 0.0)
        self.after_doubt = True

    def begin_gap(self) -> None:
        """A second period passes without feedback."""
        self.blind = True
        self.loosen()

    def resume(self, force: float, risen: float) -> float:
        """Return the force of a period with feedback less the deficit; `risen` is how far the limit has faded in."""
        if self.blind:
            self._end_gap(force, min(abs(force), risen))
        taken = min(self.deficit, abs(force))
        if taken:
            self.gaps.note(abs(force), taken)
        return math.copysign(abs(force) - taken, force)

    def _end_gap(self, force: float, size: float) -> None:
        """Feedback is back soon: what the force would be beyond that before the gap is the deficit."""
        self.blind = False
        held = self.held - self.pulse
        before = abs(held) if held * force > 0.0 else 0.0
        if size - before > self.deficit:
            self.side, self.deficit = math.copysign(1.0, force), size - before
            self.gaps.short += 1

    def leave_contact(self, asked: float, least: float) -> None:
        """Forget cap and deficit when the scene asks for no force (`least` at most), or for one against their side."""
        if self.side == 0.0 and abs(asked) > least:
            self.side = math.copysign(1.0, asked)
        if abs(asked) <= least or asked * self.side < 0.0:
            self.cap, self.deficit, self.side = math.inf, 0.0, 0.0


def bind_limiter(
    limits: EffortLimits, period: float, permission: Permission, least: float = 0.0
) -> Callable[[float], float]:
    """Return a limiter for one run [effort → effort]: limit, cap, slew; `least` is one step of the drive's torque.

    A force that is not finite comes out as not-a-number, for the loop to stop: no comparison holds for it, so it never
    passes for a force within its limits.
    """
    effort, largest_change = limits.effort, limits.slew * period
    unseen = min(effort, limits.unseen)
    growth = period / limits.fade_in

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
        # Contact is that of the scene: a pulse of the proof, or its pause, leaves none.
        permission.leave_contact(force, least)
        if permission.proof is not None:
            force, permission.blind, permission.pulse = bounded(permission.proof(force), unseen), False, 0.0
        else:
            fade = permission.fade = min(1.0, permission.fade + growth)
            # A limit that fades in is no law of the scene: what it keeps back is not missing later.
            lawful = bounded(permission.resume(force, effort * fade if fade < 1.0 else math.inf), effort * fade)
            force, permission.pulse, permission.unchanged = lawful, 0.0, permission.free
            if permission.pulses is not None:
                force = permission.pulses(lawful, min(effort * fade, permission.cap))
                permission.pulse, permission.unchanged = force - lawful, False
        before = permission.before
        if not -largest_change <= force - before <= largest_change:
            force = before + math.copysign(largest_change, force - before)
        permission.before = force
        return force

    return limit


def bind_hold(limits: EffortLimits, period: float, permission: Permission) -> Callable[[int], float]:
    """Return what gives the permitted force of a period without feedback, by how many have been missing in a row.

    While the sign is looked for, the cap of a long gap is `limits.before_sign`: the force before may be a pulse's.
    """
    fading, soon = fade_periods(period), soon_periods(period, limits.age)

    def hold(missing: int) -> float:
        if missing == 1:
            permission.held = permission.before
            return permission.before
        if missing == 2:
            permission.begin_gap()
        if permission.blind and missing > soon:
            pulses, held = permission.proof is not None, permission.held - permission.pulse
            side = 0.0 if pulses or held == 0.0 else math.copysign(1.0, held)
            permission.cap_after_gap(min(permission.cap, limits.before_sign if pulses else abs(held)), side)
        share = max(0.0, 1.0 - (missing - 1) / fading)
        permission.before = permission.held * share
        return permission.before

    return hold
