"""A hand that leans on the wall for longer than a count may stand still under force."""

from dataclasses import replace

import pytest

import haptic_fieldbus
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import SafetyTripError


def standing_still_for(seconds: float) -> Rig:
    rig = haptic_fieldbus.plan("wall").rig
    axes = {name: replace(axis, limits=replace(axis.limits, stall=seconds)) for name, axis in rig.axis.items()}
    return replace(rig, axis=axes)


@pytest.mark.thorough("runs three seconds of a loop, twice")
def test_a_hand_that_goes_on_pushing_gets_further_in_and_is_told_why() -> None:
    """6 N lean on it, and 5 % of rated torque, 2.51 N, are left; the hand then leaves the bench."""
    with pytest.raises(SafetyTripError, match=r"position 0\.1\d* m, the limit is 0\.1 m, 2\.\d+ s after") as ended:
        haptic_fieldbus.run("wall", standing_still_for(1.0), duration=4.0, hand="push")
    result = ended.value.result
    assert isinstance(result, Result)
    (told,) = result.warnings
    assert told.startswith("axis handle: the position stood still under force for 1 s, once, as when a hand leans")
    assert "at most 2.51 N was given" in told
    assert told.endswith("axis.handle.limits.stall in the rig")
    assert haptic_fieldbus.run("wall", standing_still_for(5.0), duration=4.0, hand="push").trips == ()
