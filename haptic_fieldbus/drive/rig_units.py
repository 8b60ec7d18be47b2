"""Values of a rig file with their units: `rated_torque = "94 mN·m"`, `position = ["-10 cm", "10 cm"]`.

Texts become numbers in SI before the file is validated, so all rules see numbers. What a field measures is in its
annotation (`Measured`).
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

from haptic_fieldbus.documents import Document, KeyPath
from haptic_fieldbus.documents.edits import table_name, value_text
from haptic_fieldbus.documents.quantities import annotations, parse_quantity, with_units
from haptic_fieldbus.drive.fields import Measured
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.signals import Workspace

# The text of a rig file, for a bench that is known already: the inverse of `load_rig`.
#
# Values that are the default of their key are left out, so the file says what is particular about the bench. What is
# measured in a unit has it beside it.

_UNITS = {
    "bitrate": "bit/s",
    "rated_torque": "N·m",
    "torque_constant": "N·m/A",
    "rated_current": "A",
    "peak_current": "A",
    "inertia": "kg·m², motor and handle together; values are at the motor shaft",
    "viscous_damping": "N·m·s/rad",
    "coulomb_friction": "N·m",
    "metres_per_revolution": "m, travel of the handle per turn of the motor",
}
_OF_HANDLE = {
    Workspace.LINEAR: {"effort": "N", "speed": "m/s", "position": "m", "drift": "m", "acceleration": "m/s²"},
    Workspace.ROTARY: {"effort": "N·m", "speed": "rad/s", "position": "rad", "drift": "rad", "acceleration": "rad/s²"},
}


def rig_text(rig: Rig, heading: str) -> str:
    """Return the text of a rig file; `heading` is a comment at its beginning, of one line or more."""
    comment = "".join(f"# {line}\n" for line in heading.splitlines())
    tables = [text for name, section in rig.bus.items() for text in _table(("bus", name), section, _UNITS)]
    for name, axis in rig.axis.items():
        of_handle = _OF_HANDLE[axis.mechanism.workspace]
        units = _UNITS | of_handle | {"sign_effort": of_handle["effort"]}
        tables += _table(("axis", name), axis, units)
    return "\n".join([comment, *tables])


def _table(path: tuple[str, ...], value: Any, units: dict[str, str]) -> Iterator[str]:
    """Yield a table and then the tables in it; a table without a line is left out."""
    defaults = {each.name: each.default for each in fields(value)}
    given = {name: getattr(value, name) for name in defaults}
    held = {name: one for name, one in given.items() if one is not None and one not in (defaults[name], {})}
    lines = [
        f"{key} = {value_text(one, _number_text)}" + (f"  # {units[key]}" if key in units else "")
        for key, one in held.items()
        if not is_dataclass(one)
    ]
    if lines:
        yield "\n".join([f"[{table_name(path)}]", *lines, ""])
    for key, one in held.items():
        if is_dataclass(one):
            yield from _table((*path, key), one, units)


def _number_text(_: str, number: int | float) -> str:
    return repr(number).replace("e-0", "e-")


REASONS = {None: None, Workspace.ROTARY: "at the motor shaft", Workspace.LINEAR: "at the handle"}
"""Why a unit is expected, in the words of a fault; None: because of the mechanism."""


def convert_units(document: Document, schema: type, path: KeyPath) -> None:
    """Replace texts with units by numbers in SI, in the table at `path` and all tables in it."""
    kind = document.value(*path, "mechanism", "kind")
    workspace = next((space for space in Workspace if space.value == kind), None)
    for place, measured in _places(schema, path):
        value = document.value(*place)
        for text_at in [(*place, index) for index in range(len(value))] if isinstance(value, list) else [place]:
            _convert(document, text_at, measured, workspace)


def _convert(document: Document, path: KeyPath, measured: Measured, workspace: Workspace | None) -> None:
    """Replace one text by its number; a text that is refused stays, and has its one fault."""
    text = document.value(*path)
    if not isinstance(text, str):
        return
    try:
        number = _number(text, measured, workspace)
    except ValueError as error:
        document.refuse(path, str(error))
        return
    held: Any = document.value(*path[:-1])
    # Whole, as a bit rate must be; a float takes it too.
    held[path[-1]] = int(number) if number.is_integer() else number


def _number(text: str, measured: Measured, workspace: Workspace | None) -> float:
    """Return the SI value of a text; raises ValueError with what was expected."""
    space = measured.workspace or workspace
    if space is not None:
        return parse_quantity(text, measured.quantity, space, REASONS[measured.workspace])
    # A fault of the mechanism's kind is told by itself: here a unit of either kind will do.
    with suppress(ValueError):
        return parse_quantity(text, measured.quantity, Workspace.LINEAR)
    return parse_quantity(text, measured.quantity, Workspace.ROTARY)


def _places(schema: type, path: KeyPath) -> Iterator[tuple[KeyPath, Measured]]:
    """Yield the path of each field that measures something, with what it measures."""
    for name, hint in get_type_hints(schema, include_extras=True).items():
        measured = measured_by(hint)
        if measured is not None:
            yield (*path, name), measured
        for table in tables_of(hint):
            yield from _places(table, (*path, name))


def measured_by(hint: Any) -> Measured | None:
    """Return what a field of this type measures; None when it is a name, a count or a table."""
    return next((each for each in annotations(hint) if isinstance(each, Measured)), None)


def tables_of(hint: Any) -> list[type]:
    """Return the dataclasses that a value of this type may be."""
    if is_dataclass(hint) and isinstance(hint, type):
        return [hint]
    return [table for member in get_args(hint) for table in tables_of(member)]


def units_of(measured: Measured) -> str:
    """Return the SI unit of a field, or both where the mechanism decides."""
    spaces = Workspace if measured.workspace is None else (measured.workspace,)
    return " or ".join(dict.fromkeys(measured.quantity.unit(space) for space in spaces))


def schema_with_units(schema: type, tree: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON Schema of a table, where each number that measures something may be a text with its unit."""
    for table in {schema, *_all_tables(schema)}:
        properties = tree.get("$defs", {}).get(table.__name__, tree)["properties"]
        for name, hint in get_type_hints(table, include_extras=True).items():
            measured = measured_by(hint)
            if measured is not None:
                properties[name] = _with_units(properties[name], units_of(measured))
    return tree


def _all_tables(schema: type) -> Iterator[type]:
    for hint in get_type_hints(schema, include_extras=True).values():
        for table in tables_of(hint):
            yield table
            yield from _all_tables(table)


def _with_units(node: dict[str, Any], units: str) -> dict[str, Any]:
    """Return the schema of a value; in a list each member may be a text, not the list."""
    lists = [each for each in node.get("anyOf", [node]) if each.get("type") == "array"]
    for each in lists:
        each["prefixItems"] = [with_units(member, units) for member in each["prefixItems"]]
    return node if lists else with_units(node, units)
