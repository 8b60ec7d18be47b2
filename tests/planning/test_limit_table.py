"""The table of limits: what `plan` says of an axis is what its cycle keeps."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

import haptic_fieldbus
from haptic_fieldbus.drive.rig import Limits, Rig
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.numerals import MORE, in_unit, shortened
from haptic_fieldbus.planning.explain import (
    WORDS,
    LimitRow,
    Reaction,
    explain,
    limit_rows,
    plan_json,
    recommended_limits,
)
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import PROFILE, VELOCITY_ONLY, WALL, plan_of, rig_of, scene_of

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


def with_limits(folder: Path, limits: str) -> Plan:
    """The plan of a wall on a rig file of the shipped bench with these lines of limits."""
    bench = haptic_fieldbus.plan("wall").rig
    axis = replace(bench.axis["handle"], limits=Limits(), bus="can0")
    text = rig_text(Rig({"can0": CanSection("socketcan", "can0")}, {"handle": axis}), "A bench")
    path = folder / "rig.toml"
    path.write_text(f"{text}\n[axis.handle.limits]\n{limits}\n", encoding="utf-8")
    return haptic_fieldbus.plan("wall", path, bus="sim")


def test_a_rig_without_limits_is_told_those_of_the_first_runs(tmp_path: Path) -> None:
    """As they can be written into its file; the force is a fifth of 50.27 N, the way is the person's to know."""
    (advice,) = [line for line in explain(with_limits(tmp_path, "")).splitlines() if line.startswith("advice")]
    _, _, told = advice.partition("[axis.handle.limits] ")
    assert told == "effort = 10, speed = 1, position = [lowest, highest], the travel of the handle in m"
    effort, speed, _ = told.split(", ", 2)
    plan = with_limits(tmp_path, f"{effort}\n{speed}\nposition = [-0.1, 0.1]")
    assert "advice" not in explain(plan)
    assert (plan.axes[0].limits.effort, plan.axes[0].limits.speed) == (10.0, 1.0)


def test_of_limits_that_are_known_nothing_is_recommended(tmp_path: Path) -> None:
    advice = recommended_limits(with_limits(tmp_path, "effort = 8.0\nposition = [-0.1, 0.1]").axes[0])
    assert advice == "for the first runs write [axis.handle.limits] speed = 1"


def test_the_shipped_bench_is_given_no_advice() -> None:
    assert "advice" not in explain(haptic_fieldbus.plan("wall"))


def test_a_limit_that_is_not_there_is_not_shown() -> None:
    assert not {"power", "lowest position", "drift"} & set(rows())
    unknown = plan_of(rig=rig_of(WALL, inertia=None))
    assert "acceleration" not in {row.name for row in limit_rows(unknown.axes[0], unknown.period)}


GAPS = "gaps that divide the stiffness limit by"


def test_gaps_may_use_up_nine_tenths_of_the_margin_above_one() -> None:
    (axis,) = plan_of().axes
    assert axis.stability is not None
    assert axis.stability.nominal_margin is not None
    assert rows()[GAPS].value == pytest.approx(1.0 + 0.9 * (axis.stability.nominal_margin - 1.0))
    assert GAPS not in {row.name for row in limit_rows(replace(axis, stability=None), 1e-3)}


def test_a_margin_that_no_gaps_can_use_up_is_not_told() -> None:
    """A fifth missing, in gaps of 30 ms, divides the limit by 1 + 0.2·30 ms over the mean age of the force."""
    most = 1.0 + 0.2 * 0.03 / (0.0005 + plan_of().axes[0].delay.total)
    for stiffness, told in ((600.0, True), (60.0, False)):
        (axis,) = plan_of(scene_of(Wall("handle", stiffness))).axes
        assert (GAPS in {row.name for row in limit_rows(axis, 1e-3)}) is told
        assert (axis.largest_stretch < most) is told


def test_a_scene_above_its_limit_has_no_margin_for_gaps() -> None:
    (axis,) = plan_of(scene_of(Wall("handle", 60000.0))).axes
    assert axis.largest_stretch == math.inf


@pytest.mark.parametrize("profile", [PROFILE, VELOCITY_ONLY])
def test_the_plan_shows_every_limit_in_words_and_in_json(profile: object) -> None:
    plan = plan_of(profile=profile)  # type: ignore[arg-type]
    text, shown = explain(plan), plan_json(plan)["limits"]
    assert isinstance(shown, list)
    expected = list(limit_rows(plan.axes[0], plan.period))
    assert [entry["limit"] for entry in shown if isinstance(entry, dict)] == [row.name for row in expected]
    for row in expected:
        assert f"{WORDS.get(row.name, row.name)} {in_unit(row.value, row.unit)}".rstrip() in text
    assert {row.reaction for row in expected} == set(Reaction)


def test_a_text_that_is_too_long_keeps_whole_clauses_words_and_numbers() -> None:
    assert shortened("wall; spring", 40) == "wall; spring"
    assert shortened("wall at 20 mm; a spring of 600 N/m behind it", 30) == f"wall at 20 mm; {MORE}"
    assert shortened("wall at 20 mm, a spring of 600 N/m behind it", 30) == f"wall at 20 mm, {MORE}"
    assert shortened("stiffness of a wall 600 N/m at 20 mm", 34) == f"stiffness of a wall… {MORE}"
    assert shortened("a" * 60, 30) == f"{'a' * (28 - len(MORE))}… {MORE}"


@pytest.mark.parametrize("share", [0.05, 0.5, 2.0])
def test_limits_for_less_effort_are_those_that_follow_from_it(share: float) -> None:
    (axis,) = plan_of().axes
    step, effort = axis.effort_unit, share * axis.limits.effort
    lowered = axis.limits.lowered(effort, step)
    assert lowered.effort == min(effort, axis.limits.effort)
    assert lowered.slew == pytest.approx(lowered.effort / 0.005)
    assert lowered.unseen == pytest.approx(min(axis.limits.unseen, math.floor(effort / step + 1e-9) * step))
    assert replace(lowered, effort=0.0, slew=0.0, unseen=0.0) == replace(axis.limits, effort=0.0, slew=0.0, unseen=0.0)
