"""A run prints at most eight lines of at most 110 characters, besides warnings, caps and paths."""

import re
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.run_verdict import FeltError, real_verdict, run_verdict
from haptic_fieldbus.numerals import KEY_WIDTH, LINE_WIDTH, MORE, OutputRow, as_typed, lines_of
from haptic_fieldbus.report.texts import announcement, outcome
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import scene_of
from tests.cases import every
from tests.cli.command import Command, counted, printed
from tests.several_buses import rig_on

PROJECT = Path(__file__).resolve().parents[2]
TUTORIAL, MAKEFILE = PROJECT / "docs" / "tutorials" / "first_wall.md", PROJECT / "Makefile"
CHANGES = [(0.2, {"wall.stiffness": 500.0}), (0.4, {"wall.stiffness": 400.0, "wall.position": 0.025})]


@pytest.mark.thorough("a run of every scene", quick=("wall", "teleoperation", "generalised_maxwell"))
@pytest.mark.parametrize("scene", scene_names())
def test_a_run_of_each_scene_has_at_most_eight_lines(scene: str, command: Command) -> None:
    finished = command("run", scene, "--duration", "1")
    assert finished.status == 0
    keys = [key for key, _ in counted(printed(finished.out))]
    assert keys == ["scene", "bench", "sends", "limit", "result", "verdict"]


@pytest.mark.thorough("three seconds of a run")
def test_the_tutorial_shows_what_its_demo_prints(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown, _ = re.findall(r"^```text\n(.*?)^```", TUTORIAL.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (demo,) = re.findall(r"haptic-fieldbus (run .* --plot .*)", MAKEFILE.read_text(encoding="utf-8"))
    assert command(*demo.split()).out == shown


def test_details_are_told_only_on_demand() -> None:
    result = run("wall", duration=0.6)
    assert result.plan is not None
    short = [*announcement(result.plan), *outcome(result)]
    whole = [*announcement(result.plan, verbose=True), *outcome(result, verbose=True)]
    assert [line for line in whole if line in short] == short
    told = "\n".join(text for _, text in whole)
    for words in ("TPDO1", "counts/rev", "master stopped", "nominal: passive", "bus load", "force error", "loop"):
        assert words in told
        assert words not in "\n".join(text for _, text in short)


def test_six_axes_with_long_names_on_six_buses_are_told_in_as_many_lines() -> None:
    names = [f"axis_{number}_{'of_a_long_arm_' * 3}" for number in range(6)]
    scene = scene_of(*(Wall(name, 100.0 + number, name=f"w{number}") for number, name in enumerate(names)))
    buses = {name: f"bus_{number}_of_a_long_arm" for number, name in enumerate(names)}
    rig = rig_on(scene, buses, profile="maxon_epos4")
    result = run(scene, rig, duration=0.6)
    assert result.plan is not None
    found = counted([*announcement(result.plan, CHANGES), *outcome(result)])
    assert [key for key, _ in found] == ["scene", "bench", "sends", "limit", "changes", "result", "verdict"]
    assert all(MORE in dict(found)[key] for key in ("scene", "bench", "result"))
    whole = [*announcement(result.plan, verbose=True), *outcome(result, verbose=True)]
    for words in (*names, *result.plan.rig.bus):
        assert any(words in text for _, text in whole), words


def test_a_trip_leaves_the_lines_that_are_known(command: Command, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("faults") / "faults.toml"
    path.write_text('[[fault]]\nkind = "hand_hit"\nat = 0.3\nforce = 300.0\n', encoding="utf-8")
    finished = command("run", "wall", "--duration", "2", "--faults", str(path), "--change", "1:wall.stiffness=500")
    assert finished.status == 3
    keys = [key for key, _ in counted(printed(finished.out))]
    assert keys == ["scene", "bench", "sends", "limit", "changes", "result"]
    assert finished.err.startswith("tripped    0.")


FELT = st.builds(
    FeltError,
    st.none() | st.floats(0.0, 99.0),
    st.floats(0.0, 99.0),
    st.floats(0.0, 0.09),
    st.floats(0.0, 9.0),
    st.floats(-9.0, 9.0),
    by_event=st.booleans(),
)


@given(
    scene=st.sampled_from(["wall", "standard linear solid", "scene " * 40]),
    effort=st.sampled_from(["force", "torque"]),
    hand=st.sampled_from(["", "push", "release"]),
    stable=st.booleans(),
    inside=st.booleans(),
    felt=st.none() | FELT,
    ripple=st.none() | st.floats(0.0, 9.0),
)
@example(
    scene="wall", effort="force", hand="", stable=True, inside=False,
    felt=FeltError(1.0, 0.0, 0.0, 0.0, 7.57771023177948e-97, by_event=False), ripple=1.0,
)  # fmt: skip
@example(
    scene="wall", effort="force", hand="", stable=True, inside=False,
    felt=FeltError(1.0, 0.0, 2.8034482001673695e-274, 0.0, 1.0, by_event=False), ripple=1.0,
)  # fmt: skip
def test_a_verdict_is_one_line_and_never_loses_a_chatter(
    *, scene: str, effort: str, hand: str, stable: bool, inside: bool, felt: FeltError | None, ripple: float | None
) -> None:
    told = run_verdict(scene=scene, effort=effort, hand=hand, stable=stable, inside=inside, felt=felt, ripple=ripple)
    assert KEY_WIDTH + len(told) <= LINE_WIDTH
    if stable and felt is not None:
        assert ("chatters" in told) == (ripple is not None and ripple >= 0.08)


@given(cut=st.just(0.0) | st.floats(1e-7, 1.0), behind=st.none() | st.floats(1e-6, 9.0), rehearsed=st.booleans())
def test_a_verdict_on_a_real_run_is_one_line(cut: float, behind: float | None, rehearsed: bool) -> None:
    for effort in ("force", "torque"):
        for confirmed in (True, False):
            told = real_verdict(effort=effort, cut=cut, behind=behind, confirmed=confirmed, rehearsed=rehearsed)
            assert KEY_WIDTH + len(told) <= LINE_WIDTH


def test_each_of_several_warnings_has_its_key() -> None:
    lines = lines_of([OutputRow("warning", ["one", "two"])], once=True, short=True)
    assert lines == [("warning", "one"), ("warning", "two")]


def test_a_warning_is_wrapped_and_never_cut() -> None:
    warning = " ".join(f"word{number}" for number in range(60))
    lines = lines_of([OutputRow("warning", [warning]), OutputRow("scene", [warning], cut=True)], short=True)
    found = [text for _, text in lines[:-1]]
    assert " ".join(found) == warning
    assert [key for key, _ in lines] == ["warning", *[""] * (len(found) - 1), "scene"]
    assert lines[-1][1].endswith(MORE)


@every(
    ("value", "told"),
    [
        (600.0, "600"),
        (0.0001, "0.0001"),
        (4e-5, "4e-5"),
        (681.573518196, "681.6"),
        (0.698131700798, "0.6981"),
        (-0.5, "-0.5"),
    ],
)
def test_a_number_has_the_digits_that_one_would_type(value: float, told: str) -> None:
    assert as_typed(value) == told
