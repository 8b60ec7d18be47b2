"""The Modbus master: a request and its answer, one drive after another, all in the thread of the loop.

One period is `read` and `write`, by the way that the plan has chosen:

- Function 23 (`Transaction.READ_WRITE`): `write` stores the set-points, and the next `begin` sends them with the
  questions. A period without a `write` asks by a reading function, so that a set-point is sent once, and feeds a
  watchdog once.
- Reading, then writing (`Transaction.READ_THEN_WRITE`): `write` sends the set-points, one drive after another. The
  answer of the last one is taken by the next `prepare`, as nothing is computed from it.

Answers that stay away never make a period longer: each request has its share of the time until the deadline. Then the
axis is stale, and the age of its feedback grows. `requester` tells why nothing is sent on TCP while an answer is
outstanding; when it comes, in a later period, its sample is used with the age that it has. On RTU, after function 23
stayed without an answer, the set-point is sent by a writing function in the next period: a late answer of function 23
cannot be taken for its own. A unit answers in order, so when that answer comes no earlier one can. Where it stays away
as well, or nothing is to be written, nothing is asked until a whole reading part was quiet.

A dead line raises, and the run ends. `stop` consists of `release`, `settle` and `leave`.

The way to zero torque is one design for a trip, an ordinary end and an exception. `begin` sends zero torque to the
first drive without waiting for anything; the others follow in turn, since a line takes one request at a time. Drives
that answer come before silent ones, for whose answers the line waits in vain. Every drive is sent zero torque and the
command for off before any is asked whether it is off. No set-point but zero is sent from `begin` on, and that one twice
at most. When a drive confirms nothing, its watchdog takes the torque away, and the looks end only after that time. A
line that died is opened anew for this way alone: TCP connects again, a serial port is opened again. Nothing is ever
enabled on it. All times on this way are those of the line, not of the loop.

Reference: Modbus application protocol 1.1b3, 6.3, 6.12, 6.17; Modbus over serial line 1.02, 2.4.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain

from haptic_fieldbus.buses import release
from haptic_fieldbus.buses.bus import offsets_of, traffic_of
from haptic_fieldbus.buses.modbus.exchange import Turns, listen
from haptic_fieldbus.buses.modbus.framing import Answer, Question
from haptic_fieldbus.buses.modbus.link import Reading, StoredSetPoint, TargetReading, UnitLink, times_of
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.setup import UnitSetup
from haptic_fieldbus.buses.modbus.transport import DELAYED_ACK, Transport
from haptic_fieldbus.buses.modbus.unit import DriveWatch, UnitClient, from_words
from haptic_fieldbus.buses.torque_limits import TorqueLimits
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.profile import ENERGISED, PowerTable
from haptic_fieldbus.errors import BusError, DriveFaultError
from haptic_fieldbus.numerals import in_unit
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import AxisImage
from haptic_fieldbus.planning.limits import effort_step
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, characters
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile, Register
from haptic_fieldbus.protocols.modbus.register_traffic import RegisterRequest, Transaction
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic
from haptic_fieldbus.signals import LinkFlag

# One drive on its way to zero torque, one request after another.
#
# 1. Target torque 0, then the command that frees the shaft.
# 2. The status is asked for. Until it says that the motor is off, command and question are repeated in turn. The target
#    torque is repeated only once, and only without an answer, since each write to it feeds the drive's watchdog.
# 3. A drive that is off gets back what it held before the run: the time of its watchdog, its torque limit. Each is read
#    back.

MOST_ZEROS = 2
"""So often zero torque is sent on one line."""
Undone = tuple[Register, int]
"""A register, and the value that it held before the run."""


_Move = tuple[Question, Callable[[Answer], None]]
"""A request, and what is done with its answer."""


class UnitRelease(release.DriveRelease[Undone]):
    """One drive on its way to zero torque."""

    def __init__(self, setup: UnitSetup) -> None:
        super().__init__(setup.unit.label, setup)
        self.unit = unit = setup.unit
        self.fault: int | None = None
        """Code of the fault in which the drive was when it was first asked; 0 without a code."""
        self._profile, self._power = profile, power = setup.profile, setup.axis.power
        self._order = profile.line.word_order
        self._status = unit.reading(profile.power.status)
        self._zero = unit.writing(profile.torque.target, 0)
        self._off = unit.writing(profile.power.command, power.off)
        self._to_do: list[_Move] = []
        self._asked = False
        self._zeros = 0
        """How often zero torque is still sent, unless it is answered."""

    def begin(self) -> None:
        """Forget an earlier way to zero."""
        super().begin()
        self.fault, self._asked = None, False
        self.again()

    @property
    def freed(self) -> bool:
        """True when zero torque and the command for off have been sent and answered at least once."""
        return self.free or self._asked

    @property
    def zeroed(self) -> bool:
        """True when zero torque was answered, or sent as often as it may be."""
        return not self._zeros

    def question(self) -> Question:
        """Return the next request; the drive must not be settled."""
        if not self._to_do and self.free:
            register, before = self._undoing[0]
            compare = partial(self._compare, before)
            self._to_do = [(self.unit.writing(register, before), _nothing), (self.unit.reading(register), compare)]
        elif not self._to_do:
            self._to_do = [(self._off, _nothing), (self._status, self._judge)]
            if self._zeros:
                self._zeros -= 1
                self._to_do.insert(0, (self._zero, self._zeroed))
        return self._to_do[0][0]

    def take(self, answer: Answer | None) -> None:
        """Take the answer to the last question; without one, and after an exception, the next question follows."""
        _, done = self._to_do.pop(0)
        if answer is None and self.free:
            self._to_do = []  # what is put back is read back only after it was written
        elif answer is None:
            return
        elif answer.exception is None:
            done(answer)
        elif self.free:
            self._keep(f"exception {answer.exception}")

    def again(self) -> None:
        """Begin again with zero torque, after the line was reopened."""
        self._to_do, self._zeros = [], MOST_ZEROS

    def _zeroed(self, answer: Answer) -> None:
        self._zeros = 0

    def _judge(self, answer: Answer) -> None:
        state = self._power.state(from_words(self._profile.power.status, answer.registers, self._order))
        if not self._asked and state in release.FAULTS:
            self.fault, register = release.NO_CODE, self._profile.power.error
            if register is not None:
                self._to_do.append((self.unit.reading(register), partial(self._note_fault, register)))
        self._asked, self.free = True, state not in ENERGISED

    def _note_fault(self, register: Register, answer: Answer) -> None:
        self.fault = from_words(register, answer.registers, self._order)

    def _compare(self, before: int, answer: Answer) -> None:
        register, _ = self._undoing[0]
        if from_words(register, answer.registers, self._order) == before:
            self._undoing.pop(0)
        else:
            self._keep("it has another value")

    def _keep(self, why: str) -> None:
        register, _ = self._undoing.pop(0)
        self.refused.append(f"{register} ({why})")
        self._to_do = []


def _nothing(answer: Answer) -> None:
    """Do nothing: what was written shows in the status."""


SLICE = 0.002
"""[s] of one look; longer where an exchange takes more than half of it."""
PATIENCE = 0.015
"""Time that a drive has for an answer, before the next request is sent [s]; longer on a slow line.

