"""Velocity from sampled position. One estimator is one entry of ESTIMATORS."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import StateSpace

Estimate = Callable[[float], float]
"""Position of this period [m or rad] → velocity [m/s or rad/s]; remembers the positions before."""

DEFAULT_ESTIMATOR = "backward-difference"


@dataclass(frozen=True)
class Estimator:
    """An estimator twice: as the step that the loop runs, and as the linear system that stability is judged by."""

    name: str
    start: Callable[[float], Estimate]
    """Period [s] → a fresh step."""
    system: Callable[[float], StateSpace]
    """Period [s] → s⁺ = A s + B x, v = C s + D x."""


def _start_backward_difference(period: float) -> Estimate:
    previous: float | None = None

    def step(position: float) -> float:
        nonlocal previous
        velocity = 0.0 if previous is None else (position - previous) / period
        previous = position
        return velocity

    return step


def _backward_difference(period: float) -> StateSpace:
    return StateSpace(
        a=np.array([[0.0]]), b=np.array([[1.0]]), c=np.array([[-1.0 / period]]), d=np.array([[1.0 / period]])
    )


ESTIMATORS = {
    estimator.name: estimator
    for estimator in (Estimator("backward-difference", _start_backward_difference, _backward_difference),)
}


def estimator_named(name: str) -> Estimator:
    """Raises UsageError when there is none of that name."""
    if name not in ESTIMATORS:
        raise UsageError(f'no estimator "{name}"; there are: {", ".join(ESTIMATORS)}')
    return ESTIMATORS[name]


def bind(name: str, period: float) -> Estimate:
    """A fresh step of the named estimator; its first call returns 0."""
    return estimator_named(name).start(period)


def discrete(name: str, period: float) -> StateSpace:
    """The named estimator as a linear system x_k → v_k."""
    return estimator_named(name).system(period)
