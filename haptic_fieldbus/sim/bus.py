"""The simulated wire as a python-can interface, `haptic_sim`, in stepped pace: time moves when a program receives.

The channel names the drives, `maxon_epos4@5,generic_cia402@6`: profile @ node-ID, on the shipped bench. Buses opened
with the same channel in one process share the wire.
"""

from dataclasses import dataclass

import can
from can.typechecking import CanFilters

from haptic_fieldbus.clock import Clock, VirtualClock
from haptic_fieldbus.drive.catalogue import load_profile
from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.controller import Received
from haptic_fieldbus.sim.frame import Frame
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.world import World

LONGEST_WAIT_NS = 60_000_000_000
"""A receive without time-out gives up after so much virtual time without a frame."""
_MAX_OCTETS = 8


@dataclass
class _Shared:
    """A world that several buses of one channel use."""

    world: World
    users: int = 0


# One channel name per process is one wire; python-can's interfaces have no other place to meet.
_CHANNELS: dict[str, _Shared] = {}


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
        receive_own_messages: bool = False,
        **kwargs: object,
    ) -> None:
        """With a `world`, its wire; else that of the channel's drives. can.CanInitializationError when impossible."""
        self._is_shutdown = True  # until the end of this method there is nothing to shut down
        self._channel = channel if world is None else None
        self.world = world or _shared_world(channel, bitrate, clock, seed, hand, workspace)
        self.channel_info = f"haptic_sim {channel}".rstrip()
        self._controller = self.world.attach(receive_own=receive_own_messages)
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
        """Queue a frame at the present; can.CanOperationError when it cannot be sent."""
        if msg.is_fd or msg.is_error_frame or msg.dlc > _MAX_OCTETS:
            raise can.CanOperationError("only classical data and remote frames can be sent")
        data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
        frame = Frame(msg.arbitration_id, data, msg.is_extended_id, msg.is_remote_frame)
        if not self.world.send(self._controller, frame):
            raise can.CanOperationError("the simulated controller is bus-off")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, or None at the deadline [s, virtual]; time goes along.

        Overridden because python-can's own measures the wall clock between attempts. Without a time-out
        can.CanOperationError when nothing will come, or nothing came in 60 s of virtual time.
        """
        world = self.world
        wait_ns = LONGEST_WAIT_NS if timeout is None else max(0, round(timeout * 1e9))
        deadline_ns = world.clock.now_ns() + wait_ns
        while True:
            if timeout is None and world.is_idle and not self._controller.received:
                raise can.CanOperationError("nothing will come: no frame is on its way and no drive has one to send")
            received = world.receive(self._controller, max(0, deadline_ns - world.clock.now_ns()))
            if received is None:
                break
            message = _message(received)
            if self._filters is None or self._matches_filters(message):
                return message
        if timeout is None:
            raise can.CanOperationError("nothing came in 60 s of virtual time")
        return None

    def shutdown(self) -> None:
        """Leave the wire; the last bus of a channel takes its world along."""
        if not self._is_shutdown:
            self.world.detach(self._controller)
            if self._channel is not None:
                _release(self._channel)
        super().shutdown()


def _message(received: Received) -> can.Message:
    t_ns, frame, own, error = received
    return can.Message(
        timestamp=t_ns * 1e-9,
        arbitration_id=frame.can_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_error_frame=error,
        is_rx=not own,
        dlc=len(frame.data),
        data=bytearray(frame.data),
    )


def _shared_world(channel: str, bitrate: int, clock: Clock | None, seed: int, hand: str, workspace: str) -> World:
    """The world of a channel, made by whoever comes first; the others must not ask for another one."""
    shared = _CHANNELS.get(channel)
    if shared is None:
        try:
            shared = _Shared(_new_world(channel, bitrate, clock or VirtualClock(), seed, hand, Workspace(workspace)))
        except (HapticFieldbusError, ValueError) as error:
            raise can.CanInitializationError(str(error)) from error
        _CHANNELS[channel] = shared
    elif (clock is not None and clock is not shared.world.clock) or bitrate != shared.world.bitrate:
        raise can.CanInitializationError(f'channel "{channel}" is open with another clock or bit rate')
    shared.users += 1
    return shared.world


def _release(channel: str) -> None:
    shared = _CHANNELS[channel]
    shared.users -= 1
    if not shared.users:
        del _CHANNELS[channel]


def _new_world(channel: str, bitrate: int, clock: Clock, seed: int, hand: str, workspace: Workspace) -> World:
    world = World(clock, bitrate, seed)
    for item in channel.split(","):
        name, _, number = item.strip().rpartition("@")
        if not name or not number.isdecimal() or not 1 <= int(number) <= 127:
            raise UsageError(f'"{item}": expected profile@node-ID, such as generic_cia402@5')
        axis = default_axis(workspace, bus=channel, node=int(number), profile=name)
        world.add_drive(int(number), load_profile(name), axis, hand_named(hand))
    return world
