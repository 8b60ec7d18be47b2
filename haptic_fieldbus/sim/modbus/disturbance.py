"""Faults of answers on their way to the master: what arrives, and when."""

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

from haptic_fieldbus.protocols.modbus.line import TCP_OCTETS
from haptic_fieldbus.sim import faults

GARBAGE = (1, 40)
"""Least and greatest number of random octets in the place of an answer."""


@dataclass
class _Pending:
    fault: faults.AnswerDisturbance
    unit: int
    left: int


class AnswerDisturbances:
    """Faults that wait for the next answers of the drives; random octets are drawn from the seed."""

    def __init__(self, seed: int | str, *, serial: bool) -> None:
        self._random = Random(f"{seed}/answers")
        self._serial = serial
        self._waiting: list[_Pending] = []
        self._held: list[bytes] = []
        """Answers that come with the next request."""

    def add(self, fault: faults.AnswerDisturbance, unit: int) -> None:
        """Disturb the next answers of a drive."""
        self._waiting.append(_Pending(fault, unit, fault.count))

    def take(self, unit: int) -> faults.AnswerDisturbance | None:
        """Return the fault of this answer, and count it; None when it has none."""
        for waiting in self._waiting:
            if waiting.unit == unit:
                waiting.left -= 1
                if not waiting.left:
                    self._waiting.remove(waiting)
                return waiting.fault
        return None

    def released(self) -> list[bytes]:
        """Return the answers that were held back until this request."""
        held, self._held = self._held, []
        return held

    def arriving(self, fault: faults.AnswerDisturbance | None, octets: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield what arrives in the place of an answer: by how much later [ns], and its octets."""
        match fault:
            case faults.AnswerLost():
                return
            case faults.AnswerSwapped():
                self._held.append(octets)
                return
            case faults.AnswerDelayed(delay=delay):
                yield round(delay * 1e9), octets
            case faults.AnswerGarbage():
                yield 0, self._random.randbytes(self._random.randint(*GARBAGE))
            case faults.AnswerCorrupted():
                yield 0, self._corrupted(octets)
            case faults.AnswerTruncated(length=length):
                yield 0, octets[:length]
            case _:
                yield 0, octets

    def _corrupted(self, octets: bytes) -> bytes:
        """Return the octets with one other bit; TCP protects its payload, so there it is one of the header."""
        bit = self._random.randrange(8 * (len(octets) if self._serial else TCP_OCTETS))
        changed = bytearray(octets)
        changed[bit // 8] ^= 1 << bit % 8
        return bytes(changed)
