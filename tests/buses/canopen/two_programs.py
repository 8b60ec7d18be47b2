"""Two programs on one simulated wire in virtual time: one that only reads, and another master."""

import can

from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim.canopen.bus import SimulatedBus

DRIVES = "maxon_epos4@5,generic_cia402@99"
DOWNLOADS = (0, 1, 6)
FROM_MASTERS = (0x000, 0x080, 0x200, 0x300, 0x400, 0x500, 0x600)
"""COB-IDs, without node-IDs, of what a master sends; an emergency has that of SYNC, and is told by its data."""


class TwoPrograms:
    """A reader and another master, who sees all that the reader sends; time passes while one of them receives."""

    def __init__(self, drives: str = DRIVES) -> None:
        self.clock = VirtualClock()
        self.bus = SimulatedBus(drives, clock=self.clock)
        self.other = SimulatedBus(drives, clock=self.clock)
        self.wire = Wire(self.bus, self.clock, "wire")

    def send(self, can_id: int, data: bytes = b"") -> None:
        self.other.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def put(self, node: int, index: int, sub: int, value: int, size: int) -> None:
        """The other master downloads an entry, and waits for the answer."""
        head = bytes((0x23 | (4 - size) << 2,)) + index.to_bytes(2, "little") + bytes((sub,))
        self.send(0x600 + node, head + value.to_bytes(size, "little").ljust(4, b"\0"))
        self.spend(0.01)

    def spend(self, seconds: float) -> None:
        """Time passes, and whatever comes is forgotten."""
        until = self.clock.now_ns() + round(seconds * 1e9)
        while self.clock.now_ns() < until and self.other.recv((until - self.clock.now_ns()) * 1e-9):
            pass

    def forget(self) -> None:
        """Frames that came so far reach the reader no more, as if it joined the bus now."""
        self.wire.drain(self.clock.now_ns() + 1_000_000_000)

    def enable(self, node: int) -> None:
        """The other master puts a drive into *operation enabled*, with a watch of 50 ms on its heartbeat."""
        self.put(node, 0x1016, 1, 127 << 16 | 50, 4)
        self.put(node, 0x6060, 0, 10, 1)
        self.send(0x77F, b"\x05")
        self.send(0, bytes((1, node)))
        for controlword in (0x06, 0x07, 0x0F):
            self.put(node, 0x6040, 0, controlword, 2)

    def sent(self) -> list[can.Message]:
        """Frames that the reader has sent since the other looked last."""
        heard = iter(lambda: self.other.recv(0.0), None)
        return [frame for frame in heard if frame.is_remote_frame or frame.arbitration_id & 0x780 in FROM_MASTERS[2:]
                or frame.arbitration_id in FROM_MASTERS[:2]]  # fmt: skip

    def close(self) -> None:
        self.bus.shutdown()
        self.other.shutdown()


def assert_uploads_alone(frames: list[can.Message]) -> None:
    for frame in frames:
        assert not frame.is_remote_frame
        assert 0x601 <= frame.arbitration_id <= 0x67F, frame
        assert frame.data[0] >> 5 not in DOWNLOADS, frame
