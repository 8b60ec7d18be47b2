"""Limits of a sampled haptic loop before anything moves: numbers in, limits and a verdict out.

The loop. A device of mass m and viscous damping b moves freely (no hand: a hand's damping hides instability that
appears on release). Its position is sampled every T, and the environment's force is held from td after the sample
until td after the next. `numerics.sampled` discretises this exactly, fractional delay and torque loop included, and
the eigenvalues of one period decide. A loop whose environment never opposes a slow shift (a sprung mass, a damper) has
an eigenvalue of exactly 1, the handle staying where it is left: that is no instability and is left out.

Passivity is asked of the same loop with *any* passive hand: the condition of Colgate & Schenkel, extended to fractional
delays and to the torque loop (`numerics.passivity`).

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
from dataclasses import asdict, dataclass
from enum import Enum

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.linear import ROUNDING, EnvironmentOf
from haptic_fieldbus.margins.plant import Plant
from haptic_fieldbus.numerals import exactly, rounded_limit
from haptic_fieldbus.numerics import sampled


class Verdict(Enum):
    """What a loop does; the value is the name on the command line."""

    PASSIVE = "passive"
    STABLE = "stable"
    LIMIT_CYCLE = "limit-cycle"
    UNSTABLE = "unstable"


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

    @property
    def recommended(self) -> float | None:
        """The stiffness up to which the margin is two, and the handle rests between counts where friction lets it.

        That of passivity where any stiffness is stable.
        """
        limit = self.stiffness_limit
        half = limit.passive if limit.stable is None or math.isinf(limit.stable) else 0.5 * limit.stable
        found = min((value for value in (half, limit.quantisation) if value), default=math.inf)
        return found if math.isfinite(found) else None

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


def judge(
    loop: ClosedLoop, environment_of: EnvironmentOf, stiffness: float | None, damping: float = 0.0
) -> tuple[Stability, ...]:
    """Limits and verdict of a loop, told for each of its axes with its plant and delay.

    `stiffness` None: there is none to vary, and `environment_of` is given 0. Raises UsageError for a stiffness that is
    none, naming the limit.
    """
    stable = None if stiffness is None else loop.limit(environment_of)
    if stiffness is not None and not 0.0 <= stiffness < math.inf:
        known = "" if stable is None else f"; this loop is stable to {rounded_limit(stable)}"
        raise UsageError(f"stiffness {exactly(stiffness)}: expected a number from 0 up{known}")
    asked = environment_of(stiffness or 0.0)
    growth = loop.growth(asked)
    if stiffness is None or stable is None:
        limit = StiffnessLimit(None, None, None)
        is_stable, is_bridged = growth <= 1.0 + ROUNDING, True
        is_passive = loop.damping_share(asked) <= 1.0 + ROUNDING
    else:
        passive, quantisation = loop.passive_limit(environment_of, stable), loop.quantisation_limit(environment_of)
        limit = StiffnessLimit(passive, stable, quantisation)
        is_stable = stiffness <= stable or growth < 1.0 - ROUNDING
        is_passive, is_bridged = stiffness <= passive, quantisation is None or stiffness <= quantisation
    radius = sampled.spectral_radius(loop.matrix(asked))
    margin = stable / stiffness if stiffness and stable is not None else None
    verdict = verdict_of(is_stable, is_bridged, is_passive)
    return tuple(
        Stability(loop.period, axis.delay, axis.plant, stiffness, damping, limit, radius, margin, verdict)
        for axis in loop.axes
    )


def verdict_of(is_stable: bool, is_bridged: bool, is_passive: bool) -> Verdict:
    """The table of this module."""
    if not is_stable:
        return Verdict.UNSTABLE
    if not is_bridged:
        return Verdict.LIMIT_CYCLE
    return Verdict.PASSIVE if is_passive else Verdict.STABLE
