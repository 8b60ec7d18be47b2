"""Listening to a bus before anything is sent on it, and the refusal of a bus that has a master already."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from haptic_fieldbus.buses.canopen.foreign import OneMaster, Severity, advice, frame_words
from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.errors import BusError, ForeignMasterError
from haptic_fieldbus.numerals import exactly
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
                f"somebody else is on {self.bus}: within {exactly(self.seconds)} s came {_named(self.masters)}. "
                f"{advice(self.masters, master_node)}. Nothing was sent"
            )


def listen(wire: Wire, seconds: float, one: OneMaster, bus: str) -> Heard:
    """Receive for this time [s] and send nothing; raises BusError when the bus fails."""
    frames: Counter[int] = Counter()
    masters: Counter[int] = Counter()

    def note(can_id: int, data: bytes | bytearray) -> None:
        frames[can_id] += 1
        if one.weigh(can_id, data) is not Severity.NOTHING:
            masters[can_id] += 1

    deadline_ns = wire.clock.now_ns() + round(seconds * 1e9)
    with wire.overhear(note):
        while wire.clock.now_ns() < deadline_ns:
            wire.pump(deadline_ns)
    return Heard(bus, seconds, frames, masters)


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
