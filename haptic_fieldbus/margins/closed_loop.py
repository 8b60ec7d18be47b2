"""A sampled loop for limits and verdicts: one axis, or several axes that couplings tie together.

Both have the same methods for limits, verdicts and suggestions (`ClosedLoop`), but different computations. A single
axis has closed forms, which are several times faster than the matrices of several axes (ADR 0013). The matrices are in
`coupled`; `group` chooses between both.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

from haptic_fieldbus.margins.linear import ROUNDING, EnvironmentOf, crossings, limit_of
from haptic_fieldbus.margins.passivity import LOSSLESS, passive_limit_of, searched
from haptic_fieldbus.margins.plant import Plant, check_times, quantisation_limit, sample
from haptic_fieldbus.margins.stiffness_map import Places, RestingPlace
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, gain, parallel
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.numerics.sampled import SampledPlant, discretised, estimated, scaled
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Element, abilities, is_dynamic

if TYPE_CHECKING:
    from haptic_fieldbus.margins.bodies import HungBody


USUAL = 1e-3
"""A stiffness of a usual size, as a share of m/T² + b/T."""

# The elements of an axis in sustained contact as one discrete environment, with one stiffness that varies.

Kind = TypeVar("Kind", bound=AnyElement)
Asked = ParamSpec("Asked")
Found = TypeVar("Found")


def keeping(most: int, function: Callable[Asked, Found]) -> Callable[Asked, Found]:
    """Return the function with its last `most` results kept."""
    known: Any = lru_cache(maxsize=most)(function)

    def call(*values: Asked.args, **named: Asked.kwargs) -> Found:
        try:
            return cast(Found, known(*values, **named))
        except TypeError:  # an element of one's own without a hash
            return function(*values, **named)

    return call


def stiffness_of(element: AnyElement) -> float:
    """Return the element's own stiffness [N/m or N·m/rad]; 0 when it has none."""
    return float(abilities(element).stiffness)


def stiffest_of(elements: Iterable[Kind]) -> Kind | None:
    """Return the element with the largest stiffness; None when no element has a stiffness."""
    return max(filter(stiffness_of, elements), key=stiffness_of, default=None)


def linearised(element: AnyElement, changes: Mapping[str, float]) -> StateSpace:
    """Return the linear model of the element in sustained contact, with the `changes` that name one of its parameters.

    If the stiffness follows from other parameters, a factor on the whole force changes it.
    """
    known = {name: value for name, value in changes.items() if hasattr(element, name)}
    if "stiffness" in known and abilities(element).with_stiffness:
        factor = known.pop("stiffness") / abilities(element).stiffness
        return scaled(linearised(element, known), factor)
    varied: AnyElement = replace(element, **known) if known else element  # type: ignore[type-var]  # a dataclass
    return varied.dynamics if is_dynamic(varied) else varied.linearised()  # the loop runs `dynamics`


def with_parameters(element: Kind, changes: Mapping[str, float]) -> Kind:
    """Return the element with the `changes` that name one of its parameters."""
    known = {name: value for name, value in changes.items() if hasattr(element, name)}
    varied: Any = element
    if "stiffness" in known and (graded := abilities(varied).with_stiffness):
        varied = graded(known.pop("stiffness"))
    kept: Kind = replace(varied, **known) if known else varied
    return kept


def damping_of(elements: Iterable[AnyElement]) -> float:
    """Return the virtual damping of all elements together [N·s/m or N·m·s/rad]."""
    return sum(float(getattr(element, "damping", 0.0)) for element in elements)


