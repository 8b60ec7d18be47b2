"""Traffic of a plan on a CAN bus: load, highest rate, and the delay from the latch of the encoder to the torque.

t_k is the end of SYNC k, at which the drive latches its position. Each period has the same sequence: SYNC, TPDOs, wait
for slower buses, computing, RPDOs. Worst-case stuffing is assumed, and a bus without foreign frames.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

from haptic_fieldbus.drive.profile import DataType, MappedSignal
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.errors import BusOverloadError
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.protocols.canopen import watch_traffic
from haptic_fieldbus.protocols.canopen.bus import LISTENING, cob_id_words
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.pdo import INTERFRAME_SPACE_BITS, Direction, Pdo, bits_beyond, worst_case_bits
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.protocol import BusMember
from haptic_fieldbus.protocols.traffic import COMPUTE_NS, IDEAL, Delay, HostTimes, Json, round_down, ways
from haptic_fieldbus.signals import LinkFlag, Signal

# The process data of one node: its PDOs and what is asked of it by SDO, with the texts of its faults.


@dataclass(frozen=True)
class PdoTraffic:
    """The PDOs of one node; incoming and outgoing are meant from the side of the master."""

    node: int
    tpdos: tuple[Pdo, ...]
    rpdos: tuple[Pdo, ...]
    asked: tuple[MappedSignal, ...] = field(default=(), kw_only=True)
    """Signals that are asked by SDO now and then; in the process image they follow those of the TPDOs."""
    life_guarding: bool = field(default=False, kw_only=True)

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        return _mapped(self.tpdos) + self.asked

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        return _mapped(self.rpdos)

    @property
    def pdos(self) -> tuple[Pdo, ...]:
        """All PDOs, TPDOs first."""
        return self.tpdos + self.rpdos

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield each PDO with COB-ID, transmission type and size, followed by its objects."""
        for key, pdos in (("in", self.tpdos), ("out", self.rpdos)):
            yield from _lines(key, pdos)
        if self.asked:
            every = exactly(1e3 * watch_traffic.ASK_EVERY)
            yield "ask", f"SDO upload at most every {every} ms: {self.asked[0].address}"

    def summary(self) -> Iterator[str]:
        """Yield a line for each PDO with its signals."""
        for pdo in self.pdos:
            way = "in " if pdo.direction is Direction.TPDO else "out"
            yield f"{way} {pdo.name} {', '.join(signal.value for signal, *_ in pdo.needed)}"
        if self.asked:
            yield f"read by SDO {self.asked[0].signal.value}"

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """Return the `pdos` of `plan --json`."""
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
                    "fixed": pdo.fixed,
                    "not_needed": [str(entry) for entry, _ in pdo.unneeded],
                }
                for pdo in self.pdos
            ]
        }

    def fault_text(self, flag: LinkFlag, code: int, bus: str = "the bus") -> str:
        """Return a link fault in the terms of CANopen; raises KeyError for STALE, which is no fault."""
        if flag is LinkFlag.EMERGENCY:
            return f"node {self.node} sent emergency {code:04X}h ({emergency_meaning(code)})"
        text = NO_ANSWER if self.life_guarding and flag is LinkFlag.NO_SIGN_OF_LIFE else FAULT_TEXTS[flag]
        return text.format(node=self.node, frame=cob_id_words(code), bus=bus)


FAULT_TEXTS = {
    LinkFlag.BUS_OFF: "the CAN controller went bus-off",
    LinkFlag.BOOT_UP: "node {node} restarted",
    LinkFlag.NO_SIGN_OF_LIFE: "the heartbeat of node {node} was lost",
    LinkFlag.NOT_OPERATIONAL: "node {node} is not operational according to its heartbeat",
    LinkFlag.EXCEPTION: "node {node} sent a malformed PDO, or the bus refused our frames",
    LinkFlag.FOREIGN: "another master on {bus}: received {frame}, which we did not send; end that master, and put "
    "axes that share a bus into one rig",
    LinkFlag.DUPLICATE: "{frame} was received more often than SYNC was sent: two devices have the node-ID {node}",
}

