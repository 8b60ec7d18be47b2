"""Functions of one value: called with its arguments, typed and shown as such."""

import inspect
from dataclasses import KW_ONLY, dataclass, fields

import pytest

import haptic_fieldbus
from haptic_fieldbus.api import Trial
from haptic_fieldbus.api.arguments import KINDS, arguments_of
from haptic_fieldbus.api.estimation import SignalRequest
from haptic_fieldbus.api.open_loop import OpenLoop
from haptic_fieldbus.api.stability_limits import Inquiry
from haptic_fieldbus.planning.request import Rendering, Task

VALUES = {"plan": Task, "run": Trial, "stability": Inquiry, "response": OpenLoop}
"""What each function of the Python API takes as one value."""


@dataclass(frozen=True)
class Sum:
    """Two numbers."""

    first: int
    _: KW_ONLY
    second: int = 2


@arguments_of(Sum)
def add(asked: Sum) -> int:
    """The sum of both."""
    return asked.first + asked.second


def test_a_value_and_its_arguments_mean_the_same() -> None:
    assert add(1) == add(1, second=2) == add.of(Sum(1)) == 3


def test_the_arguments_are_what_help_shows() -> None:
    assert str(inspect.signature(add)) == "(first: int, *, second: int = 2) -> int"
    assert inspect.getdoc(add) == "The sum of both."


@pytest.mark.parametrize(
    ("positional", "named", "sentence"),
    [
        ((1,), {"third": 3}, r"^add\(\) got an unexpected keyword argument 'third'$"),
        ((1, 2), {}, r"^add\(\) too many positional arguments$"),
        ((), {}, r"^add\(\) missing a required argument: 'first'$"),
    ],
)
def test_arguments_that_there_are_not_are_told_of_the_function(
    positional: tuple[int, ...], named: dict[str, int], sentence: str
) -> None:
    with pytest.raises(TypeError, match=sentence):
        add(*positional, **named)


@pytest.mark.parametrize("name", VALUES)
def test_the_python_api_takes_the_fields_of_its_value(name: str) -> None:
    shown = inspect.signature(getattr(haptic_fieldbus, name)).parameters
    assert set(shown) == {field.name for field in fields(VALUES[name])}
    assert [each for each, parameter in shown.items() if parameter.kind is not parameter.KEYWORD_ONLY] == [
        "scene",
        *(["rig"] if issubclass(VALUES[name], Task) else []),
    ]
    assert issubclass(VALUES[name], Rendering)


@pytest.mark.parametrize("asked", [*VALUES.values(), SignalRequest], ids=lambda asked: asked.__name__)
def test_every_argument_has_a_kind(asked: type) -> None:
    assert {field.name for field in fields(asked)} <= set(KINDS)


def test_a_run_takes_none_as_no_faults_and_no_changes() -> None:
    """As for `record`, `hand` and `settings`: a script passes on what its user did not give."""
    assert haptic_fieldbus.run("wall", duration=0.002, hand="none", faults=None, changes=None).cycles == 2
