"""A drive and its master in processes of their own, on Modbus: either of them is killed while there is torque."""

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyModbusTCP.client import ModbusClient

from tests.peers.hosts import STARTS_WITHIN, line_of, start

pytestmark = [pytest.mark.thorough("two processes for seconds"), pytest.mark.xdist_group("peers")]
STATUSWORD, TARGET, ERROR = 0x0100, 0x0201, 0x0105
ENABLED, FAULT, STATE = 0x27, 0x08, 0x6F
LOST_MASTER = 0x8130
GUARD = 0.05
"""[s]; the watchdog of the profile, more than five periods here."""


class Hosted:
    """Simulated drives on a line, and the rig by which they are found."""

    def __init__(self, bus: str, folder: Path) -> None:
        self.rig = folder / "rig.toml"
        self.runs: list[subprocess.Popen[str]] = []
        self.process = start(
            "simulate", "--bus", bus, "--hand", "push", "--write-rig", str(self.rig), port=None
        )  # fmt: skip
        self.bus = line_of(self.process).split(" on ")[-1].strip()
        # The hand leans deep into the soft wall that is stable here.
        self.rig.write_text(self.rig.read_text().replace("[-0.1, 0.1]", "[-0.5, 0.5]"))

    def run(self) -> "subprocess.Popen[str]":
        """A wall at which the hand leans for a minute."""
        self.runs.append(
            start(
                "run", "wall", "--rig", str(self.rig), "--yes", "--duration", "60", "--rate", "100", "--force",
                "--set", "wall.stiffness=60", "--set", "wall.position=0.005", port=None,
            )
        )  # fmt: skip
        return self.runs[-1]


@pytest.fixture
def hosted(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Hosted]:
    made = Hosted(request.param, tmp_path)
    try:
        yield made
    finally:
        for process in (made.process, *made.runs):
            process.kill()
            process.communicate()


def observer(hosted: Hosted) -> ModbusClient:
    """A second master, which only reads."""
    host, _, port = hosted.bus.removeprefix("modbus-tcp:").rpartition(":")
    return ModbusClient(host, int(port), timeout=1.0)


def register(client: ModbusClient, address: int) -> int:
    values = client.read_holding_registers(address)
    assert values is not None
    return int(values[0])


def until_torque(client: ModbusClient, run: "subprocess.Popen[str]") -> None:
    """Wait until the drive is enabled and has a torque that is more than a pulse for the sign."""
    until = time.monotonic() + STARTS_WITHIN
    while time.monotonic() < until:
        assert run.poll() is None, run.communicate()
        target = register(client, TARGET)
        if register(client, STATUSWORD) & STATE == ENABLED and min(target, 0x10000 - target) > 60:
            return
    raise AssertionError("no torque was given")


@pytest.mark.parametrize("hosted", ["modbus-tcp:127.0.0.1:0"], indirect=True)
def test_a_master_that_is_killed_leaves_no_torque_and_its_successor_does_not_clear_the_fault(hosted: Hosted) -> None:
    client, run = observer(hosted), hosted.run()
    until_torque(client, run)
    run.kill()
    killed = time.monotonic()
    run.communicate()
    while register(client, STATUSWORD) & STATE == ENABLED:
        assert time.monotonic() - killed < GUARD + 1.0
    assert register(client, STATUSWORD) & 0x4F == FAULT
    assert register(client, ERROR) == LOST_MASTER
    out, err = hosted.run().communicate(timeout=STARTS_WITHIN)
    assert "is in the state fault, error code 8130h" in err, out
    assert register(client, STATUSWORD) & 0x4F == FAULT


@pytest.mark.parametrize("hosted", ["modbus-tcp:127.0.0.1:0", "modbus-rtu:pty"], indirect=True)
def test_a_drive_that_is_gone_ends_the_run_with_a_sentence(hosted: Hosted) -> None:
    run = hosted.run()
    if hosted.bus.startswith("modbus-tcp"):
        until_torque(observer(hosted), run)
    else:
        assert "scene" in line_of(run)
        time_to_enable(run)
    hosted.process.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    out, err = run.communicate(timeout=STARTS_WITHIN)
    assert time.monotonic() - killed < 10.0
    assert run.returncode == 1, out
    assert (
        "the drive closed the connection" in err or "the drive reset the connection" in err or "adapter is gone" in err
    )
    assert "did not confirm that their motors are off: switch the power off" in err


def time_to_enable(run: "subprocess.Popen[str]") -> None:
    """Wait until the run has said all that it says before torque."""
    while not line_of(run).startswith("stability"):
        pass
    with pytest.raises(subprocess.TimeoutExpired):
        run.wait(3.0)
