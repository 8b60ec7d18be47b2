"""A scene: axes with their workspace, and the elements that act on them."""

from dataclasses import dataclass

from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.signals import Workspace


@dataclass(frozen=True)
class SceneAxis:
    name: str
    workspace: Workspace


@dataclass(frozen=True)
class Scene:
    """What is rendered; elements are listed in the order of their file."""

    name: str
    description: str
    axes: tuple[SceneAxis, ...]
    elements: tuple[Element, ...]
    source: str = ""

    def of_axis(self, axis: str) -> tuple[Element, ...]:
        return tuple(element for element in self.elements if element.axis == axis)
