"""The exchange of one period on one line: all units are read in turn, and written in turn.

Where target torques are read back, that of one unit is read first, of another one in each period.
`master` tells what goes out when, and what becomes of answers that stay away.
"""

from collections.abc import Collection, Sequence

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import ReadWriteMultipleRegistersRequest, WriteMultipleRegistersRequest

from haptic_fieldbus.buses.modbus.framing import REFUSED, Answer, FrameForm, Question
from haptic_fieldbus.buses.modbus.link import Reading, TargetReading, UnitLink
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.drive.profile import ENERGISED, PowerTable
from haptic_fieldbus.errors import ForeignMasterError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.image import HEADER
from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, ModbusProfile
from haptic_fieldbus.protocols.traffic import answer_time

# Signs of somebody else who commands our drives.
#
# A Modbus drive cannot be listened to: on TCP nobody hears the connection of another master, and on RTU its frames are
# heard only between ours. So two things are looked at:
#
# - The registers. A drive that nobody commands has a target torque of 0, a command that does not enable, and a power
#   stage that is off. Anything else is somebody's, be it a master that runs or one that died.
# - Octets on a serial line that nobody was asked for. A request among them that writes to one of our units is a command
#   of somebody else.
#
# Reference: Modbus over serial line 1.02, 2.1: there is one master on a line.

LISTENING = 0.5
"""Time for which a serial line is listened to before anything is sent [s]."""
EVERYBODY = 0
"""Unit id of a request that all units obey and none answers."""
ONE_MASTER = "A line has one master: end the other one, and put axes that share a line into one rig"


def listen(requester: Requester, seconds: float = LISTENING) -> str:
    """Listen before anything is sent, and return a sentence about it; raises ForeignMasterError, BusError."""
    if not requester.transport.serial:
        return f"{requester.name}: another master cannot be received on TCP; only the registers of a drive show it"
    heard = requester.listen(requester.clock.now_ns() + round(seconds * 1e9))
    if heard:
        raise ForeignMasterError(
            f"another master on {requester.name}: received {len(heard)} octets within {exactly(seconds)} s without a "
            f"request. {ONE_MASTER}. If there is no other master, the line is noisy: check terminators and bias. "
            "Nothing was sent"
        )
    return f"{requester.name}: listened for {exactly(seconds)} s without sending; received nothing"


def refuse_unrest(unit: UnitClient, profile: ModbusProfile, power: PowerTable) -> None:
    """Raise ForeignMasterError when the registers of a drive say that another master commands it, or BusError."""
    target = unit.optional(profile.torque.target) or 0
    if target:
        raise _commanded(unit, f"{profile.torque.target} (target torque) is {target}")
    command = unit.optional(profile.power.command) or power.off
    if command in power.enabling:
        raise _commanded(unit, f"{profile.power.command} (command) is {command:04X}h, which enables it")
    state = power.state(unit.read(profile.power.status))
    if state in ENERGISED:
        raise _commanded(unit, f"{profile.power.status} (status) shows the state {state.value}")


def _commanded(unit: UnitClient, what: str) -> ForeignMasterError:
    return ForeignMasterError(
        f"{unit.label} is commanded by another master, or a master that died left it so: {what}. {ONE_MASTER}. If "
        f"there is no other master, switch the drive off and on. Nothing was written"
    )


def foreign_write(octets: bytes, units: Collection[int]) -> int | None:
    """Return the address to which a request among these octets writes in one of our units; None without one."""
    decoder = DecodePDU(True)
    framer = FramerRTU(decoder)
    # Noise before a request may look like the begin of another one, so each octet is tried as the first.
    for at in range(len(octets) - framer.MIN_SIZE + 1):
        try:
            _, unit, _, body = framer.decode(octets[at:])
            pdu = decoder.decode(body) if body else None
        except REFUSED:
            continue
        if unit == EVERYBODY or unit in units:
            if isinstance(pdu, ReadWriteMultipleRegistersRequest):
                return pdu.write_address
            # FC6 comes back as it was sent, so a late answer of a drive would look like a request.
            if isinstance(pdu, WriteMultipleRegistersRequest):
                return pdu.address
    return None


