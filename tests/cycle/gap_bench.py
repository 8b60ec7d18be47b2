"""A running cycle whose handle is moved by hand or free, and loses samples when a test says so; energies by hand.

The torque that is sent acts until the next one is. Between two samples the handle moves by the closed form of
m·v' = F − b·v, or as the test moves it. What the torque gives is F·Δx of the true motion.
"""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import LinkFlag, Workspace
from tests.builders import plan_of, rig_of, scene_of
from tests.cycle.test_cycle import ENABLED, FADED_IN, image, sent

PERIOD = 1e-3
MASS, DAMPING = 0.63, 1.58
"""Of the shipped bench, without its dry friction [kg, N·s/m]."""
FASTEST = 1.5
"""Speed limit of the bench [m/s]."""
FREE = Limits(speed=FASTEST, acceleration=1e12)


LEVER = 0.05 / (2.0 * math.pi)
"""Way of the linear bench per turn of its motor [m/rad]; the rotary bench is the same motor without it."""


def bench_plan(*elements: Element, rotary: bool = False, **changes: Any) -> Plan:
    scene = scene_of(*elements, workspace=Workspace.ROTARY if rotary else Workspace.LINEAR)
    free = Limits(speed=FASTEST / LEVER, acceleration=FREE.acceleration) if rotary else FREE
    plan = plan_of(scene, rig=rig_of(scene, **{"limits": free, **changes}))
    # A loop that loses more than a margin permits is the subject here, and no reason to stop. A handle that is carried
    # whatever its torque is would be one with the wrong sign on a known bench.
    axes = tuple(replace(axis, stability=None, plant=None) for axis in plan.axes)
    return replace(plan, axes=axes)


@dataclass
class Handled:
    """A handle at `x` [m] with speed `v` in a running cycle; energies in J."""

    plan: Plan
    mass: float = MASS
    damping: float = DAMPING
    x: float = 0.0
    v: float = 0.0
    missing: int = 0
    given: float = 0.0
    """Work of the torque on the handle."""
    held: float = 0.0
    """That of the torque held in gaps, until the force is that of the scene again."""
    outside: float = 0.0
    """Way outside of gaps [m]."""
    leak: float = 0.0
    """Largest leak of held torque: ½·K·Δx² in a period, ¼·K·s² in a step in which the law is drawn back."""
    stiffness: float = 0.0
    """Steepest slope of the scene [N/m]."""
    force: float = 0.0
    period: int = 0
    farthest: float = 0.0
    path: float = 0.0
    """Length of the way [m]."""
    by_changes: bool = False
    """Whether the leak is that of a force that changes by itself too: its change times the way."""

    def __post_init__(self) -> None:
        self.cycle = Cycle(self.plan)
        (axis,) = self.plan.axes
        self.axis = self.cycle.axes[axis.name]  # the state of the axis, where the rows do not show it
        self._count, self._unit = axis.position_unit, axis.effort_unit
        zero = self.x
        for _ in range(FADED_IN):
            self._sample(0.0)
        self.x = zero
        for number in range(200):  # to the start, slowly, so that nothing jumps
            self._sample(zero * (number + 1) / 200)
        self.given = self.held = self.leak = self.path = self.outside = 0.0
        self.shift, self._law, self._before = 0.0, 0.0, self.x
        self._seen = self.x

    def _sample(self, x: float, *, lost: bool = False) -> None:
        self.period += 1
        flags = int(LinkFlag.STALE) if lost else 0
        t_ns = 1_000_000 * self.period
        self.force = self._unit * sent(self.cycle(image(round(x / self._count), t_ns=t_ns, flags=flags)))[1]

    @property
    def tripped(self) -> str | None:
        return None if self.cycle.trip is None else self.cycle.trip.kind.value

    def move(self, *, lost: bool = False, to: float | None = None, push: float = 0.0) -> None:
        """Take or lose a sample, and move for a period: `to` a place, or freely under a `push` of the hand [N]."""
        self._sample(self.x, lost=lost)
        gap = (lost and self.missing > 0) or self.axis.permission.blind
        self.missing = self.missing + 1 if lost else 0
        before, last = self.x, self._law
        self._law = self.axis.state.force
        if to is None:
            self._fly(push)
        else:
            self.x, self.v = to, (to - before) / PERIOD
        way = self.x - before
        self.given += self.force * way
        self.path += abs(way)
        if gap or lost:
            self.held += self.force * way
        else:
            self.outside += way
        self.leak += 0.5 * self.stiffness * way * way
        if self.by_changes:
            self.leak += abs(self._law - last) * abs(before - self._before)
        self._before = before
        if not lost:
            shift, drawn = self.axis.permission.shift, abs(self.shift) - abs(self.axis.permission.shift)
            steps = (before - self._seen) / max(1, self.axis.state.steps)
            self.leak += 0.25 * self.stiffness * abs(steps) * max(abs(drawn), abs(before - self._seen))
            self.shift, self._seen = shift, before
            self.farthest = max(self.farthest, abs(shift))

    def _fly(self, push: float) -> None:
        way, self.v = flown(self.v, self.force + push, self.mass, self.damping)
        self.x += way


