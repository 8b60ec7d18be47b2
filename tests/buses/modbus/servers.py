"""A drive in registers behind a real socket or a real pseudo-terminal, written without pymodbus.

Its registers are those of `generic_cia402_modbus`; the state machine is as small as a master needs it. `Mischief`
stands between drive and line: it may delay, twist, drop or repeat answers, or end the connection.
"""

import os
import pty
import socket
import struct
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from select import select

STATUS, DEMAND, POSITION, ACTUAL, ERROR = 0x0100, 0x0101, 0x0102, 0x0104, 0x0105
COMMAND, TARGET, MODE, LIMIT, WATCHDOG = 0x0200, 0x0201, 0x0202, 0x0203, 0x0204
IDENTITY, SERIAL, RATED, DISPLAY = 0x0300, 0x0306, 0x0308, 0x030A
ENABLED, FAULT = 0x27, 0x08
AFTER = {0x00: 0x40, 0x06: 0x21, 0x07: 0x23, 0x0F: ENABLED}
"""Controlword → statusword of a healthy drive."""


def crc(octets: bytes) -> bytes:
    """Checksum of RTU, bit by bit (Modbus over serial line 1.02, 6.2.2)."""
    value = 0xFFFF
    for octet in octets:
        value ^= octet
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


@dataclass
class Drive:
    """Registers and power state of one unit; `now` is its clock [s].

    The clock stands still unless one is given, so the watchdog does not fire because the computer is slow.
    """

    unit: int = 1
    now: Callable[[], float] = lambda: 0.0
    registers: dict[int, int] = field(default_factory=dict)
    written: list[tuple[int, int]] = field(default_factory=list)
    """Every register that was written, with its value, in order."""
    asked: int = 0
    """Requests so far."""
    exceptions: dict[int, int] = field(default_factory=dict)
    """Function → code of the exception by which it is refused."""
    fed: float | None = None

    def __post_init__(self) -> None:
        self.registers |= dict.fromkeys((*range(256, 264), *range(512, 517)), 0)
        self.registers |= dict.fromkeys(range(768, 779), 0)
        self.registers |= {STATUS: 0x40, LIMIT: 1000, SERIAL + 1: 4711, RATED + 1: 400}

    def value(self, address: int) -> int:
        return self.registers[address]

    def long(self, address: int) -> int:
        return self.registers[address] << 16 | self.registers[address + 1]

    def move_to(self, counts: int) -> None:
        self.registers[POSITION], self.registers[POSITION + 1] = counts >> 16 & 0xFFFF, counts & 0xFFFF

    def watch(self) -> None:
        """Go to fault when the set-points stay away while the drive is enabled."""
        limit = self.registers.get(WATCHDOG, 0) * 1e-3
        enabled = self.registers.get(STATUS) == ENABLED
        if limit and enabled and self.fed is not None and self.now() - self.fed > limit:
            self.registers |= {STATUS: FAULT, ERROR: 0x8130, DEMAND: 0}

    def write(self, address: int, value: int) -> None:
        self.written.append((address, value))
        self.registers[address] = value
        if address == COMMAND:
            if self.registers[STATUS] != FAULT:
                self.registers[STATUS] = AFTER.get(value & 0x0F, 0x40)
            elif value & 0x80:
                self.registers |= {STATUS: 0x40, ERROR: 0}
        if address == TARGET:
            self.fed = self.now()
            self.registers[DEMAND] = value if self.registers[STATUS] == ENABLED else 0
        if address == MODE:
            self.registers[DISPLAY] = value

    def answer(self, pdu: bytes) -> bytes:
        """The PDU of the answer; by Modbus application protocol 1.1b3, 6.3 to 6.17 and 7."""
        self.asked += 1
        self.watch()
        function = pdu[0]
        code = self.exceptions.get(function) or (0 if function in (3, 4, 6, 16, 23) else 1)
        try:
            return bytes((function | 0x80, code)) if code else self._done(function, pdu)
        except KeyError:
            return bytes((function | 0x80, 2))

    def _done(self, function: int, pdu: bytes) -> bytes:
        if function == 6:
            address, value = struct.unpack(">HH", pdu[1:5])
            _ = self.registers[address]
            self.write(address, value)
            return pdu
        if function == 16:
            address, count, _ = struct.unpack(">HHB", pdu[1:6])
            self._write_all(address, pdu[6 : 6 + 2 * count])
            return pdu[:5]
        if function == 23:
            read, count, address, written, _ = struct.unpack(">HHHHB", pdu[1:10])
            self._write_all(address, pdu[10 : 10 + 2 * written])
            return self._read(function, read, count)
        return self._read(function, *struct.unpack(">HH", pdu[1:5]))

    def _write_all(self, address: int, octets: bytes) -> None:
        for offset, (value,) in enumerate(struct.iter_unpack(">H", octets)):
            _ = self.registers[address + offset]
            self.write(address + offset, value)

    def _read(self, function: int, address: int, count: int) -> bytes:
        values = [self.registers[address + offset] for offset in range(count)]
        return bytes((function, 2 * count)) + struct.pack(f">{count}H", *values)