NO_ANSWER = "node {node} answered no request of node guarding within its life time, or repeated its toggle bit"
"""Instead of a heartbeat that stayed away, where the drive is guarded."""


def asked_signals(profile: CanopenProfile) -> tuple[MappedSignal, ...]:
    """Return the signals of an echo that is asked by SDO: the target torque, and the periods that the answer took."""
    value = profile.offers()[Signal.TARGET_ASKED]
    return value, MappedSignal(Signal.ASKED_PERIODS, value.address, DataType.UINT16)


def _mapped(pdos: tuple[Pdo, ...]) -> tuple[MappedSignal, ...]:
    """Return the signals of the PDOs in the order of their octets."""
    needed = [(signal, entry) for pdo in pdos for signal, entry, _ in pdo.needed]
    return tuple(MappedSignal(signal, str(entry), entry.type, entry.unit) for signal, entry in needed)


def _lines(key: str, pdos: tuple[Pdo, ...]) -> Iterator[tuple[str, str]]:
    """Yield the PDOs of one direction with their objects, and what fixed mappings cost."""
    for pdo in pdos:
        when = "every SYNC" if pdo.transmission_type == 1 else "synchronous" if pdo.synchronous else "event-driven"
        fixed = ", fixed mapping" if pdo.fixed else ""
        yield key, f"{pdo.name} {pdo.cob_id:03X}h, type {pdo.transmission_type} ({when}), {pdo.size} octets{fixed}"
        for signal, entry in zip(pdo.signals, pdo.entries, strict=True):
            yield "", f"  {entry}" if signal else f"  {entry} (not needed)"
    if any(pdo.fixed for pdo in pdos) and bits_beyond(pdos):
        named = ", ".join(pdo.name for pdo in pdos)
        yield "", f" cost of fixed mappings ({named}): {bits_beyond(pdos)} unneeded bits per period"


LARGEST_BUS_LOAD = 0.9
"""Largest permitted share of the bus."""
LOWEST_RATE = 0.1
"""Lowest rate that is proposed for an overloaded bus [Hz]."""
MASTER_NODES = range(127, 0, -1)
"""Candidates for the node-ID of the master, which its heartbeat needs; the first that no drive has is taken."""


CanMember = BusMember[CanopenProfile, PdoTraffic]


