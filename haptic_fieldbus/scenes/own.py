"""Elements that other packages add, each by an entry point in the group `haptic_fieldbus.elements`.

The name of the entry point is the kind that scene files give, and its object is the class. A package is imported when a
scene names its element, and not before. Any fault of a package is reported in one sentence: a broken package must not
break other scenes.
"""

import re
import sys
from collections.abc import Container, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from traceback import walk_tb
from typing import Any, cast, get_type_hints

from haptic_fieldbus.documents import schema_of
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.scenes.element import LAWS, STRICT, AnyElement
from haptic_fieldbus.scenes.own_faults import shape_fault, told

GROUP = "haptic_fieldbus.elements"
_KIND = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class OwnElement:
    """An element that a package adds, and where it comes from; `fault` is None if the element can be used."""

    kind: str
    package: str
    """Name and version of the package; of several packages all of them."""
    entry_point: str
    fault: str | None


def own_entry_points() -> dict[str, tuple[EntryPoint, ...]]:
    """Return the entry points of the group by their kind, several where packages disagree; nothing is imported."""
    return _entry_points_on(tuple(sys.path))


@cache  # a scene asks several times for each of its elements
def _entry_points_on(path: tuple[str, ...]) -> dict[str, tuple[EntryPoint, ...]]:
    found: dict[str, dict[tuple[str, str], EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        found.setdefault(entry.name, {})[_package(entry), entry.value] = entry
    return {kind: tuple(entries.values()) for kind, entries in found.items()}


def own_type(kind: str) -> type[AnyElement]:
    """Import the class of a kind; KeyError for an unknown one, UsageError that names package, entry point and fault."""
    entries, cause = own_entry_points()[kind], None
    if not _KIND.fullmatch(kind):
        found, faults = None, ["its name is no kind; expected a letter, then letters, digits, _, - or ."]
    elif len(entries) > 1:
        found, faults = None, ["several packages provide it; uninstall all but one"]
    else:
        found, faults, cause = _loaded(entries[0])
    if faults:
        raise UsageError(f'element "{kind}" of {_places(entries)}: {"; ".join(faults)}') from cause
    return cast(type[AnyElement], found)


def own_kind(element: type[AnyElement]) -> str | None:
    """Return the kind of a class that has been imported; None where no entry point names it."""
    return next((kind for kind, entries in own_entry_points().items() if _present(entries[0]) is element), None)


def described(taken: Container[str]) -> list[OwnElement]:
    """Describe every element of the group, in the order of their kinds; a kind in `taken` is a shipped one."""
    return [_described(kind, taken) for kind in sorted(own_entry_points())]


def _described(kind: str, taken: Container[str]) -> OwnElement:
    """Describe one kind, and import its class unless its name is taken."""
    entries, fault = own_entry_points()[kind], None
    if kind in taken:
        fault = f'element "{kind}" of {_places(entries)}: a shipped element has this name and is used instead'
    else:
        try:
            own_type(kind)
        except UsageError as error:
            fault = str(error)
    packages = dict.fromkeys(map(_package, entries))
    return OwnElement(kind, ", ".join(packages), ", ".join(map(_value, entries)), fault)


def check_own(element: AnyElement) -> None:
    """Raise UsageError for an element with wrong needs or a linearised form of another shape."""
    try:
        fault = shape_fault(element)
    except Exception as error:  # any exception of foreign code is a fault of the element
        raise UsageError(f"its needs or linearised() end in {_told(error)}") from error
    if fault:
        raise UsageError(fault)


def _loaded(entry: EntryPoint) -> tuple[object, list[str], BaseException | None]:
    """Import the object of an entry point, list what is wrong with it, and return the error of the import if any."""
    try:
        with redirect_stdout(sys.stderr):  # standard output may be one JSON object and nothing else
            found = entry.load()
    except (Exception, SystemExit) as error:  # a foreign module may do anything
        return None, [f"it cannot be imported: {_told(error)}"], error
    return found, list(_faults(found)), None


def _present(entry: EntryPoint) -> object:
    """Return the object of an entry point whose module has been imported, else None."""
    module, _, names = _value(entry).partition("[")[0].partition(":")
    found: object = sys.modules.get(module)
    for name in names.split("."):
        found = getattr(found, name, None)
    return found


def _faults(found: Any) -> Iterator[str]:
    """Yield each reason why an object cannot be used as the class of an element."""
    if not isinstance(found, type) or not is_dataclass(found) or not cast(Any, found).__dataclass_params__.frozen:
        yield "expected a frozen dataclass"
        return
    if getattr(found, "__pydantic_config__", None) != STRICT:
        yield "files could set it to any value: add __pydantic_config__: ClassVar = STRICT"
    names = {field.name for field in fields(found)}
    if "name" not in names:
        yield 'no field "name"'
    if len(names & {"axis", "axes"}) != 1:
        yield 'expected one field "axis", or "axes" for two axes'
    yield from (f"no {member}" for member in ("needs", "linearised") if not hasattr(found, member))
    laws = [law for law in LAWS if hasattr(found, law)]
    if len(laws) != 1 or ("axes" in names and laws != ["begin"]):
        yield f"expected {'begin' if 'axes' in names else 'one of force, begin and dynamics'}, not {laws or 'none'}"
    try:
        get_type_hints(found, include_extras=True)
        schema_of(found)
    except Exception as error:  # annotations are evaluated here, and may name anything
        yield f"its fields cannot be read from a file: {_told(error)}"


def _told(error: BaseException) -> str:
    """Return type and first line of an error, and the file and line of the foreign code that raised it."""
    ours = ("haptic_fieldbus", "importlib", "pydantic")
    places = [
        f" ({frame.f_code.co_filename}, line {line})"
        for frame, line in walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).partition(".")[0] not in ours
    ]
    return told(error) + (places[-1] if places and not isinstance(error, SyntaxError) else "")


def _places(entries: tuple[EntryPoint, ...]) -> str:
    """Return the packages and their entry points, for a sentence."""
    return " and ".join(f"{_package(entry)} (entry point {_value(entry)})" for entry in entries)


def _package(entry: EntryPoint) -> str:
    """Return name and version of the distribution that an entry point belongs to."""
    return "an unknown package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"


def _value(entry: EntryPoint) -> str:
    """Return an entry point as its package writes it, `module:Class`."""
    return "".join(entry.value.split())
