"""Frames by which somebody else commands our drives, or speaks in our name.

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

from collections.abc import Callable, Collection
from enum import Enum
from functools import partial

from haptic_fieldbus.buses.canopen.frames import REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.errors import ForeignMasterError
from haptic_fieldbus.protocols.canopen.cob_ids import (
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
    """How much a frame of somebody else matters."""

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
    """Watch for somebody else, by handlers on the wire; in a period without such frames it does nothing."""

    def __init__(self, wire: Wire, one: OneMaster, warn: Callable[[str], None]) -> None:
        self.cob_id: int | None = None
        """COB-ID of the first command of somebody else; None while there was none."""
        self._one = one
        self._warn = warn
        self._told: set[int] = set()
        for can_id in one.watched:
            wire.listen(can_id, partial(self._heard, can_id))

    @property
    def code(self) -> int | None:
        """Code of that frame for the header of an axis; None while there was none."""
        return None if self.cob_id is None else code_of(self.cob_id)

    def refuse(self, bus: str, done: str) -> None:
        """Raise ForeignMasterError when a command came since we listened; `done` tells how far we got."""
        if self.cob_id is not None:
            raise ForeignMasterError(
                f"another master on {bus}: {frame_words(self.cob_id)} came while we prepared. "
                f"{advice((self.cob_id,), self._one.master_node)}. {done}"
            )

    def _heard(self, can_id: int, data: bytes | bytearray) -> None:
        weight = self._one.weigh(can_id, data)
        if weight is Severity.COMMAND and self.cob_id is None:
            self.cob_id = can_id
        elif weight is Severity.QUESTION and can_id not in self._told:
            self._told.add(can_id)
            self._warn(f"somebody else asks our drives: {frame_words(can_id)}. Torque was not affected")


def frame_words(can_id: int) -> str:
    """Return the meaning of a frame: its COB-ID in words, or the request of node guarding that a remote frame is."""
    return cob_id_words(code_of(can_id))


def code_of(can_id: int) -> int:
    """Return the code of a frame for the header of an axis, which has 16 bits."""
    return can_id & CAN_ID | (REMOTE if can_id & REMOTE_FLAG else 0)


def advice(masters: Collection[int], master_node: int) -> str:
    """Return what to do about somebody else, by the frames that were heard."""
    only = set(masters) == {HEARTBEAT_COB_ID + master_node}
    words = "A bus has one master: end the other, and put axes that share a bus into one rig"
    if only:
        words += f"; or, if a device has the node-ID {master_node}, choose another master_node for the bus in the rig"
    return words
