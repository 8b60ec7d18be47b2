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

from haptic_fieldbus.buses.modbus.parting import MOST_ZEROS, UnitParting
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.tcp import DELAYED_ACK
from haptic_fieldbus.errors import BusError

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


class LineRelease:
    """The release of all drives of one line; no method raises anything but KeyboardInterrupt and its like."""

    def __init__(self, requester: Requester, partings: Sequence[UnitParting], *, exchange: float, guard: float) -> None:
        """Take the longest times of a request with its answer and of a watchdog [s]."""
        self.warnings: list[str] = []
        self._requester, self._clock = requester, requester.clock
        self._partings = tuple(partings)
        self._slice_ns = round(1e9 * max(SLICE, 2.0 * exchange))
        self._patience_ns = round(1e9 * max(PATIENCE, 2.0 * exchange))
        self._held_ns = 0 if requester.transport.serial else round(1e9 * DELAYED_ACK)
        # The watchdog runs from the last write of zero torque.
        zeros_ns = MOST_ZEROS * QUESTIONS * len(self._partings) * self._patience_ns
        self._longest_ns = round(1e9 * (guard + GRACE)) + zeros_ns + len(self._partings) * self._held_ns
        self._end_ns = self._waiting_until_ns = 0
        self._asked: UnitParting | None = None
        self._begun = self._dead = False

    def begin(self, missing: Sequence[int]) -> None:
        """Send zero torque to a drive; what is under way on a serial line is waited for, some milliseconds.

        `missing` are the answers that each drive owes to the present period. Those that owe more come later, and the
        one whose answer is outstanding comes last.
        """
        awaited = None if self._requester.outstanding is None else self._requester.outstanding.question.unit
        owing = zip(self._partings, missing, strict=True)
        ordered = sorted(owing, key=lambda each: (each[0].unit.id == awaited, each[1]))
        self._partings = tuple(parting for parting, _ in ordered)
        self._end_ns, self._begun, self._dead, self._asked = self._clock.now_ns() + self._longest_ns, True, False, None
        for parting in self._partings:
            parting.begin()
        if self._requester.transport.serial and self._requester.outstanding is not None:
            self._try(lambda: self._requester.answer(self._requester.sent_ns + self._patience_ns))
        self._try(self._ask)

    def look(self) -> bool:
        """Go on for one slice; True when all drives are settled, the time is over, or nothing was begun."""
        if not self._begun:
            return True
        end_ns = self._clock.now_ns() + self._slice_ns
        while not self._settled and self._clock.now_ns() < end_ns:
            if self._dead and not self._try(self._open_again):
                self._clock.sleep_until(end_ns)
            elif not self._try(lambda: self._step(end_ns)):
                self._clock.sleep_until(min(end_ns, self._clock.now_ns() + 1_000_000))
        return self._settled or self._clock.now_ns() >= self._end_ns

    def leave(self) -> bool:
        """Tell what is left to tell; True when every drive said that its motor is off, or nothing was begun."""
        if not self._begun:
            return True
        self._begun = False
        self._requester.forget()
        for parting in self._partings:
            self._tell(parting)
        return all(parting.free for parting in self._partings)

    @property
    def _settled(self) -> bool:
        return all(parting.settled for parting in self._partings)

    def _ask(self) -> None:
        """Send the next question: to the drives that were not freed yet before all others."""
        unsettled = [parting for parting in self._partings if not parting.settled]
        after = unsettled[1:] + unsettled[:1] if self._asked is not None and unsettled[0] is self._asked else unsettled
        parting = min(after, key=lambda each: each.freed)
        self._asked = parting
        question = parting.question()
        held_ns = self._held_ns if parting.zeroed and not question.values else 0
        self._waiting_until_ns = self._clock.now_ns() + self._patience_ns + held_ns
        self._requester.ask(question)

    def _step(self, end_ns: int) -> None:
        """Wait for an answer until the end of the slice; ask the next question when it came, or patience is over."""
        parting = self._asked
        if parting is not None:
            answer = self._requester.answer(min(end_ns, self._waiting_until_ns))
            if answer is None and self._clock.now_ns() < self._waiting_until_ns:
                return
            self._requester.forget()
            parting.take(answer)
        if not self._settled:
            self._ask()

    def _open_again(self) -> None:
        """Open the dead line anew, and begin with zero torque."""
        self._asked = None
        self._requester.forget()
        self._requester.transport.reopen()
        self._dead = False
        for parting in self._partings:
            parting.again()

    def _try(self, action: Callable[[], object]) -> bool:
        """Do something that must not keep anything else from being done; False, and a warning, when it failed."""
        try:
            action()
        except BusError as error:
            self._dead = True
            self._warn(f"on the way to zero torque: {error}")
            return False
        except Exception as error:  # of a driver
            self._dead = True
            self._warn(f"on the way to zero torque: {type(error).__name__}: {error}")
            return False
        return True

    def _tell(self, parting: UnitParting) -> None:
        """Warn about a drive that is not free, or that keeps what the run had written."""
        if not parting.free:
            self._warn(f"{parting.unit.label} did not confirm that its motor is off")
        elif parting.kept:
            self._warn(f"{parting.unit.label} was left with {', '.join(parting.kept)} as the run had written it")

    def _warn(self, sentence: str) -> None:
        if sentence not in self.warnings:
            self.warnings.append(sentence)
