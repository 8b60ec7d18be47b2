"""A bench of simulated drives behind a bus that a rig calls real, in virtual time; every frame on it is kept."""

import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import can

from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.running.session import Session, Site
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import DeadGuard, Fault

BUS = '[bus.can]   # the only one\ninterface = "socketcan"\nchannel = "can0"\n'
AXIS = """
[axis.{name}]
bus = "can"
node = {node}                # by its DIP switches
profile = "{profile}"
encoder_counts_per_revolution = 4096
rated_torque = 0.4
torque_constant = 0.05
rated_current = 8.0
peak_current = 20.0
raise_max_torque = true
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
limits = {{ speed = 10.0 }}
"""
EMERGENCY_STOP = 'emergency_stop = "power"\n'
EMCY, RPDO, MASTER_HEARTBEAT = 0x80, 0x200, 0x77F
LOST_MASTER = 0x8130
DEAD = DeadGuard("dead_guard")


def rig_text(*names: str, profile: str = "generic_cia402", more: str = "") -> str:
    """A rig with these axes on one bus, with comments, and `more` keys in the table of the last one."""
    axes = [AXIS.format(name=name, node=1 + place, profile=profile) for place, name in enumerate(names or ("handle",))]
    return BUS + "".join(axes) + more


@contextmanager
def drives_behind(plan: Plan, *_: object) -> Iterator[Site]:
    """Put simulated drives behind the bus of a plan, in virtual time, in the place of `api.site.site_of`."""
    clock = VirtualClock()
    world = World(clock, 1_000_000, 0)
    for axis in plan.axes:
        world.add(DriveOnBus(axis.node, axis.profile, axis.rig))
    bus = CanopenBus(SimulatedBus(world=world), clock, owned=True)
    yield Site(clock, {"here": bus}, {}, "")


class Frozen(VirtualClock):
    """A clock that sleeps too long, once or always, as a busy computer does."""

    late_ns = 0
    times = 0

    def sleep_until(self, deadline_ns: int) -> int:
        if self.times and deadline_ns > self.now_ns():
            self.times -= 1
            super().sleep_until(deadline_ns + self.late_ns)
            return self.late_ns
        return super().sleep_until(deadline_ns)


class GuardBench:
    """The drives of a rig; `run` renders a wall on them as a real run would."""

    def __init__(
        self, rig: Path, *, scene: str = "wall", rate: float = 1000.0, seed: int = 0, prove: bool = False
    ) -> None:
        self.prove = prove
        # Inside the limit of a bench whose values are stated.
        soft = {"wall.stiffness": 200.0} if scene == "wall" else {}
        found = load(Task(scene, rate=rate, rig=rig, settings=soft))
        self.selection = replace(found, rig=found.rig.unproved()) if prove else found
        self.plan = self.selection.plan
        self.clock = Frozen()
        self.world = World(self.clock, 1_000_000, seed)
        self.frames: list[tuple[int, int, bytes]] = []
        self.world.tap(lambda t_ns, can_id, data: self.frames.append((t_ns, can_id, bytes(data))))
        self.asked = ""
        self.answer: Any = True
        self.port = SimulatedBus(world=self.world)
        self.forger = SimulatedBus(world=self.world)
        self.bus = CanopenBus(self.port, self.clock, owned=True)

    def put(self, faults: Iterable[Fault] = (), *, but: Callable[[World], object] | None = None) -> "GuardBench":
        """Put the drives on the bus."""
        for axis in self.plan.axes:
            own = tuple(fault for fault in faults if fault.node in (None, axis.node))
            self.world.add(DriveOnBus(axis.node, axis.profile, axis.rig, faults=own))
        if but is not None:
            but(self.world)
        return self

    def run(self, seconds: float = 0.05) -> Result:
        def confirm(question: str) -> Any:
            self.asked = question
            return self.answer

        session = Session(self.plan, self.selection.bus.text, seconds, confirm=confirm, prove=self.prove)
        try:
            return session.render(nullcontext(Site(self.clock, {"can": self.bus}, {}, "")))
        finally:
            self.forger.shutdown()

    def when_left_alone(self, act: Callable[[], object]) -> None:
        """Do something 20 ms after the first set-point that asks for operation enabled."""
        due: list[int] = []

        def tapped(t_ns: int, can_id: int, data: bytes) -> None:
            if can_id == RPDO + 1 and data[0] == 0x0F and not due:
                due.append(t_ns + 20_000_000)
            elif len(due) == 1 and t_ns >= due[0]:
                due.append(t_ns)
                act()

        self.world.tap(tapped)

    # What the wire saw.

    def torques(self) -> list[int]:
        """Of all set-points that went out."""
        size = RPDO + 0x7F
        return [struct.unpack("<Hh", data)[1] for _, can_id, data in self.frames if RPDO < can_id <= size]

    def torques_of_the_proof(self) -> list[int]:
        """Of the set-points until the drive said that it lost its master, or all when it never did."""
        last_ns = max(self.losses(), default=None)
        return [
            struct.unpack("<Hh", data)[1]
            for t_ns, can_id, data in self.frames
            if RPDO < can_id <= RPDO + 0x7F and (last_ns is None or t_ns <= last_ns)
        ]

    def times(self, can_id: int) -> list[int]:
        return [t_ns for t_ns, each, _ in self.frames if each == can_id]

    def losses(self, node: int = 1) -> list[int]:
        """When a drive said that it lost its master [ns]."""
        return [
            t_ns
            for t_ns, can_id, data in self.frames
            if can_id == EMCY + node and int.from_bytes(data[:2], "little") == LOST_MASTER
        ]

    def written(self, index: int, subindex: int, node: int = 1) -> list[int]:
        """Values that were downloaded to an object."""
        head = index.to_bytes(2, "little") + bytes((subindex,))
        return [
            int.from_bytes(data[4:8], "little")
            for _, can_id, data in self.frames
            if can_id == 0x600 + node and data[0] >> 5 == 1 and data[1:4] == head
        ]

    def downloads(self, node: int = 1) -> set[tuple[int, int]]:
        """Objects to which something was downloaded."""
        return {
            (int.from_bytes(data[1:3], "little"), data[3])
            for _, can_id, data in self.frames
            if can_id == 0x600 + node and data[0] >> 5 == 1
        }

    def is_free(self, node: int = 1) -> bool:
        """Whether the motor of a drive is off."""
        return bool(self.world.slave(node).drive.objects.statusword.value & 0x6F != 0x27)

    def forge(self, can_id: int, data: bytes) -> None:
        """A frame of somebody else on the bus."""
        self.forger.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
