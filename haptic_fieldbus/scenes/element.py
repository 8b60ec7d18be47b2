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

An element may state more, such as its energy, its stiffness at each position, and the depth of the handle. `Abilities`
lists these statements with their defaults. By default an element gives back at most the energy that it took since it
began.

Elements are frozen dataclasses. The annotation of a parameter holds its quantity (`quantities`) and its bounds; both
are checked when a file is read (`documents`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import new_class
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeGuard, cast, runtime_checkable

from annotated_types import Ge, Le, Len

from haptic_fieldbus.documents.quantities import RANGES, Quantity
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.signals import Signal

# Bounds of force, stiffness and damping of an element between two positions.
#
# The bounds hold at every place between the two, so that a sum over elements and over neighbouring intervals is a proof
# for all places. `margins.stiffness_map` draws the sums.

Interval = tuple[float, float]
"""Lowest and highest value."""


@dataclass(frozen=True)
class Local:
    """Bounds of force, stiffness and damping of an element between two positions.

    `force` [N or N·m] is the force on a handle at rest. `stiffness` is −dF/dx [N/m or N·m/rad], negative where the
    force pushes the handle away. `damping` [N·s/m or N·m·s/rad] plus `loss` [s/m or s/rad] times the force bounds the
    change of the force per speed; an element with a loss never pulls.
    """

    force: Interval
    stiffness: Interval
    damping: float = 0.0
    loss: float = 0.0


def outwards(push: Interval, inwards: float) -> Interval:
    """Return the bounds of the force F = −inwards·push; `inwards` is 1 or −1, the side of the material."""
    return (-push[1], -push[0]) if inwards > 0.0 else push


def depths(lower: float, upper: float, surface: float, inwards: float) -> Interval:
    """Return the smallest and the largest depth below a surface between two positions; negative outside of it."""
    return (lower - surface, upper - surface) if inwards > 0.0 else (surface - upper, surface - lower)


def below(position: float, surface: float, side: str) -> float:
    """Return how deep a position is in material on the side "positive" or "negative" of a surface; 0 outside."""
    return max(position - surface if side == "positive" else surface - position, 0.0)


def hinge(depth: Interval, stiffness: float, damping: float, inwards: float, saturation: float = math.inf) -> Local:
    """Return the bounds of a spring-damper that begins at the depth 0 and pushes with at most `saturation`."""
    least, most = depth
    if most < 0.0:
        return Local((0.0, 0.0), (0.0, 0.0))
    push = tuple(min(stiffness * max(each, 0.0), saturation) for each in depth)
    in_reach = stiffness * least <= saturation
    slope = (stiffness if least > 0.0 and stiffness * most < saturation else 0.0, stiffness if in_reach else 0.0)
    # At rest beyond the saturation a small speed does not change the force.
    acts = in_reach or least < most
    return Local(outwards((push[0], push[1]), inwards), slope, damping if acts else 0.0)


def either(one: Local, other: Local) -> Local:
    """Return the bounds of the sum of two parts; at most one of them acts at any place."""
    return Local(
        (one.force[0] + other.force[0], one.force[1] + other.force[1]),
        (min(one.stiffness[0], other.stiffness[0]), max(one.stiffness[1], other.stiffness[1])),
        max(one.damping, other.damping),
    )


def turning(lower: float, upper: float, amplitude: float, turn: float) -> Local:
    """Return the bounds of F = −A·sin(κ·x) between two positions; `amplitude` A, `turn` κ [1/m or 1/rad]."""
    low, high = _sine(turn * lower, turn * upper)
    least, most = _sine(turn * lower + 0.5 * math.pi, turn * upper + 0.5 * math.pi)
    return Local((-amplitude * high, -amplitude * low), (amplitude * turn * least, amplitude * turn * most))


def _sine(lower: float, upper: float) -> Interval:
    """Return the smallest and the largest sine between two angles [rad]."""
    if not upper - lower < 2.0 * math.pi:
        return -1.0, 1.0
    ends = sorted((math.sin(lower), math.sin(upper)))
    # A crest lies between the angles where the number of crests below them differs.
    crests = [math.floor((angle - 0.5 * math.pi) / (2.0 * math.pi)) for angle in (lower, upper)]
    troughs = [math.floor((angle + 0.5 * math.pi) / (2.0 * math.pi)) for angle in (lower, upper)]
    return (-1.0 if troughs[0] != troughs[1] else ends[0]), (1.0 if crests[0] != crests[1] else ends[1])


def remainder(way: float, pitch: float) -> float:
    """Return the exact distance of `way` from the nearest multiple of a pitch; not-a-number if `way` is infinite."""
    return math.remainder(way, pitch) if math.isfinite(way) else math.nan


def periods(pitch: float, first: float, lower: float, upper: float, most: int = 24) -> tuple[float, ...]:
    """Return the valleys first + n·pitch from `lower` to `upper`, and the one before and after them.

    Of many only some are returned: the one within that is nearest to the first, and up to `most` around it.
    """
    low = math.ceil((lower - first) / pitch) if math.isfinite(lower) else -math.inf
    high = math.floor((upper - first) / pitch) if math.isfinite(upper) else math.inf
    nearest = int(min(max(0, low), high))
    begin, end = int(max(low - 1, nearest - most // 2)), int(min(high + 1, nearest + most // 2))
    return tuple(first + number * pitch for number in range(begin, end + 1))


# Pydantic's configuration of every element: an unknown key, an infinity or not-a-number is a fault of the file.
STRICT = {"extra": "forbid", "allow_inf_nan": False}

LAWS = ("force", "begin", "dynamics")
"""Names of members for the law; an element has one of them."""
Law = Callable[..., float]
"""Signals of the axis in the order of `needs` → force or torque on the handle [N or N·m]."""
PairLaw = Callable[..., tuple[float, float]]
"""Signals of the first axis, then of the second → (force on the first, force on the second) [N or N·m]."""


class Mark(Enum):
    """A property of a parameter beyond its quantity and bounds."""

    PLACE = "a position that the handle can reach"


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


class Damped:
    """Base of elements that need the velocity for their damping alone: without damping the plan has no estimator."""

    damping: float

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Position, and velocity only with damping."""
        return (Signal.POSITION, Signal.VELOCITY) if self.damping else (Signal.POSITION,)


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
class Varying(Element, Protocol):
    """An element without memory whose stiffness or damping depends on the position; it is judged at all places."""

    def local(self, lower: float, upper: float) -> Local:
        """Return bounds of force, stiffness and damping that hold at every place from `lower` to `upper`."""

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return edges and positions between which the force changes little, up to a force of `effort` [N or N·m].

        `lower` and `upper` are the ends of the travel and may be infinite. Equal parts may be left out.
        """


class Abilities:
    """Optional statements of an element beyond its law, with their defaults.

    A class makes a statement by a member with its name: a field, a property or a method. `abilities` returns all
    statements of an element.
    """

    stored: Callable[..., float] | None = None
    """Position [m or rad] → stored energy [J], from any zero; a coupling takes both positions. With a memory: the
    largest energy at this position, at least 0. None: the energy depends on more than the position. For the energy
    ledger (`planning.energy`)."""
    reserve: float | None = None
    """Largest energy that the memory can hold [J]; None: not known. For the energy ledger and the margins."""
    strongest: float = 0.0
    """Largest force that the element gives by itself, without stored energy [N or N·m]. For the energy ledger."""
    penetration: Callable[[float], float | None] | None = None
    """Position [m or rad] → depth of the handle behind a surface [m or rad], 0 outside; between two positions at most
    the larger depth of both. None: no surface, or none with these values. For the travel of a run."""
    increments: tuple[float, float] | tuple[()] | None = ()
    """Largest change of the force per move [N/m or N·m/rad], and per speed [N·s/m or N·m·s/rad]; None: the force jumps.
    In a move without delay the element gives at most ½·L·Δx² more than it took. (): the linear model applies. For the
    passivity margins (`margins.resting_points`)."""
    phases: tuple[tuple[float, float], ...] = ()
    """Stiffness [N/m or N·m/rad] and damping [N·s/m or N·m·s/rad] in each phase of the element; (0, 0) for a phase
    without force. (): the linear model applies. For the margins."""
    other_regimes: tuple[StateSpace, ...] = ()
    """Linear models of an element with states in its other regimes, such as a tool that does not touch its wall; that
    of `linearised` is the first one. For the margins."""
    by_event: bool = False
    """Whether the element gives force only for a while after an event, such as a crossing of a position; this force may
    come a little late. For the verdict on a run (`assessing.run_verdict`)."""
    at_period: Callable[[float], AnyElement] | None = None
    """Period of the loop [s] → the element with its period-dependent parameter; None: no such. For the scene."""
    stiffness: float = 0.0
    """Largest local stiffness [N/m or N·m/rad]. For margins and settings."""
    with_stiffness: Callable[[float], Any] | None = None
    """Largest local stiffness [N/m or N·m/rad] → the element with its force scaled to it; None: `stiffness` is a
    parameter, or does not change. For margins, settings and refusals."""
    local: Callable[[float, float], Local] | None = None
    """Two positions [m or rad] → bounds of force, stiffness and damping that hold at every place between them; needs
    `places` too. None: the force is sampled, or the linear model applies. For the margins (`Varying`)."""
    places: Callable[[float, float, float], tuple[float, ...]] | None = None
    """Ends of the travel [m or rad], effort [N or N·m] → positions from edge to edge; needs `local` too."""


class _Stated:
    """Members of an element, with the defaults of `Abilities`."""

    def __init__(self, element: object) -> None:
        self._element = element

    def __getattr__(self, name: str) -> Any:
        return getattr(self._element, name, getattr(Abilities, name))


def abilities(element: object) -> Abilities:
    """Return the optional statements of an element; each is read from the element on access."""
    return cast(Abilities, _Stated(element))


def is_varying(element: object) -> TypeGuard[Varying]:
    """Return whether the class of an element has the methods of `Varying`; `isinstance` takes 50 µs in Python 3.11."""
    return hasattr(type(element), "local") and hasattr(type(element), "places")


def is_dynamic(element: object) -> TypeGuard[DynamicElement]:
    """Return whether the class of an element has the property of `DynamicElement`, faster than `isinstance`."""
    return hasattr(type(element), "dynamics")


def is_sampled(element: Any) -> bool:
    """Return whether an element states a force of position and velocity but no bounds, so that its force is sampled."""
    kind = type(element)
    if not hasattr(kind, "force") or hasattr(kind, "increments") or is_varying(element):
        return False
    return bool(element.needs) and {*element.needs} <= {Signal.POSITION, Signal.VELOCITY}


def is_shipped(element: object) -> bool:
    """Return whether an element is one of this package."""
    return type(element).__module__.startswith("haptic_fieldbus.")


if not TYPE_CHECKING:
    FORMER = {
        "Active": ("strongest",),
        "Eventful": ("by_event",),
        "Graded": ("stiffness", "with_stiffness"),
        "Incremental": ("increments",),
        "Paced": ("at_period",),
        "Phased": ("phases",),
        "Reserving": ("reserve",),
        "Storing": ("stored",),
        "Surfaced": ("penetration",),
    }
    """Deprecated names of 0.1, each for a class of elements that say this; `abilities` takes their place."""

    def __getattr__(name):
        """Return the runtime protocol of a former name."""
        if name not in FORMER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        members = dict.fromkeys(FORMER[name])
        return runtime_checkable(new_class(name, (Protocol,), exec_body=lambda space: space.update(members)))
