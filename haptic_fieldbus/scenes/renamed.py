"""The axes of a scene under other names, so that a scene fits a bench whose axes are called differently."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.scene import Scene


def with_axes(scene: Scene, names: Mapping[str, str]) -> Scene:
    """Return the scene with its axes renamed, {"knob": "handle"}; other axes keep their names.

    Raises UsageError for an axis that the scene does not have, and when two axes would have one name.
    """
    known = [axis.name for axis in scene.axes]
    for name in names:
        if name not in known:
            given = f"--axis {name}={names[name]}"
            raise UsageError(f'{given}: the scene {scene.name} has no axis "{name}"{suggestion(name, known)}')
    new = [names.get(name, name) for name in known]
    twice = next((name for name in new if new.count(name) > 1), None)
    if twice is not None:
        both = " and ".join(name for name in known if names.get(name, name) == twice)
        raise UsageError(
            f'--axis: {both} of the scene {scene.name} would both be "{twice}"; expected one axis for each'
        )
    axes = tuple(replace(axis, name=name) for axis, name in zip(scene.axes, new, strict=True))
    return replace(scene, axes=axes, elements=tuple(_renamed(element, names) for element in scene.elements))


def _renamed(element: AnyElement, names: Mapping[str, str]) -> AnyElement:
    made: Any = element
    if hasattr(made, "axis"):
        made = replace(made, axis=names.get(made.axis, made.axis))
    else:
        made = replace(made, axes=tuple(names.get(name, name) for name in made.axes))
    renamed: AnyElement = made
    return renamed
