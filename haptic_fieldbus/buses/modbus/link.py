"""The link to one axis: what its unit answers goes into the input image, with its age and the flags of the link."""

from dataclasses import dataclass
from struct import Struct

from haptic_fieldbus.buses.bus import Offsets
from haptic_fieldbus.buses.modbus.framing import FrameForm, Question
from haptic_fieldbus.drive.profile import Order
from haptic_fieldbus.planning.image import AXIS_HEADER, LARGEST_AGE_NS
from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, LineSection, ModbusProfile
from haptic_fieldbus.protocols.modbus.register_traffic import Block, RegisterRequest, RegisterTraffic
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic
from haptic_fieldbus.signals import LinkFlag, Signal

# The set-point of one drive on its way out, and the command that takes its place when it changes.
#
# Where command and target torque are not neighbours, each needs a request of its own. The target torque is zero until
# the drive is in *operation enabled*, so the command may take its place in the period in which it changes. It is
# repeated until the drive has answered it.


class StoredSetPoint:
    """The blocks that are written to one unit; `start` is their offset in the output image."""

    def __init__(self, traffic: RegisterTraffic, section: LineSection, start: int) -> None:
        self.waiting = False
        """Whether a set-point was stored and has not been sent yet."""
        self.blocks = (traffic.set_point,) if traffic.command is None else (traffic.set_point, traffic.command)
        """The set-point, and the command where it has a block of its own."""
        self.function = section.writing(traffic.set_point.count)
        """Function that writes a set-point and reads nothing; None when the drive has none."""
        self._section = section
        self._unit = traffic.unit
        self._start, self._middle = start, start + 2 * traffic.set_point.count
        self._end = start + 2 * sum(block.count for block in self.blocks)
        self._octets: bytes | bytearray = b""
        self._command: bytes | bytearray = b""
        self._commanded: bytes | bytearray = b""
        """Octets of the command that the drive has answered last."""
        self._sent: bytes | bytearray = b""
        """Octets of the command that is under way; none while it is not."""

    def forget(self) -> None:
        """Forget what was sent and answered: the drive is configured anew."""
        self.waiting, self._commanded, self._sent = False, b"", b""

    def store(self, image: bytes | bytearray) -> None:
        """Take over the part of this axis; an earlier one that was not sent is dropped."""
        self._octets = image[self._start : self._middle]
        if self._end > self._middle:
            self._command = image[self._middle : self._end]
        self.waiting = True

    def writing(self, block: Block) -> Question:
        """Return the request that writes a block, all zeros, and reads nothing."""
        # A drive that writes by function 23 alone is never asked for it.
        function = self._section.writing(block.count) or READ_WRITE
        return Question(self._unit, function, block.address, 0, (0,) * block.count)

    def writing_before(self, block: Block, read: Block) -> Question:
        """Return the request that writes a block, all zeros, and then reads one."""
        return Question(self._unit, READ_WRITE, read.address, read.count, (0,) * block.count, block.address)

    def take(self) -> tuple[int, bytes | bytearray]:
        """Return the block to write now, and its octets."""
        self.waiting = False
        if self._command and self._command != self._commanded:
            self._sent = self._command
            return 1, self._command
        self._sent = b""
        return 0, self._octets

    def answered(self) -> None:
        """Note that the drive has confirmed the last set-point."""
        if self._sent:
            self._commanded, self._sent = self._sent, b""


# Plain integers: combining members of an IntFlag would make a new member in every period of the loop.
STALE, EXCEPTION, FOREIGN = int(LinkFlag.STALE), int(LinkFlag.EXCEPTION), int(LinkFlag.FOREIGN)
LEAST_TORN, MOST_TORN = 65536 - 16384, 65536 + 16384
"""Counts by which a value is off when its two registers are of different instants: 65536, or a quarter less or more."""
PREDICTED = 10
"""Gap over which a speed predicts the next position [intervals over which it was measured]."""


