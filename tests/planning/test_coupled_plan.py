"""Plans of coupled axes: one verdict on both, told in the right units, and how old the forces between them are."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import haptic_fieldbus
from haptic_fieldbus.api.stability_limits import Device, judge_scene
from haptic_fieldbus.errors import PlanError, UnstableSceneError, UsageError
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.explain import explain, limit_text, plan_json
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.report.analysis_texts import stability_lines
from haptic_fieldbus.report.texts import announcement
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal, Workspace
from tests.builders import PROFILE, canopen, plan_of, rig_of, scene_of
from tests.loops import PERIOD
from tests.pairs import PairByHand
from tests.several_buses import rig_on
from tests.velocity_only import velocity_only

AXES = ("left", "right")
SHAFT = Coupling(AXES, stiffness=300.0, damping=0.3, name="shaft")
SCENE = scene_of(SHAFT)
BUSES = {"left": "can0", "right": "can1"}


def mixed(*axes: str, **changes: Any) -> Plan:
    """A rack and its pinion; the scene names the pinion first."""
    spaces = (SceneAxis("pinion", Workspace.ROTARY), SceneAxis("rack", Workspace.LINEAR))
    values = {"stiffness": 100.0, "ratio": 0.02} | changes
    return plan_of(Scene("test", "", spaces, (Coupling(axes, **values),)))


def by_hand(plan: Plan, wall: float = 0.0) -> PairByHand:
    first, second = plan.axes
    assert first.plant is not None
    assert second.plant is not None
    delays = (first.delay.transport / PERIOD, second.delay.transport / PERIOD)
    return PairByHand((first.plant, second.plant), delays, SHAFT.damping, 1.0, wall)


class TestVerdict:
    def test_is_that_of_the_pair_on_its_bench_by_hand(self) -> None:
        plan = plan_of(SCENE)
        limit = plan.stability.stiffness_limit.stable if plan.stability else None
        assert limit is not None
        assert limit == pytest.approx(by_hand(plan).limit_near(limit), rel=1e-6)
        assert [axis.group and axis.group.couplings for axis in plan.axes] == [(SHAFT,), (SHAFT,)]
        assert {axis.stability.verdict for axis in plan.axes if axis.stability} == {Verdict.PASSIVE}

    def test_counts_what_each_axis_has_of_its_own(self) -> None:
        plan = plan_of(scene_of(SHAFT, Wall("left", stiffness=400.0)))
        limit = plan.stability.stiffness_limit.stable if plan.stability else None
        assert limit is not None
        assert limit == pytest.approx(by_hand(plan, 400.0).limit_near(limit), rel=1e-6)

    def test_counts_the_delay_of_each_axis_on_its_own_bus(self) -> None:
        plan = plan_of(SCENE, 500.0, rig=rig_on(SCENE, BUSES, {"can1": 300_000}))
        first, second = (axis.delay.transport for axis in plan.axes)
        assert second - first > 2e-4
        assert [axis.stability.delay_s for axis in plan.axes if axis.stability] == [first, second]

    def test_of_an_axis_beside_the_pair_is_its_own(self) -> None:
        alone = plan_of(scene_of(Wall("foot", 900.0)))
        plan = plan_of(scene_of(SHAFT, Wall("foot", 900.0)), rate=500.0)
        assert plan.axes[2].group is not None
        assert [member.name for member in plan.axes[2].group.members] == ["foot"]
        assert plan.axes[2].stability is not None
        assert plan.axes[2].stability.stiffness == 900.0
        assert alone.axes[0].group is not None
        assert plan.axes[2].group.couplings == alone.axes[0].group.couplings == ()

    def test_is_unknown_for_all_that_hang_together_where_one_bench_is(self) -> None:
        rig = rig_of(SCENE)
        rig = replace(rig, axis=rig.axis | {"right": replace(rig.axis["right"], inertia=None)})
        plan = plan_of(SCENE, rig=rig)
        assert [axis.stability for axis in plan.axes] == [None, None]
        assert (plan.stability, plan.weakest) == (None, None)
        assert [axis.group for axis in plan.axes] == [None, None]
        assert "unknown" in explain(plan)
        check_stable(plan)

    def test_is_told_in_the_units_of_the_couplings_first_axis(self) -> None:
        rack, pinion = mixed("rack", "pinion"), mixed("pinion", "rack", stiffness=100.0 * 0.02**2, ratio=50.0)
        assert rack.weakest is rack.axes[1]
        assert pinion.weakest is pinion.axes[0]
        assert rack.stability is not None
        assert pinion.stability is not None
        assert "N/m" in limit_text(rack.stability)
        assert "N·m/rad" in limit_text(pinion.stability)
        assert "; 100 is inside" in explain(rack)
        limits = (rack.stability.stiffness_limit.stable, pinion.stability.stiffness_limit.stable)
        assert limits[1] == pytest.approx((limits[0] or 0.0) * 0.02**2, rel=1e-6)

    def test_is_the_same_by_the_stability_command(self) -> None:
        judged = judge_scene(Task("virtual_shaft"))
        assert judged.stability == haptic_fieldbus.plan("virtual_shaft").stability
        lines = stability_lines(judged)
        text = dict(lines)
        assert "coupling left, right" in text["scene"]
        assert [line.partition(" ms")[0] for key, line in lines if key == "delay"] == ["left: 0.959", "right: 0.959"]
        less = judged.group.weakened(0.7).stability.stiffness_limit.stable
        assert less is not None
        assert less < (judged.stability.stiffness_limit.stable or 0.0)

    def test_of_a_weaker_axis_beside_the_pair_is_told_as_its_own(self) -> None:
        scene = scene_of(SHAFT, Wall("foot", stiffness=900.0))
        judged = judge_scene(Task(scene, drive="generic_cia402", rate=800.0))
        assert (judged.axis, judged.group.couplings, judged.stability.stiffness) == ("foot", (), 900.0)
        device = judge_scene(Task(scene), Device(mass=0.6, damping=1.6, delay=8e-4))
        assert (device.axis, device.group.couplings) == ("foot", ())

    def test_names_an_estimator_that_is_judged_as_another(self) -> None:
        judged = judge_scene(Task("virtual_shaft", estimator="levant"))
        assert judged.linear_estimator is not None

    def test_gives_both_axes_the_device_of_numbers(self) -> None:
        found = judge_scene(Task(SCENE), Device(mass=0.5, damping=1.2, delay=5e-4))
        pair = PairByHand((found.stability.plant, found.stability.plant), (0.5, 0.5), 0.3)
        limit = found.stability.stiffness_limit.stable
        assert limit is not None
        assert limit == pytest.approx(pair.limit_near(limit), rel=1e-6)
        assert found.axis == "left"


class TestRefusal:
    def test_names_the_limit_and_settings_that_are_stable(self) -> None:
        asked: dict[str, float | str | bool] = {"shaft.stiffness": 3000.0}
        with pytest.raises(
            UnstableSceneError, match="3000 N/m of shaft exceeds the limit of 371 N/m on this bench, at "
        ) as refused:
            haptic_fieldbus.run("virtual_shaft", settings=asked)
        assert refused.value.limit == 371.0
        found = re.findall(r"--set (shaft\.\w+)=([\d.]*\d)", str(refused.value))
        assert [setting for setting, _ in found] == ["shaft.stiffness", "shaft.damping"]
        for setting, value in found:
            told = haptic_fieldbus.stability("virtual_shaft", settings={**asked, setting: float(value)})
            assert told.is_inside

    def test_tells_what_is_unstable_without_a_coupling(self) -> None:
        with pytest.raises(UnstableSceneError, match="wall on left exceeds its limit without its coupling too, "):
            check_stable(plan_of(scene_of(SHAFT, Wall("left", stiffness=3000.0)), profile=canopen("maxon_epos4")))

    def test_says_what_a_part_of_the_limit_is_of(self) -> None:
        half = haptic_fieldbus.stability("virtual_shaft", settings={"shaft.stiffness": "max/2"})
        assert half.margin == pytest.approx(2.0, rel=0.01)
        with pytest.raises(UsageError, match=r"wall.stiffness=max: .* only shaft.stiffness can be set"):
            haptic_fieldbus.stability("virtual_shaft", settings={"wall.stiffness": "max"})

    def test_of_a_drive_that_offers_velocity_only(self, tmp_path: Path) -> None:
        drive = str(velocity_only(tmp_path))
        with pytest.raises(PlanError, match=r"shaft couples axis left, but .* reports velocity only"):
            haptic_fieldbus.plan("virtual_shaft", drive=drive)


class TestAges:
    def test_are_the_delay_of_each_axis_on_one_bus(self) -> None:
        plan = plan_of(SCENE)
        (found,) = plan.coupling_ages
        total = plan.axes[0].delay.total
        assert {on: dict(ages) for on, ages in found.ages.items()} == {
            on: pytest.approx(dict.fromkeys(AXES, total)) for on in AXES
        }
        late = f"{rounded(1e3 * total)} ms after both motions"
        line = f"shaft: force on left {late}, on right {late}"
        assert line in explain(plan)
        assert dict(announcement(plan, verbose=True))["coupling"] == line

    def test_count_that_a_slow_bus_latches_later(self) -> None:
        """The worst SYNC of 55 bits ends 220 − 55 µs later at 250 kbit/s; what it latched is so much younger."""
        profile = replace(PROFILE, timing=replace(PROFILE.timing, control_period=0.0))
        plan = plan_of(SCENE, 500.0, rig=rig_on(SCENE, BUSES, {"can1": 250_000}), profile=profile)
        (found,) = plan.coupling_ages
        left, right = (axis.delay.total for axis in plan.axes)
        assert found.ages["left"] == pytest.approx({"left": left, "right": left - 165e-6})
        assert found.ages["right"] == pytest.approx({"left": right + 165e-6, "right": right})
        late = {"left": (left, left - 165e-6), "right": (right + 165e-6, right)}
        parts = [
            f"on {on} {rounded(1e3 * a)} ms after left and {rounded(1e3 * b)} ms after right"
            for on, (a, b) in late.items()
        ]
        assert str(found) == f"shaft: force {', '.join(parts)}"

    def test_are_part_of_the_json_object(self) -> None:
        plan = haptic_fieldbus.plan("virtual_shaft")
        shown = json.loads(json.dumps(plan_json(plan)))["couplings"]
        assert shown == [{"name": "shaft", "age_s": dict(plan.coupling_ages[0].ages)}]
        assert plan_json(plan_of())["couplings"] == []


def test_velocity_is_estimated_on_both_axes_where_the_coupling_damps() -> None:
    damped, plain = plan_of(SCENE), plan_of(scene_of(replace(SHAFT, damping=0.0)))
    assert [axis.estimator for axis in damped.axes] == ["backward-difference"] * 2
    assert [axis.estimator for axis in plain.axes] == [None, None]
    assert all(Signal.VELOCITY in axis.needs for axis in damped.axes)
    assert "haptic_fieldbus.scenes.coupling" in plain.modules


def test_a_coupling_without_stiffness_beside_others_is_none_to_vary() -> None:
    plan = plan_of(scene_of(SHAFT, Constant("left", 1.0)))
    assert plan.stability is not None
    assert plan.stability.stiffness == 300.0


@pytest.mark.thorough("judges a grid of couplings")
def test_the_picture_of_the_region_is_drawn_of_a_pair_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from haptic_fieldbus.report import analysis_plots
    from haptic_fieldbus.report.drawing import save

    monkeypatch.setattr(analysis_plots, "POINTS", 3)
    save(analysis_plots.draw_region(judge_scene(Task("virtual_shaft"))), tmp_path / "region.png")
    assert (tmp_path / "region.png").stat().st_size > 10_000
