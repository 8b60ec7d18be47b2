"""One remote node: its object dictionary by SDO, its NMT state by heartbeat or node guarding, its emergencies.

Answers to node guarding alternate in their toggle bit. One that repeats the bit of the answer before is handled as if
it had not been received, so that a node which repeats itself shows no sign of life.

Reference: CiA 301 7.2.4 (SDO), 7.2.7 (EMCY), 7.2.8 (NMT, 7.2.8.3.2.1 node guarding, 7.2.8.3.2.2 heartbeat).
"""

import queue
from collections import deque
from collections.abc import Iterator, Set
from contextlib import contextmanager
from enum import IntEnum

import canopen
from canopen.sdo.client import SdoClient
from canopen.sdo.constants import ABORT_GENERAL_ERROR, REQUEST_ABORTED

from haptic_fieldbus.buses.canopen.errors import FOREIGN, translate
from haptic_fieldbus.buses.canopen.frames import REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import Received, Wire
from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.bus import EMCY_COB_ID, NMT_COB_ID, SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID
from haptic_fieldbus.protocols.canopen.emergency import RESET_CLASS, emergency_meaning
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID, SYNC_COB_ID
from haptic_fieldbus.signals import LinkFlag

# Expedited SDO requests as octets, for where an answer is not waited for.
#
# Reference: CiA 301 7.2.4.3.3 to 7.2.4.3.6.

DOWNLOAD_DONE, UPLOAD_DONE, ABORTED = 3, 2, 4
"""Specifiers of an SDO response, in the highest three bits of its first octet."""
EXPEDITED = 0x02
"""Bit in the first octet of an upload response: the value is in it."""


def request(entry: ObjectEntry, value: int | None) -> bytes:
    """Return the SDO request that downloads `value`, expedited, or uploads the entry when it is None."""
    if value is None:
        return bytes((0x40,)) + address(entry) + bytes(4)
    data = entry.type.pack(value)
    # Expedited, with its size: bits 2 and 3 count the octets that are not used.
    return bytes((0x23 | (4 - len(data)) << 2,)) + address(entry) + data.ljust(4, b"\0")


def address(entry: ObjectEntry) -> bytes:
    """Return index and sub-index as they stand in requests and responses."""
    return entry.object.to_bytes(2, "little") + bytes((entry.subindex,))


def uploaded_value(response: bytes | bytearray) -> bytes | bytearray | None:
    """Return the octets of the value in an upload response; None for one that is not expedited, and for another."""
    return response[4:8] if response[0] >> 5 == UPLOAD_DONE and response[0] & EXPEDITED else None


# The SDO client of canopen, without its thread.
#
# canopen's SdoClient implements the SDO protocol. Its queue of responses is replaced by a queue that receives from the
# wire itself, so that no thread is needed and all waiting is measured on our clock.
#
# Reference: CiA 301 7.2.4.3 (SDO protocols).

NAMING = (UPLOAD_DONE, DOWNLOAD_DONE, ABORTED)
"""Specifiers of the SDO responses that name their entry."""


class PumpedResponses(queue.Queue[bytes]):
    """Response queue of an SdoClient; `get` receives from the wire until a response is there or the time is over."""

    def __init__(self, wire: Wire) -> None:
        super().__init__()
        self._wire = wire
        self._responses: deque[bytes] = deque()
        self.entry: ObjectEntry | None = None
        """Entry of the current request; None when there is none."""

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
        self._wire.pump_until(deadline_ns, lambda: bool(self._responses))
        if not self._responses:
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


SDO_TIMEOUT = 0.3
"""[s]."""


