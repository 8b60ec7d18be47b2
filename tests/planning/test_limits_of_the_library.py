"""Library scenes on the shipped bench of every shipped drive: inside their limit where they are made for it."""

from functools import cache

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names

DRIVES = [name for name in profile_names() if load_profile(name).drive.usable]


@cache
def planned(scene: str, drive: str) -> Plan | None:
    """The plan on the simulated bench; None where this kind of drive cannot render the scene."""
    profile = load_profile(drive)
    try:
        return plan(scene, drive=drive, bus=protocol_named(profile.drive.protocol).simulated_bus(profile))
    except PlanError:
        return None


def is_made_for(scene: str, drive: str, rate: float) -> bool:
    wanted = load_scene(scene).made_for
    return wanted is None or (wanted.drive in (None, drive) and rate >= (wanted.rate or 0.0))


def is_inside(found: Plan) -> bool:
    return all(axis.stability is not None and axis.stability.is_inside for axis in found.axes)


@pytest.mark.thorough("judges every scene with every drive", quick=("maxon_epos4",))
@pytest.mark.parametrize("drive", DRIVES)
def test_every_scene_is_inside_its_limit_on_the_drives_that_it_is_made_for(drive: str) -> None:
    found = {scene: each for scene in scene_names() if (each := planned(scene, drive)) is not None}
    assert len(found) >= 0.9 * len(scene_names())
    made_for = {scene: each for scene, each in found.items() if is_made_for(scene, drive, each.rate)}
    assert [scene for scene, each in made_for.items() if not is_inside(each)] == []


@pytest.mark.thorough("judges scenes with every drive")
@pytest.mark.parametrize("scene", [name for name in scene_names() if load_scene(name).made_for is not None])
def test_a_scene_that_is_made_for_some_drives_is_outside_of_its_limit_on_another(scene: str) -> None:
    found = {drive: each for drive in DRIVES if (each := planned(scene, drive)) is not None}
    assert any(is_made_for(scene, drive, each.rate) for drive, each in found.items())
    assert any(not is_made_for(scene, drive, each.rate) and not is_inside(each) for drive, each in found.items())
