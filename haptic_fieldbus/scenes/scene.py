"""A scene: axes with their workspace, and the elements that act on them."""

from dataclasses import dataclass, replace
from typing import cast

from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, Paced
from haptic_fieldbus.signals import Workspace


@dataclass(frozen=True)
class SceneAxis:
    """An axis of a scene, and what it moves in."""

    name: str
    workspace: Workspace
    held: bool | None = None
    """Whether the simulated hand holds it; None: unless it is the second of a coupling."""


def axes_of(element: AnyElement) -> tuple[str, ...]:
    """The axes that an element acts on, by name."""
    return element.axes if isinstance(element, CouplingElement) else (cast(Element, element).axis,)


def _paced(element: AnyElement, period: float) -> AnyElement:
    return cast(AnyElement, element.at_period(period)) if isinstance(element, Paced) else element


@dataclass(frozen=True)
class Scene:
    """What is rendered; elements are listed in the order of their file."""

    name: str
    description: str
    axes: tuple[SceneAxis, ...]
    elements: tuple[AnyElement, ...]
    source: str = ""
    hand: str | None = None
    """What the simulated hand does in this scene unless told otherwise."""

    def of_axis(self, axis: str) -> tuple[Element, ...]:
        """The elements that act on this axis alone."""
        return tuple(cast(Element, element) for element in self.elements if axes_of(element) == (axis,))

    def holds(self, axis: str) -> bool:
        """Whether the simulated hand holds this axis; without a word on it, all but those that a coupling leads."""
        told = next(each.held for each in self.axes if each.name == axis)
        return axis not in {coupling.axes[1] for coupling in self.couplings} if told is None else told

    def at_period(self, period: float) -> "Scene":
        """The scene in a loop of this period [s]: what follows from it is filled in."""
        if not any(isinstance(element, Paced) for element in self.elements):
            return self
        return replace(self, elements=tuple(_paced(element, period) for element in self.elements))

    @property
    def couplings(self) -> tuple[CouplingElement, ...]:
        """The elements that act on two axes."""
        return tuple(element for element in self.elements if isinstance(element, CouplingElement))
