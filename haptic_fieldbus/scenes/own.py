"""Elements that other packages add, each by an entry point in the group `haptic_fieldbus.elements`.

The name of the entry point is the kind that scene files give, and its object is the class. A package is imported when a
scene names its element, and not before. Any fault of a package is reported in one sentence: a broken package must not
break other scenes.
"""

import re
import sys
from collections.abc import Container, Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, cast, get_type_hints

from haptic_fieldbus.documents import schema_of
from haptic_fieldbus.documents.own_parts import entry_value, own_entry_points, own_part, package_of, places_of, told_at
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.scenes.element import LAWS, STRICT, AnyElement
from haptic_fieldbus.scenes.own_faults import shape_fault

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

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


def own_type(kind: str) -> type[AnyElement]:
    """Import the class of a kind; KeyError for an unknown one, UsageError that names package, entry point and fault."""
    if not _KIND.fullmatch(kind):
        fault = "its name is no kind; expected a letter, then letters, digits, _, - or ."
        raise UsageError(f'element "{kind}" of {places_of(own_entry_points(GROUP)[kind])}: {fault}')
    return cast(type[AnyElement], own_part(GROUP, "element", kind, _faults))


def own_kind(element: type[AnyElement]) -> str | None:
    """Return the kind of a class that has been imported; None where no entry point names it."""
    return next((kind for kind, entries in own_entry_points(GROUP).items() if _present(entries[0]) is element), None)


def described(taken: Container[str]) -> list[OwnElement]:
    """Describe every element of the group, in the order of their kinds; a kind in `taken` is a shipped one."""
    return [_described(kind, taken) for kind in sorted(own_entry_points(GROUP))]


def _described(kind: str, taken: Container[str]) -> OwnElement:
    """Describe one kind, and import its class unless its name is taken."""
    entries, fault = own_entry_points(GROUP)[kind], None
    if kind in taken:
        fault = f'element "{kind}" of {places_of(entries)}: a shipped element has this name and is used instead'
    else:
        try:
            own_type(kind)
        except UsageError as error:
            fault = str(error)
    packages = dict.fromkeys(map(package_of, entries))
    return OwnElement(kind, ", ".join(packages), ", ".join(map(entry_value, entries)), fault)


def check_own(element: AnyElement) -> None:
    """Raise UsageError for an element with wrong needs or a linearised form of another shape."""
    try:
        fault = shape_fault(element)
    except Exception as error:  # any exception of foreign code is a fault of the element
        raise UsageError(f"its needs or linearised() end in {told_at(error)}") from error
    if fault:
        raise UsageError(fault)


def _present(entry: "EntryPoint") -> object:
    """Return the object of an entry point whose module has been imported, else None."""
    module, _, names = entry_value(entry).partition("[")[0].partition(":")
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
        yield f"its fields cannot be read from a file: {told_at(error)}"
