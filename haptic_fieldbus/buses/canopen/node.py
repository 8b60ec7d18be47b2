"""One remote node: its object dictionary by SDO, its NMT state by heartbeat, its emergencies.

canopen's SdoClient implements the SDO protocol. Its queue of responses is replaced by a queue that receives from the
wire itself, so that no thread is needed and all waiting is measured on our clock.

Reference: CiA 301 7.2.4 (SDO), 7.2.7 (EMCY), 7.2.8 (NMT, heartbeat).
"""

import queue
from collections import deque
from enum import IntEnum

import canopen
from canopen.sdo.client import SdoClient
from canopen.sdo.constants import ABORT_GENERAL_ERROR, REQUEST_ABORTED

from haptic_fieldbus.buses.canopen.errors import FOREIGN, translate
from haptic_fieldbus.buses.canopen.wire import Wire, frame
from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.cob_ids import (
    EMCY_COB_ID,
    NMT_COB_ID,
    SDO_REQUEST_COB_ID,
    SDO_RESPONSE_COB_ID,
)
from haptic_fieldbus.protocols.canopen.emergency import RESET_CLASS
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID

SDO_TIMEOUT = 0.3
"""[s]."""


class NmtState(IntEnum):
    """NMT state as coded in a heartbeat (CiA 301 7.2.8)."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


NMT_COMMANDS = {NmtState.OPERATIONAL: 0x01, NmtState.STOPPED: 0x02, NmtState.PRE_OPERATIONAL: 0x80}
HEARTBEAT_STATE = 0x7F
"""Mask of the state in a heartbeat; the remaining bit is the toggle bit of node guarding."""


class PumpedResponses(queue.Queue[bytes]):
    """Response queue of an SdoClient; `get` receives from the wire until a response is there or the time is over."""

    def __init__(self, wire: Wire) -> None:
        super().__init__()
        self._wire = wire
        self._responses: deque[bytes] = deque()

    def put(self, item: bytes, block: bool = True, timeout: float | None = None) -> None:
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
        self._wire.send(frame(can_id, bytes(data)))


class Node:
    """A node that the master configures and watches; `label` is its name in messages."""

    def __init__(self, wire: Wire, node_id: int, label: str) -> None:
        self.id = node_id
        self.label = label
        self.state: int | None = None
        """NMT state of the last heartbeat; None before the first, and after each NMT command."""
        self.heartbeat_ns = wire.clock.now_ns()
        self.booted = False
        """True once a boot-up message came; stays so until it is reset before configuration."""
        self.emergency = 0
        """Error code of the last emergency message; 0 when there was none, or an error reset followed."""
        self._wire = wire
        request_id, response_id = SDO_REQUEST_COB_ID + node_id, SDO_RESPONSE_COB_ID + node_id
        client = PumpedSdoClient(request_id, response_id, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        client.network = WireNetwork(wire)
        client.responses = self._responses = PumpedResponses(wire)
        self._client = client
        self.take_answers()
        wire.listen(HEARTBEAT_COB_ID + node_id, self._on_heartbeat)
        wire.listen(EMCY_COB_ID + node_id, self._on_emergency)

    def read(self, entry: ObjectEntry, timeout: float = SDO_TIMEOUT) -> int:
        """Upload one entry within `timeout` [s].

        Raises BusTimeoutError without an answer, BusConfigurationError for a refusal, BusError from the bus.
        """
        self._client.RESPONSE_TIMEOUT = timeout
        try:
            data = self._client.upload(entry.object, entry.subindex)
        except BusError:  # a fault of the wire, already translated; BusTimeoutError is also an OSError, thus FOREIGN
            raise
        except FOREIGN as error:
            raise translate(error, f"{self.label}, reading {entry}") from error
        if len(data) < entry.type.size:
            raise BusConfigurationError(
                f"{self.label}, reading {entry}: {len(data)} octets came, {entry.type.value} was expected"
            )
        return entry.type.unpack(data[: entry.type.size])

    def send(self, entry: ObjectEntry, value: int, timeout: float = SDO_TIMEOUT) -> None:
        """Download one entry within `timeout` [s]; raises the errors of `read`."""
        self._client.RESPONSE_TIMEOUT = timeout
        try:
            self._client.download(entry.object, entry.subindex, entry.type.pack(value))
        except BusError:
            raise
        except FOREIGN as error:
            raise translate(error, f"{self.label}, writing {_shown(value)} to {entry}") from error

    def write(self, entry: ObjectEntry, value: int) -> None:
        """Download one entry and read it back; raises the errors of `read`, BusConfigurationError when it differs."""
        self.send(entry, value)
        held = self.read(entry)
        if held != value:
            raise BusConfigurationError(
                f"{self.label} did not keep {entry}: {_shown(value)} was written, {_shown(held)} is read back"
            )

    def command(self, state: NmtState) -> None:
        """Command an NMT state; only a heartbeat shows that it is reached, see `confirm`. Raises BusError."""
        self._wire.send(frame(NMT_COB_ID, bytes((NMT_COMMANDS[state], self.id))))
        self.state = None  # so that `confirm` takes no heartbeat from before the command

    def confirm(self, state: NmtState, timeout: float) -> None:
        """Wait for a heartbeat that names the state; raises BusTimeoutError after `timeout` [s]."""
        deadline_ns = self._wire.clock.now_ns() + round(timeout * 1e9)
        while self.state != state:
            if not self._wire.pump(deadline_ns):
                said = "none came" if self.state is None else f"the last says {_state_name(self.state)}"
                raise BusTimeoutError(
                    f"{self.label} was told to go {_state_name(state)}, but no heartbeat confirmed it in "
                    f"{exactly(timeout)} s: {said}. A raised error register (1001h) can keep a node from starting"
                )

    def take_answers(self) -> None:
        """Receive the SDO responses of the node from now on; after a release, which takes them for itself."""
        # Every SDO response has 8 octets (CiA 301 7.2.4); SdoClient would fail on a shorter one.
        responses = self._responses
        self._wire.listen(
            SDO_RESPONSE_COB_ID + self.id, lambda data: responses.put(bytes(data)) if len(data) == 8 else None
        )

    def now_ns(self) -> int:
        return self._wire.clock.now_ns()

    def wait(self, duration_ns: int) -> None:
        """Receive frames for this time [ns]."""
        deadline_ns = self.now_ns() + duration_ns
        while self._wire.pump(deadline_ns):
            pass

    def _on_heartbeat(self, data: bytearray) -> None:
        if data:
            self.heartbeat_ns = self._wire.clock.now_ns()
            self.state = data[0] & HEARTBEAT_STATE
            self.booted = self.booted or self.state == NmtState.BOOT_UP

    def _on_emergency(self, data: bytearray) -> None:
        if len(data) >= 2:
            code = data[0] | data[1] << 8
            self.emergency = 0 if code >> 8 == RESET_CLASS else code


def _shown(value: int) -> str:
    return f"{value}" if -10 < value < 10 else f"{value} (0x{value & 0xFFFF_FFFF:X})"


def _state_name(state: int) -> str:
    try:
        return NmtState(state).name.lower().replace("_", "-")
    except ValueError:
        return f"unknown ({state:02X}h)"
