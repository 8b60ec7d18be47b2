"""Examples of docs/how-to/test_on_vcan.md work as they stand there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.vcan import runner as guest

TEXT = (Path(__file__).parents[2] / "docs" / "how-to" / "test_on_vcan.md").read_text()
COMMANDS = re.findall(r"^haptic-fieldbus (.*)$", TEXT, re.MULTILINE)
SHOWS = ("", "vcan0  181   [4]  37 02 2A 00", "vcan1", "")


@pytest.mark.vcan
@pytest.mark.thorough("starts commands one in another")
@pytest.mark.parametrize(("command", "shows"), list(zip(COMMANDS, SHOWS, strict=True)))
def test_the_commands_work(command: str, shows: str, tmp_path: Path) -> None:
    """On the interfaces of this kernel; how a guest comes about is in test_guest.py."""
    (tmp_path / "results").mkdir()
    words = [sys.executable, "-m", "haptic_fieldbus", *shlex.split(command)]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 124), done.stderr
    assert shows in done.stdout


def test_the_packages_are_those_that_are_asked_for() -> None:
    assert f"apt-get install {' '.join(guest.PROGRAMS.values())} can-utils" in TEXT