Mischief = Callable[[bytes, int], Iterator[bytes | float | None]]
"""Takes an answer as a frame, and how many requests there were; yields what is sent, seconds of silence between, or
None for the end of the connection."""


def honest(frame: bytes, asked: int) -> Iterator[bytes | float | None]:
    yield frame


@dataclass
class Server:
    """Drives by unit id, and what happens to their answers."""

    drives: dict[int, Drive]
    mischief: Mischief = honest
    name: str = ""
    """Name of the bus for our side."""
    frames: list[bytes] = field(default_factory=list)
    """Requests as they came."""
    ended: threading.Event = field(default_factory=threading.Event)
    cut: Callable[[], None] = lambda: None
    """Ends the connection, or closes the pseudo-terminal."""
    put: Callable[[bytes], object] = lambda octets: None
    """Sends octets that nobody asked for."""

    @property
    def drive(self) -> Drive:
        return next(iter(self.drives.values()))

    def serve(self, take: Callable[[], bytes], put: Callable[[bytes], None], whole: Callable[[bytes], int]) -> None:
        """Take requests until the line ends; `whole` tells the octets of the first frame, 0 while it is incomplete."""
        gathered = b""
        while not self.ended.is_set():
            octets = take()
            gathered += octets
            while size := whole(gathered):
                frame, gathered = gathered[:size], gathered[size:]
                self.frames.append(frame)
                for piece in self._answers(frame):
                    if piece is None:
                        return
                    if isinstance(piece, float):
                        self.ended.wait(piece)
                    else:
                        put(piece)

    def _answers(self, frame: bytes) -> Iterator[bytes | float | None]:
        tcp = self.name.startswith("modbus-tcp")
        unit, pdu = (frame[6], frame[7:]) if tcp else (frame[0], frame[1:-2])
        if unit not in self.drives or not (tcp or crc(frame[:-2]) == frame[-2:]):
            return
        drive = self.drives[unit]
        body = bytes((unit,)) + drive.answer(pdu)
        answer = frame[:4] + len(body).to_bytes(2, "big") + body if tcp else body + crc(body)
        yield from self.mischief(answer, drive.asked)


def tcp_size(octets: bytes) -> int:
    size = 6 + int.from_bytes(octets[4:6], "big") if len(octets) >= 6 else 0
    return size if size and len(octets) >= size else 0


def rtu_size(octets: bytes) -> int:
    if len(octets) < 8:
        return 0
    counted = {16: 6, 23: 10}.get(octets[1])
    if counted is None:
        return 8
    size = counted + 1 + octets[counted] + 2 if len(octets) > counted else 0
    return size if size and len(octets) >= size else 0


@contextmanager
def tcp_server(*drives: Drive, mischief: Mischief = honest, nagle: bool = False) -> Iterator[Server]:
    """A server on loopback; it takes one connection after another, and leaves Nagle's algorithm on or turns it off."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = Server({drive.unit: drive for drive in drives}, mischief)
        server.name = f"modbus-tcp:127.0.0.1:{listener.getsockname()[1]}"
        listener.settimeout(0.02)
        thread = threading.Thread(target=_serve_tcp, args=(server, listener, nagle), daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.ended.set()
            server.cut()
            thread.join(5.0)


def _serve_tcp(server: Server, listener: socket.socket, nagle: bool) -> None:
    while not server.ended.is_set():
        try:
            connection, _ = listener.accept()
        except (TimeoutError, OSError):
            continue
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, not nagle)
        connection.settimeout(None)

        def reset(connection: socket.socket = connection) -> None:
            with suppress(OSError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                connection.shutdown(socket.SHUT_RD)

        server.cut = reset

        def take(connection: socket.socket = connection) -> bytes:
            octets = connection.recv(4096)
            if not octets:
                raise ConnectionError
            return octets

        with suppress(OSError), connection:
            server.serve(take, connection.sendall, tcp_size)


@contextmanager
def rtu_server(*drives: Drive, mischief: Mischief = honest) -> Iterator[Server]:
    """A server on one end of a pseudo-terminal; the other end is the serial port of our side."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    server = Server({drive.unit: drive for drive in drives}, mischief)
    server.name = f"modbus-rtu:{os.ttyname(theirs)}"
    open_ends = [ours, theirs]

    def cut() -> None:
        while open_ends:
            os.close(open_ends.pop())

    server.cut, server.put = cut, lambda octets: os.write(ours, octets)

    def take() -> bytes:
        while not server.ended.is_set():
            readable, _, _ = select((ours,), (), (), 0.02)
            if readable:
                return os.read(ours, 4096)
        return b""

    def serve() -> None:
        with suppress(OSError, ValueError):
            server.serve(take, lambda octets: (os.write(ours, octets), None)[1], rtu_size)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.ended.set()
        thread.join(5.0)
        cut()
