"""Command `bench` ended by a signal: no traceback, the status of the signal, and no process left."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from tests.cli.test_interrupted import STATUS

BENCH = [sys.executable, "-m", "haptic_fieldbus", "bench", "--only", "Modbus TCP"]
WITHIN = 60.0
"""Time for a process to start or to end [s]."""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the processes from /proc")


def marked(mark: str) -> dict[int, str]:
    """Command lines by process of all processes with this mark in their environment; without zombies."""
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal() and int(folder.name) != os.getpid():
            try:
                words = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                if words and mark.encode() in (folder / "environ").read_bytes():
                    found[int(folder.name)] = words
            except OSError:
                continue
    return found


def imports(process: int) -> bool:
    """Whether a process has begun to import what the benchmarks need."""
    return "numpy" in Path(f"/proc/{process}/maps").read_text(encoding="utf-8")


def listens(process: int) -> bool:
    """Whether a process has a socket."""
    return any(os.readlink(each).startswith("socket:") for each in Path(f"/proc/{process}/fd").iterdir())


BEGUN: dict[str, Callable[[int], bool]] = {"benchmarks/bench.py": imports, "modbus_exchange.py serve": listens}
"""Part of the command line of a process, and whether it is so far that a signal would show a traceback."""


def await_process(mark: str, words: str) -> None:
    deadline = time.monotonic() + WITHIN
    while time.monotonic() < deadline:
        with suppress(OSError):
            if any(words in each and BEGUN[words](process) for process, each in marked(mark).items()):
                return
        os.sched_yield()
    pytest.fail(f"{words} has not started")


@pytest.mark.thorough("starts the benchmarks", quick=1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
@pytest.mark.parametrize("send", [os.kill, os.killpg], ids=["alone", "group"])
@pytest.mark.parametrize("begun", BEGUN)
def test_a_signal_ends_all_processes(
    number: signal.Signals, send: Callable[[int, int], None], begun: str, tmp_path: Path
) -> None:
    """To the command alone, as `kill` does it, and to its process group, as a terminal does for Ctrl-C."""
    mark = f"BENCH_ENDED={tmp_path.name}-{number.name}-{os.getpid()}"
    environment = {**os.environ, "BENCH_ENDED": mark.partition("=")[2]}
    process = subprocess.Popen(
        BENCH, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    try:
        await_process(mark, begun)
        send(process.pid, number)
        out, err = process.communicate(timeout=WITHIN)
        left = marked(mark)
    finally:
        process.kill()
        for each in marked(mark):
            os.kill(each, signal.SIGKILL)
    who = "you" if number is signal.SIGINT else number.name
    assert (process.returncode, out, err) == (STATUS[number], "", f"stopped by {who}\n")
    assert left == {}
