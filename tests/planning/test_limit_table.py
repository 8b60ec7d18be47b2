"""The table of limits: what `plan` says of an axis is what its cycle keeps."""

import math

import pytest

from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.numerals import in_unit
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.limit_table import LimitRow, Reaction, limit_rows
from haptic_fieldbus.planning.plan_json import plan_json
from tests.builders import PROFILE, VELOCITY_ONLY, WALL, plan_of, rig_of

RATED = 0.4 / (0.05 / (2 * math.pi))
"""[N]: 0.4 N·m at 50 mm a turn."""
MASS = 4.0e-5 / (0.05 / (2 * math.pi)) ** 2


def rows(rate: float = 1000.0, **limits: object) -> dict[str, LimitRow]:
    plan = plan_of(rate=rate, rig=rig_of(WALL, limits=Limits(**limits)))  # type: ignore[arg-type]
    return {row.name: row for row in limit_rows(plan.axes[0], plan.period)}


def test_limits_that_nobody_set_follow_from_motor_hand_and_inertia() -> None:
    found = rows()
    assert found["force"].value == pytest.approx(RATED)
    assert found["force at the start"].value == pytest.approx(RATED / 4)
    assert found["force at standstill"].value == pytest.approx(RATED / 20)
    assert found["slew"].value == pytest.approx(RATED / 0.005)
    assert found["acceleration"].value == pytest.approx((RATED + 500.0) / MASS)
    assert found["jump in a period"].value == pytest.approx((RATED + 500.0) / MASS * 1e-6 + 2 * 0.05 / 4096)
    assert found["age of feedback"].value == pytest.approx(0.03)


def test_at_a_low_rate_the_age_follows_the_guard_of_five_periods() -> None:
    assert rows(rate=50.0)["age of feedback"].value == pytest.approx(0.6 * 0.1)


def test_the_rig_may_set_each_limit_of_motion() -> None:
    found = rows(effort=8.0, speed=1.5, acceleration=100.0, power=3.0, stall=10.0, position=(-0.1, 0.2))
    assert (found["force"].value, found["speed"].value, found["power"].value) == (8.0, 1.5, 3.0)
    assert (found["acceleration"].value, found["force at standstill"].time) == (100.0, 10.0)
    assert (found["lowest position"].value, found["highest position"].value) == (-0.1, 0.2)


def test_a_limit_that_is_not_there_is_not_shown() -> None:
    assert not {"power", "lowest position", "drift"} & set(rows())
    unknown = plan_of(rig=rig_of(WALL, inertia=None))
    assert "acceleration" not in {row.name for row in limit_rows(unknown.axes[0], unknown.period)}


@pytest.mark.parametrize("profile", [PROFILE, VELOCITY_ONLY])
def test_the_plan_shows_every_limit_in_words_and_in_json(profile: object) -> None:
    plan = plan_of(profile=profile)  # type: ignore[arg-type]
    text, shown = explain(plan), plan_json(plan)["limits"]
    assert isinstance(shown, list)
    expected = list(limit_rows(plan.axes[0], plan.period))
    assert [entry["limit"] for entry in shown if isinstance(entry, dict)] == [row.name for row in expected]
    for row in expected:
        assert f"{row.name} {in_unit(row.value, row.unit)}" in text
    assert {row.reaction for row in expected} == set(Reaction)
