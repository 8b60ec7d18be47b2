"""The processor time of each step of hosted drives: frames in, plant, frames out, from *ready* on.

A master in the same thread asks for feedback and gives set-points at 1 kHz while a hand pushes into a wall. Every call
of `Host.serve` is one step. Its processor time is that of the thread, so other programs do not count.

    python benchmarks/hosted_step.py [--drives N] [--seconds S] [--hand NAME]
"""

import argparse
import struct
import time

import can
import numpy as np

from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.hosting import Host, HostPort
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.host_request import NamedDrive, slot_of

PERIOD_NS = 1_000_000
STIFFNESS, PLACE = 600.0, 0.002
METRES_PER_COUNT = 0.05 / 4096
PERMILLE = 0.4e-3 / (0.05 / 6.283185307)
"""Force of one thousandth of rated torque [N]."""


class Bench:
    """Hosted drives and their master on two ends of a virtual bus."""

    def __init__(self, drives: int, hand: str) -> None:
        self.theirs = can.Bus(interface="virtual", channel="step")
        self.ours = can.Bus(interface="virtual", channel="step")
        self.steps: list[int] = []
        self.sent = 0
        clock = MonotonicClock()
        self.nodes = range(5, 5 + drives)
        self.host = Host(HostPort(self.theirs, clock, "virtual:step", print), clock)
        for node in self.nodes:
            self.host.add(
                slot_of(NamedDrive("generic_cia402", node), "", Workspace.LINEAR, hand_named(hand), booted=False)
            )
        self.host.serve_for(1_000_000)
        self.steps.clear()

    def serve(self) -> None:
        """Serve everything that has come, timed."""
        for _ in range(1 + self.sent):
            began_ns = time.thread_time_ns()
            self.host.serve(0)
            self.steps.append(time.thread_time_ns() - began_ns)
        self.sent = 0

    def close(self) -> None:
        self.theirs.shutdown()
        self.ours.shutdown()

    def send(self, can_id: int, data: bytes) -> None:
        self.ours.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self.sent += 1

    def configure(self) -> None:
        for node in self.nodes:
            for index, subindex, value, size in (
                (0x1800, 1, 1 << 31 | 0x180 + node, 4), (0x1800, 2, 1, 1), (0x1A00, 0, 0, 1),
                (0x1A00, 1, 0x6041_0010, 4), (0x1A00, 2, 0x6064_0020, 4), (0x1A00, 0, 2, 1),
                (0x1800, 1, 0x180 + node, 4), (0x6060, 0, 10, 1),
                (0x1400, 1, 1 << 31 | 0x200 + node, 4), (0x1600, 0, 0, 1), (0x1600, 1, 0x6040_0010, 4),
                (0x1600, 2, 0x6071_0010, 4), (0x1600, 0, 2, 1), (0x1400, 1, 0x200 + node, 4),
            ):  # fmt: skip
                head = {1: 0x2F, 4: 0x23}[size]
                self.send(0x600 + node, struct.pack("<BHBI", head, index, subindex, value))
                self.serve()
        self.send(0, bytes((1, 0)))
        self.serve()

    def period(self) -> None:
        """SYNC, the feedback of each drive, and a set-point from it."""
        self.send(0x80, b"")
        self.serve()
        for message in iter(lambda: self.ours.recv(0), None):
            if message.arbitration_id & 0x780 == 0x180:
                status, counts = struct.unpack("<Hi", message.data)
                word = {0x40: 0x06, 0x21: 0x07}.get(status & 0x6F, 0x0F)
                force = -STIFFNESS * max(0.0, counts * METRES_PER_COUNT - PLACE)
                target = max(-1000, round(force / PERMILLE))
                self.send(0x80 + message.arbitration_id, struct.pack("<Hh", word, target))
        self.serve()

    def run(self, seconds: float) -> None:
        self.configure()
        deadline_ns = time.monotonic_ns()
        for _ in range(round(seconds * 1e9 / PERIOD_NS)):
            deadline_ns += PERIOD_NS
            while (left_ns := deadline_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns * 1e-9)
            self.period()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--drives", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--hand", default="push")
    options = parser.parse_args()
    bench = Bench(options.drives, options.hand)
    bench.run(options.seconds)
    bench.close()
    steps = np.array(bench.steps) * 1e-3
    p50, p99, p999 = np.percentile(steps, [50.0, 99.0, 99.9])
    print(f"{len(steps)} steps of {options.drives} drives: p50 {p50:.0f} µs, p99 {p99:.0f}, p99.9 {p999:.0f}")
    for place in np.argsort(steps)[-3:][::-1]:
        print(f"  {steps[place]:.0f} µs in step {place}")


if __name__ == "__main__":
    main()
