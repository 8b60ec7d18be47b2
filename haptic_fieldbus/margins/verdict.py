"""Limits and verdict of a sampled haptic loop, before anything moves.

Stability. A device of mass m and viscous damping b moves freely, without a hand, because the damping of a hand hides an
instability that appears on release. Its position is sampled every T. The environment's force is held from td after the
sample until td after the next sample. `numerics.sampled` discretises this exactly, with fractional delay and torque
loop, and the eigenvalues of one period decide. A loop whose environment never opposes a slow shift (a sprung mass, a
damper) has an eigenvalue of exactly 1: the handle stays where it is left. This is no instability and is left out.

Passivity is required of the same loop with *any* passive hand, by the condition of Colgate & Schenkel, extended to
fractional delays and to the torque loop (`numerics.passivity`).

Encoder and Coulomb friction (Abbott & Okamura, IEEE Trans. Robotics 21(5), 2005, 952). With a step D every force is a
multiple of K·D. A handle that is pushed by a force between two multiples rests only if friction bridges K·D/2, that is
up to K = 2·fc/D. Above this stiffness it oscillates over the edge of a count without end (limit cycle).

The verdicts are the regions of Diolaiti et al. (2006, doi:10.1109/TRO.2005.862487) in the plane β = b/(K·T),
σ = fc/(K·D), with the exact linear limit in place of theirs:

| verdict     | linear limit (β)   | friction (σ)  |
|-------------|--------------------|---------------|
| unstable    | K above `stable`   | any (their "locally stable", a small motion that sticks, is counted as unstable) |
| limit-cycle | K up to `stable`   | K > 2·fc/D    |
| stable      | K up to `stable`   | K ≤ 2·fc/D or D = 0 |
| passive     | K up to `passive`  | K ≤ 2·fc/D or D = 0 |

The table uses the nominal values of rig and profile. A loop above its limit over all open values (`limit`) is "stable"
at most, never "passive".
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from functools import cached_property

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.limit import Limit
from haptic_fieldbus.margins.linear import ROUNDING, EnvironmentOf
from haptic_fieldbus.margins.plant import Basis, Plant, quantisation_limit
from haptic_fieldbus.margins.stiffness_map import OwnLaw, Places, RestingPlace
from haptic_fieldbus.numerals import TYPED_DIGITS, exactly, rounded_down, rounded_limit
from haptic_fieldbus.numerics import sampled

AT_LIMIT = 1e-9
"""Excess of the growth over 1 at a limit, from the limited precision of its search."""


class Verdict(Enum):
    """Stability verdict of a loop; the value is the name on the command line."""

    PASSIVE = "passive"
    STABLE = "stable"
    LIMIT_CYCLE = "limit-cycle"
    UNSTABLE = "unstable"


@dataclass(frozen=True)
class StiffnessLimit:
    """Largest virtual stiffness [N/m or N·m/rad] for each property of the loop at its nominal values, with all other
    values unchanged; None: does not apply.

    `quantisation` is the limit up to which friction holds the handle between two encoder counts.
    """

    passive: float | None
    stable: float | None
    quantisation: float | None


@dataclass(frozen=True)
class Stability:
    """Stability of one axis; the fields are the keys of `--json`."""

    period_s: float
    delay_s: float
    """Time from sampling until the torque acts. It excludes the lag of the torque loop, which is in the plant, and the
    mean delay T/2 of the hold."""
    plant: Plant
    stiffness: float | None
    damping: float
    stiffness_limit: StiffnessLimit
    spectral_radius: float
    nominal: Verdict
    """Verdict on the loop with the values of rig and profile."""
    place: RestingPlace | None = None
    """Equilibrium with the largest growth per period; None for coupled axes."""
    crest: RestingPlace | None = None
    """Unstable equilibrium of the ideal scene with the largest growth; None when there is none."""
    effort: float = math.inf
    """Largest force of the motor [N or N·m]; equilibria up to this force were judged."""
    own_laws: tuple[OwnLaw, ...] = ()
    """Stability check of each element that states no bounds."""
    unit: str = ""
    """Unit of the stiffness."""
    find_limit: Callable[[], Limit] | None = field(default=None, repr=False, compare=False)
    """Function that computes the limit; it takes longer than all other values. None: all values are exact."""

    @cached_property
    def limit(self) -> Limit:
        """Limit over all open values, rounded down to the digits that people type."""
        found = self._exact if self.find_limit is None else self.find_limit()
        is_told = 0.0 < found.value < math.inf
        return replace(found, value=rounded_down(found.value, TYPED_DIGITS)) if is_told else found

    @property
    def _exact(self) -> Limit:
        """Limit of a loop whose values are all exact."""
        stable = self.stiffness_limit.stable
        if stable is None:
            stable = 0.0 if self.nominal is Verdict.UNSTABLE else math.inf
        return Limit(stable, Basis.STATED, self.stiffness_limit.quantisation)

    @property
    def margin(self) -> float | None:
        """Limit divided by the stiffness; None without a stiffness."""
        return self.limit.value / self.stiffness if self.stiffness else None

    @property
    def nominal_margin(self) -> float | None:
        """Limit of stability with the nominal values divided by the stiffness; None without a stiffness."""
        stable = self.stiffness_limit.stable
        return stable / self.stiffness if self.stiffness and stable is not None else None

    @property
    def is_inside(self) -> bool:
        """Whether the loop is stable for every open value."""
        asked = math.inf if self.stiffness is None else self.stiffness
        return self.nominal is not Verdict.UNSTABLE and asked <= self.limit.value

    @property
    def verdict(self) -> Verdict:
        """Verdict on the loop with the values of rig and profile; above the limit "stable" at most."""
        passive = self.nominal is Verdict.PASSIVE
        return Verdict.STABLE if passive and not self.is_inside else self.nominal

    def to_json(self) -> dict[str, object]:
        """Return the verdict as JSON values, with null for a limit or margin that is not finite."""
        has_limit = self.stiffness is not None and math.isfinite(self.limit.value)
        limit = {"value": self.limit.value, "unit": self.unit, "basis": self.limit.basis.value} if has_limit else None
        limits = asdict(self.stiffness_limit) | {"cautious": self.limit.value if has_limit else None}
        # The values at which the limit was found, one object for each axis; places at the values of rig and profile.
        values = [each.to_json() for each in self.limit.judged_at] or [{}]
        places = {"place": self.place and self.place.to_json(), "crest": self.crest and self.crest.to_json()}
        return {
            "period_s": self.period_s,
            "delay_s": self.delay_s,
            "plant": asdict(self.plant),
            "stiffness": self.stiffness,
            "damping": self.damping,
            "limit": limit,
            "stiffness_limit": {name: _finite(value) for name, value in limits.items()},
            "judged_at": [{**each, **places} for each in values],
            "spectral_radius": self.spectral_radius,
            "margin": _finite(self.margin),
            "verdict": self.verdict.value,
            "own_laws": [law.to_json() for law in self.own_laws],
        }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def judge(
    loop: ClosedLoop, environment_of: EnvironmentOf, stiffness: float | None, damping: float = 0.0
) -> tuple[Stability, ...]:
    """Judge a loop and return its limits and verdict for each axis, with the plant and delay of that axis.

    `stiffness` is None when the loop has no stiffness to vary; `environment_of` is then called with 0. Raises
    UsageError for a stiffness that is not a finite number from 0 up, with the limit in its message.
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
        # Above its first limit a loop may be stable again, so the growth at this stiffness counts too.
        is_stable = stiffness <= stable or growth < 1.0 - ROUNDING
        is_passive, is_bridged = stiffness <= passive, quantisation is None or stiffness <= quantisation
    radius = sampled.spectral_radius(loop.matrix(asked))
    place, crest = loop.judged_at(asked)
    if isinstance(asked, Places):  # stiffness and slope differ, and the bounds are exact at these values
        verdict = verdict_at_places(loop, asked, is_bridged=is_bridged or not asked.has_states)
    else:
        is_passive = is_passive and loop.rounding_is_bridged(asked)
        verdict = verdict_of(is_stable, is_bridged, is_passive)
    return tuple(
        Stability(loop.period, axis.delay, axis.plant, stiffness, damping, limit, radius, verdict, place, crest)
        for axis in loop.axes
    )


def verdict_at_places(loop: ClosedLoop, environment: Places, *, is_bridged: bool = True) -> Verdict:
    """Return the verdict of a single axis at the values that it has.

    `is_bridged` says whether friction holds the handle between two counts of the varied element alone.
    """
    (axis,) = loop.axes
    held = quantisation_limit(axis.plant)
    return verdict_of(
        loop.growth(environment) <= 1.0 + AT_LIMIT,
        is_bridged and (held is None or environment.felt <= held),
        loop.damping_share(environment) <= 1.0 + ROUNDING
        and environment.increments.rounding_is_bridged(axis.plant, loop.period),
    )


def verdict_of(is_stable: bool, is_bridged: bool, is_passive: bool) -> Verdict:
    """Return the verdict by the table of this module."""
    if not is_stable:
        return Verdict.UNSTABLE
    if not is_bridged:
        return Verdict.LIMIT_CYCLE
    return Verdict.PASSIVE if is_passive else Verdict.STABLE
