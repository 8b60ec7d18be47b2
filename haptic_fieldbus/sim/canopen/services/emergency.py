"""Errors of a simulated node: emergency messages, the error register and the error history.

Reference: CiA 301 4.2, 7.2.7 (EMCY), 7.5.2.2 (1001h), 7.5.2.4 (1003h), 7.5.2.18 (1015h). An error is active from
`raise_error` to `clear`, which sends *error reset* with the errors that remain in the register. An error may have
several causes, and lasts until all are gone; one of them is the *fault* of the drive, which its reset ends. Messages
within the inhibit time of an earlier message wait, up to `HISTORY` of them.
"""

import struct
from collections import deque
from collections.abc import Callable
from functools import partial

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.services.basics import Alarms
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Dictionary, Entry, Mappable, one_of

HISTORY = 8
DISCONNECTED = 0x8100
"""Communication, generic error: the master has ended the connection while the drive could make torque."""
HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT = 0x8210
PDO_TOO_LONG = 0x8220
SYNC_LENGTH = 0x8240
RPDO_TIMEOUT = 0x8250
DRIVE = "drive"
"""Cause of the errors of the drive, which its fault reset ends."""

_GENERIC = 0x01
# CiA 301, tables 26 and 46: bit of the error register by the class of the code. Every active error sets the generic bit
# too; device specific errors (FFxxh) also set bit 7.
_REGISTER_BITS = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}
# Codes of communication errors, which last until communication works again and end with its reset.
_MONITORING = range(0x8100, 0x8300)
# 1015h is in steps of 100 µs.
_TICK_NS = 100_000


class Emergencies:
    """Active errors, their register, history and messages; `send` queues the eight octets of an emergency message."""

    def __init__(
        self, dictionary: Dictionary, send: Callable[[bytes], None], alarms: Alarms, now: Callable[[], int]
    ) -> None:
        self.monitored = 0
        """Number of active communication errors; while it is 0, callers need not call `clear`."""
        self._send = send
        self._now = now
        self._active: list[int] = []
        self._causes: dict[int, set[object]] = {}
        self._history: deque[int] = deque(maxlen=HISTORY)
        self._waiting: deque[bytes] = deque(maxlen=HISTORY)
        self._inhibit = alarms.new(self._next)
        self._register = dictionary.add(Entry(0x1001, 0, DataType.UINT8, mappable=Mappable.TPDO))
        self._inhibit_time = dictionary.add(Entry(0x1015, 0, DataType.UINT16, 0, Access.RW))
        count = dictionary.add(Entry(0x1003, 0, DataType.UINT8, 0, Access.RW, accept=one_of((0,))))
        count.fetch = lambda: len(self._history)
        count.changed = self._history.clear
        for number in range(1, HISTORY + 1):
            entry = dictionary.add(Entry(0x1003, number, DataType.UINT32))
            entry.fetch = partial(self._past, number)

    def raise_error(self, code: int, cause: object = None) -> None:
        """Activate an error; send a message unless the same code is already active for any cause."""
        self._causes.setdefault(code, set()).add(cause)
        if code not in self._active:
            self._active.append(code)
            self._history.appendleft(code)
            self._report(code)

    def clear(self, code: int, cause: object = None) -> None:
        """Remove this cause, and end the error if no cause is left; unknown codes and causes are ignored."""
        causes = self._causes.get(code)
        if causes is None:
            return
        causes.discard(cause)
        if not causes:
            del self._causes[code]
            self._active.remove(code)
            self._report(0)

    def persists(self, cause: object) -> bool:
        """Return whether an error with this cause also has another cause that is still present."""
        return any(cause in causes and len(causes) > 1 for causes in self._causes.values())

    def clear_all(self, cause: object) -> None:
        """End all errors after a fault reset, except communication errors with a cause other than this one."""
        for causes in self._causes.values():
            causes.discard(cause)
        remaining = [code for code in self._active if code in _MONITORING and self._causes[code]]
        if remaining != self._active:
            self._keep(remaining)
            self._report(0)

    def restart(self, *, power_on: bool) -> None:
        """Reset without a message; errors of the device survive a reset of communication, also in the history."""
        survives = [code for code in self._active if not power_on and self._outlives_reset(code)]
        self._keep(survives)
        past = [code for code in self._history if code in survives]
        self._history.clear()
        self._history.extend(past)
        self._waiting.clear()
        self._inhibit.off()
        self._show()

    def _outlives_reset(self, code: int) -> bool:
        """Return whether an error is not a communication error, or has put the drive into *fault*."""
        causes = self._causes[code]
        if code in _MONITORING and DRIVE in causes:
            # What was monitored is monitored anew after the reset.
            causes.intersection_update({DRIVE})
        return code not in _MONITORING or DRIVE in causes

    def _keep(self, codes: list[int]) -> None:
        self._active = codes
        self._causes = {code: self._causes[code] for code in codes}

    def _show(self) -> None:
        register = 0
        for active in self._active:
            register |= _GENERIC | _REGISTER_BITS.get(active >> 12, 0)
        self._register.value = register
        self.monitored = sum(active in _MONITORING for active in self._active)

    def _report(self, code: int) -> None:
        self._show()
        self._waiting.append(struct.pack("<HB5x", code, self._register.value))
        if self._inhibit.due_ns == NEVER_NS:
            self._next(self._now())

    def _next(self, t_ns: int) -> None:
        """Send the waiting messages, one in each inhibit time."""
        while self._waiting:
            self._send(self._waiting.popleft())
            if self._inhibit_time.value:
                self._inhibit.at(t_ns + self._inhibit_time.value * _TICK_NS)
                return

    def _past(self, number: int) -> int:
        if number > len(self._history):
            raise AccessRefused(AbortCode.NO_DATA)
        return self._history[number - 1]
