"""Elements that were made in Python, held to what their files are held to.

A dataclass checks nothing: `SprungMass("handle", 200.0, mass=0.0)` exists, and divides by zero far from here. The
annotations and rules by which a file is read (`documents`) are asked about a ready-made scene where it is first used.
"""

import math
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from enum import Enum
from typing import Any

from haptic_fieldbus.defaults import DEFAULT_METHOD
from haptic_fieldbus.documents import Document, suggestion
from haptic_fieldbus.errors import Fault, SceneError
from haptic_fieldbus.numerals import rounded, rounded_limit
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.files import check_ratio
from haptic_fieldbus.scenes.scene import Scene, axes_of

LIGHTEST, HEAVIEST = 1e-4, 1e6
"""Masses looked at, of k·T²: T·√(k/m) from 100 down to 1/1000."""
ROUNDING = 1e-9
"""A spectral radius this little above 1 may be the rounding of 1."""


def check_elements(scene: Scene, period: float, method: str | None) -> None:
    """Raises SceneError with all that a file of these elements would be refused for; `period` in s.

    A virtual mass of 0 is told the smallest one that the method renders. Elements that no file can have, because they
    do not say how (`__pydantic_config__`), have values that are their maker's own affair; their axis must be one of the
    scene's like any other.
    """
    document = Document(scene.source or scene.name, "", SceneError)
    document.data["element"] = [table_of(element) if _says_how(element) else {} for element in scene.elements]
    for place, element in enumerate(scene.elements):
        if _says_how(element):
            _check_values(document, place, element, scene)
        _check_axes(document, place, element, [axis.name for axis in scene.axes])
    try:
        document.checked(scene)
    except SceneError as error:
        owners = {f"{element.name}.mass": element for element in scene.elements}
        faults = [_with_limit(fault, owners.get(fault.key), period, method) for fault in error.faults]
        raise SceneError(error.source, faults) from None


def _says_how(element: AnyElement) -> bool:
    return hasattr(type(element), "__pydantic_config__")


def table_of(element: AnyElement) -> dict[str, object]:
    """What a file would give; it has no word for None, and leaves the key out."""
    given: Any = element
    return {
        field.name: _plain(getattr(element, field.name))
        for field in fields(given)
        if field.init and not (getattr(element, field.name) is None and _may_be_left_out(field))
    }


def _may_be_left_out(field: Field[Any]) -> bool:
    """Whether nothing is the same as None; or is told as missing, which is what it is."""
    return field.default is None or (field.default is MISSING and field.default_factory is MISSING)


def _plain(value: object) -> object:
    """As TOML would give it; objects that it has not are left for the schema to refuse."""
    if value is None:
        return "None"
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, list | tuple):
        return [_plain(member) for member in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value) if field.init}
    return value.item() if hasattr(value, "item") else value


def _check_values(document: Document, place: int, element: AnyElement, scene: Scene) -> None:
    at = ("element", place)
    document.labels[at] = element.name
    given: Any = element
    document.labels.update({(*at, field.name): f"{element.name}.{field.name}" for field in fields(given)})
    document.validate(type(element), at)
    check_ratio(document, place, type(element), {axis.name: axis.workspace for axis in scene.axes})


def _check_axes(document: Document, place: int, element: AnyElement, axes: list[str]) -> None:
    path = ("element", place, "axis" if hasattr(element, "axis") else "axes")
    document.labels[path] = f"{element.name}.{path[-1]}"
    for axis in axes_of(element):
        if axis not in axes:
            document.fault(path, f"this scene has no axis {axis!r}{suggestion(str(axis), axes)}")


def _with_limit(fault: Fault, element: AnyElement | None, period: float, method: str | None) -> Fault:
    """A massless virtual mass is told where its method ends."""

    if element is None or not hasattr(type(element), "dynamics") or getattr(element, "mass", None) != 0.0:
        return fault
    stiffness = getattr(element, "stiffness", math.nan)
    if not (isinstance(stiffness, float | int) and 0.0 < stiffness < math.inf and 0.0 < period < math.inf):
        return fault
    name = method or DEFAULT_METHOD
    least = _least_mass(element, period, name, stiffness * period**2)
    if least is None:
        limit = f"{name} renders no mass without growth"
    elif least:
        limit = f"{name} renders it without growth from {rounded_limit(least)} up, at {rounded(1.0 / period)} Hz"
    else:
        limit = f"as it goes to 0 {name} stays bounded, and so does the force"
    return Fault(fault.key, f"{fault.message}; {limit}", fault.line)


def _least_mass(element: AnyElement, period: float, method: str, unit: float) -> float | None:
    """The smallest mass that the method makes no motion of grow; 0 for any, None for none."""
    from haptic_fieldbus.numerics import integrators

    def is_stable(mass: float) -> bool:
        light: Any = replace(element, mass=mass)  # type: ignore[type-var]
        space: StateSpace = light.dynamics
        return spectral_radius(integrators.discrete(space, period, method).a) <= 1.0 + ROUNDING

    low, high = LIGHTEST * unit, HEAVIEST * unit
    if is_stable(low):
        return 0.0
    if not is_stable(high):
        return None
    while high - low > 1e-9 * high:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if is_stable(middle) else (middle, high)
    return high
