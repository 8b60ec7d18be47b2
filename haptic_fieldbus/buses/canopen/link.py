"""The link to one axis: its process data in the input image, the age of the data, and the flags of the link."""

from collections.abc import Callable, Sequence

from haptic_fieldbus.buses.canopen.node import NmtState, Node
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.planning.image import AXIS_HEADER, LARGEST_AGE_NS
from haptic_fieldbus.protocols.canopen.pdo import Pdo
from haptic_fieldbus.signals import LinkFlag

# TPDOs as answers to SYNC: which of them is the sample of this period.
#
# TPDOs are taken only between SYNC and the end of the exchange. One that arrives before SYNC belongs to the period
# before and is dropped. Answers come in the order of the SYNCs, and nothing in them tells to which one they belong. As
# long as each SYNC is answered, it is plain. After an answer that stayed away it was either lost, and the next TPDO is
# that of the last SYNC, or the drive was late, and it is an old one. An old sample with a new date would show a speed
# that was not there, and the next one a multiple of the speed. So, while answers are pending:
#
# - one that comes when answers usually come is taken if no further one follows until the end of the exchange, since a
#   drive that was late sends them all; those that are pending are given up;
# - one at another time is not taken; but the fourth in a row is, for then it is what is usual that has changed.
#
# So an answer that was lost costs one sample, and the set-point of the period after comes later. Apart from that all
# answers are counted: one more than was ever asked for is that of a second node. What was owed at the end of each of
# many periods is lost, and excuses none any more. As it becomes operational, a node may send one that nobody asked for;
# that comes before its answers, so after the first of these it is not waited for.

WARY = 32
"""Periods for which answers at unusual times are doubted, after some were taken for lost."""
MOST_DOUBTED = 4
"""Periods after which answers at unusual times are taken as they come."""
PROMPT = 2
"""Factor by which an answer may be slower or faster than usual, and is still taken for that of the last SYNC."""

UNASKED_WITHIN = 3
"""Periods with answers before which one that nobody asked for has come; a drive needs more until it is enabled."""


class Exchange:
    """State of one exchange: the number of TPDOs still missing, and whether TPDOs are taken (from SYNC on)."""

    def __init__(self) -> None:
        self.begun = False
        """True from the first exchange on; before it, a drive may send TPDOs as it becomes operational."""
        self.doubled: int | None = None
        """COB-ID of a TPDO that came more often than it was asked for; None while there was none."""
        self.taking = False
        self.missing = 0
        self.latch_ns = 0
        """Instant of the last SYNC [ns]."""
        self.arrived_ns: Callable[[], int] = int
        """Instant at which the frame arrived that is handled at present [ns]."""


