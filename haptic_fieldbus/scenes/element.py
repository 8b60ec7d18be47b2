"""What every element of a scene is.

An element states the signals that it needs and says what acts on the handle: positive accelerates towards positive
position. It is of one of four kinds:

| kind            | it has                  | example                                                               |
|-----------------|-------------------------|-----------------------------------------------------------------------|
| StaticElement   | `force`                 | a wall: the force depends on the present feedback alone               |
| MemoryElement   | `begin(period)`         | friction, a wave: steps a memory of its own, exactly                  |
| DynamicElement  | `dynamics`              | a sprung mass: linear virtual states; the plan binds an integrator    |
| CouplingElement | `begin(period)`, `axes` | a virtual shaft: acts on two axes and needs the same signals of both  |

A law takes the signals of `needs`, in that order, as plain floats (`Signal.ELAPSED_NS` as an int), and gives the force
or torque on the handle [N or N·m]. A scene without dynamic elements imports no integrator.

Elements are frozen dataclasses; their annotations are checked where a file is read (`documents`), and name the
quantity that a number measures (`quantities`).
"""

from collections.abc import Callable
from typing import Annotated, Protocol, Self, runtime_checkable

from annotated_types import Ge, Gt, Le, Len

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.quantities import Quantity
from haptic_fieldbus.signals import Signal

STRICT = {"extra": "forbid", "allow_inf_nan": False}

Law = Callable[..., float]
PairLaw = Callable[..., tuple[float, float]]
"""The signals of the first axis, then those of the second → the force on each."""

Place = Annotated[float, Quantity.LENGTH]
Length = Annotated[float, Gt(0), Quantity.LENGTH]
NonNegativeLength = Annotated[float, Ge(0), Quantity.LENGTH]
Speed = Annotated[float, Gt(0), Quantity.SPEED]
NonNegativeSpeed = Annotated[float, Ge(0), Quantity.SPEED]
Acceleration = Annotated[float, Quantity.ACCELERATION]
NonNegativeAcceleration = Annotated[float, Ge(0), Quantity.ACCELERATION]
AnyEffort = Annotated[float, Quantity.EFFORT]
Effort = Annotated[float, Ge(0), Quantity.EFFORT]
PositiveEffort = Annotated[float, Gt(0), Quantity.EFFORT]
Stiffness = Annotated[float, Gt(0), Quantity.STIFFNESS]
NonNegativeStiffness = Annotated[float, Ge(0), Quantity.STIFFNESS]
Damping = Annotated[float, Ge(0), Quantity.DAMPING]
PositiveDamping = Annotated[float, Gt(0), Quantity.DAMPING]
Mass = Annotated[float, Gt(0), Quantity.MASS]
InverseSpeed = Annotated[float, Ge(0), Quantity.INVERSE_SPEED]
Duration = Annotated[float, Gt(0), Quantity.TIME]
NonNegativeDuration = Annotated[float, Ge(0), Quantity.TIME]
Frequency = Annotated[float, Gt(0), Quantity.FREQUENCY]
AnyRatio = Annotated[float, Quantity.RATIO]
Ratio = Annotated[float, Ge(0), Quantity.RATIO]
Share = Annotated[float, Ge(0), Le(1), Quantity.RATIO]
TwoAxes = Annotated[tuple[str, ...], Len(2, 2)]


class AnyElement(Protocol):
    """A part of a virtual world."""

    @property
    def name(self) -> str: ...

    @property
    def needs(self) -> tuple[Signal, ...]:
        """The signals of its axis, or of each of its axes."""

    def linearised(self) -> StateSpace:
        """Where it is stiffest, in sustained contact: what stability is judged by.

        (position, velocity) → force; of a coupling (position, velocity, position, velocity) → (force, force).
        """


class Element(AnyElement, Protocol):
    """An element that acts on one axis."""

    @property
    def axis(self) -> str: ...


@runtime_checkable
class StaticElement(Element, Protocol):
    """An element whose force depends on the present feedback only."""

    @property
    def force(self) -> Law: ...


@runtime_checkable
class MemoryElement(Element, Protocol):
    """An element that remembers something between periods."""

    def begin(self, period: float) -> Law:
        """A law with a fresh memory, to be called once a period [s]."""


@runtime_checkable
class DynamicElement(Element, Protocol):
    """An element with virtual states, at rest where the handle is when the drive is enabled."""

    @property
    def dynamics(self) -> StateSpace:
        """Virtual states driven by (position, velocity); the output acts on the handle [N or N·m]."""


@runtime_checkable
class CouplingElement(AnyElement, Protocol):
    """An element that acts on two axes."""

    @property
    def axes(self) -> tuple[str, ...]: ...

    def begin(self, period: float) -> PairLaw:
        """A law with a fresh memory, to be called once a period [s]."""


@runtime_checkable
class Paced(Protocol):
    """An element with a parameter that follows from the period of the loop unless it is given."""

    def at_period(self, period: float) -> Self:
        """The element with that parameter for this period [s]."""


@runtime_checkable
class Graded(Protocol):
    """An element whose stiffness follows from other parameters: the largest local one [N/m or N·m/rad]."""

    @property
    def stiffness(self) -> float: ...

    def with_stiffness(self, stiffness: float) -> Self:
        """The element with its force scaled so that this is its largest local stiffness."""
