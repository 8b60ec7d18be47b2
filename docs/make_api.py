"""Write docs/reference/api.md, the public names of the package as their code says: `python docs/make_api.py`."""

import ast
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any, get_args, get_type_hints

import haptic_fieldbus
from haptic_fieldbus.api import Trial
from haptic_fieldbus.api.open_loop import OpenLoop
from haptic_fieldbus.api.stability_limits import Device
from haptic_fieldbus.errors import Fault
from haptic_fieldbus.planning.request import Task

FILE = Path(__file__).resolve().parent / "reference" / "api.md"

HEAD = """\
# Python API

This page lists all public names of `haptic_fieldbus`. A name is imported when it is first used. Numbers are SI.
[Compatibility](compatibility.md) lists which names are stable. [examples/](../../examples) has complete programs. Scene
elements, such as `haptic_fieldbus.scenes.wall.Wall`, have [a page of their own](elements.md). You can also [write your
own](../how-to/write_your_own_element.md).

In types, `PositiveFloat` is a float above 0 and `NonNegativeFloat` a float of 0 or more. `Setting` is a float, a string
such as "0.8 N/mm", or a bool. `Scheduled` is a pair of a time [s] and settings. `Array` is a numpy array of float64.

`make docs` writes this page.
"""

GIVEN_BACK = "Return values"
"""Callers do not construct these classes, so the page omits their defaults."""
SECTIONS = {
    "Functions": ("run", "plan", "stability", "response"),
    "Sessions": ("session", "LiveSession"),
    "Sweeps": ("sweep", "Sweep"),
    "Recordings": (
        "repeat",
        "read_recording",
        "RecordedRun",
        "compare_recording",
        "FirstDifference",
        "read_provenance",
        "Provenance",
    ),
    GIVEN_BACK: ("Result", "Plan", "Stability", "Verdict", "Response"),
    "Changes while a scene runs": ("Changes",),
    "Scenes": ("load_scene", "Scene", "SceneAxis", "Signal", "Workspace"),
    "Benches": (
        "load_rig",
        "load_profile",
        "Rig",
        "CanSection",
        "RigAxis",
        "LinearMechanism",
        "RotaryMechanism",
        "Limits",
    ),
}
"""All public names but the errors, in the order of the page."""
OF_ALL = ("scene", "rate", "settings", "method", "estimator")
"""Arguments of a task that all functions take; the others are those of the bench."""
SHARED = {"Common arguments": True, "Bench arguments": False}
"""Arguments that several functions share, each listed once: whether they are in `OF_ALL`, by heading."""
OWN: dict[str, tuple[type, ...]] = {"run": (Trial,), "plan": (), "stability": (Device,), "response": (OpenLoop,)}
"""Fields that are the further arguments of a function."""
FOR_THE_LOOP = {"Changes": ("check", "open", "close", "make", "applied", "waiting", "scheduled")}
"""Methods that only the package calls; the page omits them."""
WHOLE = (haptic_fieldbus.Result, haptic_fieldbus.Stability)
"""Classes whose parts the page lists too."""


def page() -> str:
    """The text of the page."""
    lines = [HEAD, *(line for title, names in SECTIONS.items() for line in _section(title, names))]
    return "\n".join([*lines, *_parts(), *_errors()]).rstrip() + "\n"


def _section(title: str, names: tuple[str, ...]) -> Iterator[str]:
    yield f"## {title}\n"
    for name in names:
        yield from _entry(name, getattr(haptic_fieldbus, name), made=title != GIVEN_BACK)
    if title == "Functions":
        for heading, of_all in SHARED.items():
            yield f"### {heading}\n"
            yield from _table([row for row in _own_fields(Task) if (row[0] in OF_ALL) is of_all])


def _entry(name: str, found: Any, made: bool) -> Iterator[str]:
    if inspect.isclass(found):
        yield from _class(name, found, made)
    elif name in OWN:
        yield from _function_of_values(name, found)
    else:
        yield f"### `{name}{_signature(found)}`\n\n{_doc(found)}\n"


def _function_of_values(name: str, function: Any) -> Iterator[str]:
    """Yield the entry with its own arguments; shared arguments have their own tables."""
    own = [each for kind in OWN[name] for each in _own_fields(kind)]
    taken = [title for title, of_all in SHARED.items() if of_all or "rig" in inspect.signature(function).parameters]
    shared = [f"[{title.lower()}](#{_anchor(title)})" for title in taken]
    yield f"### `{name}({_first(function)}, *, …)`\n\n{_doc(function)}\n"
    yield f"Takes the {' and the '.join(shared)}{', and these keyword arguments:' if own else '.'}\n"
    if own:
        yield from _table(own)


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


def _first(function: Callable[..., object]) -> str:
    """The arguments that need no name."""
    given = inspect.signature(function).parameters.values()
    return ", ".join(str(each.replace(annotation=each.empty)) for each in given if each.kind is not each.KEYWORD_ONLY)


def _class(name: str, found: type, made: bool) -> Iterator[str]:
    yield f"### `{name}`\n\n{_doc(found)}\n"
    if issubclass(found, Enum):
        yield from _members(found)
    elif is_dataclass(found):
        yield from _table([each for kind in reversed(found.__mro__) for each in _own_fields(kind)], made)
    yield from _abilities(name, found)


def _members(found: type[Enum]) -> Iterator[str]:
    told = _Source(found).meanings
    yield "| member | value |\n|---|---|"
    for member in found:
        yield f"| `{member.name}` | `{member.value}`{_after(told.get(member.name))} |"
    yield ""


