"""One CAN bus, used in the calling thread: sending, receiving, and a handler for each identifier.

There is no Notifier and no thread. A caller that waits for a frame receives by `pump`. All waiting is measured on the
clock that was handed in, so that virtual time stays deterministic. Configuration and loop share this path.
"""

import errno
import select
import socket
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from struct import Struct, pack
from typing import Protocol
from uuid import uuid4

import can

try:
    from fcntl import ioctl
except ImportError:  # Windows: its frames have no stamps
    ioctl = None  # type: ignore[assignment]

from haptic_fieldbus.buses.canopen.errors import FOREIGN, TOLD, ErrorFrames, is_queue_full, translate
from haptic_fieldbus.buses.canopen.frames import (
    CAN_ID_MASK,
    ERROR_FLAG,
    EXTENDED_FLAG,
    REMOTE_FLAG,
    FrameLog,
    frame_bits,
)
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError

# A port to one CAN bus: frames as CAN-ID and data, over any interface of python-can.
#
# A CAN-ID holds the identifier, and the flags of linux/can.h for extended, remote and error frames, so that no handler
# of a data frame ever gets one of those. The data of a remote frame is as many octets as it asks for.
#
# Our own frames, when an interface gives them back, come as `OURS`. Most interfaces mark them (`is_rx`). On SocketCAN
# `is_rx` says another thing, that a frame comes from a process of this computer, and UDP multicast marks nothing; there
# `SocketCanPort` and `MulticastPort` take the place of this one.

Received = tuple[int, bytes | bytearray]
"""CAN-ID with its flags, and data."""
OURS: Received = (0, b"")
"""Placeholder for a frame of our own; compared by identity."""


class CanPort(Protocol):
    """Sends and receives in the calling thread. Each method may raise what python-can or the system raises."""

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        """Send a frame, or raise; it never waits for room in the transmit queue."""

    def receive(self, seconds: float) -> Received | None:
        """Return a frame, after waiting this long [s] at most; None when none came."""

    def arrived_ns(self, earliest_ns: int) -> int | None:
        """Return the instant on our clock at which the last frame arrived, `earliest_ns` or later; None if unknown."""

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        """Let only frames with these CAN-IDs, and error frames that matter, wake us; None: all frames.

        `frames` is the number that we send each period; old ones beyond a few periods are refused, not queued.
        """


class PythonCanPort:
    """Any interface of python-can that marks our own frames when it gives them back."""

    def __init__(self, can_bus: can.BusABC) -> None:
        self._bus = can_bus

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        remote = bool(can_id & REMOTE_FLAG)
        message = can.Message(
            arbitration_id=can_id & CAN_ID_MASK,
            data=None if remote else data,
            dlc=len(data),
            is_remote_frame=remote,
            is_extended_id=bool(can_id & EXTENDED_FLAG),
        )
        self._bus.send(message)

    def receive(self, seconds: float) -> Received | None:
        message = self._bus.recv(seconds)
        if message is None:
            return None
        if not message.is_rx:
            return OURS
        if not (message.is_extended_id or message.is_remote_frame or message.is_error_frame):
            return message.arbitration_id, message.data
        data = bytes(message.dlc) if message.is_remote_frame else message.data
        return message.arbitration_id | _flags(message), data

    def arrived_ns(self, earliest_ns: int) -> int | None:
        """Return None: the time stamps of interfaces come from many clocks."""
        return None

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        """Do nothing: python-can's own filter would cost more than the look-up of a handler."""


def _flags(message: can.Message) -> int:
    return (
        (EXTENDED_FLAG if message.is_extended_id else 0)
        | (REMOTE_FLAG if message.is_remote_frame else 0)
        | (ERROR_FLAG if message.is_error_frame else 0)
    )


