"""`simulate` and `run` as two processes on a SocketCAN interface, and a third program that watches the drive."""

import errno
import json
import math
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.planning.deadlines import REMAINDER, EndCause
from tests.peers.hosts import hear_signals
from tests.vcan.links import Link

PROJECT = Path(__file__).parents[2]
NODE = 5
TPDO, RPDO, EMCY, HEARTBEAT = 0x180 + NODE, 0x200 + NODE, 0x080 + NODE, 0x700 + NODE
SETTING = ("wall.stiffness", "max/2")
PUSHING = 30
"""Target torque with which the master pushes [‰ of rated torque]."""
OPERATION_ENABLED, STATE = 0x27, 0x6F
STARTS_WITHIN = 120.0
"""[s] A Python process, in a guest kernel on a busy machine."""
RATES = (200.0, 200.0, 200.0, 100.0, 100.0, 50.0, 50.0, 25.0)
"""[Hz] of one attempt after the other, on a machine so busy that the loop ends before anything happens to it."""
BUSY = {"feedback lost", "feedback lost too often", "periods missed", "emergency"}
"""Ends of a run on a machine that lets a process wait for longer than the deadlines of the run."""
RIG = """
[bus.can]
interface = "socketcan"
channel = "{channel}"

[axis.handle]
bus = "can"
node = 5
profile = "generic_cia402"
encoder_counts_per_revolution = 4096
rated_torque = 0.4
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
limits = {{ speed = 100.0, acceleration = 1.0e6 }}
"""
"""The shipped bench. A host that is late makes samples jump, so motion is hardly limited here."""


def start(*words: str) -> "subprocess.Popen[str]":
    """Start the command line, which takes Ctrl-C as from a terminal."""
    return subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", *words],
        cwd=PROJECT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_signals,
    )


@dataclass
class Watcher:
    """The drive as another program on the bus sees it."""

    bus: can.BusABC
    slowest: float = 0.0
    """Longest time in which the drive answered [s]: how late this computer is."""
    heard: list[can.Message] = field(default_factory=list)

    def receive(self, seconds: float) -> can.Message | None:
        try:
            message = self.bus.recv(seconds)
        except can.CanOperationError as error:
            if error.error_code != errno.ENETDOWN:
                raise
            return None  # the kernel tells it once, after an interface was down that may be up again
        if message is not None:
            self.heard.append(message)
        return message

    def is_pushed(self, master: "subprocess.Popen[str]") -> bool:
        """Wait until a set-point of the master pushes; False when the master ends before."""
        end = time.monotonic() + STARTS_WITHIN
        while time.monotonic() < end and master.poll() is None:
            message = self.receive(0.1)
            if message is not None and message.arbitration_id == RPDO and len(message.data) == 4:
                controlword, torque = struct.unpack("<Hh", message.data)
                if controlword == 0x0F and abs(torque) >= PUSHING:
                    return True
        return False

    def read(self, index: int) -> int:
        """Upload an object of 16 bit by SDO."""
        while self.receive(0.0) is not None:
            pass
        asked, request = time.monotonic(), b"\x40" + index.to_bytes(2, "little") + bytes(5)
        sent = -math.inf
        while time.monotonic() < asked + STARTS_WITHIN:
            if time.monotonic() > sent + 1.0:  # a socket that is full, as in a storm, loses frames
                sent = time.monotonic()
                self.bus.send(can.Message(arbitration_id=0x600 + NODE, data=request, is_extended_id=False))
            message = self.receive(0.1)
            if message is not None and message.arbitration_id == 0x580 + NODE and message.data[1:3] == request[1:3]:
                self.slowest = max(self.slowest, time.monotonic() - asked)
                return int(struct.unpack_from("<h", message.data, 4)[0])
        raise AssertionError("the simulated drive does not answer")

    def last_torque(self, since: float) -> float:
        """Ask for the torque actual until it is zero; latest time since then at which there still was torque [s]."""
        last = 0.0
        while (asked := time.monotonic() - since) < 10.0:
            if abs(self.read(0x6077)) <= REMAINDER * 1000:
                return last
            last = asked
        raise AssertionError("torque never ended")

    def is_free(self) -> bool:
        """Whether the drive is neither enabled nor gives torque."""
        return self.read(0x6041) & STATE != OPERATION_ENABLED and self.read(0x6077) == 0


class Busy(Exception):
    """The computer was too late for the run to go on until it was to end."""


@dataclass
class Rendering:
    """The two processes, while a hand leans on the wall."""

    link: Link
    drive: "subprocess.Popen[str]"
    master: "subprocess.Popen[str]"
    watcher: Watcher
    rig: Path
    rate: float

    def stated(self, cause: EndCause) -> float:
        """Times that the plan of this run states [s]."""
        compiled = plan("wall", rig=self.rig, rate=self.rate, settings=dict([SETTING]))
        return next(each.seconds for each in compiled.deadlines if each.cause is cause)

    def ended(self, *trips: str) -> tuple[str, dict[str, Any]]:
        """Wait for the end of the master by these trips: what it said to people, and its result. Raises Busy."""
        out, told = self.master.communicate(timeout=STARTS_WITHIN)
        result = json.loads(out)
        found = [each["name"] for each in result["trips"]]
        if found != list(trips) and set(found) & BUSY:
            raise Busy(told)
        assert found == list(trips), told
        return told, result


def tried(
    body: Callable[[Rendering], None], link: Link, rig: Path, *, duration: float = 60.0, faults: str = ""
) -> None:
    """Call `body` while a hand leans on a wall, at the highest rate at which this computer is in time.

    The rig keeps the proof of the guard from the first run on.
    """
    said: object = None
    for rate in RATES:
        try:
            with _rendering(link, rig, rate, duration, faults) as run:
                body(run)
                return
        except Busy as busy:
            said = busy
            rig.unlink(missing_ok=True)  # the guard of a drive in a process that waits may have been late, and be noted
    pytest.skip(f"this machine is too busy to render a wall at {RATES[-1]:g} Hz in a guest kernel: {said}")


@contextmanager
def _rendering(link: Link, rig: Path, rate: float, duration: float, faults: str) -> Iterator[Rendering]:
    if not rig.exists():
        rig.write_text(RIG.format(channel=link.name), encoding="utf-8")
    hosted = ["simulate", "--drive", f"generic_cia402@{NODE}", "--bus", f"{link.bus}@1000000", "--hand", "push"]
    if faults:
        file = rig.with_name("faults.toml")
        file.write_text(faults, encoding="utf-8")
        hosted += ["--faults", str(file)]
    rendered = ["run", "wall", "--rig", str(rig), "--yes", "--json", "--set", "=".join(SETTING)]
    rendered += ["--rate", f"{rate:g}", "--duration", f"{duration:g}"]
    processes = [start(*hosted)]
    try:
        (drive,) = processes
        assert drive.stdout is not None
        assert drive.stdout.readline(), drive.communicate()[1]
        with can.Bus(interface="socketcan", channel=link.name) as bus:
            watcher, master = Watcher(bus), start(*rendered)
            processes.append(master)
            if not watcher.is_pushed(master):
                raise Busy(master.communicate()[1])
            yield Rendering(link, drive, master, watcher, rig, rate)
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
            process.communicate()
