"""Process data objects (PDOs): assignment of signals to frames, and the worst-case length of a frame.

References: CiA 301 7.5.2.33-38 (PDO parameters); the worst-case bit count is Tindell's bound as corrected by Davis et
al., Real-Time Systems 35 (2007), doi:10.1007/s11241-007-9012-7.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import accumulate

from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.errors import ImageTooLargeError
from haptic_fieldbus.signals import Signal

SYNC_COB_ID = 0x080
HEARTBEAT_COB_ID = 0x700
"""COB-ID of the heartbeat of node 0; that of a node has its node-ID added."""
PREDEFINED = range(1, 5)
"""Numbers of the PDOs that have a COB-ID in the predefined connection set (CiA 301, 7.3.5)."""
LARGEST_PAYLOAD = 8
"""Payload of a CAN frame [octets]."""
SYNCHRONOUS_TYPES = range(241)
"""Transmission types 0 to 240, which refer to SYNC; 254 and 255 are event-driven."""
INTERFRAME_SPACE_BITS = 3


class Direction(Enum):
    """Direction of a PDO as the drive sees it, which transmits TPDOs and receives RPDOs."""

    TPDO = "TPDO"
    RPDO = "RPDO"


@dataclass(frozen=True)
class Pdo:
    """One PDO of one node with the objects mapped into it."""

    direction: Direction
    number: int
    node: int
    transmission_type: int
    signals: tuple[Signal, ...]
    entries: tuple[ObjectEntry, ...]

    @property
    def name(self) -> str:
        """Name in messages, such as `TPDO1`."""
        return f"{self.direction.value}{self.number}"

    @property
    def cob_id(self) -> int:
        """COB-ID of the predefined connection set (CiA 301, 7.3.5), which has PDO 1 to 4."""
        base = 0x180 if self.direction is Direction.TPDO else 0x200
        return base + 0x100 * (self.number - 1) + self.node

    @property
    def mapping_index(self) -> int:
        """Index of the mapping parameter record."""
        return (0x1A00 if self.direction is Direction.TPDO else 0x1600) + self.number - 1

    @property
    def size(self) -> int:
        """Size of the payload [octets]."""
        return sum(entry.type.size for entry in self.entries)

    @property
    def synchronous(self) -> bool:
        """True when the PDO refers to SYNC, false when it is event-driven."""
        return self.transmission_type in SYNCHRONOUS_TYPES


def lay_out(
    direction: Direction,
    offered: Mapping[Signal, ObjectEntry],
    signals: Sequence[Signal],
    *,
    node: int,
    transmission_type: int,
    room: Mapping[int, int],
) -> tuple[Pdo, ...]:
    """Return PDOs filled with the signals in their order; raises ImageTooLargeError when the drive has too few.

    `offered` has the object of each signal; `room` has the number of mapping entries of each PDO of the direction, by
    the number of the PDO.
    """
    available = [number for number in PREDEFINED if room.get(number)]
    frames = _frames(offered, signals, [room[number] for number in available])
    if len(frames) > len(available):
        raise ImageTooLargeError(
            f"{len(signals)} signals need {len(frames)} {direction.value}s of node {node}, which has {len(available)}: "
            + ", ".join(signal.value for signal in signals)
        )
    return tuple(
        Pdo(direction, number, node, transmission_type, tuple(frame), tuple(offered[signal] for signal in frame))
        for number, frame in zip(available, frames, strict=False)
    )


def _frames(
    offered: Mapping[Signal, ObjectEntry], signals: Sequence[Signal], rooms: Sequence[int]
) -> list[list[Signal]]:
    """Return the signals of each PDO; beyond those that the drive has, each takes as many as its last one."""
    last = rooms[-1] if rooms else LARGEST_PAYLOAD
    frames: list[list[Signal]] = [[]]
    for signal in signals:
        octets = sum(offered[member].type.size for member in frames[-1]) + offered[signal].type.size
        entries = rooms[len(frames) - 1] if len(frames) <= len(rooms) else last
        if octets > LARGEST_PAYLOAD or len(frames[-1]) == entries:
            frames.append([])
        frames[-1].append(signal)
    return frames


def placed(pdos: Sequence[Pdo], offset: int) -> tuple[tuple[Pdo, int], ...]:
    """Return each PDO with the offset of its octets in the image; the PDOs follow one another from `offset` on."""
    # `accumulate` also yields the end of the last PDO, which `zip` drops.
    sizes = accumulate((pdo.size for pdo in pdos), initial=offset)
    return tuple(zip(pdos, sizes, strict=False))


def worst_case_bits(octets: int) -> int:
    """Return the bits of a data frame with 11-bit identifier and worst-case stuffing, interframe space included."""
    # A frame has 44 bits beside its data. Stuffing covers 34 of them and the data, and adds at worst one bit for every
    # four bits after the first.
    return 8 * octets + 44 + INTERFRAME_SPACE_BITS + (33 + 8 * octets) // 4
