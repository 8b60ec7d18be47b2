"""The scenes that are shipped, and those of files."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from haptic_fieldbus.documents import file_names, file_of, schema_of
from haptic_fieldbus.scenes.files import (
    LIBRARY,
    SceneFile,
    ScenePart,
    apply_settings,
    check_together,
    elements_of,
    raise_faults,
    read_parts,
)
from haptic_fieldbus.scenes.files import parameters as parameters
from haptic_fieldbus.scenes.files import quantities as quantities
from haptic_fieldbus.scenes.quantities import Quantity
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, own_elements
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Workspace

Setting = float | str | bool


def scene_names() -> list[str]:
    return file_names(LIBRARY)


def load_scene(name_or_path: str | Path, settings: Mapping[str, Setting] | None = None) -> Scene:
    """A shipped scene by name, or any by the path of its file; `settings` as {"wall.stiffness": 800.0}.

    Raises SceneError with all faults of files and settings, UsageError for an unknown scene, element or parameter.
    """
    path = file_of("scene", name_or_path, LIBRARY)
    parts = read_parts(path)
    apply_settings(parts, settings or {}, path.stem)
    axes = check_together(parts)
    elements = [element for part in parts for element in elements_of(part, axes)]
    raise_faults(parts)
    frame = parts[-1].frame
    return Scene(
        name=path.stem,
        description=frame.description if frame is not None else "",
        axes=tuple(SceneAxis(name, workspace, _held(parts, name)) for name, workspace in axes.items()),
        elements=tuple(elements),
        source=str(path),
        hand=frame.hand if frame is not None else None,
    )


def _held(parts: list[ScenePart], axis: str) -> bool | None:
    """What the last file that says it says of the hand on an axis."""
    frames = [part.frame for part in parts if part.frame is not None and axis in part.frame.axis]
    told = [held for frame in frames if (held := frame.axis[axis].held) is not None]
    return told[-1] if told else None


def scene_summaries() -> list[dict[str, str | list[str]]]:
    """What `scenes list` shows of each shipped scene."""
    return [
        {"name": scene.name, "description": scene.description, "axes": [axis.name for axis in scene.axes]}
        for scene in map(load_scene, scene_names())
    ]


def scene_schema(*, own: bool = False) -> dict[str, Any]:
    """The JSON Schema of a scene file, with each kind of element; with `own` also those that other packages add."""
    schema = schema_of(SceneFile)
    definitions = schema.setdefault("$defs", {})
    names = {kind: element_type(kind).__name__ for kind in ELEMENTS}
    if own:
        names |= {each.kind: f"own.{each.kind}" for each in own_elements() if each.fault is None}
    for kind, name in names.items():
        element = _element_schema(kind, name)
        definitions |= {f"{name}.{part}": schema for part, schema in element.pop("$defs", {}).items()}
        definitions[name] = element
    schema["properties"]["element"]["items"] = {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in names.values()]}
    return schema


def _element_schema(kind: str, name: str) -> dict[str, Any]:
    """The JSON Schema of an element of a scene file; its own definitions are called as `name` and their name."""
    written = json.dumps(schema_of(element_type(kind)))
    element: dict[str, Any] = json.loads(written.replace('"#/$defs/', f'"#/$defs/{name}.'))
    for name, quantity in quantities(element_type(kind)).items():
        element["properties"][name] = _with_units(element["properties"][name], quantity)
    element["properties"] = {"kind": {"const": kind}} | element["properties"]
    element["required"] = ["kind", *element.get("required", ())]
    return element


def _with_units(schema: dict[str, Any], quantity: Quantity) -> dict[str, Any]:
    """A number in SI, or a text of a number and its unit."""
    units = " or ".join(dict.fromkeys(quantity.unit(workspace) for workspace in Workspace if quantity.unit(workspace)))
    described = {"description": f"in {units}"} if units else {}
    text = {"type": "string", "pattern": r"^\s*[-+.0-9]"}
    kept = [key for key in ("default", "title") if key in schema]
    whole: dict[str, Any] = {key: schema.pop(key) for key in kept} | described
    return whole | {"anyOf": [*schema.get("anyOf", [schema]), text]}
