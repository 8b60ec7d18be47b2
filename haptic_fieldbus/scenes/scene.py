"""A scene: axes with their workspaces, and the elements that act on them."""

from dataclasses import dataclass, replace
from typing import Literal, cast

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, abilities
from haptic_fieldbus.signals import Workspace


@dataclass(frozen=True)
class SceneAxis:
    """An axis of a scene: its name, its workspace, and whether the simulated hand holds it."""

    name: str
    workspace: Workspace
    held: bool | None = None
    """Whether the simulated hand holds this axis; None means yes, unless the axis is the second of a coupling."""


@dataclass(frozen=True)
class MadeFor:
    """Drives on whose shipped bench a scene is inside its limit; on others it needs other values."""

    rate: float | None = None
    """Lowest rate of the loop [Hz]; None: any."""
    drive: str | None = None
    """Name of a profile; None: every drive with this rate."""

    def __str__(self) -> str:
        rate = "" if self.rate is None else f"drives with {exactly(self.rate)} Hz or more"
        return " and ".join(filter(None, (self.drive, rate)))


def axes_of(element: AnyElement) -> tuple[str, ...]:
    """Return the names of the axes that an element acts on: both for a coupling, else one."""
    return element.axes if isinstance(element, CouplingElement) else (cast(Element, element).axis,)


@dataclass(frozen=True)
class Scene:
    """A scene to render: its axes, and its elements in the order of their files."""

    name: str
    description: str
    axes: tuple[SceneAxis, ...]
    elements: tuple[AnyElement, ...]
    source: str = ""
    """Path of the scene file; empty for a scene made in Python."""
    hand: str | None = None
    """Default motion of the simulated hand in this scene; None: the default of the run."""
    passivity: Literal["observer", "controller"] = "observer"
    """"observer": the run trips when the scene generates energy; "controller": damping absorbs the energy before
    that."""

    made_for: MadeFor | None = None
    """Drives for which the scene is made; None: every drive that can render it."""

    @property
    def controlled(self) -> bool:
        """True if damping absorbs the energy that the loop generates."""
        return self.passivity == "controller"

    def of_axis(self, axis: str) -> tuple[Element, ...]:
        """Return the elements that act on this axis alone, without couplings."""
        return tuple(cast(Element, element) for element in self.elements if axes_of(element) == (axis,))

    def holds(self, axis: str) -> bool:
        """Return whether the simulated hand holds this axis; by default every axis but the second of a coupling."""
        told = next(each.held for each in self.axes if each.name == axis)
        return axis not in {coupling.axes[1] for coupling in self.couplings} if told is None else told

    def at_period(self, period: float) -> "Scene":
        """Return the scene for a loop with this period [s]: sets the period-dependent parameters of its elements."""
        if not any(abilities(element).at_period for element in self.elements):
            return self
        paced = (fill(period) if (fill := abilities(element).at_period) else element for element in self.elements)
        return replace(self, elements=tuple(paced))

    @property
    def couplings(self) -> tuple[CouplingElement, ...]:
        """The elements that act on two axes."""
        return tuple(element for element in self.elements if isinstance(element, CouplingElement))
