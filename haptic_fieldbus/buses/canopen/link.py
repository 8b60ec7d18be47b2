"""The link to one axis: its process data in the input image, the age of the data, and the flags of the link.

TPDOs are taken only between SYNC and the end of the exchange. A TPDO that arrives before SYNC belongs to the period
before and is dropped.
"""

from collections.abc import Sequence

from haptic_fieldbus.buses.canopen.node import NmtState, Node
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.planning.image import AXIS_HEADER, LARGEST_AGE_NS
from haptic_fieldbus.protocols.canopen.pdo import Pdo
from haptic_fieldbus.signals import LinkFlag

# Plain integers: combining members of an IntFlag would make a new member in every period of the loop.
STALE, EMERGENCY, BOOT_UP, NO_SIGN_OF_LIFE, NOT_OPERATIONAL, BUS_OFF, EXCEPTION = (int(flag) for flag in LinkFlag)


class Exchange:
    """State of one exchange: the number of TPDOs still missing, and whether TPDOs are taken (from SYNC on)."""

    def __init__(self) -> None:
        self.taking = False
        self.missing = 0


class Link:
    """Link to one axis: it copies TPDOs into the image and writes the header of the axis there."""

    def __init__(self, node: Node, tpdos: Sequence[tuple[Pdo, int]], header: int, image: bytearray) -> None:
        """Take the TPDOs with their offsets in the image, and the offset of the header of the axis."""
        self._node = node
        self._image = image
        self._header = header
        self._slots = tuple(_Slot(pdo.cob_id, image, offset, pdo.size) for pdo, offset in tpdos)
        self._latched_ns: int | None = None

    def listen(self, wire: Wire, exchange: Exchange) -> None:
        for slot in self._slots:
            slot.exchange = exchange
            wire.listen(slot.cob_id, slot.take)

    def begin(self) -> int:
        """Begin a period and return the number of TPDOs that must arrive."""
        for slot in self._slots:
            slot.fresh = False
        return len(self._slots)

    @property
    def fresh(self) -> bool:
        """True when all TPDOs of this period arrived."""
        return all(slot.fresh for slot in self._slots)

    def finish(self, latch_ns: int, now_ns: int, heartbeat_limit_ns: int, common_flags: int) -> None:
        """Write the header of the axis: age of the data [ns], flags of the link, emergency code."""
        flags = common_flags
        for slot in self._slots:
            if not slot.fresh:
                flags |= STALE
            if slot.malformed:
                flags |= EXCEPTION
                slot.malformed = False
        if not flags & STALE:  # data of several TPDOs is as old as its oldest part, so all must be fresh
            self._latched_ns = latch_ns
        node = self._node
        if node.emergency:
            flags |= EMERGENCY
        if node.booted:
            flags |= BOOT_UP
        if node.state != NmtState.OPERATIONAL:
            flags |= NOT_OPERATIONAL
        if now_ns - node.heartbeat_ns > heartbeat_limit_ns:
            flags |= NO_SIGN_OF_LIFE
        age_ns = LARGEST_AGE_NS if self._latched_ns is None else min(now_ns - self._latched_ns, LARGEST_AGE_NS)
        # A latch is the nominal end of SYNC, which may lie a little ahead of the clock: the age is never negative.
        AXIS_HEADER.pack_into(self._image, self._header, max(0, age_ns), flags, node.emergency)


class _Slot:
    """Place of one TPDO in the image."""

    __slots__ = ("_end", "_image", "_offset", "_size", "cob_id", "exchange", "fresh", "malformed")

    def __init__(self, cob_id: int, image: bytearray, offset: int, size: int) -> None:
        self.cob_id = cob_id
        self.exchange = Exchange()
        self.fresh = False
        self.malformed = False
        self._image = image
        self._offset, self._end, self._size = offset, offset + size, size

    def take(self, data: bytearray) -> None:
        if not self.exchange.taking:
            return
        if len(data) != self._size:
            self.malformed = True
            return
        self._image[self._offset : self._end] = data
        if not self.fresh:  # a TPDO that comes twice in a period must count once
            self.fresh = True
            self.exchange.missing -= 1
