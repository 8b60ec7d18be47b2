"""Write docs/reference/elements.md, the elements of scenes as their dataclasses say: `python docs/make_elements.py`."""

import inspect
import sys
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from importlib import import_module
from pathlib import Path
from typing import Any, cast, get_args, get_type_hints

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.registry import ELEMENTS, NOT_SETTABLE, element_type, quantities
from haptic_fieldbus.signals import Workspace

FILE = Path(__file__).resolve().parent / "reference" / "elements.md"

HEAD = """\
# Scene elements

This page lists all kinds of `[[element]]` of a scene file with their parameters. A number is in the SI unit of its
axis: the left unit on a linear axis, the right one on a rotary axis. A string with a unit is valid too:
`stiffness = "0.6 N/mm"`. The command line can set each parameter: `--set wall.stiffness=800`. [Scene
files](scene_files.md) describes the format. Formulas, energy statements and sources are in
`haptic_fieldbus/scenes/KIND.py`.

`make docs` writes this page.
"""


def page() -> str:
    """The text of the page."""
    return "\n".join([HEAD, *(line for kind in ELEMENTS for line in _element(kind))]).rstrip() + "\n"


def _element(kind: str) -> Iterator[str]:
    element = element_type(kind)
    module = import_module(element.__module__)
    yield f"## `{kind}`\n"
    yield f"{_first_paragraph(module.__doc__)}\n"
    yield "| parameter | unit or values | default |\n|---|---|---|"
    for field in fields(cast(Any, element)):
        if field.name not in NOT_SETTABLE:
            yield f"| `{field.name}` | {_unit(kind, field.name)} | {_default(field)} |"
    yield ""
    body = inspect.getdoc(element) or ""
    if body:
        yield f"{body}\n"
    using = [name for name in scene_names() if any(type(part) is element for part in load_scene(name).elements)]
    if using:
        yield f"Used in the scenes: {', '.join(f'`{name}`' for name in using)}.\n"


def _first_paragraph(text: str | None) -> str:
    return " ".join((text or "").partition("\n\n")[0].split())


def _unit(kind: str, name: str) -> str:
    """The units on a linear and on a rotary axis; words that may be chosen in their place."""
    element = element_type(kind)
    quantity = quantities(element).get(name)
    if quantity is None:
        return " or ".join(f"`{word}`" for word in get_args(get_type_hints(element)[name]) if isinstance(word, str))
    only = getattr(element, "workspace", None)
    units = dict.fromkeys(quantity.unit(workspace) for workspace in Workspace if only in (None, workspace))
    return ", ".join(units) or "1"


def _default(field: "Field[Any]") -> str:
    if field.default is MISSING:
        return "required" if field.default_factory is MISSING else f"`{field.default_factory()}`"
    if isinstance(field.default, float):
        return exactly(field.default)
    return "none" if field.default in (None, ()) else f"`{field.default}`"


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
