"""The options of commands are the arguments of the Python API, declared once."""

import ast
import inspect
import math
import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import typer

import haptic_fieldbus
from haptic_fieldbus.api import Trial
from haptic_fieldbus.api.open_loop import OpenLoop
from haptic_fieldbus.api.stability_limits import Device
from haptic_fieldbus.cli.app import application
from haptic_fieldbus.cli.options import SHOWN, SceneOptions, frequency, number, seconds
from haptic_fieldbus.cli.planning import ResponseOptions, StabilityOptions, plan, response, stability
from haptic_fieldbus.cli.run import run
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.request import Task
from tests.cases import every
from tests.cli.command import Command

PAIRS = [(SceneOptions, Task), (SceneOptions, Trial), (StabilityOptions, Device), (ResponseOptions, OpenLoop)]
"""The options of each command, and the value of the API that they make."""
PYTHON_ONLY = {"changes", "confirm", "progress", "announce", "instruct", "live"}
"""The command line has words or ways of its own for them."""


@pytest.mark.parametrize(("options", "asked"), PAIRS)
def test_every_argument_has_its_option(options: type[SceneOptions], asked: type[Any]) -> None:
    assert {field.name for field in fields(asked)} - {field.name for field in fields(options)} <= PYTHON_ONLY


@pytest.mark.parametrize(("options", "asked"), PAIRS)
def test_what_is_not_given_is_as_in_the_api(options: type[SceneOptions], asked: type[Any]) -> None:
    assert options(scene="wall").given(asked) == (asked("wall") if asked is Task else asked())
    assert options(scene="wall").task() == Task("wall", settings={})


def test_what_is_given_reaches_the_api() -> None:
    options = SceneOptions(scene="wall", settings=["wall.stiffness=max/2"], rate=500.0, node=3)
    assert options.task() == Task("wall", settings={"wall.stiffness": "max/2"}, rate=500.0, node=3)


def test_a_rig_leaves_no_choice_of_drives() -> None:
    with pytest.raises(UsageError, match="omit --node"):
        SceneOptions(scene="wall", rig="rig.toml", node=3).task()  # type: ignore[arg-type]


@pytest.mark.parametrize("command", [plan, run, stability, response])
def test_shared_options_stand_first_and_in_one_order(command: object) -> None:
    names = list(inspect.signature(command).parameters)  # type: ignore[arg-type]
    first = [name for name in SHOWN if name in names]
    assert names[: len(first)] == first


def switches() -> set[tuple[str, ...]]:
    """Long names of each switch of each command."""
    commands, found = [typer.main.get_command(application())], set[tuple[str, ...]]()
    while commands:
        command = commands.pop()
        commands += getattr(command, "commands", {}).values()
        options = [each for each in command.params if getattr(each, "is_flag", False)]
        found |= {tuple(name for name in each.opts if name.startswith("--")) for each in options}
    return found


@pytest.mark.parametrize(("option", "scene"), [("method", "sprung_mass"), ("estimator", "damped_wall")])
def test_a_wrong_name_lists_all_as_the_help_says(option: str, scene: str, command: Command) -> None:
    text = " ".join(command("plan", "--help").out.replace("│", " ").split())
    ((example, default),) = re.findall(
        rf"--{option} NAME [^\[]*such as (\S+); a wrong name lists all\. \[default: (\S+)\]", text
    )
    refused = command("plan", scene, f"--{option}", "none_of_them")
    assert refused.status == 2
    assert {example.partition(":")[0], default} <= set(re.findall(r"[a-z0-9-]+", refused.err))


def test_a_switch_has_one_long_name() -> None:
    found = switches()
    assert ("--json",) in found
    assert {names for names in found if len(names) > 1} == set()


@every(
    ("parse", "text", "value"),
    [
        (frequency, "1kHz", 1000.0),
        (frequency, "0.5 kHz", 500.0),
        (frequency, "800", 800.0),
        (seconds, "500ms", 0.5),
        (seconds, "2 min", 120.0),
        (seconds, "inf", math.inf),
        (number, "1e-3", 0.001),
    ],
)
def test_a_number_of_an_option_may_have_its_unit(parse: Callable[[str], float], text: str, value: float) -> None:
    assert parse(text) == value


@every(
    ("parse", "text", "told"),
    [
        (frequency, "1khz", '"1khz"; expected a frequency in Hz; write "1 kHz"'),
        (frequency, "5 ms", '"5 ms"; expected a frequency in Hz; ms is a unit of a time on a linear axis'),
        (frequency, "fast", '"fast"; expected a number, or one with its unit such as "2 Hz"'),
        (seconds, "1,5", '"1,5"; expected a number without a comma: 1.5'),
        (number, "0,5", '"0,5"; expected a number without a comma: 0.5'),
        (number, "5mm", '"5mm"; expected a number without a unit'),
    ],
)
def test_a_number_in_another_spelling_is_refused(parse: Callable[[str], float], text: str, told: str) -> None:
    with pytest.raises(typer.BadParameter) as refused:
        parse(text)
    assert refused.value.message == told


def test_an_empty_name_is_no_default() -> None:
    with pytest.raises(UsageError, match=r"^--drive: empty; expected a name\n--bus: empty; expected a name$"):
        SceneOptions(scene="wall", bus="", drive="").task()


CARRIERS = {
    "cli/options.py": {"SceneOptions"},
    "planning/request.py": {"Task"},
    "planning/selection.py": {"Selection"},
    "api/__init__.py": {"Trial"},
    "running/session.py": {"Session", "Site"},
    "assessing/summary.py": {"Run", "Assessment"},
}
"""Names under which a run is handed on between its command and the loop, by the file that has it."""
OTHERS = {"Choice", "ExchangeLimit", "Traces", "Part", "AxisAssessment", "RunOptions", "Caller", "DemoOptions"}
"""Classes of these files that check names, tell limits, and assess an axis; the options of `run` with --from and of
`demo`; the caller of a session."""
ON_THE_WAY = (*CARRIERS, "cli/run.py", "api/arguments.py", "api/site.py", "planning/refusal.py", "running/loop.py")
"""Files that a run goes through on its way from the command to the loop."""


def test_at_most_eight_classes_carry_a_run_from_its_command_to_the_loop() -> None:
    package = Path(haptic_fieldbus.__file__).parent
    found = {
        name: {
            node.name
            for node in ast.walk(ast.parse((package / name).read_text("utf-8")))
            if isinstance(node, ast.ClassDef)
        }
        for name in ON_THE_WAY
    }
    carriers = {name: classes - OTHERS for name, classes in found.items()}
    assert {name: classes for name, classes in carriers.items() if classes} == CARRIERS
    assert sum(map(len, CARRIERS.values())) <= 8
