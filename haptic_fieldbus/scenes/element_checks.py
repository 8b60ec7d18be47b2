"""Check elements made in Python by the rules of scene files.

A dataclass checks nothing by itself: `SprungMass("handle", 200.0, mass=0.0)` can be made, and divides by zero only much
later. So the annotations and rules by which a file is read (`documents`) are applied where a ready-made scene is first
used.
"""

import math
from dataclasses import fields, replace
from inspect import getattr_static
from typing import Any

from haptic_fieldbus.defaults import DEFAULT_METHOD
from haptic_fieldbus.documents import Document, suggestion, table_of
from haptic_fieldbus.errors import Fault, SceneError, wrong_kind
from haptic_fieldbus.numerals import rounded, rounded_limit
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.scenes.element import LAWS, AnyElement
from haptic_fieldbus.scenes.files import check_ratio
from haptic_fieldbus.scenes.scene import MadeFor, Scene, SceneAxis, axes_of
from haptic_fieldbus.signals import Workspace

LIGHTEST, HEAVIEST = 1e-4, 1e6
"""Range of the search for the smallest mass, in units of k·T²: T·√(k/m) from 100 down to 1/1000."""
ROUNDING = 1e-9
"""A spectral radius that is above 1 by no more than this counts as 1: the difference may be rounding."""


PASSIVITIES = ("observer", "controller")


def check_kinds(scene: Scene) -> None:
    """Raise TypeError for a scene made in Python with a field, an axis or an element of a wrong type."""
    for name in ("name", "description", "source"):
        if not isinstance(getattr(scene, name), str):
            raise wrong_kind(f"scene: {name}", "a text", getattr(scene, name))
    if scene.passivity not in PASSIVITIES:
        raise wrong_kind("scene: passivity", " or ".join(PASSIVITIES), scene.passivity)
    if not isinstance(scene.made_for, MadeFor | None):
        raise wrong_kind("scene: made_for", "a MadeFor or None", scene.made_for)
    if not (isinstance(scene.axes, list | tuple) and scene.axes):
        raise wrong_kind("scene: axes", "a tuple of at least one SceneAxis", scene.axes)
    for axis in scene.axes:
        if not (isinstance(axis, SceneAxis) and isinstance(axis.name, str) and isinstance(axis.workspace, Workspace)):
            raise wrong_kind("scene: axes", "a SceneAxis of a name and a Workspace", axis)
    if not isinstance(scene.elements, list | tuple):
        raise wrong_kind("scene: elements", "a tuple of elements", scene.elements)
    for element in scene.elements:
        needed = (("name",), ("needs",), ("linearised",), ("axis", "axes"), LAWS)
        lacking = [" or ".join(names) for names in needed if not any(_has(element, name) for name in names)]
        if lacking:
            raise wrong_kind("scene: elements", f"an element with {', '.join(lacking)}", element)


def _has(element: object, name: str) -> bool:
    """Return whether an object has a member, without running the code of a property."""
    return getattr_static(element, name, None) is not None


def check_elements(scene: Scene, period: float, method: str | None) -> None:
    """Raise SceneError with all faults for which a file of these elements would be refused.

    `period` [s] and `method` are those of the loop: a virtual mass of 0 is refused with the smallest mass that the
    method renders. An element without `__pydantic_config__` declares no checks, so that no file can contain it; its
    values are not checked, but its axis must be one of the scene's.
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
        # The keys of the faults are the labels that `_check_values` gave.
        owners = {f"{element.name}.mass": element for element in scene.elements}
        faults = [_with_limit(fault, owners.get(fault.key), period, method) for fault in error.faults]
        raise SceneError(error.source, faults) from None


def _says_how(element: AnyElement) -> bool:
    return hasattr(type(element), "__pydantic_config__")


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
    """Return the fault, with the smallest mass that the method renders if it refuses a virtual mass of 0."""
    # Imported for this fault alone: a scene without virtual masses needs no integrator.

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
        limit = f"for a mass towards 0 {name} stays bounded, and so does the force"
    return Fault(fault.key, f"{fault.message}; {limit}", fault.line)


def _least_mass(element: AnyElement, period: float, method: str, unit: float) -> float | None:
    """Return the smallest mass [kg or kg·m²] without growing motion; 0 when any mass is, None when none is."""
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
    # Bisection on a logarithmic scale, as the range spans ten decades.
    while high - low > 1e-9 * high:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if is_stable(middle) else (middle, high)
    return high
