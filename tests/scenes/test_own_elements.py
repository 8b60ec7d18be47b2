"""Elements that other packages add: used like ours, imported when they are named, and told of when they are broken.

`plugin/` is what such a package installs; its clay is the one of examples/own_memory.py.
"""

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, ClassVar

import pytest

import haptic_fieldbus
from haptic_fieldbus.cli import main
from haptic_fieldbus.errors import SafetyTripError, SceneError, UsageError
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names, scene_schema
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, kind_names, kind_of, own_elements
from haptic_fieldbus.schemas import main as write_schemas
from haptic_fieldbus.signals import Signal
from tests.builders import scene_of
from tests.scenes.packages import CLASS, install
from tests.test_schemas import accepts

PLUGIN = Path(__file__).parent / "plugin"
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
AXIS = '[axis.handle]\nworkspace = "linear"\n'
CLAY = f'{AXIS}[[element]]\nkind = "clay"\naxis = "handle"\nstiffness = "0.5 N/mm"\nlimit = 3.0\nposition = "10 mm"\n'
OWN = f'{AXIS}[[element]]\nkind = "own"\naxis = "handle"\n'
SHAFT = f'{AXIS}[axis.other]\nworkspace = "linear"\n[[element]]\nkind = "soft_shaft"\naxes = ["handle", "other"]\n'
NUMBERS = count()


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package is on the path, as pip would put it there, and not yet imported."""
    for folder in (PLUGIN, EXAMPLES):
        monkeypatch.syspath_prepend(str(folder))
    for module in ("clay_elements", "own_memory"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    yield
    for module in ("clay_elements", "own_memory"):
        sys.modules.pop(module, None)


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def outcome(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


@pytest.mark.usefixtures("installed")
class TestUsedLikeOurs:
    def test_a_scene_file_names_its_kind_and_gives_units(self, tmp_path: Path) -> None:
        (clay,) = load_scene(write(tmp_path, CLAY)).elements
        assert type(clay).__name__ == "Clay"
        assert (clay.name, vars(clay)["stiffness"], vars(clay)["position"]) == ("clay", 500.0, 0.010)
        assert kind_of(type(clay)) == "clay"

    def test_its_faults_are_told_with_line_and_key_like_ours(self, tmp_path: Path) -> None:
        text = CLAY.replace("3.0", "-3.0").replace('"10 mm"', '"10 N"') + "colour = 1\n"
        with pytest.raises(SceneError) as caught:
            load_scene(write(tmp_path, text))
        assert [str(fault) for fault in caught.value.faults] == [
            "line 7: element[0].limit: -3.0; expected a number from 1e-9 to 1e9",
            'line 8: element[0].position: "10 N"; expected a length in m, because the axis is linear; '
            "N is a unit of a force on a linear axis",
            "line 9: element[0].colour: unknown key; known: axis, limit, name, position, stiffness",
        ]

    def test_it_is_planned_judged_run_and_answers(self, tmp_path: Path) -> None:
        path = write(tmp_path, CLAY)
        assert "own_memory" in haptic_fieldbus.plan(path).modules
        judged = haptic_fieldbus.stability(path, settings={"clay.stiffness": "max/2"})
        assert judged.margin == pytest.approx(2.0)
        result = haptic_fieldbus.run(path, hand="guide", duration=2.0, changes=[(1.5, {"clay.stiffness": "0.6 N/mm"})])
        assert result.verdict is not None
        assert result.verdict.startswith("Feels right: ")
        answer = haptic_fieldbus.response(path, input="ramp", amplitude=0.1)
        assert answer.force.min() == pytest.approx(-3.0)

    @pytest.mark.parametrize(
        ("text", "verdict"),
        [
            (f"{SHAFT}stiffness = 300\n", Verdict.STABLE),
            (f'{AXIS}[[element]]\nkind = "heavy_puck"\naxis = "handle"\nstiffness = 100\nmass = 0.5\n', Verdict.STABLE),
        ],
        ids=["of two axes", "with virtual states"],
    )
    def test_each_sort_of_law_runs(self, tmp_path: Path, text: str, verdict: Verdict) -> None:
        result = haptic_fieldbus.run(write(tmp_path, text), duration=0.5)
        assert result.missed_cycles == 0
        assert haptic_fieldbus.stability(write(tmp_path, text)).verdict in (Verdict.PASSIVE, verdict)

    @pytest.mark.thorough("judges the scene on every drive")
    def test_the_commands_show_it(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = write(tmp_path, CLAY)
        assert outcome(capsys, "scenes", "check", path)[0] == 0
        status, out, _ = outcome(capsys, "scenes", "show", path, "--json")
        assert status == 0
        assert json.loads(out)["elements"][0]["kind"] == "clay"
        assert "500" in outcome(capsys, "scenes", "show", path)[1]
        assert outcome(capsys, "plan", path, "--set", "clay.stiffness=300")[0] == 0

    def test_the_list_says_where_it_comes_from(self, capsys: pytest.CaptureFixture[str]) -> None:
        status, out, err = outcome(capsys, "scenes", "list")
        assert (status, err) == (0, "")
        assert ["clay", "clay-elements", "1.0", "own_memory:Clay"] in [line.split() for line in out.splitlines()]
        listed = json.loads(outcome(capsys, "scenes", "list", "--json")[1])["own_elements"]
        assert {
            "kind": "clay",
            "package": "clay-elements 1.0",
            "entry_point": "own_memory:Clay",
            "fault": None,
        } in listed

    def test_a_schema_for_editors_has_it_beside_ours(self, tmp_path: Path) -> None:
        assert accepts(scene_schema(own=True), CLAY)
        assert accepts(scene_schema(own=True), f"{SHAFT}stiffness = 3\nfeel = 'soft'\n")
        assert not accepts(scene_schema(own=True), f"{SHAFT}stiffness = 3\nfeel = 'hard'\n")
        assert not accepts(scene_schema(own=True), CLAY.replace("3.0", "-3.0"))
        assert not accepts(scene_schema(), CLAY)
        assert write_schemas([str(tmp_path)]) == 0
        assert '"own.clay"' in (tmp_path / "scene.schema.json").read_text(encoding="utf-8")

    def test_nothing_is_imported_for_scenes_without_it(self, tmp_path: Path) -> None:
        for name in scene_names():
            load_scene(name)
        with pytest.raises(SceneError, match=r'"clai"; expected a kind of element, see .*; nearest: clay'):
            load_scene(write(tmp_path, CLAY.replace('"clay"', '"clai"')))
        assert "clay" in kind_names()
        assert not {"clay_elements", "own_memory"} & set(sys.modules)
        load_scene(write(tmp_path, CLAY))
        assert "clay_elements" not in sys.modules, "another element of the same package"


class Broken:
    """A package that is broken in one way."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.package = folder / "site", f"broken_{next(NUMBERS)}"
        monkeypatch.syspath_prepend(str(self.folder))

    def refused(self, module: str, kind: str = "own", at: str = "Own") -> str:
        """Message about a scene that names its element, without the place in the file."""
        install(self.folder, self.package, f"{kind} = {self.package}{f':{at}' if at else ''}", module)
        written = f'{AXIS}[[element]]\nkind = "{kind}"\nname = "own"\naxis = "handle"\nstiffness = 300\n'
        with pytest.raises(SceneError) as caught:
            load_scene(write(self.folder, written))
        (fault,) = caught.value.faults
        place = f'element "{kind}" of {self.package} 1.0 (entry point {self.package}{f":{at}" if at else ""}): '
        assert fault.key == "element[0].kind"
        assert fault.message.startswith(place)
        (listed,) = own_elements()
        assert listed.fault == fault.message
        haptic_fieldbus.plan("wall")
        return fault.message.removeprefix(place)


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Broken:
    return Broken(tmp_path, monkeypatch)


