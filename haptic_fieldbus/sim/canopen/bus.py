"""The simulated wire as a python-can interface, `haptic_sim`.

The channel names the drives as profile @ node-ID, `maxon_epos4@5,generic_cia402@6`, on the shipped bench. Programs that
open the same channel in one process share the wire. With the default clock, time follows the wall clock, for programs
with threads of their own. With a virtual clock, or on a `world` that has one, time advances only while the program
receives (see `pace`).
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import can
from can.typechecking import CanFilters

from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_HOSTED_HAND, DEFAULT_SEED
from haptic_fieldbus.errors import HapticFieldbusError, raise_all
from haptic_fieldbus.protocols.canopen.bus import SIMULATION_INTERFACE, CanSection
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.link import Frame, Received
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.host_request import collecting, drive_of, slot_of

_MAX_OCTETS = 8
_LONGEST = 100_000
"""Least number of latest frames and motion segments that a channel's world keeps; programs may run for days."""


@dataclass
class _Shared:
    """The world of one channel and the number of buses that use it."""

    world: World
    users: int = 0


# One channel name per process is one wire. python-can opens each bus on its own, so the buses of one channel can meet
# only in a module variable.
_CHANNELS: dict[str, _Shared] = {}
_CHANNELS_LOCK = threading.Lock()


class SimulatedBus(can.BusABC):
    """The connection of one program to the simulated wire."""

    def __init__(
        self,
        channel: str = "",
        can_filters: CanFilters | None = None,
        *,
        bitrate: int = DEFAULT_BIT_RATE,
        clock: Clock | None = None,
        world: World | None = None,
        seed: int = DEFAULT_SEED,
        hand: str = DEFAULT_HOSTED_HAND,
        workspace: str = "linear",
        profiles: str | None = None,
        receive_own_messages: bool = False,
        **kwargs: object,
    ) -> None:
        """Attach to the wire of `world`; without a world, to the wire of the drives that `channel` names.

        `profiles` is a folder of own profiles, which the channel may name (see `load_profile`).
        Raises can.CanInitializationError when these drives cannot be simulated, or when the channel is open with
        another clock or bit rate.
        """
        # BusABC.__del__ calls shutdown(), also after an __init__ that raised.
        self._is_shutdown = True  # until the end of this method there is nothing to shut down
        self._channel = channel if world is None else None

        def make(clock: Clock) -> World:
            made, place = World(clock, bitrate, seed, _LONGEST), (channel, Workspace(workspace), hand_named(hand))
            faults: list[str] = []
            for text in channel.split(","):
                with collecting(faults):
                    made.add(slot_of(drive_of(text), *place, profiles=profiles))
            raise_all(faults)
            return made

        self.world = world or _shared_world(channel, bitrate, clock, make)
        self.channel_info = f"haptic_sim {channel}".rstrip()
        self.pace = self.world.pace
        self.controller = self.pace.attach(receive_own=receive_own_messages)
        super().__init__(channel, can_filters, **kwargs)

    @property
    def state(self) -> can.BusState:
        """Return ERROR while the controller is bus-off, else ACTIVE."""
        return can.BusState.ERROR if self.controller.off else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise NotImplementedError("the state of the simulated controller cannot be set")

    @property
    def clock(self) -> Clock:
        """Return the clock of the simulated world."""
        return self.world.clock

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue a frame at the present time, waiting up to `timeout` [s] for room in the transmit queue.

        Raises can.CanOperationError for anything but a classical data or remote frame, while the controller is bus-off,
        when the queue is still full after `timeout`, and after `shutdown`.
        """
        if msg.is_fd or msg.is_error_frame or msg.dlc > _MAX_OCTETS:
            raise can.CanOperationError("only classical data and remote frames can be sent")
        data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
        frame = Frame(msg.arbitration_id, data, msg.is_extended_id, msg.is_remote_frame)
        self.pace.send(self.controller, frame, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, or None when none arrives within `timeout` [s]; None waits without limit.

        With a virtual clock this call advances the time. It overrides python-can's `recv`, which measures the wall
        clock between attempts. Raises can.CanOperationError when the bus is shut down meanwhile; with a virtual clock
        and no time-out also when no frame can come, or when none came within 60 s.
        """
        filters = self._filters
        accept = None if filters is None else lambda received: self._matches_filters(self._message(received))
        received = self.pace.receive(self.controller, timeout, accept)
        return None if received is None else self._message(received)

    def shutdown(self) -> None:
        """Leave the wire; the last bus of a channel also discards the channel's world."""
        if not self._is_shutdown:
            super().shutdown()  # first, for it stops the tasks that send
            self.pace.detach(self.controller)
            if self._channel is not None:
                _release(self._channel)

    def _message(self, received: Received) -> can.Message:
        t_ns, frame, own, error = received
        return can.Message(
            timestamp=self.pace.timestamp(t_ns),
            arbitration_id=frame.can_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            is_error_frame=error,
            is_rx=not own,
            dlc=len(frame.data),
            data=bytearray(frame.data),
        )


@contextmanager
def publish(channel: str, world: World) -> Iterator[None]:
    """Let programs of this process open `world` by the name of a channel, for a `with` block.

    Raises ValueError when the name is in use.
    """
    with _CHANNELS_LOCK:
        if channel in _CHANNELS:
            raise ValueError(f'channel "{channel}" is in use')
        _CHANNELS[channel] = _Shared(world, users=1)
    try:
        yield
    finally:
        _release(channel)


class EmbeddedSection(CanSection):
    """A simulated bus in real time. A run treats it as a real one: it asks, tests the watchdogs and waits."""

    @property
    def simulated(self) -> bool:
        return False

    @property
    def rehearsed(self) -> bool:
        return True


@contextmanager
def embedded_bus(
    slots: Sequence[DriveOnBus], seed: int = DEFAULT_SEED, bitrate: int = DEFAULT_BIT_RATE
) -> Iterator[CanSection]:
    """Host drives inside this program, by the wall clock, and yield the bus for its other parts.

    The drives need no thread: each access runs all due events, each at its own instant. So a watchdog fires on time
    even without access for a long time.
    """
    world = World(MonotonicClock(), bitrate, seed, _LONGEST)
    for slot in slots:
        world.add(slot).drive.plant.prepare()
    channel = ",".join(f"{slot.profile.name}@{slot.node}" for slot in slots)
    with publish(channel, world):
        # No adapter is between this program and its own drives.
        yield EmbeddedSection(SIMULATION_INTERFACE, channel, bitrate, adapter_latency=0.0)


def _shared_world(channel: str, bitrate: int, clock: Clock | None, make: Callable[[Clock], World]) -> World:
    """Return the world of a channel, made on the first call.

    Raises can.CanInitializationError when it cannot be made, or exists with another clock or bit rate. The `make` of a
    later caller is ignored.
    """
    with _CHANNELS_LOCK:
        if (shared := _CHANNELS.get(channel)) is None:
            try:
                world = make(clock or MonotonicClock())
            except (HapticFieldbusError, ValueError) as error:
                raise can.CanInitializationError(str(error)) from error
            shared = _CHANNELS[channel] = _Shared(world)
        elif (clock is not None and clock is not shared.world.clock) or bitrate != shared.world.bitrate:
            raise can.CanInitializationError(f'channel "{channel}" is open with another clock or bit rate')
        shared.users += 1
        return shared.world


def _release(channel: str) -> None:
    with _CHANNELS_LOCK:
        shared = _CHANNELS[channel]
        shared.users -= 1
        if not shared.users:
            del _CHANNELS[channel]
