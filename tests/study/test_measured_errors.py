"""The report's work-precision sets and error along a run, against closed forms and other people's solvers."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.study.measure import loops, work_precision
from haptic_fieldbus.study.measure.bench import Bench, device_in_hand
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, WAY, Problem, problems, sprung_mass
from haptic_fieldbus.study.measure.work_precision import step_limit
from tests.loops import BENCH

OMEGA = math.sqrt(STIFFNESS / MASS)
FINE = (640, 2560, 5120)
SHIPPED = Bench(BENCH, delay=0.0, period=1e-3)


def solved(problem: Problem, times: np.ndarray) -> np.ndarray:
    """Forces by an explicit Runge–Kutta method of order 8 with the input as a formula."""
    duration, way = problem.horizon, WAY

    def inputs(t: float) -> np.ndarray:
        if problem.motion.constant:
            return problem.motion.output[:, 0]
        if problem.name == "sprung-mass-sine":
            turn = 2.0 * math.pi * 1.5
            return np.array([way * math.sin(turn * t), way * turn * math.cos(turn * t)])
        s = t / duration
        position = way * (10 * s**3 - 15 * s**4 + 6 * s**5)
        return np.array([position, way / duration * (30 * s**2 - 60 * s**3 + 30 * s**4)])

    space = problem.space
    found = scipy.integrate.solve_ivp(
        lambda t, z: space.a @ z + space.b @ inputs(t),
        (0.0, float(times[-1])),
        np.zeros(space.order),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-14,
    )
    forces: np.ndarray = space.c[0] @ found.y + np.array([space.d[0] @ inputs(t) for t in times])
    return forces


@pytest.mark.parametrize("name", problems())
def test_the_reference_of_a_problem_is_what_another_solver_finds(name: str) -> None:
    problem = problems()[name]
    times = np.linspace(0.0, problem.horizon, 41)
    exact = problem.exact(problem.horizon / 40, 40)
    np.testing.assert_allclose(exact, solved(problem, times), atol=1e-9 * np.abs(exact).max())


def test_the_held_puck_and_the_free_puck_have_their_closed_forms() -> None:
    times = np.linspace(0.0, 1.0, 101)
    held_puck = problems()["sprung-mass-step"].exact(0.01, 100)
    np.testing.assert_allclose(held_puck, -STIFFNESS * WAY * np.cos(OMEGA * times), atol=1e-12)
    free_puck = problems()["free-puck"].exact(0.01, 100)
    np.testing.assert_allclose(free_puck, -0.5 * (1.0 - np.cos(OMEGA * times)), atol=1e-12)


@pytest.mark.thorough("every method on every problem", quick=6)
@pytest.mark.parametrize("name", problems())
@pytest.mark.parametrize("method", METHODS)
def test_every_method_has_the_order_that_it_claims_on_every_problem(name: str, method: str) -> None:
    found = work_precision.measure(problems()[name], method, FINE)
    if found.claimed is not None and math.isinf(found.claimed):
        assert found.order is None
        assert max(point.error_max or 0.0 for point in found.points) < 1e-11
    else:
        assert found.order == pytest.approx(found.claimed, abs=0.05)


def test_the_errors_of_forward_euler_are_those_of_its_closed_form() -> None:
    steps = 200
    period = 1.0 / steps
    (point,) = work_precision.measure(problems()["sprung-mass-step"], "forward-euler", [steps]).points
    n = np.arange(steps + 1)
    error = STIFFNESS * WAY * (((1.0 + 1j * OMEGA * period) ** n).real - np.cos(OMEGA * period * n))
    assert point.error_final == pytest.approx(abs(error[-1]), rel=1e-9)
    assert point.error_rms == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-9)
    assert point.error_max == pytest.approx(np.abs(error).max(), rel=1e-9)
    assert not point.stable


def test_a_run_that_overflows_stays_in_the_set_as_a_failure() -> None:
    problem = replace(problems()["tissue"], horizon=10.0)
    (point,) = work_precision.measure(problem, "rk4", [800]).points
    assert (point.error_final, point.error_rms, point.error_max, point.order) == (None, None, None, None)
    assert not point.stable
    assert point.ns_per_step > 0.0


def loop_by_hand(period: float, steps: int, stiffness: float, damping: float) -> list[float]:
    """The wall in the hand, by the exponential of everything at once: device, hand, its sine, the held force."""
    a, motor, hand = device_in_hand(BENCH)
    turn = 2.0 * math.pi
    system = np.zeros((7, 7))
    system[:4, :4], system[:4, 4:5], system[:4, 6:] = a, 4.0 * hand, motor
    system[4, 5], system[5, 4] = turn, -turn
    moved = scipy.linalg.expm(system * period)
    state, before, forces = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]), None, []
    for _ in range(steps + 1):
        velocity = 0.0 if before is None else (state[0] - before) / period
        before = state[0]
        state[6] = -stiffness * state[0] - damping * velocity
        forces.append(float(state[6]))
        state = moved @ state
    return forces


def test_the_closed_loop_is_the_one_written_out_by_hand() -> None:
    contact = loops.contacts()["damped-wall-in-hand"]
    law = contact.law("backward-difference", 0.005, 0.0)
    found = loops.loop_force(law, SHIPPED, 0.005, 200)
    np.testing.assert_allclose(found, loop_by_hand(0.005, 200, 600.0, 2.0), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("name", loops.contacts())
def test_the_loop_in_continuous_time_is_what_another_solver_finds(name: str) -> None:
    contact = loops.contacts()[name]
    a, motor, hand = device_in_hand(BENCH)
    space = contact.space

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        force = space.c[0] @ z[4:] + space.d[0] @ z[:2]
        device = a @ z[:4] + motor[:, 0] * force + hand[:, 0] * 4.0 * math.sin(2.0 * math.pi * t)
        return np.concatenate([device, space.a @ z[4:] + space.b @ z[:2]])

    times = np.linspace(0.0, 1.0, 21)
    solution = scipy.integrate.solve_ivp(
        rates, (0.0, 1.0), np.zeros(4 + space.order), method="DOP853", t_eval=times, rtol=1e-11, atol=1e-13
    )
    expected = space.c[0] @ solution.y[4:] + space.d[0] @ solution.y[:2]
    np.testing.assert_allclose(loops.closed(contact, SHIPPED).exact(0.05, 20), expected, atol=1e-8)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("wall-in-hand", "none"),
        ("damped-wall-in-hand", "backward-difference"),
        ("damped-wall-in-hand", "kalman-velocity"),
        ("sprung-mass-in-hand", "rk4"),
        ("sprung-mass-in-hand", "exact-foh"),
    ],
)
def test_a_held_force_makes_every_loop_first_order(name: str, method: str) -> None:
    found = loops.measure(loops.contacts()[name], method, SHIPPED, FINE)
    assert found.order == pytest.approx(1.0, abs=0.05)


def test_a_loop_that_samples_too_slowly_is_told_to_be_unstable() -> None:
    found = loops.measure(loops.contacts()["wall-in-hand"], "none", SHIPPED, [5, 5120])
    assert [point.stable for point in found.points] == [False, True]


@pytest.mark.parametrize("step", [0, 1, 12_345, 10**7])
def test_the_force_after_many_steps_is_known_to_the_last_digit(step: int) -> None:
    with mpmath.workdps(60):
        phase = mpmath.sqrt(mpmath.mpf(STIFFNESS) / MASS) * mpmath.mpf(loops.PERIOD) * step
        expected = float(STIFFNESS * mpmath.mpf(WAY) * mpmath.cos(phase))
    assert loops.exact_force(step) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_begins_with_the_mass_where_it_should_be(method: str) -> None:
    one = integrators.discretise(sprung_mass(), loops.PERIOD, method)
    step = integrators.bind(sprung_mass(), loops.PERIOD, method)
    loops.start(one, step)
    forces = (step(0.0), step(0.0))
    assert forces[0] == pytest.approx(STIFFNESS * WAY, rel=1e-4)
    assert loops.energy(one, forces) == pytest.approx(0.5 * STIFFNESS * WAY**2, rel=1e-2)


def test_energy_grows_and_fades_as_the_eigenvalues_of_euler_say() -> None:
    h = OMEGA * loops.PERIOD
    for method, factor in (("forward-euler", 1.0 + h * h), ("backward-euler", 1.0 / (1.0 + h * h))):
        found = loops.free_swing(method, 5000)
        for steps, energy in zip(found.steps, found.energy, strict=True):
            assert energy + 1.0 == pytest.approx(factor ** (steps - 1), rel=1e-9)


def test_the_error_of_the_trapezoid_is_the_phase_that_it_lacks() -> None:
    found = loops.free_swing("trapezoidal", 20_000)
    h = OMEGA * loops.PERIOD
    lag = (h - 2.0 * math.atan(0.5 * h)) * found.steps[-1]
    assert found.error[-1] == pytest.approx(2.0 * math.sin(0.5 * lag), rel=0.02)
    assert max(map(abs, found.energy)) < 1e-12


@pytest.mark.thorough("steps down to where floats end")
def test_the_exact_step_loses_only_digits_and_euler_ends_where_floats_do() -> None:
    assert loops.free_swing("exact-foh", 10**5).error[-1] < 1e-11
    ended = loops.free_swing("forward-euler", 5 * 10**6)
    assert ended.diverged_at is not None
    overflow = 308.0 * math.log(10.0) / (0.5 * math.log1p((OMEGA * loops.PERIOD) ** 2))
    assert ended.steps[-1] < 1.02 * overflow
    assert ended.diverged_at > 0.98 * overflow


def test_the_largest_stable_step_is_measured_where_it_is_claimed() -> None:
    found = [step_limit(name) for name in METHODS]
    assert [limit.method for limit in found] == list(METHODS)
    for limit in found:
        assert limit.oscillator_measured == pytest.approx(limit.oscillator_claimed, rel=1e-6)
        assert limit.lag_measured == pytest.approx(limit.lag_claimed, rel=1e-6)


def test_a_device_without_friction_has_a_hand_too() -> None:
    a, _, _ = device_in_hand(Plant(mass=0.5, damping=0.0))
    # Without friction 0 is a double pole, of which rounding by an eps makes a pair at a distance of sqrt(eps).
    assert np.linalg.eigvals(a).real.max() <= 100.0 * np.sqrt(np.finfo(float).eps)
