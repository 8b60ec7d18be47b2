"""The simulated wire as a python-can interface, `haptic_sim`.

The channel names the drives, `maxon_epos4@5,generic_cia402@6`: profile @ node-ID, on the shipped bench. Buses opened
with the same channel in one process share the wire. Time follows the wall clock, for programs with threads of their
own; with a virtual clock, or on a world that has one, it moves when the program receives (see `pace`).
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import can
from can.typechecking import CanFilters

from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.channel import drives_of, slot_of
from haptic_fieldbus.sim.canopen.link.controller import Received
from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.hand import hand_named

_MAX_OCTETS = 8
_LONGEST = 100_000
"""Frames and segments of motion that a channel's world remembers at least: a program may run for days."""


@dataclass
class _Shared:
    """A world that several buses of one channel use."""

    world: World
    users: int = 0


# One channel name per process is one wire; python-can's interfaces have no other place to meet.
_CHANNELS: dict[str, _Shared] = {}
_CHANNELS_LOCK = threading.Lock()


class SimulatedBus(can.BusABC):
    """A program's end of the simulated wire."""

    def __init__(
        self,
        channel: str = "",
        can_filters: CanFilters | None = None,
        *,
        bitrate: int = 1_000_000,
        clock: Clock | None = None,
        world: World | None = None,
        seed: int = 0,
        hand: str = "none",
        workspace: str = "linear",
        profiles: str | None = None,
        receive_own_messages: bool = False,
        **kwargs: object,
    ) -> None:
        """With a `world`, its wire; else that of the channel's drives. can.CanInitializationError when impossible.

        `profiles` is a folder of one's own profiles, which the channel may name (see `load_profile`).
        """
        self._is_shutdown = True  # until the end of this method there is nothing to shut down
        self._channel = channel if world is None else None
        self.world = world or _shared_world(
            channel, bitrate, clock, partial(_new_world, channel, bitrate, seed, hand, workspace, profiles)
        )
        self.channel_info = f"haptic_sim {channel}".rstrip()
        self._pace = self.world.pace
        self._controller = self._pace.attach(receive_own=receive_own_messages)
        super().__init__(channel, can_filters, **kwargs)

    @property
    def state(self) -> can.BusState:
        """ERROR while the controller is bus-off."""
        return can.BusState.ERROR if self._controller.off else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise NotImplementedError("the state of the simulated controller cannot be set")

    @property
    def clock(self) -> Clock:
        """Whose time it is."""
        return self.world.clock

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue a frame at the present; can.CanOperationError when it cannot be sent.

        `timeout` [s] is for room in the transmit queue.
        """
        if msg.is_fd or msg.is_error_frame or msg.dlc > _MAX_OCTETS:
            raise can.CanOperationError("only classical data and remote frames can be sent")
        data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
        frame = Frame(msg.arbitration_id, data, msg.is_extended_id, msg.is_remote_frame)
        self._pace.send(self._controller, frame, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, or None at the deadline [s]; in virtual time, time goes along.

        Overridden because python-can's own measures the wall clock between attempts. can.CanOperationError when the bus
        is shut down meanwhile; in virtual time without a time-out also when nothing will come, or nothing came in 60 s.
        """
        accept = self._is_accepted if self._filters is not None else None
        received = self._pace.receive(self._controller, timeout, accept)
        return None if received is None else self._message(received)

    def shutdown(self) -> None:
        """Leave the wire; the last bus of a channel takes its world along."""
        if not self._is_shutdown:
            super().shutdown()  # first, for it stops the tasks that send
            self._pace.detach(self._controller)
            if self._channel is not None:
                _release(self._channel)

    def _is_accepted(self, received: Received) -> bool:
        return self._matches_filters(self._message(received))

    def _message(self, received: Received) -> can.Message:
        t_ns, frame, own, error = received
        return can.Message(
            timestamp=self._pace.timestamp(t_ns),
            arbitration_id=frame.can_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            is_error_frame=error,
            is_rx=not own,
            dlc=len(frame.data),
            data=bytearray(frame.data),
        )


def _shared_world(channel: str, bitrate: int, clock: Clock | None, make: Callable[[Clock], World]) -> World:
    """The world of a channel, made by whoever comes first; the others must not ask for another one."""
    with _CHANNELS_LOCK:
        shared = _CHANNELS.get(channel)
        if shared is None:
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


def _new_world(
    channel: str, bitrate: int, seed: int, hand: str, workspace: str, profiles: str | None, clock: Clock
) -> World:
    world = World(clock, bitrate, seed, _LONGEST)
    for drive in drives_of(channel):
        world.add(slot_of(drive, channel, Workspace(workspace), hand_named(hand), profiles=profiles))
    return world
