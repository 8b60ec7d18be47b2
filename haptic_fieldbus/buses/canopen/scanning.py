"""Finding the nodes of a bus by reading alone: first listen, then ask every node-ID, then those that answered.

All 127 node-IDs are asked for their device type (1000h), which every device has, and answers are collected meanwhile:
a node-ID that nobody has costs no time-out. The NMT state comes from a heartbeat. A node that sends none is asked once
by node guarding, unless it is set up for life guarding, which the question would begin.

When another master commands on the bus nothing is asked, since two clients would mix up each other's answers. The nodes
are then those whose frames were heard.

Reference: CiA 301 7.2.4 (SDO), 7.2.8 (NMT), 7.5.2.1 (1000h), 7.5.2.7 (1008h), 7.5.2.21 (1018h).
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeVar

from haptic_fieldbus.buses.canopen.node import GUARDING_NS, HEARTBEAT_STATE, Node, nmt_state_name, request
from haptic_fieldbus.buses.canopen.other_master import ForeignMaster, FrameCounts, OneMaster, frame_words, listen
from haptic_fieldbus.buses.canopen.setup import (
    DEVICE_TYPE,
    DRIVE_PROFILE,
    PRODUCT_CODE,
    REVISION,
    SERIAL,
    STATUSWORD,
    VENDOR_ID,
)
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.scan_result import FoundNode, Scan
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.drive.profile import STANDARD
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError
from haptic_fieldbus.protocols.canopen.bus import FROM_A_NODE, NODES, SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID
from haptic_fieldbus.protocols.canopen.eds_values import PER_AXIS, axes_words
from haptic_fieldbus.protocols.canopen.fitting import MatchQuality, fitting
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.watch_traffic import GUARD_TIME, LIFE_TIME_FACTOR, PRODUCER_HEARTBEAT
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.signals import Signal

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
    for node in NODES:
        wire.listen(HEARTBEAT_COB_ID + node, partial(_note_state, states, node))
    heard = listen(wire, listening, one, wire.name)
    heard.refuse_noise()
    if heard.masters:
        words = ", ".join(frame_words(can_id) for can_id in sorted(heard.masters))
        told = f"another master on {wire.name}: {words}. No requests were sent; the list shows received frames only"
        return Scan(wire.name, tuple(_heard_nodes(heard, states)), heard.sentence(), told)
    others: list[str] = []
    foreign = ForeignMaster(wire, one, others.append)
    answered = _answering(wire, bitrate, nodes)
    found = {node: FoundNode(node, nmt_state=nmt_state_name(state)) for node, state in states.items()}
    for node in answered:
        if others or foreign.cob_id is not None:
            found.setdefault(node, FoundNode(node))
            continue
        found[node] = _found(Node(wire, node, f"node {node}"), states.get(node), profiles)
    began = [] if foreign.cob_id is None else [f"another master on {wire.name}: {frame_words(foreign.cob_id)}"]
    in_order = tuple(found[node] for node in sorted(found))
    return Scan(wire.name, in_order, heard.sentence(), "; ".join([*began, *others]))


def _note_state(states: dict[int, int], node: int, data: bytes | bytearray) -> None:
    if data:
        states[node] = data[0] & HEARTBEAT_STATE


def _heard_nodes(heard: FrameCounts, states: dict[int, int]) -> Iterable[FoundNode]:
    """Yield the nodes whose frames were heard, in the order of their node-IDs."""
    bases = {base + node: node for base in FROM_A_NODE for node in NODES}
    for node in sorted({bases[can_id] for can_id in heard.frames if can_id in bases}):
        yield FoundNode(node, nmt_state=nmt_state_name(states[node]) if node in states else None)


def _answering(wire: Wire, bitrate: int, nodes: Sequence[int]) -> list[int]:
    """Ask these node-IDs for their device type, and return those that answered."""
    found: set[int] = set()
    for node in nodes:
        wire.listen(SDO_RESPONSE_COB_ID + node, partial(_note_answer, found, node))
    gap_ns = max(1_000_000, round(BITS_OF_A_QUESTION * 1e9 / bitrate))
    for node in nodes:
        wire.send(SDO_REQUEST_COB_ID + node, request(DEVICE_TYPE, None))
        _receive(wire, gap_ns)
    _receive(wire, LATEST_ANSWER_NS)
    return sorted(found)


def _note_answer(found: set[int], node: int, data: bytes | bytearray) -> None:
    found.add(node)


def _receive(wire: Wire, duration_ns: int) -> None:
    deadline_ns = wire.clock.now_ns() + duration_ns
    while wire.pump(deadline_ns):
        pass


def _found(node: Node, state: int | None, profiles: Sequence[CanopenProfile]) -> FoundNode:
    """Read the remaining facts of a node that answered."""
    device_type = _unless_refused(lambda: node.read(DEVICE_TYPE))
    vendor, product, revision, serial = (
        _unless_refused(partial(node.read, entry)) for entry in (VENDOR_ID, PRODUCT_CODE, REVISION, SERIAL)
    )
    name = _unless_refused(lambda: node.text(NAME))
    drives = device_type is not None and device_type & 0xFFFF == DRIVE_PROFILE
    statusword = _unless_refused(lambda: node.read(STATUSWORD)) if drives else None
    profile, sure = _profile_of(node, fitting(profiles, vendor, product, name) if drives else [])
    state = _nmt_state(node) if state is None else state
    return FoundNode(
        node.id,
        vendor,
        product,
        revision,
        serial,
        name or None,
        profile,
        sure if drives else "not a CiA 402 drive" if device_type is not None else None,
        None if state is None else nmt_state_name(state),
        None if statusword is None else CIA402.state(statusword).value,
    )


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
        return None, f"no matching profile: {reasons}{told}{_axes_of(node)}"
    best, sureness = usable[0]
    equal = [profile.name for profile, other in usable[1:] if other is sureness]
    also = f"; {', '.join(equal)} would match too" if equal else ""
    has = "the objects that force needs" if best.drive.evidence == STANDARD else "all objects of the profile"
    return best.name, f"{sureness.value}; it has {has}{also}{told}"


def _axes_of(node: Node) -> str:
    """Return what to do about a node with several axes in the sub-indices of its objects; empty for any other."""
    axes = {index: [ObjectEntry(index, DataType.UINT16, subindex) for subindex in (1, 2)] for index in PER_AXIS}
    found = [
        index
        for index, entries in axes.items()
        if all(_unless_refused(partial(node.read, entry)) is not None for entry in entries)
    ]
    return f"; {axes_words(found)}" if found else ""


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
    try:
        return ask()
    except (BusConfigurationError, BusTimeoutError):
        return None
