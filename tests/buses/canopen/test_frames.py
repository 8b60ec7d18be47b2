"""Files of frames: what a killed process leaves, and a disk that takes no more."""

import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from haptic_fieldbus.buses.canopen.frames import frame_logs, open_frame_writer

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


def test_an_error_of_the_run_is_not_hidden_by_one_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.symlink_to(FULL)

    def record() -> None:
        with frame_logs(path, ["can0"]) as logs:
            logs["can0"](0, 0x80, b"")
            raise RuntimeError("the run")

    with pytest.raises(RuntimeError, match="the run"):
        record()
