"""The kinds of element by name: the shipped ones, and those that other packages add (`own`).

`element_type` imports the module of a kind when it is first used.
"""

from dataclasses import fields
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast, get_type_hints

from haptic_fieldbus.documents.own_parts import entry_point_names
from haptic_fieldbus.documents.quantities import Quantity, annotations
from haptic_fieldbus.scenes.element import AnyElement, Mark

if TYPE_CHECKING:
    from haptic_fieldbus.scenes.own import OwnElement


# The parameters of an element class: which ones a setting can change, and the quantity that each of them measures.

# Fields that tie an element to its scene, and are no parameters.
NOT_SETTABLE = ("name", "axis", "axes")
FIXED = "fixed"
"""Metadata of a field that is no parameter."""


def parameters(element: type[AnyElement]) -> list[str]:
    """Return the names of the parameters of an element class that a setting can change."""
    settable = [field for field in fields(cast(Any, element)) if not field.metadata.get(FIXED)]
    return [field.name for field in settable if field.name not in NOT_SETTABLE]


@cache
def quantities(element: type[AnyElement]) -> dict[str, Quantity]:
    """Return the quantity that each numeric parameter of an element class measures."""
    hints = get_type_hints(element, include_extras=True)
    return {
        name: quantity
        for name in parameters(element)
        for quantity in annotations(hints[name])
        if isinstance(quantity, Quantity)
    }


@cache
def place_names(element: type[AnyElement]) -> tuple[str, ...]:
    """Return the names of the parameters of an element class that are places of the handle."""
    hints = get_type_hints(element, include_extras=True)
    return tuple(name for name in parameters(element) if Mark.PLACE in annotations(hints[name]))


# Module and class as texts, so that a scene imports only the kinds that it contains. The order is that of the
# documentation.
ELEMENTS = {
    "braking_pulse": ("haptic_fieldbus.scenes.braking_pulse", "BrakingPulse"),
    "constant": ("haptic_fieldbus.scenes.constant", "Constant"),
    "coupling": ("haptic_fieldbus.scenes.coupling", "Coupling"),
    "dahl": ("haptic_fieldbus.scenes.dahl", "Dahl"),
    "damped_sprung_mass": ("haptic_fieldbus.scenes.damped_sprung_mass", "DampedSprungMass"),
    "damper": ("haptic_fieldbus.scenes.damper", "Damper"),
    "detents": ("haptic_fieldbus.scenes.detents", "Detents"),
    "end_stop": ("haptic_fieldbus.scenes.end_stop", "EndStop"),
    "free_puck": ("haptic_fieldbus.scenes.free_puck", "FreePuck"),
    "friction": ("haptic_fieldbus.scenes.friction", "Friction"),
    "generalised_maxwell": ("haptic_fieldbus.scenes.generalised_maxwell", "GeneralisedMaxwell"),
    "grating": ("haptic_fieldbus.scenes.grating", "Grating"),
    "gravity": ("haptic_fieldbus.scenes.gravity", "Gravity"),
    "hunt_crossley": ("haptic_fieldbus.scenes.hunt_crossley", "HuntCrossley"),
    "inertia": ("haptic_fieldbus.scenes.inertia", "Inertia"),
    "kelvin_voigt": ("haptic_fieldbus.scenes.kelvin_voigt", "KelvinVoigt"),
    "lugre": ("haptic_fieldbus.scenes.lugre", "LuGre"),
    "magnet": ("haptic_fieldbus.scenes.magnet", "Magnet"),
    "needle": ("haptic_fieldbus.scenes.needle", "Needle"),
    "pendulum": ("haptic_fieldbus.scenes.pendulum", "Pendulum"),
    "periodic": ("haptic_fieldbus.scenes.periodic", "Periodic"),
    "predicted_wall": ("haptic_fieldbus.scenes.predicted_wall", "PredictedWall"),
    "proxy": ("haptic_fieldbus.scenes.proxy", "Proxy"),
    "ramp": ("haptic_fieldbus.scenes.ramp", "Ramp"),
    "spring": ("haptic_fieldbus.scenes.spring", "Spring"),
    "sprung_mass": ("haptic_fieldbus.scenes.sprung_mass", "SprungMass"),
    "standard_linear_solid": ("haptic_fieldbus.scenes.standard_linear_solid", "StandardLinearSolid"),
    "stick_slip": ("haptic_fieldbus.scenes.stick_slip", "StickSlip"),
    "texture": ("haptic_fieldbus.scenes.texture", "Texture"),
    "virtual_coupling": ("haptic_fieldbus.scenes.virtual_coupling", "VirtualCoupling"),
    "wall": ("haptic_fieldbus.scenes.wall", "Wall"),
}


def element_type(kind: str) -> type[AnyElement]:
    """Return the class of a kind; KeyError for an unknown one, UsageError where the package that adds it is broken."""
    if kind in ELEMENTS:
        module, name = ELEMENTS[kind]
        return cast(type[AnyElement], getattr(import_module(module), name))
    from haptic_fieldbus.scenes.own import own_type

    return own_type(kind)


def kind_names() -> list[str]:
    """Return every kind that a scene file can name, without importing any; a shipped kind comes before its namesake."""
    from haptic_fieldbus.scenes.own import GROUP

    return [*ELEMENTS, *(kind for kind in entry_point_names(GROUP) if kind not in ELEMENTS)]


def kind_of(element: type[AnyElement]) -> str | None:
    """Return the kind of a class; None for one that no scene file can name."""
    place = (element.__module__, element.__qualname__)
    if shipped := next((kind for kind, known in ELEMENTS.items() if known == place), None):
        return shipped
    from haptic_fieldbus.scenes.own import own_kind

    return own_kind(element)


def own_elements() -> list["OwnElement"]:
    """Import every element that other packages add, and describe it."""
    from haptic_fieldbus.scenes.own import described

    return described(taken=ELEMENTS)
