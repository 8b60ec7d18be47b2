"""On the way from one set of elements to another: the loop while old forces fade and new ones come.

With the share w of the new and 1 − w of the old, the force is that of both side by side: the loop is again linear, and
judged as any other. For a wall the mix is a wall of the stiffness and damping in between; with virtual states it has
those of both. The share is held while it is judged: a ramp of a tenth of a second is slow beside the loop, but this is
no proof for a share that moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import scaled
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement
from haptic_fieldbus.signals import Signal

SHARES = tuple(eighth / 8 for eighth in range(1, 8))
"""At which the way is looked at."""


@dataclass(frozen=True)
class Faded:
    """An element, or a coupling, with a share of its force: as far as stability asks."""

    element: Any
    share: float

    @property
    def needs(self) -> tuple[Signal, ...]:
        needs: tuple[Signal, ...] = self.element.needs
        return needs

    @property
    def axes(self) -> tuple[str, ...]:
        axes: tuple[str, ...] = self.element.axes
        return axes

    def linearised(self) -> StateSpace:
        return scaled(self.element.linearised(), self.share)


@dataclass(frozen=True)
class FadedDynamic(Faded):
    """One whose virtual states an integrator steps."""

    @property
    def dynamics(self) -> StateSpace:
        return self.linearised()


def mixed(before: Sequence[AnyElement], after: Sequence[AnyElement], share: float) -> tuple[Any, ...]:
    """The elements on their way: those that stay, and of those that change both, the new with this share."""
    mix: list[Any] = []
    for old, new in zip(before, after, strict=True):
        if new == old:
            mix.append(new)
        else:
            kind = FadedDynamic if isinstance(new, DynamicElement) else Faded
            mix += [kind(old, 1.0 - share), kind(new, share)]
    return tuple(mix)