def flown(speed: float, force: float, mass: float, damping: float) -> tuple[float, float]:
    """Way of a period under a constant force, and the speed after it: m·v' = F − b·v, exactly."""
    if not damping:
        return (speed + 0.5 * force / mass * PERIOD) * PERIOD, speed + force / mass * PERIOD
    end, rate = force / damping, damping / mass
    decay = math.exp(-rate * PERIOD)
    return end * PERIOD + (speed - end) * (1.0 - decay) / rate, end + (speed - end) * decay


Timing = Callable[[Handled], int]
"""How many samples are lost from now on; 0: none."""


def run(bench: Handled, seconds: float, gaps: Timing, push: Callable[[float], float] = lambda t: 0.0) -> None:
    """Let the handle move freely; gaps begin when a timing says so."""
    left = 0
    for number in range(round(seconds / PERIOD)):
        left = left - 1 if left else gaps(bench)
        bench.move(lost=left > 0, push=push(number * PERIOD))
        if bench.tripped:
            return


def carry(bench: Handled, way: float, speed: float, gaps: Timing) -> None:
    """Move the handle at a constant speed."""
    left = 0
    for _ in range(round(way / speed / PERIOD)):
        left = left - 1 if left else gaps(bench)
        bench.move(lost=left > 0, to=bench.x + speed * PERIOD)


@dataclass
class AtPlaces:
    """Gaps of `missing` samples whenever the handle passes a place with this phase of a pitch."""

    missing: int
    pitch: float
    phase: float = 0.0
    pause: int = 0
    """Fewest periods between the begins of two gaps."""
    of_law: bool = False
    """Whether the law passes there, or the handle."""

    def __post_init__(self) -> None:
        self._last: int | None = None
        self._begun = -(10**9)

    def __call__(self, bench: Handled) -> int:
        at = bench.x - (bench.axis.permission.shift if self.of_law else 0.0)
        number = math.floor(at / self.pitch - self.phase)
        passed, self._last = self._last is not None and number != self._last, number
        if not passed or bench.period - self._begun < self.pause:
            return 0
        self._begun = bench.period
        return self.missing


def never(bench: Handled) -> int:
    return 0


def every(periods: int, missing: int) -> Timing:
    return lambda bench: missing if bench.period % periods == 0 else 0


class TwoHandles:
    """Two free handles of a coupled scene in a running cycle, which lose samples apart from each other or together.

    Energies in J, as in `Handled`; a period counts as one in a gap when either handle is in it.
    """

    def __init__(self, scene: Scene, dampings: Sequence[float], rotary: bool) -> None:
        lever = LEVER if rotary else 1.0
        free = Limits(speed=FASTEST / lever, acceleration=FREE.acceleration)
        plan = plan_of(scene, rig=rig_of(scene, limits=free))
        plan = replace(plan, axes=tuple(replace(axis, stability=None, plant=None) for axis in plan.axes))
        self.cycle = Cycle(plan)
        self.axes = tuple(self.cycle.axes.values())
        self.mass, self.dampings = MASS * lever**2, [each * lever**2 for each in dampings]
        self._units = [(axis.position_unit, axis.effort_unit) for axis in plan.axes]
        self.x, self.v, self.forces = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        self.given = self.held = self.leak = self.path = 0.0
        self.places = [0.0, 0.0]
        """Places of the law at the last sample."""
        # The square of a twist is at most twice the sum of the squares of both motions.
        self._slopes = [
            sum(2.0 * abs(each.linearised().d[axis, 2 * axis]) for each in scene.couplings)
            + sum(abs(each.linearised().d[0, 0]) for each in plan.axes[axis].elements)
            for axis in range(2)
        ]
        self._t_ns = 0
        for _ in range(FADED_IN):
            self._sample((False, False))

    def _sample(self, lost: tuple[bool, bool]) -> None:
        self._t_ns += 1_000_000
        links = [word for each in lost for word in (0, int(LinkFlag.STALE) if each else 0, 0)]
        counts = [round(x / unit[0]) for x, unit in zip(self.x, self._units, strict=True)]
        feedback = struct.pack("<qIHHIHHHihHih", self._t_ns, *links, ENABLED, counts[0], 0, ENABLED, counts[1], 0)
        _, first, _, second = struct.unpack("<HhHh", self.cycle(feedback))
        self.forces = [unit[1] * torque for unit, torque in zip(self._units, (first, second), strict=True)]

    @property
    def tripped(self) -> str | None:
        return None if self.cycle.trip is None else self.cycle.trip.kind.value

    def move(self, lost: tuple[bool, bool] = (False, False), pushes: Sequence[float] = (0.0, 0.0)) -> bool:
        """Take or lose samples, and let both handles fly for a period; return whether it lies in a gap."""
        before = list(self.forces)
        self._sample(lost)
        self.places = [x - axis.permission.shift for x, axis in zip(self.x, self.axes, strict=True)]
        gap = any(lost) or any(axis.permission.blind for axis in self.axes)
        for number, force in enumerate(self.forces):
            way, self.v[number] = flown(self.v[number], force + pushes[number], self.mass, self.dampings[number])
            self.x[number] += way
            self.given, self.path = self.given + force * way, self.path + abs(way)
            self.held += force * way if gap else 0.0
            self.leak += abs(force - before[number]) * abs(way) + 0.5 * self._slopes[number] * way * way
        return gap
