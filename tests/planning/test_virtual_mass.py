"""The mass that elements add to the handle, against what their equations say."""

import pytest

from haptic_fieldbus.planning.sign_probe import BLOCK, FASTEST_HAND, virtual_mass
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.inertia import Inertia
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall


def test_a_filtered_inertia_is_its_mass_as_far_as_the_filter_lets_it_through() -> None:
    mass, time_constant = 1.2, 0.05
    inertia = Inertia("handle", mass=mass, time_constant=time_constant)
    assert virtual_mass([inertia]) == pytest.approx(mass / (1.0 + (FASTEST_HAND * time_constant) ** 2))


def test_springs_and_dampers_add_none() -> None:
    assert virtual_mass([Wall("handle", 1000.0), Spring("handle", 500.0), Damper("handle", 3.0)]) == 0.0


def test_a_mass_on_a_stiff_spring_is_felt_whole_or_more_below_its_resonance_only() -> None:
    mass = 0.5
    stiff, soft = (SprungMass("handle", mass * resonance**2, mass) for resonance in (10.0 * BLOCK, 0.5 * FASTEST_HAND))
    assert virtual_mass([stiff]) == pytest.approx(mass / (1.0 - 0.1**2), rel=1e-6)
    assert virtual_mass([soft]) == 0.0


def test_a_spring_takes_nothing_away_from_a_mass_beside_it() -> None:
    inertia = Inertia("handle", mass=1.0, time_constant=0.01)
    assert virtual_mass([inertia, Wall("handle", 1e5)]) == virtual_mass([inertia])
