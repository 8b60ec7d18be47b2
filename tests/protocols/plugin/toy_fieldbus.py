"""A fieldbus of its own, as somebody else's package would add it: a poll and a set-point, in bytes, each period.

Poll: node. Answer: node, mode, position, echo of the current. Set-point: node, mode that is asked for, current. All
values are big-endian, ten bits an octet. A drive that hears no set-point for `DEADLINE_NS` lets go of its shaft.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from struct import Struct
from typing import Any, ClassVar

from haptic_fieldbus.buses.access import BusAccess
from haptic_fieldbus.buses.bus import DriveFacts, InSteps, StepwiseBus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.fields import STRICT
from haptic_fieldbus.drive.profile import DataType, DriveProfile, MappedSignal, Order, PowerTable
from haptic_fieldbus.drive.rig import BusSection, RigAxis, steps_per_revolution
from haptic_fieldbus.errors import BusError, BusOverloadError, UsageError
from haptic_fieldbus.planning.image import AXIS_HEADER, HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.protocol import BusName, FieldbusProtocol, Members
from haptic_fieldbus.protocols.traffic import COMPUTE_NS, AxisTraffic, BusTraffic, Delay, Json
from haptic_fieldbus.signals import LinkFlag, Signal
from haptic_fieldbus.sim.drive.settings import DriveSettings, build_plant
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from haptic_fieldbus.sim.simulation import Simulation

BAUD = 2_000_000
POLL, ANSWER, SET = Struct(">B"), Struct(">BHih"), Struct(">BHh")
DEADLINE_NS = 50_000_000
DISABLED, TORQUE, FAULT = 0, 7, 0xEE
REGISTERS = ("mode", "position", "echo", "command", "current")


def line_time(octets: int) -> float:
    """[s]."""
    return 10 * octets / BAUD


@dataclass(frozen=True)
class Register:
    address: int
    type: DataType
    unit: str = ""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, kw_only=True)
class ToyProfile(DriveProfile):
    registers: dict[str, Register]
    power: PowerTable
    __pydantic_config__: ClassVar = STRICT

    @property
    def echo(self) -> Signal:
        return Signal.TORQUE_DEMAND

    def offers(self) -> dict[Signal, MappedSignal]:
        signals = (
            Signal.STATUSWORD, Signal.POSITION, Signal.TORQUE_DEMAND, Signal.CONTROLWORD, Signal.TARGET_TORQUE,
        )  # fmt: skip
        named = [(signal, name, self.registers[name]) for signal, name in zip(signals, REGISTERS, strict=True)]
        return {
            signal: MappedSignal(signal, f"register {each.address} {name}", each.type, each.unit, Order.BIG)
            for signal, name, each in named
        }


@dataclass(frozen=True)
class ToySection(BusSection):
    protocol: ClassVar[str] = "toy"
    __pydantic_config__: ClassVar[dict[str, object]] = STRICT

    @property
    def simulated(self) -> bool:
        return True


@dataclass(frozen=True)
class ToyAxis:
    node: int
    incoming: tuple[MappedSignal, ...]
    outgoing: tuple[MappedSignal, ...]

    def lines(self) -> Iterator[tuple[str, str]]:
        for key, signals in (("in", self.incoming), ("out", self.outgoing)):
            yield key, f"message of node {self.node}: {', '.join(mapped.address for mapped in signals)}"

    def summary(self) -> Iterator[str]:
        yield f"in  {', '.join(mapped.signal.value for mapped in self.incoming)}"
        yield f"out {', '.join(mapped.signal.value for mapped in self.outgoing)}"

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        return {"messages": [{"bus": bus, "node": self.node, "octets": ANSWER.size + SET.size}]}

    def fault_text(self, flag: LinkFlag, code: int, bus: str = "the bus") -> str:
        return f"node {self.node}: {flag.name} {code}"


@dataclass(frozen=True)
class ToyTraffic:
    members: Members
    rate: float
    waiting: float
    speed: str = f"{BAUD} baud"
    silence: float = math.inf
    waits_for_answers: bool = False
    doubted_periods: int = 0
    disturbance: float = 0.0
    exchange: str = ""

    def of(self, axis: str) -> AxisTraffic:
        return self.members[axis][1]

    def others(self) -> tuple[BusTraffic, ...]:
        return ()

    def latch(self, axis: str) -> float:
        return line_time(POLL.size)

    @property
    def feedback_time(self) -> float:
        return len(self.members) * line_time(POLL.size + ANSWER.size)

    @property
    def sending_ns(self) -> float:
        return 1e9 * len(self.members) * line_time(SET.size)

    @property
    def load(self) -> float:
        return (self.feedback_time + self.sending_ns * 1e-9) * self.rate

    @property
    def highest_rate(self) -> float:
        return 1.0 / (self.feedback_time + self.sending_ns * 1e-9 + self.waiting + COMPUTE_NS * 1e-9)

    def delay(self, axis: str) -> Delay:
        timing = self.members[axis][0].timing
        bus, compute = self.feedback_time - self.latch(axis) + self.sending_ns * 1e-9 + self.waiting, COMPUTE_NS * 1e-9
        ticks = math.ceil((bus + compute) / timing.control_period)
        drive = ticks * timing.control_period - bus - compute
        return Delay(bus, compute, drive, 1.0 / (2.0 * math.pi * timing.torque_bandwidth))

    def guard(self, axis: str) -> float:
        return DEADLINE_NS * 1e-9

    def guarding(self, axis: str, rig: RigAxis) -> tuple[str, ...]:
        return ()

    def other_masters(self, axis: str) -> None:
        return None

    def check(self, bus: str) -> None:
        if self.rate > self.highest_rate:
            raise BusOverloadError(f"{bus} {self.rate:g} Hz is too fast for a toy: at most {self.highest_rate:.0f} Hz")

    def line(self) -> str:
        return f"{self.rate:g} Hz at {self.speed}, load {100 * self.load:.1f} %"


class ToyProtocol(FieldbusProtocol):
    name = "toy"
    profile: type[DriveProfile] = ToyProfile
    section: type[BusSection] = ToySection
    nodes = range(1, 9)

    def check_profile(self, document: Document) -> None:
        for name in REGISTERS:
            if name not in document.table("registers"):
                document.fault(("registers", name), "missing; a toy has all five")

    def parse_bus(self, text: str) -> BusName:
        if text != "toy":
            raise UsageError(f'bus "{text}": buses are toy')
        return BusName(text, ToySection("toy", "toy"))

    def power_table(self, profile: DriveProfile) -> PowerTable:
        assert isinstance(profile, ToyProfile)
        return profile.power

    def axis_traffic(
        self,
        axis: RigAxis,
        section: BusSection,
        profile: DriveProfile,
        incoming: Sequence[Signal],
        outgoing: Sequence[Signal],
    ) -> ToyAxis:
        offered = profile.offers()
        return ToyAxis(axis.node, tuple(offered[s] for s in incoming), tuple(offered[s] for s in outgoing))

    def bus_traffic(self, section: BusSection, members: Members, rate: float, waiting: float) -> ToyTraffic:
        return ToyTraffic(members, rate, waiting)


class ToyDrive:
    """A simulated drive behind bytes."""

    def __init__(self, slot: DriveOnBus, t_ns: int) -> None:
        self.node, self.mode, self.current, self.heard_ns = slot.node, DISABLED, 0, t_ns
        self.torque_per_step = 1e-3 * (slot.axis.torque_constant or 0.0)
        self.steps = steps_per_revolution("mrad", 0) / (2.0 * math.pi)
        self.plant = build_plant(slot.profile, slot.axis, slot.hand, DriveSettings(), t_ns)

    def answer(self, poll: bytes, t_ns: int) -> bytes:
        self._advance(t_ns)
        return ANSWER.pack(*POLL.unpack(poll), self.mode, round(self.plant.state[0] * self.steps), self.current)

    def take(self, message: bytes, t_ns: int) -> None:
        _, mode, current = SET.unpack(message)
        self._advance(t_ns)
        if mode == TORQUE != self.mode:
            self.plant.start_hand()
        self.mode, self.current, self.heard_ns = mode, current if mode == TORQUE else 0, t_ns
        self.plant.set_target(self.current * self.torque_per_step)

    def _advance(self, t_ns: int) -> None:
        if self.mode == TORQUE and t_ns > self.heard_ns + DEADLINE_NS:
            self.plant.advance(self.heard_ns + DEADLINE_NS)
            self.plant.set_target(0.0)
            self.mode, self.current = FAULT, 0
        self.plant.advance(t_ns)


@dataclass
class ToyBus(InSteps):
    """The master with its drives, which tell their true motion too."""

    clock: Clock
    drives: dict[int, ToyDrive]
    facts: dict[str, DriveFacts] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    causes: dict[str, tuple[LinkFlag, int]] = field(default_factory=dict)
    latch_ns: int = 0
    plan: Plan | None = None
    image: bytearray = field(default_factory=bytearray)

    def inspect(self, plan: Plan, image: bytearray) -> None:
        self.plan, self.image = plan, image
        for axis in plan.axes:
            if axis.node not in self.drives:
                raise BusError(f"node {axis.node} does not answer")

    def configure(self, plan: Plan) -> None:
        """A toy has nothing to configure."""

    def start(self) -> None:
        self.release()

    def prepare(self, deadline_ns: int) -> None:
        """Nothing comes unasked."""

    def begin(self) -> None:
        self._pass(POLL.size)
        self.latch_ns = self.clock.now_ns()

    def collect(self, deadline_ns: int) -> bytearray:
        assert self.plan is not None
        HEADER.pack_into(self.image, 0, self.latch_ns)
        for axis, places in zip(self.plan.axes, self.plan.image.axes, strict=True):
            octets = self.drives[axis.node].answer(POLL.pack(axis.node), self.latch_ns)
            self._pass(ANSWER.size)
            offset, size = places.inputs
            self.image[offset : offset + size] = octets[1:]
            AXIS_HEADER.pack_into(self.image, places.header, self.clock.now_ns() - self.latch_ns, 0, 0)
        return self.image

    def write(self, image: bytes | bytearray) -> None:
        assert self.plan is not None
        for axis, places in zip(self.plan.axes, self.plan.image.axes, strict=True):
            offset, size = places.outputs
            self._pass(SET.size)
            message = bytes((axis.node,)) + bytes(image[offset : offset + size])
            self.drives[axis.node].take(message, self.clock.now_ns())

    def ask(self, axis: str) -> int | None:
        """Every answer comes with the feedback."""
        return None

    def acknowledge(self) -> None:
        for drive in self.drives.values():
            drive.mode = DISABLED

    def release(self) -> None:
        if self.plan is not None:
            self.write(bytes(self.plan.image.output_size))

    def settle(self) -> bool:
        return True

    def leave(self) -> bool:
        return all(drive.mode != TORQUE for drive in self.drives.values())

    def close(self) -> None:
        self.stop()

    def trajectory(self, node: int) -> Trajectory:
        self.drives[node].plant.advance(self.clock.now_ns())
        return Trajectory(self.drives[node].plant.recorder, self.clock.now_ns())

    def so_far(self, node: int) -> Trajectory:
        plant = self.drives[node].plant
        return Trajectory(plant.recorder, plant.t_ns)

    def forget(self, before_ns: int) -> None:
        for drive in self.drives.values():
            drive.plant.recorder.forget(before_ns)

    def _pass(self, octets: int) -> None:
        self.clock.sleep_until(self.clock.now_ns() + round(1e9 * line_time(octets)))


class ToyAccess(BusAccess):
    def open_bus(self, section: BusSection, clock: Clock, log: Any) -> StepwiseBus:
        raise UsageError("there are no real toys")


class ToySimulation(Simulation):
    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[DriveOnBus], clock: Clock, seed: int | str, log: Any
    ) -> tuple[ToyBus, ToyBus]:
        bus = ToyBus(clock, {slot.node: ToyDrive(slot, clock.now_ns()) for slot in slots})
        return bus, bus


PROTOCOL, ACCESS, SIMULATION = ToyProtocol(), ToyAccess(), ToySimulation()