# The socket of a SocketCAN interface, used without python-can's messages in between.
#
# python-can opens and closes the socket. A frame is 16 octets in both directions (`struct can_frame` of linux/can.h):
# CAN-ID with its flags, length, three octets of padding, eight octets of data. A frame costs one system call to send,
# and two to wait for and receive. (`recvmsg` of Python costs one more: it asks for the name of the interface.)
#
# - *Filters.* In the loop the kernel wakes us for frames that have a handler, and for the error frames that tell the
#   state of the controller. A bus full of frames for others costs nothing then.
# - *Latest value wins.* The kernel queues frames while the bus is busy, up to the length of its transmit queue. What
#   waits there is old when it goes out. Therefore room for a few periods of our frames is all that our socket asks for;
#   beyond that a frame is refused, and the next period sends a newer one.
# - *Time stamps.* The kernel stamps a frame as it arrives, by CLOCK_REALTIME, which may be set at any time. The stamp
#   is asked for where somebody wants to know it. It becomes an age by that clock, and the age an instant on ours; it
#   must lie between the moment at which the socket was last seen empty and now, else one of these is taken.
#
# Reference: Linux, Documentation/networking/can.rst, sections "RAW protocol sockets" and "Timestamps".

FRAME = Struct("=IB3x8s")
"""`struct can_frame`."""
EXACTLY = EXTENDED_FLAG | REMOTE_FLAG | 0x7FF
"""Mask of a filter that takes one CAN-ID of 11 bits, flags included."""
TIMESPEC = Struct("@ll")
MOST_FILTERS = 512
"""Number that the kernel takes (CAN_RAW_FILTER_MAX)."""
SO_TIMESTAMPNS, SIOCGSTAMPNS = 35, 0x8907
"""Option that sends a stamp along with each frame, and the request for that of the last frame (asm-generic)."""
QUEUED_PERIODS = 4
"""Periods whose frames may wait in the transmit queue. Slow adapters confirm a frame some milliseconds after it."""
FRAME_COST = 768
"""Octets that the kernel charges to the send buffer for a waiting frame; the kernel doubles the requested size."""
CAN_RAW_ERR_FILTER, ALL_ERRORS = 2, 0x1FFF_FFFF
"""Option of the socket (linux/can/raw.h), which Python does not name, and its value for all error frames."""


def is_socketcan(can_bus: can.BusABC) -> bool:
    """Whether a bus of python-can is one SocketCAN interface, whose socket can be used."""
    family = getattr(getattr(can_bus, "socket", None), "family", None)
    return family is not None and family == getattr(socket, "AF_CAN", None) and bool(getattr(can_bus, "channel", ""))


class SocketCanPort:
    """A port on an open socket, which stays the property of its python-can bus."""

    def __init__(self, opened: socket.socket, clock: Clock) -> None:
        self._socket, self._clock = opened, clock
        self._send, self._receive = opened.send, opened.recv_into
        self._files, self._select = (opened.fileno(),), select.select  # a socket would be asked for its number
        self._buffer = bytearray(FRAME.size + 1)  # no frame of CAN 2.0 fills it
        self._at_once = int(socket.MSG_DONTWAIT)  # a flag of `socket` makes a new one with each operation
        with suppress(OSError):
            opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 0)  # what is sent along is not kept to be asked for
        self.arrived_ns(0)  # the first request makes the kernel stamp what comes later

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        try:
            self._send(FRAME.pack(can_id, len(data), data), self._at_once)
        except BlockingIOError as full:  # our part of the queue is full, see `focus`
            raise OSError(errno.ENOBUFS, "our share of the transmit queue is full") from full

    def receive(self, seconds: float) -> Received | None:
        if seconds > 0.0 and not self._select(self._files, (), (), seconds)[0]:
            return None
        try:
            return self._decoded(self._receive(self._buffer, 0, self._at_once))
        except BlockingIOError:
            return None

    def _decoded(self, size: int) -> Received:
        """Return the frame in the first octets of the buffer, `OURS` for one that is none of CAN 2.0."""
        if size != FRAME.size:
            return OURS
        can_id, length, data = FRAME.unpack_from(self._buffer)
        return can_id, data if length == len(data) else data[:length]  # of a remote frame, zeros

    def arrived_ns(self, earliest_ns: int) -> int | None:
        try:
            seconds, nanoseconds = TIMESPEC.unpack(ioctl(self._socket, SIOCGSTAMPNS, bytes(TIMESPEC.size)))
        except (OSError, TypeError):  # no frame was stamped yet; or a system without stamps
            return None
        age_ns: int = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
        now_ns = self._clock.now_ns()
        return min(now_ns, max(now_ns - age_ns, earliest_ns))

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        if can_ids is None or len(can_ids) > MOST_FILTERS:
            self._filter(pack("=II", 0, 0), ALL_ERRORS)
            return
        wanted = sorted(can_id for can_id in can_ids if not can_id & EXTENDED_FLAG)
        self._filter(b"".join(pack("=II", can_id, EXACTLY) for can_id in wanted), TOLD)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, QUEUED_PERIODS * frames * FRAME_COST // 2)

    def _filter(self, filters: bytes, errors: int) -> None:
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        self._socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors)


