"""A minute of every library scene: nothing that watches over torque, links and motion may end it without a reason."""

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.builders import endless_rig
from tests.system.sign_bench import unseen_rig

MINUTE = 60.0

pytestmark = pytest.mark.thorough("a minute of virtual time each")


@pytest.mark.parametrize("hand", [None, "tap"], ids=["own hand", "tap"])
@pytest.mark.parametrize("scene", scene_names())
def test_a_scene_of_the_library(scene: str, hand: str | None) -> None:
    """On benches whose sign is looked for first; accounts of energy stay below a tenth of their limit."""
    result = run(scene, rig=unseen_rig(Task(scene)), hand=hand, duration=MINUTE)
    assert (result.cycles, result.trips) == (60_000, ())
    assert all(ledger.largest < 0.1 * ledger.limit for ledger in result.passivity)
    assert not [warning for warning in result.warnings if "against the torque" in warning]


@pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
@pytest.mark.parametrize("drive", ["maxon_epos4", "generic_cia402"])
@pytest.mark.parametrize("hand", ["tap", "push", "sine"])
def test_a_wall_of_half_the_stable_stiffness(rate: float, drive: str, hand: str) -> None:
    rig = endless_rig("wall", drive)
    assert run("wall", rig, rate=rate, hand=hand, duration=MINUTE, settings={"wall.stiffness": "max/2"}).trips == ()