class UnitLink:
    """The link to one unit; `header` is the offset of its axis' header in the image."""

    def __init__(self, unit: int, set_point: StoredSetPoint, header: int, image: bytearray, latch_ns: int) -> None:
        """`latch_ns` is the time from the beginning of the exchange until the drive should latch."""
        self.unit = unit
        self.set_point = set_point
        self.writing: tuple[FrameForm, ...] = ()
        """Forms that write each block of the set-point, and read nothing."""
        self.torn = 0
        """Samples that were dropped, since their two registers did not belong together."""
        self.latch_ns = 0
        """Instant at which the drive latched the motion of this exchange, or should have [ns]."""
        self.missing = 0
        """Number of requests of this exchange without an answer."""
        self.late: set[int] = set()
        """Functions whose answers have stayed away, and may still come."""
        self._header, self._image, self._should_ns = header, image, latch_ns
        self._latched_ns: int | None = None
        self._code: int | None = None

    def forget(self) -> None:
        """Forget what was received: the drive is configured anew."""
        self._latched_ns = self._code = None
        self.late.clear()
        self.set_point.forget()

    def refused(self, code: int) -> None:
        """Note an exception, for the header of the next exchange that ends."""
        self._code = code

    def finish(self, now_ns: int, begun_ns: int, foreign: int | None) -> None:
        """Write the header: age of the data [ns], flags, code of an exception or of another master's command."""
        flags = code = 0
        if self.missing:
            flags, self.latch_ns = STALE, min(now_ns, begun_ns + self._should_ns)
        else:
            self._latched_ns = self.latch_ns
        if self._code is not None:
            flags, code, self._code = flags | EXCEPTION, self._code, None
        if foreign is not None:
            flags, code = flags | FOREIGN, foreign
        age_ns = LARGEST_AGE_NS if self._latched_ns is None else now_ns - self._latched_ns
        if not 0 <= age_ns <= LARGEST_AGE_NS:
            age_ns = 0 if age_ns < 0 else LARGEST_AGE_NS
        AXIS_HEADER.pack_into(self._image, self._header, age_ns, flags, code)


class Reading:
    """One request of the reading part: its forms, where its registers go, and its times."""

    def __init__(
        self, link: UnitLink, block: Block, times: "Times", image: bytearray, offsets: Offsets, *, latches: bool
    ) -> None:
        """Take the offsets of the unit's signals in the image; `latches` tells that the motion is in this block."""
        self.link, self.block, self.times, self.latches = link, block, times, latches
        self.alone: FrameForm | None = None
        """Form that reads and writes nothing; None when the drive has no function for it."""
        self.writing: tuple[FrameForm, ...] = ()
        """Forms that write each block of the set-point first; none where they have requests of their own."""
        self._image = image
        self._executed_ns, self._answer_ns = times.executed_ns, times.answer_ns
        self._copies = _joined(block, offsets)
        self._wide = tuple(
            WideValue(mapped.order is Order.BIG_LOW_WORD_FIRST, start)
            for mapped, (start, end) in zip(block.signals, block.places, strict=True)
            if end - start == 4 and mapped.signal is Signal.POSITION
        )

    def asks(self, form: FrameForm) -> bool:
        """Return True for a form of this request."""
        return form is self.alone or form in self.writing

    def take(self, data: bytes, sent_ns: int, arrived_ns: int) -> bool:
        """Copy the registers into the image, and note when the drive latched; False when they are torn, and dropped.

        `sent_ns` and `arrived_ns` are of question and answer. The drive latched at the nominal instant, unless the
        answer came before its time: then the way back is counted from its arrival.
        """
        for wide in self._wide:
            if wide.torn(data, sent_ns):
                self.link.torn += 1
                return False
        for place, start, end in self._copies:
            self._image[place : place + end - start] = data[start:end]
        if self.latches:
            latched_ns, latest_ns = sent_ns + self._executed_ns, arrived_ns - self._answer_ns
            self.link.latch_ns = latched_ns if latched_ns <= latest_ns else max(sent_ns, latest_ns)
        return True

    def forget(self) -> None:
        """Forget what was read: until the first answer, an old statusword would count as the present one."""
        for place, start, end in self._copies:
            self._image[place : place + end - start] = bytes(end - start)


