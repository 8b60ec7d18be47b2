"""Gravity: the weight, and that it takes back what it gives."""

import math

import numpy as np
import pytest
import scipy.constants
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.gravity import Gravity


def test_a_kilogram_pulls_down_with_standard_gravity() -> None:
    assert Gravity("handle", mass=1.0).force() == -scipy.constants.g


@pytest.mark.parametrize(("share", "newtons"), [(math.sin(math.radians(30.0)), -0.5), (-1.0, 1.0), (0.0, 0.0)])
def test_on_a_slope_it_is_a_share_of_it_and_negative_where_down_is_positive(share: float, newtons: float) -> None:
    assert Gravity("handle", mass=1.0 / scipy.constants.g, share=share).force() == pytest.approx(newtons, abs=1e-15)


def test_held_from_sample_to_sample_a_closed_way_costs_nothing() -> None:
    law, way = Gravity("handle", mass=0.3).force, np.sin(np.linspace(0.0, 20.0 * math.pi, 777))
    assert sum(law() * move for move in np.diff(way)) == pytest.approx(0.0, abs=1e-12)


def test_it_needs_no_signal_and_no_motion_changes_it() -> None:
    assert Gravity("handle", mass=0.3).needs == ()
    assert not Gravity("handle", mass=0.3).linearised().d.any()


@pytest.mark.parametrize("wrong", [{"mass": 0.0}, {"mass": -1.0}, {"share": math.inf}, {"position": 0.0}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Gravity).validate_python({"axis": "handle", "mass": 0.3, **wrong})
