"""Load scenes of the library and of files, list the shipped ones, and give the JSON Schema of their files."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from haptic_fieldbus.documents import file_names, file_of, schema_of
from haptic_fieldbus.documents.quantities import with_units
from haptic_fieldbus.errors import wrong_kind
from haptic_fieldbus.scenes import files
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, own_elements, quantities
from haptic_fieldbus.scenes.scene import MadeFor, Scene, SceneAxis
from haptic_fieldbus.signals import Workspace

Setting = float | str | bool


def scene_names() -> list[str]:
    """Return the names of the shipped scenes, sorted."""
    return file_names(files.LIBRARY)


@own_faults()
def load_scene(name_or_path: str | Path, settings: Mapping[str, Setting] | None = None) -> Scene:
    """Load a shipped scene by its name, or any scene by the path of its file.

    `settings` replace single parameters, such as {"wall.stiffness": 800.0}. Raises SceneError with all faults of files
    and settings, UsageError for an unknown scene, element or parameter.
    """
    if not isinstance(settings, Mapping | None):
        raise wrong_kind("settings", 'a mapping such as {"wall.stiffness": 800.0}', settings)
    path = file_of("scene", name_or_path, files.LIBRARY)
    parts = files.read_parts(path)
    files.apply_settings(parts, settings or {}, path.stem)
    axes = files.check_together(parts)
    # All parts are validated before the first fault is raised, so that one error lists them all.
    elements = [element for part in parts for element in files.elements_of(part, axes)]
    files.raise_faults(parts)
    frame = cast(files.SceneFile, parts[-1].frame)  # one that could not be read is a fault
    told = [part.frame.passivity for part in parts if part.frame is not None and part.frame.passivity]
    return Scene(
        name=path.stem,
        description=frame.description,
        axes=tuple(SceneAxis(name, workspace, _held(parts, name)) for name, workspace in axes.items()),
        elements=tuple(elements),
        source=str(path),
        hand=frame.hand,
        passivity=told[-1] if told else "observer",  # that of the last file that names one
        made_for=MadeFor(made.rate, made.drive) if (made := frame.made_for) else None,
    )


def _held(parts: list[files.ScenePart], axis: str) -> bool | None:
    """Return whether the hand holds an axis, by the last file that states it; None when no file does."""
    frames = [part.frame for part in parts if part.frame is not None and axis in part.frame.axis]
    told = [held for frame in frames if (held := frame.axis[axis].held) is not None]
    return told[-1] if told else None


def scene_summaries() -> list[dict[str, str | list[str]]]:
    """Return name, description and axes of each shipped scene, as shown by `scenes list`."""
    return [
        {"name": scene.name, "description": scene.description, "axes": [axis.name for axis in scene.axes]}
        for scene in map(load_scene, scene_names())
    ]


def scene_schema(*, own: bool = False) -> dict[str, Any]:
    """Return the JSON Schema of a scene file, with a definition for each kind of element.

    With `own` it has the elements that other packages add too.
    """
    schema = schema_of(files.SceneFile)
    definitions = schema.setdefault("$defs", {})
    names = {kind: element_type(kind).__name__ for kind in ELEMENTS}
    if own:
        names |= {each.kind: f"own.{each.kind}" for each in own_elements() if each.fault is None}
    for kind, name in names.items():
        element = _element_schema(kind, name)
        # References count from the root of the schema, so the definitions inside of an element move there.
        definitions |= {f"{name}.{part}": schema for part, schema in element.pop("$defs", {}).items()}
        definitions[name] = element
    schema["properties"]["element"]["items"] = {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in names.values()]}
    return schema


def _element_schema(kind: str, name: str) -> dict[str, Any]:
    """Return the JSON Schema of an element of a scene file; `name` stands in front of the names of its definitions."""
    written = json.dumps(schema_of(element_type(kind)))
    element: dict[str, Any] = json.loads(written.replace('"#/$defs/', f'"#/$defs/{name}.'))
    for name, quantity in quantities(element_type(kind)).items():
        units = dict.fromkeys(quantity.unit(workspace) for workspace in Workspace if quantity.unit(workspace))
        element["properties"][name] = with_units(element["properties"][name], " or ".join(units))
    element["properties"] = {"kind": {"const": kind}} | element["properties"]
    element["required"] = ["kind", *element.get("required", ())]
    return element
