"""A default stands once, in `haptic_fieldbus.defaults`, and everybody who has it takes it from there."""

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus import api, defaults
from haptic_fieldbus.api.open_loop import OpenLoop
from haptic_fieldbus.api.stability_limits import Device
from haptic_fieldbus.cli.options import SceneOptions
from haptic_fieldbus.cli.planning import ResponseOptions, StabilityOptions
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.sim.host_request import HostRequest
from tests.cases import every
from tests.cli.command import Command
from tests.source import modules, nodes_of, reads_the_source, tree_of

PACKAGE = Path(defaults.__file__).parent
REQUESTS = (Task, Device, OpenLoop, api.Trial, HostRequest)
"""Functions of the package that are called."""
COMMANDS = {
    "plan": (SceneOptions, Task),
    "stability": (StabilityOptions, Device),
    "response": (ResponseOptions, OpenLoop),
    "run": (SceneOptions, api.Trial),
}
"""Of each command its options, and what it asks."""
TEXTS = {value for name, value in vars(defaults).items() if name.isupper() and isinstance(value, str)} - {"none"}
"""The last is a word of every list that may be empty too."""
BELOW = ("drive", "numerics", "scenes", "sim/faults", "sim/mechanics")
"""Where a rate or a duration is another one than that of a run."""


def defaults_of(kind: type[Any]) -> dict[str, object]:
    """The fields that have a number or a text where nobody says otherwise."""
    return {
        field.name: field.default
        for field in fields(kind)
        if isinstance(field.default, int | float | str) and not isinstance(field.default, bool)
    }


SETTABLE = {name for kind in REQUESTS for name in defaults_of(kind)}
"""Arguments that a person may leave out."""


def literal(node: ast.expr | None) -> object:
    """The number or text that is written there; None for anything else."""
    value = node.value if isinstance(node, ast.Constant) else None
    return value if isinstance(value, int | float | str) and not isinstance(value, bool) else None


def written_defaults(path: Path) -> Iterator[tuple[int, str, object]]:
    """(line, name, value) of each parameter and field whose default is a literal."""
    for node in nodes_of(path):
        if isinstance(node, ast.arguments):
            plain = [*node.posonlyargs, *node.args]
            pairs = [*zip(reversed(plain), reversed(node.defaults), strict=False)]
            pairs += [(each, value) for each, value in zip(node.kwonlyargs, node.kw_defaults, strict=True) if value]
            yield from ((each.lineno, each.arg, literal(value)) for each, value in pairs)
        elif isinstance(node, ast.ClassDef):
            for line in node.body:
                if not isinstance(line, ast.AnnAssign) or "ClassVar" in ast.unparse(line.annotation):
                    continue
                if isinstance(line.target, ast.Name):
                    yield line.lineno, line.target.id, literal(line.value)


def fallbacks(path: Path) -> Iterator[tuple[int, object]]:
    """(line, value) of each literal behind an `or`."""
    for node in nodes_of(path):
        if isinstance(node, ast.BoolOp) and isinstance(node.op, ast.Or):
            for value in node.values[1:]:
                yield from ((node.lineno, literal(each)) for each in getattr(value, "elts", [value]))


@reads_the_source
@every("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_module_writes_a_default_of_its_own(path: Path) -> None:
    if path == Path(defaults.__file__):
        return
    is_below = path.relative_to(PACKAGE).as_posix().startswith(BELOW)
    parameters = [
        (line, name)
        for line, name, value in written_defaults(path)
        if (name in SETTABLE and value is not None and not is_below) or value in TEXTS
    ]
    assert parameters == []
    assert [line for line, value in fallbacks(path) if value in TEXTS] == []
    constants = [target.id for node in tree_of(path).body if isinstance(node, ast.Assign)
                 for target in node.targets if isinstance(target, ast.Name)]  # fmt: skip
    assert [name for name in constants if name.startswith("DEFAULT_")] == []


def test_what_a_person_may_leave_out_is_what_there_is_a_default_for() -> None:
    shared = {value for kind in REQUESTS for value in defaults_of(kind).values()}
    assert shared <= {value for name, value in vars(defaults).items() if name.isupper()}
    assert {"node", "duration", "seed", "input", "amplitude", "hand"} <= SETTABLE


def test_the_protocol_of_the_bus_decides_about_rate_and_drive(command: Command) -> None:
    assert (Task("wall").rate, Task("wall").drive) == (None, None)
    found = api.plan("wall"), api.plan("wall", bus="sim-modbus-rtu@115200")
    assert [plan.rate for plan in found] == [defaults.DEFAULT_RATE, 140.0]
    drives = [defaults.DEFAULT_DRIVE, defaults.DEFAULT_MODBUS_DRIVE]
    assert [plan.axes[0].profile.name for plan in found] == drives
    text = " ".join(command("plan", "--help").out.replace("│", " ").split())
    assert f"[default: {drives[0]} on CAN, {drives[1]} on Modbus]" in text
    assert "[default: 1000 on CAN, the highest possible on Modbus]" in text


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_the_defaults_of_what_it_asks(name: str) -> None:
    options, asked = (defaults_of(kind) for kind in COMMANDS[name])
    assert {key: value for key, value in options.items() if key in asked} == {
        key: asked[key] for key in options if key in asked
    }


@pytest.mark.parametrize("name", [*COMMANDS, "simulate", "report"])
def test_the_help_shows_each_default_once(name: str, command: Command) -> None:
    text = " ".join(command(name, "--help").out.replace("│", " ").split())
    parts = re.split(r"(?=--\w[\w-]* )", text)[1:]
    shown = {part.split()[0]: re.findall(r"\[default: ([^\]]*)\]", part) for part in parts}
    assert all(len(found) <= 1 for found in shown.values()), shown
    if name in COMMANDS:
        asked = defaults_of(COMMANDS[name][1])
        written = {key: exactly(value) if isinstance(value, float) else str(value) for key, value in asked.items()}
        assert {key: shown[f"--{key}"] for key in written if f"--{key}" in shown} == {
            key: [value] for key, value in written.items() if f"--{key}" in shown
        }
