"""The simulated world: drives and programs on one wire, as a discrete-event simulation.

Theory: an event is a frame that ends, a timer of a drive, a fault, or the start of a frame. Events at the same instant
happen in this order, so every frame queued at an instant takes part in its arbitration. Plants are moved, exactly, when
a drive reads them (see `plant`). The world is lazy: it runs when a program sends (up to the present) or receives (up to
the next frame, or to the deadline, and the clock advances with it). Everything random is drawn from the seed (see
`drives`), so in virtual time the same seed gives the same octets. `pace` describes how programs share the world in real
time.

A bench with several buses consists of several worlds with one clock. Only a program connects them, so each world
catches up when it is called, and the order does not matter to the program.
"""

import errno
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import can

from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_SEED
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import DrivenBus, until
from haptic_fieldbus.sim.canopen.drives import SimulatedDrives
from haptic_fieldbus.sim.canopen.link import Controller, Frame, Port, Received, Wire, WireStatistics, frames_arriving
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import Disturbance, HostFault, LineFault
from haptic_fieldbus.sim.simulation import HostClock

# The pace of a world: its time is advanced by the programs that wait in it, or follows the wall clock.
#
# Theory: a world has no thread of its own; it runs its events only when a program calls it. *Stepped*, one thread uses
# it and its clock is virtual: receiving advances the time, so nothing depends on the machine. *Paced*, the clock is the
# machine's, and any number of threads use the world at once under one lock with a condition. Every call first runs the
# events that have fallen due, each at its own instant. A waiting thread sleeps until the next event or its own
# deadline, whichever is sooner. A frame that is sent may cause an earlier event, so sending wakes all waiting threads.

Accept = Callable[[Received], bool]
"""Predicate on a received frame: True when the program wants it."""

LONGEST_WAIT_NS = 60_000_000_000
"""Stepped: virtual time without a frame after which a receive without time-out gives up."""
RECEIVE_ROOM = 1024
"""Paced: frames that a controller holds for its program; while these are not read, further frames are lost."""
TRANSMIT_ROOM = 1000
"""Paced: frames that may wait to be sent; 1000 is the queue length recommended for SocketCAN."""
_NAP = 3600.0
"""Longest single sleep [s]; Python refuses time-outs beyond some large limit."""
_LEAVING_NS = 200_000_000
"""Paced: longest time that a leaving program waits until its last frames are sent."""


class Stepped:
    """The pace of virtual time, for one thread. Time-outs are in s; None waits for ever."""

    def __init__(self, world: "World") -> None:
        self._world = world

    def attach(self, *, receive_own: bool) -> Controller:
        """Connect a program to the wire and return its controller."""
        return self._world.attach(receive_own=receive_own)

    def detach(self, controller: Controller) -> None:
        """Disconnect a program; threads that wait for its frames are woken."""
        self._world.detach(controller)

    def send(self, controller: Controller, frame: Frame, timeout: float | None) -> None:
        """Queue a frame at the present time; raises can.CanOperationError when the controller does not take it."""
        if not self._world.send(controller, frame):
            raise _refused(controller)

    def receive(self, controller: Controller, timeout: float | None, accept: Accept | None) -> Received | None:
        """Return the next accepted frame, None at the deadline; raises can.CanOperationError when none can come."""
        if controller.down:
            raise _refused(controller)
        world = self._world
        wait_ns = LONGEST_WAIT_NS if timeout is None else max(0, round(timeout * 1e9))
        if timeout is not None and accept is None:  # fast path: the loop receives like this in every period
            return world.receive(controller, wait_ns)
        deadline_ns = world.clock.now_ns() + wait_ns
        while True:
            if timeout is None and world.next_ns == NEVER_NS and not controller.received:
                raise can.CanOperationError("nothing will arrive: no frame is under way, and no drive has one to send")
            if (item := world.receive(controller, max(0, deadline_ns - world.clock.now_ns()))) is None:
                break
            if accept is None or accept(item):
                return item
        if timeout is None:
            raise can.CanOperationError("nothing arrived within 60 s of virtual time")
        return None

    def timestamp(self, t_ns: int) -> float:
        """Return the timestamp [s] of a message for an instant of the world's clock."""
        return t_ns * 1e-9

    @contextmanager
    def held(self) -> Iterator[None]:
        """Bring the world to the present and hold it there for a `with` block, in which it may be read and changed."""
        self._world.run()
        yield


