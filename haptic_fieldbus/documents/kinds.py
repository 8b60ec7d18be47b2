"""The kind of file that a TOML text is: a profile, a rig or a scene given in the place of another is told as such.

Each kind has a table that no other has. Without this a rig that is checked as a profile has a page of faults, and none
of them says the one thing that is wrong.

What was made in Python is checked as the file that would give it (`table_of`).
"""

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from typing import Any

from haptic_fieldbus.documents.document import Document
from haptic_fieldbus.errors import Fault

KINDS = {
    "drive": ("a drive profile", "give it as --drive FILE, or check it by: haptic-fieldbus profiles check FILE"),
    "bus": ("a rig", "give it as --rig FILE; it is checked by: haptic-fieldbus plan wall --rig FILE"),
    "element": ("a scene", "give it as SCENE, or check it by: haptic-fieldbus scenes check FILE"),
}
"""Table → the kind of a file that has it, and what to do with such a file."""


def check_kind(document: Document, table: str) -> None:
    """Raise the document's error with one fault when it lacks the `table` of its kind, and has that of another."""
    if table in document.data:
        return
    for other, (kind, advice) in KINDS.items():
        if other in document.data:
            message = f"this is {kind}, and not {KINDS[table][0]}; {advice.replace('FILE', document.source)}"
            raise document.error(document.source, [Fault("", message)])


def table_of(given: Any) -> dict[str, object]:
    """Return the table of a file that would give this dataclass. A None is left out where its key may be missing."""
    return {
        field.name: _plain(getattr(given, field.name))
        for field in fields(given)
        if field.init and not (getattr(given, field.name) is None and _may_be_left_out(field))
    }


def _may_be_left_out(field: Field[Any]) -> bool:
    """Return whether a missing key stands for None: it is the default, or its absence will be reported."""
    return field.default is None or (field.default is MISSING and field.default_factory is MISSING)


def _plain(value: object) -> object:
    """Return the value as TOML would give it; objects that TOML does not have are left for the schema to refuse."""
    if value is None:
        # TOML has no null. This text fails as a number, and the message then shows None as the value.
        return "None"
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, list | tuple):
        return [_plain(member) for member in value]
    if isinstance(value, Mapping):
        return {name: _plain(member) for name, member in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return table_of(value)
    return value.item() if hasattr(value, "item") else value
