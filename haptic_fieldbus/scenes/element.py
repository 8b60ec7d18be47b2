"""What every element of a scene is.

An element states the signals that it needs and says what acts on the handle: positive accelerates towards positive
position. There are two kinds. A *static* element has no memory: its `force` takes the needed signals in the order of
`needs`. A *dynamic* element has virtual states: it gives them as a linear system with inputs (position, velocity) and
output force, and the plan binds an integrator to it. A scene without dynamic elements imports no integrator.

Elements are frozen dataclasses; the annotations are checked where a file is read (`documents`), not when one is made.
"""

from collections.abc import Callable
from typing import Annotated, Protocol, runtime_checkable

from annotated_types import Ge, Gt

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.signals import Signal

STRICT = {"extra": "forbid", "allow_inf_nan": False}
PositiveFloat = Annotated[float, Gt(0)]
NonNegativeFloat = Annotated[float, Ge(0)]


class Element(Protocol):
    """A part of a virtual world, acting on one axis."""

    @property
    def name(self) -> str: ...

    @property
    def axis(self) -> str: ...

    @property
    def needs(self) -> tuple[Signal, ...]:
        """The signals of its axis."""
        ...

    def linearised(self) -> StateSpace:
        """The element in sustained contact, (position, velocity) → force: what stability is judged by."""
        ...


@runtime_checkable
class StaticElement(Element, Protocol):
    """An element whose force depends on the present feedback only."""

    @property
    def force(self) -> Callable[..., float]:
        """Force or torque on the handle [N or N·m]; takes the signals of `needs`, in that order, as plain floats."""
        ...


@runtime_checkable
class DynamicElement(Element, Protocol):
    """An element with virtual states, at rest where the handle is when the drive is enabled."""

    @property
    def dynamics(self) -> StateSpace:
        """Virtual states driven by (position, velocity); the output acts on the handle [N or N·m]."""
        ...
