"""The options of commands are the arguments of the Python API, declared once."""

import inspect
from dataclasses import fields

import pytest

from haptic_fieldbus.api import Trial
from haptic_fieldbus.api.judging import Inquiry
from haptic_fieldbus.api.open_loop import OpenLoop
from haptic_fieldbus.cli.options import SHOWN, BenchOptions, SceneOptions
from haptic_fieldbus.cli.plan import plan
from haptic_fieldbus.cli.response import ResponseOptions, response
from haptic_fieldbus.cli.run import RunOptions, run
from haptic_fieldbus.cli.stability import StabilityOptions, stability
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.task import Rendering, Task

PAIRS = [(BenchOptions, Task), (RunOptions, Trial), (StabilityOptions, Inquiry), (ResponseOptions, OpenLoop)]
"""The options of each command, and the value of the API that they make."""
PYTHON_ONLY = {"changes", "confirm", "progress", "announce", "instruct"}
"""The command line has words or ways of its own for them."""


@pytest.mark.parametrize(("options", "asked"), PAIRS)
def test_every_argument_has_its_option(options: type[SceneOptions], asked: type[Rendering]) -> None:
    assert {field.name for field in fields(asked)} - {field.name for field in fields(options)} <= PYTHON_ONLY


@pytest.mark.parametrize(("options", "asked"), PAIRS)
def test_what_is_not_given_is_as_in_the_api(options: type[SceneOptions], asked: type[Rendering]) -> None:
    assert options(scene="wall").given(asked) == asked("wall", settings={})


def test_what_is_given_reaches_the_api() -> None:
    options = BenchOptions(scene="wall", settings=["wall.stiffness=max/2"], rate=500.0, node=3)
    assert options.given(Task) == Task("wall", settings={"wall.stiffness": "max/2"}, rate=500.0, node=3)


def test_a_rig_leaves_no_choice_of_drives() -> None:
    with pytest.raises(UsageError, match="leave out --node"):
        BenchOptions(scene="wall", rig="rig.toml", node=3).given(Task)  # type: ignore[arg-type]


@pytest.mark.parametrize("command", [plan, run, stability, response])
def test_shared_options_stand_first_and_in_one_order(command: object) -> None:
    names = list(inspect.signature(command).parameters)  # type: ignore[arg-type]
    first = [name for name in SHOWN if name in names]
    assert names[: len(first)] == first
