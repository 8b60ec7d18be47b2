"""The drives of a bench, their timers, and the faults that befall them.

Frames come from a wire, simulated or real, and wait in the ports for it. Everything random (serial number, where within
a count the encoder's zero lies, boot time) is drawn from the seed.
"""

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from random import Random

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.sim.drive import Drive
from haptic_fieldbus.sim.faults import Fault, LastingFault, TimedFault, faults_of
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.injection import Line, inject, install
from haptic_fieldbus.sim.link.frame import Frame
from haptic_fieldbus.sim.link.wire import NEVER_NS, Port
from haptic_fieldbus.sim.settings import DriveSettings

_START_JITTER_NS = 40_000
_RESET_NS = (20_000_000, 30_000_000)


@dataclass(frozen=True)
class Slot:
    """What is put on the bus under a node-ID; position [rad] and velocity [rad/s] are those of the shaft."""

    node: int
    profile: DriveProfile
    axis: RigAxis
    hand: Hand | None = None
    faults: tuple[Fault, ...] = ()
    position: float = 0.0
    velocity: float = 0.0
    booted: bool = True
    """The bench was switched on before the program came; False: now, the boot-up message is still to come."""


class Rack:
    """Drives by node-ID; all times are those of one clock [ns].

    `longest`: so much of the true motion, in segments, is kept at least; None: all of it.
    """

    def __init__(self, line: Line, seed: int | str = 0, longest: int | None = None) -> None:
        self.seed = seed
        self.drives: dict[int, Drive] = {}
        self.slaves: list[tuple[Port, Drive]] = []
        self.due_ns = NEVER_NS
        """When something is to be done without a frame."""
        self.on_enabled: Callable[[int, int], None] = _ignore
        """Called with (node, time) when a drive is first *operation enabled*."""
        self._line = line
        self._longest = longest
        self._agenda: list[tuple[int, int, Callable[[int], None]]] = []
        self._planned = 0

    def add(self, slot: Slot, port: Port, t_ns: int) -> Drive:
        """Power a drive that sends through this port; ValueError when the node-ID is taken."""
        self.check_free(slot.node)
        settings = replace(_drawn(self.seed, slot.node), position=slot.position, velocity=slot.velocity)
        drive = Drive(slot.node, slot.profile, slot.axis, port.send, slot.hand, settings, t_ns=t_ns)
        drive.plant.recorder.longest = self._longest
        timed: list[TimedFault] = []
        for fault in faults_of(slot.faults, slot.node):
            if isinstance(fault, LastingFault):
                install(fault, drive)
            else:
                timed.append(fault)
        drive.on_enabled = self._enabled(slot.node, drive, timed)
        self.drives[slot.node] = drive
        self.slaves.append((port, drive))
        drive.power_on(t_ns, booted=slot.booted)
        self.find_due()
        return drive

    def check_free(self, node: int) -> None:
        """ValueError when the node-ID is taken."""
        if node in self.drives:
            raise ValueError(f"node {node} is on this bus already")

    def receive(self, frame: Frame, sender: Port | None, t_ns: int) -> None:
        """A frame ended; every drive but its sender hears it."""
        for port, drive in self.slaves:
            if port is not sender:
                drive.receive(frame, t_ns)
        self.find_due()

    def timers(self, t_ns: int) -> None:
        """Do what is due."""
        while self._agenda and self._agenda[0][0] <= t_ns:
            heapq.heappop(self._agenda)[2](t_ns)
        for _port, drive in self.slaves:
            if drive.due_ns <= t_ns:
                drive.timer(t_ns)
        self.find_due()

    def find_due(self) -> None:
        """After anything that may have changed it."""
        due_ns = self._agenda[0][0] if self._agenda else NEVER_NS
        for _port, drive in self.slaves:
            due_ns = min(due_ns, drive.due_ns)
        self.due_ns = due_ns

    def plan(self, t_ns: int, action: Callable[[int], None]) -> None:
        """Do something at an instant, with that instant."""
        self._planned += 1
        heapq.heappush(self._agenda, (t_ns, self._planned, action))

    def _enabled(self, node: int, drive: Drive, faults: Iterable[TimedFault]) -> Callable[[int], None]:
        def enabled(t_ns: int) -> None:
            for fault in faults:
                self.plan(t_ns + round(fault.at * 1e9), _injection(fault, drive, self._line))
            self.on_enabled(node, t_ns)

        return enabled


def _injection(fault: TimedFault, drive: Drive, line: Line) -> Callable[[int], None]:
    return lambda t_ns: inject(fault, drive, line, t_ns)


def _drawn(seed: int | str, node: int) -> DriveSettings:
    """The random properties of one drive."""
    random = Random(f"{seed}/{node}")
    return DriveSettings(
        serial=random.getrandbits(32),
        encoder_phase=random.random() - 0.5,
        start_delay_ns=random.randrange(_START_JITTER_NS),
        reset_ns=random.randrange(*_RESET_NS),
    )


def _ignore(_node: int, _t_ns: int) -> None:
    """Nobody wants to know."""
