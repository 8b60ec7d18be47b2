"""One unit on the line, register by register: for all that is asked and written beside the exchange.

A request that stays without an answer is repeated, which changes nothing, since each one reads or writes a value. After
a time-out the line is left quiet for a while, so that a late answer is not taken for that to the next question. An
answer to a repeated request may be that to an earlier one. The line is then left quiet for as long as a unit needs that
answers one request after the other: each took no longer than the first.
"""

from collections.abc import Sequence

from haptic_fieldbus.buses.modbus.framing import Answer, Question
from haptic_fieldbus.buses.modbus.requester import Requester, no_echo
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, LineSection, Register, WatchdogSection, WordOrder
from haptic_fieldbus.protocols.modbus.register_traffic import EXCEPTIONS
from haptic_fieldbus.protocols.modbus.traffic import STEPS_PER_SECOND

# Values as they stand in registers of 16 bits; one of 32 bits takes two, in the drive's order of words.


def to_words(register: Register, value: int, order: WordOrder) -> tuple[int, ...]:
    """Return the registers of a value, by rising address; raises struct.error when it is out of range."""
    low_first = register.type.pack(value)
    words = tuple(int.from_bytes(low_first[at : at + 2], "little") for at in range(0, len(low_first), 2))
    return words if order == "low first" else words[::-1]


def from_words(register: Register, words: Sequence[int], order: WordOrder) -> int:
    """Return the value in registers, given by rising address."""
    low_first = words if order == "low first" else words[::-1]
    return register.type.unpack(b"".join(word.to_bytes(2, "little") for word in low_first))


ANSWER_TIMEOUT = 0.3
"""Time for which an answer is waited for [s]."""
TRIES = 3
QUIET_NS = 50_000_000
"""Time for which nothing is sent after a question without an answer [ns]."""
ABSENT = (1, 2)
"""Exceptions that say that there is no such register: illegal function, illegal data address."""


class RefusedError(BusConfigurationError):
    """An exception by which a unit refused a request; `code` is its number."""

    def __init__(self, message: str, code: int) -> None:
        self.code = code
        super().__init__(message)


class UnitClient:
    """The unit with this id; `label` names it in messages, `section` tells which functions it has."""

    def __init__(self, requester: Requester, unit: int, label: str, section: LineSection) -> None:
        self.id, self.label = unit, label
        self.requester, self._section = requester, section

    def now_ns(self) -> int:
        """Return the time of the clock of the line."""
        return self.requester.clock.now_ns()

    def wait(self, duration_ns: int) -> None:
        """Send nothing for this time."""
        self.requester.quiet(duration_ns)

    def read(self, register: Register, timeout: float = ANSWER_TIMEOUT, tries: int = TRIES) -> int:
        """Return the value of a register.

        Raises BusTimeoutError without an answer, BusConfigurationError (RefusedError) when it is refused.
        """
        words = self._exchange(self.reading(register), f"to read {register}", timeout, tries).registers
        return from_words(register, words, self._section.word_order)

    def optional(self, register: Register) -> int | None:
        """Return the value of a register; None when the unit has none of that address."""
        try:
            return self.read(register)
        except RefusedError as error:
            if error.code in ABSENT:
                return None
            raise

    def send(self, register: Register, value: int) -> None:
        """Write a register and do not read it back; raises BusError as `read` does."""
        self._exchange(self.writing(register, value), f"to write {value} to {register}", ANSWER_TIMEOUT, TRIES)

    def write(self, register: Register, value: int) -> None:
        """Write a register and read it back; raises BusConfigurationError when it then holds another value."""
        self.send(register, value)
        held = self.read(register)
        if held != value:
            raise BusConfigurationError(f"{self.label}: wrote {value} to {register}, read back {held}")

    def ensure(self, register: Register, value: int) -> None:
        """Write a register, unless it holds the value already; raises BusError as `write` does."""
        if self.read(register) != value:
            self.write(register, value)

    def reading(self, register: Register) -> Question:
        """Return the question for a register; raises BusConfigurationError when the drive has no function for it."""
        function = self._section.reading
        if function is None:
            raise BusConfigurationError(f"{self.label} has no function that reads registers (profile: line.functions)")
        return Question(self.id, function, register.address, register.count)

    def writing(self, register: Register, value: int) -> Question:
        """Return the request that writes a register; one that writes and reads where the drive has no other."""
        words, address = to_words(register, value, self._section.word_order), register.address
        function = self._section.writing(register.count)
        if function is None:
            return Question(self.id, READ_WRITE, address, register.count, words, address)
        return Question(self.id, function, address, 0, words)

    def _exchange(self, question: Question, purpose: str, timeout: float, tries: int) -> Answer:
        requester, begun_ns = self.requester, self.now_ns()
        for late in range(tries):
            requester.ask(question)
            answer = requester.answer(requester.clock.now_ns() + round(timeout * 1e9))
            no_echo(requester)
            if answer is None:
                requester.quiet(QUIET_NS)
                continue
            if late:
                requester.quiet(QUIET_NS + late * (self.now_ns() - begun_ns))
            if answer.exception is None:
                return answer
            words = EXCEPTIONS.get(answer.exception, "not in the standard")
            refusal = f"{self.label} refused {purpose} with exception {answer.exception} ({words})"
            raise RefusedError(refusal, answer.exception)
        raise BusTimeoutError(
            f"{self.label} does not answer on {requester.name}: {tries} requests {purpose}, {exactly(timeout)} s each"
        )


# The drive's own watch on its master: armed when the exchange begins, and put back when a drive has been freed.
#
# It is armed last, so that it does not run out while other drives are configured. Set-points feed it; questions do not.


class DriveWatch:
    """The watchdog of one drive, set to `seconds`."""

    def __init__(self, unit: UnitClient, section: WatchdogSection, seconds: float) -> None:
        self._unit, self._section = unit, section
        if section.time.unit not in STEPS_PER_SECOND:
            wrong = f"unit {section.time.unit!r} of {section.time} is not one of {', '.join(STEPS_PER_SECOND)}"
            raise BusConfigurationError(f"{unit.label}: {wrong}")
        self._steps = round(seconds * STEPS_PER_SECOND[section.time.unit])
        self._before: int | None = None
        self.words = f"on link loss {section.reaction} within {round(1e3 * seconds)} ms"

    def prepare(self) -> None:
        """Choose the reaction, and note the former time; raises BusError."""
        for each in self._section.writes:
            self._unit.ensure(each, each.value)
        self._before = self._unit.read(self._section.time)

    def arm(self) -> None:
        """Set the time, and read it back; raises BusError, BusConfigurationError when the drive has another."""
        self._unit.write(self._section.time, self._steps)

    @property
    def disarming(self) -> tuple[tuple[Register, int], ...]:
        """Registers and values that restore the former state."""
        return () if self._before is None else ((self._section.time, self._before),)
