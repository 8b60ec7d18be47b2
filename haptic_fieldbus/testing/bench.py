"""A simulated bus with its drives, for one test: any program of the process can open it."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from enum import Enum
from itertools import count
from pathlib import Path
from random import SystemRandom
from typing import Any, ClassVar, TypeVar

import can
import canopen
from canopen.network import PeriodicMessageTask

from haptic_fieldbus.clock import Clock, MonotonicClock, VirtualClock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_DRIVE, DEFAULT_HOSTED_HAND, DEFAULT_NODE, DEFAULT_SEED
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.errors import UsageError, raise_all, wrong_kind
from haptic_fieldbus.protocols.canopen.bus import BITRATES, NODES
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.bus import SimulatedBus, publish
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.dictionary import AccessRefused
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import (
    DriveFault,
    DriveFaultKind,
    Fault,
    HostFault,
    LineFault,
    checked_faults,
    load_faults,
    of_no_drive,
    toml_of,
)
from haptic_fieldbus.sim.faults.drawing import ANSWER_RECIPES, RANDOM, RECIPES, drawn, seed_of
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.host_request import NamedDrive, collecting, slot_of

# A simulated drive as a test sees it: from inside, beside the wire.

Answer = TypeVar("Answer")


class DriveInside(ABC):
    """A simulated drive from inside; what is read of it is the truth at this moment, not what it says on the bus."""

    profile: DriveProfile
    number_word: ClassVar = "node"

    @property
    @abstractmethod
    def node(self) -> int:
        """Return the node-ID or the unit id."""

    @abstractmethod
    def _ask(self, read: Callable[[Drive], Answer], *, moved: bool = False) -> Answer:
        """Return what is read of the drive now; with `moved`, after its shaft has moved until now."""

    @abstractmethod
    def happen(self, fault: DriveFaultKind) -> None:
        """Let a fault of this drive happen; its `at` counts from now."""

    def __repr__(self) -> str:
        return f"<simulated {self.profile.title}, {self.number_word} {self.node}: {self.state}>"

    @property
    def state(self) -> str:
        """Return the state of CiA 402 by its name in the standard, such as "operation enabled"."""
        return self._ask(lambda drive: drive.power.state.value)

    @property
    def torque(self) -> float:
        """Return the torque of the motor [N·m]."""
        return self._ask(lambda drive: drive.plant.torque, moved=True)

    @property
    def position(self) -> float:
        """Return the angle of the shaft [rad]."""
        return self._ask(lambda drive: drive.plant.position, moved=True)

    @property
    def velocity(self) -> float:
        """Return the speed of the shaft [rad/s]."""
        return self._ask(lambda drive: drive.plant.velocity, moved=True)

    @property
    def rated_torque(self) -> float:
        """Return the rated torque of the motor [N·m]; on CAN 6071h and 6077h refer to it."""
        return self._ask(lambda drive: drive.objects.rated_torque)

    @property
    def error_code(self) -> int:
        """Return the code of the fault that stands, as in 603Fh; 0 when there is none."""
        return self._ask(lambda drive: drive.objects.error_code.value)

    def fail(self, code: int = 0x2310) -> None:
        """Let the drive detect a fault now, with the code that it tells; 2310h is an over-current."""
        self.happen(DriveFault("drive_fault", 0.0, code))


class SimulatedDrive(DriveInside):
    """One drive of a `VirtualCanBus`."""

    def __init__(self, world: World, slave: Slave, profile: DriveProfile) -> None:
        self._world, self._slave, self.profile = world, slave, profile

    @property
    def node(self) -> int:
        """Return the node-ID."""
        return self._slave.node.number

    @property
    def nmt_state(self) -> str:
        """Return the NMT state: "initialising", "pre-operational", "operational" or "stopped"."""
        with self._world.pace.held():
            return self._slave.node.state.name.lower().replace("_", "-")

    def value(self, index: int, subindex: int = 0) -> int:
        """Return a number of the object dictionary, as an upload would; raises LookupError when there is none."""
        with self._world.pace.held():
            self._slave.drive.measure(self._world.clock.now_ns())
            try:
                entry = self._slave.drive.dictionary.find(index, subindex)
            except AccessRefused:
                raise LookupError(f"the simulated {self.profile.title} has no {index:04X}h:{subindex:02X}") from None
            return entry.fetch() if entry.fetch is not None else entry.value

    def happen(self, fault: DriveFaultKind | LineFault) -> None:
        """Let a fault of this drive or of its bus happen; its `at` counts from now."""
        checked_faults((fault,))
        if not isinstance(fault, DriveFaultKind | LineFault):
            raise ValueError(f'fault "{fault.kind}" cannot begin while the bench runs')
        with self._world.pace.held():
            self._world.let_happen(self.node, fault)

    def _ask(self, read: Callable[[Drive], Answer], *, moved: bool = False) -> Answer:
        with self._world.pace.held():
            if moved:
                self._slave.drive.servo.advance(self._world.clock.now_ns())
            return read(self._slave.drive)


# The faults of a test's bench: of a file, of a list, or drawn from a seed.

NEW_SEED = "random"
"""A plan whose seed is drawn anew for each test."""
_LARGEST_NEW_SEED = 999_999
"""Short enough to be typed; any seed may be given."""
HOST_KINDS = frozenset({"host_late", "host_paused", "clock_step", "slow_compute"})
"""Faults of the computer of a master that runs in virtual time; nobody else's computer is simulated."""


