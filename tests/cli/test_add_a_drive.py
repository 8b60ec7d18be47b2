"""The page "Add a drive from its EDS", walked line by line in one folder."""

import re
import tomllib
from pathlib import Path

import pytest

from tests.cli.command import Command

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "add_a_drive.md"
COMMANDS = [
    line
    for block in re.findall(r"```console\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    for line in block.splitlines()
]


def test_every_command_of_the_page_works_in_its_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(COMMANDS) > 6
    for line in COMMANDS:
        program, *words = line.split()
        finished = command(*words)
        assert program == "haptic-fieldbus"
        assert finished.status == 0, f"{line}: {finished.out}{finished.err}"


def test_every_key_that_a_draft_assumes_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    for line in COMMANDS[:4]:
        assert command(*line.split()[1:]).status == 0
    sources = tomllib.loads((tmp_path / "push1.toml").read_text(encoding="utf-8"))["sources"]
    assumed = {key for key, source in sources.items() if "ASSUMED" in source}
    text = PAGE.read_text(encoding="utf-8")
    for key in assumed:
        section, name, *_ = key.split(".")
        assert f"`{section}.{name}" in text or f"`{name}" in text, key
