"""A plan: all decisions about a period, made before the first one. A plan is a value and does no I/O."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import TorqueDeadline, torque_deadlines
from haptic_fieldbus.planning.guards import AxisGuard, SetGuard, guard_of
from haptic_fieldbus.planning.image import ImageLayout
from haptic_fieldbus.protocols.traffic import COMPUTE_NS, BusTraffic, Delay
from haptic_fieldbus.scenes.scene import Scene

if TYPE_CHECKING:
    from haptic_fieldbus.planning.coupled_plan import CouplingAges


# Values of the plan without a source: the values of the profiles that are marked ASSUMED, in words.
#
# A limit that is computed from an assumption is no better than the assumption. Each result therefore shows the word.

_WORDS: dict[str, Callable[[DriveProfile], str]] = {
    "timing.torque_bandwidth": lambda profile: f"torque loop {exactly(profile.timing.torque_bandwidth)} Hz",
    "timing.control_period": lambda profile: f"control period {exactly(1e3 * profile.timing.control_period)} ms",
    "line.answer_time": lambda profile: "answer time",
    "timing.enabling_timeout": lambda profile: "time to enable",
    "torque.mode_of_operation": lambda profile: "mode of operation",
    "torque.target": lambda profile: "unit of target torque",
    "torque.rated": lambda profile: "unit of rated torque",
    "torque.rated_current": lambda profile: "unit of rated current",
    "torque.full_scale": lambda profile: f"full scale of torque {exactly(profile.full_scale or 0.0)} N·m",
    "torque.limit": lambda profile: "unit of the torque limit",
    "torque.slope": lambda profile: "unit of the torque slope",
    "torque.echo": lambda profile: "echo of the set-points",
    "position.actual": lambda profile: "unit of position",
    "velocity.actual": lambda profile: "unit of velocity",
    "pdo.rpdo_acts": lambda profile: "set-points act on reception",
    "link_loss.reacts": lambda profile: "reaction to a lost link",
    "sync.powers": lambda profile: "accepted loop periods",
}
"""Key of a profile → its words; other keys do not affect torque, or follow from these."""


def assumed_words(profile: DriveProfile) -> tuple[str, ...]:
    """Return the words of the assumed values of a drive, times first."""
    # A source covers its own key, or all keys of its table.
    covered = {name for key in profile.assumed for name in _WORDS if f"{name}.".startswith(f"{key}.")}
    return tuple(words(profile) for name, words in _WORDS.items() if name in covered)


def assumed_lines(axes: Iterable[AxisPlan]) -> tuple[str, ...]:
    """Return a line for each drive with assumed values; drives with one profile share a line."""
    profiles = {axis.profile.title: axis.profile for axis in axes}
    told = {title: ", ".join(assumed_words(profile)) for title, profile in profiles.items()}
    several = len(profiles) > 1
    return tuple(f"{title}: {words}" if several else words for title, words in told.items() if words)


def assumed_texts(assumed: Iterable[str]) -> Iterator[str]:
    """Yield each line of assumed values with its reason."""
    return (f"{text}; not stated by the profile" for text in assumed)


def _margin(axis: AxisPlan) -> float:
    """Return the margin of an axis; ∞ without a stiffness, so that such an axis is the weakest only if it is alone."""
    margin = None if axis.stability is None else axis.stability.margin
    return math.inf if margin is None else margin


@dataclass(frozen=True)
class LeftOut:
    """A part that a plan omits, and the reason."""

    what: str
    why: str


@dataclass(frozen=True)
class BusPlan:
    """One bus of a plan: its name in the rig, its protocol, its traffic, and the names of the axes on it."""

    name: str
    protocol: str
    traffic: BusTraffic
    axes: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """Plan of a run: all decisions about a period, made before the first one."""

    scene: Scene
    rig: Rig = field(repr=False)
    rate: float
    """Periods a second [Hz]."""
    buses: tuple[BusPlan, ...] = field(repr=False)
    """Buses, in the order in which the axes name them."""
    axes: tuple[AxisPlan, ...] = field(repr=False)
    """Axes, in the order of the scene."""
    image: ImageLayout = field(repr=False)
    """Layout of the process image."""
    left_out: tuple[LeftOut, ...] = field(repr=False)
    """Parts that the plan omits, with reasons."""
    steps: tuple[str, ...] = field(repr=False)
    """Steps of a period in words."""
    modules: tuple[str, ...] = field(repr=False)
    """Names of the optional modules of this package that the plan imports."""
    compute_ns: int = COMPUTE_NS
    """Computing time granted to the host in each period [ns]."""

    @property
    def period(self) -> float:
        """Length of a period [s]."""
        return self.period_ns * 1e-9

    @property
    def period_ns(self) -> int:
        """Length of a period in whole nanoseconds."""
        return round(1e9 / self.rate)

    @property
    def bus_load(self) -> float:
        """Load of the fullest bus, worst case, as a share of its capacity."""
        return max(bus.traffic.load for bus in self.buses)

    @property
    def simulated(self) -> bool:
        """True when all buses are simulated."""
        return all(self.rig.bus[bus.name].simulated for bus in self.buses)

    def fading_in(self, fade_in: float) -> "Plan":
        """Return the same plan with limits that reach their full value `fade_in` [s] after *operation enabled*."""
        axes = tuple(replace(axis, limits=replace(axis.limits, fade_in=fade_in)) for axis in self.axes)
        return replace(self, axes=axes)

    def on(self, bus: BusPlan) -> "Plan":
        """Return the part of the plan on one bus: its axes, at their places in the process image of the whole plan."""
        at = [position for position, axis in enumerate(self.axes) if axis.name in bus.axes]
        image = replace(self.image, axes=tuple(self.image.axes[position] for position in at))
        return replace(self, buses=(bus,), axes=tuple(self.axes[position] for position in at), image=image)

    @property
    def assumed(self) -> tuple[str, ...]:
        """Values of the drives' profiles without a source, one line for each drive."""
        return assumed_lines(self.axes)

    @property
    def mapped(self) -> tuple[str, ...]:
        """Mapped objects such as `6064h:00 position actual value`, each once."""
        signals = [mapped for axis in self.axes for mapped in (*axis.traffic.incoming, *axis.traffic.outgoing)]
        return tuple(dict.fromkeys(mapped.address for mapped in signals))

    @property
    def delay(self) -> Delay:
        """Delay of the axis with the longest one."""
        return max((axis.delay for axis in self.axes), key=lambda delay: delay.total)

    @property
    def deadlines(self) -> tuple[TorqueDeadline, ...]:
        """Longest time to zero torque for each cause."""
        traffic = self._traffic
        return torque_deadlines([(axis, traffic[axis.name]) for axis in self.axes], self.period)

    @property
    def guards(self) -> tuple[AxisGuard, ...]:
        """Drive watchdog of each axis, with its proof."""
        found, traffics = [], self._traffic
        for axis in self.axes:
            traffic = traffics[axis.name]
            late = axis.delay.transport + axis.profile.timing.control_period
            written = (*traffic.guarding(axis.name, axis.rig), self.place(axis))
            set_to = SetGuard(traffic.guard(axis.name), late, self.period, written)
            found.append(guard_of(axis.name, axis.profile, axis.rig, set_to, self.rig.source))
        return tuple(found)

    def place(self, axis: AxisPlan) -> str:
        """Return the location of the drive of an axis: the wires of its bus, and its number on the bus."""
        return f"{self.rig.bus[axis.rig.bus].wires} {axis.node}"

    @property
    def _traffic(self) -> dict[str, BusTraffic]:
        """Traffic of the bus of each axis, by its name."""
        return {name: bus.traffic for bus in self.buses for name in bus.axes}

    @property
    def stability(self) -> Stability | None:
        """Verdict on `weakest`; None when a bench is unknown."""
        return None if self.weakest is None else self.weakest.stability

    @property
    def weakest(self) -> AxisPlan | None:
        """Axis with the smallest margin. For coupled axes, the axis whose units the verdict uses. None when a bench is
        unknown."""
        names = {axis.group.reference_axis for axis in self.axes if axis.group is not None}
        if not names or any(axis.stability is None for axis in self.axes):
            return None
        # The margin of a single group is not computed: it takes longer than all other values of a plan.
        judged = [axis for axis in self.axes if axis.name in names]
        return judged[0] if len(judged) == 1 else min(judged, key=_margin)

    def axis(self, name: str) -> AxisPlan:
        """Return the axis of that name, which must exist."""
        return next(each for each in self.axes if each.name == name)

    @property
    def coupling_ages(self) -> "tuple[CouplingAges, ...]":
        """Age of the motion to which each coupling reacts; empty without couplings."""
        if not self.scene.couplings:
            return ()
        # Imported here, because a scene without couplings does not need it.
        from haptic_fieldbus.planning.coupled_plan import ages

        latch = {name: traffic.latch(name) for name, traffic in self._traffic.items()}
        return tuple(ages(self.scene.couplings, self.axes, latch))