def _abilities(name: str, found: type) -> Iterator[str]:
    """Properties and methods that a caller may use, each in one line."""
    told = list(_told(name, found))
    if inspect.isfunction(vars(found).get("__init__")) and not is_dataclass(found):
        yield f"`{name}{_signature(vars(found)['__init__'])}`\n"
    if told:
        yield from told
        yield ""


def _told(name: str, found: type) -> Iterator[str]:
    for key, value in vars(found).items():
        if key.startswith("_") or key in FOR_THE_LOOP.get(name, ()):
            continue
        if isinstance(value, property | cached_property):
            yield f"- `{key}`: {_paragraph(value)}" if _paragraph(value) else f"- `{key}`"
        elif inspect.isfunction(value):
            shown = f"{key}{_signature(value)}"
            yield f"- `{shown}`: {_paragraph(value)}" if _paragraph(value) else f"- `{shown}`"


class _Source:
    """Source text of a class: its annotations as written, and the docstring below each field."""

    def __init__(self, found: type) -> None:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(found))).body
        body = tree.body if isinstance(tree, ast.ClassDef) else []
        self.annotations: dict[str, str] = {}
        self.meanings: dict[str, str] = {}
        for place, node in enumerate(body):
            name = _assigned(node)
            if isinstance(node, ast.AnnAssign):
                self.annotations[name] = _written(node.annotation)
            after = body[place + 1] if place + 1 < len(body) else None
            if name and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                self.meanings[name] = " ".join(str(after.value.value).split())


def _assigned(node: ast.stmt) -> str:
    target = (
        node.target if isinstance(node, ast.AnnAssign) else node.targets[0] if isinstance(node, ast.Assign) else None
    )
    return target.id if isinstance(target, ast.Name) else ""


def _written(annotation: ast.expr) -> str:
    """As it is written, without the quotes of what is imported for its type alone, and without checks."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return annotation.value
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) == "Annotated":
        return ast.unparse(annotation.slice.elts[0]) if isinstance(annotation.slice, ast.Tuple) else ""
    return ast.unparse(annotation).replace("fields.", "")  # of a rig, which names its types by their module


Row = tuple[str, str, str, str]
"""Name, type, default and meaning of a field."""


def _own_fields(kind: type) -> list[Row]:
    """The fields that this class adds to those of its bases."""
    if not is_dataclass(kind):
        return []
    source = _Source(kind)
    return [
        (each.name, source.annotations[each.name], _default(each), source.meanings.get(each.name, ""))
        for each in fields(kind)
        if each.name in source.annotations
    ]


def _default(field: "Field[Any]") -> str:
    if field.default is MISSING:
        return "" if field.default_factory is MISSING else f"`{field.default_factory()}`"
    return f"`{field.default}`" if isinstance(field.default, Enum) else f"`{field.default!r}`"


def _table(rows: list[Row], made: bool = True) -> Iterator[str]:
    """A default is told of what a caller makes."""
    yield (
        "| name | type | default | meaning |\n|---|---|---|---|" if made else "| name | type | meaning |\n|---|---|---|"
    )
    for name, kind, default, meaning in rows:
        told = [default or "required"] if made else []
        yield f"| {' | '.join(_in_a_cell(cell) for cell in (f'`{name}`', f'`{kind}`', *told, meaning))} |"
    yield ""


def _parts() -> Iterator[str]:
    """Dataclasses of the package that the fields of `WHOLE` name, and those in them."""
    yield "## Parts of results and scenes\n"
    found: dict[type, None] = {Fault: None}
    for whole in WHOLE:
        _collect(whole, found)
    public = {getattr(haptic_fieldbus, name) for name in haptic_fieldbus.__all__}
    for part in found:
        if part not in public:
            yield from _class(part.__name__, part, made=False)


def _collect(whole: type, found: dict[type, None]) -> None:
    for hint in get_type_hints(whole).values():
        for kind in _classes(hint):
            if is_dataclass(kind) and kind not in found and kind is not haptic_fieldbus.Plan:
                found[kind] = None
                _collect(kind, found)


def _classes(hint: Any) -> Iterator[type]:
    if inspect.isclass(hint):
        yield hint
    for inner in get_args(hint):
        yield from _classes(inner)


def _errors() -> Iterator[str]:
    yield "## Errors\n"
    yield "The name in brackets is a built-in base class of the error. `result` holds the results known at the error.\n"
    yield from _tree(haptic_fieldbus.HapticFieldbusError, 0)


def _tree(error: type[Exception], depth: int) -> Iterator[str]:
    foreign = [base.__name__ for base in error.__bases__ if not base.__module__.startswith("haptic_fieldbus")]
    also = f" ({', '.join(foreign)})" if depth and foreign else ""
    yield f"{'  ' * depth}- `{error.__name__}`{also}: {_paragraph(error)}"
    for inner in error.__subclasses__():
        if inner.__module__ == error.__module__:
            yield from _tree(inner, depth + 1)


def _signature(function: Callable[..., object]) -> str:
    """Arguments and what comes back, as they are written."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    if not isinstance(tree, ast.FunctionDef):
        return "()"
    given = ast.unparse(tree.args).removeprefix("self").removeprefix(", ")
    back = "" if tree.returns is None or tree.name == "__init__" else f" -> {_written(tree.returns)}"
    return f"({given}){back}"


def _in_a_cell(text: str) -> str:
    return text.replace("|", "\\|")


def _doc(found: object) -> str:
    return inspect.getdoc(found) or ""


def _paragraph(found: object) -> str:
    return " ".join(_doc(found).partition("\n\n")[0].split())


def _after(meaning: str | None) -> str:
    return f", {meaning[0].lower()}{meaning[1:]}" if meaning else ""


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
