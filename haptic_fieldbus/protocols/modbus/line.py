"""What requests and answers take on a line: octets of each function, characters, silence, answer time.

A request is sent. The drive knows its end by the silence after it, and works for its answer time, at the end of which
it writes and reads its registers; then the answer is sent, and again there is silence. On RTU every octet takes a
character of 10 or 11 bits. On TCP a frame takes no time of its own and its length is told; the network and both stacks
take `round_trip` for a request and its answer together, half of it on each way.

Reference: Modbus application protocol 1.1b3, 6.3, 6.6, 6.12, 6.17; Modbus over serial line 1.02, 2.5.1.1.
"""

from dataclasses import dataclass

from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, WRITE_MULTIPLE, WRITE_SINGLE
from haptic_fieldbus.protocols.modbus.requests import RegisterRequest

RTU_OCTETS, TCP_OCTETS = 3, 7
"""Octets of a frame beside its PDU: unit and checksum; MBAP header."""
SILENT_CHARACTERS, LONGEST_SILENCE, SILENT_ABOVE = 3.5, 1.75e-3, 19200
"""Silence between frames: 3.5 characters, and 1.75 ms at more than 19200 bit/s."""
ROUND_TRIP = 0.25e-3
"""[s], of a network whose rig does not state it, the simulated one included: a switch, and the stacks of both ends."""


@dataclass(frozen=True)
class LineTimes:
    """Times of one line [s]."""

    octet: float
    """Time of one character; 0 on TCP."""
    silence: float
    """Silence that ends a frame and separates it from the next; 0 on TCP."""
    round_trip: float
    """Time that network, adapter and stacks take for a request and its answer."""
    frame_octets: int = RTU_OCTETS
    speed: str = ""
    """The line in words."""

    def request_time(self, request: RegisterRequest) -> float:
        """Return the time from the first octet of a request until the drive has all of it [s]."""
        return self.octet * (self.frame_octets + request_octets(request)) + 0.5 * self.round_trip

    def executed(self, request: RegisterRequest, answer_time: float) -> float:
        """Return the time from the first octet of a request until the drive writes and reads [s]."""
        return self.request_time(request) + self.silence + answer_time

    def answer_duration(self, request: RegisterRequest) -> float:
        """Return the time from the begin of an answer until the master has all of it [s]."""
        return self.octet * (self.frame_octets + answer_octets(request)) + 0.5 * self.round_trip

    def exchange(self, request: RegisterRequest, answer_time: float) -> float:
        """Return the time from the first octet of a request to the last one of its answer [s]."""
        return self.executed(request, answer_time) + self.answer_duration(request)

    def octets(self, request: RegisterRequest) -> int:
        """Return the octets of a request and its answer."""
        return 2 * self.frame_octets + request_octets(request) + answer_octets(request)


def serial_line(baud: int, bits: int, silence: float | None, round_trip: float = 0.0) -> LineTimes:
    """Return an RTU line of `baud` bit/s with characters of so many bits; `silence` None: that of the standard."""
    character = bits / baud
    standard = LONGEST_SILENCE if baud > SILENT_ABOVE else SILENT_CHARACTERS * character
    return LineTimes(
        character,
        standard if silence is None else silence,
        round_trip,
        speed=f"Modbus RTU at {baud} bit/s",
    )


def tcp_line(round_trip: float | None) -> LineTimes:
    """Return a TCP line; `round_trip` None: that which is assumed."""
    return LineTimes(0.0, 0.0, ROUND_TRIP if round_trip is None else round_trip, TCP_OCTETS, "Modbus TCP")


def request_octets(request: RegisterRequest) -> int:
    """Return the octets of the PDU of a request."""
    written = 0 if request.write is None else 2 * request.write.count
    fixed = {READ_WRITE: 10, WRITE_MULTIPLE: 6, WRITE_SINGLE: 3}
    return fixed.get(request.function, 5) + written


def answer_octets(request: RegisterRequest) -> int:
    """Return the octets of the PDU of its answer."""
    return 5 if request.read is None else 2 + 2 * request.read.count
