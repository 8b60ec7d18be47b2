"""Readers that are killed and pages that flood the run: it goes on, and nothing grows without bound."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.live import Live, folder
from haptic_fieldbus.running.loop import threads_give_way
from tests.running.test_live import Watcher
from tests.view.served import GROWTH, Served, children, memory_of, serving
from tests.view.test_server import begun, connected, told

pytestmark = [
    pytest.mark.thorough("attacks a server and a run"),
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]
TIMES = 50
VERSIONS = ("3.11", "3.12", "3.13")
READER = """
import json, mmap, socket, struct, sys
run = socket.socket(socket.AF_UNIX)
run.connect(sys.argv[1])
line, fds, _, _ = socket.recv_fds(run, 65536, 1)
while not line.endswith(b"\\n"):
    line += run.recv(65536)
width = len(json.loads(line.splitlines()[0])["hello"]["columns"])
memory = mmap.mmap(fds[0], 0, access=mmap.ACCESS_READ)
magic, columns, capacity, _ = struct.unpack_from("@8sIIQ", memory)
assert (magic, columns) == (b"HFRING1\\0", width)
while True:
    pushed = struct.unpack_from("@Q", memory, 16)[0]
    slot = struct.unpack_from(f"{width + 2}d", memory, 64 + (pushed - 1) % capacity * 8 * (width + 2))
    if slot[0] == slot[-1] == pushed:
        print(pushed, flush=True)
"""
"""A reader by the layout of the ring alone: it needs nothing but the standard library."""


def interpreter(version: str) -> str:
    """Return an interpreter of a version; skips the test where none works."""
    own = sys.executable if sys.version_info[:2] == tuple(map(int, version.split("."))) else None
    kept = [str(path) for path in (Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python3")]
    for found in (own, *kept, shutil.which(f"python{version}")):
        if found is not None and subprocess.run([found, "-c", ""], check=False, capture_output=True).returncode == 0:
            return found
    pytest.skip(f"needs an interpreter of Python {version}")


def descriptors(pid: int) -> int:
    return len(os.listdir(f"/proc/{pid}/fd"))


@pytest.fixture
def served() -> Iterator[Served]:
    with serving("demo", "--no-browser", "--port", "0") as found:
        yield found


def watching(served: Served) -> Watcher:
    """Attach to the run, and wait for a row with torque."""
    watcher = Watcher(folder() / f"{served.process.pid}.sock")
    watcher.until("hello")
    watcher.row_where("enabled", lambda value: value == 1.0)
    return watcher


@pytest.mark.parametrize("version", VERSIONS)
def test_the_ring_lives_on_when_readers_are_killed_one_after_another(served: Served, version: str) -> None:
    words = [interpreter(version), "-I", "-c", READER, str(folder() / f"{served.process.pid}.sock")]
    watcher = watching(served)
    open_before, seen = descriptors(served.process.pid), []
    for _ in range(TIMES):
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as reader:
            assert reader.stdout is not None
            seen.append(int(reader.stdout.readline()))
            reader.kill()
    assert seen == sorted(seen)
    assert seen[-1] > seen[0]
    watcher.reader.send({"change": {"wall.stiffness": 700.0}})
    assert watcher.until("changed") == {"wall.stiffness": 700.0}
    assert watcher.ring is not None
    pushed = watcher.ring.pushed
    watcher.row_where("t_ns", lambda value: watcher.ring is not None and watcher.ring.pushed > pushed + 100)
    assert descriptors(served.process.pid) <= open_before + 1  # that of the last reader may still be noticed
    watcher.reader.close()


def test_a_page_that_floods_the_run_is_refused_and_neither_delays_stop_nor_fills_memory(served: Served) -> None:
    page, other = connected(served, "page"), connected(served, "other")
    begun(page)
    (server,) = children(served.process.pid)
    before = [memory_of(server), memory_of(served.process.pid)]
    for number in range(3000):
        page.send(json.dumps({"change": {"wall.stiffness": 500 + number % 200}}))
        page.send('{"pull": ["handle", 0.01]}')
        page.send('{"speed": 1.0, "steps": 1, "hand": "none"}')
    assert told(page, "refused").startswith(("too many commands", "8 changes wait"))
    grown = [memory_of(pid) - was for pid, was in zip((server, served.process.pid), before, strict=True)]
    assert max(grown) < GROWTH
    other.send('{"stop": true}')
    status, out, _ = served.ended()
    assert (status, "no trip" in out) == (130, True)
    page.close()
    other.close()


FLOOD = """
import socket, sys
run = socket.socket(socket.AF_UNIX)
run.connect(sys.argv[1])
run.setblocking(False)
print("ready", flush=True)
while True:
    try:
        run.sendall(b'{"speed": 1.0, "pull": ["handle", 0.01]}\\n')
        run.recv(65536)
    except BlockingIOError:
        pass
"""
BLOCKS, PERIODS = 16, 250
"""Blocks of a measurement, quiet and attacked by turns, and periods of 1 ms in each."""
RATIO, SLACK = 3.0, 5e-4
"""Bound of the median lateness under attack: a multiple of the quiet one, and a time beside it [s]."""


def test_a_reader_that_floods_the_run_leaves_its_loop_as_punctual_as_without_it() -> None:
    found, clock = plan("wall"), MonotonicClock()
    row = tuple(float(number) for number in range(len(columns(found))))
    late: dict[bool, list[float]] = {False: [], True: []}
    with Live(lambda *_: {}) as live, threads_give_way():
        record = Record(columns(found), BLOCKS * PERIODS)
        live.follow(found, record)
        live.begin(found, Cycle(found), LoopReport(), None, EndSignals())
        words = [sys.executable, "-I", "-c", FLOOD, str(live.path)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as flood:
            assert flood.stdout is not None
            assert flood.stdout.readline() == "ready\n"
            for block in range(BLOCKS):
                attacked = block % 2 == 1
                os.kill(flood.pid, signal.SIGCONT if attacked else signal.SIGSTOP)
                deadline_ns = clock.now_ns() + found.period_ns
                for _ in range(PERIODS):
                    late_ns = clock.sleep_until(deadline_ns)
                    record.push(row)
                    late[attacked].append(1e-9 * late_ns)
                    deadline_ns += (1 + late_ns // found.period_ns) * found.period_ns
            flood.kill()
    quiet, attacked_too = (float(np.median(late[each])) for each in (False, True))
    assert attacked_too < RATIO * quiet + SLACK
