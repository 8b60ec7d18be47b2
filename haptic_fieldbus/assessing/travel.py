"""Travel of a handle and its depth in elements with a surface: extremes, updated during a run."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.scenes.element import Element, abilities
from haptic_fieldbus.signals import Workspace

if TYPE_CHECKING:  # imported for its type alone: a plan that is not run never loads it
    from haptic_fieldbus.assessing.loop_report import LoopReport


@dataclass(frozen=True)
class Travel:
    """Travel of the handle of one axis since operation enabled [m or rad]: the true motion in simulation, otherwise the
    decoded position."""

    axis: str
    lowest: float
    highest: float
    depth: Mapping[str, float]
    """Largest depth by the name of each element with a surface; 0 if the handle stayed outside. After a live change:
    the depth in the new element since the start of the ramp, and in the old element before.
    """
    workspace: Workspace = field(default=Workspace.LINEAR, repr=False)

    def to_json(self) -> dict[str, Json]:
        return {"axis": self.axis, "lowest": self.lowest, "highest": self.highest, "depth": dict(self.depth)}


class Reach:
    """Lowest and highest position of an axis, for each set of elements that acted."""

    def __init__(self) -> None:
        self._ends: dict[int, tuple[float, float]] = {}
        """Extremes by the number of changes before."""
        self.faults: list[str] = []
        """Sentences about elements that failed to compute a depth."""

    def add(self, times_ns: NDArray[np.int64], positions: NDArray[np.float64], changed_ns: Sequence[int]) -> None:
        """Add positions at instants [ns], both `(n,)`; `changed_ns` are the last instants before each change so far."""
        number = np.searchsorted(np.asarray(changed_ns, dtype=np.int64), times_ns)
        for changes in np.unique(number, return_counts=True)[0].tolist():  # alone it imports numpy.ma
            here = positions[number == changes]
            lowest, highest = self._ends.get(changes, (math.inf, -math.inf))
            self._ends[changes] = min(lowest, float(here.min())), max(highest, float(here.max()))

    def travel(self, axis: str, workspace: Workspace, acted: Sequence[Iterable[Element]]) -> Travel | None:
        """Return travel and depths; None without positions. `acted` maps the number of changes to the elements."""
        if not self._ends:
            return None
        depth: dict[str, float] = {}
        for changes, ends in self._ends.items():
            for element in acted[changes]:
                found = [each for end in ends if (each := self._depth(element, end)) is not None]
                if found:
                    depth[element.name] = max(*found, depth.get(element.name, 0.0))
        lowest, highest = (min(low for low, _ in self._ends.values()), max(high for _, high in self._ends.values()))
        return Travel(axis, lowest, highest, depth, workspace)

    def _depth(self, element: Element, position: float) -> float | None:
        """Return the depth of the handle in an element; None if the element has no depth or fails to compute it."""
        depth_at = abilities(element).penetration
        try:
            return None if depth_at is None else depth_at(position)
        except Exception as error:  # of an element of one's own: it must not hide how the run ended
            fault = f"depth of element {element.name}: {type(error).__name__}: {error}"
            self.faults += [fault] if fault not in self.faults else []
            return None


class Travels:
    """The travel of all axes of a run, and the changes of its report."""

    def __init__(self, axes: Sequence[AxisPlan], report: "LoopReport") -> None:
        self._axes, self._report = axes, report
        self._reached = {axis.name: Reach() for axis in axes}

    def add(self, axis: str, times_ns: NDArray[np.int64], positions: NDArray[np.float64]) -> None:
        """Add positions of an axis at instants [ns], both `(n,)`."""
        self._reached[axis].add(times_ns, positions, [applied.after_ns for applied in self._report.changes])

    @property
    def faults(self) -> list[str]:
        """Return sentences about elements that failed to compute a depth; call it after `told`."""
        return [fault for reached in self._reached.values() for fault in reached.faults]

    def told(self) -> tuple[Travel, ...]:
        """Return the travel of each axis with a known position."""
        plans = [self._axes, *(applied.change.plan.axes for applied in self._report.changes)]
        told = [
            self._reached[axis.name].travel(axis.name, axis.workspace, [axes[place].elements for axes in plans])
            for place, axis in enumerate(self._axes)
        ]
        return tuple(each for each in told if each is not None)
