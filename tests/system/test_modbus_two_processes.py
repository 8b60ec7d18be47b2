"""`simulate` and `run` as two processes over Modbus: TCP on loopback, RTU over a pair of pseudo-terminals.

The rate is one at which a busy machine is in time. What cannot be promised there, that a run goes to its end, is not
asked for: it ends by itself, or torque-free with a reason.
"""

import re
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.peers.hosts import STARTS_WITHIN, line_of, start
from tests.sim.modbus.test_line import tcp
from tests.sim.modbus.units import DEMAND, STATUS

TCP, RTU = "modbus-tcp:127.0.0.1:0", "modbus-rtu:pty"
RATE, HAND = {TCP: "200", RTU: "100"}, {TCP: "push", RTU: "tap"}
FAULT, ENABLED = 0x08, 0x27


@contextmanager
def simulated(bus: str, rig: Path) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """`simulate`, and the bus that its line names; it ends by itself at Ctrl-C, unless it was killed."""
    process = start("simulate", "--bus", bus, "--write-rig", str(rig), "--hand", HAND[bus], port=None)
    try:
        yield process, line_of(process).split(" on ")[1].strip()
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            assert process.wait(STARTS_WITHIN) == 0
            out, err = process.communicate()
            assert out == ""
            # What `simulate` says of the port that it made.
            assert err == "" or ("is a pseudo-terminal" in err and bus == RTU)
    finally:
        process.kill()
        process.communicate()


def running(bus: str, rig: Path, seconds: float) -> "subprocess.Popen[str]":
    """A run on this bench, about to begin."""
    words = ("--set", "wall.stiffness=max/2", "--rate", RATE[bus], "--duration", str(seconds), "--yes")
    return start("run", "wall", "--rig", str(rig), *words, port=None)


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize("bus", [TCP, RTU])
def test_a_wall_is_rendered_with_the_rig_that_simulate_writes(bus: str, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    with simulated(bus, rig) as (_, name):
        assert name.partition(":")[0] == bus.partition(":")[0]
        process = running(bus, rig, 1.5 if bus == RTU else 1.0)
        out, err = process.communicate(timeout=60.0)
    if process.returncode == 0:
        assert "verdict" in out
        assert "no trip" in out
        assert re.search(r"; handle (from|stayed|\S+ mm deep)", out), out
    else:
        assert re.search("torque is off|not confirmed", out + err)
    # The guard was proved before, and the proof is kept.
    assert "drive watchdog fired" in out
    assert 'guard = "proved"' in rig.read_text(encoding="utf-8")


def registers(address: tuple[str, int]) -> tuple[int, int]:
    """Statusword and torque demand, as somebody else reads them."""
    with socket.create_connection(address, timeout=5.0) as connection:
        connection.sendall(tcp(1, struct.pack(">BHH", 3, STATUS, 2)))
        octets = connection.recv(100)
    status, demand = struct.unpack(">HH", octets[9:13])
    assert DEMAND == STATUS + 1
    return status, demand


def wait_until_enabled(address: tuple[str, int], process: "subprocess.Popen[str]") -> None:
    """Until the drive has torque, which it has not while its guard is proved."""
    end = time.monotonic() + STARTS_WITHIN
    while time.monotonic() < end and process.poll() is None:
        status, demand = registers(address)
        if status & 0x6F == ENABLED and demand:
            return
    pytest.fail("no torque: " + "".join(process.communicate()))


@pytest.mark.thorough("seconds of real time")
def test_a_master_that_is_killed_leaves_no_torque_behind(tmp_path: Path) -> None:
    with simulated(TCP, tmp_path / "rig.toml") as (_, name):
        host, _, port = name.removeprefix("modbus-tcp:").rpartition(":")
        process = running(TCP, tmp_path / "rig.toml", 30.0)
        wait_until_enabled((host, int(port)), process)
        process.kill()
        process.communicate()
        begin = time.monotonic()
        while registers((host, int(port)))[1] and time.monotonic() < begin + STARTS_WITHIN:
            pass
        status, demand = registers((host, int(port)))
        assert (status & 0x4F, demand) == (FAULT, 0)


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize("bus", [TCP, RTU])
def test_drives_that_are_stopped_end_the_run_and_are_free_when_they_go_on(bus: str, tmp_path: Path) -> None:
    """SIGSTOP of `simulate`: nobody answers, and what was sent meanwhile is obeyed late; on CAN see `tests/vcan`."""
    with simulated(bus, tmp_path / "rig.toml") as (drives, name):
        process = running(bus, tmp_path / "rig.toml", 30.0)
        assert process.stderr is not None
        told = next(line for line in process.stderr if "about to enable torque" in line)
        if bus == TCP:
            host, _, port = name.removeprefix("modbus-tcp:").rpartition(":")
            wait_until_enabled((host, int(port)), process)
        drives.send_signal(signal.SIGSTOP)
        out, err = process.communicate(timeout=60.0)
        drives.send_signal(signal.SIGCONT)
        assert process.returncode == 1, told + out + err
        assert re.search(r"feedback lost|not answer", out + err), out + err
        assert "Traceback" not in out + err
        if bus == TCP:
            status, demand = registers((host, int(port)))
            assert (status & 0x6F != ENABLED, demand) == (True, 0)


GONE = {
    TCP: "closed the connection|reset the connection|no server at this address",
    RTU: "adapter is gone|feedback lost|no feedback|not answer",
}


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize("bus", [TCP, RTU])
def test_drives_that_are_killed_end_the_run_with_a_sentence(bus: str, tmp_path: Path) -> None:
    with simulated(bus, tmp_path / "rig.toml") as (drives, _):
        process = running(bus, tmp_path / "rig.toml", 30.0)
        assert process.stderr is not None
        told = next(line for line in process.stderr if "about to enable torque" in line)
        drives.kill()
        out, err = process.communicate(timeout=30.0)
    assert process.returncode == 1, told + out + err
    assert re.search(GONE[bus], out + err), out + err
    assert "Traceback" not in out + err
