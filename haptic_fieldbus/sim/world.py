"""The simulated world: drives and programs on one wire, in virtual time, as a discrete-event simulation.

Theory: an event is a frame that ends, a timer of a drive, a fault, or the start of a frame; at one instant they come in
this order, so that whatever is queued at an instant takes part in its arbitration. Plants are moved when a drive looks
at them, exactly (see `plant`). The world is lazy: it runs when a program sends (up to the present) or receives (up to
the next frame, or to the deadline, and the clock goes along). Everything random (serial number, where within a count
the encoder's zero lies, boot time) is drawn from the seed, so the same seed gives the same octets.
"""

import heapq
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING

from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.sim.controller import Controller, Received
from haptic_fieldbus.sim.drive import Drive
from haptic_fieldbus.sim.faults import Fault, LastingFault, TimedFault, faults_of
from haptic_fieldbus.sim.frame import Frame
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.injection import inject, install
from haptic_fieldbus.sim.settings import DriveSettings
from haptic_fieldbus.sim.trajectory import Trajectory
from haptic_fieldbus.sim.wire import NEVER_NS, Port, Wire, WireStatistics

if TYPE_CHECKING:  # `bus` builds worlds, so it is imported by `World.bus` only when that is called
    from haptic_fieldbus.sim.bus import SimulatedBus

Tap = Callable[[int, int, bytes], None]

_START_JITTER_NS = 40_000
_RESET_NS = (20_000_000, 30_000_000)


