"""Arguments of the Python API: written out, gathered in values, each of a known kind."""

import inspect
from dataclasses import fields

import pytest

import haptic_fieldbus
from haptic_fieldbus.api import Trial
from haptic_fieldbus.api.arguments import KINDS
from haptic_fieldbus.api.estimation import SignalRequest
from haptic_fieldbus.api.open_loop import OpenLoop
from haptic_fieldbus.api.stability_limits import Device
from haptic_fieldbus.planning.request import Task

VALUES = {"plan": (Task,), "run": (Task, Trial), "stability": (Task, Device), "response": (Task, OpenLoop)}
"""Classes in which the arguments of each function of the Python API are gathered."""
ON_A_BENCH = {"rig", "drive", "bus", "node", "axes", "zero", "profiles"}
"""Arguments that the open loop, which has no bench, does without."""


@pytest.mark.parametrize("name", VALUES)
def test_the_python_api_takes_the_fields_of_its_values(name: str) -> None:
    given = inspect.signature(getattr(haptic_fieldbus, name)).parameters
    told = {field.name: field.default for kind in VALUES[name] for field in fields(kind)}
    left_out = ON_A_BENCH if name == "response" else set()
    assert set(given) == set(told) - left_out
    by_place = [each for each, parameter in given.items() if parameter.kind is not parameter.KEYWORD_ONLY]
    assert by_place == [each for each in ("scene", "rig") if each in given]
    assert {each: parameter.default for each, parameter in given.items() if each != "scene"} == {
        each: told[each] for each in given if each != "scene"
    }


@pytest.mark.parametrize("name", VALUES)
def test_signatures_are_written_and_not_made(name: str) -> None:
    function = getattr(haptic_fieldbus, name)
    assert not hasattr(function, "__wrapped__")
    assert not hasattr(function, "__signature__")


@pytest.mark.parametrize("asked", [Task, Trial, Device, OpenLoop, SignalRequest], ids=lambda asked: asked.__name__)
def test_every_argument_has_a_kind(asked: type) -> None:
    assert {field.name for field in fields(asked)} <= set(KINDS)


@pytest.mark.parametrize("name", VALUES)
def test_all_arguments_of_a_wrong_kind_are_told_at_once(name: str) -> None:
    with pytest.raises(TypeError) as refused:
        getattr(haptic_fieldbus, name)(3, rate="fast", method=1)
    assert [line.partition(":")[0] for line in str(refused.value).splitlines()] == [
        f"{name}() {argument}" for argument in ("scene", "rate", "method")
    ]


def test_a_run_takes_none_as_no_faults_and_no_changes() -> None:
    """As for `record`, `hand` and `settings`: a script passes on what its user did not give."""
    assert haptic_fieldbus.run("wall", duration=0.002, hand="none", faults=None, changes=None).cycles == 2
