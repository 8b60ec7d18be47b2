"""Opening CANopen buses on any python-can interface; drives found, watched and measured by reading alone."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from haptic_fieldbus.buses import scan_result
from haptic_fieldbus.buses.access import ANSWER_TIMEOUT, Axes, BusAccess, Logs, checks_on, look_at, profiles_of
from haptic_fieldbus.buses.canopen import setup
from haptic_fieldbus.buses.canopen.frames import FrameLog, frame_logs
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import GUARDING_NS, HEARTBEAT_STATE, Node, nmt_state_name, request
from haptic_fieldbus.buses.canopen.opening import adapter_checks, open_can
from haptic_fieldbus.buses.canopen.other_master import ForeignMaster, OneMaster, frame_words, listen
from haptic_fieldbus.buses.canopen.setup import NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.scan_result import Check, DriveReading, FoundNode, Scan
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.profile import STANDARD, DataType, DriveProfile, ObjectEntry
from haptic_fieldbus.drive.rig import RATED_TORQUE_UNITS, BusSection, RigAxis
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, EdsError
from haptic_fieldbus.protocols.canopen import bus
from haptic_fieldbus.protocols.canopen.bus import NODES, CanSection, can_section
from haptic_fieldbus.protocols.canopen.eds_values import PER_AXIS, axes_words
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.fitting import MatchQuality, fitted, fitting, uploaded
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.canopen.traffic import MASTER_NODES
from haptic_fieldbus.protocols.canopen.watch_traffic import GUARD_TIME, LIFE_TIME_FACTOR, PRODUCER_HEARTBEAT
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.signals import Signal

# Looking at drives without touching them: their objects are uploaded, and nothing is downloaded or commanded.
#
# The exchange of a run would show the same values, but to begin it a drive is configured: its PDOs are mapped, its mode
# is changed, its guard is armed, and one that somebody left enabled would be switched off, with whatever hangs on it.
# A drive in fault would be refused, when a look at it is needed most. SDO uploads do none of this, and a look that is
# late or ends leaves nothing behind (decision 0032).
#
# As soon as another master commands or asks on the bus, nothing more is sent: two SDO clients of one node mix up their
# answers.
#
# Reference: CiA 301 7.2.4 (SDO), 7.2.8 (heartbeat).

LONGEST_DRAIN_NS = 10_000_000


class BusObserver:
    """Observer of the drives of one bus. It listens for this time [s] before it sends anything. Raises BusError."""

    def __init__(
        self, wire: Wire, drives: Mapping[str, tuple[int, CanopenProfile]], listening: float, master_node: int
    ) -> None:
        self.masters = ""
        self._several: dict[tuple[int, int], bool] = {}
        self._wire = wire
        one = OneMaster([node for node, _ in drives.values()], master_node)
        self._drives = {
            axis: (Node(wire, node, f"node {node} (axis {axis})"), profile.entries())
            for axis, (node, profile) in drives.items()
        }
        wire.drain(wire.clock.now_ns() + LONGEST_DRAIN_NS)  # what comes from now on is dated by this look, or later
        heard = listen(wire, listening, one, wire.name)
        heard.refuse_noise()
        self.listened = heard.sentence()
        if heard.masters:
            self._yield_to(self._commanded(*sorted(heard.masters)))
        self._foreign = ForeignMaster(wire, one, self._yield_to)

    def look(self) -> dict[str, DriveReading]:
        """Return what each drive says now; raises BusError when the bus is dead."""
        self._wire.drain(self._wire.clock.now_ns() + LONGEST_DRAIN_NS)
        if self._foreign.cob_id is not None:
            self._yield_to(self._commanded(self._foreign.cob_id))
        return {axis: self._look_at(node, entries) for axis, (node, entries) in self._drives.items()}

    def _commanded(self, *can_ids: int) -> str:
        return f"another master on {self._wire.name}: {', '.join(map(frame_words, can_ids))}"

    def _yield_to(self, words: str) -> None:
        self.masters = self.masters or f"{words}; requests stopped, listening only"

    def _look_at(self, node: Node, entries: Mapping[Signal, ObjectEntry]) -> DriveReading:
        now_ns = self._wire.clock.now_ns
        if self.masters:
            code = node.emergency
            note = f"it sent emergency {code:04X}h ({emergency_meaning(code)})" if code else "not asked"
            glimpse = DriveReading(now_ns(), error_code=code or None, note=note)
        else:
            glimpse = look_at(
                entries,
                lambda entry: node.read(entry, ANSWER_TIMEOUT),
                now_ns,
                arrived_ns=now_ns,
                power=CIA402,
                error=setup.ERROR_CODE,
                silent=NO_ANSWER_ADVICE,
                emergency=lambda: node.emergency or None,
                refused=partial(self._axes, node),
            )
        life_age = (now_ns() - node.heartbeat_ns) * 1e-9
        if node.state is None:
            return glimpse
        return replace(glimpse, nmt_state=nmt_state_name(node.state), life_age=life_age)

    def _axes(self, node: Node, entry: ObjectEntry) -> str:
        """Return what to do about an object that has a value of each of several axes in sub-indices, asked once."""
        key = node.id, entry.object
        if key not in self._several:
            self._several[key] = entry.object in PER_AXIS and entry.subindex == 0 and _has_axes(node, entry.object)
        return f"; {axes_words([entry.object])}" if self._several[key] else ""


# The way to a node and back, measured by SDO uploads of its device type.
#
# A round trip holds the adapter twice, the bus and the SDO server of the drive, which a drive runs beside its control
# loop. So the least one bounds what the adapter takes, and the spread is that of both.

SLOW = (
    "the adapter delays frames, or the drive answers late: use a SocketCAN adapter instead of a serial one, and see "
    "usb_latency_timer"
)


def round_trips(wire: Wire, node: int, questions: int = scan_result.QUESTIONS) -> list[float]:
    """Return the times of so many round trips [s]; those without an answer are missing. Raises BusError."""
    answered: list[int] = []
    wire.listen(bus.SDO_RESPONSE_COB_ID + node, lambda data: answered.append(wire.clock.now_ns()))
    times: list[float] = []
    for _ in range(questions):
        answered.clear()
        asked_ns = wire.clock.now_ns()
        wire.send(bus.SDO_REQUEST_COB_ID + node, request(setup.DEVICE_TYPE, None))
        wire.pump_until(asked_ns + scan_result.ANSWER_NS, lambda: bool(answered))
        if answered:
            times.append((answered[0] - asked_ns) * 1e-9)
        elif not times:
            break  # a node that is not there
    return times


def round_trip_checks(node: int, times: list[float], asked: int, rate: float) -> tuple[Check, Check]:
    """Return the checks of the usual round trip and of its jitter, for a loop of this rate [Hz]."""
    silent = f"{NO_ANSWER_ADVICE}; `haptic-fieldbus scan` lists the nodes"
    return scan_result.timing_checks(f"node {node}", times, asked, rate, silent=silent, slow=SLOW)


# Finding the nodes of a bus by reading alone: first listen, then ask every node-ID, then those that answered.
#
# All 127 node-IDs are asked for their device type (1000h), which every device has, and answers are collected
# meanwhile: a node-ID that nobody has costs no time-out. The NMT state comes from a heartbeat. A node that sends none
# is asked once by node guarding, unless it is set up for life guarding, which the question would begin.
#
# When another master commands on the bus nothing is asked, since two clients would mix up each other's answers. The
# nodes are then those whose frames were heard.
#
# Reference: CiA 301 7.2.4 (SDO), 7.2.8 (NMT), 7.5.2.1 (1000h), 7.5.2.7 (1008h), 7.5.2.21 (1018h).

NOBODY_ANSWERS = (
    "no node answered: check the power of the drives, the wiring, both 120 Ω terminators and the bit rate; run doctor "
    "to check the adapter"
)
NOBODY = 0
"""Node-ID in the place of our own: a heartbeat of any node-ID may be that of a device."""
NAME = 0x1008
BITS_OF_A_QUESTION = 300
"""Bits of a request and its answer, stuffing and some air included."""
LATEST_ANSWER_NS = 300_000_000
LONGEST_HEARTBEAT_NS = 2_000_000_000
"""Time for which a heartbeat is waited for at most."""
Value = TypeVar("Value")


def scan_bus(
    wire: Wire, listening: float, bitrate: int, profiles: Sequence[CanopenProfile], nodes: Sequence[int] = NODES
) -> Scan:
    """Listen for so long [s], then ask these node-IDs; `profiles` are those that may fit. Raises BusError."""
    one, states = OneMaster(NODES, NOBODY), dict[int, int]()

    def note_state(node: int, data: bytes | bytearray) -> None:
        if data:
            states[node] = data[0] & HEARTBEAT_STATE

    for node in NODES:
        wire.listen(HEARTBEAT_COB_ID + node, partial(note_state, node))
    heard = listen(wire, listening, one, wire.name)
    heard.refuse_noise()
    if heard.masters:
        words = ", ".join(frame_words(can_id) for can_id in sorted(heard.masters))
        told = f"another master on {wire.name}: {words}. No requests were sent; the list shows received frames only"
        bases = {base + node: node for base in bus.FROM_A_NODE for node in NODES}
        alive = sorted({bases[can_id] for can_id in heard.frames if can_id in bases})
        return Scan(
            wire.name, tuple(_with_state(node, states) for node in alive), heard.sentence(), told, NOBODY_ANSWERS
        )
    others: list[str] = []
    foreign = ForeignMaster(wire, one, others.append)
    answered = _answering(wire, bitrate, nodes)
    found = {node: _with_state(node, states) for node in states}
    for node in answered:
        if others or foreign.cob_id is not None:
            found.setdefault(node, FoundNode(node))
            continue
        found[node] = _found(Node(wire, node, f"node {node}"), states.get(node), profiles)
    began = [] if foreign.cob_id is None else [f"another master on {wire.name}: {frame_words(foreign.cob_id)}"]
    in_order = tuple(found[node] for node in sorted(found))
    return Scan(wire.name, in_order, heard.sentence(), "; ".join([*began, *others]), NOBODY_ANSWERS)


def _with_state(node: int, states: Mapping[int, int]) -> FoundNode:
    """Return a node of which nothing is known but, from its heartbeats, its NMT state."""
    return FoundNode(node, nmt_state=nmt_state_name(states[node]) if node in states else None)


def _answering(wire: Wire, bitrate: int, nodes: Sequence[int]) -> list[int]:
    """Ask these node-IDs for their device type, and return those that answered."""
    found: dict[int, bytes | bytearray] = {}
    for node in nodes:
        wire.listen(bus.SDO_RESPONSE_COB_ID + node, partial(found.__setitem__, node))
    gap_ns = max(1_000_000, round(BITS_OF_A_QUESTION * 1e9 / bitrate))
    for node in nodes:
        wire.send(bus.SDO_REQUEST_COB_ID + node, request(setup.DEVICE_TYPE, None))
        wire.pump_until(wire.clock.now_ns() + gap_ns)
    wire.pump_until(wire.clock.now_ns() + LATEST_ANSWER_NS)
    return sorted(found)


def _found(node: Node, state: int | None, profiles: Sequence[CanopenProfile]) -> FoundNode:
    """Read the remaining facts of a node that answered."""
    device_type = _unless_refused(lambda: node.read(setup.DEVICE_TYPE))
    vendor, product, revision, serial = (_unless_refused(partial(node.read, entry)) for entry in setup.IDENTITY)
    name = _unless_refused(lambda: node.text(NAME))
    drives = device_type is not None and device_type & 0xFFFF == setup.DRIVE_PROFILE
    statusword = _unless_refused(lambda: node.read(setup.STATUSWORD)) if drives else None
    profile, sure = _profile_of(node, fitting(profiles, vendor, product, name) if drives else [])
    if not drives:
        sure = None if device_type is None else "not a CiA 402 drive"
    state = _nmt_state(node) if state is None else state
    nmt_state = None if state is None else nmt_state_name(state)
    power = None if statusword is None else CIA402.state(statusword).value
    return FoundNode(node.id, vendor, product, revision, serial, name or None, profile, sure, nmt_state, power)


def _profile_of(node: Node, candidates: list[tuple[CanopenProfile, MatchQuality]]) -> tuple[str | None, str | None]:
    """Return the first profile whose objects the node has, and how sure it is; None and the reason without one.

    A profile that cannot render force is named as such and not proposed.
    """
    lacking = {profile.name: _lacking(node, profile) for profile, _ in candidates}
    whole = [(profile, sureness) for profile, sureness in candidates if not lacking[profile.name]]
    useless = [f"{profile.name} ({sureness.value})" for profile, sureness in whole if not profile.drive.usable]
    usable = [(profile, sureness) for profile, sureness in whole if profile.drive.usable]
    told = f"; it cannot render force by {', '.join(useless)}" if useless else ""
    if not usable:
        missing = [f"{', '.join(map(str, each))} of {name} missing" for name, each in lacking.items() if each]
        reasons = "; ".join(missing) or ("none" if useless else "no profile has this vendor and product")
        several = [index for index in PER_AXIS if _has_axes(node, index)]
        axes = f"; {axes_words(several)}" if several else ""
        return None, f"no matching profile: {reasons}{told}{axes}"
    best, sureness = usable[0]
    equal = [profile.name for profile, other in usable[1:] if other is sureness]
    also = f"; {', '.join(equal)} would match too" if equal else ""
    has = "the objects that force needs" if best.drive.evidence == STANDARD else "all objects of the profile"
    return best.name, f"{sureness.value}; it has {has}{also}{told}"


def _has_axes(node: Node, index: int) -> bool:
    """Return whether a node has a value of each of two axes in the sub-indices of an object."""
    entries = [ObjectEntry(index, DataType.UINT16, subindex) for subindex in (1, 2)]
    return all(_unless_refused(partial(node.read, entry)) is not None for entry in entries)


def _lacking(node: Node, profile: CanopenProfile) -> list[ObjectEntry]:
    """Return the entries that force needs by a profile, and that the node does not let us read."""
    unread = {Signal.CONTROLWORD} if profile.drive.usable else {Signal.CONTROLWORD, Signal.TARGET_TORQUE}
    if profile.drive.evidence == STANDARD:
        unread |= {Signal.TORQUE_ACTUAL, Signal.TORQUE_DEMAND}  # a run does without them
    entries = [entry for signal, entry in profile.entries().items() if signal not in unread]
    return [entry for entry in entries if _unless_refused(partial(node.read, entry)) is None]


def _nmt_state(node: Node) -> int | None:
    """Return the NMT state of a node by its next heartbeat, else by an answer to node guarding; None: neither came."""
    period = _unless_refused(lambda: node.read(PRODUCER_HEARTBEAT))
    if period:
        node.wait_for_state(min(2 * period * 1_000_000, LONGEST_HEARTBEAT_NS))
        return node.state
    # A request of node guarding begins life guarding where it is set up, and its end would then be a fault.
    watched = [_unless_refused(partial(node.read, entry)) or 0 for entry in (GUARD_TIME, LIFE_TIME_FACTOR)]
    if not all(watched):
        node.ask_state()
        node.wait_for_state(GUARDING_NS)
    return node.state


def _unless_refused(ask: Callable[[], Value]) -> Value | None:
    """Return an answer; None when the node refuses or stays silent."""
    with suppress(BusConfigurationError, BusTimeoutError):
        return ask()
    return None


class CanopenAccess(BusAccess):
    """The I/O half of CANopen; its buses are opened by python-can, its logs take CAN frames."""

    def logs(self, record: Path | None, buses: Sequence[str], *, simulated: bool) -> Logs:
        return frame_logs(record, buses, simulated=simulated)

    def open_bus(self, section: BusSection, clock: Clock, log: FrameLog | None) -> CanopenBus:
        return CanopenBus(open_can(can_section(section)), clock, log, owned=True)

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        profile = load_profile(axis.profile)
        if not isinstance(profile, CanopenProfile) or profile.torque.rated is None:
            return None
        mapped = profile.torque.rated
        with _asked(can_section(section), {name: (axis, profile)}) as nodes:
            raw = nodes[name].optional(mapped.entry)
        return None if raw is None else raw * RATED_TORQUE_UNITS[mapped.unit]

    def fitted(self, section: BusSection, axes: Axes) -> Mapping[str, DriveProfile]:
        loaded = {name: (axis, canopen_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        general = {name: each for name, each in loaded.items() if each[1].drive.evidence == STANDARD}
        if not general:
            return {}
        with _asked(can_section(section), general) as nodes:
            return {name: fit_to_drive(profile, nodes[name]) for name, (_, profile) in general.items()}

    def scan(self, section: BusSection, axes: Axes, profiles: str | Path | None, nodes: Sequence[int] = ()) -> Scan:
        own = can_section(section)
        with opened(own, axes) as wire:
            return scan_bus(wire, own.listen, own.bitrate, profiles_of(CanopenProfile, profiles), nodes or NODES)

    @contextmanager
    def onlooker(self, section: BusSection, axes: Axes) -> Iterator[BusObserver]:
        own = can_section(section)
        drives = {name: (axis.node, canopen_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        with opened(own, axes) as wire:
            yield BusObserver(wire, drives, own.listen, own.master_node or MASTER_NODES[0])

    def checks(self, section: BusSection, axes: Axes, rate: float) -> tuple[Check, ...]:
        own = can_section(section)
        further = partial(_on_the_bus, section=own, axes=axes, rate=rate)
        return checks_on(opened(own, axes), adapter_checks(own), further)


def fit_to_drive(profile: CanopenProfile, node: Node) -> CanopenProfile:
    """Return a general profile, fitted to the objects of this drive; nothing is written.

    Raises BusError, and BusConfigurationError when the node is no CiA 402 drive.
    """
    try:
        return fitted(profile, uploaded(profile, node.found))
    except EdsError as error:
        told = "; ".join(fault.message for fault in error.faults)
        raise BusConfigurationError(f"{node.label}: {told}. Nothing was written") from error


def opened(section: CanSection, axes: Axes) -> AbstractContextManager[Wire]:
    """Open a bus for as long as the block lasts; a simulated one has the drives of these axes, in real time.

    Raises UsageError or BusError.
    """
    # A multicast bus that cannot be kept apart from others says so in its own name.
    name = "" if section.interface == "udp_multicast" else f"{section.interface}:{section.channel}"
    if section.simulated:
        section = replace(section, channel=",".join(f"{axis.profile}@{axis.node}" for axis in axes.values()))
    return _opened(section, name)


@contextmanager
def _opened(section: CanSection, name: str = "") -> Iterator[Wire]:
    """Open a bus for as long as the block lasts; without a name it has its own."""
    can_bus = open_can(section)
    try:
        yield Wire(can_bus, MonotonicClock(), name or can_bus.channel_info)
    finally:
        can_bus.shutdown()


@contextmanager
def _asked(section: CanSection, drives: Mapping[str, tuple[RigAxis, CanopenProfile]]) -> Iterator[dict[str, Node]]:
    """Open a bus to read from drives by SDO before a plan is made. First it listens for another master.

    Raises UsageError, BusError or ForeignMasterError.
    """
    guarded = [axis.node for axis, profile in drives.values() if profile.link_loss.life_guarding]
    one = OneMaster([axis.node for axis, _ in drives.values()], section.master_node or MASTER_NODES[0], guarded)
    with _opened(section) as wire:
        try:
            listen(wire, section.listen, one, wire.name).refuse(one.master_node)
            yield {name: Node(wire, axis.node, f"node {axis.node} (axis {name})") for name, (axis, _) in drives.items()}
        except BusTimeoutError as error:
            raise BusTimeoutError(f"{error}; {NO_ANSWER_ADVICE}") from error


def _on_the_bus(wire: Wire, section: CanSection, axes: Axes, rate: float) -> tuple[Check, ...]:
    """Check that there is no other master, then measure the round trip to a drive; raises BusError."""
    nodes = [axis.node for axis in axes.values()]
    master_node = section.master_node or MASTER_NODES[0]
    heard = listen(wire, section.listen, OneMaster(nodes, master_node), wire.name)
    heard.refuse_noise()
    if heard.masters:
        return scan_result.another_master(heard.sentence())
    alone = Check("other_masters", True, "none heard")
    node = nodes[0]
    return alone, *round_trip_checks(node, round_trips(wire, node), scan_result.QUESTIONS, rate)


ACCESS = CanopenAccess()
