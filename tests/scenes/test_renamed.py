"""Scenes whose axes are renamed, so that they fit a rig whose axes are called differently."""

from dataclasses import replace

import pytest

import haptic_fieldbus
from haptic_fieldbus.cli import main
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.parameter_changes import with_axes
from haptic_fieldbus.scenes.scene import axes_of
from tests.cases import every

TWO_AXES = next(name for name in scene_names() if len(load_scene(name).axes) == 2)


@every("name", scene_names())
def test_every_element_follows_its_axis_and_nothing_else_changes(name: str) -> None:
    scene = load_scene(name)
    names = {axis.name: f"{axis.name}_of_rig" for axis in scene.axes}
    renamed = with_axes(scene, names)
    assert [axis.name for axis in renamed.axes] == list(names.values())
    acted = [[names[axis] for axis in axes_of(element)] for element in scene.elements]
    assert [list(axes_of(element)) for element in renamed.elements] == acted
    assert with_axes(renamed, {other: own for own, other in names.items()}) == scene


def test_two_axes_may_change_their_names() -> None:
    scene = load_scene(TWO_AXES)
    first, second = (axis.name for axis in scene.axes)
    swapped = with_axes(scene, {first: second, second: first})
    assert [axis.name for axis in swapped.axes] == [second, first]


def test_an_axis_that_the_scene_lacks_is_told_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r'^--axis handel=knob: the scene wall has no axis "handel"; nearest: handle'):
        with_axes(load_scene("wall"), {"handel": "knob"})


def test_two_axes_cannot_have_one_name() -> None:
    scene = load_scene(TWO_AXES)
    first, second = (axis.name for axis in scene.axes)
    with pytest.raises(UsageError, match=f'{first} and {second} of the scene {TWO_AXES} would both be "{second}"'):
        with_axes(scene, {first: second})


def knob() -> Rig:
    """The bench of the wall, whose only axis is called a knob."""
    bench = haptic_fieldbus.plan("wall").rig
    return replace(bench, axis={"knob": bench.axis["handle"]}, source="rig.toml")


@pytest.mark.thorough("two runs")
def test_a_run_on_a_renamed_axis_is_the_run_on_its_own() -> None:
    settings = {"wall.stiffness": "max/4"}
    changes = [(0.5, {"wall.stiffness": 200.0})]
    own = haptic_fieldbus.run("wall", duration=1.0, settings=settings, changes=changes)
    other = haptic_fieldbus.run(
        "wall", knob(), axes={"handle": "knob"}, duration=1.0, settings=settings, changes=changes
    )
    assert own.torque_error is not None
    assert other.torque_error == own.torque_error
    assert other.changes == own.changes


def test_a_rig_without_the_axis_says_how_to_rename() -> None:
    with pytest.raises(PlanError, match=r"rig\.toml has: knob\. Use --axis handle=NAME for another one$"):
        haptic_fieldbus.plan("wall", knob())


def test_the_command_renames_too(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["plan", "wall", "--axis", "handle = knob"])
    assert not stopped.value.code
    assert "axis       knob: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["handle"], '--axis "handle": expected SCENE_AXIS=RIG_AXIS, for example knob=handle'),
        (["=knob"], '--axis "=knob": expected SCENE_AXIS=RIG_AXIS, for example knob=handle'),
        (["handle=a", "handle=b"], "--axis handle: given twice, as a and b"),
    ],
)
def test_a_malformed_name_is_wrong_usage(given: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["plan", "wall", *(word for text in given for word in ("--axis", text))])
    assert stopped.value.code == 2
    assert told in " ".join(capsys.readouterr().err.split())


def test_the_bench_that_is_shipped_has_the_name_that_is_given() -> None:
    """So that an option can be tried before there is a rig."""
    assert list(haptic_fieldbus.plan("wall", axes={"handle": "knob"}).rig.axis) == ["knob"]
