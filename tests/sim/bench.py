"""A simulated drive and its node without wire or clock, driven frame by frame: what the tests of both use."""

import struct
from dataclasses import dataclass, replace
from functools import cache

from haptic_fieldbus.drive.rig import RigAxis, default_axis
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive.settings import DriveSettings
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import Hand

NODE = 5
MS = 1_000_000
SIZES = {"B": 1, "b": 1, "H": 2, "h": 2, "I": 4, "i": 4}


@cache
def profile(name: str = "generic_cia402") -> CanopenProfile:
    return canopen_profile(load_profile(name))


def axis(workspace: Workspace = Workspace.LINEAR, **changes: object) -> RigAxis:
    return replace(default_axis(workspace, bus="bus", node=NODE, profile="profile"), **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Refusal:
    """An SDO abort as the client sees it."""

    code: int


class DriveBench:
    """One drive; `sent` holds (time, frame) of everything that it sent."""

    def __init__(
        self,
        drive_profile: CanopenProfile | None = None,
        drive_axis: RigAxis | None = None,
        *,
        hand: Hand | None = None,
        settings: DriveSettings | None = None,
        booted: bool = True,
    ) -> None:
        self.t_ns = 0
        self.sent: list[tuple[int, Frame]] = []
        slot = DriveOnBus(NODE, drive_profile or profile(), drive_axis or axis(), hand)
        self.slave = Slave(slot, self._sent, settings or DriveSettings())
        self.drive, self.node = self.slave.drive, self.slave.node
        self.slave.power_on(0, booted=booted)

    def _sent(self, frame: Frame) -> None:
        self.sent.append((self.t_ns, frame))

    def run(self, duration_ns: int) -> None:
        """Let the drive do what falls due."""
        end_ns = self.t_ns + duration_ns
        while self.slave.due_ns <= end_ns:
            self.t_ns = max(self.t_ns, self.slave.due_ns)
            self.slave.timer(self.t_ns)
        self.t_ns = end_ns

    def give(self, can_id: int, data: bytes = b"") -> None:
        """A frame ends now."""
        self.slave.receive(Frame(can_id, data), self.t_ns)

    def take(self, can_id: int) -> list[bytes]:
        """Octets of the frames sent with this identifier; all are forgotten."""
        taken = [frame.data for _, frame in self.sent if frame.can_id == can_id]
        self.sent.clear()
        return taken

    def request(self, data: bytes) -> bytes:
        """One SDO exchange."""
        self.sent.clear()
        self.give(0x600 + NODE, data.ljust(8, b"\0"))
        (response,) = self.take(0x580 + NODE)
        return response

    def read(self, index: int, subindex: int = 0) -> int | Refusal:
        response = self.request(bytes((0x40, *index.to_bytes(2, "little"), subindex)))
        if response[0] == 0x80:
            return Refusal(int.from_bytes(response[4:], "little"))
        return int.from_bytes(response[4 : 8 - (response[0] >> 2 & 3)], "little")

    def write(self, index: int, subindex: int, value: int, code: str) -> Refusal | None:
        size = SIZES[code]
        head = bytes((0x23 | (4 - size) << 2, *index.to_bytes(2, "little"), subindex))
        response = self.request(head + struct.pack("<" + code, value))
        if response[0] == 0x80:
            return Refusal(int.from_bytes(response[4:], "little"))
        assert response == bytes((0x60, *head[1:], 0, 0, 0, 0))
        return None

    def nmt(self, command: int, node: int = NODE) -> None:
        self.give(0, bytes((command, node)))

    def sync(self) -> None:
        self.give(0x80)

    def map(self, number: int, transmission_type: int, entries: list[int], *, tpdo: bool) -> None:
        """Configure a PDO as CiA 301 asks for it."""
        communication, mapping = (0x1800, 0x1A00) if tpdo else (0x1400, 0x1600)
        can_id = (0x180 if tpdo else 0x200) + 0x100 * (number - 1) + NODE
        steps = [
            (communication, 1, can_id | 1 << 31, "I"),
            (communication, 2, transmission_type, "B"),
            (mapping, 0, 0, "B"),
            *((mapping, position, entry, "I") for position, entry in enumerate(entries, start=1)),
            (mapping, 0, len(entries), "B"),
            (communication, 1, can_id, "I"),
        ]
        for base, subindex, value, code in steps:
            assert self.write(base + number - 1, subindex, value, code) is None

    def operational(self, *, rpdo_type: int = 255, tpdo_type: int = 1) -> None:
        """TPDO1 statusword and position, RPDO1 controlword and target torque, torque mode, NMT operational."""
        self.map(1, tpdo_type, [0x6041_0010, 0x6064_0020], tpdo=True)
        self.map(1, rpdo_type, [0x6040_0010, 0x6071_0010], tpdo=False)
        assert self.write(0x6060, 0, 10, "b") is None
        self.nmt(1)

    def control(self, controlword: int, target: int = 0) -> None:
        """One RPDO1."""
        self.give(0x200 + NODE, struct.pack("<Hh", controlword, target))

    def status(self) -> int:
        value = self.read(0x6041)
        assert isinstance(value, int)
        return value

    def enable(self) -> None:
        """Operational and in *operation enabled*."""
        self.operational()
        for controlword in (0x06, 0x07, 0x0F):
            self.control(controlword)
        assert self.status() & 0x6F == 0x27
