"""The simulated world: drives and programs on one wire, as a discrete-event simulation.

Theory: an event is a frame that ends, a timer of a drive, a fault, or the start of a frame; at one instant they come in
this order, so that whatever is queued at an instant takes part in its arbitration. Plants are moved when a drive looks
at them, exactly (see `plant`). The world is lazy: it runs when a program sends (up to the present) or receives (up to
the next frame, or to the deadline, and the clock goes along). Everything random is drawn from the seed (see `rack`), so
in virtual time the same seed gives the same octets. How programs share it in real time is told in `pace`.

A bench with several buses is several worlds with one clock: nothing but a program joins them, so each may catch up when
it is touched, and what a program sees does not depend on the order.
"""

from collections import deque
from collections.abc import Callable, Iterable

from haptic_fieldbus.clock import Clock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_SEED
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link.controller import Controller, Received
from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.link.wire import Wire, WireStatistics
from haptic_fieldbus.sim.canopen.pace import Pace, pace_of
from haptic_fieldbus.sim.canopen.rack import Rack
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from haptic_fieldbus.sim.slot import Slot

Tap = Callable[[int, int, bytes], None]


class World:
    """Drives, wire and time; all times are those of the clock [ns].

    `longest`: so many frames and segments of motion are remembered at least; None: all, for a run that ends.
    """

    def __init__(
        self,
        clock: Clock,
        bitrate: int = DEFAULT_BIT_RATE,
        seed: int | str = DEFAULT_SEED,
        longest: int | None = None,
    ) -> None:
        self.clock = clock
        self.bitrate = bitrate
        self._wire = Wire(bitrate, longest)
        self._rack = Rack(self, seed, longest)
        self._now_ns = clock.now_ns()
        self._controllers: list[Controller] = []
        self._taps: list[Tap] = []
        self.pace: Pace = pace_of(self)
        """How programs use it."""

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
    ) -> Slave:
        """Put a drive on the wire; position [rad] and velocity [rad/s] are those of its shaft.

        The bench was switched on before the program came; `booted=False`: it is switched on now, so that the boot-up
        message is still to come.
        ValueError when the node-ID is taken.
        """
        return self.add(Slot(node, profile, axis, hand, tuple(faults), position, velocity, booted))

    def add(self, slot: Slot) -> Slave:
        """Put a drive on the wire; ValueError when the node-ID is taken."""
        self._rack.check_free(slot.node)
        self.run()
        slave = self._rack.add(slot, self._wire.attach(in_order=False), self._now_ns)
        slave.node.commission(self.bitrate)
        return slave

    def attach(self, *, receive_own: bool = False, room: int | None = None) -> Controller:
        """A program's end of the wire, with a first-in-first-out transmit queue as SocketCAN has."""
        controller = Controller(self._wire.attach(in_order=True), receive_own=receive_own, room=room)
        self._controllers.append(controller)
        return controller

    def detach(self, controller: Controller) -> None:
        """The program leaves; what it had queued is not sent."""
        controller.closed = True
        self._controllers.remove(controller)
        self._wire.detach(controller.port)

    def tap(self, callback: Tap) -> None:
        """Tell (end of frame [ns], identifier, octets) of every data frame on the wire."""
        self._taps.append(callback)

    # Looking at it.

    def slave(self, node: int) -> Slave:
        return self._rack.slaves[node]

    def trajectory(self, node: int) -> Trajectory:
        """The true motion of a shaft up to the present."""
        self.run()
        drive = self._rack.slaves[node].drive
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
    def next_ns(self) -> int:
        """When the next event is, if no program sends before; NEVER_NS: there will be none."""
        return min(self._rack.due_ns, self._wire.end_ns, self._wire.start_ns(self._now_ns))

    @property
    def is_idle(self) -> bool:
        """Whether nothing will ever happen unless a program sends."""
        return self.next_ns == NEVER_NS

    def _run(self, limit_ns: int, until: deque[Received] | None = None) -> None:
        """Events up to and including the limit, or until something was received."""
        wire, rack = self._wire, self._rack
        while not until:
            end_ns, due_ns = wire.end_ns, rack.due_ns
            t_ns = min(end_ns, due_ns) if end_ns != NEVER_NS else min(wire.start_ns(self._now_ns), due_ns)
            if t_ns > limit_ns:
                self._now_ns = max(self._now_ns, limit_ns)
                return
            self._now_ns = t_ns
            if end_ns == t_ns:
                self._deliver(t_ns)
            elif due_ns == t_ns:
                rack.timers(t_ns)
            else:
                wire.start(t_ns)

    def _deliver(self, t_ns: int) -> None:
        sender = self._wire.sender
        frame = self._wire.finish()
        self._rack.receive(frame, sender, t_ns)
        for controller in self._controllers:
            controller.frame_ended(frame, sender, t_ns)
        if not frame.remote:
            for tap in self._taps:
                tap(t_ns, frame.can_id, frame.data)

    # Faults.

    def bus_off(self, t_ns: int, until_ns: int) -> None:
        """Every program's controller goes bus-off (see `injection.Line`)."""
        for controller in self._controllers:
            controller.bus_off(t_ns)
            if until_ns != NEVER_NS:
                self._rack.plan(until_ns, controller.restarted)

    def error_frame(self, t_ns: int) -> None:
        """Every program's controller reports a disturbed frame."""
        for controller in self._controllers:
            controller.error_frame(t_ns)
