"""Examples of the guides to things of one's own work as they stand there, and name what is to be written."""

import importlib
import os
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main
from haptic_fieldbus.documents.own_parts import name_of
from haptic_fieldbus.protocols.catalogue import profile_folder
from tests.new_things import THINGS

PROJECT = Path(__file__).resolve().parents[2]
HOW_TO = PROJECT / "docs" / "how-to"
ELEMENT, PROFILES, PACKAGE, PARTS = (
    (HOW_TO / f"{name}.md").read_text(encoding="utf-8")
    for name in ("write_your_own_element", "keep_your_own_profiles", "add_to_the_package", "use_your_own_parts")
)


def blocks(text: str, kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands(text: str) -> Iterator[list[str]]:
    for block in blocks(text, "console"):
        yield from (shlex.split(line) for line in block.splitlines())


def status(words: list[str]) -> int:
    with pytest.raises(SystemExit) as ended:
        main(words)
    return int(ended.value.code or 0)


def test_the_element_of_the_guide_is_named_in_a_scene_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its package as pip installs it: the metadata that its pyproject.toml becomes, and the module on the path."""
    files = {block.split()[1]: block for block in blocks(ELEMENT, "toml")}
    entry_points = re.sub(r"project\.entry-points\.\"(.*)\"", r"\1", files["pyproject.toml"]).replace('"', "")
    info = tmp_path / "clay-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: clay\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entry_points)
    (tmp_path / "clay.toml").write_text(files["clay.toml"])
    for folder in (tmp_path, PROJECT / "examples"):
        monkeypatch.syspath_prepend(str(folder))
    monkeypatch.chdir(tmp_path)
    asked = list(commands(ELEMENT))
    assert len(asked) == 4
    for name, *words in asked:
        assert name == "haptic-fieldbus"
        assert status(words) == 0, capsys.readouterr().err
    told = capsys.readouterr().out
    assert "own_memory:Clay" in told
    assert "Feels right" in told, "the handle reaches the clay"
    sys.modules.pop("own_memory")


def test_the_parts_of_the_guide_run_as_objects_and_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (toml,) = blocks(PARTS, "toml")
    info = tmp_path / "my_parts-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-parts\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(re.sub(r"project\.entry-points\.\"(.*)\"", r"\1", toml).replace('"', ""))
    (tmp_path / "my_parts.py").write_text("\n".join(blocks(PARTS, "python")))
    monkeypatch.syspath_prepend(str(tmp_path))
    parts = importlib.import_module("my_parts")
    assert parts.result.plan.axes[0].estimator == name_of(parts.MEAN_OF_TWO)
    ((_, *words),) = commands(PARTS)
    assert status(words) == 0, capsys.readouterr().err
    sys.modules.pop("my_parts")


@pytest.fixture
def drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder of the guide; what is exported ends with the test."""
    (tmp_path / "drives").mkdir()
    text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
    (tmp_path / "drives" / "acme_mover.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("drives")
def test_the_commands_of_the_guide_to_profiles_find_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = list(commands(PROFILES))
    assert len(asked) == 5
    for name, *words in asked:
        if name == "export":
            monkeypatch.setenv(*words[0].split("=", 1))
        else:
            assert status(words) == 0, capsys.readouterr().err
    assert os.environ["HAPTIC_FIELDBUS_PROFILES"] == "drives"


@pytest.mark.usefixtures("drives")
def test_the_program_of_the_guide_to_profiles_runs() -> None:
    (program,) = blocks(PROFILES, "python")
    exec(compile(program, "keep_your_own_profiles.md", "exec"), {})


@pytest.mark.parametrize("kind", THINGS)
def test_the_guide_to_the_package_names_what_a_person_writes(kind: str) -> None:
    thing = THINGS[kind]
    for step in thing.steps:
        assert f"`{step.path.replace(thing.name, 'NAME')}`" in PACKAGE