@dataclass(frozen=True)
class FaultPlan:
    """Faults of a bench; `seed` is that of drawn faults, None for others."""

    faults: tuple[Fault, ...] = ()
    seed: int | None = None

    @property
    def text(self) -> str:
        """The faults as a file; for drawn ones, a first line that tells how to draw them again."""
        if self.seed is None:
            return toml_of(self.faults)
        return f"# again by: --fault-plan-seed {self.seed}, or the plan {RANDOM}{self.seed}\n{toml_of(self.faults)}"


def plan_faults(
    source: "FaultPlan | str | Path | Iterable[Fault]",
    *,
    within: float = 1.0,
    kinds: Iterable[str] | None = None,
    seed: int | None = None,
    folder: Path | None = None,
    possible: Collection[str] = RECIPES,
) -> FaultPlan:
    """Return the plan of a file, of a list of faults, of `random@SEED`, or of `random` and a new seed.

    Drawn faults happen `within` s of *operation enabled*, and are of these `kinds` (None: all that are `possible` on
    the bus of the bench); `seed` replaces that of `random`. The name of a file counts from `folder`. Raises UsageError
    for faults that this bench cannot have, and FaultFileError for a faulty file.
    """
    if isinstance(source, FaultPlan):
        return source
    if source == NEW_SEED:
        source = f"{RANDOM}{SystemRandom().randint(0, _LARGEST_NEW_SEED) if seed is None else seed}"
    number = seed_of(str(source)) if isinstance(source, str | Path) else None
    if number is not None:
        if not 0.0 < within < math.inf:
            raise UsageError(f"within {within!r}: expected a time above 0 s")
        return FaultPlan(drawn(number, within, _kinds(kinds, possible)), number)
    if not isinstance(source, str | Path | Iterable):
        raise wrong_kind("faults", "a file, a list of faults, random@SEED or random", source)
    faults = load_faults((folder or Path()) / source) if isinstance(source, str | Path) else checked_faults(source)
    for fault in faults:
        if isinstance(fault, HostFault):
            raise UsageError(f'fault "{fault.kind}" is a fault of the host computer, which is real here; remove it')
        if fault.bus is not None:
            raise UsageError(
                f'fault "{fault.kind}" names the bus "{fault.bus}"; this bench has one bus, remove the key'
            )
    return FaultPlan(faults)


def _kinds(wanted: Iterable[str] | None, possible: Collection[str]) -> tuple[str, ...]:
    """Return the kinds to draw from; raises UsageError for one that cannot be drawn here."""
    here = [kind for kind in (*RECIPES, *ANSWER_RECIPES) if kind in possible and kind not in HOST_KINDS]
    kinds = tuple(here if wanted is None else [wanted] if isinstance(wanted, str) else wanted)
    unknown = [kind for kind in kinds if kind not in here]
    if unknown or not kinds:
        raise UsageError(f"kinds of faults {', '.join(unknown)}: expected some of {', '.join(here)}")
    return kinds


# canopen in virtual time, in one thread.
#
# Theory: canopen receives in a thread of its own, and its callers wait for that thread by the wall clock. In virtual
# time there is one thread, and time passes only in it. So this network has no receiving thread: an SDO request lets
# virtual time pass until its answer has come, right where it is sent, and `wait` lets any time pass. In both, the
# frames that arrive go to canopen's callbacks.
#
# What waits by the wall clock or has a thread does not work: periodic transmission (SYNC, heartbeat, `PdoMap.start`) is
# refused, and `LssMaster`, `wait_for_heartbeat`, `wait_for_bootup`, `wait_for_reception` and `BaseNode402` wait in
# vain.

_SDO_REQUESTS, _SDO_RESPONSES = range(0x601, 0x680), 0x580
_LONGEST_NS = 300_000_000
"""Time that an answer may take, the time-out of canopen's SDO client."""


class SteppedNetwork(canopen.Network):
    """A canopen network whose time passes in its requests and in `wait`."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        super().__init__(bus)
        self._wire, self._clock = bus, clock

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame; after an SDO request, go on to its answer."""
        super().send_message(can_id, data, remote)
        if can_id in _SDO_REQUESTS:
            self._go_on(_LONGEST_NS, until=_SDO_RESPONSES + can_id % 0x80)

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> PeriodicMessageTask:
        """Refuse, because periodic transmission has a thread; raises RuntimeError."""
        raise RuntimeError(f"{can_id:03X}h cannot be sent periodically in virtual time; send it each time it is due")

    def wait(self, seconds: float) -> None:
        """Let time pass [s]."""
        self._go_on(round(seconds * 1e9))

    def _go_on(self, longest_ns: int, until: int | None = None) -> None:
        end_ns = self._clock.now_ns() + longest_ns
        while (message := self._wire.recv(max(0, end_ns - self._clock.now_ns()) * 1e-9)) is not None:
            for listener in self.listeners:
                listener(message)
            if message.arbitration_id == until:
                return