class TestBroken:
    @pytest.mark.parametrize(
        ("module", "told"),
        [
            ("import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
            ("raise SystemExit(7)", "SystemExit: 7"),
            ("raise RuntimeError", "RuntimeError"),
            ("raise ValueError('one\\ntwo')", "ValueError: one"),
            ("def", "SyntaxError: invalid syntax"),
            ("class Other: ...", "AttributeError: module "),
        ],
    )
    def test_that_cannot_be_imported(self, broken: Broken, module: str, told: str) -> None:
        assert broken.refused(module).startswith(f"it cannot be imported: {told}")

    @pytest.mark.thorough("15 cases of one rule", quick=5)
    @pytest.mark.parametrize(
        ("old", "new", "told"),
        [
            ("(frozen=True)", "", "expected a frozen dataclass"),
            ("@dataclass(frozen=True)\n", "", "expected a frozen dataclass"),
            ("class Own:", "class Not: ...\nOwn = 3\nclass Other:", "expected a frozen dataclass"),
            (
                "    __pydantic_config__: ClassVar = STRICT\n",
                "",
                "files could set it to any value: add __pydantic_config",
            ),
            ("= STRICT", "= {}", "files could set it to any value: add __pydantic_config__: ClassVar = STRICT"),
            ('    name: str = "own"\n', "", 'no field "name"'),
            ("    axis: str\n", "", 'expected one field "axis", or "axes" for two axes'),
            ("axis: str", "axes: tuple[str, str]", "expected begin, not ['force']"),
            ("def needs", "def wants", "no needs"),
            ("def linearised", "def straight", "no linearised"),
            ("def force", "def strength", "expected one of force, begin and dynamics, not none"),
            (
                "def force",
                "begin = 1\n    def force",
                "expected one of force, begin and dynamics, not ['force', 'begin']",
            ),
            ("stiffness: Stiffness", "stiffness: object()", "its fields cannot be read from a file: "),
            ("stiffness: Stiffness", "stiffness: 'Nowhere'", "its fields cannot be read from a file: NameError"),
            ("stiffness: Stiffness", "stiffness: type(gain)", "its fields cannot be read from a file: Pydantic"),
        ],
    )
    def test_as_a_class(self, broken: Broken, old: str, new: str, told: str) -> None:
        assert old in CLASS
        assert broken.refused(CLASS.replace(old, new)).startswith(told)

    def test_but_not_as_a_class_that_has_an_element_as_its_base(self, broken: Broken) -> None:
        module = CLASS.replace("class Own:", "class Base:") + "\nclass Own(Base): ...\n"
        install(broken.folder, broken.package, f"own = {broken.package}:Own", module)
        assert element_type("own").__name__ == "Own"
        assert own_elements()[0].fault is None

    def test_all_faults_of_a_class_are_told_at_once(self, broken: Broken) -> None:
        told = broken.refused(CLASS.replace("def needs", "def wants").replace("def force", "def strength"))
        assert told == "no needs; expected one of force, begin and dynamics, not none"

    def test_as_an_entry_point(self, broken: Broken) -> None:
        assert broken.refused(CLASS, at="") == "expected a frozen dataclass"

    @pytest.mark.parametrize("kind", ["../wall", "a b", "*", "ключ", "-"])
    def test_by_its_name(self, broken: Broken, kind: str) -> None:
        assert broken.refused(CLASS, kind) == "its name is no kind; expected a letter, then letters, digits, _, - or ."

    @pytest.mark.parametrize(
        ("old", "new", "told"),
        [
            ("(Signal.POSITION,)", '("position",)', "needs 'position'; expected "),
            ("(Signal.POSITION,)", "(Signal.CONTROLWORD,)", "needs <Signal.CONTROLWORD"),
            ("(Signal.POSITION,)", "3", "its needs or linearised() end in TypeError"),
            ("gain([[-self.stiffness, 0.0]])", "1 / 0", "its needs or linearised() end in ZeroDivisionError"),
            (
                "[[-self.stiffness, 0.0]]",
                "[[-self.stiffness]]",
                "linearised() must return a StateSpace with 2 inputs and 1 ou",
            ),
            (
                "gain([[-self.stiffness, 0.0]])",
                "None",
                "linearised() must return a StateSpace with 2 inputs and 1 output",
            ),
        ],
    )
    def test_as_an_element(self, broken: Broken, old: str, new: str, told: str) -> None:
        assert old in CLASS
        install(broken.folder, broken.package, f"own = {broken.package}:Own", CLASS.replace(old, new))
        with pytest.raises(SceneError) as caught:
            load_scene(write(broken.folder, f'{AXIS}[[element]]\nkind = "own"\naxis = "handle"\nstiffness = 3\n'))
        (fault,) = caught.value.faults
        assert fault.message.startswith(f'element "own": {told}')

    @pytest.mark.parametrize(
        ("old", "new", "where"),
        [
            ("@dataclass", "1 / 0\n@dataclass", "@dataclass"),
            ("return gain([[-self.stiffness, 0.0]])", "return 1 / 0", "return gain"),
        ],
        ids=["at its import", "in linearised"],
    )
    def test_its_error_keeps_cause_file_and_line(self, broken: Broken, old: str, new: str, where: str) -> None:
        install(broken.folder, broken.package, f"own = {broken.package}:Own", CLASS.replace(old, new))
        with pytest.raises(SceneError) as caught:
            load_scene(write(broken.folder, f"{OWN}stiffness = 3\n"))
        line = 1 + CLASS[: CLASS.index(where)].count("\n")
        place = f"({broken.folder / broken.package}.py, line {line})"
        assert f"ZeroDivisionError: division by zero {place}" in str(caught.value)
        assert 'element "own"' in str(caught.value)
        assert isinstance(caught.value.__cause__, ZeroDivisionError)

    def test_an_error_of_its_making_names_element_file_and_line(
        self, broken: Broken, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """Of other errors than ValueError, which is a fault of the value."""
        making = CLASS + "\n    def __post_init__(self):\n        raise OSError('no disk')\n"
        install(broken.folder, broken.package, f"own = {broken.package}:Own", making)
        scene = write(broken.folder, f"{OWN}stiffness = 3\n")
        with pytest.raises(SceneError) as caught:
            haptic_fieldbus.plan(scene)
        source, line = f"{broken.folder / broken.package}.py", making.count("\n")
        words = "Own.__post_init__ raised OSError: no disk"
        assert str(caught.value) == f"{source}: line {line}: element own: {words}"
        assert isinstance(caught.value.__cause__, OSError)
        status, out, err = outcome(capsys, "run", scene, "--json")
        assert (status, err) == (2, f"{caught.value}\n")
        assert json.loads(out)["errors"] == [{"source": source, "key": "element own", "line": line, "message": words}]

    def test_an_error_in_its_force_ends_the_run_with_element_file_and_line(
        self, broken: Broken, capsys: pytest.CaptureFixture[str]
    ) -> None:
        law = CLASS.replace("return -self", "return helper() if position > 1e-3 else -self")
        law += "\n\ndef helper():\n    raise ValueError('table')\n"
        install(broken.folder, broken.package, f"own = {broken.package}:Own", law)
        scene = write(broken.folder, f'{OWN}name = "mine"\nstiffness = 30\n')
        with pytest.raises(SafetyTripError) as caught:
            haptic_fieldbus.run(scene, duration=1.0)
        place = f"({broken.folder / broken.package}.py line {law.count(chr(10))})"
        told = f"the scene failed: element mine: helper raised ValueError: table {place}; "
        assert told in str(caught.value)
        assert isinstance(caught.value.__cause__, ValueError)
        status, out, err = outcome(capsys, "run", scene, "--duration", 1, "--json")
        assert status == 3
        assert told in err
        assert place in json.loads(out)["trips"][0]["message"]

    def test_an_error_that_is_none_of_arithmetic_is_told_before_anything_moves(self, broken: Broken) -> None:
        law = CLASS.replace("return -self", "return helper() if position > 1e-3 else -self")
        law += "\n\ndef helper():\n    raise KeyError('table')\n"
        install(broken.folder, broken.package, f"own = {broken.package}:Own", law)
        with pytest.raises(SceneError, match="element mine: helper raised KeyError: 'table'"):
            haptic_fieldbus.run(write(broken.folder, f'{OWN}name = "mine"\nstiffness = 30\n'), duration=1.0)

    def test_it_prints_nothing_beside_an_object(self, broken: Broken, capsys: pytest.CaptureFixture[str]) -> None:
        install(broken.folder, broken.package, f"own = {broken.package}:Own", "print('hello')" + CLASS)
        status, out, err = outcome(capsys, "scenes", "list", "--json")
        assert (status, err) == (0, "hello\n")
        assert json.loads(out)["own_elements"][0]["fault"] is None

    def test_its_fault_is_told_beside_the_list(self, broken: Broken, capsys: pytest.CaptureFixture[str]) -> None:
        broken.refused("raise SystemExit(7)")
        status, out, err = outcome(capsys, "scenes", "list")
        assert status == 0
        assert "wall" in out
        assert "cannot be imported: SystemExit: 7" in " ".join(err.split())


def test_two_packages_with_one_name_are_both_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("twin_one", "twin_two"):
        install(tmp_path, package, f"twin = {package}:Own")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UsageError) as caught:
        element_type("twin")
    for package in ("twin_one", "twin_two"):
        assert f"{package} 1.0 (entry point {package}:Own)" in str(caught.value)
    assert str(caught.value).endswith("several packages provide it; uninstall all but one")
    assert not {"twin_one", "twin_two"} & set(sys.modules)


def test_a_shipped_element_keeps_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, "walled", "wall = walled:Own")
    monkeypatch.syspath_prepend(str(tmp_path))
    (wall,) = load_scene("wall").elements
    assert type(wall).__module__ == "haptic_fieldbus.scenes.wall"
    (listed,) = own_elements()
    assert listed.fault == (
        'element "wall" of walled 1.0 (entry point walled:Own): a shipped element has this name and is used instead'
    )
    assert kind_names() == list(ELEMENTS)
    assert "walled" not in sys.modules