class Turns:
    """The requests of all units of a line, and their answers in the input `image`."""

    def __init__(
        self,
        requester: Requester,
        readings: Sequence[Reading],
        targets: Sequence[TargetReading],
        image: bytearray,
        *,
        period_ns: int,
        writes: bool,
    ) -> None:
        """`targets` are read back, one in each period.

        `writes` tells that the set-points are sent by requests of their own, after computing.
        """
        self.foreign: int | None = None
        """Address to which another master was heard to write; None without one."""
        self.late = self.slowest_ns = 0
        """Number of answers on TCP that came too late for their period, and the longest time that one took [ns]."""
        self._requester, self._readings, self._image = requester, readings, image
        self._now_ns = requester.clock.now_ns
        self._links = tuple(dict.fromkeys(reading.link for reading in readings))
        self._units = frozenset(link.unit for link in self._links)
        self._period_ns, self._writes = period_ns, writes
        self._targets = targets
        self._present = readings
        """Requests of the present period, in their order."""
        whole_ns = [max(each.times.whole_ns for each in targets)] if targets else []
        whole_ns += [each.times.whole_ns for each in readings]
        self._left_ns = tuple(sum(whole_ns[at:]) for at in range(len(whole_ns)))
        """Time that each request and those after it take."""
        self._nothing: bytes | bytearray = b""
        self._begun_ns = 0
        self._patience_ns = round(1e9 * answer_time(1e-9 * period_ns))
        self._asked: Question | None = None
        """Question of the present turn; None while that of an earlier one waits for its answer."""
        self._owner = readings[0].link
        """Link to which the last question was sent."""
        self._written: UnitLink | None = None
        """Link whose set-point is under way."""

    def forget(self) -> None:
        """Forget what was exchanged: the drives are configured anew."""
        self._requester.forget()
        self._written, self.foreign = None, None
        for link in self._links:
            link.forget()
        for reading in (*self._readings, *self._targets):
            reading.forget()

    def prepare(self, deadline_ns: int) -> None:
        """Take the answer to the last set-point, as long as the deadline [ns] leaves time for all that is read."""
        link, self._written = self._written, None
        if link is not None:
            self._confirm(link, self._requester.waiting() or self._requester.answer(deadline_ns - self._left_ns[0]))
        elif (form := self._requester.outstanding) is not None:
            self._take_late(form, 0)  # its sample is not needed: a younger one is asked for at once
            # An answer that is very late is waited for no more: the unit may have lost the question.
            if self._requester.clock.now_ns() - self._requester.sent_ns > self._patience_ns:
                self._requester.forget()

    def _take_late(self, form: FrameForm, until_ns: int) -> None:
        """Wait until then [ns] for the answer to a request of an earlier period; use all of it but its sample."""
        answer = self._requester.answer(until_ns)
        self._note_late(answer)
        self._accepted(self._owner, form.question, answer)

    def _note_late(self, answer: Answer | None) -> None:
        """Count an answer that came after its share of the period was over."""
        if answer is not None:
            self.late += 1
            self.slowest_ns = max(self.slowest_ns, self._requester.arrived_ns - self._requester.sent_ns)

    def begin(self) -> None:
        """Ask the first unit."""
        for link in self._links:
            link.missing = 0
        if self._targets:
            first, *others = self._targets
            self._targets, self._present = (*others, first), (first, *self._readings)
            for each in self._targets:
                each.begin()
        self._asked = self._ask(self._present[0])
        self._begun_ns = self._now_ns() if self._asked is None else self._requester.sent_ns

    def collect(self, deadline_ns: int) -> bytearray:
        """Receive, and ask the other units, until the deadline [ns] at the latest; return the image."""
        requester, present, last = self._requester, self._present, len(self._present) - 1
        for at, reading in enumerate(present):
            until_ns = deadline_ns
            if at < last:  # its share of the time that is left
                now_ns = requester.clock.now_ns()
                until_ns = now_ns + max(0, deadline_ns - now_ns) * reading.times.whole_ns // self._left_ns[at]
            if self._asked is None:
                self._clear(reading, until_ns)
            form, link = requester.outstanding, reading.link
            if form is None:
                # Ask nothing, and drop what comes; when nothing did, no answer is late any more.
                link.missing += 1
                if not requester.listen(until_ns):
                    link.late.clear()
            else:  # an answer to an earlier question counts with its age
                answer = requester.answer(until_ns)
                if self._asked is None:
                    self._note_late(answer)
                accepted = self._accepted(self._owner, form.question, answer) and reading.asks(form)
                if not (accepted and answer and reading.take(answer.data, requester.sent_ns, requester.arrived_ns)):
                    link.missing += 1
            if at < last:
                self._asked = self._ask(present[at + 1])
        # Octets that were no answers may be a command of another master.
        if requester.unasked or requester.garbled:
            for octets in (requester.unasked, requester.garbled):
                if octets and requester.transport.serial and self.foreign is None:
                    self.foreign = foreign_write(octets, self._units)
            requester.unasked = requester.garbled = b""
        # Write all headers.
        now_ns, latch_ns = self._now_ns(), 0
        for link in self._links:
            link.finish(now_ns, self._begun_ns, self.foreign)
            if link.latch_ns > latch_ns:
                latch_ns = link.latch_ns
        HEADER.pack_into(self._image, 0, latch_ns)
        return self._image

    def write(self, image: bytes | bytearray) -> None:
        """Store the set-points; send them where they have requests of their own.

        They are sent to one unit after another, and none while an answer is outstanding.
        """
        requester, last = self._requester, self._links[-1]
        for link in self._links:
            link.set_point.store(image)
        if not self._writes:
            return
        for left, link in zip(range(len(self._links), 0, -1), self._links, strict=True):
            if requester.outstanding is not None:
                return
            place, octets = link.set_point.take()
            form = link.writing[place]
            requester.send(form, octets)
            self._asked, self._owner = form.question, link
            if link is last:
                self._written = link
            else:
                now_ns = requester.clock.now_ns()
                self._confirm(link, requester.answer(now_ns + (self._begun_ns + self._period_ns - now_ns) // left))

    def _ask(self, reading: Reading) -> Question | None:
        """Ask a unit, and return the question; None when nothing can be asked now."""
        if self._requester.outstanding is not None:
            return None
        link, octets = reading.link, self._nothing
        set_point, late = link.set_point, link.late
        if not (reading.writing and set_point.waiting):
            form = reading.alone
            if form is None or form.question.function in late:
                return None
        else:
            forms = reading.writing
            if READ_WRITE in late:
                if not link.writing or set_point.function in late:
                    return None
                forms = link.writing
            place, octets = set_point.take()
            form = forms[place]
        self._requester.send(form, octets)
        self._owner = link
        return form.question

    def _clear(self, reading: Reading, until_ns: int) -> None:
        """Wait for the answer to another request, of an earlier period; then ask for this reading, if there is time."""
        form = self._requester.outstanding
        if form is None or reading.asks(form):
            return
        self._take_late(form, until_ns)
        if until_ns - self._requester.clock.now_ns() >= reading.times.whole_ns:
            self._asked = self._ask(reading)

    def _accepted(self, link: UnitLink, asked: Question, answer: Answer | None) -> bool:
        """Note the state of the unit from an answer; False without an answer, and for an exception."""
        if answer is None:
            if self._requester.transport.serial:
                self._requester.forget()
                link.late.add(asked.function)
            return False
        if link.late and asked.function not in link.late:
            link.late.clear()  # a unit answers in order, so no earlier answer can come any more
        if answer.exception is not None:
            link.refused(answer.exception)
            return False
        if asked.values:
            link.set_point.answered()
        return True

    def _confirm(self, link: UnitLink, answer: Answer | None) -> None:
        if self._asked is not None:
            self._accepted(link, self._asked, answer)
