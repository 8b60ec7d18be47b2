"""A plan: everything that one period needs, decided before the first. A value; nothing here talks to a drive."""

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import ImageLayout
from haptic_fieldbus.protocols.traffic import COMPUTE_NS, BusTraffic, Delay
from haptic_fieldbus.scenes.scene import Scene

if TYPE_CHECKING:  # a scene without couplings does without it
    from haptic_fieldbus.planning.coupled_plan import CouplingAges


@dataclass(frozen=True)
class LeftOut:
    """Something that this scene does without, and why."""

    what: str
    why: str


@dataclass(frozen=True)
class BusPlan:
    """One bus of a plan, by its name in the rig: its traffic, and the names of the axes on it."""

    name: str
    protocol: str
    traffic: BusTraffic
    axes: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """Everything that one period needs, decided before the first."""

    scene: Scene
    rig: Rig = field(repr=False)
    rate: float
    buses: tuple[BusPlan, ...] = field(repr=False)
    """In the order in which the axes name them."""
    axes: tuple[AxisPlan, ...] = field(repr=False)
    image: ImageLayout = field(repr=False)
    left_out: tuple[LeftOut, ...] = field(repr=False)
    steps: tuple[str, ...] = field(repr=False)
    modules: tuple[str, ...] = field(repr=False)
    compute_ns: int = COMPUTE_NS

    @property
    def period(self) -> float:
        """[s]."""
        return self.period_ns * 1e-9

    @property
    def period_ns(self) -> int:
        return round(1e9 / self.rate)

    @property
    def bus_load(self) -> float:
        """Of the fullest bus."""
        return max(bus.traffic.load for bus in self.buses)

    @property
    def simulated(self) -> bool:
        """Whether all of its buses are."""
        return all(self.rig.bus[bus.name].simulated for bus in self.buses)

    def on(self, bus: BusPlan) -> "Plan":
        """The part of one bus: its axes, and their places in the one process image."""
        at = [position for position, axis in enumerate(self.axes) if axis.name in bus.axes]
        image = replace(self.image, axes=tuple(self.image.axes[position] for position in at))
        return replace(self, buses=(bus,), axes=tuple(self.axes[position] for position in at), image=image)

    @property
    def mapped(self) -> tuple[str, ...]:
        """Mapped objects such as `6064h:00 position actual value`, each once."""
        signals = [mapped for axis in self.axes for mapped in (*axis.traffic.incoming, *axis.traffic.outgoing)]
        return tuple(dict.fromkeys(mapped.address for mapped in signals))

    @property
    def delay(self) -> Delay:
        """The longest of all axes."""
        return max((axis.delay for axis in self.axes), key=lambda delay: delay.total)

    @property
    def stability(self) -> Stability | None:
        """That of `weakest`."""
        return None if self.weakest is None else self.weakest.stability

    @property
    def weakest(self) -> AxisPlan | None:
        """The axis with the smallest margin, told by the first of those that are judged together; None when a bench is
        unknown."""
        told = [
            (math.inf if axis.stability.margin is None else axis.stability.margin, axis.group.reference_axis)
            for axis in self.axes
            if axis.stability is not None and axis.group is not None
        ]
        if len(told) < len(self.axes):
            return None
        return self.axis(min(told, key=lambda each: each[0])[1])

    def axis(self, name: str) -> AxisPlan:
        """The axis of that name."""
        return next(each for each in self.axes if each.name == name)

    @property
    def coupling_ages(self) -> "tuple[CouplingAges, ...]":
        """How old the forces of each coupling are on its axes."""
        if not self.scene.couplings:
            return ()
        from haptic_fieldbus.planning.coupled_plan import ages

        latch = {name: bus.traffic.latch for bus in self.buses for name in bus.axes}
        return tuple(ages(self.scene.couplings, self.axes, latch))
