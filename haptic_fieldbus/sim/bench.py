"""Parts that the simulated drives of a bus share: planned actions, the schedule of their faults, and their true motion.

Each fault happens once, `at` seconds after *operation enabled*. A drive may be enabled more than once, for example for
the watchdog test and then for the run. So the time counts anew from each *operation enabled*. Until the first fault has
happened, it stops counting when the drive is freed. After that, the other faults keep their times, even if a fault
frees the drive.
"""

import gc
import heapq
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from types import UnionType
from typing import Protocol

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.settings import DriveSettings, drawn_settings
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

# Planned actions of a simulated world, each called at its instant.

Action = Callable[[int], None]
"""Called with the instant [ns] for which it was planned."""
Plan = Callable[[int, Action], None]
"""Plan to call an action at an instant [ns], with that instant."""


class TimerQueue:
    """Actions by their instants; those of one instant are called in the order in which they were planned."""

    def __init__(self) -> None:
        self.due_ns = NEVER_NS
        """Instant of the next action; NEVER_NS when there is none."""
        self._waiting: list[tuple[int, int, Action]] = []
        # Orders actions of the same instant by age; callables cannot be compared.
        self._planned = 0

    def plan(self, t_ns: int, action: Action) -> None:
        """Plan to call `action` at an instant, with that instant; at NEVER_NS nothing is planned."""
        if t_ns == NEVER_NS:
            return
        self._planned += 1
        heapq.heappush(self._waiting, (t_ns, self._planned, action))
        self.due_ns = self._waiting[0][0]

    def run(self, t_ns: int) -> None:
        """Call all due actions, also those planned meanwhile."""
        while self.due_ns <= t_ns:
            _, _, action = heapq.heappop(self._waiting)
            self.due_ns = self._waiting[0][0] if self._waiting else NEVER_NS
            action(t_ns)


# What drives that are hosted in real time need, on any bus.

LONGEST_REMEMBERED = 1000
"""Least number of latest motion segments that are kept; no caller needs more."""
NAP_NS = 100_000_000
"""Longest wait, so that a request to stop is noticed soon."""


@contextmanager
def frozen() -> Iterator[None]:
    """Keep what exists now out of garbage collection inside the block, so that a collection has little to do.

    If the surrounding program had frozen objects, all stay frozen, because theirs cannot be told apart.
    """
    theirs = gc.get_freeze_count()
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        if not theirs:
            gc.unfreeze()


TimedFault = faults.DriveFaultKind | faults.LineFault | faults.AnswerFault | faults.HostFault


_OF_BUS = faults.LineFault | faults.ConnectionReset | faults.HostFault


@dataclass(eq=False)
class _PlannedFault:
    """A fault that is planned; it was cancelled when it does not wait any more."""

    fault: TimedFault
    node: int

    def concerns(self, fault: TimedFault, node: int) -> bool:
        """Return whether this is the same fault; of the same drive, unless it is a fault of the bus or of the host."""
        return self.fault is fault and (self.node == node or isinstance(fault, _OF_BUS))


