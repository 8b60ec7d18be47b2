"""The torque by which the sign from torque to motion is seen, before more than a hand can bear is given.

A reversed encoder, or a motor that turns the other way, makes a spring push away instead of back. In a scene nothing
tells this before the handle flies: a spring answers the position alike with either sign, and a hand that leads the
handle sees to it that position and torque go together. What tells is a torque that does *not* answer the motion. So at
enabling, while the permitted torque is small, pulses of both signs are given, of which neither scene nor hand knows.

A *pulse* lasts three times n periods: n without torque, n with the torque s·A, n with −s·A to stop again. From the
positions at the ends of its first two thirds follows the second difference

    e = x(2n) − 2·x(n) + x(0)

A motion with constant speed drops out of it. Two pulses of opposite sign are a *pair*, d = e₊ − e₋, from which constant
acceleration drops out too: a push, a weight. For a mass alone d = A·T²/m with T = n periods.

Three things must agree before anything is decided, so that it takes more than noise, a hand or a spring to decide
falsely, and all three are the same for either decision:

- *Every pair* shows |d| of at least three counts, all to the same side. Each of the readings of a pair is up to half a
  count off, two of them count twice: together at most four counts, with a standard deviation of one.
- *The first pulse* goes to that side. It begins at rest, and what is pushed out of rest goes the way of the push first,
  whatever mass, spring or damper hold it. Later pulses may go wrong while the handle still rings.
- *Every pulse* goes the way of its torque, after a straight line is taken out of their e. The signs are + − − + − + + −
  … (Thue and Morse), which no even motion follows: a hand that leads the handle would have to turn it round with nearly
  every pulse, some 30 times a second on the shipped bench. Where pulses are so long that a hand could, there are
  twice as many, with turns that are so uneven that no swing follows them.

A pulse is as long as it takes for d to be four counts, but at least 5 ms. When friction or a hand hides the motion, the
torque is raised to its bound, then the pulses are made longer; after that the scene goes on within 5 % of rated torque,
and it is tried again every second.
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import HOLDING_SHARE

FIRST_SHARE = 2.0 / 3.0
"""Of the bound, with which the probe begins."""
FRICTION_SHARE = 1.1
"""Of the breakaway torque, where friction is larger than what is permitted otherwise."""
SHORTEST_PULSE, LONGEST_PULSE = 0.005, 0.1
"""[s]; of the part with one torque."""
ASKED_COUNTS, SEEN_COUNTS = 4.0, 3.0
"""Counts that a pair is designed to show, and those from which on it counts."""
FEWEST_PAIRS, MORE_PAIRS = 3, 6
"""Pairs of a stage that is faster than a hand, and of one that is not."""
HAND_TIME = 0.15
"""[s]; in it a hand makes no more than one movement and back."""
PAUSE = 1.0
"""[s] between two attempts."""
PULSES_OF_A_PAIR, PARTS = 2, 3


@dataclass(frozen=True)
class PulseStage:
    """Pairs of pulses of one torque [N or N·m in the workspace] and length, of the part with one torque [periods]."""

    effort: float
    periods: int
    pairs: int


@dataclass(frozen=True)
class SignProbe:
    """How the sign of one axis will be seen."""

    stages: tuple[PulseStage, ...]
    """Tried one after the other until the sign is seen."""
    holding: float
    """Effort that the scene is permitted until then [N or N·m]."""
    period: float
    """[s]"""
    step: float
    """What one count of the encoder is worth [m or rad]; for a drive with velocity only, one of its speed [m/s]."""
    speed: bool
    """Whether `step` is one of speed."""
    mass: float | None
    """[kg or kg·m²]; None: unknown."""
    friction: float
    """[N or N·m]"""

    @property
    def largest(self) -> float:
        """Largest effort of the probe [N or N·m]."""
        return max(stage.effort for stage in self.stages)

    @property
    def time(self) -> float:
        """Least time until the sign is seen [s]."""
        return self.stages[0].pairs * PULSES_OF_A_PAIR * PARTS * self.stages[0].periods * self.period

    @property
    def travel(self) -> float | None:
        """How far a free handle is moved at most by a pulse that is seen [m or rad]; None: the inertia is unknown."""
        first = self.stages[0]
        if not self.mass:
            return None
        return max(0.0, first.effort - self.friction) / self.mass * (first.periods * self.period) ** 2

    def least(self, stage: PulseStage) -> float:
        """Return the smallest d of a pair that counts [m or rad]."""
        return SEEN_COUNTS * self.step * (stage.periods * self.period if self.speed else 1.0)


def sign_probe(axis: AxisPlan, period: float) -> SignProbe | None:
    """Return how the sign of the axis is seen; None where it is known."""
    return None if axis.sign_known else probe_of(axis, period)


def probe_of(axis: AxisPlan, period: float) -> SignProbe:
    """Return how the sign of the axis is seen, known or not."""
    friction = axis.rig.coulomb_friction / axis.rig.mechanism.ratio
    bound = min(axis.limits.effort, max(HOLDING_SHARE * axis.rated_effort, FRICTION_SHARE * friction))
    # A drive has steps of torque: at most the bound, after rounding.
    bound = max(1, math.floor(bound / axis.effort_unit + 1e-9)) * axis.effort_unit
    first = FIRST_SHARE * bound
    # Two thirds that friction eats up are not worth trying.
    efforts = (first, bound) if first > 1.5 * friction else (bound,)
    step = abs(axis.velocity_unit) if axis.integrates else axis.resolution
    mass = axis.plant.mass if axis.plant is not None else None
    length = _length(step, efforts[0] - friction, mass, speed=axis.integrates)
    periods = max(1, math.ceil(length / period - 1e-9))
    longest = max(periods, round(LONGEST_PULSE / period))
    sizes = [(effort, periods) for effort in efforts]
    sizes += [(bound, min(longest, factor * periods)) for factor in (2, 4)]
    stages = tuple(PulseStage(*size, _pairs(size[1] * period)) for size in dict.fromkeys(sizes))
    holding = min(axis.limits.effort, HOLDING_SHARE * axis.rated_effort)
    return SignProbe(stages, holding, period, step, axis.integrates, mass, friction)


def _pairs(length: float) -> int:
    """Return how many pairs decide with pulses of this length [s]."""
    fast = FEWEST_PAIRS * PULSES_OF_A_PAIR * PARTS * length <= HAND_TIME
    return FEWEST_PAIRS if fast else MORE_PAIRS


def _length(step: float, effort: float, mass: float | None, *, speed: bool) -> float:
    """Return the time for which a torque must act on the free handle to be seen [s]."""
    if not mass or effort <= 0.0:
        return SHORTEST_PULSE
    least = ASKED_COUNTS * step * mass / effort  # speed times time of the pulse, or its square
    return min(max(least if speed else math.sqrt(least), SHORTEST_PULSE), LONGEST_PULSE)


def sign_text(axis: AxisPlan, probe: SignProbe) -> str:
    """Return in words how the sign will be seen."""
    force, length = axis.workspace.effort_unit, axis.workspace.length_unit
    first = probe.stages[0]
    raised = f", then {in_unit(probe.largest, force)}" if probe.largest > first.effort else ""
    travel = "by an unknown way" if probe.travel is None else f"by up to {in_unit(probe.travel, length)}"
    at = (
        f" at {in_unit(probe.travel / (first.periods * probe.period), f'{length}/s')}"
        if probe.travel and probe.speed
        else ""
    )
    return (
        f"pulses of ±{in_unit(first.effort, force)}{raised} move the free handle to and fro {travel}{at} for "
        f"{rounded(1e3 * probe.time)} ms; until motion follows torque, at most {in_unit(probe.holding, force)}"
    )