class TargetReading(Reading):
    """The request that reads back the target torque of a unit, so that one of another master is seen."""

    def __init__(self, link: UnitLink, block: Block, times: "Times", image: bytearray, offsets: Offsets) -> None:
        super().__init__(link, block, times, image, offsets, latches=False)
        self._came = slice(offsets[Signal.ASKED_PERIODS], offsets[Signal.ASKED_PERIODS] + 2)

    def begin(self) -> None:
        """Begin a period, in which no value has come yet."""
        self._image[self._came] = b"\0\0"

    def take(self, data: bytes, sent_ns: int, arrived_ns: int) -> bool:
        """Copy the target torque into the image, and note that it came in this period."""
        self._image[self._came] = b"\0\1"
        return super().take(data, sent_ns, arrived_ns)


@dataclass(frozen=True)
class Times:
    """Times of one request [ns]."""

    executed_ns: int
    """From its first octet until the drive reads its registers."""
    answer_ns: int
    """Of its answer on the line."""
    whole_ns: int
    """With the silence that follows."""


class WideValue:
    """A value of two registers. A drive that tears it shows about 65536 counts more or less than its motion does.

    The two samples before predict the position; one that is this far from the prediction is doubted.
    """

    def __init__(self, low_first: bool, start: int) -> None:
        self._value = Struct(">I")
        self._low_first, self._start = low_first, start
        self._before: int | None = None
        self._at_ns = 0
        """Value and instant [ns] of the last sample that was believed."""
        self._speed = 0.0
        """Between the last two of them [counts/ns]."""
        self._known_ns = 0
        """Time for which this speed predicts a position [ns]."""
        self._doubted = False

    def torn(self, octets: bytes, t_ns: int) -> bool:
        """Whether the value at an instant [ns] is a torn one; a second one in a row is the drive's own motion."""
        (value,) = self._value.unpack_from(octets, self._start)
        if self._low_first:
            value = (value & 0xFFFF) << 16 | value >> 16
        if self._before is None:
            self._before, self._at_ns = value, t_ns
            return False
        # The way from one position to the other [counts]; 32 bits may have run over.
        way = (value - self._before + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        passed_ns = t_ns - self._at_ns
        expected = self._speed * passed_ns if passed_ns <= self._known_ns else 0.0
        if LEAST_TORN <= abs(way - expected) <= MOST_TORN and not self._doubted:
            self._doubted = True
            return True
        self._doubted, self._before, self._at_ns = False, value, t_ns
        self._speed = way / passed_ns if passed_ns > 0 else 0.0
        self._known_ns = PREDICTED * passed_ns
        return False


def _joined(block: Block, offsets: Offsets) -> list[tuple[int, int, int]]:
    """Return the place in the image, and the begin and end in the block, of signals that are neighbours in both."""
    copies: list[tuple[int, int, int]] = []
    for mapped, (start, end) in zip(block.signals, block.places, strict=True):
        place, (first, begin, middle) = offsets[mapped.signal], copies[-1] if copies else (-1, 0, 0)
        if copies and (place - first, start) == (middle - begin, middle):
            copies[-1] = (first, begin, end)
        else:
            copies.append((place, start, end))
    return copies


def times_of(traffic: ModbusTraffic, profile: ModbusProfile, request: RegisterRequest) -> Times:
    """Return the times of one request on the line of this traffic."""
    line, answer_time = traffic.wire, profile.line.answer_time
    executed, answered = line.executed(request, answer_time), line.answer_duration(request)
    whole = executed + answered + line.silence
    return Times(round(1e9 * executed), round(1e9 * answered), round(1e9 * whole))
