"""Opening CANopen buses on any python-can interface."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from haptic_fieldbus.buses.access import ANSWER_TIMEOUT, SHOWN, BusAccess, checks_on, look_at, profiles_of
from haptic_fieldbus.buses.canopen.frames import FrameLog, frame_logs
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import Node, nmt_state_name, request
from haptic_fieldbus.buses.canopen.opening import adapter_checks, open_can
from haptic_fieldbus.buses.canopen.other_master import ForeignMaster, OneMaster, frame_words, listen
from haptic_fieldbus.buses.canopen.scanning import scan_bus
from haptic_fieldbus.buses.canopen.setup import DEVICE_TYPE, ERROR_CODE, NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import ECHOING, Wire
from haptic_fieldbus.buses.release import FAULTS
from haptic_fieldbus.buses.scan_result import Check, DriveReading, Scan, another_master, timing_checks
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.drive.profile import STANDARD, DriveProfile
from haptic_fieldbus.drive.rig import RATED_TORQUE_UNITS, BusSection, RigAxis
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, EdsError
from haptic_fieldbus.protocols.canopen.bus import (
    NODES,
    SDO_REQUEST_COB_ID,
    SDO_RESPONSE_COB_ID,
    CanSection,
    can_section,
)
from haptic_fieldbus.protocols.canopen.eds_values import PER_AXIS, axes_words
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.fitting import fitted, uploaded
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.canopen.traffic import MASTER_NODES
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
            axis: (Node(wire, node, f"node {node} (axis {axis})"), _shown(profile))
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
                error_code=partial(_error_code, node),
                silent=NO_ANSWER_ADVICE,
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


def _error_code(node: Node, values: Mapping[Signal, int]) -> int | None:
    """Return the error code of a drive in fault; from its emergency message where it has no 603Fh."""
    if CIA402.state(values.get(Signal.STATUSWORD, 0)) not in FAULTS:
        return None
    try:
        return node.read(ERROR_CODE, ANSWER_TIMEOUT)
    except (BusConfigurationError, BusTimeoutError):
        return node.emergency or None


def _has_axes(node: Node, index: int) -> bool:
    try:
        return all(node.found(index, subindex) is not None for subindex in (1, 2))
    except (BusConfigurationError, BusTimeoutError):
        return False


def _shown(profile: CanopenProfile) -> dict[Signal, ObjectEntry]:
    entries = profile.entries()
    return {signal: entries[signal] for signal in SHOWN if signal in entries}


# The way to a node and back, measured by SDO uploads of its device type.
#
# A round trip holds the adapter twice, the bus and the SDO server of the drive, which a drive runs beside its control
# loop. So the least one bounds what the adapter takes, and the spread is that of both.

QUESTIONS = 200
ANSWER_NS = 100_000_000
SLOW = (
    "the adapter delays frames, or the drive answers late: use a SocketCAN adapter instead of a serial one, and see "
    "usb_latency_timer"
)


def round_trips(wire: Wire, node: int, questions: int = QUESTIONS) -> list[float]:
    """Return the times of so many round trips [s]; those without an answer are missing. Raises BusError."""
    answered: list[int] = []
    wire.listen(SDO_RESPONSE_COB_ID + node, lambda data: answered.append(wire.clock.now_ns()))
    times: list[float] = []
    for _ in range(questions):
        answered.clear()
        asked_ns = wire.clock.now_ns()
        wire.send(SDO_REQUEST_COB_ID + node, request(DEVICE_TYPE, None))
        while not answered and wire.pump(asked_ns + ANSWER_NS):
            pass
        if answered:
            times.append((answered[0] - asked_ns) * 1e-9)
        elif not times:
            break  # a node that is not there
    return times


def round_trip_checks(node: int, times: list[float], asked: int, rate: float) -> tuple[Check, Check]:
    """Return the checks of the usual round trip and of its jitter, for a loop of this rate [Hz]."""
    silent = f"{NO_ANSWER_ADVICE}; `haptic-fieldbus scan` lists the nodes"
    return timing_checks(f"node {node}", times, asked, rate, silent=silent, slow=SLOW)


class CanopenAccess(BusAccess):
    """The I/O half of CANopen; its buses are opened by python-can, its logs take CAN frames."""

    def logs(
        self, record: Path | None, buses: Sequence[str], *, simulated: bool
    ) -> AbstractContextManager[Mapping[str, FrameLog]]:
        return frame_logs(record, buses, simulated=simulated)

    def open_bus(self, section: BusSection, clock: Clock, log: FrameLog | None) -> CanopenBus:
        return CanopenBus(open_can(can_section(section)), clock, log, owned=True, echoes=section.interface in ECHOING)

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        profile = load_profile(axis.profile)
        if not isinstance(profile, CanopenProfile) or profile.torque.rated is None:
            return None
        mapped = profile.torque.rated
        with _asked(can_section(section), {name: (axis, profile)}) as nodes:
            raw = nodes[name].optional(mapped.entry)
        return None if raw is None else raw * RATED_TORQUE_UNITS[mapped.unit]

    def fitted(self, section: BusSection, axes: Mapping[str, RigAxis]) -> Mapping[str, DriveProfile]:
        loaded = {name: (axis, canopen_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        general = {name: each for name, each in loaded.items() if each[1].drive.evidence == STANDARD}
        if not general:
            return {}
        with _asked(can_section(section), general) as nodes:
            return {name: fit_to_drive(profile, nodes[name]) for name, (_, profile) in general.items()}

    def scan(
        self, section: BusSection, axes: Mapping[str, RigAxis], profiles: str | Path | None, nodes: Sequence[int] = ()
    ) -> Scan:
        own = can_section(section)
        with opened(own, axes) as wire:
            return scan_bus(wire, own.listen, own.bitrate, profiles_of(CanopenProfile, profiles), nodes or NODES)

    @contextmanager
    def onlooker(self, section: BusSection, axes: Mapping[str, RigAxis]) -> Iterator[BusObserver]:
        own = can_section(section)
        drives = {name: (axis.node, canopen_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        with opened(own, axes) as wire:
            yield BusObserver(wire, drives, own.listen, own.master_node or MASTER_NODES[0])

    def checks(self, section: BusSection, axes: Mapping[str, RigAxis], rate: float) -> tuple[Check, ...]:
        own = can_section(section)
        return checks_on(
            opened(own, axes), adapter_checks(own), partial(_on_the_bus, section=own, axes=axes, rate=rate)
        )


def fit_to_drive(profile: CanopenProfile, node: Node) -> CanopenProfile:
    """Return a general profile, fitted to the objects of this drive; nothing is written.

    Raises BusError, and BusConfigurationError when the node is no CiA 402 drive.
    """
    try:
        return fitted(profile, uploaded(profile, node.found))
    except EdsError as error:
        told = "; ".join(fault.message for fault in error.faults)
        raise BusConfigurationError(f"{node.label}: {told}. Nothing was written") from error


@contextmanager
def opened(section: CanSection, axes: Mapping[str, RigAxis]) -> Iterator[Wire]:
    """Open a bus for as long as the block lasts; a simulated one has the drives of these axes, in real time.

    Raises UsageError or BusError.
    """
    name = f"{section.interface}:{section.channel}"
    if section.simulated:
        section = replace(section, channel=",".join(f"{axis.profile}@{axis.node}" for axis in axes.values()))
    can_bus = open_can(section)
    # A multicast bus that cannot be kept apart from others says so in its name.
    name = can_bus.channel_info if section.interface in ECHOING else name
    try:
        yield Wire(can_bus, MonotonicClock(), name, echoes=section.interface in ECHOING)
    finally:
        can_bus.shutdown()


@contextmanager
def _asked(section: CanSection, drives: Mapping[str, tuple[RigAxis, CanopenProfile]]) -> Iterator[dict[str, Node]]:
    """Open a bus to read from drives by SDO before a plan is made. First it listens for another master.

    Raises UsageError, BusError or ForeignMasterError.
    """
    can_bus = open_can(section)
    try:
        wire = Wire(can_bus, MonotonicClock(), can_bus.channel_info, echoes=section.interface in ECHOING)
        guarded = [axis.node for axis, profile in drives.values() if profile.link_loss.life_guarding]
        one = OneMaster([axis.node for axis, _ in drives.values()], section.master_node or MASTER_NODES[0], guarded)
        listen(wire, section.listen, one, wire.name).refuse(one.master_node)
        yield {name: Node(wire, axis.node, f"node {axis.node} (axis {name})") for name, (axis, _) in drives.items()}
    except BusTimeoutError as error:
        raise BusTimeoutError(f"{error}; {NO_ANSWER_ADVICE}") from error
    finally:
        can_bus.shutdown()


def _on_the_bus(wire: Wire, section: CanSection, axes: Mapping[str, RigAxis], rate: float) -> tuple[Check, ...]:
    """Check that there is no other master, then measure the round trip to a drive; raises BusError."""
    nodes = [axis.node for axis in axes.values()]
    master_node = section.master_node or MASTER_NODES[0]
    heard = listen(wire, section.listen, OneMaster(nodes, master_node), wire.name)
    heard.refuse_noise()
    if heard.masters:
        return another_master(heard.sentence())
    alone = Check("other_masters", True, "none heard")
    node = nodes[0]
    return alone, *round_trip_checks(node, round_trips(wire, node), QUESTIONS, rate)


ACCESS = CanopenAccess()
