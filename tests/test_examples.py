"""The programs of examples/ end where physics says; the guide to elements of one's own shows parts of them."""

import re
import runpy
from pathlib import Path

import pytest

from haptic_fieldbus import Scene, SceneAxis, Workspace, stability
from haptic_fieldbus.scenes.spring import Spring

PROJECT = Path(__file__).resolve().parents[1]
FILES = {path.stem: path for path in (PROJECT / "examples").glob("*.py")}
GUIDE = (PROJECT / "docs" / "how-to" / "write_your_own_element.md").read_text(encoding="utf-8")
SHOWN = re.findall(r"^```python\n(.*?)^```", GUIDE, re.MULTILINE | re.DOTALL)

PUSH = 6.0
"""[N]; what the hand `push` ends with."""
FRICTION = 2.0e-3 * 6.2832 / 0.05
"""[N]; of both benches, from the motor shaft to the handle."""


def shown_by(name: str, capsys: pytest.CaptureFixture[str]) -> tuple[str, list[float]]:
    """Output of a program, and the lengths [m] in its last line."""
    runpy.run_path(str(FILES[name]), run_name="__main__")
    text = capsys.readouterr().out
    return text, [1e-3 * float(number) for number in re.findall(r"([\d.]+) mm", text.splitlines()[-1])]


def test_every_example_is_run_here() -> None:
    assert FILES.keys() == {
        "own_controller",
        "own_element",
        "own_memory",
        "recording_to_pandas",
        "replay_as_a_test",
        "sweep_to_a_figure",
        "wall_in_python",
    }


@pytest.mark.thorough("a run of seconds")
def test_the_controller_of_ones_own_bears_the_hand(capsys: pytest.CaptureFixture[str]) -> None:
    text, (rest,) = shown_by("own_controller", capsys)
    assert abs(200.0 * rest - PUSH) <= FRICTION
    assert text.startswith("Feels right: ")


@pytest.mark.thorough("a run of seconds")
def test_the_frame_has_the_stiffness_of_the_wall(capsys: pytest.CaptureFixture[str]) -> None:
    text, _ = shown_by("recording_to_pandas", capsys)
    assert float(text.splitlines()[-1].split()[1]) == pytest.approx(600.0, rel=0.03)
    assert "seed 0" in text


@pytest.mark.thorough("a run of seconds")
def test_the_changed_line_is_found_in_contact_alone(capsys: pytest.CaptureFixture[str]) -> None:
    text, _ = shown_by("replay_as_a_test", capsys)
    same, other = text.splitlines()
    assert same == "first difference: None"
    assert re.match(r"first difference: period \d+, 0\.\d+ s after the first: handle\.target torque is", other)


@pytest.mark.thorough("judges and simulates many loops")
def test_the_swept_wall_grows_above_its_limit(capsys: pytest.CaptureFixture[str]) -> None:
    text, _ = shown_by("sweep_to_a_figure", capsys)
    limit = stability("wall").stiffness_limit.stable
    assert limit is not None
    told = text.splitlines()
    assert told[0].startswith("2400 points")
    step = (30000.0 / 10.0) ** (1 / 59)
    assert limit / step < float(told[1].split()[5]) <= limit
    assert limit < float(told[2].split()[4]) <= limit * (3000.0 / 800.0) ** (1 / 19)


def test_the_wall_made_in_python_bears_the_hand(capsys: pytest.CaptureFixture[str]) -> None:
    text, (rest,) = shown_by("wall_in_python", capsys)
    assert abs(600.0 * (rest - 0.010) - PUSH) <= FRICTION
    assert text.startswith("Feels right: ")
    assert "above the limit" not in text


@pytest.mark.thorough("a run of seconds")
def test_the_spring_of_ones_own_bears_the_hand(capsys: pytest.CaptureFixture[str]) -> None:
    text, (rest,) = shown_by("own_element", capsys)
    assert abs(100.0 * rest + 2.0e5 * rest**3 - PUSH) <= FRICTION
    assert text.startswith("stable; stable up to 952 N/m")


def test_the_spring_is_judged_with_its_hardening() -> None:
    """Stiffness that a plain spring may have, less 3·h·x² at the furthest place that is judged."""
    plain = Scene("plain", "", (SceneAxis("handle", Workspace.LINEAR),), (Spring("handle", 100.0),))
    limit = stability(plain).stiffness_limit.stable
    assert limit is not None
    assert round(limit - 3 * 2.0e5 * 0.03**2) == 952


@pytest.mark.thorough("a run of seconds")
def test_clay_keeps_its_dent(capsys: pytest.CaptureFixture[str]) -> None:
    """It springs back by limit over stiffness, and is let go within a period and a step of torque of that."""
    text, (deepest, released) = shown_by("own_memory", capsys)
    assert deepest - released == pytest.approx(3.0 / 500.0, abs=0.25e-3)
    assert released > 0.010 + 0.02
    assert text.startswith("Feels right: ")


@pytest.mark.parametrize("block", SHOWN, ids=[block.split("\n")[0] for block in SHOWN])
def test_the_guide_shows_what_is_run(block: str) -> None:
    assert any(block in path.read_text(encoding="utf-8") for path in FILES.values())
