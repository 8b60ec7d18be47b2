"""Listening to a bus before anything is sent on it, and the refusal of a bus that has a master already."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from haptic_fieldbus.buses.canopen.foreign import OneMaster, Severity, advice, frame_words
from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, frame_bits
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.errors import BusError, ForeignMasterError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.cob_ids import FROM_A_NODE
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID

DEAF = "It cannot be heard: a master that sends nothing or more rarely, and a node without heartbeat"
MOST_NAMED = 4
"""Kinds of frames that the sentence names; the others are counted."""


@dataclass(frozen=True)
class Heard:
    """The frames that came while nothing was sent, as numbers by CAN-ID."""

    bus: str
    seconds: float
    frames: Mapping[int, int]
    masters: Mapping[int, int]
    """Those of them that only one master may send."""
    bits: Mapping[int, int] = field(default_factory=dict)
    """Bits of all frames by CAN-ID."""

    def sentence(self) -> str:
        """Return a line for people: the frames that came, and what could not be heard."""
        if not self.seconds:
            return f"{self.bus}: not listened to before sending (bus listen = 0)"
        return f"{self.bus}: listened for {exactly(self.seconds)} s, nothing sent; heard {_named(self.frames)}. {DEAF}"

    def refuse_noise(self) -> None:
        """Raise BusError when nothing but error frames came: what is sent at a wrong bit rate destroys other frames."""
        if self.frames and all(can_id & ERROR_FLAG for can_id in self.frames):
            raise BusError(
                f"{self.bus}: within {exactly(self.seconds)} s came nothing but error frames, so nothing was sent: "
                "is the bit rate that of the other devices? Check CAN high and CAN low, and both 120 Ω terminators"
            )

    def refuse(self, master_node: int) -> None:
        """Raise ForeignMasterError when a master was heard; `master_node` is our own node-ID."""
        if self.masters:
            raise ForeignMasterError(
                f"another master on {self.bus}: within {exactly(self.seconds)} s came {_named(self.masters)}. "
                f"{advice(self.masters, master_node)}. Nothing was sent"
            )


class ForeignLoad:
    """Share of a bus that frames of other devices take: while nothing was sent, or in the loop, the larger one.

    On SocketCAN no frame of theirs wakes us in the loop, so those from before it are all that is known.
    """

    def __init__(self, wire: Wire, heard: Heard, nodes: Collection[int], bitrate: int) -> None:
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


def listen(wire: Wire, seconds: float, one: OneMaster, bus: str) -> Heard:
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
    return Heard(bus, seconds, frames, masters, bits)


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
