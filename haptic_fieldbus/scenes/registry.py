"""The kinds of element by name; a module is imported when a scene has an element of its kind."""

from importlib import import_module

from haptic_fieldbus.scenes.element import Element

ELEMENTS = {
    "sprung_mass": ("haptic_fieldbus.scenes.sprung_mass", "SprungMass"),
    "wall": ("haptic_fieldbus.scenes.wall", "Wall"),
}


def element_type(kind: str) -> type[Element]:
    """The class of a kind; raises KeyError for one that is not in the table."""
    module, name = ELEMENTS[kind]
    found: type[Element] = getattr(import_module(module), name)
    return found