class Answers:
    """One TPDO: its place in the image, and which of its frames are answers to which SYNC."""

    __slots__ = (
        "_end", "_image", "_offset", "_size", "_wanted", "alone", "answered", "cob_id", "doubted", "exchange", "fresh",
        "least", "malformed", "owed", "pending", "periods", "unasked", "usual_ns", "wary",
    )  # fmt: skip

    def __init__(
        self, cob_id: int, image: bytearray, offset: int, size: int, wanted: Sequence[slice] | None = None
    ) -> None:
        """Take the octets of the payload that the image has at `offset`; None: all of them."""
        self.cob_id = cob_id
        self.exchange = Exchange()
        self.fresh = self.malformed = False
        self.owed = 0
        """Number of SYNCs that this TPDO has not answered; negative when it came more often than it was asked for."""
        self.least = 0
        """Smallest `owed` in the window, which consists of `periods` with answers."""
        self.periods = 0
        self.answered = False
        self.unasked = False
        """Whether one that nobody asked for may still come."""
        self.pending = 0
        """Number of SYNCs whose answers are still waited for."""
        self.alone: bool | None = None
        """True when one prompt answer came while others are pending, and no more: so those are lost."""
        self.doubted = 0
        """Number of periods since the last sure answer in which others came."""
        self.wary = 0
        """Number of periods in which answers that were taken for lost may still come."""
        self.usual_ns = 0
        """Time from SYNC to the end of an exchange with this TPDO, on average; 0 before the first."""
        self._image = image
        self._wanted = wanted
        octets = size if wanted is None else sum(each.stop - each.start for each in wanted)
        self._offset, self._end, self._size = offset, offset + octets, size

    def forget(self) -> None:
        """Forget what was received; as a node becomes operational it may send a TPDO that nobody asked for."""
        self._image[self._offset : self._end] = bytes(self._end - self._offset)
        self.owed, self.least, self.periods, self.answered, self.unasked = 1, 1, 0, False, True
        self.pending = self.doubted = self.wary = self.usual_ns = 0

    def ask(self, window: int) -> None:
        """Expect an answer to the next SYNC; answers that are more than `window` periods late count as lost."""
        self.fresh, self.alone = False, None
        if self.owed < self.least:
            self.least = self.owed
        if self.answered:
            self.answered = False
            self.periods += 1
            if self.unasked and self.periods >= UNASKED_WITHIN:
                # Take back what excuses one that nobody asked for, unless it has come.
                excused = min(1, max(0, self.least))
                self.owed, self.least, self.unasked = self.owed - excused, self.least - excused, False
            if self.periods >= window:
                self.owed -= max(0, self.least)
                self.periods, self.least = 0, self.owed
        self.owed += 1
        self.pending += 1
        if self.wary:
            self.wary -= 1

    def accept(self) -> bool:
        """At the end of an exchange without a sure answer: return whether one that came is taken after all."""
        if self.alone is False:
            self.doubted += 1
            if self.doubted == MOST_DOUBTED:  # then it is what is usual that has changed
                self.usual_ns = 0
                return True
        return self.alone is True

    def settle(self, took_ns: int) -> None:
        """End an exchange that took this long for its sample; answers that have not come count as lost."""
        self.doubted = 0
        if self.pending:
            self.pending, self.wary = 0, WARY
        elif usual_ns := self.usual_ns:
            most_ns = PROMPT * usual_ns
            self.usual_ns = usual_ns + ((took_ns if took_ns < most_ns else most_ns) - usual_ns >> 4)
        else:
            self.usual_ns = max(1, took_ns)

    def take(self, data: bytes | bytearray) -> None:
        """Copy a TPDO into the image, and tell whether it is the sample of this period."""
        exchange = self.exchange
        if exchange.begun:
            self.owed -= 1
            self.answered = True
            if self.owed < 0:
                exchange.doubled = self.cob_id
            if self.pending:
                self.pending -= 1
        if not exchange.taking:
            return
        if len(data) != self._size:
            self.malformed = True
            return
        if self._wanted is not None:
            data = b"".join([data[each] for each in self._wanted])
        self._image[self._offset : self._end] = data
        if self.fresh:
            return  # one that comes twice must count once
        if (self.pending or self.wary) and self._may_be_old():
            self.alone = False
        elif not self.pending:
            self.fresh = True
            exchange.missing -= 1
        else:
            self.alone = self.alone is None

    def _may_be_old(self) -> bool:
        """Return whether this is rather the answer to an earlier SYNC, by the time it took."""
        took_ns = self.exchange.arrived_ns() - self.exchange.latch_ns
        return self.usual_ns > 0 and not self.usual_ns < PROMPT * took_ns < PROMPT * PROMPT * self.usual_ns


# Plain integers: combining members of an IntFlag would make a new member in every period of the loop.
STALE, EMERGENCY, BOOT_UP, NO_SIGN_OF_LIFE, NOT_OPERATIONAL, BUS_OFF, EXCEPTION, FOREIGN, DUPLICATE = map(int, LinkFlag)
_OPERATIONAL = int(NmtState.OPERATIONAL)
LOST_AFTER = 1.0
"""Time with answers after which one that is still missing counts as lost [s].

Until then a node or an adapter that was busy may send it, in a burst. After it, a lost one must not excuse that of a
second node.
"""


