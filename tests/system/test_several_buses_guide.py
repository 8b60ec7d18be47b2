"""Examples of docs/how-to/use_several_buses.md work as they stand there."""

import re
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "use_several_buses.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```toml\n# (\S+)\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL))
COMMANDS = [line for block in re.findall(r"^```console\n(.*?)^```", TEXT, re.M | re.S) for line in block.splitlines()]
SHOWN = re.findall(r"^```text\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def outcome(command: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    name, *words = command.split()
    assert name == "haptic-fieldbus"
    with pytest.raises(SystemExit) as ended:
        main(words)
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_the_guide_has_its_files_and_commands() -> None:
    assert set(FILES) == {"rig.toml", "scene.toml", "faults.toml"}
    assert len(COMMANDS) == 4
    assert len(SHOWN) == 1


@pytest.mark.thorough("runs of seconds", quick=1)
@pytest.mark.parametrize("command", COMMANDS[:-1])
def test_its_commands_do_what_they_say(command: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = outcome(command, capsys)
    assert status == 0, err
    assert ("--record" in command) == (folder / "frames.log").exists()


def test_its_fault_takes_the_torque_of_both_axes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = outcome(f"{COMMANDS[-1]} --record {folder / 'faulty.log'}", capsys)
    assert status == 1
    assert "axis right: feedback lost: the last from node 1" in err
    last = dict(re.findall(r" (can_\w+) 201#([0-9A-F]{8})", (folder / "faulty.log").read_text()))
    assert last == {"can_left": "00000000", "can_right": "00000000"}


def test_the_plan_has_the_lines_that_are_shown(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = outcome(COMMANDS[0], capsys)
    assert [line for line in out.splitlines() if line.startswith("bus")] == SHOWN[0].splitlines()
