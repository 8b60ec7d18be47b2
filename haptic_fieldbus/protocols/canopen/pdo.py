"""Process data objects (PDOs): assignment of signals to frames, and the worst-case length of a frame.

References: CiA 301 7.5.2.33-38 (PDO parameters); the worst-case bit count is Tindell's bound as corrected by Davis et
al., Real-Time Systems 35 (2007), doi:10.1007/s11241-007-9012-7.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import accumulate, combinations
from typing import Annotated

from annotated_types import Ge, Le, Len

from haptic_fieldbus.drive.fields import Table, UInt32
from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.errors import ImageTooLargeError
from haptic_fieldbus.protocols.protocol import Signals
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
OCTETS = {8: DataType.UINT8, 16: DataType.UINT16, 32: DataType.UINT32}
"""Bits of an object in a fixed mapping → type of the same size; objects of other lengths cannot be passed over."""


class Direction(Enum):
    """Direction of a PDO as the drive sees it, which transmits TPDOs and receives RPDOs."""

    TPDO = "TPDO"
    RPDO = "RPDO"


@dataclass(frozen=True)
class FixedPdo(Table):
    """A PDO with a mapping that cannot be written, which the drive only lets one switch on."""

    number: Annotated[int, Ge(1), Le(512)]
    maps: Annotated[tuple[UInt32, ...], Len(1, 64)]
    """Values of its mapping entries (1600h:01, 1A00h:01 and on): index, sub-index and bits of each object."""

    @property
    def size(self) -> int:
        """Size of the payload [octets]."""
        return sum(value & 0xFF for value in self.maps) // 8


@dataclass(frozen=True)
class Pdo:
    """One PDO of one node with the objects mapped into it.

    An object of a fixed mapping that the loop does not need has None in the place of its signal.
    """

    direction: Direction
    number: int
    node: int
    transmission_type: int
    signals: tuple[Signal | None, ...]
    entries: tuple[ObjectEntry, ...]
    fixed: bool = False
    """True: the drive has this mapping, and does not let it be written."""
    cob_id_of: int | None = None
    """Number of the PDO that has this COB-ID in the predefined connection set; None: its own number."""

    @property
    def name(self) -> str:
        """Name in messages, such as `TPDO1`."""
        return f"{self.direction.value}{self.number}"

    @property
    def cob_id(self) -> int:
        """COB-ID of the predefined connection set (CiA 301, 7.3.5), which has PDO 1 to 4."""
        base = 0x180 if self.direction is Direction.TPDO else 0x200
        return base + 0x100 * ((self.cob_id_of or self.number) - 1) + self.node

    @property
    def mapping_index(self) -> int:
        """Index of the mapping parameter record."""
        return (0x1A00 if self.direction is Direction.TPDO else 0x1600) + self.number - 1

    @property
    def size(self) -> int:
        """Size of the payload [octets]."""
        return sum(entry.type.size for entry in self.entries)

    @property
    def needed(self) -> tuple[tuple[Signal, ObjectEntry, slice], ...]:
        """Signals that the loop needs, each with its object and its octets in the payload."""
        return tuple((signal, entry, octets) for signal, entry, octets in self._placed if signal)

    @property
    def unneeded(self) -> tuple[tuple[ObjectEntry, slice], ...]:
        """The other objects, each with its octets in the payload."""
        return tuple((entry, octets) for signal, entry, octets in self._placed if signal is None)

    @property
    def _placed(self) -> Iterator[tuple[Signal | None, ObjectEntry, slice]]:
        """All objects, each with its signal and its octets in the payload."""
        ends = accumulate(entry.type.size for entry in self.entries)
        for signal, entry, end in zip(self.signals, self.entries, ends, strict=True):
            yield signal, entry, slice(end - entry.type.size, end)

    @property
    def image_size(self) -> int:
        """Size of the needed signals, which alone are in the process image [octets]."""
        return sum(entry.type.size for _, entry, _ in self.needed)

    @property
    def synchronous(self) -> bool:
        """True when the PDO refers to SYNC, false when it is event-driven."""
        return self.transmission_type in SYNCHRONOUS_TYPES


Offered = Mapping[Signal, ObjectEntry]
"""The object of each signal."""


def lay_out(
    direction: Direction,
    offered: Offered,
    signals: Signals,
    *,
    node: int,
    transmission_type: int,
    room: Mapping[int, int],
    fixed: Sequence[FixedPdo] = (),
) -> tuple[Pdo, ...]:
    """Return the PDOs with the signals that take the fewest bits; raises ImageTooLargeError when none have them all.

    `room` has the number of mapping entries of each PDO of the direction that
    can be mapped anew, by the number of the PDO. They are filled with the signals in their order. The other PDOs have
    `fixed` mappings, of which those are used that leave the fewest bits.
    """
    free = [number for number in PREDEFINED if room.get(number)]
    rooms = [room[number] for number in free]
    wanted = {offered[signal].mapping: signal for signal in signals}
    best: tuple[tuple[FixedPdo, ...], list[list[Signal]]] | None = None
    for chosen in _choices(fixed, wanted):
        carried = {wanted[value] for each in chosen for value in each.maps if value in wanted}
        rest = [signal for signal in signals if signal not in carried]
        frames = _frames(offered, rest, rooms) if rest or not chosen else []
        fits = len(frames) <= len(free) and len(frames) + len(chosen) <= len(PREDEFINED)
        if fits and (best is None or _bits(offered, chosen, frames) < _bits(offered, *best)):
            best = chosen, frames
    if best is None:
        raise ImageTooLargeError(_too_few(direction, offered, signals, node, rooms, fixed))
    made = [
        Pdo(direction, number, node, transmission_type, tuple(frame), tuple(offered[signal] for signal in frame))
        for number, frame in zip(free, best[1], strict=False)
    ]
    made += _with_fixed(Pdo(direction, 1, node, transmission_type, (), (), fixed=True), best[0], offered, wanted)
    made.sort(key=lambda pdo: pdo.number)
    # Those beyond PDO 4 take the COB-IDs of PDOs that are not used.
    left = [number for number in PREDEFINED if number not in {pdo.number for pdo in made}]
    return tuple(pdo if pdo.number in PREDEFINED else replace(pdo, cob_id_of=left.pop(0)) for pdo in made)


def _choices(fixed: Sequence[FixedPdo], wanted: Mapping[int, Signal]) -> Iterator[tuple[FixedPdo, ...]]:
    """Yield each set of PDOs with fixed mappings that may be used, the smallest first; of those alike the shortest."""
    shortest: dict[frozenset[int], FixedPdo] = {}
    for each in sorted(fixed, key=lambda each: (each.size, each.number)):
        shortest.setdefault(frozenset(value for value in each.maps if value in wanted), each)
    useful = sorted((each for values, each in shortest.items() if values), key=lambda each: each.number)
    for number in range(len(PREDEFINED) + 1):
        yield from combinations(useful, number)


def _bits(offered: Offered, chosen: Sequence[FixedPdo], frames: Sequence[Signals]) -> int:
    own = (sum(offered[signal].type.size for signal in frame) for frame in frames)
    return sum(worst_case_bits(octets) for octets in (*own, *(each.size for each in chosen)))


def _with_fixed(like: Pdo, chosen: Sequence[FixedPdo], offered: Offered, wanted: Mapping[int, Signal]) -> Iterator[Pdo]:
    """Yield the PDOs with fixed mappings; a signal that several of them carry is taken from the first."""
    left = dict(wanted)
    for each in chosen:
        signals = tuple(left.pop(value, None) for value in each.maps)
        entries = [
            # Of the type only the size is known.
            ObjectEntry(value >> 16, OCTETS[value & 0xFF], value >> 8 & 0xFF) if signal is None else offered[signal]
            for signal, value in zip(signals, each.maps, strict=True)
        ]
        yield replace(like, number=each.number, signals=signals, entries=tuple(entries))


def _too_few(
    direction: Direction, offered: Offered, signals: Signals, node: int, rooms: Sequence[int], fixed: Sequence[FixedPdo]
) -> str:
    """Return why the signals fit into no PDOs of a node."""
    carried = {value for each in fixed for value in each.maps}
    missing = [offered[signal] for signal in signals if offered[signal].mapping not in carried]
    if fixed and missing and not rooms:
        maps = ([f"{value >> 16:04X}h:{value >> 8 & 0xFF:02X}" for value in each.maps] for each in fixed)
        named = zip(fixed, maps, strict=True)
        held = "; ".join(f"{direction.value}{each.number} {' + '.join(places)}" for each, places in named)
        lacks = f"no {direction.value} of node {node} carries {', '.join(map(str, missing))}"
        return f"{lacks}, and the mapping is fixed: {held}"
    names, needed = ", ".join(signal.value for signal in signals), len(_frames(offered, signals, rooms))
    return f"{len(signals)} signals need {needed} {direction.value}s of node {node}, which has {len(rooms)}: {names}"


def _frames(offered: Offered, signals: Signals, rooms: Sequence[int]) -> list[list[Signal]]:
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


def bits_beyond(pdos: Sequence[Pdo]) -> int:
    """Return the bits that PDOs of one direction take more than with a mapping of our own, worst case."""
    needed = {signal: entry for pdo in pdos for signal, entry, _ in pdo.needed}
    own = _frames(needed, list(needed), ())
    return sum(worst_case_bits(pdo.size) for pdo in pdos) - _bits(needed, (), own)


def placed(pdos: Sequence[Pdo], offset: int) -> tuple[tuple[Pdo, int], ...]:
    """Return each PDO with the offset of its signals in the image; the PDOs follow one another from `offset` on."""
    # `accumulate` also yields the end of the last PDO, which `zip` drops.
    sizes = accumulate((pdo.image_size for pdo in pdos), initial=offset)
    return tuple(zip(pdos, sizes, strict=False))


def worst_case_bits(octets: int, *, extended: bool = False) -> int:
    """Return the bits of a frame with worst-case stuffing, interframe space included.

    The identifier has 11 bits, `extended` 29.
    """
    if extended:  # 20 bits more, all of them stuffed
        return 8 * octets + 64 + INTERFRAME_SPACE_BITS + (53 + 8 * octets) // 4
    # A frame has 44 bits beside its data. Stuffing covers 34 of them and the data, and adds at worst one bit for every
    # four bits after the first.
    return 8 * octets + 44 + INTERFRAME_SPACE_BITS + (33 + 8 * octets) // 4
