"""Transition from one set of elements to another: the loop while old forces fade out and new forces fade in.

With the share w of the new elements and 1 − w of the old, the force is the sum of both. The loop is again linear and is
judged as any other. For two walls the mix is a wall with a stiffness and damping in between; elements with virtual
states contribute the states of both. The share is constant for each judgement. A ramp of a tenth of a second is slow
compared with the loop, but this is no proof for a changing share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import scaled
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Local, is_varying
from haptic_fieldbus.signals import Signal

SHARES = tuple(eighth / 8 for eighth in range(1, 8))
"""Shares of the new elements at which the transition is judged."""


@dataclass(frozen=True)
class Faded:
    """An element, or a coupling, with a share of its force, for the judgement of stability alone."""

    element: Any
    share: float

    @property
    def needs(self) -> tuple[Signal, ...]:
        needs: tuple[Signal, ...] = self.element.needs
        return needs

    @property
    def name(self) -> str:
        name: str = self.element.name
        return name

    @property
    def axis(self) -> str:
        axis: str = self.element.axis
        return axis

    @property
    def axes(self) -> tuple[str, ...]:
        axes: tuple[str, ...] = self.element.axes
        return axes

    def linearised(self) -> StateSpace:
        return scaled(self.element.linearised(), self.share)


@dataclass(frozen=True)
class FadedDynamic(Faded):
    """A faded element whose virtual states an integrator steps."""

    @property
    def dynamics(self) -> StateSpace:
        return self.linearised()


@dataclass(frozen=True)
class FadedVarying(Faded):
    """A faded element that is judged at all places."""

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds of the element with its share of force, stiffness and damping."""
        whole: Local = self.element.local(lower, upper)
        force, stiffness = ((self.share * low, self.share * high) for low, high in (whole.force, whole.stiffness))
        return Local(force, stiffness, self.share * whole.damping, whole.loss)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return the places of the element."""
        found: tuple[float, ...] = self.element.places(lower, upper, effort)
        return found


def _kind_of(element: AnyElement) -> type[Faded]:
    if isinstance(element, DynamicElement):
        return FadedDynamic
    return FadedVarying if is_varying(element) else Faded


def mixed(before: Sequence[AnyElement], after: Sequence[AnyElement], share: float) -> tuple[Any, ...]:
    """Return the mixed elements: unchanged elements once, changed elements twice, the new one with this share.

    `before` and `after` have the same length and order.
    """
    mix: list[Any] = []
    for old, new in zip(before, after, strict=True):
        if new == old:
            mix.append(new)
        else:
            kind = _kind_of(new)
            mix += [kind(old, 1.0 - share), kind(new, share)]
    return tuple(mix)
