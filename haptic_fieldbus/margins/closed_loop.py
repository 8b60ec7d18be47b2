"""A sampled loop as its margins ask it: one axis, or several that couplings tie together.

Limits and verdicts are the same questions of both (`ClosedLoop`, `verdict`, `suggestion`); what answers differs. One
axis has closed forms, six times as fast as the matrices of several (ADR 0013). Those are in `coupled`; `group` chooses.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from haptic_fieldbus.margins.linear import EnvironmentOf, limit_of
from haptic_fieldbus.margins.passivity import passive_limit_of
from haptic_fieldbus.margins.plant import Plant, check_times, quantisation_limit, sample
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix, StateSpace
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.numerics.sampled import SampledPlant


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the axes of a loop."""

    plant: Plant
    delay: float
    """From sampling to acting [s]."""
    environment: StateSpace | None = None
    """x_k → F_k of the elements of its own that stay as they are while a coupling is varied; None: it has none."""


@dataclass(frozen=True, eq=False)
class ClosedLoop(ABC):
    """Axes under their delayed holds, closed over (x_1 … x_n)_k → (F_1 … F_n)_k; `period` in s.

    Raises UsageError for times that no loop has.
    """

    axes: Sequence[Axis]
    period: float

    def __post_init__(self) -> None:
        for axis in self.axes:
            check_times(self.period, axis.delay)

    @cached_property
    def devices(self) -> list[SampledPlant]:
        return [sample(axis.plant, self.period, axis.delay) for axis in self.axes]

    @abstractmethod
    def matrix(self, environment: StateSpace) -> Matrix:
        """One period of the closed loop."""

    @abstractmethod
    def growth(self, environment: StateSpace) -> float:
        """Largest modulus of the loop's eigenvalues, free shifts of the handles left out; below 1 is stable."""

    @abstractmethod
    def damping_share(self, environment: StateSpace) -> float:
        """The share of the devices' dampings that any passive hands need: passive up to 1; ∞ where none is enough."""

    @abstractmethod
    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        """The stiffness [N/m or N·m/rad] up to which any passive hands are safe; `stable` bounds it."""

    @abstractmethod
    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """The force at each handle while the others are held, per stiffness and way."""

    def limit(self, environment_of: EnvironmentOf) -> float:
        """The stiffness [N/m or N·m/rad] up to which the loop is stable; 0 when the smallest already is not, or ∞."""
        return limit_of(lambda stiffness: self.growth(environment_of(stiffness)), self.scale(environment_of))

    def quantisation_limit(self, environment_of: EnvironmentOf) -> float | None:
        """The stiffness up to which friction holds each handle between two counts; None without quantisation."""
        limits = [
            limit / felt
            for axis, felt in zip(self.axes, self.felt(environment_of), strict=True)
            if (limit := quantisation_limit(axis.plant)) is not None and felt
        ]
        return min(limits, default=None)

    def scale(self, environment_of: EnvironmentOf) -> float:
        """The smallest m/T² + b/T as the stiffness meets it."""
        return self._least(environment_of, lambda plant: plant.mass / self.period**2 + plant.damping / self.period)

    def largest_damping(self, environment_of: EnvironmentOf) -> float:
        """The smallest m/T so met, about which virtual damping moves a device by as much in a period as it moved."""
        return self._least(environment_of, lambda plant: plant.mass / self.period)

    def _least(self, environment_of: EnvironmentOf, value: Callable[[Plant], float]) -> float:
        felt = self.felt(environment_of)
        return min(value(axis.plant) / (share or 1.0) for axis, share in zip(self.axes, felt, strict=True))


class OneAxis(ClosedLoop):
    """A single axis, by the closed forms of `sampled` and `passivity`."""

    def matrix(self, environment: StateSpace) -> Matrix:
        return sampled.loop_matrix(self.devices[0], environment)

    def growth(self, environment: StateSpace) -> float:
        return sampled.growth(self.devices[0], environment)

    def damping_share(self, environment: StateSpace) -> float:
        """With a tachometer any force at all asks for infinitely much.

        A reading says nothing of the motion between two: a hand that is fast only at the instants of the readings sets
        the force as it likes, at a cost of b·∫v² that goes to 0 as these instants get shorter, and lets the force work
        on it in between.
        """
        (axis,) = self.axes
        if axis.plant.tachometer:
            return math.inf if environment.c.any() or environment.d.any() else 0.0
        needed = damping_needed(environment, self.period, axis.delay, axis.plant.torque_lag)
        if not axis.plant.damping:
            return math.inf if needed else 0.0
        return needed / axis.plant.damping

    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        (axis,) = self.axes
        return passive_limit_of(axis.plant, self.period, axis.delay, environment_of, stable)

    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """All of it, whatever follows behind a virtual mass: a count is felt before anything has moved."""
        return [1.0]


def alone(plant: Plant, period: float, delay: float) -> ClosedLoop:
    """The loop of a single axis [s]."""
    return OneAxis((Axis(plant, delay),), period)


def stiffness_limit(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf) -> float:
    """The limit of stability of a single axis [N/m or N·m/rad]; 0 or ∞ as for any loop."""
    return alone(plant, period, delay).limit(environment_of)
