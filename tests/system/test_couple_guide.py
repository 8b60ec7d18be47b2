"""Examples of docs/how-to/couple_two_drives.md work as they stand there; its `sh` blocks are run with all others."""

import re
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "couple_two_drives.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```toml\n# (\S+)\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL))
COMMANDS = [line for block in re.findall(r"^```console\n(.*?)^```", TEXT, re.M | re.S) for line in block.splitlines()]
SHOWN = re.findall(r"^```text\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_guide_has_its_files_and_commands() -> None:
    assert set(FILES) == {"shaft.toml", "rig.toml"}
    assert (len(COMMANDS), len(SHOWN)) == (5, 1)


@pytest.mark.thorough("runs of seconds", quick=1)
@pytest.mark.parametrize("command", COMMANDS)
def test_its_commands_do_what_they_say(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(command.split()[1:])
    assert not ended.value.code, capsys.readouterr().err


def test_the_plan_has_the_line_that_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["plan", "virtual_shaft"])
    assert SHOWN[0].strip() in capsys.readouterr().out
