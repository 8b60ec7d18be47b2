"""A CAN bus of one process in virtual time, with drives that do just what a master needs, and faults on demand.

It knows nothing of the package but its clock: octets are written out here by hand, so that master and fake cannot share
a mistake. Frames take no time on the wire; answers come `DELAY_NS` later.
"""

import heapq
from collections.abc import Callable
from itertools import count

import can

from haptic_fieldbus.clock import VirtualClock

DELAY_NS = 100_000
REMOTE = 0x4000_0000
"""Added to the identifier of a remote frame in what was sent (linux/can.h)."""
Key = tuple[int, int]


class FakeCan(can.BusABC):
    """The master's port; `sent` holds what the master sent, `heard` all frames in order, as (t_ns, id, data)."""

    channel_info = "fake0"

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.sent: list[tuple[int, int, bytes]] = []
        self.refuse: Callable[[can.Message], Exception | None] = lambda message: None
        self.broken: Exception | None = None
        self.drives: list[FakeDrive] = []
        self.is_shut_down = False
        self._events: list[tuple[int, int, can.Message | Callable[[], None]]] = []
        self._order = count()
        super().__init__("fake0")
        self._is_shutdown = True  # nothing to complain of when a test leaves it open

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        error = self.broken or self.refuse(msg)
        if error is not None:
            raise error
        can_id = msg.arbitration_id | (REMOTE if msg.is_remote_frame else 0)
        self.sent.append((self.clock.now_ns(), can_id, bytes(msg.data)))
        for drive in self.drives:
            drive.hear(can_id, bytes(msg.data))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.broken is not None:
            raise self.broken
        deadline_ns = self.clock.now_ns() + round((timeout or 0.0) * 1e9)
        while self._events and self._events[0][0] <= deadline_ns:
            t_ns, _, event = heapq.heappop(self._events)
            self.clock.sleep_until(t_ns)
            if isinstance(event, can.Message):
                return event
            event()
        self.clock.sleep_until(deadline_ns)
        return None

    def shutdown(self) -> None:
        self.is_shut_down = True
        super().shutdown()

    def later(self, delay_ns: int, event: can.Message | Callable[[], None]) -> None:
        """Something that the master receives, or that happens, after a while."""
        heapq.heappush(self._events, (self.clock.now_ns() + delay_ns, next(self._order), event))

    def reply(self, can_id: int, data: bytes, delay_ns: int = DELAY_NS) -> None:
        self.later(delay_ns, can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def of(self, can_id: int) -> list[bytes]:
        """Payloads that the master sent under an identifier, in order."""
        return [data for _, sent, data in self.sent if sent == can_id]


class FakeDrive:
    """A CiA 402 drive as far as a master sees it: SDO server, NMT, heartbeat, PDOs of any mapping, power states."""

    def __init__(self, bus: FakeCan, node: int, objects: dict[Key, bytes]) -> None:
        self.bus, self.node = bus, node
        self.objects = dict(objects)
        self.state = 0x7F
        self.silent = False
        self.mute_tpdos = False
        self.tpdo_delay_ns = DELAY_NS
        self.tpdo_change: Callable[[bytes], bytes] = lambda data: data
        self.aborts: dict[Key, int] = {}
        """Writes refused with a code."""
        self.refusals: dict[Key, int] = {}
        """Reading and writing refused with a code."""
        self.in_segments: set[Key] = set()
        """Objects whose upload is begun without a value, as if it followed in segments."""
        self.forgets: set[Key] = set()
        """Writes accepted and not kept."""
        self.stays_in: int | None = None
        """NMT state that no command leaves."""
        self.power_stays: int | None = None
        """Statusword that no controlword changes."""
        self.counts_at: Callable[[int], int] = lambda t_ns: 0
        """Position actual value over time [ns]."""
        self.toggles = True
        """Whether answers to node guarding alternate in their toggle bit."""
        self.lost_answers = 0
        """Number of following answers to node guarding that are lost on the wire."""
        self.mute_sdo = False
        self.sdo_delay_ns = DELAY_NS
        self._toggle = 0
        self._beating = False
        bus.drives.append(self)

    def value(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self.objects[index, subindex], "little")

    def hear(self, can_id: int, data: bytes) -> None:
        if self.silent:
            return
        if can_id == 0x600 + self.node:
            self._serve(data)
        elif can_id == REMOTE | 0x700 + self.node and not self.value(0x1017):
            self._be_guarded()
        elif can_id == 0x000 and data[1] in (0, self.node):
            wanted = {0x01: 0x05, 0x02: 0x04, 0x80: 0x7F}[data[0]]
            self.state = wanted if self.stays_in is None else self.stays_in
        elif self.state == 0x05 and can_id == 0x080:
            self._answer_sync()
        elif self.state == 0x05:
            self._take_rpdo(can_id, data)

    def emergency(self, code: int, delay_ns: int = 0) -> None:
        self.bus.reply(0x080 + self.node, code.to_bytes(2, "little") + bytes((1, 0, 0, 0, 0, 0)), delay_ns)

    def restart(self) -> None:
        self.state, self._toggle = 0x7F, 0
        self.bus.reply(0x700 + self.node, b"\x00", 0)

    def _be_guarded(self) -> None:
        if not self.lost_answers:
            self.bus.reply(0x700 + self.node, bytes((self._toggle | self.state,)))
        self.lost_answers = max(0, self.lost_answers - 1)
        self._toggle ^= 0x80 if self.toggles else 0

    def _serve(self, request: bytes) -> None:
        command, key = request[0], (int.from_bytes(request[1:3], "little"), request[3])
        if command == 0x80 or self.mute_sdo:
            return
        if key in self.refusals:
            answer = b"\x80" + request[1:4] + self.refusals[key].to_bytes(4, "little")
        elif command == 0x40 and key in self.in_segments:
            answer = request[:4] + bytes(4)
        elif command == 0x40 and key in self.objects:
            data = self.objects[key]
            answer = bytes((0x43 | (4 - len(data)) << 2,)) + request[1:4] + data.ljust(4, b"\0")
        elif key not in self.objects:
            answer = b"\x80" + request[1:4] + (0x0602_0000).to_bytes(4, "little")
        elif key in self.aborts:
            answer = b"\x80" + request[1:4] + self.aborts[key].to_bytes(4, "little")
        else:
            size = 4 - (command >> 2 & 3)
            if key not in self.forgets:
                self._store(key, request[4 : 4 + size])
            answer = b"\x60" + request[1:4] + bytes(4)
        self.bus.reply(0x580 + self.node, answer, self.sdo_delay_ns)

    def _store(self, key: Key, data: bytes) -> None:
        self.objects[key] = data
        if key == (0x6060, 0):
            self.objects[0x6061, 0] = data
        if key == (0x6040, 0):
            self._obey(int.from_bytes(data, "little"))
        if key == (0x1017, 0) and self.value(*key) and not self._beating:
            self._beating = True
            self._beat()

    def _beat(self) -> None:
        if not self.silent:
            self.bus.reply(0x700 + self.node, bytes((self.state,)), 0)
        self.bus.later(self.value(0x1017) * 1_000_000, self._beat)

    def _obey(self, controlword: int) -> None:
        """Up one state a command, down at once."""
        status = self.value(0x6041)
        up = {(0x40, 0x06): 0x21, (0x21, 0x07): 0x23, (0x23, 0x0F): 0x27}
        if controlword & 0x02 == 0:
            status = 0x40
        status = up.get((status, controlword), status)
        self.objects[0x6041, 0] = (status if self.power_stays is None else self.power_stays).to_bytes(2, "little")

    def _pdos(self, communication: int, mapping: int) -> list[tuple[int, list[Key]]]:
        found = []
        for at in range(4):
            cob_id = self.value(communication + at, 1)
            if not cob_id & 0x8000_0000:
                entries = [self.value(mapping + at, sub + 1) for sub in range(self.value(mapping + at))]
                found.append((cob_id & 0x7FF, [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]))
        return found

    def _answer_sync(self) -> None:
        if self.mute_tpdos:
            return
        self.objects[0x6064, 0] = self.counts_at(self.bus.clock.now_ns()).to_bytes(4, "little", signed=True)
        for cob_id, keys in self._pdos(0x1800, 0x1A00):
            self.bus.reply(cob_id, self.tpdo_change(b"".join(self.objects[key] for key in keys)), self.tpdo_delay_ns)

    def _take_rpdo(self, can_id: int, data: bytes) -> None:
        for cob_id, keys in self._pdos(0x1400, 0x1600):
            if cob_id == can_id:
                for key in keys:
                    size = len(self.objects[key])
                    self._store(key, data[:size])
                    data = data[size:]


def epos4_objects(node: int, rated_torque_micro: int = 400_000) -> dict[Key, bytes]:
    """Values of such a drive after power-on: PDO 1 valid, type 255, and inhibit times."""
    objects: dict[Key, bytes] = {
        (0x1000, 0): (0x0002_0192).to_bytes(4, "little"),
        (0x1005, 0): (0x80).to_bytes(4, "little"),
        (0x100C, 0): bytes(2),
        (0x100D, 0): bytes(1),
        (0x1016, 1): bytes(4),
        (0x1017, 0): bytes(2),
        (0x1018, 1): (0xFB).to_bytes(4, "little"),
        (0x1018, 2): (0x6050_0000).to_bytes(4, "little"),
        (0x1018, 3): (0x0168_0000).to_bytes(4, "little"),
        (0x1018, 4): (0x1234).to_bytes(4, "little"),
        (0x6007, 0): (3).to_bytes(2, "little"),
        (0x603F, 0): bytes(2),
        (0x6040, 0): bytes(2),
        (0x6041, 0): (0x40).to_bytes(2, "little"),
        (0x605E, 0): (2).to_bytes(2, "little"),
        (0x6060, 0): bytes(1),
        (0x6061, 0): bytes(1),
        (0x6064, 0): bytes(4),
        (0x6071, 0): bytes(2),
        (0x6076, 0): rated_torque_micro.to_bytes(4, "little"),
        (0x6077, 0): bytes(2),
    }
    for at in range(4):
        invalid = 0 if at == 0 else 0x8000_0000
        for base, cob_id in ((0x1400, 0x200), (0x1800, 0x4000_0180)):
            objects[base + at, 1] = (invalid | cob_id + 0x100 * at + node).to_bytes(4, "little")
            objects[base + at, 2] = b"\xff"
            objects[base + at, 3] = (10).to_bytes(2, "little")
        for base in (0x1600, 0x1A00):
            objects[base + at, 0] = b"\x00"
            objects |= {(base + at, sub): bytes(4) for sub in range(1, 9)}
    return objects
