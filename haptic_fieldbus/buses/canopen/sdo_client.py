"""The SDO client of canopen, without its thread.

canopen's SdoClient implements the SDO protocol. Its queue of responses is replaced by a queue that receives from the
wire itself, so that no thread is needed and all waiting is measured on our clock.

Reference: CiA 301 7.2.4.3 (SDO protocols).
"""

import queue
from collections import deque

import canopen
from canopen.sdo.client import SdoClient
from canopen.sdo.constants import ABORT_GENERAL_ERROR, REQUEST_ABORTED

from haptic_fieldbus.buses.canopen.expedited import ABORTED, DOWNLOAD_DONE, UPLOAD_DONE, address
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.drive.objects import ObjectEntry

NAMING = (UPLOAD_DONE, DOWNLOAD_DONE, ABORTED)
"""Specifiers of the SDO responses that name their entry."""


class PumpedResponses(queue.Queue[bytes]):
    """Response queue of an SdoClient; `get` receives from the wire until a response is there or the time is over."""

    def __init__(self, wire: Wire) -> None:
        super().__init__()
        self._wire = wire
        self._responses: deque[bytes] = deque()
        self.entry: ObjectEntry | None = None
        """What is asked for at present."""

    def put(self, item: bytes, block: bool = True, timeout: float | None = None) -> None:
        """Take a response; one to an earlier request, which came too late for it, names another entry."""
        named = item[0] >> 5 in NAMING and any(item[1:4])
        if self.entry is None or not named or item[1:4] == address(self.entry):
            self._responses.append(item)

    def empty(self) -> bool:
        """Drop responses to earlier requests, and return True.

        SdoClient calls this before each request, and replaces a queue that is not empty by an ordinary one.
        """
        self._responses.clear()
        return True

    def get(self, block: bool = True, timeout: float | None = None) -> bytes:
        deadline_ns = self._wire.clock.now_ns() + round((timeout or 0.0) * 1e9)
        while not self._responses:
            if not self._wire.pump(deadline_ns):
                raise queue.Empty
        return self._responses.popleft()


class PumpedSdoClient(SdoClient):
    """SdoClient that aborts without a log entry, since an exception with the same message follows."""

    def abort(self, abort_code: int = ABORT_GENERAL_ERROR) -> None:
        self.send_request(bytes((REQUEST_ABORTED, 0, 0, 0)) + abort_code.to_bytes(4, "little"))  # type: ignore[no-untyped-call]


class WireNetwork(canopen.Network):
    """The network that SdoClient sends through: our wire."""

    def __init__(self, wire: Wire) -> None:
        super().__init__()
        self._wire = wire

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._wire.send(can_id, bytes(data))
