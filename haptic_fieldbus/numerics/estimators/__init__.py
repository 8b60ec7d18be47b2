"""Velocity from sampled position: estimators by name, each family in a module that is imported when it is named.

An estimator is written NAME or NAME:key=value,key=value, such as `least-squares:window=8,order=2`. `bind` returns the
step that the loop runs. `discrete` returns the linear system of the estimator, or None for an estimator that is not
linear. `linear_form` returns the system by which stability is judged. An estimator that chooses between several linear
systems is judged by the one with the most delay, if there is one.

The choice matters: in one published data set the estimator changed the stable stiffness by a factor of two. Less noise
costs delay, and delay costs stiffness; docs/reference/estimators.md has both figures for each estimator.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import cast

from haptic_fieldbus.documents import nearest
from haptic_fieldbus.documents.own_parts import OwnName, entry_point_names, foreign_part
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, ParameterValue
from haptic_fieldbus.numerics.linear import StateSpace

__all__ = [
    "ESTIMATORS", "ChosenEstimator", "Estimate", "Estimator", "bind", "chosen", "discrete", "estimator_named",
    "is_timed", "linear_form", "linear_stand_in", "most_acceleration",
]  # fmt: skip

ESTIMATORS = {
    "backward-difference": "differences",
    "moving-average": "differences",
    "low-pass": "differences",
    "filtered-derivative": "differences",
    "least-squares": "fits",
    "foaw-end-fit": "fits",
    "foaw-best-fit": "fits",
    "levant": "levant",
    "kalman-velocity": "kalman",
    "kalman-acceleration": "kalman",
    "tick-interval": "ticks",
}
"""Module of the family of each estimator, by name."""
GROUP = "haptic_fieldbus.estimators"
"""Entry points of other packages; each names an `Estimator`."""
KEPT = 64
"""Number of linear forms that are kept, by name and period."""


@dataclass(frozen=True)
class ChosenEstimator:
    """An estimator with the parameters that were written after its name."""

    estimator: Estimator
    given: dict[str, ParameterValue]

    def setup(self, period: float, resolution: float = 0.0) -> EstimatorSetup:
        """Return all parameters, defaults included; `resolution` is one encoder count [m or rad].

        Raises UsageError for a period [s] that is not above 0, and for parameters that do not fit it or each other.
        """
        if not 0.0 < period < math.inf:
            raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
        known = self.estimator.parameters
        defaults = {each.key: resolution if each.default is None else each.default for each in known}
        setup = EstimatorSetup(period, resolution, defaults | self.given)
        self.estimator.check(setup)
        return setup


def estimator_named(name: str) -> Estimator:
    """Return the estimator of this name, without parameters; raises UsageError for an unknown name."""
    if name not in ESTIMATORS:
        own = foreign_part(GROUP, "estimator", name, Estimator, ESTIMATORS)
        if own is None:
            raise UsageError(_unknown(f'no estimator "{name}"', name, [*ESTIMATORS, *entry_point_names(GROUP)]))
        return own
    module = import_module(f"{__name__}.{ESTIMATORS[name]}")
    return cast(Estimator, next(estimator for estimator in module.ESTIMATORS if estimator.name == name))


def chosen(spec: str) -> ChosenEstimator:
    """Parse NAME[:key=value,…]; raises UsageError for an unknown name or key, a repeated key, a bad value."""
    if isinstance(spec, OwnName):
        return ChosenEstimator(estimator_named(spec), {})
    name, _, written = spec.partition(":")
    estimator = estimator_named(name.strip())
    known = {parameter.key: parameter for parameter in estimator.parameters}
    given: dict[str, ParameterValue] = {}
    for part in filter(None, map(str.strip, written.split(","))):
        key, equals, text = map(str.strip, part.partition("="))
        if not equals or key not in known:
            raise UsageError(_unknown(f'{name}: no parameter "{key}"', key, list(known)))
        if key in given:
            raise UsageError(f"{name}: {key} is set twice")
        try:
            given[key] = known[key].parsed(text)
        except UsageError as error:
            raise UsageError(f"{name}: {error}") from None
    return ChosenEstimator(estimator, given)


def _unknown(sentence: str, name: str, known: list[str]) -> str:
    near = nearest(name, known)
    return f"{sentence}; {f'nearest: {near[0]}; ' if near else ''}there are: {', '.join(known) or 'none'}"


def bind(spec: str, period: float, resolution: float = 0.0) -> Estimate:
    """Return a fresh step of an estimator; its first call returns 0. `resolution` is one encoder count [m or rad].

    Raises UsageError as `chosen` and `ChosenEstimator.setup`.
    """
    choice = chosen(spec)
    return choice.estimator.start(choice.setup(period, resolution))


def discrete(spec: str, period: float) -> StateSpace | None:
    """Return the estimator as a linear system x_k → v_k; None when it is not linear. Raises UsageError as `bind`."""
    choice = chosen(spec)
    return None if choice.estimator.system is None else choice.estimator.system(choice.setup(period))


def is_timed(spec: str) -> bool:
    """Return True when the step of an estimator takes the time of the sample [ns] beside the position."""
    return chosen(spec).estimator.timed


def linear_stand_in(spec: str) -> str | None:
    """Return the linear estimator with which stability is judged in place of this one; None when this one is linear."""
    choice = chosen(spec)
    # No stand-in depends on the period, so any period serves.
    return None if choice.estimator.system is not None else choice.estimator.stand_in(choice.setup(1.0))


def most_acceleration(spec: str) -> float:
    """Return the largest acceleration that the velocity of an estimator follows [m/s² or rad/s²]."""
    choice = chosen(spec)
    # A linear one follows any; no other depends on the period here, so any period serves.
    return math.inf if choice.estimator.system is not None else choice.estimator.follows(choice.setup(1.0))


@lru_cache(maxsize=KEPT)
def linear_form(spec: str, period: float) -> StateSpace:
    """Return the linear system with which stability is judged: that of the estimator or of its `linear_stand_in`.

    Raises UsageError as `bind`, and TypeError when the stand-in of an estimator is not linear either.
    """
    system = discrete(linear_stand_in(spec) or spec, period)
    if system is None:
        raise TypeError(f"{spec}: its replacement for the stability check is not linear either")
    return system
