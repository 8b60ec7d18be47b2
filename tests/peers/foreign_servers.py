"""Foreign Modbus servers with a drive behind them, and starts of `run` on each.

`python -m tests.peers.foreign_servers` makes five starts of ten seconds on each server, at each rate and by each way,
and prints how many ran to their end and how many ended without the drive's confirmation. For that the machine must
have nothing else to do. Beside each start a bare timer sleeps on each processor. A start that ended early while a timer
was late itself is told and not counted: it is made again.
"""

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from haptic_fieldbus.running.loop import UNCONFIRMED
from tests.peers.hosts import PROJECT, line_of, start

SOURCE = Path(__file__).with_name("libmodbus_drive.c")
HEADER = "modbus/modbus.h"
LIBMODBUS, MODBUS_TK, PY_MODBUS_TCP = "libmodbus", "modbus-tk", "pyModbusTCP"
NAGLE, NODELAY = "nagle", "nodelay"
SERVERS = ((LIBMODBUS, NAGLE), (LIBMODBUS, NODELAY), (MODBUS_TK, NAGLE), (MODBUS_TK, NODELAY), (PY_MODBUS_TCP, NODELAY))
"""Libraries and whether they use Nagle's algorithm; pyModbusTCP never does."""
RATES = (1000, 200)
"""[Hz]"""
WAYS = {"FC23": "[3, 23]", "FC3 + FC16": "[3, 16]"}
"""Way of exchange → functions of the drive."""
PROFILE, PRIORITY = "foreign_drive", 40
UNTIMELY = ("feedback lost: the last from node", "feedback lost too often", "the loop missed", "the loop slept")
"""Parts of the sentences by which a run ends that computer or server kept waiting."""
WITHHELD = 0.015
"""A machine that was late by so much itself [s], half of the age that ends a run, keeps no loop in time."""
MOST_REPEATED = 3
"""Starts of a line that are made again."""
TIMER = """
import os, sys, threading, time
from contextlib import suppress
os.sched_setaffinity(0, [int(sys.argv[1])])
with suppress(OSError):
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
ended = []
threading.Thread(target=lambda: ended.append(sys.stdin.read()), daemon=True).start()
largest, due = 0.0, time.monotonic()
while not ended:
    due += 0.001
    time.sleep(max(0.0, due - time.monotonic()))
    late = time.monotonic() - due
    largest, due = max(largest, late), due + max(0.0, late)
print(largest)
"""
REASONS = ("failed", "tripped", "refused")
"""Begins of the line that tells why a run ended early."""
RIG = """
[bus.line]
interface = "modbus-tcp"
channel = "127.0.0.1:{port}"

[axis.handle]
bus = "line"
node = 1
profile = "{profile}"
encoder_counts_per_revolution = 4096
rated_torque = 0.4
torque_constant = 0.05
rated_current = 8.0
peak_current = 20.0
inertia = 4e-5
viscous_damping = 0.0001
coulomb_friction = 0.002

[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05

[axis.handle.limits]
speed = 10.0
position = [-0.1, 0.1]

[axis.handle.seen]
direction = "confirmed"
"""


@dataclass(frozen=True)
class Line:
    """One server, and how it is talked to."""

    library: str
    nagle: str
    rate: int
    way: str

    def __str__(self) -> str:
        return f"{self.library}, {self.nagle}, {self.rate} Hz, {self.way}"


LINES = tuple(Line(*server, rate, way) for server in SERVERS for rate in RATES for way in WAYS)


@dataclass(frozen=True)
class End:
    """How a run ended."""

    status: int
    said: str
    withheld: float = 0.0
    """How late a bare timer beside it was at most [s]."""

    @property
    def counted(self) -> bool:
        """It says something about the program: it ran to its end, or the machine was in time."""
        return self.rendered or not self.untimely or self.withheld < WITHHELD

    @property
    def rendered(self) -> bool:
        """It ran to its end, and the handle was in the wall."""
        return self.status == 0 and "no trip" in self.said and "deep in wall" in self.said

    @property
    def reason(self) -> str:
        """The line that tells why it ended early; empty without one."""
        return next((line for line in self.said.splitlines() if line.startswith(REASONS)), "")

    @property
    def confirmed(self) -> bool:
        """The drive said that its motor is off."""
        return UNCONFIRMED not in self.said

    @property
    def untimely(self) -> bool:
        """It ended torque-free because feedback came too late."""
        return self.confirmed and any(words in self.reason for words in UNTIMELY)


