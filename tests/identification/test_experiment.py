"""The experiments: how far, how fast and how strongly they move a bench, and how they end on anything odd."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.identification.experiment import Bounds, Experiment, GuidedMotion, Probe
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.sim.mechanics.motion import SPEED, Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from tests.identification.benches import Bench, conducted, drawn_bench, plant_of_bench

MODEL = ShaftModel(4e-5, 1e-4, 2e-3, 0.0008, 0.0002)
BENCH = Bench(MODEL, 4096, 1000.0, 0.1, 60.0, 8.0)


def motion(bench: Bench = BENCH, bounds: Bounds | None = None, **told: float) -> GuidedMotion:
    """The motion with the values of the bench, but for those that are told."""
    model = replace(bench.model, **told)  # type: ignore[arg-type]
    late = model.delay + model.lag
    return GuidedMotion(bounds or bench.bounds, model.inertia, model.coulomb, model.load, late, model.damping)


def test_the_probe_goes_through_its_stages_and_ends_at_rest() -> None:
    law, plant = Probe(BENCH.bounds), plant_of_bench(BENCH)
    course = conducted(law, BENCH, plant)
    assert law.failure == ""
    assert list(dict.fromkeys(course.stages)) == ["rest", "breakaway", "pulse"]
    assert abs(plant.velocity) < 0.5
    # The effort grows on until the motion is seen.
    assert 2e-3 <= law.friction <= 5e-3
    rest = course.stages.count("rest")
    assert set(course.record.torques[: rest - 1]) == {0.0}


def test_the_breakaway_tells_a_constant_load() -> None:
    law = Probe(BENCH.bounds)
    conducted(law, BENCH, plant_of_bench(BENCH), load=1e-3)
    assert law.failure == ""
    # A load of 1 mN·m helps forward, and friction of 2 mN·m is against both ways.
    for way, torque in (("forward", 1e-3), ("backward", 3e-3)):
        low, high = law.breakaway[way]
        assert low <= torque <= high < torque + 3e-3


def test_an_encoder_that_stops_counting_ends_the_pulses_before_they_are_strong() -> None:
    """A handle that nobody sees would be pushed on and on, to the end of its way."""
    law, plant = Probe(BENCH.bounds, ["rest"]), plant_of_bench(BENCH)
    whole = conducted(law, BENCH, plant)
    frozen, efforts = Probe(BENCH.bounds, ["rest"]), list[float]()
    begin = whole.stages.index("pulse")
    for place in [*whole.record.positions[:begin], *[whole.record.positions[begin]] * 20_000]:
        if frozen.done:
            break
        efforts.append(abs(frozen.effort(place)))
    assert frozen.failure.startswith("the encoder did not move under a push much above")
    assert max(efforts[begin:]) < 0.2 * BENCH.bounds.effort


@pytest.mark.parametrize("seed", range(30))
def test_the_breakaway_covers_the_friction_of_a_drawn_bench(seed: int) -> None:
    bench = drawn_bench(seed)
    law = Probe(bench.bounds, ["rest", "dynamics"])
    conducted(law, bench, plant_of_bench(bench))
    assert law.failure == ""
    for low, high in law.breakaway.values():
        assert low <= bench.model.coulomb <= high


@pytest.mark.parametrize(
    ("skipped", "stages"),
    [
        (["rest"], ["breakaway", "pulse"]),
        (["friction"], ["rest", "pulse"]),
        (["dynamics"], ["rest", "breakaway"]),
        (["rest", "friction"], ["pulse"]),
    ],
)
def test_a_part_is_left_out(skipped: list[str], stages: list[str]) -> None:
    law = Probe(BENCH.bounds, skipped)
    course = conducted(law, BENCH, plant_of_bench(BENCH))
    assert law.failure == ""
    # The stage that a law begins with is that of the sample before its first one.
    assert [each for each in dict.fromkeys(course.stages) if each != "rest" or "rest" not in skipped] == stages
    assert bool(law.breakaway) == ("friction" not in skipped)


@pytest.mark.parametrize("friction", [0.5e-3, 2e-3, 20e-3])
def test_pulses_find_an_effort_above_a_friction_that_was_not_looked_for(friction: float) -> None:
    bench = replace(BENCH, model=replace(MODEL, coulomb=friction))
    law = Probe(bench.bounds, ["friction"])
    course = conducted(law, bench, plant_of_bench(bench))
    assert law.failure == ""
    assert max(map(abs, course.record.torques)) > friction
    assert max(map(abs, course.speeds)) < bench.bounds.speed


def test_the_motion_stays_in_its_bounds_and_ends_slowly() -> None:
    law, plant = motion(), plant_of_bench(BENCH)
    course = conducted(law, BENCH, plant)
    assert law.failure == ""
    assert list(dict.fromkeys(course.stages)) == ["middle", "motion", "check", "stop"]
    assert 1.5 < max(map(abs, course.angles)) < 4.0
    assert max(map(abs, course.speeds)) < 60.0
    assert max(map(abs, course.record.torques)) <= 0.1004
    assert abs(plant.velocity) < 2.0


@pytest.mark.parametrize("damping", [1e-4, 1e-3, 3e-3, 1e-2])
def test_a_damped_handle_is_moved_through_the_planned_part_of_its_travel(damping: float) -> None:
    """Without effort against it, the largest damping left 5 % of the travel; at 15 rad/s it would take 1.5 times the
    bound of the effort, so the motion is slower there."""
    bench = replace(BENCH, model=replace(MODEL, damping=damping))
    law = motion(bench)
    course = conducted(law, bench, plant_of_bench(bench))
    assert law.failure == ""
    moved = course.angles[course.stages.index("motion") : course.stages.index("check")]
    assert 0.5 * bench.travel < max(moved) - min(moved) < 0.75 * bench.travel
    assert max(map(abs, course.angles)) < 0.45 * bench.travel
    assert max(map(abs, course.speeds)) < min(60.0, 0.1 / damping)
    torques = np.abs(course.record.torques)
    assert torques.max() <= 0.1004
    assert np.mean(torques > 0.099) < 0.02, "the plan leaves room for the oscillations"


def test_an_acceleration_limit_is_kept_away_from() -> None:
    calm = motion(bounds=replace(BENCH.bounds, acceleration=500.0))
    course = conducted(calm, BENCH, plant_of_bench(BENCH))
    assert calm.failure == ""
    steps = [abs(after - before) / 1e-3 for before, after in zip(course.speeds, course.speeds[1:], strict=False)]
    assert max(steps) < 500.0


# What ends an experiment.


def test_a_load_that_falls_is_refused_before_any_effort() -> None:
    law = Probe(BENCH.bounds)
    course = conducted(law, BENCH, plant_of_bench(BENCH), load=6e-3)
    assert "moves while no effort acts" in law.failure
    assert set(course.record.torques) == {0.0}


def test_a_handle_that_is_held_fast_is_told() -> None:
    law = Probe(BENCH.bounds)
    course = conducted(law, replace(BENCH, model=replace(MODEL, coulomb=0.5)), Plant(Shaft(4e-5, 0.0, 0.5, 2e-4), None))
    assert "nothing moved up to the announced effort" in law.failure
    assert course.record.torques[-1] == 0.0
    assert max(map(abs, course.record.torques)) <= 0.1004


def test_a_motor_that_turns_the_other_way_ends_the_probe_within_its_travel() -> None:
    law = Probe(replace(BENCH.bounds, low=-0.5, high=0.5))
    plant, places = plant_of_bench(BENCH), list[float]()
    for k in range(4000):
        plant.advance(k * 1_000_000)
        places.append(plant.position)
        plant.set_target(-law.effort(plant.position))
    assert law.failure
    assert law.effort(0.0) == 0.0


@pytest.mark.parametrize("seconds", [0.5, 1.0, 3.0])
def test_a_hand_that_pushes_the_handle_out_of_the_travel_ends_the_motion(seconds: float) -> None:
    law, plant = motion(), plant_of_bench(BENCH)
    for k in range(20_000):
        plant.advance(k * 1_000_000)
        pushed = 0.2 if k > 1000 * seconds else 0.0
        plant.set_target(law.effort(plant.position) + pushed)
        if law.done:
            break
    assert "announced" in law.failure
    assert abs(plant.position) <= 4.0
    assert law.effort(plant.position) == 0.0


@pytest.mark.parametrize("wrong", [0.2, 5.0])
def test_a_first_model_that_is_wrong_by_a_factor_of_five_leaves_no_bound(wrong: float) -> None:
    law = motion(inertia=wrong * 4e-5)
    course = conducted(law, BENCH, plant_of_bench(BENCH))
    assert max(map(abs, course.angles)) <= 4.0
    assert max(map(abs, course.record.torques)) <= 0.1004


@pytest.mark.parametrize(
    "told", [{"damping": 2e-3}, {"coulomb": 6e-3}, {"damping": 1e-3, "coulomb": 4e-3, "inertia": 1.3e-5}]
)
def test_a_first_model_of_too_much_friction_or_damping_ends_no_motion(told: dict[str, float]) -> None:
    bench = replace(BENCH, model=replace(MODEL, damping=5e-4))
    law = motion(bench, None, **told)
    course = conducted(law, bench, plant_of_bench(bench))
    assert law.failure == ""
    assert max(map(abs, course.angles)) <= 4.0
    assert max(map(abs, course.speeds)) <= 60.0


def test_a_bench_that_is_too_light_for_its_encoder_is_told() -> None:
    light = replace(BENCH, model=replace(MODEL, inertia=1e-8, coulomb=0.0, damping=0.0), counts=24, rate=100.0)
    law = Probe(light.bounds)
    conducted(law, light, plant_of_bench(light))
    assert law.failure


def test_an_experiment_that_is_over_gives_no_effort_ever() -> None:
    law = Probe(Bounds(1e-3, 1e-3, -1.0, 1.0, 10.0, 0.1, math.inf))
    while not law.done:
        law.effort(0.0)
    assert law.failure
    assert {law.effort(place) for place in (0.0, 5.0, math.nan)} == {0.0}


def test_the_base_of_both_has_no_stages() -> None:
    with pytest.raises(NotImplementedError):
        Experiment(BENCH.bounds)


def test_a_plant_is_moved_as_it_is_said_to_be() -> None:
    plant = plant_of_bench(BENCH, velocity=3.0)
    assert plant.state[SPEED] == 3.0


def test_a_handle_that_is_faster_than_announced_ends_the_experiment() -> None:
    law, place = Probe(Bounds(1e-3, 1e-5, -1.0, 1.0, 2.0, 0.1, math.inf), skipped=("rest",)), 0.0
    while not law.done and place < 0.9:
        assert law.effort(place) <= 0.1
        place += 1e-5 * law.bounds.effort + 2.1e-3  # 2.1 m/s
    assert (law.failure, law.effort(place)) == ("the handle was faster than announced in the stage breakaway", 0.0)


@pytest.mark.parametrize("effort", [5.0, 50.0])
@pytest.mark.parametrize("damping", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("friction", [0.0, 0.3, 2.0])
def test_all_oscillations_together_stay_below_a_quarter_of_the_speed(
    friction: float, damping: float, effort: float
) -> None:
    for rate in (100.0, 1000.0):
        bounds = Bounds(1.0 / rate, 1e-6, -1.0, 1.0, 2.0, effort, math.inf)
        law = GuidedMotion(bounds, 0.3, friction, 0.0, 3.0 / rate, damping)
        for lines in law._riding:
            times = np.arange(0.0, law._time, 1e-3)
            speeds = sum(
                (size * np.exp(1j * (turning * times + phase)) / (damping + 0.3j * turning)).imag
                for turning, size, phase in lines
            )
            assert np.abs(speeds).max() <= 0.26 * 2.0


@pytest.mark.parametrize("share", [0.02, 0.2, 0.4])
def test_pushes_find_an_effort_that_moves_a_handle_of_unknown_friction(share: float) -> None:
    stiff = replace(BENCH, model=replace(BENCH.model, coulomb=share * BENCH.effort))
    law = Probe(BENCH.bounds, ["friction"])
    course = conducted(law, stiff, plant_of_bench(stiff))
    assert law.failure == ""
    assert max(map(abs, course.speeds)) < 0.9 * BENCH.speed
