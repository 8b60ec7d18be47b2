"""Values of a rig file with their units: `rated_torque = "94 mN·m"`, `position = ["-10 cm", "10 cm"]`.

Texts become numbers in SI before the file is validated, so all rules see numbers. What a field measures is in its
annotation (`Measured`).
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import is_dataclass
from typing import Any, get_args, get_type_hints

from haptic_fieldbus.documents import Document, KeyPath
from haptic_fieldbus.documents.quantities import annotations, parse_quantity, with_units
from haptic_fieldbus.drive.fields import Measured
from haptic_fieldbus.signals import Workspace

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
