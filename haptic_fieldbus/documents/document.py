"""Content of a TOML file during reading: its data, and the faults found so far.

Validation runs on JSON in Pydantic's strict mode, where lists become tuples and words become enums, but a text is never
taken for a number and a float never for an integer. There is one exception: a number in a `Literal` is compared by
equality, so true and 1.0 would pass as 1. `integers` refuses them.
"""

import json
import math
import re
import tomllib
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from functools import cache, cached_property
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_args

from haptic_fieldbus.documents.expected import Expectation, KeyPath, Schema, child
from haptic_fieldbus.documents.names import suggestion
from haptic_fieldbus.documents.safe_read import TOML_SIZE, TOO_MANY_DIGITS, fault_of_data, fault_of_text, read_octets
from haptic_fieldbus.errors import DocumentError, Fault

if TYPE_CHECKING:
    from pydantic import TypeAdapter

    from haptic_fieldbus.documents.positions import Positions


T = TypeVar("T")

_AT_LINE = re.compile(r"\s*\(at line (\d+), column (\d+)\)$")
_AT_END = re.compile(r"\s*\(at end of document\)$")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SHOWN_LENGTH = 60
_MOST_FAULTS = 100
"""Largest number of keys with reported faults; further faults of a file are left out."""


class Document:
    """The data of one TOML file: `fault` notes a fault, `checked` raises all noted faults.

    Raises `error` when the text is not TOML.
    """

    def __init__(self, source: str, text: str, error: type[DocumentError]) -> None:
        self.source = source
        self.text = text
        self.error = error
        self.labels: dict[KeyPath, str] = {}
        """Names of values that do not come from the file; a fault shows the name instead of key and line."""
        self.faults: dict[KeyPath, list[str]] = {}
        """Messages noted so far, by key."""
        self.cause: BaseException | None = None  # in the code of an own element; `checked` raises from it
        self.data = self._parse()

    @property
    def faulty(self) -> bool:
        return bool(self.faults)

    def value(self, *path: str | int) -> object:
        """Return the unchecked value at a key; None when there is none."""
        value: object = self.data
        for step in path:
            value = child(value, step)
        return value

    def table(self, *path: str | int) -> dict[str, object]:
        """Return the table at a key; empty when there is none."""
        return value if isinstance(value := self.value(*path), dict) else {}

    def rows(self, *path: str | int) -> dict[KeyPath, object]:
        """Return the members of the list at a key by their own keys; empty when there is none."""
        value = self.value(*path)
        return {(*path, number): each for number, each in enumerate(value)} if isinstance(value, list) else {}

    def fault(self, path: KeyPath, message: str, *, also: bool = False) -> None:
        """Note a fault at a key; a further message for the same key is dropped unless it has `also`."""
        if path not in self.faults and len(self.faults) >= _MOST_FAULTS:
            return
        messages = self.faults.setdefault(path, [])
        if also or not messages:
            messages.append(message)

    def refuse(self, path: KeyPath, expected: str) -> None:
        """Note that the value at a key is not as expected."""
        self.fault(path, f"{self._shown(path)}; expected {expected}")

    def integers(self, path: KeyPath) -> None:
        """Refuse true, false and floats where a `Literal` has whole numbers."""
        if isinstance(self.value(*path), bool | float):
            self.refuse(path, "a whole number")

    def checked(self, value: T | None) -> T:
        """Return a value from `validate`; raises `error` with all noted faults, by line, if there are any."""
        if value is None or self.faults:
            faults = [self._fault(path, message) for path, messages in self.faults.items() for message in messages]
            faults.sort(key=lambda fault: fault.line or math.inf)
            if len(self.faults) >= _MOST_FAULTS:
                faults.append(Fault("", f"the first {_MOST_FAULTS} errors; there may be more"))
            raise self.error(self.source, faults) from self.cause
        return value

    def validate(self, schema: type[T], path: KeyPath = (), *, loaded: Sequence[str] = ()) -> T | None:
        """Return the table at `path` as a dataclass; notes faults and returns None if there are any.

        The file must not contain the `loaded` fields, which the program sets.
        """
        from pydantic import ValidationError

        value, kind = self.value(*path), cast(Hashable, schema)
        for name in (name for name in loaded if name in self.table(*path)):
            names = [known for known in _expectation(kind).names((), value) if known not in loaded]
            self.fault((*path, name), f"unknown key{suggestion(name, names)}")
        try:
            return cast(T, _adapter(kind).validate_json(json.dumps(value, default=_no_date), strict=True))
        except ValidationError as error:
            found = error.errors(include_url=False, include_context=False, include_input=False)
            for item in found[:_MOST_FAULTS]:
                if item["type"] == "value_error":
                    self._rule(item["msg"].removeprefix("Value error, "), (*path, *_follow(value, item["loc"])))
                else:
                    self._translate(item["type"], item["loc"], kind, path, loaded)
        return None

    def _rule(self, message: str, path: KeyPath) -> None:
        """Note a ValueError that a dataclass raised, at the key with which its message begins."""
        # Rules across fields begin with a field, as in "lower 3: expected less than upper, 2".
        name = re.split(r"[\s.:\[]", message, maxsplit=1)[0]
        rest = message.removeprefix(name).lstrip(" :")
        if name in self.table(*path):
            self.fault((*path, name), rest)
        else:
            self.fault(path, message)

    def _translate(self, kind: str, location: KeyPath, schema: Hashable, at: KeyPath, loaded: Sequence[str]) -> None:
        """Note a fault that Pydantic found, in our own words."""
        root = self.value(*at)
        path = _follow(root, location)
        expectation = _expectation(schema)
        if kind == "unexpected_keyword_argument" and path and path[-1] == location[-1]:
            names = [name for name in expectation.names(path[:-1], root) if len(path) > 1 or name not in loaded]
            self.fault(at + path, f"unknown key{suggestion(str(path[-1]), names)}")
        elif kind == "missing":
            path = (*path, location[-1])
            self.fault(at + path, f"missing; expected {expectation.describe(path, root)}")
        elif kind == "json_invalid":
            # The JSON is our own, so nothing but its depth can be invalid.
            self.fault(at, "nested too deeply")
        else:
            # The tag that chooses the member of a union is its `kind`.
            tag = ("kind",) if kind.startswith("union_tag") else ()
            self._expect(expectation, (*path, *tag), root, at)

    def _expect(self, expectation: Expectation, path: KeyPath, root: object, at: KeyPath) -> None:
        shown = self._shown(at + path)
        described = expectation.describe(path, root, hexadecimal=shown.startswith("0x"))
        value = self.value(*at, *path)
        # A plain number takes every float but infinity and not-a-number.
        if described == "a number" and isinstance(value, float):
            described = "a finite number"
        near = suggestion(value, expectation.choices(path, root)) if isinstance(value, str) else ""
        # The message lists all words already, so only the nearest are worth adding.
        near = near if near.startswith("; nearest") else ""
        self.fault(at + path, f"{shown}; expected {described}{near}")

    def _shown(self, path: KeyPath) -> str:
        """Return a value as written in the file if it is short, otherwise its kind or its beginning."""
        value = self.value(*path)
        if value is None:
            return "missing"
        written = "" if path in self.labels else self._positions.text(path)
        if written and "\n" not in written and len(written) <= _SHOWN_LENGTH:
            return written
        if isinstance(value, dict | list):
            return "a table" if isinstance(value, dict) else "a list"
        shown = str(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False, default=str)
        return shown if len(shown) <= _SHOWN_LENGTH else shown[:_SHOWN_LENGTH] + "…"

    def _fault(self, path: KeyPath, message: str) -> Fault:
        # A label also covers the keys below its own.
        for length in range(len(path), 0, -1):
            if path[:length] in self.labels:
                return Fault(self.labels[path[:length]], message)
        return Fault(key_text(path), message, self._positions.line(path))

    @cached_property
    def _positions(self) -> "Positions":
        from haptic_fieldbus.documents.positions import Positions

        return Positions(self.text)

    def _parse(self) -> dict[str, object]:
        self._refuse_whole(fault_of_text(self.text))
        try:
            data: dict[str, object] = tomllib.loads(self.text)
            # Validation writes the data as JSON. Data for which that fails must be refused here, as a fault of the
            # file.
            json.dumps(data, default=_no_date)
        except tomllib.TOMLDecodeError as cause:
            raise self.error(self.source, self._syntax_faults(str(cause))) from None
        # tomllib and json recurse for nested values.
        except RecursionError:
            raise self.error(self.source, [Fault("", "nested too deeply")]) from None
        # Python refuses to convert an integer of several thousand digits.
        except ValueError:
            raise self.error(self.source, [Fault("", TOO_MANY_DIGITS)]) from None
        self._refuse_whole(fault_of_data(data))
        return data

    def _refuse_whole(self, message: str) -> None:
        """Raise `error` for a fault of the file as a whole, unless the message is empty."""
        if message:
            raise self.error(self.source, [Fault("", message)])

    def _syntax_faults(self, message: str) -> list[Fault]:
        """Return a fault for each duplicate key; without duplicates, the place at which the parser stopped."""
        if message.startswith(("Cannot overwrite", "Cannot declare")) and self._positions.duplicates:
            twice = self._positions.duplicates
            return [Fault(key_text(path), f"set twice; first in line {first}", line) for path, line, first in twice]
        if at_line := _AT_LINE.search(message):
            words = f"not TOML: {message[: at_line.start()]}, at column {at_line[2]}"
            return [Fault("", words, int(at_line[1]))]
        return [Fault("", f"not TOML: {_AT_END.sub('', message)}, at the end", self.text.rstrip("\n").count("\n") + 1)]


