"""Apply settings to the files of a scene, check them together, and make their elements.

Each file is read in two steps: first its frame (`parts`), then each element as the dataclass of its kind, so that only
the modules of the kinds in use are imported. In between, settings replace single parameters and texts with units become
numbers.
"""

from collections.abc import Iterator, Mapping

from haptic_fieldbus.documents import Document, suggestion
from haptic_fieldbus.documents.quantities import parse_quantity
from haptic_fieldbus.errors import Fault, SceneError, UsageError
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.parameters import parameters, quantities
from haptic_fieldbus.scenes.parts import ScenePart
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type
from haptic_fieldbus.signals import Workspace


def apply_settings(parts: list[ScenePart], settings: Mapping[str, object], scene: str) -> None:
    """Write settings into the tables of the files; raises UsageError for an unknown element or parameter."""
    places = {name: (part, index) for part in parts for name, index in part.names().items()}
    kinds = {str(name): element_type(part.kinds[index]) for name, (part, index) in places.items()}
    for setting, value in settings.items():
        # The unknown element may be one that a faulty file failed to give, so the faults of the file come first.
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
                document.fault(("element", index, "name"), f'"{element}" stands twice; expected a name of its own')
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
    """Return the element, or None with its faults noted; shipped kinds are tested, so only others are looked into."""
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
    line = "" if fault.line is None else f"line {fault.line}: "
    return Fault(f"in {source}: {line}{fault.key}", fault.message)


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
        first, second = (space.length_unit for space in spaces[:2])
        text = f"missing; expected a number, what a {spaces[0].value} axis moves for a {spaces[1].value} one"
        document.fault(("element", index, "ratio"), f"{text} [{first}/{second}]")


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
