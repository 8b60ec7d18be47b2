"""The limits of a scene: on its bench as the plan has them, on a device as the formulas have them."""

import math

import pytest

import haptic_fieldbus
from haptic_fieldbus.api import plan
from haptic_fieldbus.api.stability_limits import Device, judge_scene
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.margins import Plant, Verdict, stiffness_limit
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.loops import wall


@pytest.mark.thorough("every scene of the library", quick=("wall", "sprung_mass", "virtual_shaft"))
@pytest.mark.parametrize("scene", scene_names())
def test_a_bench_is_judged_as_its_plan_judges_it(scene: str) -> None:
    assert haptic_fieldbus.stability(scene, rate=1000.0) == plan(scene).stability


def test_a_device_is_exactly_its_numbers() -> None:
    found = haptic_fieldbus.stability("wall", mass=0.5, damping=1.2, delay=0.4e-3)
    assert found.plant == Plant(mass=0.5, damping=1.2)
    assert (found.period_s, found.delay_s) == (1e-3, 0.4e-3)
    limit = found.stiffness_limit
    assert limit.stable == pytest.approx(stiffness_limit(found.plant, 1e-3, 0.4e-3, wall))
    centre, rest = 0.9e-3, 0.4e-3 * 0.6e-3
    assert limit.passive == pytest.approx(2 * 1.2 / (centre + math.sqrt(centre**2 + rest)), rel=1e-9)
    assert limit.quantisation is None


@pytest.mark.parametrize(("coulomb", "verdict"), [(0.0, Verdict.LIMIT_CYCLE), (0.1, Verdict.PASSIVE)])
def test_an_encoder_asks_friction_of_a_device(coulomb: float, verdict: Verdict) -> None:
    found = haptic_fieldbus.stability("wall", mass=0.5, damping=1.2, coulomb=coulomb, resolution=1e-5)
    assert found.stiffness_limit.quantisation == 2 * coulomb / 1e-5
    assert found.verdict is verdict


def test_a_setting_may_be_a_part_of_the_limit_of_a_device() -> None:
    found = haptic_fieldbus.stability("wall", mass=0.5, damping=1.2, settings={"wall.stiffness": "max/2"})
    assert found.margin == pytest.approx(2.0)


def test_rates_that_no_bus_carries_are_no_matter_to_a_device() -> None:
    with pytest.raises(PlanError):
        haptic_fieldbus.stability("wall", rate=20_000.0)
    assert haptic_fieldbus.stability("wall", mass=0.5, rate=20_000.0).period_s == 5e-5


def test_of_several_axes_the_one_with_the_smallest_margin_is_told() -> None:
    walls = (Wall("x", 400.0, name="soft"), Wall("y", 900.0, name="hard"))
    scene = Scene("two", "", (SceneAxis("x", Workspace.LINEAR), SceneAxis("y", Workspace.LINEAR)), walls)
    found = judge_scene(Task(scene), Device(mass=0.5, damping=1.2))
    assert (found.axis, found.stability.stiffness) == ("y", 900.0)


def test_less_friction_means_less_stiffness() -> None:
    found = judge_scene(Task("wall"))
    less, all_of_it = found.group.weakened(0.7).stability.stiffness_limit, found.stability.stiffness_limit
    assert less.quantisation == pytest.approx(0.7 * all_of_it.quantisation)  # type: ignore[operator]
    assert less.stable == pytest.approx(0.7 * all_of_it.stable, rel=0.02)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("estimator", "stands_for_it"), [(None, None), ("low-pass", None), ("foaw-end-fit", "moving-average:window=16")]
)
def test_an_estimator_that_is_not_linear_is_replaced_and_named(
    estimator: str | None, stands_for_it: str | None
) -> None:
    found = judge_scene(Task("damped_wall", estimator=estimator))
    assert found.linear_estimator == stands_for_it
    assert judge_scene(Task("wall", estimator=estimator)).linear_estimator is None


@pytest.mark.parametrize(
    ("device", "sentence"),
    [
        (Device(delay=0.0), "mass 0: expected a number from 1e-12 to 1e9"),
        (
            Device(damping=1.5),
            "mass 0: expected a number from 1e-12 to 1e9; for a mass towards 0 the limit of a spring goes to 3000",
        ),
        (
            Device(mass=-1.0, damping=-2.0),
            "mass -1: expected a number from 1e-12 to 1e9\ndamping -2: expected a number from 0 up, at most 1e9",
        ),
        (Device(mass=math.nan), "mass nan: expected a number from 1e-12 to 1e9"),
        (Device(mass=1.0, delay=math.inf), "delay inf: expected a number from 0 up, at most 100"),
    ],
)
def test_a_device_that_cannot_be_is_refused_with_the_limit(device: Device, sentence: str) -> None:
    with pytest.raises(UsageError) as refused:
        judge_scene(Task("wall"), device)
    assert str(refused.value) == sentence


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(UsageError, match="rate"):
        haptic_fieldbus.stability("wall", mass=1.0, rate=rate)


def test_methods_and_estimators_that_do_not_exist_are_refused() -> None:
    with pytest.raises(UsageError, match="no method"):
        haptic_fieldbus.stability("wall", mass=1.0, method="magic")
