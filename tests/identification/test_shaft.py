"""The sampled shaft against scipy's solver, which follows reversals and breakaways as events of its own."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from haptic_fieldbus.identification import shaft
from haptic_fieldbus.identification.shaft import HeldSpan, ShaftModel, ShaftRecord, predicted_motion, predicted_slopes

PERIOD = 0.002
SMOOTH = ShaftModel(4e-5, 3e-4, 0.0, 0.0007, 0.0006)
ROUGH = ShaftModel(4e-5, 1e-4, 3e-3, 0.0031, 0.0009)
LOADED = ShaftModel(9e-5, 0.0, 2e-3, 0.0, 0.0002, load=1.2e-3)


def record_of(positions: list[float], torques: list[float]) -> ShaftRecord:
    return ShaftRecord(PERIOD, tuple(positions), tuple(torques), 1e-3)


def opened(model: ShaftModel, torques: list[float], speed: float = 0.0) -> np.ndarray:
    """Angles of an open integration."""
    return predicted_motion(model, record_of([0.0] * len(torques), torques), 0.0, speed)[0]


def solved(model: ShaftModel, torques: list[float], speed: float = 0.0) -> list[float]:
    """Angles at the samples, by scipy: each piece of constant set-point and mode on its own."""
    edges = sorted({k * PERIOD for k in range(len(torques))} | {k * PERIOD + model.delay for k in range(len(torques))})
    state, side, found = np.array([0.0, speed, 0.0]), int(np.sign(speed)), [0.0]
    for begin, end in pairwise(edges):
        number = math.floor((0.5 * (begin + end) - model.delay) / PERIOD)
        target = torques[number] if number >= 0 else 0.0
        state, side = _piece(model, state, side, target, end - begin)
        if abs(end / PERIOD - round(end / PERIOD)) < 1e-9 and round(end / PERIOD) < len(torques):
            found.append(float(state[0]))
    return found


def _piece(model: ShaftModel, state: np.ndarray, side: int, target: float, left: float) -> tuple[np.ndarray, int]:
    while left > 1e-15:

        def rate(_: float, z: np.ndarray, side: int = side) -> list[float]:
            torque = (target - z[2]) / model.lag
            if not side and model.coulomb:
                return [0.0, 0.0, torque]
            return [z[1], (z[2] + model.load - model.coulomb * side - model.damping * z[1]) / model.inertia, torque]

        def event(_: float, z: np.ndarray, side: int = side) -> float:
            return float(side * z[1] if side else model.coulomb - abs(z[2] + model.load))

        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        events = [event] if model.coulomb else None
        run = solve_ivp(rate, (0.0, left), state, events=events, rtol=1e-10, atol=1e-13, method="DOP853")
        state, left = run.y[:, -1], left - run.t[-1]
        if run.status == 1:
            pull = state[2] + model.load
            if side:
                state[1] = 0.0
                side = 0 if abs(pull) <= model.coulomb else int(np.sign(pull))
            else:
                side = int(np.sign(pull))
    return state, side


def solved_with_parts(model: ShaftModel, torques: list[float]) -> list[float]:
    """Angles of a shaft that never rests, by scipy, with Stribeck friction and waves at every instant."""

    def rate(t: float, z: np.ndarray) -> list[float]:
        number = math.floor((t - model.delay) / PERIOD)
        target = torques[number] if 0 <= number < len(torques) else 0.0
        friction = model.coulomb + model.stribeck * math.exp(-((z[1] / model.stribeck_speed) ** 2))
        wave = sum(a * math.cos(n * z[0]) + b * math.sin(n * z[0]) for n, a, b in model.waves)
        pull = z[2] + model.load + wave - friction * np.sign(z[1]) - model.damping * z[1]
        return [z[1], pull / model.inertia, (target - z[2]) / model.lag]

    times = PERIOD * np.arange(len(torques))
    run = solve_ivp(rate, (0.0, times[-1]), [0.0, 8.0, 0.0], t_eval=times, max_step=1e-4, rtol=1e-9, atol=1e-11)
    return [float(each) for each in run.y[0]]


def test_stribeck_friction_and_waves_are_those_of_scipy() -> None:
    model = ShaftModel(
        4e-5,
        1e-4,
        1e-3,
        0.0008,
        0.0006,
        stribeck=6e-4,
        stribeck_speed=6.0,
        waves=((7.0, 4e-4, -3e-4), (0.5, 2e-4, 0.0)),
    )
    torques = [2.2e-3 + 1e-3 * math.sin(0.05 * k) for k in range(150)]
    theirs = solved_with_parts(model, torques)
    mine = opened(model, torques, 8.0)
    without = opened(replace(model, stribeck=0.0, waves=()), torques, 8.0)
    assert np.ptp(theirs) > 1.0
    assert mine == pytest.approx(theirs, abs=2e-3)
    assert float(np.abs(without - theirs).max()) > 0.02


def test_a_wave_is_taken_as_its_mean_over_the_way() -> None:
    model = ShaftModel(1.0, 0.0, 0.0, 0.0, 1.0, load=0.5, waves=((9.0, 0.3, 0.2),))
    places = np.linspace(1.0, 1.8, 4001)
    mean = float(np.mean(0.5 + 0.3 * np.cos(9.0 * places) + 0.2 * np.sin(9.0 * places)))
    assert model.torque_at(1.4, 0.8) == pytest.approx(mean, abs=1e-4)
    assert model.torque_at(1.4) == pytest.approx(0.5 + 0.3 * math.cos(12.6) + 0.2 * math.sin(12.6))


def pushes(count: int, size: float) -> list[float]:
    """Steps that reverse the shaft and let it stick."""
    draw = np.random.default_rng(3)
    return [float(each) for each in np.repeat(draw.uniform(-size, size, count // 10), 10)]


@pytest.mark.parametrize("model", [SMOOTH, ROUGH, LOADED], ids=["smooth", "rough", "loaded"])
def test_an_open_integration_is_that_of_scipy(model: ShaftModel) -> None:
    torques = pushes(120, 0.008)
    mine = opened(model, torques)
    theirs = solved(model, torques)
    assert np.ptp(theirs) > 0.02
    assert mine == pytest.approx(theirs, abs=1e-6)


def test_a_spinning_shaft_slows_down_and_sticks_where_the_closed_form_says() -> None:
    model = ShaftModel(4e-5, 0.0, 2e-3, 0.0, 0.0005)
    angles = opened(model, [0.0] * 500, 10.0)
    # ω²·J/(2·c)
    assert angles[-1] == pytest.approx(100.0 * 4e-5 / 4e-3, rel=1e-9)


def test_equal_rates_of_torque_and_speed_are_no_division_by_zero() -> None:
    close, far = (HeldSpan(ShaftModel(4e-5, 4e-5 / lag, 0.0, 0.0, 0.01), 0.002) for lag in (0.01, 0.010001))
    assert close.speed_of_torque == pytest.approx(far.speed_of_torque, rel=1e-3)
    assert close.way_of_torque == pytest.approx(far.way_of_torque, rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 1e-16, 1e-9, 1e-7])
def test_a_tiny_damping_is_the_limit_without_damping(damping: float) -> None:
    span, free = (HeldSpan(ShaftModel(4e-5, each, 0.0, 0.0, 1e-3), 0.002) for each in (damping, 0.0))
    assert span.way_of_force == pytest.approx(free.way_of_force, rel=1e-4)
    assert free.way_of_force == pytest.approx(0.5 * 0.002**2 / 4e-5, rel=1e-12)


def test_the_model_is_led_back_to_a_record_that_it_does_not_explain() -> None:
    drifting = [0.01 * k * PERIOD for k in range(2000)]
    record = record_of(drifting, [0.0] * 2000)
    at_rest, _ = predicted_motion(SMOOTH, record, speed=0.0)
    assert abs(at_rest[-1] - drifting[-1]) < 0.01
    assert predicted_motion(SMOOTH, record, 0.0, 0.0)[0][-1] == 0.0


RICH = ShaftModel(
    4e-5, 3e-4, 2e-3, 0.0011, 0.0006, 2e-4, stribeck=8e-4, stribeck_speed=3.0, waves=((14.0, 1e-4, -3e-4),)
)


@pytest.mark.parametrize(
    "model", [SMOOTH, ROUGH, replace(LOADED, delay=1e-5), RICH], ids=["smooth", "rough", "loaded", "rich"]
)
@pytest.mark.parametrize("key", ["inertia", "damping", "coulomb", "delay", "lag", "load"])
def test_a_slope_is_the_difference_of_two_predictions(
    model: ShaftModel, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over reversals, breakaways and rest; the difference over both sides has an error of second order."""
    monkeypatch.setattr(shaft, "MOSTLY_AT_REST", 1.0)
    torques, scales = pushes(300, 0.01), {"inertia": 4e-5, "delay": PERIOD, "lag": PERIOD, "damping": 1e-4}
    step = 1e-4 * scales.get(key, 2e-3)
    record = record_of(np.round(opened(model, torques), 3).tolist(), torques)

    def moved(side: float) -> ShaftModel:
        return replace(model, **{key: getattr(model, key) + side * step})

    ahead, behind = (predicted_motion(moved(side), record)[0] for side in (1.0, -1.0))
    slope = predicted_slopes([model, moved(1.0)], record)[:, 0]
    assert np.ptp(slope) > 0.0
    assert np.linalg.norm(slope - 0.5 * (ahead - behind)) < 0.02 * np.linalg.norm(slope)


def test_of_a_record_mostly_at_rest_whole_predictions_are_compared() -> None:
    """A load of 3 mN·m moves a shaft that friction holds, whatever the slope at rest is."""
    stuck = ShaftModel(4e-5, 1e-4, 2e-3, 0.0, 5e-4)
    record = record_of([0.0] * 300, [0.0] * 300)
    slopes = predicted_slopes([stuck, replace(stuck, load=3e-3)], record, 0.0)
    assert slopes[:, 0] == pytest.approx(predicted_motion(replace(stuck, load=3e-3), record, 0.0)[0])
    assert slopes[-1, 0] > 1.0
