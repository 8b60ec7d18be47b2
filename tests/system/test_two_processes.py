"""`simulate` and `run` at 1 kHz as two real processes: how it ends, which is all that a busy machine can promise."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.peers.hosts import free_port, require_multicast

PROJECT = Path(__file__).resolve().parents[2]


@pytest.mark.thorough("ten seconds of real time")
@pytest.mark.xdist_group("peers")
def test_ten_seconds_end_by_themselves_or_torque_free_with_a_reason() -> None:
    """Frames of multicast are delivered by a thread of the kernel without real-time rights, which other tests delay."""
    require_multicast(free_port())
    command = [sys.executable, "benchmarks/two_processes.py", "--starts", "1", "--seconds", "10"]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    (start,) = [line for line in done.stdout.splitlines() if line.startswith("  1")]
    ends = ("went to its end", "torque is off", "not confirmed")
    assert any(end in start for end in ends), done.stdout + done.stderr
    assert "times the timer's" in done.stdout, done.stdout + done.stderr