class FaultSchedule:
    """The faults of all drives of a bus, by node-ID; those of the bus and of the host count from its first drive."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._waiting: list[_PlannedFault] = []
        self._happened: list[_PlannedFault] = []

    def begin(
        self, these: Iterable[TimedFault], node: int, action: Callable[[TimedFault], Callable[[int], None]], t_ns: int
    ) -> None:
        """Plan the faults of a drive that is in *operation enabled* from now on; `action` returns their effects.

        Faults that have happened, or wait for another drive, are left out.
        """
        self._cancel(node)
        for fault in these:
            if not any(each.concerns(fault, node) for each in (*self._happened, *self._waiting)):
                waiting = _PlannedFault(fault, node)
                self._waiting.append(waiting)
                self._plan(t_ns + round(fault.at * 1e9), partial(self._happen, waiting, action(fault)))

    def freed(self, node: int) -> None:
        """Note that torque of a drive has ended."""
        if not self._happened:
            self._cancel(node)

    def _cancel(self, node: int) -> None:
        self._waiting = [waiting for waiting in self._waiting if waiting.node != node]

    def _happen(self, waiting: _PlannedFault, act: Callable[[int], None], t_ns: int) -> None:
        if waiting in self._waiting:
            self._waiting.remove(waiting)
            self._happened.append(waiting)
            act(t_ns)


# Faults of a drive on any bus (encoder, current loop, safe torque off), and faults of the hand.


def with_faulty_hand(slot: DriveOnBus) -> DriveOnBus:
    """Return the place of a drive whose hand, if it has one, releases and hits as its faults tell."""
    if (hand := slot.hand) is None:
        return slot
    for fault in faults.faults_of(slot.faults, slot.node):
        match fault:
            case faults.HandRelease(at=at):
                hand = hand.letting_go(at)
            case faults.HandHit(at=at, force=force, duration=duration):
                hand = hand.hitting(at, force, duration)
    return replace(slot, hand=hand)


def inject_drive(fault: faults.DriveFaultKind, drive: Drive, plan: Plan, t_ns: int) -> None:
    """Apply a fault that happens at `t_ns`; raises ValueError for a fault of the link."""
    if isinstance(fault, faults.SafeTorqueOff):
        drive.sto(True, t_ns)
        plan(until(t_ns, fault.duration), lambda closed_ns: drive.sto(False, closed_ns))
        return
    # Bring the shaft up to date first: the encoder goes on from the counts of this instant.
    drive.measure(t_ns)
    servo = drive.servo
    match fault:
        case faults.EncoderJump(counts=counts):
            servo.jump(counts)
        case faults.PositionStuck(duration=duration):
            servo.stuck_until_ns = max(servo.stuck_until_ns, until(t_ns, duration))
        case faults.EncoderScaling(factor=factor):
            servo.rescale(factor)
        case faults.EncoderReversed():
            servo.rescale(-1.0)
        case faults.TorqueDead():
            servo.impair(0.0)
        case faults.TorqueSaturated(share=share):
            servo.impair(share * drive.objects.rated_torque)
        case faults.TorqueReversed():
            servo.impair(math.inf, -servo.torque_sign)
        case _:
            raise ValueError(f"{fault.kind} is no fault of encoder or current loop")


def until(t_ns: int, duration: float | None) -> int:
    """Return the end [ns] of a fault that begins at `t_ns`."""
    return NEVER_NS if duration is None else t_ns + round(duration * 1e9)


class Ticking(Protocol):
    """A part of a drive that has something to do at a time [ns]."""

    due_ns: int


class DriveBench(ABC):
    """Parts that the simulated drives of a bus share: seed, planned actions and the schedule of their faults.

    At least the `longest` latest segments of the true motion of each drive are kept, None: all.
    """

    of_line: UnionType | type
    """Faults that concern every drive, regardless of their node."""
    kinds: frozenset[str]
    """Kinds of faults that the bus and its drives may have."""
    protocol: str
    """Name of the protocol, in messages."""

    def __init__(self, seed: int | str, longest: int | None) -> None:
        self.queue = TimerQueue()
        self._seed, self._longest = seed, longest
        self._schedule = FaultSchedule(self.queue.plan)
        self.by_node: dict[int, Drive] = {}
        """Each drive by its number on the bus."""
        self.timed: list[Ticking] = []

    def check(self, slot: DriveOnBus) -> None:
        """Raise UsageError when the number of a drive is taken, or for faults that it cannot have."""
        if slot.node in self.by_node:
            raise UsageError(f"node {slot.node} is on this bus already")
        if wrong := sorted({fault.kind for fault in slot.faults} - self.kinds):
            raise UsageError(f"drives on {self.protocol} do not support the fault {', '.join(wrong)}; remove it")

    def drawn(self, slot: DriveOnBus) -> DriveSettings:
        """Return the settings of a drive, as drawn from the seed."""
        drawn = drawn_settings(self._seed, slot.node)
        return replace(drawn, position=slot.position, velocity=slot.velocity, led=slot.led)

    def follow(self, drive: Drive, slot: DriveOnBus) -> None:
        """Install the faults of a drive that exist from power-on, and schedule the others from *operation enabled* on.

        Only then is its number taken.
        """
        drive.plant.recorder.longest = self._longest
        timed: list[TimedFault] = []
        for fault in slot.faults:
            if not isinstance(fault, self.of_line) and fault.node not in (None, slot.node):
                continue
            if isinstance(fault, faults.LastingFault):
                self.install(fault, slot.node)
            elif not isinstance(fault, faults.HandFault):
                timed.append(fault)
        drive.on_enabled = partial(self._schedule.begin, timed, slot.node, partial(self.action, slot.node))
        drive.on_freed = lambda _t_ns: self._schedule.freed(slot.node)
        self.by_node[slot.node] = drive

    @abstractmethod
    def install(self, fault: faults.LastingFault, node: int) -> None:
        """Apply a fault that exists from power-on; raises ValueError for one that this drive cannot have."""

    @abstractmethod
    def action(self, node: int, fault: TimedFault) -> Action:
        """Return the action of a fault on its drive or on the bus."""

    def let_happen(self, fault: TimedFault, node: int, t_ns: int) -> None:
        """Plan a fault of a drive or of the bus, whose `at` counts from `t_ns`."""
        self.queue.plan(t_ns + round(fault.at * 1e9), self.action(node, fault))

    @property
    def next_due_ns(self) -> int:
        """Return the time of the next timer or planned action; NEVER_NS when there is none."""
        due_ns = self.queue.due_ns
        for timer in self.timed:
            if timer.due_ns < due_ns:
                due_ns = timer.due_ns
        return due_ns


class DrivenBus(ABC):
    """A simulated bus with the true motion of its drives."""

    def __init__(self, bench: DriveBench) -> None:
        self._bench = bench

    @abstractmethod
    def run(self) -> None:
        """Run all events up to the present of the clock."""

    @property
    @abstractmethod
    def reached_ns(self) -> int:
        """Return the instant up to which all events have been run."""

    def let_happen(self, node: int, fault: TimedFault) -> None:
        """Plan a fault of a drive or of its bus; its `at` counts from the present."""
        self.run()
        self._bench.let_happen(fault, node, self.reached_ns)

    def body(self, node: int) -> Body:
        """Return the shaft of a drive."""
        return self._bench.by_node[node].plant

    def trajectory(self, node: int) -> Trajectory:
        """Return the true motion of a shaft up to the present."""
        self.run()
        self._bench.by_node[node].servo.advance(self.reached_ns)
        return self.so_far(node)

    def so_far(self, node: int) -> Trajectory:
        """Return the true motion of a shaft up to the instant that it has been moved to, without moving it."""
        plant = self.body(node)
        return Trajectory(plant.recorder, plant.t_ns)

    def forget(self, before_ns: int) -> None:
        """Drop the motion before an instant [ns]."""
        for drive in self._bench.by_node.values():
            drive.plant.recorder.forget(before_ns)
