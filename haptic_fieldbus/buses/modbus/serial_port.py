"""Modbus RTU: a serial port, RS-485 or RS-232, read and written without waiting.

pyserial opens the port and sets bit rate and characters. The lines RTS and DTR stay as the system has them, since
adapters turn their driver on by themselves, and a kernel that does it by RTS was told so by somebody else.

A port that is gone reads as readable without octets, or fails with EIO. A pseudo-terminal has no parity and refuses to
be told one, so it keeps its own characters.
"""

import os
from contextlib import suppress
from select import select

import serial

from haptic_fieldbus.buses.modbus.errors import port_errors, translate
from haptic_fieldbus.buses.usb_serial import NO_SERIAL_LINE, leads_elsewhere
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.protocols.modbus.profile import Parity

PARITIES = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}
PSEUDO_TERMINALS = range(136, 144)
"""Major numbers of the devices /dev/pts/* (Linux, admin-guide/devices.txt)."""
CLOSED = -1
LARGEST = 4096
"""Octets that are taken at once; an answer has 256 at most."""


class SerialTransport:
    """The serial port `device`, held by this program alone; raises BusError when it cannot be opened.

    Raises UsageError on a system whose ports have no descriptors (Windows).
    """

    serial = True

    def __init__(self, name: str, device: str, clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._errors = port_errors()
        self._port = serial.Serial(timeout=0, write_timeout=0, exclusive=True)
        self._port.port = device
        self._open()

    def _open(self) -> None:
        try:
            self._port.open()
        except self._errors as error:  # pyserial's own errors are among them
            subject = f"cannot open {self.name}"
            if leads_elsewhere(str(self._port.port), error):
                raise BusError(f"{subject}: {NO_SERIAL_LINE}") from error
            raise translate(error, subject) from error
        with suppress(OSError, ValueError):  # not every driver knows of it
            self._port.set_low_latency_mode(True)
        self._number = self._port.fileno()

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        try:
            self._port.baudrate = baud
            if os.major(os.fstat(self._number).st_rdev) not in PSEUDO_TERMINALS:
                self._port.parity, self._port.stopbits = PARITIES[parity], stop_bits
        except ValueError as error:
            raise BusError(f"{self.name} at {baud} bit/s: {error}") from error
        except self._errors as error:
            raise translate(error, f"{self.name} at {baud} bit/s") from error

    def discard(self) -> bytes:
        gathered = b""
        while self._waits(0.0):
            gathered += self._taken()
        return gathered

    def send(self, frame: bytes | bytearray) -> None:
        try:
            sent = os.write(self._number, frame)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise translate(error, self.name) from error
        if sent < len(frame):
            raise BusError(f"{self.name}: the port takes no more octets")

    def receive(self, deadline_ns: int) -> bytes:
        wait_ns = deadline_ns - self._clock.now_ns()
        return self._taken() if self._waits(wait_ns * 1e-9 if wait_ns > 0 else 0.0) else b""

    def _waits(self, seconds: float) -> bool:
        try:
            readable, _, _ = select((self._number,), (), (), seconds)
        except (OSError, ValueError) as error:
            raise translate(error, self.name) from error
        return bool(readable)

    def _taken(self) -> bytes:
        try:
            octets = os.read(self._number, LARGEST)
        except OSError as error:
            raise translate(error, self.name) from error
        if not octets:
            raise BusError(f"{self.name}: the adapter is gone, as when it is unplugged")
        return octets

    def reopen(self) -> None:
        self.close()
        self._open()

    def close(self) -> None:
        self._number = CLOSED  # the system gives the number to the next file
        with suppress(OSError):
            self._port.close()