@dataclass(frozen=True)
class Own:
    """An element made in Python; `fault` says what of it is wrong."""

    fault: str
    axis: str = "handle"
    name: str = "mine"
    needs: ClassVar = (Signal.POSITION,)

    def begin(self, period: float) -> Any:
        if self.fault == "begin":
            raise KeyError("table")

        def law(position: float) -> float:
            raise OSError("no disk")

        return (lambda: 0.0) if self.fault == "call" else law

    def linearised(self) -> Any:
        if self.fault == "linearised":
            raise RuntimeError("no model")
        return gain([[-1.0, 0.0]])


MADE = {
    "begin": ("Own.begin raised KeyError: 'table'", 'raise KeyError("table")', KeyError),
    "law": ("Own.begin.<locals>.law raised OSError: no disk", 'raise OSError("no disk")', OSError),
    "call": ("a call of Own raised TypeError: ", "", TypeError),
    "linearised": ("Own.linearised raised RuntimeError: no model", 'raise RuntimeError("no model")', RuntimeError),
}
"""Words, the text of the line, and the class of each error."""


@pytest.mark.parametrize("fault", MADE)
def test_an_error_of_an_element_made_in_python_is_told_by_every_function(fault: str) -> None:
    words, text, cause = MADE[fault]
    lines = Path(__file__).read_text(encoding="utf-8").splitlines()
    line = f"line {next(place for place, each in enumerate(lines, 1) if each.strip() == text)}: " if text else ""
    scene = scene_of(Own(fault))
    calls: dict[str, Callable[[], object]] = {
        "begin": lambda: haptic_fieldbus.run(scene, duration=0.1),
        "law": lambda: haptic_fieldbus.response(scene),
        "call": lambda: haptic_fieldbus.response(scene),
        "linearised": lambda: haptic_fieldbus.stability(scene, mass=1.0),
    }
    with pytest.raises(SceneError) as caught:
        calls[fault]()
    assert str(caught.value).startswith(f"{__file__}: {line}element mine: {words}")
    assert isinstance(caught.value.__cause__, cause)


def test_an_error_of_ours_is_not_blamed_on_an_element() -> None:
    with pytest.raises(ZeroDivisionError), own_faults():
        raise ZeroDivisionError
