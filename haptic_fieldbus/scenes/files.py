"""Apply settings to the files of a scene, check them together, and make their elements.

Each file is read in two steps: first its frame (`parts`), then each element as the dataclass of its kind, so that only
the modules of the kinds in use are imported. In between, settings replace single parameters and texts with units become
numbers.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Len

from haptic_fieldbus.documents import Document, beside, check_kind, file_of, is_path, read_document, suggestion
from haptic_fieldbus.documents.quantities import parse_quantity
from haptic_fieldbus.errors import Fault, SceneError, UsageError
from haptic_fieldbus.scenes.element import STRICT, AnyElement, Frequency
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, kind_names, parameters, quantities
from haptic_fieldbus.signals import Workspace

# The parts of a scene: a file and the files that it includes, within bounds, and the kinds of their elements.

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
class MadeForSection:
    """Drives on whose shipped bench the scene is inside its limit."""

    rate: Frequency | None = None
    """Lowest rate of the loop [Hz]."""
    drive: Annotated[str, Len(1)] | None = None
    """Name of a profile."""
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
    made_for: MadeForSection | None = None
    """Drives for which the values of the scene are made; without it every drive that can render the scene."""
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
    if document.value("made_for") == {}:
        document.fault(("made_for",), "empty; expected rate or drive")
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
    """Return whether this kind of element exists; the fault of a broken package is noted."""
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
        kind, place = table.get("kind"), ("element", index, "name")
        if not isinstance(kind, str) or not _is_known(document, index, kind):
            near = suggestion(str(kind or ""), kind_names())
            document.refuse(("element", index, "kind"), f"a kind of element, see docs/reference/elements.md{near}")
            continue
        if "name" not in table and given.count(kind) > 1:
            document.fault(place, f'missing; expected a name, because the kind "{kind}" is used twice')
        kinds[index] = kind
        del table["kind"]
        name = str(table.setdefault("name", kind))
        # A setting on the command line is split at its first equals sign, so a name must have none.
        if not name or "=" in name:
            document.refuse(place, "a non-empty string, without =")
        if name in names:
            document.fault(place, f'"{name}" is used twice; expected a unique name')
        names.add(name)
    return kinds


def apply_settings(parts: list[ScenePart], settings: Mapping[str, object], scene: str) -> None:
    """Write settings into the tables of the files; raises UsageError for an unknown element or parameter."""
    places = {name: (part, index) for part in parts for name, index in part.names().items()}
    kinds = {str(name): element_type(part.kinds[index]) for name, (part, index) in places.items()}
    for setting, value in settings.items():
        # The unknown element may be missing because its file is faulty, so the faults of the files come first.
        if "." in setting and setting.rpartition(".")[0] not in kinds and any(part.document.faulty for part in parts):
            continue
        name, parameter = named(setting, kinds, scene)
        part, index = places[name]
        put(part.document, index, parameter, value, setting)


def named(setting: str, kinds: Mapping[str, type[AnyElement]], scene: str) -> tuple[str, str]:
    """Split "element.parameter" into both names; raises UsageError with the nearest names when one is unknown."""
    name, dot, parameter = setting.rpartition(".")
    if not dot:
        name, parameter = next(iter(kinds), "wall"), setting
        if setting in kinds:  # an element alone
            name, parameter = setting, parameters(kinds[setting])[0]
        raise UsageError(f"--set {setting}: expected element.parameter, such as {name}.{parameter}")
    if name not in kinds:
        raise UsageError(f'--set {setting}: no element "{name}" in scene {scene}{suggestion(name, list(kinds))}')
    known = parameters(kinds[name])
    if parameter not in known:
        raise UsageError(f'--set {setting}: no parameter "{parameter}" of {name}{suggestion(parameter, known)}')
    return name, parameter


def put(document: Document, index: int, parameter: str, value: object, setting: str) -> None:
    """Write a setting in the place of a value; faults about the value then name the setting."""
    document.table("element", index)[parameter] = value
    document.labels["element", index, parameter] = f"--set {setting}"


def check_together(parts: list[ScenePart]) -> dict[str, Workspace]:
    """Note the faults between files, and return the workspaces of all axes.

    Faults are an element name that is used twice, an axis with different workspaces in two files, and an element on an
    axis that no file has.
    """
    axes: dict[str, Workspace] = {}
    names: set[object] = set()
    for part in parts:
        document = part.document
        for name, section in (part.frame.axis if part.frame is not None else {}).items():
            if axes.setdefault(name, section.workspace) is not section.workspace:
                document.refuse(("axis", name, "workspace"), f'"{axes[name].value}", as in an included scene')
        for element, index in part.names().items():
            if element in names:
                document.fault(("element", index, "name"), f'"{element}" is used twice; expected a unique name')
            names.add(element)
        for index in part.kinds:
            _check_axes(document, index, axes if part.frame is not None else None)
    return axes


def _check_axes(document: Document, index: int, axes: Mapping[str, Workspace] | None) -> None:
    # None means that the frame is faulty: its raw table then prevents a second fault that follows from the first.
    known = document.table("axis") if axes is None else axes
    for path in _axis_paths(document, index):
        axis = document.value(*path)
        if isinstance(axis, str) and axis not in known:
            document.fault(path, f"no [axis.{axis}] in this file{suggestion(axis, known)}")


def _axis_paths(document: Document, index: int) -> Iterator[tuple[str | int, ...]]:
    """Yield the keys of an element that name an axis: `axis`, and each member of `axes`."""
    yield ("element", index, "axis")
    axes = document.value("element", index, "axes")
    for place in range(len(axes) if isinstance(axes, list) else 0):
        yield ("element", index, "axes", place)


def elements_of(part: ScenePart, axes: Mapping[str, Workspace]) -> list[AnyElement]:
    """Return the valid elements of one file; the faults of the others are noted in its document."""
    for index, kind in part.kinds.items():
        _check_workspace(part.document, index, kind, axes)
        convert(part.document, index, element_type(kind), axes)
    found = [_validated(part.document, index, kind) for index, kind in part.kinds.items()]
    return [element for element in found if element is not None]


def _validated(document: Document, index: int, kind: str) -> AnyElement | None:
    """Return the element, or None with its faults noted; only kinds of other packages are checked for their shapes."""
    element = document.validate(element_type(kind), ("element", index))
    if element is None or kind in ELEMENTS:
        return element
    from haptic_fieldbus.scenes.own import check_own

    try:
        check_own(element)
    except UsageError as fault:
        document.fault(("element", index), f'element "{kind}": {fault}')
        document.cause = fault.__cause__
    return element


def raise_faults(parts: list[ScenePart]) -> None:
    """Raise one SceneError with all faults of all files, if there are any.

    The error names the file that was asked for; a fault of an included file has that file in its key.
    """
    errors = []
    for part in parts:
        try:
            part.document.checked(part.frame)
        except SceneError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        main = parts[-1].document.source
        cause = next((error.__cause__ for error in errors if error.__cause__), None)
        faults = [_in_file(fault, error.source, main) for error in errors for fault in error.faults]
        raise SceneError(main, faults) from cause


def _in_file(fault: Fault, source: str, main: str) -> Fault:
    if source == main:
        return fault
    return Fault(f"in {source}: {'' if fault.line is None else f'line {fault.line}: '}{fault.key}", fault.message)


def _workspace(document: Document, index: int, axes: Mapping[str, Workspace]) -> Workspace | None:
    """Return the workspace of the element's axis, or of its first known one; None when it has no known axis."""
    names = [document.value(*path) for path in _axis_paths(document, index)]
    return next((axes[str(name)] for name in names if str(name) in axes), None)


