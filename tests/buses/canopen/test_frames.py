"""Files of frames: what a killed process leaves, and a disk that takes no more."""

import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from haptic_fieldbus.buses.canopen.frames import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, frame_logs, open_frame_writer

FULL = Path("/dev/full")
SUFFIXES = pytest.mark.parametrize("suffix", [".log", ".blf"])
LONG = 40_000
"""Frames of several chunks in each format."""


def read(path: Path) -> list[int]:
    """Identifiers of all frames, as python-can reads them."""
    with can.LogReader(path) as reader:
        return [message.arbitration_id for message in reader]


@SUFFIXES
def test_what_a_killed_process_leaves_can_be_read(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    child = os.fork()
    if child == 0:
        writer = open_frame_writer(path)
        for k in range(LONG):
            if writer is not None:
                writer(k * 250_000, k % 0x7FF, bytes(8))
        os.kill(os.getpid(), signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WTERMSIG(status) == signal.SIGKILL
    found = read(path)
    assert LONG > len(found) > LONG - 4000
    assert found == [k % 0x7FF for k in range(len(found))]


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """A limit of the process on the size of files [octets], as a disk that fills up."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@SUFFIXES
def test_a_disk_that_fills_up_ends_the_log_and_nothing_else(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    noted = 0

    def record() -> None:
        nonlocal noted
        with frame_logs(path, ["can0"]) as logs:
            for k in range(LONG):
                logs["can0"](k * 250_000, k % 0x7FF, os.urandom(8))
                noted += 1

    with files_up_to(200_000), pytest.raises(OSError, match="File too large"):
        record()
    assert noted == LONG, "no frame raised"
    found = read(path)
    assert len(found) > 3000
    assert found == [k % 0x7FF for k in range(len(found))]


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_full_disk_is_told_when_the_log_ends(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.symlink_to(FULL)

    def record() -> None:
        with frame_logs(path, ["left", "right"]) as logs:
            for k in range(LONG):
                logs["left"](k, 0x80, b"")

    with pytest.raises(OSError, match="No space left"):
        record()


@pytest.mark.thorough("4 cases of one rule", quick=1)
@SUFFIXES
@pytest.mark.parametrize("buses", [["can0"], ["left arm", "right"]], ids=["one bus", "two buses"])
def test_another_process_writes_the_same_file_as_this_one(suffix: str, buses: list[str], tmp_path: Path) -> None:
    """Remote, extended and error frames and an empty one among them."""
    paths = [tmp_path / f"{name}{suffix}" for name in ("here", "there")]
    flags = (0, REMOTE_FLAG, EXTENDED_FLAG, ERROR_FLAG)
    for path, simulated in zip(paths, (True, False), strict=True):
        with frame_logs(path, buses, simulated=simulated) as logs:
            for k in range(3000):
                can_id = k % 0x7FF | flags[k % 16 % 4 if k % 16 < 4 else 0]
                logs[buses[k % len(buses)]](k * 250_000, can_id, bytes(range(k % 9)) if k % 4 != 1 else b"")
    here, there = ([(each.timestamp, each.channel, str(each)) for each in can.LogReader(path)] for path in paths)
    assert here == there
    assert len(there) == 3000


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_full_disk_of_another_process_ends_the_log_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.symlink_to(FULL)
    noted = 0

    def record() -> None:
        nonlocal noted
        with frame_logs(path, ["can0"], simulated=False) as logs:
            for k in range(LONG):
                logs["can0"](k, 0x80, b"")
                noted += 1

    with pytest.raises(OSError, match="No space left"):
        record()
    assert noted == LONG, "no frame raised"


def test_a_log_of_another_process_that_cannot_be_made_is_refused_at_once(tmp_path: Path) -> None:
    with (
        pytest.raises(OSError, match="No such file"),
        frame_logs(tmp_path / "nowhere" / "run.log", ["can0"], simulated=False),
    ):
        pass


def test_an_error_of_the_run_is_not_hidden_by_one_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.symlink_to(FULL)

    def record() -> None:
        with frame_logs(path, ["can0"]) as logs:
            logs["can0"](0, 0x80, b"")
            raise RuntimeError("the run")

    with pytest.raises(RuntimeError, match="the run"):
        record()