_LONGEST = 100_000
"""Least number of latest frames and motion segments that are kept."""
_NUMBERS = count(1)
"""Numbers of the channels of this process, of which no two have the same name."""
POLL = 0.001
"""Time between two looks of `wait_until` [s]."""
_NOTIFIER_CYCLE = 0.01
"""Longest time that canopen's receiving thread needs to end [s]; its own 1 s would be added to every test."""


def waited_for(condition: Callable[[], bool], longest: float, clock: Clock, wait: Callable[[float], None]) -> bool:
    """Wait until the condition holds; False when it does not within `longest` s of the clock."""
    end_ns = clock.now_ns() + round(longest * 1e9)
    while not condition():
        if clock.now_ns() >= end_ns:
            return False
        wait(POLL)
    return True


class Time(Enum):
    """Clock of a bus: real or virtual time."""

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
    rig: str | None = None
    """Rig file, such as a twin, whose only axis is the drive, in the place of profile, node and workspace."""

    def beside(self, folder: Path) -> "DriveRequest":
        """Return the request with the files that are in this folder; others count from the current one."""
        profile, rig = (str(folder / each) if each and (folder / each).is_file() else each
                        for each in (self.profile, self.rig))  # fmt: skip
        own = self.profiles and folder / self.profiles
        return replace(self, profile=profile, rig=rig, profiles=str(own) if own and own.is_dir() else self.profiles)

    def slot(self, default: str, bus: str, faults: tuple[Fault, ...]) -> DriveOnBus:
        """Return the place of the drive on a bus with these faults; `default` is the profile when none was named."""
        drive, hand, axis = NamedDrive(self.profile or default, self.node), hand_named(self.hand), None
        if self.rig is not None:
            if (self.profile, self.node) != (None, DEFAULT_NODE):
                raise UsageError(f"rig {self.rig}: profile and node are those of its axis; leave them out of the mark")
            axes = list(load_rig(self.rig, self.profiles).axis.values())
            if len(axes) != 1:
                raise UsageError(f"{self.rig}: expected a rig with one axis, found {len(axes)}")
            axis, drive = axes[0], NamedDrive(axes[0].profile, axes[0].node)
        return slot_of(drive, bus, Workspace(self.workspace), hand, faults, profiles=self.profiles, axis=axis)


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

        Raises UsageError for an unknown profile or hand, a bad profile file, a fault that no CAN bus has, a bit rate or
        node-ID that no CAN bus has, and two drives of one node-ID. All wrong drives are told at once. Raises ValueError
        for an unknown time or workspace.
        """
        if type(bitrate) is not int or not BITRATES[0] <= bitrate <= BITRATES[1]:
            raise UsageError(f"bitrate {bitrate!r}: expected a whole number from {BITRATES[0]} to {BITRATES[1]} bit/s")
        self.time = Time(time)
        self.clock: Clock = MonotonicClock() if self.time is Time.REAL else VirtualClock()
        self.faults = faults or FaultPlan()
        self.channel = f"simulated-{next(_NUMBERS)}"
        self.bitrate, self.seed = bitrate, seed
        self._world = World(self.clock, bitrate, seed, _LONGEST)
        self.drives: dict[int, SimulatedDrive] = {}
        wrong: list[str] = []
        for each in drives:
            with collecting(wrong):
                slot = each.slot(DEFAULT_DRIVE, self.channel, self.faults.faults)
                if type(slot.node) is not int or slot.node not in NODES:
                    raise UsageError(f"node {slot.node!r}: expected a node-ID from {NODES[0]} to {NODES[-1]}")
                self.drives[slot.node] = SimulatedDrive(self._world, self._world.add(slot), slot.profile)
        raise_all(wrong or of_no_drive(self.faults.faults, self.drives))
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
        """Arguments for `can.Bus` or `canopen.Network.connect` that join this wire."""
        return {"interface": "haptic_sim", "channel": self.channel, "bitrate": self.bitrate}

    def open(self, **options: Any) -> can.BusABC:
        """Return one more python-can bus on this wire; `options` are further ones of `can.Bus`."""
        return self._stack.enter_context(SimulatedBus(**{"channel": self.channel, "bitrate": self.bitrate, **options}))

    def network(self) -> canopen.Network:
        """Return a canopen network on this wire; in virtual time one without a thread (see `testing.bench`)."""
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
        return waited_for(condition, longest, self.clock, self.wait)
