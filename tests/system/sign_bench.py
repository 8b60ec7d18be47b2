"""A loop on simulated drives whose sign is not known, with the torque that their motors really got."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.drive.rig import Rig, Seen
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import HANDS, Hand, Piece
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from tests.builders import can_traffic
from tests.whole_loop import run_loop

TURN, STROKE, ARM = math.pi, 0.03, 1e6
"""Of the rigid hand: [rad/s], [m], [kg]."""
HELD_BY: dict[str, Hand | None] = {
    "free": None,
    "held still": Hand("held still", mass=1000.0),
    "held hard": Hand("held hard", mass=1000.0, stiffness=3000.0, damping=20.0),
    "led": HANDS["guide"],
    "led rigidly": Hand("led rigidly", (Piece(0.0, 0.5 * ARM * STROKE * TURN**2),), angular_frequency=TURN, mass=ARM,
                        stiffness=1e7, damping=2e3),
    "pushed": HANDS["push"],
    "knocked": HANDS["tap"],
    "to and fro": HANDS["sine"],
}  # fmt: skip
REVERSED: dict[str, faults.Fault] = {
    "encoder": faults.EncoderReversed("encoder_reversed", 0.0),
    "torque": faults.TorqueReversed("torque_reversed", 0.0),
}
SMALL = 0.05
"""Share of rated torque that must not be exceeded before the sign is seen."""


def unseen_rig(task: Task, **changes: Any) -> Rig:
    """The bench of a task with an endless way, of which no sign is known, with changes to every axis."""
    axes = {}
    for name, axis in load(task).rig.axis.items():
        endless = replace(axis, limits=replace(axis.limits, position=None))
        axes[name] = replace(endless, seen=Seen(), **changes)
    return replace(load(task).rig, axis=axes)


def unseen_plan(task: Task, **changes: Any) -> Plan:
    return select(replace(task, rig=unseen_rig(task, **changes))).plan


@dataclass
class Outcome:
    """Result of a run."""

    plan: Plan
    cycle: Cycle
    torques: dict[str, float]
    """Largest target that the motor of each axis got, as a share of rated torque."""
    error: HapticFieldbusError | None
    began_ns: int
    """Operation enabled; 0 for a run that failed."""
    motions: dict[str, Trajectory]
    """True motion of each axis, and the targets of its motor."""

    @property
    def contradicted(self) -> bool:
        return self.cycle.trip is not None and self.cycle.trip.kind is TripKind.SIGN

    @property
    def limited(self) -> bool:
        """Whether the sign of at least one axis is still looked for, so that no axis gets more."""
        return any(self.cycle.axes[axis.name].state.permitted_ns is None for axis in self.plan.axes)

    @property
    def seen_at(self) -> float:
        """When the sign of all axes had been seen [s after operation enabled]."""
        times = [self.cycle.axes[axis.name].state.permitted_ns for axis in self.plan.axes]
        assert None not in times
        return max(time - self.began_ns for time in times if time is not None) * 1e-9

    @property
    def largest(self) -> float:
        return max(self.torques.values())


def rendered(plan: Plan, hand: Hand | None, these: Sequence[faults.Fault] = (), seconds: float = 1.0) -> Outcome:
    """Run a plan of one bus in virtual time; the hand holds the first axis, and the faults are those of each drive."""
    clock = VirtualClock()
    world = World(clock, can_traffic(plan).bitrate)
    for place, axis in enumerate(plan.axes):
        own = tuple(fault for fault in these if fault.node in (None, axis.node))
        world.add(DriveOnBus(axis.node, axis.profile, axis.rig, hand if place == 0 else None, faults=own))
    cycle, error = Cycle(plan), None
    bus = CanopenBus(SimulatedBus(world=world), clock, owned=True)
    began_ns = 0
    try:
        bus.open(plan)
        report = run_loop(plan, cycle, bus, clock, cycles=max(1, round(seconds * plan.rate)))
        began_ns = report.enabled_at_ns or 0
    except HapticFieldbusError as raised:
        error = raised
    finally:
        bus.close()
    motions = {axis.name: world.trajectory(axis.node) for axis in plan.axes}
    torques = {
        axis.name: float(np.abs(motions[axis.name].targets()[1]).max(initial=0.0)) / (axis.rig.rated_torque or 1)
        for axis in plan.axes
    }
    return Outcome(plan, cycle, torques, error, began_ns, motions)
