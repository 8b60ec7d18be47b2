"""A simulated bus with its drives, for one test: any program of the process can open it."""

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum
from itertools import count
from typing import Any

import can
import canopen

from haptic_fieldbus.clock import Clock, MonotonicClock, VirtualClock
from haptic_fieldbus.defaults import (
    DEFAULT_BIT_RATE,
    DEFAULT_DRIVE,
    DEFAULT_HOSTED_HAND,
    DEFAULT_NODE,
    DEFAULT_SEED,
)
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.bus import SimulatedBus, publish
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.channel import NamedDrive, slot_of
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.testing.drive import SimulatedDrive
from haptic_fieldbus.testing.fault_plan import FaultPlan
from haptic_fieldbus.testing.network import SteppedNetwork

_LONGEST = 100_000
"""Least number of latest frames and motion segments that are kept."""
_NUMBERS = count(1)
"""Numbers of the channels of this process, of which no two have the same name."""
_POLL = 0.001
"""Time between two looks of `wait_until` [s]."""
_NOTIFIER_CYCLE = 0.01
"""Longest time that canopen's receiving thread needs to end [s]; its own 1 s would be added to every test."""


class Time(Enum):
    """Whose time a bus has."""

    REAL = "real"
    """The wall clock's, for programs with threads of their own."""
    VIRTUAL = "virtual"
    """Time passes only while the program receives or waits, and then at once; for a single thread."""


@dataclass(frozen=True)
class DriveRequest:
    """One drive to put on the bus: the name or file of its profile, its node-ID, and the hand on its shaft."""

    profile: str | None = None
    """None: that of the bus on which nobody named one."""
    node: int = DEFAULT_NODE
    hand: str = DEFAULT_HOSTED_HAND
    workspace: str = Workspace.LINEAR.value
    profiles: str | None = None
    """Folder of own profiles (see `load_profile`)."""


class VirtualCanBus:
    """A simulated wire with drives. Use it in a `with` block, which closes what was opened through it."""

    def __init__(
        self,
        drives: Iterable[DriveRequest] = (DriveRequest(),),
        faults: FaultPlan | None = None,
        *,
        time: str = Time.REAL.value,
        bitrate: int = DEFAULT_BIT_RATE,
        seed: int = DEFAULT_SEED,
    ) -> None:
        """Switch the drives on; they are pre-operational at once.

        Raises UsageError for an unknown profile or hand, ProfileError or EdsError for a bad profile file, ValueError
        for an unknown time or workspace and when two drives have the same node-ID.
        """
        self.time = Time(time)
        self.clock: Clock = MonotonicClock() if self.time is Time.REAL else VirtualClock()
        self.faults = faults or FaultPlan()
        self.channel = f"simulated-{next(_NUMBERS)}"
        self.bitrate = bitrate
        self.seed = seed
        self._world = World(self.clock, bitrate, seed, _LONGEST)
        self.drives = {drive.node: self._add(drive) for drive in drives}
        self._networks: list[SteppedNetwork] = []
        self._stack = ExitStack()

    def __enter__(self) -> "VirtualCanBus":
        self._stack.enter_context(publish(self.channel, self._world))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def __str__(self) -> str:
        drives = "\n".join(f"node {node}: {drive.profile.title}" for node, drive in self.drives.items())
        return f"{drives}\n{self.time.value} time, {self.bitrate} bit/s, seed {self.seed}\n{self.faults.text}"

    @property
    def options(self) -> dict[str, Any]:
        """What a program gives to `can.Bus` or `canopen.Network.connect` to be on this wire."""
        return {"interface": "haptic_sim", "channel": self.channel, "bitrate": self.bitrate}

    def open(self, **options: Any) -> can.BusABC:
        """Return one more python-can bus on this wire; `options` are further ones of `can.Bus`."""
        return self._stack.enter_context(SimulatedBus(**{"channel": self.channel, "bitrate": self.bitrate, **options}))

    def network(self) -> canopen.Network:
        """Return a canopen network on this wire; in virtual time one without a thread (see `testing.network`)."""
        bus = self.open()
        if self.time is Time.VIRTUAL:
            stepped = SteppedNetwork(bus, self.clock)
            self._networks.append(stepped)
            return stepped
        network = canopen.Network(bus)
        network.NOTIFIER_CYCLE = _NOTIFIER_CYCLE
        network.connect()
        self._stack.callback(network.disconnect)
        return network

    def wait(self, seconds: float) -> None:
        """Let time pass [s]."""
        if self.time is Time.REAL:
            time.sleep(seconds)
            return
        self.clock.sleep_until(self.clock.now_ns() + round(seconds * 1e9))
        self._world.run()
        for network in self._networks:
            network.wait(0.0)

    def wait_until(self, condition: Callable[[], bool], longest: float = 1.0) -> bool:
        """Let time pass until the condition holds; False when it does not within `longest` s."""
        end_ns = self.clock.now_ns() + round(longest * 1e9)
        while not condition():
            if self.clock.now_ns() >= end_ns:
                return False
            self.wait(_POLL)
        return True

    def _add(self, request: DriveRequest) -> SimulatedDrive:
        slot = slot_of(
            NamedDrive(request.profile or DEFAULT_DRIVE, request.node),
            self.channel,
            Workspace(request.workspace),
            hand_named(request.hand),
            self.faults.faults,
            profiles=request.profiles,
        )
        return SimulatedDrive(self._world, self._world.add(slot), slot.profile)