def environment_of(
    elements: tuple[Element, ...], period: float, method: str | None, estimator: str | None, **changes: float
) -> StateSpace:
    """Return the linearised elements as the loop runs them, x_k → F_k, with `changes` to the stiffest element.

    `method` applies to elements whose virtual states the loop integrates. An element with its own memory steps this
    memory exactly. Raises UsageError as `numerics.sampled.environment`.
    """
    stiffest = stiffest_of(elements)
    steps = []
    for element in elements:
        space = linearised(element, changes if element is stiffest else {})
        steps.append(discretised(space, period, method if isinstance(element, DynamicElement) else None))
    return estimated(parallel(steps) if steps else gain([[0.0, 0.0]]), period, estimator)


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a loop."""

    plant: Plant
    delay: float
    """Time from sampling to acting [s]."""
    environment: StateSpace | None = None
    """Environment x_k → F_k of the axis' own elements, kept while a coupling varies; None when it has none.

    `Places` are tried one by one. Any other system acts everywhere.
    """
    bodies: "tuple[HungBody, ...]" = ()
    """Masses behind a compliant transmission; the plant is then the motor alone."""

    @property
    def own_stiffness(self) -> float:
        """Largest stiffness of its own elements that a single count meets [N/m or N·m/rad]."""
        return self.environment.felt if isinstance(self.environment, Places) else 0.0

    def damping_needed(self, places: Places, period: float) -> float:
        """Return the device damping for passivity with any hand, at this delay and torque loop [N·s/m or N·m·s/rad]."""
        times = (period, self.delay, self.plant.torque_lag)
        needed = places.increments.damping_needed(*times)
        if places.swept is not None:
            # At the resonance of an undamped mode no damping is enough.
            is_lossless = sampled.spectral_radius(places.swept.a) > 1.0 - LOSSLESS
            needed += math.inf if is_lossless else damping_needed(places.swept, *times)
        return needed

    def sampled(self, period: float) -> SampledPlant:
        """Return the device as the loop samples it; `period` in s."""
        if self.bodies:
            from haptic_fieldbus.margins.bodies import sample_with  # a rigid axis does without it

            return sample_with(self.plant, self.bodies, period, self.delay)
        return sample(self.plant, period, self.delay)


@dataclass(frozen=True, eq=False)
class ClosedLoop(ABC):
    """Axes under their delayed holds, closed over (x_1 … x_n)_k → (F_1 … F_n)_k; `period` in s.

    Raises UsageError for a period that is not above 0, and for a negative delay.
    """

    axes: Sequence[Axis]
    period: float

    def __post_init__(self) -> None:
        for axis in self.axes:
            check_times(self.period, axis.delay)

    @cached_property
    def devices(self) -> list[SampledPlant]:
        return [axis.sampled(self.period) for axis in self.axes]

    @abstractmethod
    def matrix(self, environment: StateSpace) -> Matrix:
        """Return the square matrix of one period of the closed loop."""

    @abstractmethod
    def growth(self, environment: StateSpace) -> float:
        """Return the largest modulus of the eigenvalues, without free shifts of the handles; below 1 is stable."""

    def judged_at(self, environment: StateSpace) -> tuple[RestingPlace | None, RestingPlace | None]:
        """Return the equilibrium with the largest growth, and the one with the largest growth of the ideal scene.

        None for an equilibrium that is unknown or does not exist.
        """
        return None, None

    @abstractmethod
    def damping_share(self, environment: StateSpace) -> float:
        """Return the share of the devices' dampings that passive hands need: passive up to 1, ∞ if none is enough."""

    @abstractmethod
    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        """Return the stiffness [N/m or N·m/rad] up to which any passive hands are safe; `stable` bounds it."""

    @abstractmethod
    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """Return the force at each handle per stiffness and position while the others are held, for each axis."""

    def limit(self, environment_of: EnvironmentOf, **search: float) -> float:
        """Return the stiffness [N/m or N·m/rad] up to which the loop is stable; 0, ∞ and `search` as in `limit_of`."""
        scale, expected = self.scale(environment_of), self.crossings(environment_of)
        return limit_of(lambda stiffness: self.growth(environment_of(stiffness)), scale, expected=expected, **search)

    @abstractmethod
    def crossings(self, environment_of: EnvironmentOf) -> list[float] | None:
        """Return all stiffnesses at which an eigenvalue has the modulus 1; None if there is no closed form."""

    def _usual(self, environment_of: EnvironmentOf) -> tuple[float, list[StateSpace]]:
        """Return a stiffness of a usual size, and the environments at its first three multiples."""
        step = USUAL * self.scale(environment_of)
        return step, [environment_of(multiple * step) for multiple in (1.0, 2.0, 3.0)]

    def bears(self, environment: StateSpace) -> bool:
        """Return whether the loop is stable, up to rounding."""
        return self.growth(environment) <= 1.0 + ROUNDING

    def rounding_is_bridged(self, environment: StateSpace) -> bool:
        """Return whether friction absorbs what rounding gives; a single axis is judged by its places instead."""
        return True

    def quantisation_limit(self, environment_of: EnvironmentOf) -> float | None:
        """Return the stiffness up to which friction holds each handle between two counts; None without quantisation."""
        limits = [
            max(limit - axis.own_stiffness, 0.0) / felt
            for axis, felt in zip(self.axes, self.felt(environment_of), strict=True)
            if (limit := quantisation_limit(axis.plant)) is not None and felt
        ]
        return min(limits, default=None)

    def _passive_limit(self, environment_of: EnvironmentOf, stable: float, smallest: float, precision: float) -> float:
        """Return the largest stiffness up to which the dampings are enough; the arguments are those of `searched`."""
        scale = self.scale(environment_of)
        return searched(
            lambda stiffness: self.damping_share(environment_of(stiffness)) <= 1.0, scale, stable,
            smallest=smallest, precision=precision,
        )  # fmt: skip

    def scale(self, environment_of: EnvironmentOf) -> float:
        """Return the smallest m/T² + b/T of the devices [N/m or N·m/rad], referred to the varied stiffness."""
        return self._least(environment_of, lambda plant: plant.mass / self.period**2 + plant.damping / self.period)

    def largest_damping(self, environment_of: EnvironmentOf) -> float:
        """Return the smallest m/T of the devices [N·s/m or N·m·s/rad], referred to the varied stiffness.

        At about this virtual damping the force of a period moves a device by as much as it moved in the period before.
        """
        return self._least(environment_of, lambda plant: plant.mass / self.period)

    def _least(self, environment_of: EnvironmentOf, value: Callable[[Plant], float]) -> float:
        felt = self.felt(environment_of)
        # A handle at which the varied stiffness gives no force counts as it is, instead of dividing by 0.
        return min(value(axis.plant) / (share or 1.0) for axis, share in zip(self.axes, felt, strict=True))


