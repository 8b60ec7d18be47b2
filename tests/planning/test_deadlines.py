"""Costs of one of several drives to the others: the times until torque is zero when its feedback is lost."""

import math

import pytest

from haptic_fieldbus import plan
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import scene_of

ALONE = scene_of(Wall("left", 20.0), Wall("right", 20.0))
TIED = scene_of(Coupling(("left", "right"), 20.0))
LAG = -math.log(0.01) / (2.0 * math.pi * 1000.0)
"""[s] until the torque loop of 1000 Hz is at a hundredth."""


@pytest.mark.parametrize(
    ("scene", "bus", "lost", "told"),
    [
        # A period is held, ten fade, one passes until the answer, one more until the set-point is obeyed.
        (TIED, "sim", 0.001 * (1 + 10 + 1) + 0.0004, "then faded out"),
        # 0.6 of a guard of 50 ms, a period until it is noticed, and as above.
        (ALONE, "sim", 0.030 + 0.002 + 0.0004, "axes without a coupling to it: trip when feedback is older than 30 ms"),
        # A guard of 50 ms after the period in which it was fed.
        (TIED, "sim-modbus-tcp", 0.050 + 0.001, "behind a gateway: drive watchdog 50 ms"),
        # 70 Hz, the guard is five periods in whole milliseconds; function 23 is a period late.
        (
            TIED,
            "sim-modbus-rtu@115200",
            0.6 * 0.072 + 3.0 / 70.0,
            "wait for the silent one: trip when feedback is older",
        ),
        (ALONE, "sim-modbus-rtu@115200", 0.6 * 0.072 + 3.0 / 70.0, "axes without a coupling to it"),
    ],
)
def test_feedback_that_one_of_two_drives_loses_ends_the_torque_of_both(
    scene: Scene, bus: str, lost: float, told: str
) -> None:
    compiled = plan(scene, bus=bus)
    stated = {each.cause: each for each in compiled.deadlines}
    assert stated[EndCause.FEEDBACK].seconds == pytest.approx(lost + LAG, abs=5e-4)
    assert told in stated[EndCause.FEEDBACK].how
    assert stated[EndCause.DISCONNECTED].seconds >= stated[EndCause.FEEDBACK].seconds
