"""The warning of a drive that may turn its shaft when it is enabled for the first time."""

from dataclasses import replace

from haptic_fieldbus.planning.deadlines import enabling_lines, first_enabling
from tests.builders import PROFILE, plan_of

SEARCHING = replace(
    PROFILE,
    drive=replace(PROFILE.drive, commutation_search=True),
    timing=replace(PROFILE.timing, enabling_timeout=4.0, mode_change_timeout=0.5),
)


def test_it_tells_that_the_shaft_may_turn_and_for_how_long() -> None:
    assert "may turn the shaft" in first_enabling(SEARCHING)
    assert "keep hands off and the way free for up to 4.5 s" in first_enabling(SEARCHING)
    assert first_enabling(PROFILE) == ""


def test_a_plan_tells_it_for_each_axis_that_has_one() -> None:
    (axis,) = plan_of(profile=SEARCHING).axes
    (line,) = enabling_lines([axis, replace(axis, profile=PROFILE)])
    assert line.startswith(f"{axis.name}: the first enabling after power-on may turn the shaft")
