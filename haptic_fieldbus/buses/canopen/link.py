"""The link to one axis: its process data in the input image, the age of the data, and the flags of the link."""

from collections.abc import Sequence

from haptic_fieldbus.buses.canopen.answers import Answers, Exchange
from haptic_fieldbus.buses.canopen.node import NmtState, Node
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.planning.image import AXIS_HEADER, LARGEST_AGE_NS
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.pdo import Pdo
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.signals import LinkFlag, Signal

# Plain integers: combining members of an IntFlag would make a new member in every period of the loop.
STALE, EMERGENCY, BOOT_UP, NO_SIGN_OF_LIFE, NOT_OPERATIONAL, BUS_OFF, EXCEPTION, FOREIGN, DUPLICATE = (
    int(flag) for flag in LinkFlag
)
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
        self._node = node
        self._image = image
        self._header = header
        self._slots = tuple(Answers(pdo.cob_id, image, offset, pdo.size, _wanted(pdo)) for pdo, offset in tpdos)
        self._latched_ns: int | None = None
        self._silence_ns = round(silence * 1e9)

    def listen(self, wire: Wire, exchange: Exchange) -> None:
        exchange.arrived_ns = lambda: wire.taken_ns
        for slot in self._slots:
            slot.exchange = exchange
            wire.listen(slot.cob_id, slot.take)

    def forget(self) -> None:
        """Forget what was received: the node is configured anew, and what it said before is true no more."""
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
        if node.state != NmtState.OPERATIONAL:
            flags |= NOT_OPERATIONAL
        if now_ns - node.heartbeat_ns > self._silence_ns:
            flags |= NO_SIGN_OF_LIFE
        age_ns = LARGEST_AGE_NS if self._latched_ns is None else min(now_ns - self._latched_ns, LARGEST_AGE_NS)
        # A latch is the nominal end of SYNC, which may lie a little ahead of the clock: the age is never negative.
        AXIS_HEADER.pack_into(self._image, self._header, max(0, age_ns), flags, emergency)

    def accuse(self, foreign: int | None, doubled: int | None) -> None:
        """Add the COB-ID of somebody else's command, else of feedback that came twice, to the header of the axis."""
        age_ns, flags, code = AXIS_HEADER.unpack_from(self._image, self._header)
        if doubled in [slot.cob_id for slot in self._slots]:
            flags, code = flags | DUPLICATE, doubled
        if foreign is not None:
            flags, code = flags | FOREIGN, foreign
        AXIS_HEADER.pack_into(self._image, self._header, age_ns, flags, code)


class OutgoingPdo:
    """One RPDO: where its octets are in the output image, and what a fixed mapping sends beside them.

    Objects that nobody asked for keep what they hold: it is read before the first set-point, and sent in each.
    """

    def __init__(self, node: Node, pdo: Pdo, offset: int) -> None:
        self.cob_id = pdo.cob_id
        self._node = node
        self.torque_free = bytearray(pdo.size)
        """Payload with target torque 0 and controlword *disable voltage*, which both consist of zero octets."""
        self._start, self._end = offset, offset + pdo.image_size
        self._wanted, self._unneeded = _wanted(pdo), pdo.unneeded

    def hold(self) -> None:
        """Read what the objects hold that nobody asked for; raises BusError."""
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


def traffic_of(plan: Plan) -> CanTraffic:
    """Return the traffic of the only bus in this part of a plan; raises TypeError for a bus of another protocol."""
    (bus,) = plan.buses
    if not isinstance(bus.traffic, CanTraffic):
        raise TypeError(f"bus {bus.name} is one of {bus.protocol}")
    return bus.traffic


def statusword_places(plan: Plan) -> tuple[int, ...]:
    """Return the offset of each axis' statusword in the input image, in the order of the axes."""
    places = []
    for axis, image in zip(plan.axes, plan.image.axes, strict=True):
        offset = image.inputs[0]
        for mapped in axis.traffic.incoming:
            if mapped.signal is Signal.STATUSWORD:
                places.append(offset)
            offset += mapped.type.size
    return tuple(places)
