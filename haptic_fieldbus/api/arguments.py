"""Functions of one value that are called with the arguments of that value.

A request to the package is a frozen dataclass, and its fields are the arguments of a function of the Python API. So
each argument and its default is written once. What each may be stands in `KINDS`: a value of another kind is refused
with the name of the argument before anything is loaded. Whether the value itself fits is checked where it is used.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import wraps
from numbers import Integral, Rational, Real
from pathlib import Path
from typing import Any, ParamSpec, Protocol, TypeVar, cast

from haptic_fieldbus.drive.rig import BusSection, Rig, RigAxis
from haptic_fieldbus.errors import wrong_kind
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene

P = ParamSpec("P")
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
AskedBy = TypeVar("AskedBy", contravariant=True)
Answered = TypeVar("Answered", covariant=True)


Holds = Callable[[Any], bool]
"""Test of whether a value is of the kind that an argument has."""
LARGEST = 10**308
"""Largest whole number that is taken as a number: a float holds it."""


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    """Return whether a value is a float, or a whole number that a float can hold."""
    if _is_whole(value):
        return abs(cast(int, value)) <= LARGEST
    return isinstance(value, Real) and not isinstance(value, Rational)  # bool and Fraction are rational


def _is_truth(value: object) -> bool:
    return isinstance(value, bool)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value != ""


def _is_path(value: object) -> bool:
    return isinstance(value, str | Path)


def _is_settings(value: object) -> bool:
    return isinstance(value, Mapping) and all(map(_is_name, value))


def _is_axes(value: object) -> bool:
    return _is_settings(value) and all(map(_is_name, cast(Mapping[str, object], value).values()))


def _is_rig(value: object) -> bool:
    """Return whether a value is a path, or a Rig with at least one axis; `catalogue.check_rig` looks into it."""
    if not isinstance(value, Rig):
        return _is_path(value)
    return (
        _is_settings(value.bus)
        and _is_settings(value.axis)
        and len(value.axis) > 0
        and all(isinstance(each, BusSection) for each in value.bus.values())
        and all(isinstance(each, RigAxis) for each in value.axis.values())
    )


def _is_faults(value: object) -> bool:
    return _is_path(value) or (isinstance(value, Sequence) and all(hasattr(each, "kind") for each in value))


def _is_changes(value: object) -> bool:
    """Return whether a value is a list, into which `Changes` looks, or a Changes, which most runs do not import."""
    return isinstance(value, list | tuple) or hasattr(value, "scheduled")


KINDS: Mapping[str, tuple[str, Holds]] = {
    "scene": ("a name of the library, a path or a Scene", lambda value: _is_path(value) or isinstance(value, Scene)),
    "rig": ("the path of a rig file, or a Rig of buses and axes", _is_rig),
    "settings": ('a mapping such as {"wall.stiffness": 800.0}', _is_settings),
    "axes": ('a mapping of names, such as {"knob": "handle"}', _is_axes),
    "rate": ("a number in Hz", _is_number),
    **dict.fromkeys(("duration", "fade_in", "delay"), ("a number in s", _is_number)),
    **dict.fromkeys(("mass", "damping", "coulomb", "resolution", "amplitude"), ("a number", _is_number)),
    **dict.fromkeys(("node", "seed"), ("a whole number", _is_whole)),
    **dict.fromkeys(("force", "prove"), ("True or False", _is_truth)),
    **dict.fromkeys(("method", "estimator", "drive", "bus", "zero", "hand"), ("a name", _is_name)),
    **dict.fromkeys(("profiles", "record", "input", "file"), ("a path", _is_path)),
    "faults": ("a path, random@SEED or a list of faults", _is_faults),
    "changes": ('a Changes, or a list such as [(2.0, {"wall.stiffness": 800.0})]', _is_changes),
    **dict.fromkeys(("confirm", "instruct", "progress", "announce"), ("a function", callable)),
}
"""What an argument is expected to be, by its name: in words, and as a test. None is taken where it is the default."""


def check_arguments(function: str, asked: Any) -> None:
    """Raise one TypeError for all arguments of the wrong kind in a request, each with its name."""
    wrong = []
    for field in fields(asked):
        expected, holds = KINDS.get(field.name, ("", None))
        value = getattr(asked, field.name)
        if holds and not (value is None and field.default is None) and not holds(value):
            wrong.append(str(wrong_kind(f"{function}() {field.name}", expected, value)))
    if wrong:
        raise TypeError("\n".join(wrong))


class Called(Protocol[P, AskedBy, Answered]):
    """A function that takes the fields of a value as arguments; `of` takes the value itself."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Answered: ...

    def of(self, asked: AskedBy, /) -> Answered: ...


def arguments_of(make: Callable[P, Asked]) -> Callable[[Callable[[Asked], Answer]], Called[P, Asked, Answer]]:
    """Decorate a function of one value: it takes the arguments of `make` instead, and its signature shows them.

    A call with wrong arguments raises TypeError with the name of the decorated function. An error in the code of an own
    element becomes a SceneError with its name, file and line, also from `of`.
    """

    def decorated(function: Callable[[Asked], Answer]) -> Called[P, Asked, Answer]:
        answered = own_faults()(function)
        shown = inspect.signature(make).replace(return_annotation=inspect.signature(function).return_annotation)

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> Answer:
            try:
                shown.bind(*args, **kwargs)
            except TypeError as wrong:  # names the function that was called, not the dataclass
                raise TypeError(f"{function.__name__}() {wrong}") from None
            asked = make(*args, **kwargs)
            check_arguments(function.__name__, asked)
            return answered(asked)

        vars(call).update(__signature__=shown, of=answered)
        return cast("Called[P, Asked, Answer]", call)

    return decorated
