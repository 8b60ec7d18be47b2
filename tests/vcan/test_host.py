"""Interfaces of the kernel itself; inside a guest that is the guest's."""

import subprocess
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.vcan import runner
from tests.vcan.links import Link

pytestmark = [
    pytest.mark.vcan,
    pytest.mark.thorough("makes interfaces"),
    pytest.mark.skipif(not Path("/sys/class/net/vcan0").exists(), reason="no vcan0 here"),
]


def exists(name: str) -> bool:
    return (runner.NET / name).exists()


def test_what_is_there_stays_and_what_was_made_goes(vcan: Link) -> None:
    with runner.lent([vcan.name, "made0"]) as there:
        if not there:
            pytest.skip("this user must not make interfaces")
        assert runner.is_up("made0")
    assert not exists("made0")
    assert vcan.is_up


def test_an_interface_that_was_down_is_down_again(vcan: Link) -> None:
    vcan.down()
    with runner.lent([vcan.name]) as there:
        assert there
        assert vcan.is_up
    assert not vcan.is_up


def test_an_interface_that_is_no_vcan_is_not_lent() -> None:
    with pytest.raises(UsageError, match='interface "lo" exists and is not a vcan'), runner.lent(["made0", "lo"]):
        pass
    assert not exists("made0")


def test_a_command_beside_the_interface_of_this_kernel(vcan: Link) -> None:
    script = f"echo $HAPTIC_FIELDBUS_VCAN; ip link show dev {vcan.name} >&2; exit 3"
    command = [sys.executable, "-m", "haptic_fieldbus", "vcan", "--", "sh", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (3, "host\n")
    assert "vcan       vcan0 of this machine" in done.stderr
    assert vcan.is_up


@pytest.mark.parametrize(("words", "status"), [(["sh", "-c", "kill -TERM $$"], 143), (["sleep", "99"], 124)])
def test_the_exit_status_is_the_same_as_in_a_guest(vcan: Link, words: list[str], status: int) -> None:
    command = [sys.executable, "-m", "haptic_fieldbus", "vcan", "--time-limit", "5", "--", *words]
    assert subprocess.run(command, capture_output=True, check=False).returncode == status
