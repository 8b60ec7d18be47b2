"""Translation of exceptions of canopen, python-can and the operating system into errors of this package.

`TABLE` is the only place of this translation on CAN. The first row whose type fits is taken, so a special type stands
above the general types.
"""

import errno
import queue
from collections import Counter
from collections.abc import Callable, Mapping

import can
import canopen
from canopen.emcy import EmcyError
from canopen.lss import LssError
from canopen.nmt import NmtError
from canopen.sdo.exceptions import SdoError

from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError

# The CAN controller of this computer, as its error frames tell it.
#
# The driver sends itself error frames about the state of its controller; nothing of them is on the bus. Bus-off takes
# the torque away. The others do not, because the controller repeats a frame by itself, but they are told at the end of
# a run: who loses feedback learns why.
#
# Reference: linux/can/error.h (CAN_ERR_*), ISO 11898-1 12.1.4 (error passive, bus-off).

BUS_OFF, RESTARTED, STATE, TRANSCEIVER, TX_TIMEOUT = 0x040, 0x100, 0x004, 0x010, 0x001
"""Classes of error frames, as bits of their identifier."""
TOLD = BUS_OFF | RESTARTED | STATE | TRANSCEIVER | TX_TIMEOUT
"""Classes that concern the controller; those of single bits on the wire may come thousands of times a second."""
CLASS_WORDS = {
    BUS_OFF: "bus-off",
    RESTARTED: "restarted after bus-off",
    TRANSCEIVER: "the transceiver reports a fault of the wires",
    TX_TIMEOUT: "a frame could not be sent in time",
}
STATE_WORDS = {
    0x01: "received frames were lost, its buffer was full",
    0x02: "its transmit buffer was full",
    0x04: "many receive errors",
    0x08: "many transmit errors",
    0x10: "error passive by receive errors",
    0x20: "error passive by transmit errors",
}
"""Bits of the second octet of a frame of the class `STATE`."""


class ErrorFrames:
    """The error frames that came."""

    def __init__(self) -> None:
        self.bus_off = False
        """True from the first bus-off on: a controller that restarted has lost frames, and nothing enables again."""
        self._heard: Counter[str] = Counter()

    def hear(self, can_id: int, data: bytes | bytearray) -> None:
        """Note an error frame."""
        self.bus_off = self.bus_off or bool(can_id & BUS_OFF)
        self._heard.update(words for bit, words in CLASS_WORDS.items() if can_id & bit)
        if can_id & STATE and len(data) > 1:
            self._heard.update(words for bit, words in STATE_WORDS.items() if data[1] & bit)

    def sentence(self, bus: str) -> str | None:
        """Return for people what the controller reported; None when it reported nothing."""
        if not self._heard:
            return None
        told = ", ".join(f"{words} {number}×" for words, number in self._heard.items())
        return f"{bus}: CAN controller error: {told}. Check wiring, terminators and bit rate"


def _abort(error: Exception) -> str:
    code = getattr(error, "code", 0)
    meaning = canopen.SdoAbortedError.CODES.get(code, "a code that CiA 301 does not list")
    return f"refused: {meaning} (SDO abort code {code:08X}h)"


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__


def _bus(error: Exception) -> str:
    if is_queue_full(error):
        return (
            "the transmit queue is full (ENOBUFS): is another node on the bus to acknowledge? To lengthen the queue: "
            "ip link set CHANNEL txqueuelen 1000"
        )
    if _number(error) in (errno.ENETDOWN, errno.ENODEV, errno.ENXIO):
        return f"the interface is down or gone: {_said(error)}. See: ip -details link show"
    return _said(error)


TABLE: Mapping[type[Exception], tuple[type[BusError], Callable[[Exception], str]]] = {
    canopen.SdoAbortedError: (BusConfigurationError, _abort),
    canopen.SdoCommunicationError: (BusConfigurationError, lambda error: f"wrong answer: {error}"),
    SdoError: (BusConfigurationError, _said),
    NmtError: (BusConfigurationError, _said),
    LssError: (BusConfigurationError, _said),
    EmcyError: (BusError, _said),
    canopen.ObjectDictionaryError: (BusConfigurationError, _said),
    can.CanTimeoutError: (BusTimeoutError, _bus),
    can.CanError: (BusError, _bus),
    OSError: (BusError, _bus),
}
"""Foreign exception type → our error type, and the text made from the exception."""
FOREIGN = tuple(TABLE)


def translate(error: Exception, subject: str) -> BusError:
    """Return our error for a foreign exception; `subject` names the node and object, or the bus, in its text.

    An exception that no row fits is raised again unchanged: a mistake in our own code must not look like a bus fault.
    """
    # canopen raises the same type for silence and for a wrong answer; only the cause of a timeout is an empty queue.
    if isinstance(error, canopen.SdoCommunicationError) and isinstance(error.__context__, queue.Empty):
        return BusTimeoutError(f"{subject}: no answer")
    for foreign, (ours, words) in TABLE.items():
        if isinstance(error, foreign):
            return ours(f"{subject}: {words(error)}")
    raise error


def is_queue_full(error: Exception) -> bool:
    """Return True when a frame was refused because earlier frames still wait in the transmit queue."""
    # python-can's socketcan raises "Transmit buffer full" without an error number.
    return _number(error) == errno.ENOBUFS or "buffer full" in str(error)


def _number(error: Exception) -> int | None:
    number = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return number if isinstance(number, int) else None
