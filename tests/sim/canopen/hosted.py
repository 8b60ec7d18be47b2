"""Drives hosted in this thread, on `virtual`, served turn by turn: what several tests use."""

import struct
from dataclasses import replace

import can

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.hosting import Host, HostPort
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.host_request import NamedDrive, slot_of

MS = 1_000_000
READ_IDENTITY = bytes.fromhex("40 18 10 01 00 00 00 00")


class Hosted:
    """Drives on one end of a virtual bus, the test on the other; time moves when told to."""

    def __init__(
        self, *nodes: int, faults: tuple[Fault, ...] = (), echoes: bool = False, hand: str = "none", led: bool = False
    ) -> None:
        channel = f"hosting {id(self)}"
        self.clock = VirtualClock()
        self.theirs = can.Bus(interface="virtual", channel=channel, receive_own_messages=echoes)
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.told: list[str] = []
        self.host_port = HostPort(self.theirs, self.clock, "virtual:hosting", self.told.append, self.reopened)
        self.host = Host(self.host_port, self.clock)
        for node in nodes:
            drive = NamedDrive("generic_cia402", node)
            bench = (drive, "virtual:hosting", Workspace.LINEAR, hand_named(hand), faults)
            self.host.add(replace(slot_of(*bench, booted=False), led=led))

    def reopened(self) -> can.BusABC:
        """The bus is opened anew."""
        self.theirs = can.Bus(interface="virtual", channel=f"hosting {id(self)}")
        return self.theirs

    def send(self, can_id: int, data: bytes, *, remote: bool = False, extended: bool = False) -> None:
        self.bus.send(
            can.Message(
                arbitration_id=can_id,
                data=None if remote else data,
                dlc=len(data),
                is_remote_frame=remote,
                is_extended_id=extended,
            )
        )

    def serve(self, duration_ns: int = MS) -> list[tuple[int, bytes]]:
        """Time passes; what was sent is served first, then what falls due; returns what the drives sent."""
        for _ in range(20):
            self.host.serve(0)
        self.clock.compute(duration_ns)
        self.host.serve(0)
        heard = iter(lambda: self.bus.recv(0), None)
        return [(message.arbitration_id, bytes(message.data)) for message in heard]

    def close(self) -> None:
        self.theirs.shutdown()
        self.bus.shutdown()


def enabled(hosted: Hosted) -> list[tuple[int, bytes]]:
    """Node 5 sends statusword and position at each SYNC, and is in *operation enabled* by cyclic synchronous torque."""
    for entry, value, size in (
        ("00 18 01", 1 << 31 | 0x185, 4), ("00 18 02", 1, 1), ("00 1A 00", 0, 1), ("00 1A 01", 0x6041_0010, 4),
        ("00 1A 02", 0x6064_0020, 4), ("00 1A 00", 2, 1), ("00 18 01", 0x185, 4), ("60 60 00", 10, 1),
        ("00 14 01", 1 << 31 | 0x205, 4), ("00 16 00", 0, 1), ("00 16 01", 0x6040_0010, 4),
        ("00 16 02", 0x6071_0010, 4), ("00 16 00", 2, 1), ("00 14 01", 0x205, 4),
    ):  # fmt: skip
        head = {1: b"\x2f", 4: b"\x23"}[size]
        hosted.send(0x605, head + bytes.fromhex(entry) + struct.pack("<I", value))
    hosted.send(0, bytes((1, 5)))
    for controlword in (0x06, 0x07, 0x0F):
        hosted.send(0x205, struct.pack("<Hh", controlword, 0))
    return hosted.serve()