def read_document(path: Path, error: type[DocumentError]) -> Document:
    """Read a TOML file; raises `error` when it cannot be read, is not UTF-8 or is not TOML."""
    try:
        octets = read_octets(path, TOML_SIZE)
    except FileNotFoundError:
        raise error(path, [Fault("", "no such file")]) from None
    except OSError as cause:
        raise error(path, [Fault("", f"cannot be read: {cause.strerror}")]) from cause
    try:
        text = octets.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        where = octets.count(b"\n", 0, cause.start) + 1
        fault = Fault("", f"not UTF-8: octet 0x{octets[cause.start]:02X}; save the file as UTF-8", where)
        raise error(path, [fault]) from None
    return Document(str(path), text, error)


def schema_of(schema: type, *, loaded: Sequence[str] = ()) -> Schema:
    """Return the JSON Schema of a file that is read into `schema`, without the `loaded` fields."""
    tree: Schema = _adapter(cast(Hashable, schema)).json_schema()
    for name in loaded:
        tree["properties"].pop(name)
    return tree


def knows(schema: Hashable, path: KeyPath) -> bool:
    """Return whether a file of this schema may have the key."""
    return _has_fields(schema, path) or bool(_expectation(schema).nodes(path, {}))


def _has_fields(kind: object, path: KeyPath) -> bool:
    """Return whether dataclasses alone have the key; a JSON Schema, which knows all kinds of tables, takes longer."""
    if isinstance(kind, UnionType):
        return any(_has_fields(option, path) for option in get_args(kind))
    below = {each.name: each.type for each in fields(kind)} if is_dataclass(kind) else {}
    return not path or (path[0] in below and _has_fields(below[str(path[0])], path[1:]))


