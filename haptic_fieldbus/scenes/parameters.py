"""The parameters of an element class: which ones a setting can change, and the quantity that each of them measures."""

from dataclasses import fields
from functools import cache
from typing import Any, cast, get_type_hints

from haptic_fieldbus.documents.quantities import Quantity, annotations
from haptic_fieldbus.scenes.element import AnyElement, Mark

# Fields that tie an element to its scene, and are no parameters.
NOT_SETTABLE = ("name", "axis", "axes")


def parameters(element: type[AnyElement]) -> list[str]:
    """Return the names of the parameters of an element class that a setting can change."""
    return [field.name for field in fields(cast(Any, element)) if field.name not in NOT_SETTABLE]


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
