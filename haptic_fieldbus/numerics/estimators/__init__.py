"""Velocity from sampled position: estimators by name, each family in a module that is imported when it is named.

An estimator is written NAME or NAME:key=value,key=value, such as `least-squares:window=8,order=2`. `bind` gives the
step that the loop runs, `discrete` the linear system that it is, or None for those that are none (they choose between
several); `linear_form` is what stability is judged by then: the one of these with the most delay, where there is one.

The estimator matters: in one published data set it was worth a factor two of stiffness. Less noise costs delay, and
delay costs stiffness; `figures` gives both.
"""

import math
from dataclasses import dataclass
from importlib import import_module

from haptic_fieldbus.documents import nearest
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter, ParameterValue
from haptic_fieldbus.numerics.linear import StateSpace

__all__ = [
    "ESTIMATORS",
    "Chosen",
    "Estimate",
    "Estimator",
    "bind",
    "chosen",
    "discrete",
    "estimator_named",
    "is_timed",
    "linear_form",
    "linear_stand_in",
]

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
"""Name → module of its family."""


@dataclass(frozen=True)
class ChosenEstimator:
    """An estimator and the parameters that were given with its name."""

    estimator: Estimator
    given: dict[str, ParameterValue]

    def setup(self, period: float, resolution: float = 0.0) -> EstimatorSetup:
        """All parameters, checked; raises UsageError when they do not go with the period."""
        if not 0.0 < period < math.inf:
            raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
        defaults = {
            parameter.key: resolution if parameter.default is None else parameter.default
            for parameter in self.estimator.parameters
        }
        setup = EstimatorSetup(period, resolution, defaults | self.given)
        self.estimator.check(setup)
        return setup


def estimator_named(name: str) -> Estimator:
    """The estimator without parameters; raises UsageError when there is none of that name."""
    if name not in ESTIMATORS:
        raise UsageError(_unknown(f'no estimator "{name}"', name, list(ESTIMATORS)))
    module = import_module(f"{__name__}.{ESTIMATORS[name]}")
    found: Estimator = next(estimator for estimator in module.ESTIMATORS if estimator.name == name)
    return found


def chosen(spec: str) -> ChosenEstimator:
    """NAME[:key=value,…]; raises UsageError that names what is wrong, and the limits."""
    name, _, written = spec.partition(":")
    estimator = estimator_named(name.strip())
    known = {parameter.key: parameter for parameter in estimator.parameters}
    given: dict[str, ParameterValue] = {}
    for part in filter(None, map(str.strip, written.split(","))):
        key, equals, text = map(str.strip, part.partition("="))
        if not equals or key not in known:
            raise UsageError(_unknown(f'{name}: no parameter "{key}"', key, list(known)))
        if key in given:
            raise UsageError(f"{name}: {key} stands twice")
        given[key] = _parsed(name, known[key], text)
    return ChosenEstimator(estimator, given)


def _parsed(name: str, parameter: Parameter, text: str) -> ParameterValue:
    try:
        return parameter.parsed(text)
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None


def _unknown(sentence: str, name: str, known: list[str]) -> str:
    near = nearest(name, known)
    return f"{sentence}; {f'nearest: {near[0]}; ' if near else ''}there are: {', '.join(known) or 'none'}"


def bind(spec: str, period: float, resolution: float = 0.0) -> Estimate:
    """A fresh step of an estimator; its first call returns 0. `resolution` is one encoder count [m or rad]."""
    choice = chosen(spec)
    return choice.estimator.start(choice.setup(period, resolution))


def discrete(spec: str, period: float) -> StateSpace | None:
    """The estimator as a linear system x_k → v_k; None where it is none."""
    choice = chosen(spec)
    setup = choice.setup(period)
    return None if choice.estimator.system is None else choice.estimator.system(setup)


def is_timed(spec: str) -> bool:
    """Whether the step of an estimator takes the time of the sample [ns] beside the position."""
    return chosen(spec).estimator.timed


def linear_stand_in(spec: str) -> str | None:
    """The estimator that stability is judged with in the place of this one; None where it is linear itself."""
    choice = chosen(spec)
    return None if choice.estimator.system is not None else choice.estimator.stand_in(choice.setup(1.0))


def linear_form(spec: str, period: float) -> StateSpace:
    """The linear system that stability is judged by: the estimator's, or that of `linear_stand_in`."""
    system = discrete(linear_stand_in(spec) or spec, period)
    if system is None:
        raise TypeError(f"{spec} is judged as an estimator that is not linear either")
    return system