# The socket of python-can's UDP multicast, used without its messages: a datagram is a map of msgpack.
#
# A group member hears itself, and nothing but the datagram tells whose it is: all sockets of a computer send from the
# port of the group. A datagram has the channel of a frame, which means nothing there; ours is a mark, and stands first,
# so that on Linux a filter of the kernel drops what has it before we are woken. To count what was sent would not do,
# because a lost echo would excuse the same frame of somebody else.
#
# Reference: Linux, Documentation/networking/filter.rst.

LARGEST_DATAGRAM = 4096
MALFORMED = "received a datagram that is no CAN frame"
FLAGS = {"is_extended_id": EXTENDED_FLAG, "is_remote_frame": REMOTE_FLAG, "is_error_frame": ERROR_FLAG}
"""Flags of a CAN-ID by their fields in a frame of python-can."""
OTHER_FIELDS = ("timestamp", "is_fd", "bitrate_switch", "error_state_indicator")
MAP = bytes((0x80 | len(FLAGS) + len(OTHER_FIELDS) + len(("channel", "arbitration_id", "dlc", "data")),))
"""Head of a map with all fields."""
FIELDS = Struct(">I4sB6sB")
"""Changing end of a datagram: identifier, name and value of `dlc`, name of `data` with its kind, and its length."""
MARK_AT = 18
"""Place of the mark: behind the heads of UDP (8 octets), the map and the text, and the name of the field."""
LOAD, IF_EQUAL, RETURN = 0x20, 0x15, 0x06
"""Codes of a filter: load a word, compare it with a constant, return the number of octets that pass."""
SO_ATTACH_FILTER = 26


class MulticastPort(SocketCanPort):
    """A port on the socket of an open UDP multicast bus of python-can."""

    def __init__(self, can_bus: can.BusABC, clock: Clock) -> None:
        import msgpack

        multicast = can_bus._multicast  # type: ignore[attr-defined]
        super().__init__(multicast._socket, clock)
        self._buffer = bytearray(LARGEST_DATAGRAM + 1)
        self._to: tuple[str, int] = multicast._send_destination
        self._unpack = msgpack.unpackb
        mark = uuid4().hex[:8]
        fields = {"channel": mark} | dict.fromkeys(OTHER_FIELDS, 0)
        heads = [fields | {name: bool(bits << 29 & flag) for name, flag in FLAGS.items()} for bits in range(8)]
        self._heads = [MAP + msgpack.packb(head)[1:] + msgpack.packb("arbitration_id") + b"\xce" for head in heads]
        """Begin of a datagram up to its identifier, by the three flags of its CAN-ID."""
        self._own = self._heads[0][:MARK_AT]
        with suppress(OSError):  # another system than Linux
            self._drop(mark.encode())

    def _drop(self, mark: bytes) -> None:
        """Let the kernel drop datagrams with this mark; raises OSError."""
        first, second = (int.from_bytes(part, "big") for part in (mark[:4], mark[4:]))
        steps = (
            (LOAD, 0, 0, MARK_AT), (IF_EQUAL, 0, 2, first), (LOAD, 0, 0, MARK_AT + 4), (IF_EQUAL, 1, 0, second),
            (RETURN, 0, 0, LARGEST_DATAGRAM), (RETURN, 0, 0, 0),
        )  # fmt: skip
        program = array("B", b"".join(pack("=HBBI", *step) for step in steps))
        self._socket.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, pack("@HP", len(steps), program.buffer_info()[0]))

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        size = len(data)
        if can_id & REMOTE_FLAG:
            data = b""
        fields = FIELDS.pack(can_id & CAN_ID_MASK, b"\xa3dlc", size, b"\xa4data\xc4", len(data))
        self._socket.sendto(self._heads[can_id >> 29] + fields + data, self._to)

    def _decoded(self, size: int) -> Received:
        octets = self._buffer[:size]
        if size > LARGEST_DATAGRAM or octets.startswith(self._own):
            return OURS
        try:
            fields = self._unpack(octets)
            can_id, data = fields["arbitration_id"] & CAN_ID_MASK, fields["data"]
            for name, flag in FLAGS.items():
                if fields[name]:
                    can_id |= flag
            if can_id & REMOTE_FLAG:
                data = bytes(min(8, fields["dlc"]))
            if isinstance(data, bytes):
                return can_id, data
        except (KeyError, TypeError, ValueError) as fault:
            raise can.CanOperationError(MALFORMED) from fault
        raise can.CanOperationError(MALFORMED)

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        """Do nothing: the kernel knows datagrams, not the frames in them."""