class NmtState(IntEnum):
    """NMT state as coded in a heartbeat (CiA 301 7.2.8)."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


NMT_COMMANDS = {NmtState.OPERATIONAL: 0x01, NmtState.STOPPED: 0x02, NmtState.PRE_OPERATIONAL: 0x80}
HEARTBEAT_STATE, TOGGLE = 0x7F, 0x80
"""Masks of the state in a heartbeat, and of the toggle bit in an answer to node guarding."""
REPEATED = (
    "{0.label} repeated the toggle bit in {0.repeated} node guarding answers; these do not count: answers were lost, "
    "or the node repeats itself"
)
GUARDING_NS = 10_000_000
"""Time between two requests of node guarding, while an NMT state is waited for."""
ABSENT = (0x0602_0000, 0x0609_0011)
"""SDO abort codes: object, or sub-index, does not exist."""
WRITE_ONLY, READ_ONLY = 0x0601_0001, 0x0601_0002
"""SDO abort codes: attempt to read an object that can only be written, and to write one that can only be read."""


class Node:
    """A node that the master configures and watches; `label` is its name in messages.

    A `guarded` node is asked for its NMT state by node guarding; its answers count as heartbeats.
    """

    def __init__(self, wire: Wire, node_id: int, label: str, *, guarded: bool = False) -> None:
        self.id = node_id
        self.label = label
        self.guarded = guarded
        self.guarding_request: Received = REMOTE_FLAG | HEARTBEAT_COB_ID + node_id, bytes(1)
        self.repeated = 0
        """Number of answers to node guarding that repeated the toggle bit of the answer before."""
        self.state: int | None = None
        """NMT state of the last heartbeat; None before the first, and after each NMT command."""
        self.heartbeat_ns = wire.clock.now_ns()
        self.booted = False
        """True once a boot-up message came; stays so until it is reset before configuration."""
        self.emergency = 0
        """Error code of the first emergency message; 0 when there was none, or an error reset followed.

        One that is reset between two looks stays until the second, so that none passes unseen: `look_at_emergency`.
        """
        self._emergency_seen = self._emergency_over = False
        self._first_emergency = 0
        """Of those since the node was told to go operational; after another command they may be our own doing."""
        self._operating = False
        self._wire = wire
        self._toggle: int | None = None
        request_id, response_id = SDO_REQUEST_COB_ID + node_id, SDO_RESPONSE_COB_ID + node_id
        client = PumpedSdoClient(request_id, response_id, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        client.network = WireNetwork(wire)
        client.responses = self._responses = PumpedResponses(wire)
        self._client = client
        self.take_answers()
        wire.listen(HEARTBEAT_COB_ID + node_id, self._on_heartbeat)
        wire.listen(EMCY_COB_ID + node_id, self._on_emergency)

    def on_response(self, data: bytes | bytearray) -> None:
        """Take the SDO response to the open request."""
        if len(data) == 8:  # as every SDO response has (CiA 301 7.2.4); SdoClient would fail on a shorter one
            self._responses.put(bytes(data))

    def optional(self, entry: ObjectEntry) -> int | None:
        """Upload one entry; None when the node lacks it. Raises the errors of `read`."""
        try:
            return self.read(entry)
        except BusConfigurationError as error:
            if getattr(error.__cause__, "code", None) in ABSENT:
                return None
            raise

    def read(self, entry: ObjectEntry, timeout: float = SDO_TIMEOUT) -> int:
        """Upload one entry within `timeout` [s].

        Raises BusTimeoutError without an answer, BusConfigurationError for a refusal, BusError from the bus.
        """
        data = self._upload(entry, timeout)
        if len(data) < entry.type.size:
            wrong = f"received {len(data)} octets, expected {entry.type.value}"
            raise BusConfigurationError(f"{self.label}, reading {entry}: {wrong}")
        return entry.type.unpack(data[: entry.type.size])

    def found(self, index: int, subindex: int) -> bytes | None:
        """Upload an entry of any size: None when the node lacks it, empty when it can only be written.

        Raises the errors of `read`.
        """
        try:
            return self._upload(ObjectEntry(index, DataType.UINT8, subindex), SDO_TIMEOUT)
        except BusConfigurationError as error:
            code = getattr(error.__cause__, "code", None)
            if code in (*ABSENT, WRITE_ONLY):
                return b"" if code == WRITE_ONLY else None
            raise

    def text(self, index: int) -> str:
        """Upload an object that is a text; raises the errors of `read`."""
        data = self._upload(ObjectEntry(index, DataType.UINT8), SDO_TIMEOUT)
        return data.split(b"\0")[0].decode("ascii", "replace").strip()

    def _upload(self, entry: ObjectEntry, timeout: float) -> bytes:
        with self._requested(entry, timeout, f"reading {entry}") as client:
            return bytes(client.upload(entry.object, entry.subindex))

    def send(self, entry: ObjectEntry, value: int, timeout: float = SDO_TIMEOUT) -> None:
        """Download one entry within `timeout` [s]; raises the errors of `read`."""
        with self._requested(entry, timeout, f"writing {_shown(value)} to {entry}") as client:
            client.download(entry.object, entry.subindex, entry.type.pack(value))

    @contextmanager
    def _requested(self, entry: ObjectEntry, timeout: float, purpose: str) -> Iterator[SdoClient]:
        """Translate the errors of a request. If no answer came, events before it are the explanation."""
        self._client.RESPONSE_TIMEOUT, self._responses.entry = timeout, entry
        try:
            yield self._client
        except BusError:  # a fault of the wire, already translated; BusTimeoutError is also an OSError, thus FOREIGN
            raise
        except FOREIGN as error:
            ours, code = translate(error, f"{self.label}, {purpose}"), self.emergency
            said = {
                "the CAN controller went bus-off": self._wire.error_frames.bus_off,
                f"it sent emergency {code:04X}h ({emergency_meaning(code)})": code,
                "it restarted": self.booted,
            }
            reasons = [words for words, came in said.items() if came]
            if reasons and isinstance(ours, BusTimeoutError):
                ours = BusTimeoutError(f"{ours}. Before that, {', and '.join(reasons)}")
            raise ours from error

    def write(self, entry: ObjectEntry, value: int) -> None:
        """Download one entry and read it back; raises the errors of `read`, BusConfigurationError when it differs."""
        self.send(entry, value)
        held = self.read(entry)
        if held != value:
            differs = f"wrote {_shown(value)}, read back {_shown(held)}"
            raise BusConfigurationError(f"{self.label} did not keep {entry}: {differs}")

    def command(self, state: NmtState) -> None:
        """Command an NMT state; only a heartbeat shows that it is reached, see `confirm`. Raises BusError."""
        self._wire.send(NMT_COB_ID, bytes((NMT_COMMANDS[state], self.id)))
        self._operating = state is NmtState.OPERATIONAL
        if self._operating:
            self._first_emergency = 0
        self.state = None  # so that `confirm` takes no heartbeat from before the command

    def confirm(self, state: NmtState, timeout: float) -> None:
        """Wait for a heartbeat, or an answer to node guarding, that names the state.

        Raises BusTimeoutError after `timeout` [s].
        """
        deadline_ns = self.now_ns() + round(timeout * 1e9)
        while self.state != state and self.now_ns() < deadline_ns:
            if self.guarded:
                self._wire.send(*self.guarding_request)
            until_ns = min(self.now_ns() + GUARDING_NS, deadline_ns) if self.guarded else deadline_ns
            self._wire.pump_until(until_ns, lambda: self.state == state)
        if self.state != state:
            said = "none came" if self.state is None else f"the last one reports {nmt_state_name(self.state)}"
            sign = "answer to node guarding" if self.guarded else "heartbeat"
            raise BusTimeoutError(
                f"{self.label} did not confirm {nmt_state_name(state)} within {exactly(timeout)} s (no {sign}): "
                f"{said}. A raised error register (1001h) can keep a node from starting"
            )

    def ask_state(self) -> None:
        """Ask for the NMT state by node guarding, once; raises BusError."""
        self._wire.send(*self.guarding_request)

    def wait_for_state(self, duration_ns: int) -> None:
        """Receive until the node tells its NMT state, this time [ns] at most."""
        self._wire.pump_until(self.now_ns() + duration_ns, lambda: self.state is not None)

    def take_answers(self) -> None:
        """Receive the SDO responses of the node from now on; after a release, which takes them for itself."""
        self._wire.listen(SDO_RESPONSE_COB_ID + self.id, self.on_response)

    def now_ns(self) -> int:
        return self._wire.clock.now_ns()

    def wait(self, duration_ns: int) -> None:
        """Receive frames for this time [ns]."""
        self._wire.pump_until(self.now_ns() + duration_ns)

    def answer_ns(self, cob_ids: Set[int], most_ns: int) -> int:
        """Send one SYNC, and return how long the last of these TPDOs took [ns]; 0 if one took longer than `most_ns`.

        Raises BusError.
        """
        took_ns: dict[int, int] = {}

        def note(can_id: int, _: bytes | bytearray) -> None:
            if can_id in cob_ids:
                took_ns.setdefault(can_id, self._wire.taken_ns - begin_ns)

        begin_ns = self.now_ns()
        self._wire.send(SYNC_COB_ID)
        with self._wire.overhear(note):
            self._wire.pump_until(begin_ns + most_ns, lambda: len(took_ns) == len(cob_ids))
        return max(took_ns.values(), default=0) if len(took_ns) == len(cob_ids) else 0

    def _on_heartbeat(self, data: bytes | bytearray) -> None:
        if not data or (self.guarded and self._repeats(data[0])):
            return
        self.heartbeat_ns = self._wire.arrived_ns
        self.state = data[0] & HEARTBEAT_STATE
        self.booted = self.booted or self.state == NmtState.BOOT_UP

    def _repeats(self, answer: int) -> bool:
        """Return True for an answer to node guarding with the toggle bit of the one before; note its toggle bit."""
        if answer & HEARTBEAT_STATE == NmtState.BOOT_UP:
            self._toggle = TOGGLE  # the first answer after a boot-up has 0
            return False
        before, self._toggle = self._toggle, answer & TOGGLE
        if self._toggle != before:
            return False
        self.repeated += 1
        return True

    def _on_emergency(self, data: bytes | bytearray) -> None:
        if len(data) < 2:
            return
        code = data[0] | data[1] << 8
        self._emergency_over = code >> 8 == RESET_CLASS
        if self._emergency_over:
            self.emergency = 0 if self._emergency_seen else self.emergency
            return
        self._emergency_seen = self._emergency_seen and self.emergency != 0
        self.emergency = self.emergency or code
        if self._operating:
            self._first_emergency = self._first_emergency or code

    def look_at_emergency(self) -> int:
        """Return `emergency`, and forget it from then on when an error reset has followed."""
        seen, self._emergency_seen = self.emergency, True
        if self._emergency_over:
            self.emergency = 0
        return seen

    @property
    def cause(self) -> tuple[LinkFlag, int] | None:
        """Event since the node went operational that explains a silence or a fault, with its code."""
        if self._first_emergency:
            return LinkFlag.EMERGENCY, self._first_emergency
        return (LinkFlag.BOOT_UP, 0) if self.booted else None


def _shown(value: int) -> str:
    return f"{value}" if -10 < value < 10 else f"{value} (0x{value & 0xFFFF_FFFF:X})"


def nmt_state_name(state: int) -> str:
    """Return an NMT state in words."""
    try:
        return NmtState(state).name.lower().replace("_", "-")
    except ValueError:
        return f"unknown ({state:02X}h)"