class World:
    """Drives, wire and time; all times are those of the clock [ns]."""

    def __init__(self, clock: Clock, bitrate: int = 1_000_000, seed: int = 0) -> None:
        self.clock = clock
        self.bitrate = bitrate
        self.seed = seed
        self.on_enabled: Callable[[int, int], None] = _ignore
        """Called with (node, time) when a drive is first *operation enabled*."""
        self._wire = Wire(bitrate)
        self._now_ns = clock.now_ns()
        self._due_ns = NEVER_NS
        self._drives: dict[int, Drive] = {}
        self._slaves: list[tuple[Port, Drive]] = []
        self._controllers: list[Controller] = []
        self._taps: list[Tap] = []
        self._agenda: list[tuple[int, int, Callable[[int], None]]] = []
        self._planned = 0

    # Setting up.

    def add_drive(
        self,
        node: int,
        profile: DriveProfile,
        axis: RigAxis,
        hand: Hand | None = None,
        faults: Iterable[Fault] = (),
        *,
        position: float = 0.0,
        velocity: float = 0.0,
        booted: bool = True,
    ) -> Drive:
        """Put a drive on the wire; position [rad] and velocity [rad/s] are those of its shaft.

        The bench was switched on before the program came; `booted=False`: it is switched on now, so that the boot-up
        message is still to come.
        ValueError when the node-ID is taken.
        """
        if node in self._drives:
            raise ValueError(f"node {node} is on this bus already")
        self.run()
        port = self._wire.attach(in_order=False)
        settings = replace(_drawn(self.seed, node), position=position, velocity=velocity)
        drive = Drive(node, profile, axis, port.send, hand, settings, t_ns=self._now_ns)
        timed: list[TimedFault] = []
        for fault in faults_of(faults, node):
            if isinstance(fault, LastingFault):
                install(fault, drive)
            else:
                timed.append(fault)
        drive.on_enabled = self._enabled(node, drive, timed)
        self._drives[node] = drive
        self._slaves.append((port, drive))
        drive.power_on(self._now_ns, booted=booted)
        self._find_due()
        return drive

    def attach(self, *, receive_own: bool = False) -> Controller:
        """A program's end of the wire, with a first-in-first-out transmit queue as SocketCAN has."""
        controller = Controller(self._wire.attach(in_order=True), receive_own=receive_own)
        self._controllers.append(controller)
        return controller

    def detach(self, controller: Controller) -> None:
        """The program leaves; what it had queued is not sent."""
        self._controllers.remove(controller)
        self._wire.detach(controller.port)

    def bus(self, *, receive_own_messages: bool = False) -> "SimulatedBus":
        """A python-can bus on this world."""
        from haptic_fieldbus.sim.bus import SimulatedBus

        return SimulatedBus(world=self, receive_own_messages=receive_own_messages)

    def tap(self, callback: Tap) -> None:
        """Tell (end of frame [ns], identifier, octets) of every data frame on the wire."""
        self._taps.append(callback)

    # Looking at it.

    def drive(self, node: int) -> Drive:
        return self._drives[node]

    def trajectory(self, node: int) -> Trajectory:
        """The true motion of a shaft up to the present."""
        self.run()
        drive = self._drives[node]
        drive.servo.advance(self._now_ns)
        return Trajectory(drive.plant.recorder, self._now_ns)

    def statistics(self, from_ns: int, to_ns: int) -> WireStatistics:
        """What the wire carried."""
        return self._wire.statistics(from_ns, to_ns)

    # Running.

    def run(self) -> None:
        """Catch up with the clock."""
        self._run(self.clock.now_ns())

    def send(self, controller: Controller, frame: Frame) -> bool:
        """Queue a frame at the present; False when the controller is bus-off."""
        now_ns = self.clock.now_ns()
        self._run(now_ns - 1)
        self._now_ns = max(self._now_ns, now_ns)
        if not controller.off:
            controller.port.send(frame)
        return not controller.off

    def receive(self, controller: Controller, timeout_ns: int) -> Received | None:
        """The next frame for this controller; the clock goes to its end, or to the deadline when there is none."""
        received = controller.received
        if not received:
            deadline_ns = self.clock.now_ns() + timeout_ns
            self._run(deadline_ns, received)
            if not received:
                self.clock.sleep_until(deadline_ns)
                return None
        item = received.popleft()
        self.clock.sleep_until(item.t_ns)
        return item

    @property
    def is_idle(self) -> bool:
        """Whether nothing will ever happen unless a program sends."""
        return min(self._due_ns, self._wire.end_ns, self._wire.start_ns(self._now_ns)) == NEVER_NS

    def _run(self, limit_ns: int, until: deque[Received] | None = None) -> None:
        """Events up to and including the limit, or until something was received."""
        wire = self._wire
        while not until:
            end_ns, due_ns = wire.end_ns, self._due_ns
            t_ns = min(end_ns, due_ns) if end_ns != NEVER_NS else min(wire.start_ns(self._now_ns), due_ns)
            if t_ns > limit_ns:
                self._now_ns = max(self._now_ns, limit_ns)
                return
            self._now_ns = t_ns
            if end_ns == t_ns:
                self._deliver(t_ns)
            elif due_ns == t_ns:
                self._timers(t_ns)
            else:
                wire.start(t_ns)

    def _deliver(self, t_ns: int) -> None:
        sender = self._wire.sender
        frame = self._wire.finish()
        for port, drive in self._slaves:
            if port is not sender:
                drive.receive(frame, t_ns)
        for controller in self._controllers:
            controller.frame_ended(frame, sender, t_ns)
        if not frame.remote:
            for tap in self._taps:
                tap(t_ns, frame.can_id, frame.data)
        self._find_due()

    def _timers(self, t_ns: int) -> None:
        while self._agenda and self._agenda[0][0] <= t_ns:
            heapq.heappop(self._agenda)[2](t_ns)
        for _port, drive in self._slaves:
            if drive.due_ns <= t_ns:
                drive.timer(t_ns)
        self._find_due()

    def _find_due(self) -> None:
        due_ns = self._agenda[0][0] if self._agenda else NEVER_NS
        for _port, drive in self._slaves:
            due_ns = min(due_ns, drive.due_ns)
        self._due_ns = due_ns

    # Faults.

    def bus_off(self, t_ns: int, until_ns: int) -> None:
        """Every program's controller goes bus-off (see `injection.Line`)."""
        for controller in self._controllers:
            controller.bus_off(t_ns)
            if until_ns != NEVER_NS:
                self._plan(until_ns, controller.restarted)

    def error_frame(self, t_ns: int) -> None:
        """Every program's controller reports a disturbed frame."""
        for controller in self._controllers:
            controller.error_frame(t_ns)

    def _enabled(self, node: int, drive: Drive, faults: list[TimedFault]) -> Callable[[int], None]:
        def enabled(t_ns: int) -> None:
            for fault in faults:
                self._plan(t_ns + round(fault.at * 1e9), _injection(fault, drive, self))
            self.on_enabled(node, t_ns)

        return enabled

    def _plan(self, t_ns: int, action: Callable[[int], None]) -> None:
        self._planned += 1
        heapq.heappush(self._agenda, (t_ns, self._planned, action))


def _injection(fault: TimedFault, drive: Drive, world: World) -> Callable[[int], None]:
    return lambda t_ns: inject(fault, drive, world, t_ns)


def _drawn(seed: int, node: int) -> DriveSettings:
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