class PacedByClock:
    """The pace of the wall clock, for any number of threads; its methods are those of `Stepped`."""

    def __init__(self, world: "World") -> None:
        self._world = world
        self._turn = threading.Condition()
        # python-can's timestamps count from the Unix epoch, the world's clock from an instant of its own.
        self._epoch_ns = time.time_ns() - world.clock.now_ns()

    def attach(self, *, receive_own: bool) -> Controller:
        with self._turn:
            self._world.run()
            return self._world.attach(receive_own=receive_own, room=RECEIVE_ROOM)

    def detach(self, controller: Controller) -> None:
        with self._turn:
            # A program often sends a last command and leaves at once; the frame should still go out.
            self._wait_while(lambda: bool(controller.port.waiting), _LEAVING_NS)
            self._world.detach(controller)
            self._turn.notify_all()

    def send(self, controller: Controller, frame: Frame, timeout: float | None) -> None:
        def full() -> bool:
            return len(controller.port.waiting) >= TRANSMIT_ROOM and not controller.closed

        with self._turn:
            if full():
                self._wait_while(full, max(0, round((timeout or 0.0) * 1e9)))
                if full():
                    raise can.CanOperationError("the transmit queue is full", errno.ENOBUFS)
            _check_open(controller)
            if not self._world.send(controller, frame):
                raise _refused(controller)
            # The frame may cause an event earlier than the one that the waiting threads sleep until.
            self._turn.notify_all()

    def receive(self, controller: Controller, timeout: float | None, accept: Accept | None) -> Received | None:
        found: list[Received] = []

        def wanted() -> bool:
            _check_open(controller)
            while controller.received:
                item = controller.received.popleft()
                if accept is None or accept(item):
                    found.append(item)
                    return False
            return True

        with self._turn:
            wait_ns = NEVER_NS if timeout is None else max(0, round(timeout * 1e9))
            self._wait_while(wanted, wait_ns)
        return found[0] if found else None

    def timestamp(self, t_ns: int) -> float:
        return (t_ns + self._epoch_ns) * 1e-9

    @contextmanager
    def held(self) -> Iterator[None]:
        with self._turn:
            self._world.run()
            yield
            # What was changed may cause an event earlier than the one that the waiting threads sleep until.
            self._turn.notify_all()

    def _wait_while(self, condition: Callable[[], bool], wait_ns: int) -> None:
        """Let time pass, from event to event, while the condition holds and the wait is not over."""
        world = self._world
        deadline_ns = min(NEVER_NS, world.clock.now_ns() + wait_ns)
        while True:
            # Read before the events run: at the deadline, all events up to it have happened when the condition is
            # judged.
            now_ns = world.clock.now_ns()
            world.run()
            if not condition() or now_ns >= deadline_ns:
                return
            remaining_ns = min(deadline_ns, world.next_ns) - world.clock.now_ns()
            if remaining_ns > 0:
                self._turn.wait(min(remaining_ns * 1e-9, _NAP))


def pace_of(world: "World") -> Stepped | PacedByClock:
    """Return the pace for a world's clock: a MonotonicClock is followed, any other clock is advanced."""
    return PacedByClock(world) if isinstance(world.clock, MonotonicClock) else Stepped(world)


def _check_open(controller: Controller) -> None:
    if controller.closed:
        raise can.CanOperationError("the bus has been shut down")


def _refused(controller: Controller) -> can.CanOperationError:
    """Return the error of a controller that takes no frame."""
    if controller.down:
        return can.CanOperationError("Network is down", errno.ENETDOWN)
    return can.CanOperationError("the simulated controller is bus-off")


Tap = Callable[[int, int, bytes], None]
"""Callback for a data frame: end of frame [ns], identifier, octets."""

Watch = Callable[[int, Frame, Port | None], None]
"""Callback for a frame of any kind: end of frame [ns], the frame as it was sent, and the port that sent it."""