On TCP the answer to a question has `DELAYED_ACK` more once zero torque need not be sent again: zero torque goes out
while an earlier answer is outstanding, and a server with Nagle's algorithm then holds its answers back until we
acknowledge that one.
"""
QUESTIONS = 3
"""Requests of one round: zero torque, command, status."""
GRACE = 0.05
"""Time from the end of the longest watchdog to the last look [s]."""


class LineRelease(release.BusRelease[UnitRelease]):
    """The release of all drives of one line."""

    def __init__(self, requester: Requester, drives: Sequence[UnitRelease], *, exchange: float, guard: float) -> None:
        """Take the longest times of a request with its answer and of a watchdog [s]."""
        super().__init__(requester.clock, drives)
        self._requester, self._linked = requester, self._drives  # in the order of the links
        self._slice_ns = round(1e9 * max(SLICE, 2.0 * exchange))
        self._patience_ns = round(1e9 * max(PATIENCE, 2.0 * exchange))
        self._held_ns = 0 if requester.transport.serial else round(1e9 * DELAYED_ACK)
        # The watchdog runs from the last write of zero torque.
        zeros_ns = MOST_ZEROS * QUESTIONS * len(self._drives) * self._patience_ns
        self._longest_ns = round(1e9 * (guard + GRACE)) + zeros_ns + len(self._drives) * self._held_ns
        self._waiting_until_ns = 0
        self._asked: UnitRelease | None = None
        self._dead = False

    def begin(self, missing: Sequence[int]) -> None:
        """Send zero torque to a drive; what is under way on a serial line is waited for, some milliseconds.

        `missing` are the answers that each drive owes to the present period. Those that owe more come later, and the
        one whose answer is outstanding comes last.
        """
        awaited = None if self._requester.outstanding is None else self._requester.outstanding.question.unit
        owing = zip(self._linked, missing, strict=True)
        ordered = sorted(owing, key=lambda each: (each[0].unit.id == awaited, each[1]))
        self._drives = tuple(drive for drive, _ in ordered)
        self._end_ns, self._begun, self._dead, self._asked = self._clock.now_ns() + self._longest_ns, True, False, None
        for drive in self._drives:
            drive.begin()
        if self._requester.transport.serial and self._requester.outstanding is not None:
            self._try(lambda: self._requester.answer(self._requester.sent_ns + self._patience_ns))
        self._try(self._ask)

    def _go_on(self) -> None:
        end_ns = self._clock.now_ns() + self._slice_ns
        while not self._settled and self._clock.now_ns() < end_ns:
            if self._dead and not self._try(self._open_again):
                self._clock.sleep_until(end_ns)
            elif not self._try(lambda: self._step(end_ns)):
                self._clock.sleep_until(min(end_ns, self._clock.now_ns() + 1_000_000))

    def leave(self) -> bool:
        """Issue the remaining warnings; True when every drive reported its motor off, or nothing was begun."""
        if self._begun:
            self._requester.forget()
        return super().leave()

    def _ask(self) -> None:
        """Send the next question: to the drives that were not freed yet before all others."""
        unsettled = [drive for drive in self._drives if not drive.settled]
        after = unsettled[1:] + unsettled[:1] if self._asked is not None and unsettled[0] is self._asked else unsettled
        drive = min(after, key=lambda each: each.freed)
        self._asked = drive
        question = drive.question()
        held_ns = self._held_ns if drive.zeroed and not question.values else 0
        self._waiting_until_ns = self._clock.now_ns() + self._patience_ns + held_ns
        self._requester.ask(question)

    def _step(self, end_ns: int) -> None:
        """Wait for an answer until the end of the slice; ask the next question when it came, or patience is over."""
        drive = self._asked
        if drive is not None:
            answer = self._requester.answer(min(end_ns, self._waiting_until_ns))
            if answer is None and self._clock.now_ns() < self._waiting_until_ns:
                return
            self._requester.forget()
            drive.take(answer)
        if not self._settled:
            self._ask()

    def _open_again(self) -> None:
        """Open the dead line anew, and begin with zero torque."""
        self._asked = None
        self._requester.forget()
        self._requester.transport.reopen()
        self._dead = False
        for drive in self._drives:
            drive.again()

    def _try(self, action: Callable[[], object]) -> bool:
        """Do one thing whose failure must not stop the rest; False, and a warning, when it failed."""
        try:
            action()
        except Exception as error:  # of the line, or of a driver
            self._dead = True
            kind = "" if isinstance(error, BusError) else f"{type(error).__name__}: "
            self._warn(f"during release: {kind}{error}")
            return False
        return True


# Clearing of the fault into which a drive goes when it has lost its master (`buses.release`), by the code that its
# profile names for it.


def acknowledge(unit: UnitClient, profile: ModbusProfile, power: PowerTable) -> None:
    """Clear the fault of a drive that lost its master; raises DriveFaultError for another fault, or BusError."""
    status, command = profile.power.status, profile.power.command
    if power.state(unit.read(status)) not in release.FAULTS:
        return
    code = release.NO_CODE if profile.power.error is None else unit.optional(profile.power.error) or release.NO_CODE
    expected = None if profile.watchdog is None else profile.watchdog.fault
    if expected is not None and code not in (expected, release.NO_CODE):
        raise release.other_fault(unit.label, f"{code:04X}h")
    reset = release.FAULT_RESET if profile.power.table == "cia402" else profile.power.reset
    if reset is None:
        raise DriveFaultError(
            f"{unit.label} is in fault for a lost master, but {profile.title} has no command that resets it "
            "(power.reset of its profile): switch it off and on"
        )
    for each in (power.off, reset, power.off):
        unit.send(command, each)
    release.check_cleared(unit, lambda: power.state(unit.read(status)) not in release.FAULTS)


UNGUARDED = 1.0
"""Time for which a drive without a watchdog is tried to be freed [s]: on TCP, lost octets come again within it."""
ANSWER_TIME = 0.01
"""[s]; so long an answer beside the exchange is waited for at least."""


class ModbusBus(release.ReleasedBus[LineRelease]):
    """A Modbus master on any transport; `section` is its bus in the rig."""

    def __init__(self, transport: Transport, clock: Clock, section: ModbusSection) -> None:
        super().__init__()
        self._transport, self._clock, self._section = transport, clock, section
        self._requester = Requester(transport, clock, echo=section.echo)
        self._setups: tuple[UnitSetup, ...] = ()
        self._links: tuple[UnitLink, ...] = ()
        self._drives: tuple[UnitRelease, ...] = ()
        self._exchange: Turns

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """Listen for another master, then check all drives without writing to them, and fill `facts`.

        Exchanges fill the part of this bus in the input `image`. Raises ForeignMasterError before anything was written,
        BusTimeoutError, BusConfigurationError or DriveFaultError, TypeError for a bus of another protocol.
        """
        traffic = traffic_of(plan, ModbusTraffic)
        if self._section.serial:
            self._transport.tune(*characters(self._section, [member.profile for member in traffic.members]))
        self._requester.silence_ns = round(1e9 * traffic.wire.silence)
        listened = listen(self._requester)
        self._bind(plan, traffic, image)
        self.facts = {each.axis.name: each.inspect(listened) for each in self._setups}

    def configure(self, plan: Plan) -> None:
        """Configure all inspected drives; raises BusError, ForeignMasterError when another master commands by now."""
        self._exchange.forget()
        self._plan = plan  # from here on `stop` has something to undo
        for each in self._setups:
            each.configure()

    def start(self) -> None:
        """Arm the watchdogs; from now on set-points must come. Raises BusError."""
        for each in self._setups:
            each.start()
        self._requester.forget()
        self._requester.keep_silence()  # it is no part of the first period

    def _bind(self, plan: Plan, traffic: ModbusTraffic, image: bytearray) -> None:
        """Prepare all requests and offsets, so that the loop looks nothing up."""
        self._setups = tuple(self._setup_of(axis, traffic, plan) for axis in plan.axes)
        axes = zip(plan.axes, plan.image.axes, strict=True)
        self._links, of_axes, asked = zip(*(self._bound(*each, traffic, image) for each in axes), strict=True)
        readings, targets = tuple(chain.from_iterable(of_axes)), tuple(filter(None, asked))
        writes = traffic.way is Transaction.READ_THEN_WRITE
        self._exchange = Turns(self._requester, readings, targets, image, period_ns=plan.period_ns, writes=writes)
        self._drives = tuple(map(UnitRelease, self._setups))
        longest = max(reading.times.whole_ns for reading in readings) * 1e-9
        guard = max(UNGUARDED if each.watchdog is None else traffic.guard(each.axis.name) for each in self._setups)
        self._release = LineRelease(self._requester, self._drives, exchange=longest, guard=guard)

    def _setup_of(self, axis: AxisPlan, traffic: ModbusTraffic, plan: Plan) -> UnitSetup:
        profile = traffic.member(axis.name).profile
        unit = UnitClient(self._requester, axis.node, f"unit {axis.node} (axis {axis.name})", profile.line)
        section, held, real = profile.watchdog, profile.torque.limit, not plan.simulated
        watchdog = None if section is None else DriveWatch(unit, section, traffic.guard(axis.name))
        # The unit of the limit need not be that of the set-point.
        step = axis.effort_unit if held is None else effort_step(held.unit, profile, axis.rig)
        entries = () if held is None else (held,)
        limits = TorqueLimits(unit, axis, self.warnings.append, real, entries, step, plan.place(axis))
        return UnitSetup(unit, axis, profile, watchdog, limits)

    def _bound(
        self, axis: AxisPlan, places: AxisImage, traffic: ModbusTraffic, image: bytearray
    ) -> tuple[UnitLink, list[Reading], TargetReading | None]:
        """Return the link to one axis, the requests of its reading part, and that which reads its target torque back.

        None: its target torque is not read back.
        """
        member, of_axis = traffic.member(axis.name), traffic.of(axis.name)
        profile, own = member.profile, member.traffic
        form, function = self._requester.form, profile.line.reading
        set_point = StoredSetPoint(own, profile.line, places.outputs[0])
        link = UnitLink(axis.node, set_point, places.header, image, round(1e9 * traffic.latch(axis.name)))
        if set_point.function is not None:
            link.writing = tuple(form(set_point.writing(block)) for block in set_point.blocks)
        offsets = offsets_of(of_axis.incoming, places.inputs[0])
        readings: list[Reading] = []
        for request, block in ((each, each.read) for each in of_axis.reading):
            if block is None:
                continue
            times = times_of(traffic, profile, request)
            readings.append(Reading(link, block, times, image, offsets, latches=block.has(own.motion)))
            if function is not None:
                readings[-1].alone = form(Question(axis.node, function, block.address, block.count))
            if request.write is not None:
                readings[-1].writing = tuple(form(set_point.writing_before(each, block)) for each in set_point.blocks)
        if (block := of_axis.asked) is None:
            return link, readings, None
        function = function or READ_HOLDING
        times = times_of(traffic, profile, RegisterRequest(function, block))
        target = TargetReading(link, block, times, image, offsets)
        target.alone = form(Question(axis.node, function, block.address, block.count))
        return link, readings, target

    def read(self, deadline_ns: int) -> bytearray:
        """Exchange feedback once and return the input image; raises BusError when the line is dead.

        As `InSteps.read`, without its calls in between.
        """
        exchange = self._exchange
        exchange.prepare(deadline_ns)
        exchange.begin()
        return exchange.collect(deadline_ns)

    def prepare(self, deadline_ns: int) -> None:
        """Take the answer to the last set-point, until the deadline [ns] at the latest; raises BusError when dead."""
        self._exchange.prepare(deadline_ns)

    def begin(self) -> None:
        """Ask the first unit; raises BusError when the line is dead."""
        self._exchange.begin()

    def collect(self, deadline_ns: int) -> bytearray:
        """Receive answers and ask the other units until the deadline [ns], write the headers, return the input image.

        Raises BusError when the line is dead.
        """
        return self._exchange.collect(deadline_ns)

    def write(self, image: bytes | bytearray) -> None:
        """Send the set-points, or store them for the next `begin`; raises BusError when the line is dead."""
        self._exchange.write(image)

    @property
    def causes(self) -> dict[str, tuple[LinkFlag, int]]:
        """By axis, the fault that a drive reported while it was freed, unless it is that of having lost us."""
        return {
            each.axis.name: (LinkFlag.EMERGENCY, drive.fault)
            for each, drive in zip(self._setups, self._drives, strict=True)
            if drive.fault and (each.profile.watchdog is None or drive.fault != each.profile.watchdog.fault)
        }

    def ask(self, axis: str) -> int | None:
        """Read the statusword of an axis; None without an answer in some milliseconds."""
        each = next(each for each in self._setups if each.axis.name == axis)
        status = each.profile.power.status
        self._requester.ask(each.unit.reading(status))
        longest = max(ANSWER_TIME, 4e-9 * self._requester.silence_ns)
        answer = self._requester.answer(self._clock.now_ns() + round(1e9 * longest))
        self._requester.forget()
        if answer is None or answer.exception is not None:
            return None
        return from_words(status, answer.registers, each.profile.line.word_order)

    def acknowledge(self) -> None:
        """Clear the faults by which the stopped drives say that they lost us; raises DriveFaultError or BusError."""
        for each in self._setups:
            acknowledge(each.unit, each.profile, each.axis.power)

    def release(self) -> None:
        """Send zero torque, once something was written; raises nothing."""
        if self._plan is not None and self._release is not None:
            self._release.begin([link.missing for link in self._links])

    def _observed(self) -> Iterator[str]:
        """Yield what is told of answers: dropped, too late for their period, and with positions that are torn."""
        dropped = ", ".join(f"{number} {kind.value}" for kind, number in self._requester.surprises.items())
        self._requester.surprises.clear()
        if dropped:
            yield f"{self._transport.name}: answers were dropped: {dropped}"
        exchange = self._exchange
        if exchange.late:
            yield (
                f"{self._transport.name}: {exchange.late} answers came too late for their period, the slowest after "
                f"{in_unit(1e-9 * exchange.slowest_ns, 's')}. The line is slower than the plan assumes. Measure "
                "round_trip with haptic-fieldbus doctor and write it into the rig, or use a lower rate"
            )
        for link in self._links:
            if link.torn:
                yield (
                    f"unit {link.unit} sent {link.torn} positions with jumps of about 65536 counts (their two "
                    "registers are of different instants); these samples were dropped"
                )

    def close(self) -> None:
        """Stop unless already stopped, and close the line; raises no BusError."""
        self.stop()
        self._transport.close()