class OneAxis(ClosedLoop):
    """A single axis, with the closed forms of `numerics.sampled` and `numerics.passivity`."""

    def matrix(self, environment: StateSpace) -> Matrix:
        """Return the matrix of one period, at the worst place of an environment that has several."""
        at = environment.worst(self.devices[0])[1] if isinstance(environment, Places) else environment
        return sampled.loop_matrix(self.devices[0], at)

    def growth(self, environment: StateSpace) -> float:
        if isinstance(environment, Places):
            return math.inf if environment.runs_off else environment.worst(self.devices[0])[0].growth
        return sampled.growth(self.devices[0], environment)

    def crossings(self, environment_of: EnvironmentOf) -> list[float] | None:
        step, environments = self._usual(environment_of)
        first, *others = environments
        if isinstance(first, Places):
            return first.crossings(others, step, self.devices[0])
        return crossings([sampled.loop_matrix(self.devices[0], each) for each in environments], step)

    def judged_at(self, environment: StateSpace) -> tuple[RestingPlace | None, RestingPlace | None]:
        (axis,) = self.axes
        if not isinstance(environment, Places):
            return None, None
        mass = axis.plant.mass + sum(body.mass for body in axis.bodies)
        crest = environment.crest(self.devices[0], mass, axis.plant.damping, self.period)
        return environment.worst(self.devices[0])[0], crest

    def damping_share(self, environment: StateSpace) -> float:
        """Return the needed damping divided by the device damping; ∞ if damping is needed and the device has none.

        With a tachometer the result is ∞, or 0 without a force: no damping is enough for a force. The readings do not
        show the motion between them. A hand that moves fast only at the instants of the readings can choose the force.
        The energy b·∫v² of these motions goes to 0 as they get shorter. Between the readings the force does work on the
        hand.
        """
        (axis,) = self.axes
        if axis.plant.tachometer:
            return math.inf if environment.c.any() or environment.d.any() else 0.0
        if isinstance(environment, Places):
            needed = axis.damping_needed(environment, self.period)
        else:
            needed = damping_needed(environment, self.period, axis.delay, axis.plant.torque_lag)
        if not axis.plant.damping:
            return math.inf if needed else 0.0
        return needed / axis.plant.damping

    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        (axis,) = self.axes
        if not stable:
            return 0.0
        if isinstance(environment_of(1.0), Places) and not axis.plant.tachometer:
            return self._passive_limit(environment_of, stable, smallest=1e-6, precision=1e-9)
        return passive_limit_of(axis.plant, self.period, axis.delay, environment_of, stable)

    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """Return [1.0]: a count changes the force by the full stiffness, even if a virtual mass follows later."""
        return [1.0]


def alone(plant: Plant, period: float, delay: float) -> ClosedLoop:
    """Return the loop of a single axis; `period` and `delay` in s. Raises UsageError for impossible times."""
    return OneAxis((Axis(plant, delay),), period)


def stiffness_limit(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf) -> float:
    """Return the limit of stability of a single axis [N/m or N·m/rad]; 0 and ∞ as in `limit_of`.

    Raises UsageError for impossible times [s].
    """
    return alone(plant, period, delay).limit(environment_of)