def _check_workspace(document: Document, index: int, kind: str, axes: Mapping[str, Workspace]) -> None:
    """Note a fault when a kind for one workspace is used in the other, or a ratio is missing between both."""
    only, workspace = getattr(element_type(kind), "workspace", None), _workspace(document, index, axes)
    if only is not None and workspace is not None and workspace is not only:
        document.fault(("element", index), f'"{kind}" is for {only.value} axes; its axis is {workspace.value}')
    check_ratio(document, index, element_type(kind), axes)


def check_ratio(document: Document, index: int, kind: type[AnyElement], axes: Mapping[str, Workspace]) -> None:
    """Note a fault when a coupling of a linear and a rotary axis gives no ratio: with a unit it has no default."""
    spaces = [axes[name] for path in _axis_paths(document, index) if (name := str(document.value(*path))) in axes]
    if len(set(spaces)) > 1 and "ratio" in parameters(kind) and document.value("element", index, "ratio") is None:
        one, other = spaces[:2]
        text = f"missing; expected a number: motion of the {one.value} axis per motion of the {other.value} axis"
        document.fault(("element", index, "ratio"), f"{text} [{one.length_unit}/{other.length_unit}]")


def convert(document: Document, index: int, kind: type[AnyElement], axes: Mapping[str, Workspace]) -> None:
    """Replace texts with units by numbers in SI, in the table of one element."""
    table, workspace = document.table("element", index), _workspace(document, index, axes)
    for parameter, quantity in quantities(kind).items():
        value = table.get(parameter)
        if not isinstance(value, str) or workspace is None:
            continue
        try:
            table[parameter] = parse_quantity(value, quantity, workspace)
        except ValueError as error:
            document.refuse(("element", index, parameter), str(error))
            del table[parameter]
