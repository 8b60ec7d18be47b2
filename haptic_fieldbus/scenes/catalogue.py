"""The scenes that are shipped, and reading scenes from files.

A scene file is read in two steps: its frame (`SceneFile`), then each element as the dataclass of its kind, so that
only the modules of the kinds in use are imported. Settings replace single parameters in between.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, cast

from annotated_types import Len

from haptic_fieldbus.documents import Document, file_names, file_of, read_document, schema_of, suggestion
from haptic_fieldbus.errors import SceneError, UsageError
from haptic_fieldbus.scenes.element import STRICT, Element
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Workspace

Setting = float | str | bool

_LIBRARY = Path(__file__).resolve().parent / "library"
_NOT_SETTABLE = ("name", "axis")


@dataclass(frozen=True)
class AxisSection:
    workspace: Workspace
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class SceneFile:
    """The frame of a scene file; the elements are read by their kind."""

    axis: Annotated[dict[str, AxisSection], Len(1)]
    element: Annotated[tuple[dict[str, object], ...], Len(1)]
    description: str = ""
    __pydantic_config__: ClassVar = STRICT


def scene_names() -> list[str]:
    return file_names(_LIBRARY)


def load_scene(name_or_path: str | Path, settings: Mapping[str, Setting] | None = None) -> Scene:
    """A shipped scene by name, or any by the path of its file; `settings` as {"wall.stiffness": 800.0}.

    Raises SceneError with all faults of file and settings, UsageError for an unknown scene, element or parameter.
    """
    document = read_document(file_of("scene", name_or_path, _LIBRARY), SceneError)
    frame = document.validate(SceneFile)
    kinds = _name_elements(document)
    _apply(document, kinds, settings or {})
    elements = [document.validate(element_type(kind), ("element", index)) for index, kind in kinds.items()]
    _check_axes(document, kinds)
    frame = document.checked(frame)
    return Scene(
        name=Path(document.source).stem,
        description=frame.description,
        axes=tuple(SceneAxis(name, axis.workspace) for name, axis in frame.axis.items()),
        elements=tuple(element for element in elements if element is not None),
        source=document.source,
    )


def scene_summaries() -> list[dict[str, str | list[str]]]:
    """What `scenes list` shows of each shipped scene."""
    return [
        {"name": scene.name, "description": scene.description, "axes": [axis.name for axis in scene.axes]}
        for scene in map(load_scene, scene_names())
    ]


def parameters(element: type[Element]) -> list[str]:
    """The parameters of an element that a setting can give."""
    return [field.name for field in fields(cast(Any, element)) if field.name not in _NOT_SETTABLE]


def scene_schema() -> dict[str, Any]:
    """The JSON Schema of a scene file, with each kind of element."""
    schema = schema_of(SceneFile)
    definitions = schema.setdefault("$defs", {})
    for kind in ELEMENTS:
        element = schema_of(element_type(kind))
        definitions |= element.pop("$defs", {})
        element["properties"] = {"kind": {"const": kind}} | element["properties"]
        element["required"] = ["kind", *element["required"]]
        definitions[element["title"]] = element
    schema["properties"]["element"]["items"] = {
        "oneOf": [{"$ref": f"#/$defs/{element_type(kind).__name__}"} for kind in ELEMENTS]
    }
    return schema


def _name_elements(document: Document) -> dict[int, str]:
    """The known kinds by the place of the element; each element's table is left with a name and without its kind."""
    raw = document.value("element")
    tables = {i: table for i, table in enumerate(raw if isinstance(raw, list) else []) if isinstance(table, dict)}
    given = [table.get("kind") for table in tables.values()]
    kinds: dict[int, str] = {}
    names: set[object] = set()
    for index, table in tables.items():
        kind = table.get("kind")
        if not isinstance(kind, str) or kind not in ELEMENTS:
            document.refuse(("element", index, "kind"), f"a kind of element{suggestion(str(kind or ''), ELEMENTS)}")
            continue
        if "name" not in table and given.count(kind) > 1:
            document.fault(("element", index, "name"), f'missing; expected one, as the kind "{kind}" stands twice')
        kinds[index] = kind
        del table["kind"]
        name = str(table.setdefault("name", kind))
        if name in names:
            document.fault(("element", index, "name"), f'"{name}" stands twice; expected a name of its own')
        names.add(name)
    return kinds


def _apply(document: Document, kinds: dict[int, str], settings: Mapping[str, Setting]) -> None:
    """Put settings in the place of what the file gives; a faulty file is told of before an unknown name."""
    indices = {document.value("element", index, "name"): index for index in kinds}
    for setting, value in settings.items():
        name, dot, parameter = setting.rpartition(".")
        if not dot:
            raise UsageError(
                f"--set {setting}: expected element.parameter, such as {next(iter(indices), 'wall')}.{setting}"
            )
        if name not in indices:
            if document.faulty:
                continue
            near = suggestion(name, [str(known) for known in indices])
            raise UsageError(f'--set {setting}: no element "{name}" in scene {Path(document.source).stem}{near}')
        index = indices[name]
        known = parameters(element_type(kinds[index]))
        if parameter not in known:
            raise UsageError(f'--set {setting}: no parameter "{parameter}" of {name}{suggestion(parameter, known)}')
        document.table("element", index)[parameter] = value
        document.labels["element", index, parameter] = f"--set {setting}"


def _check_axes(document: Document, kinds: dict[int, str]) -> None:
    axes = document.table("axis")
    for index in kinds:
        axis = document.value("element", index, "axis")
        if isinstance(axis, str) and axis not in axes:
            document.fault(("element", index, "axis"), f"no [axis.{axis}] in this file{suggestion(axis, axes)}")
