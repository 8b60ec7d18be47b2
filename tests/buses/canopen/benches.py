"""One drive on a fake bus with a master that may be opened."""

from dataclasses import dataclass, field

from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.planning.plan import Plan
from tests.builders import plan_of
from tests.buses.canopen.fake_can import FakeCan, FakeDrive, epos4_objects

NODE = 1
RPDO, TPDO, HEARTBEAT = 0x200 + NODE, 0x180 + NODE, 0x700 + NODE
LISTENING_NS = 1_000_000_000
"""For which a master listens before it sends."""
TORQUE_FREE = bytes(4)
"""Controlword disable voltage, target torque 0."""


@dataclass
class Bench:
    """Everything that a test of the master touches."""

    plan: Plan = field(default_factory=plan_of)
    clock: VirtualClock = field(default_factory=VirtualClock)

    def __post_init__(self) -> None:
        self.can = FakeCan(self.clock)
        self.drives = [FakeDrive(self.can, axis.node, epos4_objects(axis.node)) for axis in self.plan.axes]
        self.drive = self.drives[0]
        self.frames: list[tuple[int, int, bytes]] = []
        self.bus = CanopenBus(self.can, self.clock, self._log, owned=True)

    def _log(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self.frames.append((t_ns, can_id, bytes(data)))

    def open(self) -> "Bench":
        self.bus.open(self.plan)
        return self

    def written(self) -> list[tuple[str, int]]:
        """SDO downloads in order, such as ("6060h:00", 10)."""
        downloads = []
        for _, can_id, data in self.can.sent:
            if 0x601 <= can_id <= 0x67F and data[0] >> 5 == 1:
                size = 4 - (data[0] >> 2 & 3)
                name = f"{int.from_bytes(data[1:3], 'little'):04X}h:{data[3]:02X}"
                downloads.append((name, int.from_bytes(data[4 : 4 + size], "little")))
        return downloads
