"""A mix of old and new elements, for the judgement of a change that fades."""

import numpy as np
import pytest

from haptic_fieldbus.planning.live_changes import mixed
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall


def test_each_element_has_its_share_of_the_force() -> None:
    same = Wall("handle", 50.0, name="floor")
    found = mixed((same, Wall("handle", 100.0)), (same, Wall("handle", 300.0)), 0.25)
    assert [(each.name, each.axis) for each in found] == [("floor", "handle"), ("wall", "handle"), ("wall", "handle")]
    forces = [each.linearised().d[0, 0] for each in found]
    assert forces == pytest.approx([-50.0, -0.75 * 100.0, -0.25 * 300.0])


def test_a_mass_keeps_its_motion_and_gives_its_share() -> None:
    soft, stiff = (SprungMass("handle", stiffness=each, mass=0.5) for each in (40.0, 90.0))
    for each, whole, share in zip(mixed((soft,), (stiff,), 0.6), (soft, stiff), (0.4, 0.6), strict=True):
        assert np.array_equal(each.dynamics.a, whole.dynamics.a)
        assert each.dynamics.c == pytest.approx(share * whole.dynamics.c)