class World(DrivenBus):
    """Drives, wire and time; all times are those of the clock [ns].

    At least the `longest` latest frames and motion segments are kept; None: all, for a run that ends.
    """

    def __init__(
        self, clock: Clock, bitrate: int = DEFAULT_BIT_RATE, seed: int | str = DEFAULT_SEED, longest: int | None = None
    ) -> None:
        self.clock = clock
        self.bitrate = bitrate
        self._wire = Wire(bitrate, longest)
        self._drives = SimulatedDrives(seed, longest)
        self._drives.inject_line = self.inject_line
        super().__init__(self._drives)
        self._now_ns = clock.now_ns()
        self._controllers: list[Controller] = []
        self._taps: list[Tap] = []
        self._watches: list[Watch] = []
        self._disturbances: list[Disturbance] = []
        self._stranger: Port | None = None
        """Port of another program whose frames are a fault."""
        self.host: HostClock | None = None
        """Clock of the computer of the master, where its faults take effect; None: there is no such clock."""
        self.adapter_ns = 0
        """Time that the adapter of a program adds to each frame on its way in, and on its way out [ns]."""
        self.pace = pace_of(self)
        """The way in which programs use this world."""

    # Setting up.

    def add(self, slot: DriveOnBus) -> Slave:
        """Put a drive on the wire; raises UsageError (see `DriveBench.check`)."""
        # Before a port is attached, which a refused drive would leave behind.
        self._drives.check(slot)
        self.run()
        slave = self._drives.add(slot, self._wire.attach(in_order=False), self._now_ns)
        slave.node.commission(self.bitrate)
        return slave

    def attach(self, *, receive_own: bool = False, room: int | None = None) -> Controller:
        """Connect a program to the wire, with a first-in-first-out transmit queue as in SocketCAN."""
        controller = Controller(self._wire.attach(in_order=True), receive_own=receive_own, room=room)
        self._controllers.append(controller)
        return controller

    def detach(self, controller: Controller) -> None:
        """Disconnect a program; frames that it had queued are not sent."""
        controller.closed = True
        self._controllers.remove(controller)
        self._wire.detach(controller.port)

    def tap(self, callback: Tap) -> None:
        """Call `callback` with (end of frame [ns], identifier, octets) of every data frame on the wire."""
        self._taps.append(callback)

    def watch(self, callback: Watch) -> None:
        """Call `callback` with (end of frame [ns], frame, port of the sender) of every frame on the wire."""
        self._watches.append(callback)

    # Looking at it.

    def slave(self, node: int) -> Slave:
        return self._drives.slaves[node]

    def forget(self, before_ns: int) -> None:
        """Drop the motion and the traffic before an instant [ns]."""
        super().forget(before_ns)
        self._wire.forget(before_ns)

    def statistics(self, from_ns: int, to_ns: int) -> WireStatistics:
        """Return the traffic of the frames that end in (from_ns, to_ns]."""
        return self._wire.statistics(from_ns, to_ns)

    # Running.

    def run(self) -> None:
        """Run all events up to the present of the clock."""
        self._run(self.clock.now_ns())

    def send(self, controller: Controller, frame: Frame) -> bool:
        """Queue a frame at the present time; False when the controller is bus-off."""
        now_ns = self.clock.now_ns()
        # Events of this very instant come later, so that the frame takes part in their arbitration.
        self._run(now_ns - 1)
        if now_ns > self._now_ns:
            self._now_ns = now_ns
        if controller.off:
            return False
        if self.adapter_ns:
            self._drives.plan(now_ns + self.adapter_ns, lambda _t_ns: controller.port.send(frame))
            self._drives.find_due()
        else:
            controller.port.send(frame)
        return True

    def receive(self, controller: Controller, timeout_ns: int) -> Received | None:
        """Return the next frame for this controller, None when none ends within `timeout_ns`.

        The clock advances to the end of the frame, or to the deadline.
        """
        if not (received := controller.received):
            deadline_ns = self.clock.now_ns() + timeout_ns
            self._run(deadline_ns, received)
            if not received:
                self.clock.sleep_until(deadline_ns)
                return None
        item = received.popleft()
        self.clock.sleep_until(item.t_ns)
        return item

    @property
    def reached_ns(self) -> int:
        return self._now_ns

    @property
    def next_ns(self) -> int:
        """Return the time of the next event, if no program sends before it; NEVER_NS if there is no further event."""
        return min(self._drives.due_ns, self._wire.end_ns, self._wire.start_ns(self._now_ns))

    def _run(self, limit_ns: int, until: deque[Received] | None = None) -> None:
        """Run the events up to and including the limit, or until a frame was received."""
        wire, drives = self._wire, self._drives
        while not until:
            # No arbitration can start while a frame is on the wire.
            end_ns, due_ns = wire.end_ns, drives.due_ns
            t_ns = end_ns if end_ns != NEVER_NS else wire.start_ns(self._now_ns)
            if due_ns < t_ns:
                t_ns = due_ns
            if t_ns > limit_ns:
                if limit_ns > self._now_ns:
                    self._now_ns = limit_ns
                return
            self._now_ns = t_ns
            # The order of events at one instant, as stated in the theory above.
            if end_ns == t_ns:
                self._deliver(t_ns)
            # A frame starts last, after all frames of this instant have been queued.
            elif due_ns == t_ns:
                drives.timers(t_ns)
            else:
                wire.start(t_ns)
                # Mostly nothing happens before the frame ends, and the program waits for it.
                if (end_ns := wire.end_ns) < drives.due_ns and end_ns <= limit_ns:
                    self._now_ns = end_ns
                    self._deliver(end_ns)

    def _deliver(self, t_ns: int) -> None:
        frame, sender = self._wire.finish(), self._wire.sender
        if self._disturbances:
            for later_ns, arriving in frames_arriving(self._disturbances, frame):
                if later_ns:
                    self._drives.plan(t_ns + later_ns, partial(self._pass_on, arriving, sender))
                else:
                    self._pass_on(arriving, sender, t_ns)
            self._drives.find_due()
        else:
            self._pass_on(frame, sender, t_ns)
        # Taps see what was sent, whatever arrives of it.
        for watch in self._watches:
            watch(t_ns, frame, sender)
        if self._taps and not frame.remote:
            for tap in self._taps:
                tap(t_ns, frame.can_id, frame.data)

    def _pass_on(self, frame: Frame, sender: Port | None, t_ns: int) -> None:
        self._drives.receive(frame, sender, t_ns)
        if not self.adapter_ns:
            for controller in self._controllers:
                controller.frame_ended(frame, sender, t_ns)
            return
        for controller in self._controllers:
            self._drives.plan(t_ns + self.adapter_ns, partial(controller.frame_ended, frame, sender))
        self._drives.find_due()

    # Faults.

    def inject_line(self, fault: LineFault | HostFault, t_ns: int) -> None:
        """Apply a fault of the bus or of the host that happens at `t_ns`.

        Raises ValueError for one of the host when its clock is not simulated.
        """
        match fault:
            case faults.BusOff(duration=duration):
                for controller in self._controllers:
                    controller.bus_off(t_ns)
                    self._drives.plan(until(t_ns, duration), controller.restarted)
            case faults.InterfaceDown(duration=duration):
                for controller in self._controllers:
                    controller.interface_down()
                    self._drives.plan(until(t_ns, duration), controller.interface_up)
            case faults.ErrorFrame():
                for controller in self._controllers:
                    controller.error_frame(t_ns)
            case faults.ForeignFrame(can_id=can_id, data=data, count=count, interval=interval):
                if self._stranger is None:
                    self._stranger = self._wire.attach(in_order=False)
                self._stranger.send(Frame(can_id, bytes(data)))
                if count > 1:
                    self._drives.plan(until(t_ns, interval), partial(self.inject_line, replace(fault, count=count - 1)))
            case faults.HostLate() | faults.HostPaused() | faults.ClockStep() | faults.SlowCompute():
                if self.host is None:
                    raise ValueError(f'fault "{fault.kind}" needs a simulated clock of the host')
                self.host.happen(fault)
            case _:
                self._disturbances.append(fault)
