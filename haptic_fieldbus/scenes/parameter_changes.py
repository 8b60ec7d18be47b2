"""Change parameters of a scene that is already built, under the same checks as settings of a file."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, cast

from haptic_fieldbus.documents import Document, suggestion, table_of
from haptic_fieldbus.errors import SceneError, UsageError
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.files import convert, named, put
from haptic_fieldbus.scenes.scene import Scene

# The axes of a scene under other names, so that a scene fits a bench whose axes are called differently.


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


def _renamed(element: Any, names: Mapping[str, str]) -> AnyElement:
    if hasattr(element, "axis"):
        return cast(AnyElement, replace(element, axis=names.get(element.axis, element.axis)))
    return cast(AnyElement, replace(element, axes=tuple(names.get(name, name) for name in element.axes)))


def changed(scene: Scene, settings: Mapping[str, object]) -> Scene:
    """Return the scene with settings applied, such as {"wall.stiffness": 800.0} or {"wall.stiffness": "0.8 N/mm"}.

    Elements that no setting names stay the same objects. Raises SceneError with all faults of the settings, UsageError
    for an unknown element or parameter. An element without `__pydantic_config__` declares no checks and takes any
    value, but no text in the place of a number.
    """
    document = Document(scene.source or scene.name, "", SceneError)
    document.data["element"] = [table_of(element) for element in scene.elements]
    places = {element.name: place for place, element in enumerate(scene.elements)}
    kinds = {element.name: type(element) for element in scene.elements}
    given: dict[int, dict[str, object]] = {}
    for setting, value in settings.items():
        name, parameter = named(setting, kinds, scene.name)
        given.setdefault(places[name], {})[parameter] = value
        put(document, places[name], parameter, value, setting)
    found = {place: _made(document, place, scene, given[place]) for place in given}
    elements = document.checked([found.get(place, element) for place, element in enumerate(scene.elements)])
    return replace(scene, elements=tuple(element for element in elements if element is not None))


def _made(document: Document, place: int, scene: Scene, given: Mapping[str, object]) -> AnyElement | None:
    """Return the element built from its changed table; None when it has faults, which are noted in the document."""
    element: Any = scene.elements[place]
    if not hasattr(type(element), "__pydantic_config__"):
        return _unchecked(document, place, element, given)
    for field in fields(element):
        # A value that was just set keeps its label, the name of the setting.
        document.labels.setdefault(("element", place, field.name), f"{element.name}.{field.name}")
    document.labels["element", place] = element.name
    convert(document, place, type(element), {axis.name: axis.workspace for axis in scene.axes})
    return document.validate(type(element), ("element", place))


def _unchecked(document: Document, place: int, element: Any, given: Mapping[str, object]) -> AnyElement | None:
    """Return an element that declares no checks with these values; None when it has faults, which are noted."""
    numbers = [name for name in given if isinstance(getattr(element, name), int | float)]
    texts = [name for name in numbers if isinstance(given[name], str)]
    for name in texts:
        units = f"{type(element).__name__} accepts units only with the line __pydantic_config__: ClassVar = STRICT"
        fields_too = "and fields annotated with the types of haptic_fieldbus.scenes.element"
        document.refuse(("element", place, name), f"a number; {units} {fields_too}")
    if texts:
        return None
    try:
        return cast(AnyElement, replace(element, **given))
    except (TypeError, ValueError) as error:  # its own __post_init__ may refuse a value
        document.fault(("element", place), f"{element.name}: {error}")
        return None
