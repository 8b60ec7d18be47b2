"""The parts of a scene: a file and the files that it includes, within bounds, and the kinds of their elements."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Len

from haptic_fieldbus.documents import Document, beside, check_kind, file_of, is_path, read_document, suggestion
from haptic_fieldbus.errors import Fault, SceneError, UsageError
from haptic_fieldbus.scenes.element import STRICT
from haptic_fieldbus.scenes.registry import element_type, kind_names
from haptic_fieldbus.signals import Workspace

LIBRARY = Path(__file__).resolve().parent / "library"
MOST_FILES = 32
"""Most files of one scene, a file counted each time that it is included."""
MOST_ELEMENTS = 500
"""Most elements of one scene; each takes about a microsecond of every period."""


@dataclass(frozen=True)
class AxisSection:
    workspace: Workspace
    held: bool | None = None
    """Whether the simulated hand holds the axis; by default it holds every axis but the second of a coupling."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class SceneFile:
    """The frame of a scene file; its elements stay tables, as their dataclass depends on their kind."""

    axis: Annotated[dict[str, AxisSection], Len(1)]
    element: tuple[dict[str, object], ...] = ()
    include: tuple[str, ...] = ()
    """Scenes by name, or files beside this one; their axes and elements come before those of this file."""
    description: str = ""
    hand: Literal["push", "tap", "sine", "guide", "shake", "release", "none"] | None = None
    """Motion of the simulated hand in this scene, unless a run names another."""
    passivity: Literal["observer", "controller"] | None = None
    """Whether energy that the loop gives of its own ends the run, or is taken back by damping before that; the
    observer unless this file or an included one names the controller."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, eq=False)
class ScenePart:
    """One file of a scene while it is read; `kinds` maps the places of elements of a known kind to that kind."""

    document: Document
    frame: SceneFile | None
    kinds: dict[int, str]

    def names(self) -> dict[object, int]:
        """Return the places of the elements by their names."""
        return {self.document.value("element", index, "name"): index for index in self.kinds}


def read_parts(path: Path) -> list[ScenePart]:
    """Read a file and all files that it includes, the file itself last.

    Raises SceneError when the file cannot be read or is not TOML, or when it includes too much. Other faults, those of
    included files among them, are noted in the documents.
    """
    parts = _read(path, (), count(1))
    elements = sum(len(part.kinds) for part in parts)
    if elements > MOST_ELEMENTS:
        raise SceneError(path, [Fault("element", f"{elements} in all files; expected at most {MOST_ELEMENTS}")])
    return parts


def _read(path: Path, above: tuple[Path, ...], numbers: Iterator[int]) -> list[ScenePart]:
    """Read a file and those that it includes; `above` are the files that include it, `numbers` count the files."""
    document = read_document(path, SceneError)
    check_kind(document, "element")
    frame = document.validate(SceneFile)
    if not document.value("element") and not document.value("include"):
        document.fault(("element",), "missing; expected a list that is not empty")
    included = document.value("include")
    parts: list[ScenePart] = []
    for place, name in enumerate(included if isinstance(included, list) else []):
        if isinstance(name, str):
            parts += _included(document, place, name, (*above, path.resolve()), numbers)
    return [*parts, ScenePart(document, frame, _name_elements(document))]


def _included(
    document: Document, place: int, name: str, above: tuple[Path, ...], numbers: Iterator[int]
) -> list[ScenePart]:
    """Read one included file with its own includes; return none, and note the fault, when it cannot be read."""
    if next(numbers) >= MOST_FILES:
        document.refuse(("include", place), f"at most {MOST_FILES} files in all")
        return []
    try:
        path = beside(above[-1], name, LIBRARY) if is_path(name) else file_of("scene", name, LIBRARY)
        # A file that includes itself, directly or through others, would be read without end.
        if path.resolve() in above:
            circle = [*above[above.index(path.resolve()) :], path]
            document.refuse(("include", place), f"no circle: {' → '.join(each.stem for each in circle)}")
            return []
        return _read(path, above, numbers)
    except (SceneError, UsageError) as error:
        document.fault(("include", place), str(error))
        return []


def _is_known(document: Document, index: int, kind: str) -> bool:
    """Return whether there are elements of this kind; the fault of one whose package is broken is noted."""
    try:
        element_type(kind)
    except KeyError:
        return False
    except UsageError as error:
        document.fault(("element", index, "kind"), str(error))
        document.cause = error.__cause__
        return False
    return True


def _name_elements(document: Document) -> dict[int, str]:
    """Return the kinds of the elements by their places, where known.

    The tables of these elements lose their `kind`, and get it as their `name` when they have none.
    """
    raw = document.value("element")
    tables = {i: table for i, table in enumerate(raw if isinstance(raw, list) else []) if isinstance(table, dict)}
    given = [table.get("kind") for table in tables.values()]
    kinds: dict[int, str] = {}
    names: set[object] = set()
    for index, table in tables.items():
        kind = table.get("kind")
        if not isinstance(kind, str) or not _is_known(document, index, kind):
            document.refuse(("element", index, "kind"), f"a kind of element{suggestion(str(kind or ''), kind_names())}")
            continue
        if "name" not in table and given.count(kind) > 1:
            document.fault(("element", index, "name"), f'missing; expected one, as the kind "{kind}" stands twice')
        kinds[index] = kind
        del table["kind"]
        name = str(table.setdefault("name", kind))
        # A setting on the command line is split at its first equals sign, so a name must have none.
        if not name or "=" in name:
            document.refuse(("element", index, "name"), "text that is not empty, without =")
        if name in names:
            document.fault(("element", index, "name"), f'"{name}" stands twice; expected a name of its own')
        names.add(name)
    return kinds
