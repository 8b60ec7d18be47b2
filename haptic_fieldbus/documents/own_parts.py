"""Parts that are not of this package: objects of Python, and parts that other packages add by entry points.

The name of an entry point is the name of the part, and its object is the part. A package is imported when its part is
named, and not before. A fault in it becomes one sentence with package and entry point: a broken package must not stop
what does not use it. An object of Python travels as `OwnName`, wherever the name of a shipped part would.
"""

import inspect
import os
import pickle
import sys
from collections.abc import Callable, Container, Iterable
from contextlib import redirect_stdout
from functools import cache
from hashlib import sha256
from io import BytesIO
from traceback import walk_tb
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any, TypeVar

from haptic_fieldbus.errors import UsageError, wrong_kind

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Part = TypeVar("Part")
Faults = Callable[[Any], Iterable[str]]
"""Function that returns each reason why an object cannot be used."""


class OwnName(str):
    """Name of a part that is an object of Python, with that object; equal only to a name with an equal object."""

    part: Any

    def __new__(cls, name: str, part: Any) -> "OwnName":
        found = super().__new__(cls, name)
        found.part = part
        return found

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OwnName) and str(self) == str(other) and bool(self.part == other.part)

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = str.__hash__

    def __deepcopy__(self, memo: object) -> "OwnName":
        return self

    def __reduce__(self) -> tuple[type[str], tuple[str, ...]]:
        """Send the object along with its name; the name alone where it cannot be sent, such as one with a lambda."""
        try:
            pickle.dumps(self.part)
        except Exception:  # a foreign object may raise anything
            return str, (str(self),)
        return OwnName, (str(self), self.part)


class _Content(pickle.Pickler):
    """Writes an object with the content of its functions and classes, of which pickle writes the name alone."""

    def __init__(self, file: BytesIO) -> None:
        super().__init__(file)
        self.fast = True  # equal values are written alike, whether they are one object or several
        self._begun: list[object] = []

    def reducer_override(self, part: Any) -> Any:
        if isinstance(part, CodeType):
            values = [sorted(map(repr, each)) if isinstance(each, frozenset) else each for each in part.co_consts]
            return tuple, ((part.co_code, part.co_names, values),)
        kinds = part.__mro__ if isinstance(part, type) else ()
        if not isinstance(part, FunctionType) and not any(each.__module__ not in _WITHOUT_TEXT for each in kinds):
            return NotImplemented
        if any(part is each for each in self._begun):
            return tuple, ((part.__qualname__,),)
        self._begun.append(part)
        if isinstance(part, FunctionType):
            cells = [each.cell_contents for each in part.__closure__ or ()]
            return tuple, ((part.__code__, cells, part.__defaults__, part.__kwdefaults__, vars(part), _used(part)),)
        if "<locals>" in part.__qualname__:
            raise TypeError(f"{part.__qualname__}: its text does not tell what surrounds it")
        texts = [inspect.getsource(each) for each in kinds if each.__module__ not in _WITHOUT_TEXT]
        return tuple, ((part.__qualname__, texts),)


_WITHOUT_TEXT = sys.stdlib_module_names
"""Modules whose classes are known by their names."""


def _used(function: FunctionType) -> dict[str, Any]:
    """Return the constants, functions and classes of its module that a function names."""

    def names(code: CodeType) -> set[str]:
        return {*code.co_names}.union(*(names(each) for each in code.co_consts if isinstance(each, CodeType)))

    found = {name: function.__globals__.get(name) for name in sorted(names(function.__code__))}
    constant = (int, float, complex, str, bytes, tuple)
    return {
        name: each
        for name, each in found.items()
        if isinstance(each, constant)
        or (isinstance(each, FunctionType | type) and each.__module__ == function.__module__)
    }


def content_digest(part: Any) -> str:
    """Return a digest of the content and the code of an object, a new one each time where that cannot be known."""
    file = BytesIO()
    try:
        _Content(file).dump(part)
    except Exception:  # a foreign object may raise anything
        return f"unknown {os.urandom(16).hex()}"
    return sha256(file.getvalue()).hexdigest()


