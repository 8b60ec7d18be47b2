"""The pace of a world: its time is advanced by the programs that wait in it, or follows the wall clock.

Theory: a world has no thread of its own; it runs its events only when a program calls it. *Stepped*, one thread uses it
and its clock is virtual: receiving advances the time, so nothing depends on the machine. *Paced*, the clock is the
machine's, and any number of threads use the world at once under one lock with a condition. Every call first runs the
events that have fallen due, each at its own instant. A waiting thread sleeps until the next event or its own deadline,
whichever is sooner. A frame that is sent may cause an earlier event, so sending wakes all waiting threads.
"""

import errno
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

import can

from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link.controller import Controller, Received
from haptic_fieldbus.sim.canopen.link.frame import Frame

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


class LazyWorld(Protocol):
    """The part of a world that its pace uses."""

    @property
    def clock(self) -> Clock: ...

    @property
    def next_ns(self) -> int: ...

    @property
    def is_idle(self) -> bool: ...

    def attach(self, *, receive_own: bool = False, room: int | None = None) -> Controller: ...

    def detach(self, controller: Controller) -> None: ...

    def run(self) -> None: ...

    def send(self, controller: Controller, frame: Frame) -> bool: ...

    def receive(self, controller: Controller, timeout_ns: int) -> Received | None: ...


class Pace(Protocol):
    """The way in which programs use a world. Time-outs are in s; None waits for ever."""

    def attach(self, *, receive_own: bool) -> Controller:
        """Connect a program to the wire and return its controller."""

    def detach(self, controller: Controller) -> None:
        """Disconnect a program; threads that wait for its frames are woken."""

    def send(self, controller: Controller, frame: Frame, timeout: float | None) -> None:
        """Queue a frame at the present time; raises can.CanOperationError when the controller does not take it."""

    def receive(self, controller: Controller, timeout: float | None, accept: Accept | None) -> Received | None:
        """Return the next accepted frame, None at the deadline; raises can.CanOperationError when none can come."""

    def timestamp(self, t_ns: int) -> float:
        """Return the timestamp [s] of a message for an instant of the world's clock."""

    def held(self) -> AbstractContextManager[None]:
        """Bring the world to the present and hold it there for a `with` block, in which it may be read and changed."""


def pace_of(world: LazyWorld) -> Pace:
    """Return the pace for a world's clock: a MonotonicClock is followed, any other clock is advanced."""
    return PacedByClock(world) if isinstance(world.clock, MonotonicClock) else Stepped(world)


class Stepped:
    """The pace of virtual time, for one thread."""

    def __init__(self, world: LazyWorld) -> None:
        self._world = world

    def attach(self, *, receive_own: bool) -> Controller:
        return self._world.attach(receive_own=receive_own)

    def detach(self, controller: Controller) -> None:
        self._world.detach(controller)

    def send(self, controller: Controller, frame: Frame, timeout: float | None) -> None:
        if not self._world.send(controller, frame):
            raise _refused(controller)

    def receive(self, controller: Controller, timeout: float | None, accept: Accept | None) -> Received | None:
        if controller.down:
            raise _refused(controller)
        world = self._world
        wait_ns = LONGEST_WAIT_NS if timeout is None else max(0, round(timeout * 1e9))
        if timeout is not None and accept is None:  # fast path: the loop receives like this in every period
            return world.receive(controller, wait_ns)
        deadline_ns = world.clock.now_ns() + wait_ns
        while True:
            if timeout is None and world.is_idle and not controller.received:
                raise can.CanOperationError("nothing will come: no frame is on its way and no drive has one to send")
            item = world.receive(controller, max(0, deadline_ns - world.clock.now_ns()))
            if item is None:
                break
            if accept is None or accept(item):
                return item
        if timeout is None:
            raise can.CanOperationError("nothing came in 60 s of virtual time")
        return None

    def timestamp(self, t_ns: int) -> float:
        return t_ns * 1e-9

    @contextmanager
    def held(self) -> Iterator[None]:
        self._world.run()
        yield


class PacedByClock:
    """The pace of the wall clock, for any number of threads."""

    def __init__(self, world: LazyWorld) -> None:
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
        with self._turn:
            if len(controller.port.waiting) >= TRANSMIT_ROOM:
                self._make_room(controller, timeout)
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

    def _make_room(self, controller: Controller, timeout: float | None) -> None:
        def full() -> bool:
            return len(controller.port.waiting) >= TRANSMIT_ROOM and not controller.closed

        self._wait_while(full, max(0, round((timeout or 0.0) * 1e9)))
        if full():
            raise can.CanOperationError("the transmit queue is full", errno.ENOBUFS)

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


def _check_open(controller: Controller) -> None:
    if controller.closed:
        raise can.CanOperationError("the bus has been shut down")


def _refused(controller: Controller) -> can.CanOperationError:
    """Return the error of a controller that takes no frame."""
    if controller.down:
        return can.CanOperationError("Network is down", errno.ENETDOWN)
    return can.CanOperationError("the simulated controller is bus-off")
