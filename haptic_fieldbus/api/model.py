"""The virtual environment of a scene as a linear system: matrices, poles and transfer functions.

In continuous time it is ż = A z + B u, F = C z + D u, with the virtual states z, the inputs u = (x, v), position and
velocity of the handle, and the force F on it. An element that is not linear stands as in sustained contact, where it is
stiffest; couplings are felt with the other axis held. The discrete system x[n] → F[n] is the one that the loop runs and
that stability is judged with: virtual states by the method, memories of elements by their own exact step, velocity by
the estimator.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.api.open_loop import rendered_axis
from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR, DEFAULT_METHOD
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins.closed_loop import environment_of
from haptic_fieldbus.numerics.integrators import METHODS, discrete
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, parallel
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.numerics.transfer import TransferFunction, transfer_function
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.scenes.element import DynamicElement
from haptic_fieldbus.scenes.own_faults import own_faults

Poles = NDArray[np.complex128]

INPUTS = ("position", "velocity")
"""Inputs of the continuous system, in their order; the discrete system has the first alone."""


def poles_of(a: Matrix) -> Poles:
    """Return the eigenvalues of a square matrix (n, n), sorted by their real and then their imaginary part."""
    return np.sort_complex(np.linalg.eigvals(a)).astype(np.complex128)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A system of a scene with the names of its inputs."""

    space: StateSpace
    inputs: tuple[str, ...]

    @property
    def poles(self) -> Poles:
        return poles_of(self.space.a)

    @property
    def transfer_functions(self) -> dict[str, TransferFunction]:
        """Force by position, and by velocity where it has an effect."""
        used = self.inputs if len(self.inputs) > 1 and self.space.uses_velocity else self.inputs[:1]
        return {name: transfer_function(self.space, place) for place, name in enumerate(used)}

    def to_json(self) -> dict[str, object]:
        """Return matrices, poles as [real, imaginary], and transfer functions, the highest power first."""
        matrices = {name: getattr(self.space, name).tolist() for name in ("a", "b", "c", "d")}
        poles, functions = [[pole.real, pole.imag] for pole in self.poles.tolist()], self.transfer_functions.items()
        transfer = [{"input": name, "num": list(each.num), "den": list(each.den)} for name, each in functions]
        return {**matrices, "poles": poles, "transfer": transfer}


@dataclass(frozen=True, eq=False)
class EnvironmentModel:
    """The environment of a scene's first axis, continuous and as the loop runs it."""

    axis: str
    period: float
    """[s]"""
    method: str
    estimator: str
    continuous: LinearModel
    discrete: LinearModel
    integrated: StateSpace
    """The virtual states that a method integrates, in continuous time."""

    @property
    def growth(self) -> dict[str, float | None]:
        """By method the factor by which a free motion of the virtual states grows in a step; None without a step."""
        return {method: step_growth(self.integrated, self.period, method) for method in METHODS}

    def to_json(self) -> Mapping[str, object]:
        """Return the object `model` of `response --model --json`."""
        return {
            "axis": self.axis,
            "period_s": self.period,
            "method": self.method,
            "estimator": self.estimator,
            "continuous": self.continuous.to_json(),
            "discrete": self.discrete.to_json(),
            "growth": self.growth if self.integrated.order else {},
        }


@own_faults()
def model_of(task: Task) -> EnvironmentModel:
    """Return the model of the scene's first axis; raises DocumentError or UsageError."""
    period, axis, elements = rendered_axis(task)
    method, estimator = task.method or DEFAULT_METHOD, task.estimator or DEFAULT_ESTIMATOR
    continuous = LinearModel(parallel([element.linearised() for element in elements]), INPUTS)
    sampled = LinearModel(environment_of(elements, period, method, estimator), INPUTS[:1])
    dynamics = [element.dynamics for element in elements if isinstance(element, DynamicElement)]
    integrated = parallel(dynamics) if dynamics else StateSpace(*(np.zeros((0, 0)) for _ in range(4)))
    return EnvironmentModel(axis.name, period, method, estimator, continuous, sampled, integrated)


def step_growth(space: StateSpace, period: float, method: str) -> float | None:
    """Return the spectral radius of a step [s] of a method; None when its equation has no solution."""
    try:
        return spectral_radius(discrete(space, period, method).a)
    except UsageError:
        return None


def poles_along(space: StateSpace, periods: Matrix, method: str) -> Iterator[Poles]:
    """Yield the poles (n,) of a step of a method for each of the periods [s]; without those that have no solution."""
    for period in periods.tolist():
        with suppress(UsageError):
            yield poles_of(discrete(space, period, method).a)
