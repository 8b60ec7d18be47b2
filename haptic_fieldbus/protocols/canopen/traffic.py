"""What a plan costs on a CAN bus: load, and the delay from the encoder's latch to the motor's torque.

t_k is the end of SYNC k, where the drive latches its position. Worst-case stuffing is assumed, as is a bus without
foreign frames.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.errors import BusOverloadError
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.pdo import INTERFRAME_SPACE_BITS, Direction, Pdo, worst_case_bits
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.traffic import COMPUTE_NS, Delay, Json
from haptic_fieldbus.signals import LinkFlag

LARGEST_BUS_LOAD = 0.9
LOWEST_RATE = 0.1
"""[Hz]; below it no rate is proposed."""
HEARTBEATS_PER_DEADLINE = 5
NODE_HEARTBEAT_MS = 100
MASTER_NODES = range(127, 0, -1)
"""Our own node-ID, for the heartbeat: the first that no drive has."""


@dataclass(frozen=True)
class PdoTraffic:
    """The PDOs of one node; incoming and outgoing as the master sees it."""

    node: int
    tpdos: tuple[Pdo, ...]
    rpdos: tuple[Pdo, ...]

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        return _mapped(self.tpdos)

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        return _mapped(self.rpdos)

    @property
    def pdos(self) -> tuple[Pdo, ...]:
        return self.tpdos + self.rpdos

    def lines(self) -> Iterator[tuple[str, str]]:
        """Each PDO with its COB-ID, transmission type and objects."""
        for pdo in self.pdos:
            when = "every SYNC" if pdo.transmission_type == 1 else "synchronous" if pdo.synchronous else "event-driven"
            text = f"{pdo.name} {pdo.cob_id:03X}h, type {pdo.transmission_type} ({when}), {pdo.size} octets"
            yield "in" if pdo.direction is Direction.TPDO else "out", text
            for entry in pdo.entries:
                yield "", f"  {entry}"

    def summary(self) -> Iterator[str]:
        """Each PDO with its signals."""
        for pdo in self.pdos:
            way = "in " if pdo.direction is Direction.TPDO else "out"
            yield f"{way} {pdo.name} {', '.join(signal.value for signal in pdo.signals)}"

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """The `pdos` of `plan --json`."""
        return {
            "pdos": [
                {
                    "name": pdo.name,
                    "bus": bus,
                    "node": pdo.node,
                    "cob_id": pdo.cob_id,
                    "transmission_type": pdo.transmission_type,
                    "octets": pdo.size,
                    "mapped": [str(entry) for entry in pdo.entries],
                }
                for pdo in self.pdos
            ]
        }

    def fault_text(self, flag: LinkFlag, code: int) -> str:
        """The link fault in the words of CANopen."""
        if flag is LinkFlag.EMERGENCY:
            return f"node {self.node} sent emergency {code:04X}h ({emergency_meaning(code)})"
        return FAULT_TEXTS[flag].format(node=self.node)


FAULT_TEXTS = {
    LinkFlag.BUS_OFF: "the CAN controller went bus-off: check wiring, terminators and bit rate",
    LinkFlag.BOOT_UP: "node {node} restarted",
    LinkFlag.NO_SIGN_OF_LIFE: "the heartbeat of node {node} stayed away",
    LinkFlag.NOT_OPERATIONAL: "node {node} is not operational, says its heartbeat",
    LinkFlag.EXCEPTION: "node {node} sent a malformed PDO, or the bus refused our frames",
}


def _mapped(pdos: tuple[Pdo, ...]) -> tuple[MappedSignal, ...]:
    return tuple(
        MappedSignal(signal, str(entry), entry.type, entry.unit)
        for pdo in pdos
        for signal, entry in zip(pdo.signals, pdo.entries, strict=True)
    )


@dataclass(frozen=True)
class BusMember:
    """One axis on the bus."""

    axis: str
    profile: CanopenProfile
    traffic: PdoTraffic


@dataclass(frozen=True)
class CanTraffic:
    """One period's traffic of one bus, worst case; bit rate in bit/s, rate in Hz."""

    members: tuple[BusMember, ...]
    bitrate: int
    rate: float
    waiting: float = 0.0
    """[s]; from its last TPDO to that of the slowest bus of the rig: only then is there something to compute with."""
    node_heartbeat_ms: int = NODE_HEARTBEAT_MS

    @property
    def heartbeat_every(self) -> int:
        """Periods between two of our heartbeats, so that the shortest deadline of a drive spans several."""
        deadline = min(member.profile.link_loss.deadline for member in self.members)
        return max(1, int(deadline / HEARTBEATS_PER_DEADLINE * self.rate))

    @property
    def master_node(self) -> int:
        nodes = {member.traffic.node for member in self.members}
        return next(node for node in MASTER_NODES if node not in nodes)

    @property
    def latch(self) -> float:
        """[s]; the end of SYNC."""
        return worst_case_bits(0) / self.bitrate

    @property
    def feedback_time(self) -> float:
        """[s]; SYNC and TPDOs."""
        return (worst_case_bits(0) + self._bits_in) / self.bitrate

    @property
    def sending_ns(self) -> float:
        """[ns]; RPDOs."""
        return self._bits_out * 1e9 / self.bitrate

    @property
    def answer_bits(self) -> int:
        """From the end of SYNC to the end of the last RPDO."""
        return self._bits_in + self._bits_out - INTERFRAME_SPACE_BITS

    @property
    def period_bits(self) -> int:
        return worst_case_bits(0) + self.answer_bits + INTERFRAME_SPACE_BITS

    @property
    def shortest_period(self) -> float:
        """[s]; SYNC, TPDOs, the wait for other buses, compute and RPDOs one after another."""
        return self.period_bits / self.bitrate + self.waiting + COMPUTE_NS * 1e-9

    @property
    def load(self) -> float:
        """Share of the bus in use, heartbeats of master and nodes included."""
        heartbeats = self.rate / self.heartbeat_every + len(self.members) * 1000 / self.node_heartbeat_ms
        return (self.period_bits * self.rate + worst_case_bits(1) * heartbeats) / self.bitrate

    @property
    def highest_rate(self) -> float:
        """[Hz]; what the bus could carry; heartbeats stay as they are. 0 or less: nothing."""
        heartbeats = self.load - self.period_bits * self.rate / self.bitrate
        by_load = (LARGEST_BUS_LOAD - heartbeats) * self.bitrate / self.period_bits
        return min(by_load, 1.0 / self.shortest_period)

    def check(self, bus: str) -> None:
        """Raises BusOverloadError, with the numbers and the highest rate, when the bus cannot carry this."""
        if self._fits:
            return
        rate, load, lower = self.rate, self.load, self._fitting_rate()
        subject = f"bus {bus}: " if bus else ""
        fits = "No rate would fit" if lower is None else f"Would fit: --rate {exactly(lower)}"
        raise BusOverloadError(
            f"{subject}{exactly(rate)} Hz needs {self.period_bits} bits a period: {percent(load)} of "
            f"{self.bitrate} bit/s, and {rounded(1e3 * self.shortest_period)} ms for SYNC, TPDOs, "
            f"{COMPUTE_NS // 1000} µs of computing and RPDOs. At most {percent(LARGEST_BUS_LOAD)} and one period are "
            f"allowed. {fits}"
        )

    @property
    def _fits(self) -> bool:
        return self.load <= LARGEST_BUS_LOAD and self.shortest_period * self.rate <= 1.0

    def _fitting_rate(self) -> float | None:
        """A round rate [Hz] that fits; it is tried, for at a lower rate heartbeats may be more."""
        rate = self.highest_rate
        while rate > LOWEST_RATE:
            rate = _round_down(rate)
            if replace(self, rate=rate)._fits:
                return rate
            rate *= 0.95
        return None

    def delay(self, axis: str) -> Delay:
        """The RPDO's type and the profile say when the drive acts."""
        member = self.member(axis)
        timing = member.profile.timing
        bus = self.answer_bits / self.bitrate + self.waiting
        compute = COMPUTE_NS * 1e-9
        if acts_on_reception(member):
            acts_at = _next_tick(bus + compute, timing.control_period)
        else:
            acts_at = round(1e9 / self.rate) * 1e-9
        return Delay(bus, compute, acts_at - bus - compute, 1.0 / (2 * math.pi * timing.torque_bandwidth))

    def member(self, axis: str) -> BusMember:
        """One of its axes by name."""
        return next(member for member in self.members if member.axis == axis)

    @property
    def speed(self) -> str:
        """Bit rate."""
        fast = self.bitrate >= 1_000_000
        return f"{exactly(self.bitrate / 1e6)} Mbit/s" if fast else f"{exactly(self.bitrate / 1e3)} kbit/s"

    def line(self) -> str:
        """Rate, bit rate and load."""
        return f"{exactly(self.rate)} Hz at {self.speed}, load {percent(self.load)} (worst case)"

    @cached_property
    def _bits_in(self) -> int:
        return sum(worst_case_bits(pdo.size) for member in self.members for pdo in member.traffic.tpdos)

    @cached_property
    def _bits_out(self) -> int:
        return sum(worst_case_bits(pdo.size) for member in self.members for pdo in member.traffic.rpdos)


def acts_on_reception(member: BusMember) -> bool:
    """False also when the profile does not know: the longer delay is assumed."""
    synchronous = any(pdo.synchronous for pdo in member.traffic.rpdos)
    return member.profile.pdo.rpdo_acts == "reception" and not synchronous


def _round_down(rate: float) -> float:
    step = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return math.floor(rate / step) * step


def _next_tick(instant: float, control_period: float) -> float:
    if control_period == 0.0:
        return instant
    return math.ceil(instant / control_period - 1e-9) * control_period
