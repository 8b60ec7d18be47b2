"""Limits of a sampled haptic loop before anything moves: numbers in, limits and a verdict out.

The loop. A device of mass m and viscous damping b moves freely (no hand: a hand's damping hides instability that
appears on release). Its position is sampled every T, and the environment's force is held from td after the sample
until td after the next. `numerics.sampled` discretises this exactly, fractional delay and torque loop included, and
the eigenvalues of one period decide. A loop whose environment never opposes a slow shift (a sprung mass, a damper) has
an eigenvalue of exactly 1, the handle staying where it is left: that is no instability and is left out.

Passivity is asked of the same loop with *any* passive hand. For a spring the condition of Colgate & Schenkel, extended
to fractional delays (`numerics.sampled.damping_needed`), is hardest at low frequency, which gives `passive_limit`. An
environment with an undamped mode is passive at no stiffness: at its resonance the delay turns the force against every
damping.

Encoder and Coulomb friction (Abbott & Okamura, IEEE Trans. Robotics 21(5), 2005, 952): with a step D every force is a
multiple of K·D; a handle pushed by a force between two multiples rests only if friction bridges K·D/2, K ≤ 2·fc/D.
Above, it moves to and fro over the edge of a count for ever. The verdicts are the regions of Diolaiti et al. (2006,
doi:10.1109/TRO.2005.862487) in the plane β = b/(K·T), σ = fc/(K·D), with the exact linear limit in place of theirs:

| verdict     | linear limit (β)   | friction (σ)  |
|-------------|--------------------|---------------|
| unstable    | K above `stable`   | any (their "locally stable", a small motion that sticks, is counted as unstable) |
| limit-cycle | K up to `stable`   | K > 2·fc/D    |
| stable      | K up to `stable`   | K ≤ 2·fc/D or D = 0 |
| passive     | K up to `passive`  | K ≤ 2·fc/D or D = 0 |
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import Enum

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix, StateSpace
from haptic_fieldbus.numerics.sampled import SampledPlant
from haptic_fieldbus.numerics.sampled import environment as environment

EnvironmentOf = Callable[[float], StateSpace]
"""Stiffness → the discrete environment x_k → F_k."""

SCAN_START = 1e-9
"""Of m/T² + b/T: the smallest stiffness looked at."""
SCAN_FACTOR = math.sqrt(2.0)
ROUNDING = 1e-11
"""A spectral radius this little above 1 may be the rounding of 1."""


class Verdict(Enum):
    """What a loop does; the value is the name on the command line."""

    PASSIVE = "passive"
    STABLE = "stable"
    LIMIT_CYCLE = "limit-cycle"
    UNSTABLE = "unstable"


@dataclass(frozen=True)
class Plant:
    """The device in the workspace of its axis: kg, N·s/m, N, m — or kg·m², N·m·s/rad, N·m, rad."""

    mass: float
    damping: float
    coulomb: float = 0.0
    resolution: float = 0.0
    """One encoder count."""
    torque_lag: float = 0.0
    """Time constant of the torque loop [s]."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 <= value < math.inf:
                raise UsageError(f"{name} {value}: expected a number from 0 up")
        if not (self.mass or self.damping):
            raise UsageError("a device without mass needs damping")


@dataclass(frozen=True)
class StiffnessLimit:
    """Virtual stiffness [N/m or N·m/rad] at which the loop stops being so, all else kept; None: does not apply."""

    passive: float | None
    stable: float | None
    quantisation: float | None


@dataclass(frozen=True)
class Stability:
    """The judgement of one axis; the fields are the keys of `--json`."""

    period_s: float
    delay_s: float
    """From sampling to acting; the torque loop's lag is in the plant, the hold's T/2 in neither."""
    plant: Plant
    stiffness: float | None
    damping: float
    stiffness_limit: StiffnessLimit
    spectral_radius: float
    margin: float | None
    """Limit of stability over stiffness."""
    verdict: Verdict

    def to_json(self) -> dict[str, object]:
        """The contract of the command line; what is not finite is null."""
        limits = {name: _finite(value) for name, value in asdict(self.stiffness_limit).items()}
        return {
            **asdict(self),
            "stiffness_limit": limits,
            "margin": _finite(self.margin),
            "verdict": self.verdict.value,
        }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def sample(plant: Plant, period: float, delay: float) -> SampledPlant:
    """The device under the delayed hold; its states are position, velocity (with a mass), motor force (with a lag)."""
    if plant.mass:
        a = np.array([[0.0, 1.0], [0.0, -plant.damping / plant.mass]])
        b = np.array([[0.0], [1.0 / plant.mass]])
    else:
        a, b = np.zeros((1, 1)), np.array([[1.0 / plant.damping]])
    if plant.torque_lag:
        order, rate = len(a), 1.0 / plant.torque_lag
        a = np.block([[a, b], [np.zeros((1, order)), np.full((1, 1), -rate)]])
        b = np.vstack([np.zeros((order, 1)), np.full((1, 1), rate)])
    return sampled.sample(a, b, period, delay)


def loop_matrix(plant: Plant, period: float, delay: float, environment: StateSpace) -> Matrix:
    """One period of the closed loop: states of the plant, of the environment, and forces on their way."""
    return sampled.loop_matrix(sample(plant, period, delay), environment)


def stiffness_limit(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf) -> float:
    """The stiffness [N/m or N·m/rad] below which every loop is stable; 0 when the smallest already is not, or ∞.

    Relative accuracy about 1e-9 for b·T/m above 1e-4, less for lighter damping (1e-6 at 1e-6).
    """
    device = sample(plant, period, delay)

    def excess(stiffness: float) -> float:
        return sampled.growth(device, environment_of(stiffness)) - 1.0

    scale = plant.mass / period**2 + plant.damping / period
    low, high = 0.0, SCAN_START * scale
    while excess(high) <= ROUNDING:
        low, high = high, high * SCAN_FACTOR
        if high > scale / SCAN_START:
            return math.inf
    while low and high - low > 1e-10 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) <= 0.0 else (low, middle)
    return low