class Link:
    """Link to one axis: it copies TPDOs into the image and writes the header of the axis there."""

    def __init__(
        self, node: Node, tpdos: Sequence[tuple[Pdo, int]], header: int, image: bytearray, silence: float, period: float
    ) -> None:
        """Take the TPDOs with their offsets in the image, and the offset of the header of the axis.

        `silence` is the time without a sign of life after which the node counts as gone, `period` that of the loop [s].
        """
        self._window = round(LOST_AFTER / period)
        self._node, self._image, self._header = node, image, header
        self._slots = tuple(Answers(pdo.cob_id, image, offset, pdo.size, _wanted(pdo)) for pdo, offset in tpdos)
        self._latched_ns: int | None = None
        self._silence_ns = round(silence * 1e9)

    def listen(self, wire: Wire, exchange: Exchange) -> None:
        exchange.arrived_ns = lambda: wire.taken_ns
        for slot in self._slots:
            slot.exchange = exchange
            wire.listen(slot.cob_id, slot.take)

    def forget(self) -> None:
        """Forget all that was received: the node is configured anew, and earlier values no longer hold."""
        self._latched_ns = None
        for slot in self._slots:
            slot.forget()

    def begin(self) -> int:
        """Begin a period and return the number of TPDOs that must arrive."""
        for slot in self._slots:
            slot.ask(self._window)
        return len(self._slots)

    @property
    def fresh(self) -> bool:
        """True when all TPDOs came since the last SYNC, be they answers to it or to earlier ones."""
        return all(slot.fresh or slot.alone is not None for slot in self._slots)

    def forget_answers(self) -> None:
        """Count what came before as no answer: the next one is that to a SYNC which is still to be sent."""
        for slot in self._slots:
            slot.fresh, slot.alone = False, None

    def finish(self, latch_ns: int, now_ns: int, common_flags: int) -> None:
        """Write the header of the axis: age of the data [ns], flags of the link, emergency code."""
        flags = common_flags
        for slot in self._slots:
            if slot.fresh or slot.accept():
                slot.settle(now_ns - latch_ns)
            else:
                flags |= STALE
            if slot.malformed:
                flags |= EXCEPTION
                slot.malformed = False
        if not flags & STALE:  # data of several TPDOs is as old as its oldest part, so all must be fresh
            self._latched_ns = latch_ns
        node = self._node
        emergency = 0
        if node.emergency:
            emergency = node.look_at_emergency()
            flags |= EMERGENCY
        if node.booted:
            flags |= BOOT_UP
        if node.state != _OPERATIONAL:
            flags |= NOT_OPERATIONAL
        if now_ns - node.heartbeat_ns > self._silence_ns:
            flags |= NO_SIGN_OF_LIFE
        age_ns = LARGEST_AGE_NS if self._latched_ns is None else now_ns - self._latched_ns
        # A latch is the nominal end of SYNC, which may lie a little ahead of the clock: the age is never negative.
        if not 0 <= age_ns <= LARGEST_AGE_NS:
            age_ns = 0 if age_ns < 0 else LARGEST_AGE_NS
        AXIS_HEADER.pack_into(self._image, self._header, age_ns, flags, emergency)

    def accuse(self, foreign: int | None, doubled: int | None) -> None:
        """Write the COB-ID of another master's command, or else of duplicate feedback, into the header."""
        age_ns, flags, code = AXIS_HEADER.unpack_from(self._image, self._header)
        if doubled in [slot.cob_id for slot in self._slots]:
            flags, code = flags | DUPLICATE, doubled
        if foreign is not None:
            flags, code = flags | FOREIGN, foreign
        AXIS_HEADER.pack_into(self._image, self._header, age_ns, flags, code)


class OutgoingPdo:
    """One RPDO: where its octets are in the output image, and what a fixed mapping sends beside them.

    Objects that the plan does not use keep their values: these are read before the first set-point and sent in each.
    """

    def __init__(self, node: Node, pdo: Pdo, offset: int) -> None:
        self.cob_id = pdo.cob_id
        self._node = node
        self.torque_free = bytearray(pdo.size)
        """Payload with target torque 0 and controlword *disable voltage*, which both consist of zero octets."""
        self._start, self._end = offset, offset + pdo.image_size
        self._wanted, self._unneeded = _wanted(pdo), pdo.unneeded

    def hold(self) -> None:
        """Read the values of mapped objects that the plan does not use; raises BusError."""
        for entry, place in self._unneeded:
            self.torque_free[place] = entry.type.pack(self._node.read(entry))

    def payload(self, image: bytes | bytearray) -> bytes | bytearray:
        """Return the payload with the values of the output image."""
        if self._wanted is None:
            return image[self._start : self._end]
        octets, start = bytearray(self.torque_free), self._start
        for place in self._wanted:
            end = start + place.stop - place.start
            octets[place], start = image[start:end], end
        return octets


def _wanted(pdo: Pdo) -> tuple[slice, ...] | None:
    """Return the octets of the payload that the image has; None: all of them."""
    return tuple(place for *_, place in pdo.needed) if pdo.unneeded else None
