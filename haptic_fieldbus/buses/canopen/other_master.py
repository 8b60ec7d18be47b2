"""Frames by which another master commands our drives, or sends with our identifiers.

A CANopen bus has one master. A second one is dangerous even when it never touches our drives: its heartbeat feeds their
guards when we are dead, its SYNC makes them latch and answer at instants that are not ours. So each frame is weighed
that only the one master of these drives may send:

- A command: SYNC, our own heartbeat, a set-point, an NMT command, an SDO download. Before we begin it is a reason to
  refuse, in the loop a reason to trip.
- A question: an SDO upload, a request of node guarding. Before we begin it is a reason to refuse as well, for who asks
  now may command next; in the loop it is told once, because it changes nothing. To a drive under life guarding the
  request is a command: it feeds the guard.

Our own frames never come here: the wire drops those that an interface gives back.

Reference: CiA 301 7.2.2 (PDO), 7.2.4 (SDO), 7.2.5 (SYNC), 7.2.8 (NMT, node guarding, heartbeat), 7.3.5 (COB-IDs).
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import partial

from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, frame_bits
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.errors import BusError, ForeignMasterError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.bus import (
    FROM_A_NODE,
    NMT_COB_ID,
    REMOTE,
    RPDO_COB_IDS,
    SDO_REQUEST_COB_ID,
    cob_id_words,
)
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID, SYNC_COB_ID

DOWNLOADS = (0, 1, 6)
"""Client command specifiers that write: segment, initiate, block (CiA 301 7.2.4.3)."""
ALL_NODES = 0
"""Node-ID of an NMT command that all nodes obey."""
CAN_ID = 0x7FF


class Severity(Enum):
    """Severity of a frame that another device sent."""

    COMMAND = "command"
    QUESTION = "question"
    NOTHING = "nothing"


class OneMaster:
    """The frames that only one master may send, for the drives with these node-IDs."""

    def __init__(self, nodes: Collection[int], master_node: int, guarded: Collection[int] = ()) -> None:
        """Take the node-IDs of the drives, that of the master, and of the drives those under life guarding."""
        self.master_node = master_node
        self._nodes = frozenset(nodes)
        commands = {SYNC_COB_ID, HEARTBEAT_COB_ID + master_node}
        commands |= {base + node for base in RPDO_COB_IDS for node in nodes}
        self._plain = dict.fromkeys(commands, Severity.COMMAND)
        self._plain |= {REMOTE_FLAG | HEARTBEAT_COB_ID + node: Severity.QUESTION for node in nodes}
        self._plain |= {REMOTE_FLAG | HEARTBEAT_COB_ID + node: Severity.COMMAND for node in guarded}
        self._requests = frozenset(SDO_REQUEST_COB_ID + node for node in nodes)

    @property
    def watched(self) -> frozenset[int]:
        """CAN-IDs of all frames that can matter, with the flags of the wire."""
        return frozenset(self._plain) | self._requests | {NMT_COB_ID}

    def weigh(self, can_id: int, data: bytes | bytearray) -> Severity:
        """Return how much a frame with this CAN-ID matters; one that is too short counts as a command."""
        if can_id in self._requests:
            writes = not data or data[0] >> 5 in DOWNLOADS
            return Severity.COMMAND if writes else Severity.QUESTION
        if can_id == NMT_COB_ID:
            concerned = data[1] if len(data) > 1 else ALL_NODES
            return Severity.COMMAND if concerned == ALL_NODES or concerned in self._nodes else Severity.NOTHING
        return self._plain.get(can_id, Severity.NOTHING)


class ForeignMaster:
    """Watch for another master by handlers on the wire; a period without such frames costs nothing."""

    def __init__(self, wire: Wire, one: OneMaster, warn: Callable[[str], None]) -> None:
        self.cob_id: int | None = None
        """COB-ID of the first command of another master; None while there was none."""
        self._one, self._warn = one, warn
        self._told: set[int] = set()
        for can_id in one.watched:
            wire.listen(can_id, partial(self._heard, can_id))

    @property
    def code(self) -> int | None:
        """Code of that frame for the header of an axis; None while there was none."""
        return None if self.cob_id is None else code_of(self.cob_id)

    def refuse(self, bus: str, done: str) -> None:
        """Raise ForeignMasterError when a command came since we listen; `done` is a sentence on what was done."""
        if self.cob_id is not None:
            raise ForeignMasterError(
                f"another master on {bus}: received {frame_words(self.cob_id)} during setup. "
                f"{advice((self.cob_id,), self._one.master_node)}. {done}"
            )

    def _heard(self, can_id: int, data: bytes | bytearray) -> None:
        weight = self._one.weigh(can_id, data)
        if weight is Severity.COMMAND and self.cob_id is None:
            self.cob_id = can_id
        elif weight is Severity.QUESTION and can_id not in self._told:
            self._told.add(can_id)
            asks = f"another program sends requests to our drives: {frame_words(can_id)}"
            self._warn(f"{asks}. Torque was not affected")


def frame_words(can_id: int) -> str:
    """Return the meaning of a frame: its COB-ID in words, or the request of node guarding that a remote frame is."""
    return cob_id_words(code_of(can_id))


def code_of(can_id: int) -> int:
    """Return the code of a frame for the header of an axis, which has 16 bits."""
    return can_id & CAN_ID | (REMOTE if can_id & REMOTE_FLAG else 0)


def advice(masters: Collection[int], master_node: int) -> str:
    """Return advice about another master, chosen by the frames that were heard."""
    only = set(masters) == {HEARTBEAT_COB_ID + master_node}
    words = "A bus has one master: end the other one, and put axes that share a bus into one rig"
    if only:
        words += f"; or, if a device has the node-ID {master_node}, choose another master_node for the bus in the rig"
    return words


# Listening to a bus before anything is sent on it, and the refusal of a bus that has a master already.

DEAF = "Not detectable: a master that sends nothing or rarely, and a node without heartbeat"
MOST_NAMED = 4
"""Kinds of frames that the sentence names; the others are counted."""


@dataclass(frozen=True)
class FrameCounts:
    """The frames that came while nothing was sent, as numbers by CAN-ID."""

    bus: str
    seconds: float
    frames: Mapping[int, int]
    masters: Mapping[int, int]
    """Frames that only a master may send, as numbers by CAN-ID."""
    bits: Mapping[int, int] = field(default_factory=dict)
    """Bits of all frames by CAN-ID."""

    def sentence(self) -> str:
        """Return a line for people: the frames that came, and what could not be heard."""
        if not self.seconds:
            return f"{self.bus}: not checked for another master (bus listen = 0)"
        return (
            f"{self.bus}: listened for {exactly(self.seconds)} s without sending; received {_named(self.frames)}. "
            f"{DEAF}"
        )

    def refuse_noise(self) -> None:
        """Raise BusError when nothing but error frames came: what is sent at a wrong bit rate destroys other frames."""
        if self.frames and all(can_id & ERROR_FLAG for can_id in self.frames):
            raise BusError(
                f"{self.bus}: only error frames within {exactly(self.seconds)} s, so nothing was sent: do all devices "
                "use this bit rate? Check CAN high and CAN low, and both 120 Ω terminators"
            )

    def refuse(self, master_node: int) -> None:
        """Raise ForeignMasterError when a master was heard; `master_node` is our own node-ID."""
        if self.masters:
            raise ForeignMasterError(
                f"another master on {self.bus}: received {_named(self.masters)} within {exactly(self.seconds)} s. "
                f"{advice(self.masters, master_node)}. Nothing was sent"
            )


class ForeignLoad:
    """Share of a bus that frames of other devices take: while nothing was sent, or in the loop, the larger one.

    On SocketCAN no frame of theirs wakes us in the loop, so those from before it are all that is known.
    """

    def __init__(self, wire: Wire, heard: FrameCounts, nodes: Collection[int], bitrate: int) -> None:
        """Take what was heard before, the nodes whose frames are part of the exchange, and the bit rate [bit/s]."""
        own = {base + node for base in FROM_A_NODE for node in nodes}
        bits = sum(bits for can_id, bits in heard.bits.items() if can_id not in own)
        self._before = bits / (heard.seconds * bitrate) if heard.seconds else 0.0
        self._wire, self._bitrate = wire, bitrate
        self._begun_ns: int | None = None

    def begin(self) -> None:
        """Count from now on."""
        self._wire.foreign_bits, self._begun_ns = 0, self._wire.clock.now_ns()

    @property
    def share(self) -> float:
        now_ns = self._wire.clock.now_ns()
        lasted_ns = 0 if self._begun_ns is None else now_ns - self._begun_ns
        since = self._wire.foreign_bits * 1e9 / (lasted_ns * self._bitrate) if lasted_ns else 0.0
        return max(since, self._before)


def listen(wire: Wire, seconds: float, one: OneMaster, bus: str) -> FrameCounts:
    """Receive for this time [s] and send nothing; raises BusError when the bus fails."""
    frames: Counter[int] = Counter()
    masters: Counter[int] = Counter()
    bits: Counter[int] = Counter()

    def note(can_id: int, data: bytes | bytearray) -> None:
        frames[can_id] += 1
        bits[can_id] += frame_bits(can_id, data)
        if one.weigh(can_id, data) is not Severity.NOTHING:
            masters[can_id] += 1

    deadline_ns = wire.clock.now_ns() + round(seconds * 1e9)
    with wire.overhear(note):
        while wire.clock.now_ns() < deadline_ns:
            wire.pump(deadline_ns)
    return FrameCounts(bus, seconds, frames, masters, bits)


def _named(frames: Mapping[int, int]) -> str:
    """Return the most frequent frames with their numbers; `nothing` when there are none."""
    if not frames:
        return "nothing"
    ordered = sorted(frames, key=lambda can_id: (-frames[can_id], can_id))
    named = [f"{_words(can_id)} {frames[can_id]}×" for can_id in ordered[:MOST_NAMED]]
    rest = sum(frames[can_id] for can_id in ordered[MOST_NAMED:])
    return ", ".join(named) + (f" and {rest} others" if rest else "")


def _words(can_id: int) -> str:
    if can_id & ERROR_FLAG:
        return "error frame"
    if can_id & EXTENDED_FLAG:
        return f"extended frame ({can_id & CAN_ID_MASK:08X}h)"
    if can_id & REMOTE_FLAG and can_id & 0x780 != HEARTBEAT_COB_ID:
        return f"remote frame ({can_id & 0x7FF:03X}h)"
    return frame_words(can_id)