MOST_WAITING = 100
"""Largest number of frames that are received after a deadline, because they may have waited."""
Handler = Callable[[bytes | bytearray], None]
Tap = Callable[[int, bytes | bytearray], None]
"""Function that is called with the CAN-ID, flags included, and the data of every frame that comes."""


class Wire:
    """A python-can bus with a handler for each CAN-ID, flags included; `name` is its name in messages.

    Our own frames, when an interface gives them back, reach neither handlers nor log.
    """

    def __init__(
        self, can_bus: can.BusABC, clock: Clock, name: str, log: FrameLog | None = None, *, port: CanPort | None = None
    ) -> None:
        self.clock = clock
        self.name = name
        self.error_frames = ErrorFrames()
        self.foreign_bits = 0
        """Bits of the frames that came and that nobody listens to: those of other devices."""
        self.refusal: BusError | None = None
        """Error of the last frame that the full transmit queue refused; None when there was none."""
        # Bound methods are looked up once: the loop calls them for every frame.
        self._port = port or port_to(can_bus, clock)
        self._send, self._receive = self._port.send, self._port.receive
        self._now_ns = clock.now_ns
        self._empty_ns = self._logged_ns = 0
        self._log = log
        self._handlers: dict[int, Handler] = {}

    def listen(self, can_id: int, handler: Handler) -> None:
        """Hand all frames with this CAN-ID to `handler`, which replaces an earlier one."""
        self._handlers[can_id] = handler

    @contextmanager
    def overhear(self, tap: Tap) -> Iterator[None]:
        """Call `tap` with every frame that comes meanwhile; nothing may be sent."""
        log = self._log

        def both(t_ns: int, can_id: int, data: bytes | bytearray) -> None:
            tap(can_id, data)
            if log is not None:
                log(t_ns, can_id, data)

        self._log = both
        try:
            yield
        finally:
            # A log that raised meanwhile is used no more.
            self._log = None if self._log is None else log

    def focus(self, frames: int) -> None:
        """Be woken only by frames that have a handler, unless all are recorded; raises BusError.

        `frames` is the number of frames that we send each period at most: SYNC, set-points, proofs of life, questions.
        A handler that is added later hears nothing.
        """
        self._set_filter(None if self._log is not None else frozenset(self._handlers), frames)

    def unfocus(self) -> None:
        """Be woken by all frames; raises BusError."""
        self._set_filter(None, 0)

    def _set_filter(self, can_ids: frozenset[int] | None, frames: int) -> None:
        try:
            self._port.focus(can_ids, frames)
        except FOREIGN as error:
            raise translate(error, self.name) from error

    def mute(self) -> None:
        """Forget all handlers."""
        self._handlers.clear()

    @property
    def arrived_ns(self) -> int:
        """Arrival of the present frame [ns]; where it is unknown, the earliest possible.

        It came after the last look that found nothing. A rare sign of life must not count as a recent one.
        """
        known = self._port.arrived_ns(self._empty_ns)
        return self._empty_ns if known is None else known

    @property
    def taken_ns(self) -> int:
        """Arrival of the present frame [ns]; where it is unknown, now."""
        known = self._port.arrived_ns(self._empty_ns)
        return self._now_ns() if known is None else known

    @property
    def sentences(self) -> list[str]:
        """Faults of this computer's end of the bus, for people: frames that were refused, states of the controller."""
        told = (self.refusal, self.error_frames.sentence(self.name))
        return [str(said) for said in told if said is not None]

    def send(self, can_id: int, data: bytes | bytearray = b"") -> None:
        """Send a frame; raises BusError when it is not accepted, also when the transmit queue is full."""
        if not self.offer(can_id, data):
            raise self.refusal or BusError(f"{self.name}: a frame was refused")

    def offer(self, can_id: int, data: bytes | bytearray = b"") -> bool:
        """Send a frame; False when the transmit queue is full and the frame was dropped. Raises BusError otherwise."""
        try:
            self._send(can_id, data)
        except FOREIGN as error:
            ours = translate(error, self.name)
            if not is_queue_full(error):
                raise ours from error
            self.refusal = ours
            return False
        if self._log is not None:
            self._write_log(self._log, self._now_ns(), can_id, data)
        return True

    def pump(self, deadline_ns: int) -> bool:
        """Receive one frame and call its handler; False when none came until the deadline [ns]. Raises BusError."""
        remaining_ns = deadline_ns - self._now_ns()
        return self.pump_for(remaining_ns * 1e-9 if remaining_ns > 0 else 0.0)

    def pump_for(self, seconds: float) -> bool:
        """Receive as `pump` does, for so long [s] at most; raises BusError."""
        try:
            received = self._receive(seconds)
        except FOREIGN as error:
            raise translate(error, self.name) from error
        if received is None:
            return False
        if received is OURS:
            return True
        can_id, data = received
        if can_id & ERROR_FLAG:
            self.error_frames.hear(can_id, data)
        if self._log is not None:
            known = self._port.arrived_ns(self._empty_ns)
            self._write_log(self._log, self._now_ns() if known is None else known, can_id, data)
        handler = self._handlers.get(can_id)
        if handler is None:
            self.foreign_bits += frame_bits(can_id, data)
        else:
            handler(data)
        return True

    def _write_log(self, log: FrameLog, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        """Write a frame to the log; a log that raises is used no more, so that a full disk stops no other frame."""
        self._logged_ns = t_ns = max(t_ns, self._logged_ns)  # what arrived before we sent may be read after it
        try:
            log(t_ns, can_id, data)
        except Exception:
            self._log = None
            raise

    def pump_until(self, deadline_ns: int, done: Callable[[], bool] = bool) -> None:
        """Receive until `done` returns True, by default until the deadline [ns]. Raises BusError.

        After it, frames that wait are still received, up to `MOST_WAITING`: a flood of frames has no end.
        """
        late = 0
        while not done() and late <= MOST_WAITING and self.pump(deadline_ns):
            late += self._now_ns() > deadline_ns

    def drain(self, deadline_ns: int) -> int:
        """Handle all frames that have already arrived, without waiting, and return the time [ns].

        In a flood it stops at the deadline [ns].
        """
        while self.pump_for(0.0):
            now_ns = self._now_ns()
            if now_ns >= deadline_ns:
                return now_ns
        self._empty_ns = now_ns = self._now_ns()
        return now_ns


def port_to(can_bus: can.BusABC, clock: Clock) -> CanPort:
    """Return the port to an open bus: its socket on SocketCAN and UDP multicast, else python-can's messages."""
    if is_socketcan(can_bus):
        return SocketCanPort(can_bus.socket, clock)  # type: ignore[attr-defined]
    return MulticastPort(can_bus, clock) if hasattr(can_bus, "_multicast") else PythonCanPort(can_bus)
