"""Protocols of the elements of a scene, and the annotated types of their parameters.

An element names the signals that it needs and computes the force or torque on the handle; positive accelerates towards
positive position. It is of one of four kinds:

| kind            | it has                  | example                                                               |
|-----------------|-------------------------|-----------------------------------------------------------------------|
| StaticElement   | `force`                 | a wall: the force depends on the present feedback alone               |
| MemoryElement   | `begin(period)`         | friction, a wave: steps a memory of its own, exactly                  |
| DynamicElement  | `dynamics`              | a sprung mass: linear virtual states; the plan binds an integrator    |
| CouplingElement | `begin(period)`, `axes` | a virtual shaft: acts on two axes and needs the same signals of both  |

A law takes the signals of `needs`, in that order, as plain floats (`Signal.ELAPSED_NS` as an int), and returns the
force or torque on the handle [N or N·m]. A scene without dynamic elements imports no integrator.

An element also states what energy it can give, for the ledger of the cycle (`cycle.energy`): `stored`, `reserve` or
`strongest`. One that states nothing is taken to give back no more than it took since it began.

Elements are frozen dataclasses. The annotation of a parameter holds its quantity (`quantities`) and its bounds; both
are checked when a file is read (`documents`).
"""

from collections.abc import Callable
from enum import Enum
from typing import Annotated, Any, Protocol, Self, TypeGuard, runtime_checkable

from annotated_types import Ge, Le, Len

from haptic_fieldbus.documents.quantities import RANGES, Quantity
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.local import Local
from haptic_fieldbus.signals import Signal

# Pydantic's configuration of every element: an unknown key, an infinity or not-a-number is a fault of the file.
STRICT = {"extra": "forbid", "allow_inf_nan": False}

LAWS = ("force", "begin", "dynamics")
"""Members of which an element has one: its law."""
Law = Callable[..., float]
"""Signals of the axis in the order of `needs` → force or torque on the handle [N or N·m]."""
PairLaw = Callable[..., tuple[float, float]]
"""Signals of the first axis, then of the second → (force on the first, force on the second) [N or N·m]."""


class Mark(Enum):
    """A property of a parameter beyond its quantity and bounds."""

    PLACE = "a place of the handle, refused where the handle cannot reach it"


Place = Annotated[float, RANGES[Quantity.LENGTH].any, Quantity.LENGTH, Mark.PLACE]
Length = Annotated[float, RANGES[Quantity.LENGTH].positive, Quantity.LENGTH]
NonNegativeLength = Annotated[float, RANGES[Quantity.LENGTH].from_zero, Quantity.LENGTH]
Speed = Annotated[float, RANGES[Quantity.SPEED].positive, Quantity.SPEED]
NonNegativeSpeed = Annotated[float, RANGES[Quantity.SPEED].from_zero, Quantity.SPEED]
Acceleration = Annotated[float, RANGES[Quantity.ACCELERATION].any, Quantity.ACCELERATION]
NonNegativeAcceleration = Annotated[float, RANGES[Quantity.ACCELERATION].from_zero, Quantity.ACCELERATION]
AnyEffort = Annotated[float, RANGES[Quantity.EFFORT].any, Quantity.EFFORT]
Effort = Annotated[float, RANGES[Quantity.EFFORT].from_zero, Quantity.EFFORT]
PositiveEffort = Annotated[float, RANGES[Quantity.EFFORT].positive, Quantity.EFFORT]
Stiffness = Annotated[float, RANGES[Quantity.STIFFNESS].positive, Quantity.STIFFNESS]
NonNegativeStiffness = Annotated[float, RANGES[Quantity.STIFFNESS].from_zero, Quantity.STIFFNESS]
Damping = Annotated[float, RANGES[Quantity.DAMPING].from_zero, Quantity.DAMPING]
PositiveDamping = Annotated[float, RANGES[Quantity.DAMPING].positive, Quantity.DAMPING]
Mass = Annotated[float, RANGES[Quantity.MASS].positive, Quantity.MASS]
InverseSpeed = Annotated[float, RANGES[Quantity.INVERSE_SPEED].from_zero, Quantity.INVERSE_SPEED]
Duration = Annotated[float, RANGES[Quantity.TIME].positive, Quantity.TIME]
NonNegativeDuration = Annotated[float, RANGES[Quantity.TIME].from_zero, Quantity.TIME]
Frequency = Annotated[float, RANGES[Quantity.FREQUENCY].positive, Quantity.FREQUENCY]
AnyRatio = Annotated[float, RANGES[Quantity.RATIO].any, Quantity.RATIO]
Ratio = Annotated[float, RANGES[Quantity.RATIO].from_zero, Quantity.RATIO]
Share = Annotated[float, Ge(0), Le(1), Quantity.RATIO]
TwoAxes = Annotated[tuple[str, ...], Len(2, 2)]


class AnyElement(Protocol):
    """The common part of all elements: a name, the needed signals, and a linear model."""

    @property
    def name(self) -> str: ...

    @property
    def needs(self) -> tuple[Signal, ...]:
        """The signals that the law takes, in this order; for a coupling, of each of its two axes."""

    def linearised(self) -> StateSpace:
        """Return the linear model in sustained contact, where the element is stiffest; stability is judged with it.

        Inputs (position, velocity), output the force; for a coupling inputs (position, velocity, position, velocity),
        outputs (force, force).
        """


