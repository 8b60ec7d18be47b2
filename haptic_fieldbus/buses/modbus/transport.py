"""The way of octets between master and drives, real or simulated: one request is under way at a time."""

from typing import Protocol

from haptic_fieldbus.protocols.modbus.profile import Parity


class Transport(Protocol):
    """A line or a connection that carries octets; it is used in one thread, and nothing in it waits unasked."""

    name: str
    """Name of the bus, as users write it: `modbus-tcp:192.168.0.10`."""
    serial: bool
    """True on RTU, False on TCP."""

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        """Set bit rate [bit/s] and characters of a serial line; nothing on TCP. Raises BusError."""

    def discard(self) -> bytes:
        """Drop all octets that wait, and return them: they belong to no request of now. Raises BusError when dead."""

    def send(self, frame: bytes | bytearray) -> None:
        """Send a frame; raises BusError when the line is dead or takes no more."""

    def receive(self, deadline_ns: int) -> bytes:
        """Return what has arrived; wait for at least one octet until the deadline [ns], and return none after it.

        What has arrived is returned after the deadline too. Raises BusError when the line is dead.
        """

    def reopen(self) -> None:
        """Open a dead line anew, for the way to zero alone, and wait some milliseconds at most; raises BusError."""

    def close(self) -> None:
        """Release the line; raises nothing."""