def compiled(folder: Path) -> Path:
    """The C program; skips, and says so, where compiler or library are missing."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("cc is not installed: apt-get install gcc libc6-dev")
    probe = subprocess.run(
        [compiler, "-E", "-xc", "-"], input=f"#include <{HEADER}>\n", text=True, capture_output=True, check=False
    )
    if probe.returncode:
        pytest.skip("libmodbus is not installed: apt-get install libmodbus-dev")
    program = folder / "libmodbus_drive"
    if not program.exists():
        flags = ("-O2", "-Wall", "-Wextra", "-Werror")
        subprocess.run([compiler, *flags, "-o", program, SOURCE, "-lmodbus", "-lm"], check=True)
    return program


def _like_a_device() -> None:
    """A drive has a processor of its own; where that is permitted its process goes before ordinary ones."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


@contextmanager
def served(line: Line, folder: Path) -> Iterator[int]:
    """A drive behind this server, in a process of its own; its port."""
    if line.library == LIBMODBUS:
        command = [str(compiled(folder)), line.nagle]
    else:
        command = [sys.executable, "-m", "tests.peers.python_drive", line.library, line.nagle]
    process = subprocess.Popen(
        command, cwd=PROJECT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_like_a_device
    )
    try:
        yield int(line_of(process))
        assert process.poll() is None, "the server ended"
    finally:
        process.kill()
        process.communicate()


@contextmanager
def bare_timers() -> Iterator[list[float]]:
    """A timer on each processor; afterwards how late each was at most [s]."""
    latest: list[float] = []
    command = [sys.executable, "-c", TIMER]
    timers = [
        subprocess.Popen([*command, str(processor)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for processor in os.sched_getaffinity(0)
    ]
    try:
        yield latest
    finally:
        latest += [float(timer.communicate("end")[0]) for timer in timers]


def run_on(line: Line, folder: Path, duration: float) -> End:
    """One start of `run` on a server that was just started: the guard is proved, then a wall is rendered."""
    profile = (PROJECT / "profiles" / "generic_cia402_modbus.toml").read_text(encoding="utf-8")
    changed = profile.replace("functions = [3, 4, 6, 16, 23]", f"functions = {WAYS[line.way]}")
    assert changed != profile
    (folder / f"{PROFILE}.toml").write_text(changed, encoding="utf-8")
    with served(line, folder) as port:
        rig = folder / "rig.toml"
        rig.write_text(RIG.format(port=port, profile=PROFILE), encoding="utf-8")
        settings = ("--set", "wall.stiffness=max/2", "--set", "wall.position=0.003")
        length = ("--rate", str(line.rate), "--duration", str(duration), "--yes")
        process = start("run", "wall", "--profiles", str(folder), "--rig", str(rig), *settings, *length, port=None)
        out, err = process.communicate(timeout=60.0 + duration)
    assert "drive watchdog fired" in out + err or process.returncode != 0, out + err
    return End(process.returncode, out + err)


def counted(line: Line, folder: Path, starts: int, duration: float) -> Iterator[End]:
    """So many starts beside bare timers; those that the machine itself ended are told and made again."""
    repeats = MOST_REPEATED
    while starts:
        with bare_timers() as latest:
            end = run_on(line, folder, duration)
        end = replace(end, withheld=max(latest))
        if repeats and not end.counted:
            repeats -= 1
            print(f"    again: the machine was {1e3 * end.withheld:.0f} ms late itself: {end.reason}", flush=True)
        else:
            starts -= 1
            yield end


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--starts", type=int, default=5)
    options.add_argument("--duration", type=float, default=10.0, help="of each start [s]")
    options.add_argument("--only", default="", help="lines whose name contains this")
    asked = options.parse_args()
    missing = 0
    with TemporaryDirectory() as folder:
        for line in (each for each in LINES if asked.only in str(each)):
            ends = list(counted(line, Path(folder), asked.starts, asked.duration))
            rendered, unconfirmed = sum(end.rendered for end in ends), sum(not end.confirmed for end in ends)
            missing += len(ends) - rendered + unconfirmed
            print(f"{line!s:45} {rendered} of {len(ends)} ran to the end, {unconfirmed} unconfirmed", flush=True)
            for end in ends:
                if not end.rendered:
                    print(f"    a timer was {1e3 * end.withheld:.0f} ms late: {end.reason}")
    raise SystemExit(missing > 0)


if __name__ == "__main__":
    main()
