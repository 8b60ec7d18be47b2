"""A running cycle whose handle is moved by hand or free, and loses samples when a test says so; energies by hand.

The torque that is sent acts until the next one is. Between two samples the handle moves by the closed form of
m·v' = F − b·v, or as the test moves it. What the torque gives is F·Δx of the true motion.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.signals import LinkFlag, Workspace
from tests.builders import plan_of, rig_of, scene_of
from tests.cycle.test_cycle import FADED_IN, image, sent

PERIOD = 1e-3
MASS, DAMPING = 0.63, 1.58
"""Of the shipped bench, without its dry friction [kg, N·s/m]."""
FREE = Limits(speed=1.5, acceleration=1e12)


LEVER = 0.05 / (2.0 * math.pi)
"""Way of the linear bench per turn of its motor [m/rad]; the rotary bench is the same motor without it."""


def bench_plan(*elements: Element, rotary: bool = False, **changes: Any) -> Plan:
    scene = scene_of(*elements, workspace=Workspace.ROTARY if rotary else Workspace.LINEAR)
    free = Limits(speed=FREE.speed / LEVER, acceleration=FREE.acceleration) if rotary else FREE
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
        """m·v' = F − b·v with a constant force, exactly."""
        force, rate = self.force + push, self.damping / self.mass
        if rate:
            end, decay = force / self.damping, math.exp(-rate * PERIOD)
            way = end * PERIOD + (self.v - end) * (1.0 - decay) / rate
            self.v = end + (self.v - end) * decay
        else:
            way = (self.v + 0.5 * force / self.mass * PERIOD) * PERIOD
            self.v += force / self.mass * PERIOD
        self.x += way


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
