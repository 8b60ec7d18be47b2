"""Translation of exceptions of canopen, python-can and the operating system into errors of this package.

`TABLE` is the only place of this translation on CAN. The first row whose type fits is taken, so a special type stands
above the general types.
"""

import errno
import queue
from collections.abc import Callable
from dataclasses import dataclass

import can
import canopen
from canopen.emcy import EmcyError
from canopen.lss import LssError
from canopen.nmt import NmtError
from canopen.sdo.exceptions import SdoError

from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError


@dataclass(frozen=True)
class Translation:
    """A row of the table: a foreign exception type, our error type, and the text made from the exception."""

    foreign: type[Exception]
    ours: type[BusError]
    words: Callable[[Exception], str]


def _abort(error: Exception) -> str:
    code = getattr(error, "code", 0)
    meaning = canopen.SdoAbortedError.CODES.get(code, "a code that CiA 301 does not list")
    return f"refused: {meaning} (SDO abort code {code:08X}h)"


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__


def _bus(error: Exception) -> str:
    if is_queue_full(error):
        return (
            "the transmit queue is full (ENOBUFS): is another node there to acknowledge? "
            "A longer queue: ip link set CHANNEL txqueuelen 1000"
        )
    if _number(error) in (errno.ENETDOWN, errno.ENODEV, errno.ENXIO):
        return f"the interface is down or gone: {_said(error)}. See: ip -details link show"
    return _said(error)


TABLE = (
    Translation(canopen.SdoAbortedError, BusConfigurationError, _abort),
    Translation(canopen.SdoCommunicationError, BusConfigurationError, lambda error: f"answered wrongly: {error}"),
    Translation(SdoError, BusConfigurationError, _said),
    Translation(NmtError, BusConfigurationError, _said),
    Translation(LssError, BusConfigurationError, _said),
    Translation(EmcyError, BusError, _said),
    Translation(canopen.ObjectDictionaryError, BusConfigurationError, _said),
    Translation(can.CanTimeoutError, BusTimeoutError, _bus),
    Translation(can.CanInitializationError, BusError, _bus),
    Translation(can.CanInterfaceNotImplementedError, BusError, _bus),
    Translation(can.CanError, BusError, _bus),
    Translation(OSError, BusError, _bus),
)
FOREIGN = tuple(row.foreign for row in TABLE)


def translate(error: Exception, subject: str) -> BusError:
    """Return our error for a foreign exception; `subject` names the node and object, or the bus, in its text.

    An exception that no row fits is raised again unchanged: a mistake in our own code must not look like a bus fault.
    """
    # canopen raises the same type for silence and for a wrong answer; only the cause of a timeout is an empty queue.
    if isinstance(error, canopen.SdoCommunicationError) and isinstance(error.__context__, queue.Empty):
        return BusTimeoutError(f"{subject}: no answer")
    for row in TABLE:
        if isinstance(error, row.foreign):
            return row.ours(f"{subject}: {row.words(error)}")
    raise error


def is_queue_full(error: Exception) -> bool:
    """Return True when a frame was refused because earlier frames still wait in the transmit queue."""
    # python-can's socketcan raises "Transmit buffer full" without an error number.
    return _number(error) == errno.ENOBUFS or "buffer full" in str(error)


def _number(error: Exception) -> int | None:
    number = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    return number if isinstance(number, int) else None
