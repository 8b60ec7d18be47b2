"""Examples of docs/how-to/change_a_running_scene.md work as they stand there."""

import re
import shlex
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "change_a_running_scene.md").read_text("utf-8")
COMMANDS = re.findall(r"^```console\n(.*?)\n```", TEXT, re.MULTILINE | re.DOTALL)
(PROGRAM,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.thorough("runs of seconds", quick=("unstable",))
@pytest.mark.parametrize(("command", "status"), [*zip(COMMANDS, (0, 4), strict=True)], ids=["stable", "unstable"])
def test_its_commands_end_as_it_says(command: str, status: int, capsys: pytest.CaptureFixture[str]) -> None:
    name, *words = shlex.split(command)
    assert name == "haptic-fieldbus"
    with pytest.raises(SystemExit) as ended:
        main(words)
    shown = capsys.readouterr()
    assert (ended.value.code or 0) == status
    assert ("at 2 s wall.stiffness=0.3 N/mm" in shown.out) == (status == 0)
    assert ("Inside the limit" in shown.err) == (status == 4)


@pytest.mark.thorough("a run of seconds")
def test_its_program_changes_a_running_wall_and_is_told_why_not(capsys: pytest.CaptureFixture[str]) -> None:
    scope: dict[str, object] = {}
    exec(compile(PROGRAM, "how-to", "exec"), scope)
    refused, *_, in_force, made = capsys.readouterr().out.splitlines()
    assert refused.startswith("90000 N/m exceeds the limit of 750 N/m on this bench")
    assert "stiffness=700.0" in in_force
    assert "'wall.stiffness': 90000.0" not in made


def test_its_figure_is_that_of_its_formula() -> None:
    assert "300 N/m more at 10 mm, over 100 periods, is 0.03 N per period" in " ".join(TEXT.split())
    force = 300.0 * 0.010
    assert force / 100 == pytest.approx(0.03)