class Element(AnyElement, Protocol):
    """An element that acts on one axis."""

    @property
    def axis(self) -> str: ...


@runtime_checkable
class StaticElement(Element, Protocol):
    """An element whose force depends on the present feedback alone."""

    @property
    def force(self) -> Law: ...


@runtime_checkable
class MemoryElement(Element, Protocol):
    """An element that keeps a memory of its own from period to period."""

    def begin(self, period: float) -> Law:
        """Return a law with a fresh memory; it must be called once every `period` [s]."""


@runtime_checkable
class DynamicElement(Element, Protocol):
    """An element with virtual states; they start at rest at the handle's position when the drive is enabled."""

    @property
    def dynamics(self) -> StateSpace:
        """State space with inputs (position, velocity); its output acts on the handle [N or N·m]."""


@runtime_checkable
class CouplingElement(AnyElement, Protocol):
    """An element that acts on two axes."""

    @property
    def axes(self) -> tuple[str, ...]: ...

    def begin(self, period: float) -> PairLaw:
        """Return a law with a fresh memory; it must be called once every `period` [s]."""


@runtime_checkable
class Storing(Protocol):
    """An element whose energy follows from where the handle is; a coupling takes the positions of both axes."""

    @property
    def stored(self) -> Callable[..., float]:
        """Position [m or rad] → the energy that the element can give back from there [J], from any zero."""


@runtime_checkable
class Surfaced(Protocol):
    """An element with a surface that the handle can be behind; a run tells how deep it went."""

    def penetration(self, position: float) -> float | None:
        """Return the depth of the handle at `position` [m or rad], 0 outside; None where its values leave no surface.

        Between two positions the depth is nowhere larger than at the deeper one of them.
        """


@runtime_checkable
class Reserving(Protocol):
    """An element whose memory holds a bounded energy."""

    @property
    def reserve(self) -> float:
        """Largest energy that the memory can hold [J]."""


@runtime_checkable
class Active(Protocol):
    """An element that may give energy that it never took."""

    @property
    def strongest(self) -> float:
        """Largest force that it gives by itself [N or N·m]; 0 when its values make it passive."""


@runtime_checkable
class Varying(Element, Protocol):
    """An element without memory whose stiffness or damping depends on the position; it is judged at all places."""

    def local(self, lower: float, upper: float) -> Local:
        """Return bounds of force, stiffness and damping that hold at every place from `lower` to `upper`."""

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return positions from edge to edge between which it changes little, as far as `effort` [N or N·m] pushes.

        `lower` and `upper` are the ends of the travel and may be infinite. Equal parts may be left out.
        """


@runtime_checkable
class Incremental(Protocol):
    """An element whose force never jumps, and that gives at most ½·L·Δx² more than it took in a move without delay."""

    @property
    def increments(self) -> tuple[float, float] | None:
        """Largest change of the force per move [N/m or N·m/rad], and per speed [N·s/m or N·m·s/rad]; None: it jumps."""


@runtime_checkable
class Phased(Protocol):
    """An element with a memory that feels like one of several springs and dampers, each for a while."""

    @property
    def phases(self) -> tuple[tuple[float, float], ...]:
        """Stiffness [N/m or N·m/rad] and damping [N·s/m or N·m·s/rad] of each; (0, 0) where it may be left."""


@runtime_checkable
class Eventful(Protocol):
    """An element whose force may come from events alone; it may then come a little late (`assessing.run_verdict`)."""

    @property
    def by_event(self) -> bool:
        """Whether it gives no force but for a while after an event, such as a crossing of a position."""


@runtime_checkable
class Paced(Protocol):
    """An element with a parameter that follows from the period of the loop when it is left out."""

    def at_period(self, period: float) -> Self:
        """Return the element with that parameter filled in for this period [s]."""


@runtime_checkable
class Graded(Protocol):
    """An element whose stiffness follows from its other parameters."""

    @property
    def stiffness(self) -> float:
        """The largest local stiffness [N/m or N·m/rad]."""

    def with_stiffness(self, stiffness: float) -> Self:
        """Return the element with its force scaled to this largest local stiffness [N/m or N·m/rad]."""


def is_varying(element: object) -> TypeGuard[Varying]:
    """Return whether the class of an element has the methods of `Varying`; `isinstance` takes 50 µs in Python 3.11."""
    return hasattr(type(element), "local") and hasattr(type(element), "places")


def is_dynamic(element: object) -> TypeGuard[DynamicElement]:
    """Return whether the class of an element has the property of `DynamicElement`, as fast."""
    return hasattr(type(element), "dynamics")


def is_sampled(element: Any) -> bool:
    """Return whether an element states a force of position and velocity, and no bounds: its force is read at places."""
    kind = type(element)
    if not hasattr(kind, "force") or hasattr(kind, "increments") or is_varying(element):
        return False
    return bool(element.needs) and {*element.needs} <= {Signal.POSITION, Signal.VELOCITY}


def is_shipped(element: object) -> bool:
    """Return whether an element is one of this package."""
    return type(element).__module__.startswith("haptic_fieldbus.")
