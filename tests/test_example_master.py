"""examples/test_your_master: its tests pass for its master, and notice five ways to break it.

Each broken master is a copy with an edit that a person might make; pytest runs in a process of its own, as a user
starts it.
"""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
EXAMPLE = PROJECT / "examples" / "test_your_master"
GUIDE = (PROJECT / "docs" / "how-to" / "test_your_master_with_pytest.md").read_text(encoding="utf-8")
ON_CAN, _, ON_MODBUS = GUIDE.partition("\n## On Modbus\n")
SHOWN, (MODBUS,) = (
    re.findall(r"^```python\n(.*?)^```", part, re.MULTILINE | re.DOTALL) for part in (ON_CAN, ON_MODBUS)
)


@dataclass(frozen=True)
class Mistake:
    """Edits of the master's text; the example's tests that must fail by them, and what they must say."""

    edits: tuple[tuple[str, str], ...]
    noticed_by: str
    said: str


MISTAKES = {
    "wrong order of controlwords": Mistake(
        (('(0x06, "ready to switch on")', '(0x07, "ready to switch on")'), ('(0x07, "switched', '(0x06, "switched')),
        "test_the_drive_is_enabled_and_stopped",
        "the drive is switch on disabled, and should be ready to switch on",
    ),
    "no heartbeat": Mistake(
        (
            ('self._heartbeat = self.network.send_periodic(0x700 + MASTER_ID, b"\\x05", HEARTBEAT_PERIOD)\n', "pass\n"),
            ("self._heartbeat.stop()\n", "pass\n"),
        ),
        "test_a_master_that_is_gone_leaves_no_torque",
        "<simulated generic CiA 402, node 5: operation enabled>",
    ),
    "a PDO is mapped while it is valid": Mistake(
        (("cob_id | NOT_VALID", "cob_id"),),
        "test_nothing_moves_before_the_drive_is_enabled",
        "Code 0x06010000, Unsupported access to an object",
    ),
    "no wait for a state": Mistake(
        (("            self._controlword = controlword\n            self._wait_for(state)\n",
          "            self._controlword = controlword\n"),),
        "test_the_drive_is_enabled_and_stopped",
        "assert 'switch on disabled' == 'operation enabled'",
    ),
    "wrong unit": Mistake(
        (('self._read("<I", 0x6076) / 1000', 'self._read("<I", 0x6076) / 1'),),
        "test_the_motor_makes_the_torque_that_was_asked_for",
        "0.05 ± 0.001",
    ),
}  # fmt: skip


def run_tests(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run pytest in a folder, without what the tests around it have set."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(EXAMPLE, tmp_path / "example", ignore=shutil.ignore_patterns("__pycache__")))


@pytest.mark.thorough("waits in real time")
def test_the_tests_of_the_example_pass(copy: Path) -> None:
    done = run_tests(copy)
    assert done.returncode == pytest.ExitCode.OK, done.stdout + done.stderr
    assert "9 passed" in done.stdout


@pytest.mark.thorough("waits in real time")
@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_of_the_master_is_noticed(mistake: Mistake, copy: Path) -> None:
    master = copy / "master.py"
    text = master.read_text(encoding="utf-8")
    for old, new in mistake.edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    master.write_text(text, encoding="utf-8")
    done = run_tests(copy, "-k", mistake.noticed_by)
    assert done.returncode == pytest.ExitCode.TESTS_FAILED, done.stdout + done.stderr
    assert re.search(rf"^(FAILED|ERROR) \S*{mistake.noticed_by}\b", done.stdout, re.MULTILINE)
    assert mistake.said in done.stdout


@pytest.mark.parametrize("block", SHOWN, ids=range(len(SHOWN)))
def test_the_guide_shows_the_tests_of_the_example(block: str) -> None:
    assert block in (EXAMPLE / "test_master.py").read_text(encoding="utf-8")


@pytest.mark.thorough("starts a process")
def test_the_test_of_a_modbus_master_passes(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(MODBUS, encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--strict-markers"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