@dataclass(frozen=True)
class CanTraffic:
    """Traffic of one bus in a period, worst case; the bit rate is in bit/s, the rate in Hz."""

    members: tuple[CanMember, ...]
    bitrate: int
    rate: float
    waiting: float = 0.0
    """Time from the last TPDO of this bus to that of the slowest bus, when computing can begin [s]."""
    node_heartbeat_ms: int = watch_traffic.NODE_HEARTBEAT_MS
    listening: float = LISTENING
    """Time for which the master listens before it sends [s]."""
    chosen_master_node: int | None = None
    host: HostTimes = IDEAL
    """Times of adapter and host."""
    exchange: ClassVar = ""
    waits_for_answers: ClassVar = False
    """Set-points are sent whether or not a drive answers."""
    doubted_periods: ClassVar = 0
    """A frame is whole, and so is every value in it."""

    @property
    def heartbeat_every(self) -> int:
        """Periods between two signs of life of the master; the shortest guard spans several."""
        shortest = min(self.guard(member.axis) for member in self.members)
        return max(1, int(shortest / watch_traffic.PROOFS_PER_GUARD * self.rate + 1e-9))

    @property
    def beats(self) -> bool:
        """True when a drive watches our heartbeat; where all are guarded by requests, none is sent."""
        return not all(member.profile.link_loss.life_guarding for member in self.members)

    def guard(self, axis: str) -> float:
        """Time after which the drive detects the loss of the master [s]: that of its profile, at least five periods."""
        return watch_traffic.guard_time(self.member(axis).profile.link_loss, self.rate)

    def guarding(self, axis: str, rig: RigAxis) -> tuple[str, ...]:
        """Return what is written to the drive of an axis before its guard is proved: the guard, the reactions to a lost
        master, and what the profile sets up."""
        profile = self.member(axis).profile
        section, milliseconds = profile.link_loss, round(1e3 * self.guard(axis))
        reactions = watch_traffic.reactions(section, brakes=rig.on_link_loss == "brake")
        held = [
            *watch_traffic.guard_objects(section, milliseconds, self.master_node, self.node_heartbeat_ms),
            *((option.entry, value) for option, value in reactions),
            *((each.entry, each.value) for each in profile.setup.writes),
            (watch_traffic.MODE, profile.torque.mode_of_operation),
        ]
        return tuple(f"{entry.place} = {value}" for entry, value in held)

    def silence_of(self, axis: str) -> float:
        """Time without a sign of life of the drive after which it counts as gone [s]."""
        return watch_traffic.silence(self.member(axis).profile.link_loss, self.rate, self.node_heartbeat_ms)

    @property
    def silence(self) -> float:
        """The longest time without a sign of life after which a drive counts as gone [s]."""
        return max(self.silence_of(member.axis) for member in self.members)

    def other_masters(self, axis: str) -> None:
        """Every node hears every frame, those of another master too."""

    @property
    def disturbance(self) -> float:
        """Time by which frames beside the exchange delay it: one of eight octets, and all signs of life [s]."""
        own = worst_case_bits(1) if self.beats else 0
        theirs = sum(watch_traffic.bits_at_once(member.profile) for member in self.members)
        return (worst_case_bits(8) + own + theirs) / self.bitrate

    @property
    def master_node(self) -> int:
        """Node-ID of the master: the one that the rig chooses, else the highest that no drive has."""
        if self.chosen_master_node is not None:
            return self.chosen_master_node
        nodes = {member.traffic.node for member in self.members}
        return next(node for node in MASTER_NODES if node not in nodes)

    def of(self, axis: str) -> PdoTraffic:
        """Return the PDOs of an axis."""
        return self.member(axis).traffic

    def others(self) -> tuple["CanTraffic", ...]:
        """There is one way: SYNC, TPDOs, RPDOs."""
        return ()

    def latch(self, axis: str) -> float:
        """Return the time from the beginning of SYNC to its end [s], which is the same for all drives."""
        return worst_case_bits(0) / self.bitrate

    @property
    def feedback_time(self) -> float:
        """Time from the beginning of SYNC to the end of the last TPDO [s]."""
        return (worst_case_bits(0) + self._bits_in) / self.bitrate + self.host.known_latency

    @property
    def sending_ns(self) -> float:
        """Time that all RPDOs take [ns]."""
        return self._bits_out * 1e9 / self.bitrate

    @property
    def answer_bits(self) -> int:
        """Bits from the end of SYNC to the end of the last RPDO, without the interframe space after it."""
        # The last frame is complete at its end, not after the space that separates it from the next.
        return self._bits_in + self._bits_out - INTERFRAME_SPACE_BITS

    @property
    def period_bits(self) -> int:
        """Bits of SYNC, TPDOs and RPDOs, interframe spaces included."""
        return worst_case_bits(0) + self.answer_bits + INTERFRAME_SPACE_BITS

    @property
    def shortest_period(self) -> float:
        """Time of SYNC, TPDOs, the wait for other buses, computing and RPDOs one after another [s]."""
        # Computing begins with the end of the last TPDO, not after the space that separates it from the next frame.
        frames = (self.period_bits - INTERFRAME_SPACE_BITS) / self.bitrate
        return frames + self.waiting + self.host.known_latency + COMPUTE_NS * 1e-9

    @property
    def proves_while_computing(self) -> bool:
        """True when a period has no time left for our sign of life behind the set-points."""
        return (self.shortest_period + worst_case_bits(1) / self.bitrate) * self.rate > 1.0

    @property
    def load(self) -> float:
        """Share of the bus in use, including all frames beside the exchange."""
        # The master counts periods, the nodes milliseconds.
        proofs = self.rate / self.heartbeat_every
        own = worst_case_bits(1) * proofs if self.beats else 0.0
        milliseconds, profiles = self.node_heartbeat_ms, [member.profile for member in self.members]
        theirs = sum(watch_traffic.bits_a_second(each, self.rate, proofs, milliseconds) for each in profiles)
        return (self.period_bits * self.rate + own + theirs) / self.bitrate

    @property
    def highest_rate(self) -> float:
        """Highest rate that the bus could carry with the heartbeats of the present rate [Hz]; 0 or less: none."""
        heartbeats = self.load - self.period_bits * self.rate / self.bitrate
        by_load = (LARGEST_BUS_LOAD - heartbeats) * self.bitrate / self.period_bits
        return min(by_load, 1.0 / self.shortest_period)

    def check(self, bus: str) -> None:
        """Raise BusOverloadError, with the figures and a rate that fits, when the bus cannot carry this traffic."""
        if self._fits:
            return
        subject, lower = f"bus {bus}: " if bus else "", self._fitting_rate()
        fits = "No rate fits" if lower is None else f"Fits: --rate {exactly(lower)}"
        bits = f"{self.period_bits} bits per period: {percent(self.load)} of {self.bitrate} bit/s"
        computing = f"{COMPUTE_NS // 1000} µs of computing"
        times = f"{rounded(1e3 * self.shortest_period)} ms for SYNC, TPDOs, {computing} and RPDOs"
        allowed = f"Allowed: {percent(LARGEST_BUS_LOAD)} and one period"
        raise BusOverloadError(f"{subject}{exactly(self.rate)} Hz needs {bits}, and {times}. {allowed}. {fits}")

    @property
    def _fits(self) -> bool:
        return self.load <= LARGEST_BUS_LOAD and self.shortest_period * self.rate <= 1.0

    def _fitting_rate(self) -> float | None:
        """Return a round rate that fits [Hz]; None when none above `LOWEST_RATE` does."""
        # Each candidate is tried, because heartbeats, counted in periods, change their share with the rate.
        rate = self.highest_rate
        while rate > LOWEST_RATE:
            rate = round_down(rate)  # a rate that people would type
            if replace(self, rate=rate)._fits:
                return rate
            rate *= 0.95
        return None

    def delay(self, axis: str) -> Delay:
        """Return the delay budget of an axis, by the transmission type of its RPDOs and its profile."""
        member = self.member(axis)
        bus = self.answer_bits / self.bitrate + self.waiting + self.host.known_latency
        compute, period = COMPUTE_NS * 1e-9, round(1e9 / self.rate) * 1e-9
        synchronous = any(pdo.synchronous for pdo in member.traffic.rpdos)
        # At the next SYNC also when the profile leaves it open, so that the longer delay is assumed.
        on_reception = member.profile.pdo.rpdo_acts == "reception" and not synchronous
        timing, lag = member.profile.timing, member.profile.torque_lag
        planned, shortest, longest = ways(timing, bus + compute, self.host, period, on_reception=on_reception)
        return Delay(bus, compute, planned - bus - compute, lag, shortest, longest, self.host.lateness)

    def member(self, axis: str) -> CanMember:
        """Return the axis of that name, which must be on this bus."""
        return next(member for member in self.members if member.axis == axis)

    @property
    def speed(self) -> str:
        """Bit rate in words."""
        factor, unit = (1e6, "Mbit/s") if self.bitrate >= 1_000_000 else (1e3, "kbit/s")
        return f"{exactly(self.bitrate / factor)} {unit}"

    def line(self) -> str:
        """Return rate, bit rate and load in words."""
        return f"{exactly(self.rate)} Hz at {self.speed}, load {percent(self.load)} (worst case)"

    @cached_property
    def _bits_in(self) -> int:
        return sum(worst_case_bits(pdo.size) for member in self.members for pdo in member.traffic.tpdos)

    @cached_property
    def _bits_out(self) -> int:
        return sum(worst_case_bits(pdo.size) for member in self.members for pdo in member.traffic.rpdos)
