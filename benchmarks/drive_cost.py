"""Cost of one simulated drive in a period: SYNC in, TPDO out, RPDO in, and its motor between them.

The reference is 1/1000 of the time that starting Python takes, 10 µs on the machine of reference, where 15 µs are
allowed: a ratio of 1.5.
"""

import struct
import subprocess
import sys
from contextlib import ExitStack
from itertools import count
from time import perf_counter

from rows import Figure, Pair, Row, cost, show

from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named

NODE = 5
PERIOD_NS = 1_000_000
ANSWER_NS = 100_000
"""From SYNC to the end of the RPDO."""
ALLOWED = 1.5


class Period:
    """One drive in operation enabled, with frames given to it as the world would."""

    def __init__(self, hand: str = "none") -> None:
        self.sent: list[Frame] = []
        axis = default_axis(Workspace.LINEAR, bus="bus", node=NODE, profile="maxon_epos4")
        slot = DriveOnBus(NODE, load_profile("maxon_epos4"), axis, hand_named(hand))
        self.slave = Slave(slot, self.sent.append)
        self.slave.power_on(0, booted=True)
        self._configure()
        self._rpdo = Frame(0x200 + NODE, struct.pack("<Hh", 0x0F, 20))
        self._sync = Frame(0x80, b"")
        self._times = count(PERIOD_NS, PERIOD_NS)

    def _configure(self) -> None:
        for communication, can_id, kind, entries in (
            (0x1800, 0x180 + NODE, 1, (0x6041_0010, 0x6064_0020)),
            (0x1400, 0x200 + NODE, 255, (0x6040_0010, 0x6071_0010)),
        ):
            self._write(communication, 1, can_id | 1 << 31, 4)
            self._write(communication, 2, kind, 1)
            self._write(communication + 0x200, 0, 0, 1)
            for number, entry in enumerate(entries, start=1):
                self._write(communication + 0x200, number, entry, 4)
            self._write(communication + 0x200, 0, len(entries), 1)
            self._write(communication, 1, can_id, 4)
        self._write(0x6060, 0, 10, 1)
        self.slave.receive(Frame(0, bytes((1, NODE))), 0)
        for controlword in (0x06, 0x07, 0x0F):
            self.slave.receive(Frame(0x200 + NODE, struct.pack("<Hh", controlword, 0)), 0)

    def _write(self, index: int, subindex: int, value: int, size: int) -> None:
        head = bytes((0x23 | (4 - size) << 2, *index.to_bytes(2, "little"), subindex))
        self.slave.receive(Frame(0x600 + NODE, head + value.to_bytes(4, "little")), 0)
        assert self.sent[-1].data[0] == 0x60, self.sent[-1]

    def __call__(self) -> None:
        slave, sent, t_ns = self.slave, self.sent, next(self._times)
        while slave.due_ns < t_ns:
            slave.timer(slave.due_ns)
        sent.clear()
        slave.receive(self._sync, t_ns)
        assert sent[0].can_id == 0x180 + NODE
        t_ns += ANSWER_NS
        while slave.due_ns < t_ns:
            slave.timer(slave.due_ns)
        slave.receive(self._rpdo, t_ns)


def reference() -> float:
    """1/1000 of a Python start [s]."""

    def once() -> float:
        begun = perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        return perf_counter() - begun

    return min(once() for _ in range(20)) / 1000


def pair(_: ExitStack) -> Pair:
    period = Period("sine")
    return lambda: (cost(period, 1000, 5), reference())


FIGURES = (Figure("simulated drive with a hand, one period", "1/1000 of starting Python", ALLOWED, pair),)


def rows() -> list[Row]:
    allowed = reference()
    return [
        Row(f"drive, {name}", cost(Period(hand), 2000, 15), allowed, ALLOWED)
        for name, hand in (("no hand", "none"), ("a hand", "sine"))
    ]


if __name__ == "__main__":
    show(rows())
