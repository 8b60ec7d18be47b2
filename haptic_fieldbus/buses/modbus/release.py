"""The way to zero torque on one line: one design for a trip, an ordinary end and an exception.

`begin` sends zero torque to the first drive without waiting for anything; the others follow in turn, since a line takes
one request at a time. Drives that answer come before silent ones, for whose answers the line waits in vain. Every drive
is sent zero torque and the command for off before any is asked whether it is off.
No set-point but zero is sent from `begin` on, and that one twice at most. When a drive confirms nothing, its watchdog
takes the torque away, and the looks end only after that time.

A line that died is opened anew for this way alone: TCP connects again, a serial port is opened again. Nothing is ever
enabled on it; the run has ended.

All times here are those of the line, not of the loop.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from haptic_fieldbus.buses.modbus.framing import Answer, Question
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.setup import UnitSetup
from haptic_fieldbus.buses.modbus.transport import DELAYED_ACK
from haptic_fieldbus.buses.modbus.unit import from_words
from haptic_fieldbus.buses.release import FAULTS, NO_CODE, BusRelease, DriveRelease
from haptic_fieldbus.drive.power import ENERGISED
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.protocols.modbus.profile import Register

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


@dataclass(frozen=True)
class _Move:
    question: Question
    done: Callable[[Answer], None]


class UnitRelease(DriveRelease[Undone]):
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
        if not self._to_do:
            self._to_do = self._undo(*self._undoing[0]) if self.free else self._freeing()
        return self._to_do[0].question

    def take(self, answer: Answer | None) -> None:
        """Take the answer to the last question; without one, and after an exception, the next question follows."""
        step = self._to_do.pop(0)
        if answer is None and self.free:
            self._to_do = []  # what is put back is read back only after it was written
        elif answer is None:
            return
        elif answer.exception is None:
            step.done(answer)
        elif self.free:
            self._keep(f"exception {answer.exception}")

    def again(self) -> None:
        """Begin again with zero torque, after the line was reopened."""
        self._to_do, self._zeros = [], MOST_ZEROS

    def _freeing(self) -> list[_Move]:
        steps = [_Move(self._off, _nothing), _Move(self._status, self._judge)]
        if self._zeros:
            self._zeros -= 1
            steps.insert(0, _Move(self._zero, self._zeroed))
        return steps

    def _zeroed(self, answer: Answer) -> None:
        self._zeros = 0

    def _judge(self, answer: Answer) -> None:
        state = self._power.state(from_words(self._profile.power.status, answer.registers, self._order))
        if not self._asked and state in FAULTS:
            self.fault, register = NO_CODE, self._profile.power.error
            if register is not None:
                self._to_do.append(_Move(self.unit.reading(register), partial(self._note_fault, register)))
        self._asked, self.free = True, state not in ENERGISED

    def _note_fault(self, register: Register, answer: Answer) -> None:
        self.fault = from_words(register, answer.registers, self._order)

    def _undo(self, register: Register, before: int) -> list[_Move]:
        return [
            _Move(self.unit.writing(register, before), _nothing),
            _Move(self.unit.reading(register), lambda answer: self._compare(answer, before)),
        ]

    def _compare(self, answer: Answer, before: int) -> None:
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


class LineRelease(BusRelease[UnitRelease]):
    """The release of all drives of one line."""

    def __init__(self, requester: Requester, drives: Sequence[UnitRelease], *, exchange: float, guard: float) -> None:
        """Take the longest times of a request with its answer and of a watchdog [s]."""
        super().__init__(requester.clock, drives)
        self._requester = requester
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
        owing = zip(self._drives, missing, strict=True)
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