def name_of(part: Any) -> Any:
    """Return the name of an object of Python together with the object; a text, None or anything else as it is."""
    name = getattr(part, "name", None)
    return OwnName(name, part) if isinstance(name, str) and not isinstance(part, str) else part


def foreign_part(
    group: str, sort: str, name: str, expected: type[Part], shipped: Container[str],
    further: Faults = lambda found: (),
) -> Part | None:  # fmt: skip
    """Return the object that a name has with it, or that a package adds by this name; None for any other name.

    `further` looks into an object of the `expected` class. Raises TypeError for another class, and UsageError for a
    fault and for an object with the name of a shipped part.
    """

    def faults(found: Any) -> Iterable[str]:
        if not isinstance(found, expected):
            yield f"expected an object of {expected.__name__}, not {type(found).__name__}"
        elif found.name != name:  # type: ignore[attr-defined]
            yield f'its name is "{found.name}"; expected that of the entry point'  # type: ignore[attr-defined]
        else:
            yield from further(found)

    if not isinstance(name, OwnName):
        return own_part(group, sort, name, faults) if name in own_entry_points(group) else None
    if not isinstance(name.part, expected):
        raise wrong_kind(sort, f"an object of {expected.__name__}", name.part)
    if str(name) in shipped:
        raise UsageError(f'{sort} "{name}": a shipped one has this name; give yours another')
    if wrong := "; ".join(further(name.part)):
        raise UsageError(f'{sort} "{name}": {wrong}')
    return name.part


def entry_point_names(group: str) -> list[str]:
    """Return the names of all entry points of a group in alphabetical order; nothing is imported."""
    return sorted(own_entry_points(group))


def own_entry_points(group: str) -> "dict[str, tuple[EntryPoint, ...]]":
    """Return the entry points of a group by name, several where packages disagree; nothing is imported."""
    return _entry_points_on(group, tuple(sys.path))


@cache  # a scene asks several times for each of its elements
def _entry_points_on(group: str, path: tuple[str, ...]) -> "dict[str, tuple[EntryPoint, ...]]":
    from importlib.metadata import entry_points

    found: dict[str, dict[tuple[str, str], EntryPoint]] = {}
    for entry in entry_points(group=group):
        found.setdefault(entry.name, {})[package_of(entry), entry_value(entry)] = entry
    return {name: tuple(entries.values()) for name, entries in found.items()}


def own_part(group: str, sort: str, name: str, faults: Faults) -> Any:
    """Import the part of this name; KeyError for an unknown one, UsageError that names package, entry point, fault."""
    entries = own_entry_points(group)[name]
    part = f'{sort} "{name}" of {places_of(entries)}'
    if len(entries) > 1:
        raise UsageError(f"{part}: several packages provide it; uninstall all but one")
    try:
        with redirect_stdout(sys.stderr):  # standard output may be one JSON object and nothing else
            found = entries[0].load()
    except (Exception, SystemExit) as error:  # a foreign module may do anything
        raise UsageError(f"{part}: it cannot be imported: {told_at(error)}") from error
    if wrong := list(faults(found)):
        raise UsageError(f"{part}: {'; '.join(wrong)}")
    return found


def told(error: BaseException) -> str:
    """Return the type of an error and the first line of its message."""
    words = str(error).strip().partition("\n")[0]
    return f"{type(error).__name__}{': ' * bool(words)}{words}"


def told_at(error: BaseException) -> str:
    """Return type and first line of an error, and the file and line of the foreign code that raised it."""
    ours = ("haptic_fieldbus", "importlib", "pydantic")
    places = [
        f" ({frame.f_code.co_filename}, line {line})"
        for frame, line in walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).partition(".")[0] not in ours
    ]
    return told(error) + (places[-1] if places and not isinstance(error, SyntaxError) else "")


def places_of(entries: "tuple[EntryPoint, ...]") -> str:
    """Return the packages and their entry points, for a sentence."""
    return " and ".join(f"{package_of(entry)} (entry point {entry_value(entry)})" for entry in entries)


def package_of(entry: "EntryPoint") -> str:
    """Return name and version of the distribution that an entry point belongs to."""
    return "an unknown package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"


def entry_value(entry: "EntryPoint") -> str:
    """Return an entry point as its package writes it, `module:Class`."""
    return "".join(entry.value.split())
