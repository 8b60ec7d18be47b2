"""Places of one element on any travel, also far away from where its valleys begin.

The oracle is brute force: the steepest slope of the force on a fine grid of the travel, where the motor can hold it.
"""

import math
from typing import Any, cast

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.stiffness_map import Places
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import Interval
from haptic_fieldbus.scenes.pendulum import Pendulum
from haptic_fieldbus.scenes.texture import Texture
from tests.margins.drawn import PERIOD, element

NAMES = ("wall", "end_stop", "magnet", "detents", "counted", "spring", "texture", "pendulum")
STEP = 1e-7


def drawn(name: str, random: np.random.Generator) -> Any:
    if name == "counted":
        return Detents(
            "a", 1.0, 10.0 ** random.uniform(-2.5, -1.5), random.uniform(-1.0, 1.0), int(random.integers(1, 300))
        )
    if name == "pendulum":
        return Pendulum("a", 100.0, random.uniform(-30.0, 30.0))
    return element(name, 10.0 ** random.uniform(1.0, 3.0), 10.0, random)


def drawn_travel(one: Any, random: np.random.Generator) -> Interval:
    """Return a travel that is as long as a part of a pitch or as many, near the element or hundreds of pitches off."""
    pitch = 2.0 * math.pi if isinstance(one, Pendulum) else getattr(one, "pitch", 0.01)
    middle = getattr(one, "position", 0.0) + pitch * random.uniform(-1.0, 1.0) * 10.0 ** random.uniform(-1.0, 2.5)
    half = pitch * 10.0 ** random.uniform(-1.0, 1.5)
    return middle - half, middle + half


def steepest(one: Any, travel: Interval, effort: float) -> float:
    """Return the largest −dF/dx at rest where the motor can hold the handle; −∞ where it can nowhere."""
    x = np.linspace(*travel, 5_001)
    others = [0.0] * (len(one.needs) - 1)
    force = np.array([[one.force(float(at + way), *others) for at in x] for way in (-STEP, 0.0, STEP)])
    slope = (force[0] - force[2]) / (2.0 * STEP)
    return float(slope[np.abs(force[1]) <= effort].max(initial=-math.inf))


@pytest.mark.thorough("8 elements on 40 travels each", quick=("detents", "counted", "pendulum"))
@pytest.mark.parametrize("name", NAMES)
def test_the_stiffest_place_of_a_travel_is_found_wherever_it_is(name: str) -> None:
    random = np.random.default_rng(31)
    for number in range(40):
        one, effort = drawn(name, random), 10.0 ** random.uniform(-1.0, 2.0)
        travel = drawn_travel(one, random)
        member = Member("a", Plant(0.3, 1.0), 0.0, (one,), None, "backward-difference", effort=effort, travel=travel)
        found = float(cast("Places", Group((member,), (), PERIOD).environment()).stiffness.max())
        brute = steepest(one, travel, effort)
        assert found >= brute - 0.01 * abs(brute) - 1e-3, (number, one, travel, effort)


@pytest.mark.parametrize("pitch", [1e-3, 0.01, 1.0])
def test_a_texture_far_from_zero_is_as_stiff_as_one_at_zero(pitch: float) -> None:
    one = Texture("a", 1.0, pitch)
    for middle in (0.0, 0.1, 1e3, -1e5):
        marks = [place for place in one.places(middle - pitch, middle + pitch, 10.0) if abs(place - middle) <= pitch]
        assert max(one.local(place, place).stiffness[1] for place in marks) == pytest.approx(one.stiffness, rel=1e-3)
