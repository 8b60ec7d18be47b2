"""A small CANopen master on the simulated world, written by hand from CiA 301: frames in, frames out."""

import struct

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim.canopen.link import Frame, Received
from haptic_fieldbus.sim.canopen.world import World

PERIOD_NS = 1_000_000


class Master:
    """Keeps all it heard in `log`."""

    def __init__(self, world: World, clock: VirtualClock) -> None:
        self.world = world
        self.clock = clock
        self.controller = world.attach()
        self.log: list[Received] = []
        self.positions: list[int] = []
        self.statusword = 0
        self.position = 0
        self.missed = 0
        self.enabled_ns = 0
        self._next_ns = 0

    @property
    def last_position(self) -> int:
        return self.positions[-1]

    def heard(self, can_id: int) -> list[Received]:
        return [item for item in self.log if item.frame.can_id == can_id and not item.error]

    def send(self, can_id: int, data: bytes) -> None:
        self.world.send(self.controller, Frame(can_id, data))

    def wait(self, duration_ns: int) -> None:
        """Listen for a while."""
        end_ns = self.clock.now_ns() + duration_ns
        while self._hear(end_ns) is not None:
            pass

    def _hear(self, end_ns: int) -> Received | None:
        item = self.world.receive(self.controller, max(0, end_ns - self.clock.now_ns()))
        if item is not None:
            self.log.append(item)
        return item

    def _await(self, can_id: int, duration_ns: int) -> bytes | None:
        end_ns = self.clock.now_ns() + duration_ns
        while (item := self._hear(end_ns)) is not None:
            if item.frame.can_id == can_id and not item.error:
                return item.frame.data
        return None

    def read(self, node: int, index: int, subindex: int = 0) -> int | None:
        """Expedited upload; None when nobody answers."""
        self.send(0x600 + node, bytes((0x40, *index.to_bytes(2, "little"), subindex, 0, 0, 0, 0)))
        response = self._await(0x580 + node, 100_000_000)
        return None if response is None else int.from_bytes(response[4 : 8 - (response[0] >> 2 & 3)], "little")

    def write(self, node: int, index: int, subindex: int, value: int, size: int) -> None:
        """Expedited download; AssertionError with the abort code when refused."""
        head = bytes((0x23 | (4 - size) << 2, *index.to_bytes(2, "little"), subindex))
        self.send(0x600 + node, head + (value & (1 << 32) - 1).to_bytes(4, "little"))
        response = self._await(0x580 + node, 100_000_000)
        assert response is not None
        assert response[0] == 0x60, f"{int.from_bytes(response[4:], 'little'):08x}"

    def map(self, node: int, communication: int, can_id: int, type_: int, entries: list[int]) -> None:
        mapping = communication + 0x200
        self.write(node, communication, 1, can_id | 1 << 31, 4)
        self.write(node, communication, 2, type_, 1)
        self.write(node, mapping, 0, 0, 1)
        for position, entry in enumerate(entries, start=1):
            self.write(node, mapping, position, entry, 4)
        self.write(node, mapping, 0, len(entries), 1)
        self.write(node, communication, 1, can_id, 4)

    def enable(self, node: int) -> None:
        """Map TPDO1 (statusword, position) and RPDO1 (controlword, target), start, and go to operation enabled."""
        self.map(node, 0x1800, 0x180 + node, 1, [0x6041_0010, 0x6064_0020])
        self.map(node, 0x1400, 0x200 + node, 255, [0x6040_0010, 0x6071_0010])
        self.write(node, 0x6060, 0, 10, 1)
        self.send(0, bytes((1, node)))
        self._next_ns = max(self._next_ns, self.clock.now_ns() + PERIOD_NS)
        for controlword in (0x06, 0x07, 0x0F):
            self.period(node, controlword, 0)
        self.enabled_ns = self.clock.now_ns()
        self.positions.clear()

    def period(self, node: int, controlword: int, target: int, *, optional: bool = False) -> tuple[int, int]:
        """SYNC, TPDO, RPDO."""
        self.wait(self._next_ns - self.clock.now_ns())
        self.clock.sleep_until(self._next_ns)
        self._next_ns += PERIOD_NS
        self.send(0x80, b"")
        data = self._await(0x180 + node, PERIOD_NS // 2)
        if data is None:
            assert optional
            self.missed += 1
        else:
            self.statusword, position = struct.unpack("<Hi", data)
            self.positions.append(position)
        self.clock.compute(50_000)
        self.send(0x200 + node, struct.pack("<Hh", controlword, target))
        return self.statusword, self.positions[-1] if self.positions else 0