def passive_limit(plant: Plant, period: float, delay: float, damping: float = 0.0) -> float:
    """The stiffness [N/m or N·m/rad] up to which a spring with a backward-difference damper is passive; 0 for none.

    K = 2·(b − |B|)/(g + √(g² + δ·(T − δ))), g = T/2 + td: exact for B = 0 or td = 0, else on the safe side. The torque
    loop's lag counts as a pure delay, which turns the phase more than the lag does.
    """
    delay += plant.torque_lag
    fraction = sampled.split_delay(delay, period)[1]
    centre = 0.5 * period + delay
    spare = max(0.0, plant.damping - abs(damping))
    return 2.0 * spare / (centre + math.sqrt(centre**2 + fraction * (period - fraction)))


def quantisation_limit(plant: Plant) -> float | None:
    """2·fc/D: the stiffness up to which friction holds the handle between two counts; None without quantisation."""
    return 2.0 * plant.coulomb / plant.resolution if plant.resolution else None


def passive_limit_of(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf, stable: float) -> float:
    """The stiffness up to which any environment is passive; `stable` bounds it."""
    environment = environment_of(1.0)
    if not environment.a.any():
        damping = float((environment.c @ environment.b)[0, 0]) * period
        return passive_limit(plant, period, delay, damping)

    def passive(stiffness: float) -> bool:
        environment = environment_of(stiffness)
        if sampled.spectral_radius(environment.a) > 1.0 - 1e-9:
            return False
        return sampled.damping_needed(environment, period, delay + plant.torque_lag) <= plant.damping

    low, high = 0.0, stable
    while high - low > 1e-6 * high and high > 1e-6 * stable:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passive(middle) else (low, middle)
    return low


def judge(
    plant: Plant,
    period: float,
    delay: float,
    environment_of: EnvironmentOf,
    stiffness: float | None,
    damping: float = 0.0,
) -> Stability:
    """Limits and verdict of one axis; `stiffness` None: there is none to vary, and `environment_of` is given 0."""
    asked, device = environment_of(stiffness or 0.0), sample(plant, period, delay)
    growth = sampled.growth(device, asked)
    if stiffness is None:
        limit = StiffnessLimit(None, None, None)
        is_stable = growth <= 1.0 + ROUNDING
        needed = sampled.damping_needed(asked, period, delay + plant.torque_lag)
        is_passive, is_bridged = needed <= plant.damping * (1.0 + ROUNDING), True
    else:
        stable = stiffness_limit(plant, period, delay, environment_of)
        passive = passive_limit_of(plant, period, delay, environment_of, stable)
        quantisation = quantisation_limit(plant)
        limit = StiffnessLimit(passive, stable, quantisation)
        is_stable = stiffness <= stable or growth < 1.0 - ROUNDING
        is_passive, is_bridged = stiffness <= passive, quantisation is None or stiffness <= quantisation
    return Stability(
        period_s=period,
        delay_s=delay,
        plant=plant,
        stiffness=stiffness,
        damping=damping,
        stiffness_limit=limit,
        spectral_radius=sampled.spectral_radius(sampled.loop_matrix(device, asked)),
        margin=limit.stable / stiffness if stiffness and limit.stable is not None else None,
        verdict=_verdict(is_stable, is_bridged, is_passive),
    )


def _verdict(is_stable: bool, is_bridged: bool, is_passive: bool) -> Verdict:
    if not is_stable:
        return Verdict.UNSTABLE
    if not is_bridged:
        return Verdict.LIMIT_CYCLE
    return Verdict.PASSIVE if is_passive else Verdict.STABLE


@dataclass(frozen=True)
class Suggestion:
    """What would be stable instead; None where nothing sensible is."""

    stiffness: float | None
    """With the damping kept."""
    damping: float | None
    """With the stiffness kept."""
    damping_limit: float | None
    """The limit of stability with that damping."""


def suggest(
    plant: Plant,
    period: float,
    delay: float,
    environment_of: Callable[[float, float], StateSpace],
    stiffness: float,
    damping: float | None,
) -> Suggestion:
    """Round values that make an unstable scene stable; `damping` None: the scene has none to vary.

    `environment_of` takes (stiffness, damping). The stiffness is 0.7 of its limit, the damping the smallest whose limit
    is 1.2 of the stiffness asked for.
    """

    def limit_with(value: float) -> float:
        return stiffness_limit(plant, period, delay, lambda stiffness: environment_of(stiffness, value))

    device = sample(plant, period, delay)
    limit = limit_with(damping or 0.0)
    softer = _two_digits(0.7 * limit) if 0.0 < limit < math.inf else None
    for candidate in _round_values(plant.mass / period) if damping is not None else ():
        if (
            candidate > (damping or 0.0)
            and sampled.growth(device, environment_of(1.2 * stiffness, candidate)) <= 1.0
            and (limit := limit_with(candidate)) >= 1.2 * stiffness
        ):
            return Suggestion(softer, candidate, limit)
    return Suggestion(softer, None, None)


def _two_digits(value: float) -> float:
    """Rounded down, never up: it is a promise."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.2g}")


def _round_values(largest: float) -> list[float]:
    """Four decades of values with one or two digits, up to `largest`."""
    top = math.floor(math.log10(largest)) if largest else 0
    values = [float(f"{digit}e{decade}") for decade in range(top - 4, top + 1) for digit in (1, 1.5, 2, 3, 4, 5, 7)]
    return [value for value in values if value <= largest]
