"""Errors of a simulated node: emergency messages, the error register and the error history.

Reference: CiA 301 4.2, 7.2.7 (EMCY), 7.5.2.2 (1001h), 7.5.2.4 (1003h). An error is active from `raise_error` to
`clear`; when the last one is cleared the message *error reset* is sent.
"""

import struct
from collections import deque
from collections.abc import Callable

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.dictionary import AbortCode, Access, Dictionary, Entry, SdoAbort

HISTORY = 8
HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT = 0x8210

_GENERIC = 0x01
# CiA 301, tables 26 and 46: bit of the error register by the class of the code; device specific errors are generic too.
_REGISTER_BITS = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}
_MONITORING = range(0x8100, 0x8300)


class Emergencies:
    """Active errors and what follows from them; `send` queues the eight octets of an emergency message."""

    def __init__(self, dictionary: Dictionary, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._active: list[int] = []
        self._history: deque[int] = deque(maxlen=HISTORY)
        self._register = dictionary.add(Entry(0x1001, 0, DataType.UINT8))
        count = dictionary.add(Entry(0x1003, 0, DataType.UINT8, 0, Access.RW, accept=_only_zero))
        count.fetch = lambda: len(self._history)
        count.changed = self._history.clear
        for number in range(1, HISTORY + 1):
            entry = dictionary.add(Entry(0x1003, number, DataType.UINT32))
            entry.fetch = self._reader(number)

    def raise_error(self, code: int) -> None:
        """An error occurred: a message, unless the same is active already."""
        if code in self._active:
            return
        self._active.append(code)
        self._history.appendleft(code)
        self._report(code)

    def clear(self, code: int) -> None:
        """The error is over; unknown ones are passed over."""
        if code in self._active:
            self._active.remove(code)
            self._report(0)

    def clear_all(self) -> None:
        """After a fault reset; errors of communication stay until it works again."""
        remaining = [code for code in self._active if code in _MONITORING]
        if remaining != self._active:
            self._active = remaining
            self._report(0)

    def restart(self) -> None:
        """Power-on: nothing is active, nothing is sent."""
        self._active.clear()
        self._history.clear()
        self._register.value = 0

    def _report(self, code: int) -> None:
        register = 0
        for active in self._active:
            register |= _GENERIC | _REGISTER_BITS.get(active >> 12, 0)
        self._register.value = register
        self._send(struct.pack("<HB5x", code, register))

    def _reader(self, number: int) -> Callable[[], int]:
        def read() -> int:
            if number > len(self._history):
                raise SdoAbort(AbortCode.NO_DATA)
            return self._history[number - 1]

        return read


def _only_zero(value: int) -> None:
    if value:
        raise SdoAbort(AbortCode.INVALID_VALUE)
