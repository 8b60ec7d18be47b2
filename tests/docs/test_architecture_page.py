"""docs/explanation/architecture.md says what the code does: its picture, its names, and both of its ways."""

import ast
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import haptic_fieldbus
from haptic_fieldbus.api.site import BUS_GROUP, SIMULATION_GROUP
from haptic_fieldbus.cli import main
from haptic_fieldbus.planning import compile
from haptic_fieldbus.protocols import catalogue
from haptic_fieldbus.protocols.registry import GROUP
from tests.calls import Call, Calls, Function, traced
from tests.cases import every

pytestmark = pytest.mark.unwatched("looks at who calls whom, and a witness calls too")

PROJECT = Path(__file__).resolve().parents[2]
PACKAGE = PROJECT / "haptic_fieldbus"
PAGE = PROJECT / "docs" / "explanation" / "architecture.md"
TEXT = PAGE.read_text(encoding="utf-8")
TWO_SCREENS, WIDEST = 110, 120

MENTION = re.compile(r"`([\w/]+\.py)(?:: (\w+))?`")
FOLDER = re.compile(r"`([\w/]+/)`")

HANDED_IN = {
    ("documents.document", "protocols.canopen.profile"): "a file becomes the dataclass that the caller names",
    (
        "running.session",
        "api.site",
    ): "the site of a run is a context that the caller made; the run enters and leaves it",
    ("buses.canopen.wire", "sim.canopen.site"): "the master has a port to the wire; it cannot see which",
    ("buses.canopen.master", "sim.canopen.bus"): "the same, when it is closed",
    ("assessing.summary", "sim.bench"): "a run is judged by the true motion that its bench knows",
    ("assessing.summary", "sim.canopen.world"): "the world may forget the motion that has been judged",
    ("assessing.recording", "sim.mechanics.trajectory"): "the same motion, instant by instant",
}
"""Where a module of a lower room calls one of a higher, and what it was handed for it."""


