"""The fit against scipy's least squares on a simulation of its own, and what it says where it cannot know."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import least_squares

from haptic_fieldbus.drive.rig import Cogging, Mechanics, Stribeck, Weight
from haptic_fieldbus.identification.estimates import UNITS, Estimate, reason_of
from haptic_fieldbus.identification.experiment import GuidedMotion
from haptic_fieldbus.identification.fit import (
    ShaftFit,
    errors_after,
    first_guess,
    fit_shaft,
    prediction_errors,
    torque_balance,
)
from haptic_fieldbus.identification.shaft import ShaftModel, ShaftRecord
from haptic_fieldbus.sim.mechanics.loaded_plant import Load, LoadedPlant
from haptic_fieldbus.sim.mechanics.motion import Shaft
from tests.identification.benches import Bench, conducted, drawn_bench, identified_bench

PERIOD, COUNT = 0.002, 2.0 * math.pi / 20_000
TRUE = ShaftModel(4e-5, 2e-4, 0.0, 0.0012, 0.001)


def multisine(count: int, size: float, seed: int = 1) -> list[float]:
    draw, t = np.random.default_rng(seed), np.arange(count) * PERIOD
    lines = [np.sin(2 * math.pi * f * t + draw.uniform(0.0, 6.28)) for f in (1.0, 3.0, 7.0, 13.0, 29.0, 47.0)]
    return [float(each) for each in size * np.sum(lines, axis=0) / 3.0]


def open_loop(model: ShaftModel, torques: list[float]) -> np.ndarray:
    """Angles of the linear shaft, by matrix exponentials."""
    a = np.zeros((4, 4))
    a[0, 1], a[1, 1], a[1, 2] = 1.0, -model.damping / model.inertia, 1.0 / model.inertia
    a[2, 2], a[2, 3] = -1.0 / model.lag, 1.0 / model.lag
    before, after = expm(a * model.delay), expm(a * (PERIOD - model.delay))
    state, found = np.zeros(4), []
    for k, torque in enumerate(torques):
        found.append(state[0])
        state[3] = torques[k - 1] if k else 0.0
        state = before @ state
        state[3] = torque
        state = after @ state
    return np.array(found)


def record_of(model: ShaftModel, torques: list[float], seed: int = 5) -> ShaftRecord:
    phase = np.random.default_rng(seed).uniform()
    shown = np.floor(open_loop(model, torques) / COUNT + phase) * COUNT
    return ShaftRecord(PERIOD, tuple(shown.tolist()), tuple(torques), COUNT)


def test_the_values_are_those_of_scipys_least_squares_within_the_intervals() -> None:
    record = record_of(TRUE, multisine(1200, 0.02))
    mine = fit_shaft([record])
    scales = np.array([4e-5, 2e-4, 1e-3, 1e-3, 1.0])

    def error(x: np.ndarray) -> np.ndarray:
        values = x * scales
        model = ShaftModel(values[0], values[1], 0.0, values[2], values[3])
        off: np.ndarray = (open_loop(model, list(record.torques)) + x[4] * COUNT - record.positions) / COUNT
        return off

    theirs = least_squares(
        error, [1.3, 0.7, 1.0, 0.8, 0.0], diff_step=1e-4, bounds=([0.1, 0.0, 0.1, 0.1, -9.0], [9.0, 9.0, 1.9, 9.0, 9.0])
    )
    found = dict(zip(("inertia", "viscous_damping", "delay", "torque_lag"), theirs.x * scales, strict=False))
    for name, value in found.items():
        estimate = mine.values[name]
        assert estimate.low <= value <= estimate.high, name
    assert mine.values["inertia"].value == pytest.approx(4e-5, rel=2e-3)
    assert mine.residual == pytest.approx(float(np.sqrt(2.0 * theirs.cost / 1200)), rel=0.15)


def test_a_record_that_begins_in_motion_is_predicted_from_what_was_before() -> None:
    """Its first speed is not known from its first counts."""
    whole = replace(record_of(TRUE, multisine(1200, 0.02)), resolution=COUNT)
    before, record = whole.part(0, 700), whole.part(700)
    errors = errors_after(TRUE, before, record)
    assert len(errors) == 500
    assert np.sqrt(np.mean(errors**2)) < 0.4 < 0.5 * np.sqrt(np.mean(prediction_errors(TRUE, record) ** 2))


def test_the_solution_is_a_minimum_of_its_own_sum_of_squares() -> None:
    record = record_of(TRUE, multisine(1200, 0.02))
    best = fit_shaft([record]).model

    def cost(model: ShaftModel) -> float:
        return float(np.sum(prediction_errors(model, record) ** 2))

    for key in ("inertia", "damping", "delay", "lag"):
        for factor in (0.97, 1.03):
            assert cost(replace(best, **{key: factor * getattr(best, key)})) > 0.999 * cost(best)


@pytest.mark.parametrize("guess", [None, ShaftModel(1.5e-5, 0.0, 1e-3, 0.004, 2e-4), replace(TRUE, inertia=1.2e-4)])
def test_the_first_guess_does_not_matter(guess: ShaftModel | None) -> None:
    record = record_of(TRUE, multisine(1200, 0.02))
    assert fit_shaft([record], guess).model.inertia == pytest.approx(4e-5, rel=2e-3)


def test_the_first_guess_is_near() -> None:
    guess = first_guess([record_of(TRUE, multisine(1200, 0.02))])
    assert guess.inertia == pytest.approx(4e-5, rel=0.2)
    assert guess.delay + guess.lag == pytest.approx(0.0022, abs=1.1e-3)


def test_too_few_samples_and_a_shaft_that_did_not_move_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 200"):
        fit_shaft([record_of(TRUE, multisine(100, 0.02))])
    with pytest.raises(ValueError, match="less than 10 counts"):
        fit_shaft([ShaftRecord(PERIOD, (0.0,) * 300, (0.0,) * 300, COUNT)])


@pytest.mark.thorough("fits benches")
def test_what_the_model_does_not_explain_is_told_and_widens_the_intervals() -> None:
    torques = multisine(1200, 0.02)
    clean, true = record_of(TRUE, torques), open_loop(TRUE, torques)
    wavy = replace(clean, positions=tuple((true + 40.0 * COUNT * np.sin(40.0 * true)).tolist()))
    narrow, wide = fit_shaft([clean]), fit_shaft([wavy])
    assert not narrow.warnings
    assert "unexplained" in wide.warnings[0]
    assert wide.values["inertia"].half_width > 3.0 * narrow.values["inertia"].half_width


RICH = ShaftModel(
    4e-5, 2e-4, 2e-3, 0.0012, 0.0006, load=2e-4, stribeck=1e-3, stribeck_speed=1.5, waves=((12.0, 3e-4, -4e-4),)
)


@pytest.fixture(scope="module")
def rich_fit() -> ShaftFit:
    """A fit to the motion of a bench with Stribeck friction and cogging, as the plant of the simulation moves it."""
    mechanics = Mechanics(
        stribeck=Stribeck(RICH.stribeck, RICH.stribeck_speed), cogging=Cogging(5e-4, 12), gravity=Weight(2e-4)
    )
    shaft = Shaft(RICH.inertia, RICH.damping, RICH.coulomb, RICH.lag)
    bench = Bench(RICH, 4096, 500.0, 0.1, 60.0, 8.0)
    plant = LoadedPlant(Load(shaft, mechanics), None)
    motion = GuidedMotion(bench.bounds, 4e-5, 2.5e-3, 0.0, 0.0018)
    course = conducted(motion, bench, plant)
    assert motion.failure == ""
    return fit_shaft([course.part("check", "stop")])


@pytest.mark.thorough("fits a motion of 8 s, 6 s of the processor")
def test_stribeck_friction_and_cogging_are_found_and_leave_the_other_values_alone(rich_fit: ShaftFit) -> None:
    values, model = rich_fit.values, rich_fit.model
    assert values["inertia"].value == pytest.approx(4e-5, rel=0.01)
    assert values["viscous_damping"].value == pytest.approx(2e-4, rel=0.05)
    assert values["coulomb_friction"].value == pytest.approx(2e-3, rel=0.03)
    assert model.stribeck == pytest.approx(1e-3, rel=0.1)
    assert model.stribeck_speed == pytest.approx(1.5, rel=0.15)
    order, cosine, sine = max(model.waves, key=lambda each: math.hypot(*each[1:]))
    assert order == pytest.approx(12.0, abs=0.05)
    assert math.hypot(cosine, sine) == pytest.approx(5e-4, rel=0.1)
    assert not rich_fit.warnings


SUDDEN = replace(RICH, stribeck_speed=0.25, load=0.0, waves=())


def sudden_course(jitter: float = 0.0) -> ShaftRecord:
    """A motion at 200 Hz with Stribeck friction whose speed is passed within a tenth of a period."""
    mechanics = Mechanics(stribeck=Stribeck(SUDDEN.stribeck, SUDDEN.stribeck_speed))
    shaft = Shaft(SUDDEN.inertia, SUDDEN.damping, SUDDEN.coulomb, SUDDEN.lag)
    bench = Bench(SUDDEN, 4096, 200.0, 0.1, 60.0, 8.0)
    motion = GuidedMotion(bench.bounds, 4e-5, 2.5e-3, 0.0, 0.0018)
    course = conducted(motion, bench, LoadedPlant(Load(shaft, mechanics), None), jitter=jitter)
    assert motion.failure == ""
    return course.part("check", "stop")


@pytest.mark.thorough("simulates benches")
def test_at_the_true_values_stribeck_friction_leaves_no_more_than_the_encoder() -> None:
    """Held over whole periods it left 1.5 counts, which the fit explained by less inertia."""
    assert np.sqrt(np.mean(prediction_errors(SUDDEN, sudden_course()) ** 2)) < 0.4


@pytest.mark.thorough("fits a motion of 20 s")
def test_set_points_that_act_early_and_late_bend_no_value() -> None:
    """With a fixed gain the inertia was 5 % off and the damping 15 %, with waves that imitated the noise."""
    fit = fit_shaft([sudden_course(jitter=0.0016)])
    assert fit.values["inertia"].value == pytest.approx(SUDDEN.inertia, rel=0.01)
    assert fit.values["viscous_damping"].value == pytest.approx(SUDDEN.damping, rel=0.05)
    assert fit.values["coulomb_friction"].value == pytest.approx(SUDDEN.coulomb, rel=0.05)
    assert fit.values["delay_and_lag"].value == pytest.approx(0.0018, rel=0.1)
    assert fit.model.waves == ()


def test_friction_and_load_of_a_record_are_those_of_its_model() -> None:
    """The balance takes no friction and no load from the model: a model without them shows both."""
    record = record_of(TRUE, multisine(1200, 0.02))
    _, speeds, friction, _ = torque_balance(replace(TRUE, damping=0.0), record)
    fast = np.abs(speeds) > 0.3 * np.abs(speeds).max()
    slope = np.polyfit(speeds[fast], friction[fast], 1)[0]
    assert slope == pytest.approx(TRUE.damping, rel=0.15)
    *_, load = torque_balance(TRUE, record)
    assert load.mean() == pytest.approx(0.0, abs=2e-4)


def estimates(**changed: Estimate) -> dict[str, Estimate]:
    known = {name: Estimate(1.0, 0.99, 1.01, "") for name in UNITS}
    return known | changed


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("inertia", "too small beside one count"),
        (
            "viscous_damping",
            "its torque at the top speed of 3 rad/s is too small beside the torque that the inertia takes",
        ),
        ("coulomb_friction", "small beside the torques"),
        ("delay", "act alike"),
        ("torque_lag", "together they are 1000 ms"),
        ("delay_and_lag", "fast part of the motion"),
        ("load", ""),
    ],
)
def test_a_wide_interval_has_a_reason(name: str, words: str) -> None:
    wide = estimates(**{name: Estimate(1.0, 0.0, 3.0, "")})
    assert words in reason_of(name, wide, 3.0)
    assert (reason_of(name, wide, 3.0) == "") == (words == "")
    assert all(reason_of(each, wide, 3.0) == "" for each in UNITS if each != name)


def test_a_damping_below_friction_is_said_to_be_hidden_by_it() -> None:
    wide = estimates(viscous_damping=Estimate(0.1, 0.0, 3.0, ""))
    told = reason_of("viscous_damping", wide, 3.0)
    assert told == "friction hides it: at the top speed of 3 rad/s it is 30 % of the Coulomb friction"


# Seeded draws of whole benches.

TRUTHS = ("inertia", "viscous_damping", "coulomb_friction", "delay_and_lag", "torque_lag", "delay")


def truth(bench: Bench) -> dict[str, float]:
    model = bench.model
    both = model.delay + model.lag
    values = (model.inertia, model.damping, model.coulomb, both, model.lag, model.delay)
    return dict(zip(TRUTHS, values, strict=True))


@pytest.mark.thorough("measures 12 drawn benches", quick=2)
@pytest.mark.parametrize("seed", range(12))
def test_a_drawn_bench_is_measured_within_its_bounds(seed: int) -> None:
    bench = drawn_bench(seed)
    fit, *courses = identified_bench(bench)
    for course in courses:
        assert max(map(abs, course.angles)) <= 0.5 * bench.travel
        assert max(map(abs, course.speeds)) <= bench.speed
        assert max(map(abs, course.record.torques)) <= bench.effort * 1.005
    true, both = truth(bench), bench.model.delay + bench.model.lag
    assert fit.values["inertia"].value == pytest.approx(true["inertia"], rel=0.05)
    assert fit.values["delay_and_lag"].value == pytest.approx(both, abs=max(1e-4, 0.1 * both))
    if true["viscous_damping"] * fit.top_speed > 0.05 * true["coulomb_friction"]:
        damping = fit.values["viscous_damping"]
        assert damping.value == pytest.approx(true["viscous_damping"], rel=0.15) or damping.reason


@pytest.mark.thorough("measures 12 drawn benches")
def test_intervals_cover_what_is_true() -> None:
    inside = []
    for seed in range(100, 112):
        bench = drawn_bench(seed)
        fit, *_ = identified_bench(bench)
        inside += [fit.values[name].low <= value <= fit.values[name].high for name, value in truth(bench).items()]
    assert sum(inside) >= 0.9 * len(inside)
