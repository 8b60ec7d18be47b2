"""A minute of every library scene: nothing that watches over torque, links and motion may end it without a reason."""

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names

MINUTE = 60.0
TAPPED = [name for name in scene_names() if len(load_scene(name).axes) == 1]

pytestmark = pytest.mark.thorough("a minute of virtual time each")


@pytest.mark.parametrize("scene", scene_names())
def test_a_scene_with_its_own_hand(scene: str) -> None:
    result = run(scene, duration=MINUTE)
    assert (result.trips, result.warnings) == ((), ())


@pytest.mark.parametrize("scene", TAPPED)
def test_a_scene_that_is_tapped(scene: str) -> None:
    assert run(scene, duration=MINUTE, hand="tap").trips == ()


@pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
@pytest.mark.parametrize("drive", ["maxon_epos4", "generic_cia402"])
@pytest.mark.parametrize("hand", ["tap", "push", "sine"])
def test_a_wall_of_half_the_stable_stiffness(rate: float, drive: str, hand: str) -> None:
    settings = {"wall.stiffness": "max/2"}
    assert run("wall", drive=drive, rate=rate, hand=hand, duration=MINUTE, settings=settings).trips == ()