@cache
def maker() -> ModuleType:
    """The script that draws the picture."""
    spec = importlib.util.spec_from_file_location("make_architecture", PROJECT / "docs" / "make_architecture.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def section(words: str) -> str:
    """The part of the page under the heading with these words."""
    return next(part for part in re.split(r"^## ", TEXT, flags=re.MULTILINE) if words in part.partition("\n")[0])


def way(words: str) -> list[str]:
    """The functions of a table in the order of their first mention, as `str` of a `Function`."""
    rows = [row for row in section(words).splitlines() if row.startswith("| ")]
    column = next(place for place, head in enumerate(rows[0].split("|")) if head.strip() == "where")
    mentions = [MENTION.search(row.split("|")[column]) for row in rows[1:]]
    return list(dict.fromkeys(f"{found[1]}: {found[2]}" for found in mentions if found is not None))


def in_order(calls: list[Call], names: list[str]) -> list[str]:
    """Functions that are called, by their first call."""
    return [name for name in dict.fromkeys(str(call.called) for call in calls) if name in names]


def defined(path: Path) -> Iterator[str]:
    """Everything that a file gives a name, inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def test_the_page_fits_on_two_screens_with_one_picture() -> None:
    lines = TEXT.splitlines()
    assert len(lines) <= TWO_SCREENS
    assert max(map(len, lines)) <= WIDEST
    assert len(re.findall(r"!\[", TEXT)) == 1


def test_the_picture_is_that_of_the_imports() -> None:
    script = maker()
    assert script.FILE.read_text(encoding="utf-8") == script.picture(), "run: make docs"


@every("mention", sorted(set(MENTION.findall(TEXT))), ids=": ".join)
def test_every_file_and_every_name_on_the_page_is_there(mention: tuple[str, str]) -> None:
    path, name = mention
    assert (PACKAGE / path).is_file()
    assert not name or name in defined(PACKAGE / path)


def test_every_folder_on_the_page_is_there() -> None:
    folders = [folder for folder in FOLDER.findall(TEXT) if folder != "haptic_fieldbus/"]
    assert folders
    assert [folder for folder in folders if not (PACKAGE / folder).is_dir()] == []


def test_a_second_protocol_has_the_groups_of_the_page() -> None:
    groups = re.findall(r"`(haptic_fieldbus\.\w+)`", section("second protocol"))
    assert groups == [GROUP, BUS_GROUP, SIMULATION_GROUP]


def test_one_period_goes_the_way_of_the_page() -> None:
    """In the first period of operation enabled, in which the power state is new."""
    with traced() as calls:
        haptic_fieldbus.run("damped_wall", duration=0.05)
    names = way("encoder count")
    assert in_order(first_enabled_period(calls.made), names) == names


def first_enabled_period(calls: list[Call]) -> list[Call]:
    """From the wait of the loop to the next one."""
    waits = [place for place, call in enumerate(calls) if _is_wait(call)]
    enabled = next(place for place, call in enumerate(calls) if str(call.called) == "cycle/axis.py: render")
    start = max(place for place in waits if place < enabled)
    return calls[start : min(place for place in waits if place > enabled)]


def _is_wait(call: Call) -> bool:
    called, caller = call.called, call.caller
    return called.name.endswith(".sleep_until") and caller is not None and caller.module == "running.loop"


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("given", ["as an option", "in a scene file"])
def test_one_parameter_goes_the_way_of_the_page_and_arrives(given: str, tmp_path: Path) -> None:
    scene, options = "wall", ["--set", "wall.stiffness=800"]
    if given == "in a scene file":
        file = tmp_path / "own.toml"
        text = (PACKAGE / "scenes" / "library" / "wall.toml").read_text(encoding="utf-8")
        file.write_text(re.sub(r"stiffness = [\d.]+", "stiffness = 800.0", text), encoding="utf-8")
        scene, options = str(file), []
    with traced() as calls, pytest.raises(SystemExit) as stopped:
        main(["run", scene, *options, "--duration", "0.05"])
    names = way("parameter to the loop")
    assert not stopped.value.code
    assert in_order(calls.made, names) == names
    assert calls.stiffnesses == {800.0}


def climbs(calls: Calls) -> dict[tuple[str, str], tuple[Function, Function]]:
    """By both modules: a call from one room to another that does not stand below it."""
    heights = {room: -height for height, layer in enumerate(maker().layers()) for room in layer}
    return {
        (call.caller.module, call.called.module): (call.caller, call.called)
        for call in calls.made
        if call.caller is not None
        and call.caller.room != call.called.room
        and heights[call.caller.room] <= heights[call.called.room]
    }


@pytest.fixture
def _first_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that an earlier test has read and judged is read and judged again, so that its calls are seen."""
    catalogue._shipped.cache_clear()
    monkeypatch.setattr(compile, "_known", compile._itself)


@pytest.mark.thorough("traces every call of a run")
@pytest.mark.usefixtures("_first_plan")
def test_no_room_calls_a_higher_one_but_through_what_it_was_handed() -> None:
    """One second: long enough to touch the wall, and to be judged by it."""
    with traced() as calls:
        result = haptic_fieldbus.run("wall", settings={"wall.stiffness": 800.0}, duration=1.0)
    assert result.verdict is not None
    assert result.verdict.startswith("Feels right")
    assert calls.stiffnesses == {800.0}
    found = climbs(calls)
    assert set(found) == set(HANDED_IN), [f"{caller} → {called}" for caller, called in found.values()]


@pytest.mark.usefixtures("_first_plan")
def test_planning_calls_nothing_above_it() -> None:
    with traced() as calls:
        haptic_fieldbus.plan("damped_wall", settings={"wall.stiffness": "max/2"})
    assert set(climbs(calls)) == {("documents.document", "protocols.canopen.profile")}
