"""Kinds of the arguments of the Python API.

A value of another kind is refused with the name of the argument before anything is loaded. Whether the value itself
fits is checked where it is used.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from importlib import import_module
from numbers import Integral, Rational, Real
from pathlib import Path
from typing import Any, cast

from haptic_fieldbus.documents.own_parts import OwnName, name_of
from haptic_fieldbus.drive.rig import BusSection, Rig, RigAxis
from haptic_fieldbus.errors import wrong_kind
from haptic_fieldbus.scenes.scene import Scene

Holds = Callable[[Any], bool]
"""Test of whether a value is of the kind that an argument has."""
PATH = str | Path
"""Types of a path."""
LARGEST = 10**308
"""Largest whole number that is taken as a number: a float holds it."""


def _is_whole(value: object) -> bool:
    """Return whether a value is a whole number; True and False are none."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    """Return whether a value is a float, or a whole number that a float can hold."""
    if _is_whole(value):
        return abs(cast(int, value)) <= LARGEST
    return isinstance(value, Real) and not isinstance(value, Rational)  # bool and Fraction are rational


def _is_name(value: object) -> bool:
    """Return whether a value is a text that is not empty."""
    return isinstance(value, str) and value != ""


def _is_part(value: object, module: str, kind: str) -> bool:
    """Return whether a value is a name, or an object of Python of this class, which is imported for one alone."""
    if not isinstance(value, OwnName):
        return _is_name(value)
    return isinstance(value.part, getattr(import_module(f"haptic_fieldbus.{module}"), kind))


def _is_settings(value: object) -> bool:
    """Return whether a value is a mapping of names."""
    return isinstance(value, Mapping) and all(map(_is_name, value))


def _is_rig(value: object) -> bool:
    """Return whether a value is a path, or a Rig with at least one axis; `catalogue.check_rig` looks into it."""
    if not isinstance(value, Rig):
        return isinstance(value, PATH)
    tables: Any = ((value.bus, BusSection), (value.axis, RigAxis))
    known = (_is_settings(table) and all(isinstance(each, kind) for each in table.values()) for table, kind in tables)
    return all(known) and len(value.axis) > 0


def _is_times(value: object) -> bool:
    """Return whether a value is a sequence of pairs of numbers."""
    return isinstance(value, Sequence) and all(
        isinstance(pair, Sequence) and len(pair) == 2 and all(map(_is_number, pair)) for pair in value
    )


def _is_faults(value: object) -> bool:
    """Return whether a value is a path or a list of faults; each fault has a kind."""
    return isinstance(value, PATH) or (isinstance(value, Sequence) and all(hasattr(each, "kind") for each in value))


KINDS: Mapping[str, tuple[str, Holds]] = {
    "scene": ("a name of the library, a path or a Scene", lambda value: isinstance(value, PATH | Scene)),
    "rig": ("the path of a rig file, or a Rig of buses and axes", _is_rig),
    "settings": ('a mapping such as {"wall.stiffness": 800.0}', _is_settings),
    "axes": (
        'a mapping of names, such as {"knob": "handle"}',
        lambda value: _is_settings(value) and all(map(_is_name, value.values())),
    ),
    "rate": ("a number in Hz", _is_number),
    **dict.fromkeys(("duration", "fade_in", "delay"), ("a number in s", _is_number)),
    **dict.fromkeys(("mass", "damping", "coulomb", "resolution", "amplitude"), ("a number", _is_number)),
    **dict.fromkeys(("node", "seed", "sample", "steps", "chunk", "workers"), ("a whole number", _is_whole)),
    **dict.fromkeys(("force", "prove", "anonymous", "yes"), ("True or False", lambda value: isinstance(value, bool))),
    "method": ("a name or an Integrator", lambda value: _is_part(value, "numerics.integrators", "Integrator")),
    "estimator": ("a name or an Estimator", lambda value: _is_part(value, "numerics.estimators", "Estimator")),
    "hand": ("a name or a Hand", lambda value: _is_part(value, "sim.hand", "Hand")),
    **dict.fromkeys(("drive", "bus", "zero", "engine", "scheduler", "axis"), ("a name", _is_name)),
    "free": ("times in s, such as [(12.0, 18.5)]", _is_times),
    **dict.fromkeys(("profiles", "record", "input", "file", "out"), ("a path", lambda value: isinstance(value, PATH))),
    "faults": ("a path, random@SEED or a list of faults", _is_faults),
    # Into a list `Changes` looks itself; most runs do not import it.
    "changes": (
        'a Changes, or a list such as [(2.0, {"wall.stiffness": 800.0})]',
        lambda value: isinstance(value, list | tuple) or hasattr(value, "scheduled"),
    ),
    "live": ("a Live", lambda value: hasattr(value, "follow") and hasattr(value, "begin")),
    **dict.fromkeys(("confirm", "instruct", "announce", "measure"), ("a function", callable)),
    "effort": ("a function of the feedback", callable),
    "executor": ("an Executor", lambda value: callable(getattr(value, "submit", None))),
    "progress": ("a function, True or False", lambda value: isinstance(value, bool) or callable(value)),
}
"""Expected kind of each argument by its name: in words, and as a test. None is accepted where it is the default."""


OF_PYTHON = ("method", "estimator", "hand")
"""Arguments that may be objects of Python; they travel with their names."""


def asked_of(function: str, arguments: Mapping[str, Any], *kinds: type[Any]) -> Any:
    """Return a value of each kind with the arguments that are its fields; one value alone, several as a tuple.

    Raises one TypeError for all arguments of the wrong kind.
    """
    given = {name: name_of(value) if name in OF_PYTHON else value for name, value in arguments.items()}
    asked = [kind(**{each.name: given[each.name] for each in fields(kind) if each.name in given}) for kind in kinds]
    check_arguments(function, *asked)
    return asked[0] if len(asked) == 1 else tuple(asked)


def check_arguments(function: str, *asked: Any) -> None:
    """Raise one TypeError for all arguments of the wrong kind in these values, each with its name."""
    given = ((getattr(each, field.name), field) for each in asked for field in fields(each))
    check_values(function, ((field.name, value) for value, field in given if (value, field.default) != (None, None)))


def check_values(function: str, given: Iterable[tuple[str, Any]]) -> None:
    """Raise one TypeError for all of these arguments that are of the wrong kind, each with its name."""
    wrong = []
    for name, value in given:
        expected, holds = KINDS.get(name, ("", None))
        if holds and not holds(value):
            own = value.part if isinstance(value, OwnName) else value
            wrong.append(str(wrong_kind(f"{function}() {name}", expected, own)))
    if wrong:
        raise TypeError("\n".join(wrong))