def key_text(path: KeyPath) -> str:
    """Return a path as TOML would write it, list elements counted from 0: `element[0].stiffness`."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            # TOML forbids a bare DEL in a text, JSON does not.
            step = step if len(step) <= _SHOWN_LENGTH else step[:_SHOWN_LENGTH] + "…"
            quoted = json.dumps(step, ensure_ascii=False).replace("\x7f", "\\u007F")
            text += "." * bool(text) + (step if _BARE_KEY.fullmatch(step) else quoted)
    return text


def _follow(value: object, location: KeyPath) -> KeyPath:
    """Return the part of a Pydantic location that exists in the data; marks of union members are left out."""
    path: KeyPath = ()
    for step in location:
        inner = child(value, step)
        if inner is not None:
            value, path = inner, (*path, step)
    return path


def _no_date(_: object) -> dict[str, None]:
    """Return a value that every field refuses, in place of a date, which JSON does not have."""
    return {"": None}


@cache
def _adapter(schema: Hashable) -> "TypeAdapter[Any]":
    from pydantic import TypeAdapter

    return TypeAdapter(cast(Any, schema))


@cache
def _expectation(schema: Hashable) -> Expectation:
    return Expectation(_adapter(schema).json_schema())


# The kind of file that a TOML text is: a profile, a rig or a scene given in the place of another is told as such.
#
# Each kind has a table that no other has. Without this a rig that is checked as a profile has a page of faults, and
# none of them says the one thing that is wrong.
#
# What was made in Python is checked as the file that would give it (`table_of`).

KINDS = {
    "drive": ("a drive profile", "use it as --drive FILE; to check it: haptic-fieldbus profiles check FILE"),
    "bus": ("a rig", "use it as --rig FILE; to check it: haptic-fieldbus plan wall --rig FILE"),
    "element": ("a scene", "use it as SCENE; to check it: haptic-fieldbus scenes check FILE"),
}
"""Table → the kind of a file with this table, and the advice for such a file."""


def check_kind(document: Document, table: str) -> None:
    """Raise the document's error with one fault if it lacks the `table` of its kind but has that of another kind."""
    if table in document.data:
        return
    for other, (kind, advice) in KINDS.items():
        if other in document.data:
            message = f"this is {kind}, not {KINDS[table][0]}; {advice.replace('FILE', document.source)}"
            raise document.error(document.source, [Fault("", message)])


def table_of(given: Any) -> dict[str, object]:
    """Return the table of a file for this dataclass. A None is left out if its key may be missing."""
    values = [(field, getattr(given, field.name)) for field in fields(given) if field.init]
    return {field.name: _plain(value) for field, value in values if value is not None or not _may_be_left_out(field)}


def _may_be_left_out(field: Field[Any]) -> bool:
    """Return whether a missing key stands for None: it is the default, or its absence will be reported."""
    return field.default is None or (field.default is MISSING and field.default_factory is MISSING)


def _plain(value: object) -> object:
    """Return the value as TOML would give it; objects unknown to TOML stay, so that the schema refuses them."""
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
