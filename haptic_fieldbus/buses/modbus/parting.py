"""One drive on its way to zero torque, one request after another.

1. Target torque 0, then the command that frees the shaft.
2. The status is asked for. Until it says that the motor is off, command and question are repeated in turn. The target
   torque is repeated only once, and only without an answer, since each write to it feeds the drive's watchdog.
3. A drive that is off gets back what it held before the run: the time of its watchdog, its torque limit. Each is read
   back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from haptic_fieldbus.buses.modbus.framing import Answer, Question
from haptic_fieldbus.buses.modbus.registers import from_words
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.drive.power import ENERGISED, PowerState, PowerTable
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, Register

MOST_ZEROS = 2
"""So often zero torque is sent on one line."""
Undone = tuple[Register, int]
"""A register, and the value that it held before the run."""


@dataclass(frozen=True)
class _Move:
    question: Question
    done: Callable[[Answer], None]


class UnitParting:
    """A drive that is to be freed; `last` gives what it held before, when it is asked for."""

    def __init__(
        self, unit: UnitClient, profile: ModbusProfile, power: PowerTable, last: Callable[[], Sequence[Undone]]
    ) -> None:
        self.unit = unit
        self.free = False
        """True when the drive has said that its motor is off."""
        self.fault: int | None = None
        """Code of the fault in which the drive was when it was first asked; 0 without a code."""
        self.refused: list[str] = []
        """Registers that the drive kept as they were."""
        self._profile, self._power, self._last = profile, power, last
        self._order = profile.line.word_order
        self._status = unit.reading(profile.power.status)
        self._zero = unit.writing(profile.torque.target, 0)
        self._off = unit.writing(profile.power.command, power.off)
        self._to_do: list[_Move] = []
        self._undoing: list[Undone] = []
        self._asked = False
        self._zeros = 0
        """How often zero torque is still sent, unless it is answered."""

    def begin(self) -> None:
        """Forget an earlier way to zero."""
        self.free, self.fault, self.refused, self._asked = False, None, [], False
        self._undoing = list(self._last())
        self.again()

    @property
    def settled(self) -> bool:
        """True when the motor is off, and all was put back or refused to be."""
        return self.free and not self._undoing

    @property
    def freed(self) -> bool:
        """True when zero torque and the command for off have been sent and answered at least once."""
        return self.free or self._asked

    @property
    def zeroed(self) -> bool:
        """True when zero torque was answered, or sent as often as it may be."""
        return not self._zeros

    @property
    def kept(self) -> list[str]:
        """Registers that are still as the run had written them."""
        return [*self.refused, *(str(register) for register, _ in self._undoing)]

    def question(self) -> Question:
        """Return what is to be asked next; the drive must not be settled."""
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
        """Begin with zero torque once more, on a line that was opened anew."""
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
        if not self._asked and state in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            self._look_for_cause()
        self._asked, self.free = True, state not in ENERGISED

    def _look_for_cause(self) -> None:
        self.fault = 0
        register = self._profile.power.error
        if register is not None:
            self._to_do.append(_Move(self.unit.reading(register), partial(self._note_fault, register)))

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
            self._keep("it holds another value")

    def _keep(self, why: str) -> None:
        register, _ = self._undoing.pop(0)
        self.refused.append(f"{register} ({why})")
        self._to_do = []


def _nothing(answer: Answer) -> None:
    """Do nothing: what was written shows in the status."""
