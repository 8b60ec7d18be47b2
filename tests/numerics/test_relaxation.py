"""Springs that relax, against closed forms, quadrature and a fine integration of surface and branches."""

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.relaxation import bind_surface, decay_and_mean, pressed
from tests.lanes import examples

PERIOD = 1e-3
MULTI = ((200.0, 0.1), (300.0, 1e-3), (500.0, 1e-5))
REST = 100.0
some_branches = st.lists(st.tuples(st.floats(1.0, 2e3), st.floats(1e-6, 10.0)), min_size=1, max_size=4)


@pytest.mark.parametrize("ratio", [1e-12, 1e-6, 0.01, 0.5, 1.0, 30.0, 1e3, 1e9])
def test_decay_and_mean_have_all_their_digits(ratio: float) -> None:
    with mpmath.workdps(50):
        decay = mpmath.exp(-mpmath.mpf(ratio))
        expected = float(decay), float((1 - decay) / mpmath.mpf(ratio))
    assert decay_and_mean(ratio) == pytest.approx(expected, rel=1e-15, abs=1e-300)


@pytest.mark.parametrize(("ratio", "expected"), [(0.0, (1.0, 1.0)), (math.inf, (0.0, 0.0))])
def test_a_branch_may_be_as_slow_or_fast_as_it_likes(ratio: float, expected: tuple[float, float]) -> None:
    assert decay_and_mean(ratio) == expected


def test_after_a_press_it_relaxes_as_the_closed_form_in_every_branch() -> None:
    """A ramp to D within one period: k₀·D + Σ k·D·(1 − e⁻ʳ)/r·e^(−n·r), r = T/τ; branches of 100 ms, 1 ms and 10 µs."""
    push = bind_surface(REST, MULTI, PERIOD)
    push(0.0)
    for n in range(200):
        exact = REST + sum(
            k * -math.expm1(-PERIOD / tau) * tau / PERIOD * math.exp(-n * PERIOD / tau) for k, tau in MULTI
        )
        assert push(1e-3) == pytest.approx(1e-3 * exact, rel=1e-12)


@settings(derandomize=True, max_examples=examples(30))
@given(branches=some_branches, speed=st.floats(1e-3, 2.0))
def test_pressed_on_at_constant_speed_each_branch_lags_by_its_time(
    branches: list[tuple[float, float]], speed: float
) -> None:
    """k·v·τ·(1 − e^(−t/τ)) each: a branch far faster than the period is the damper k·τ."""
    push = bind_surface(REST, branches, PERIOD)
    found = [push(speed * PERIOD * n) for n in range(50)]
    for n, force in enumerate(found):
        time = n * PERIOD
        exact = REST * speed * time + sum(k * speed * tau * -math.expm1(-time / tau) for k, tau in branches)
        assert force == pytest.approx(exact, rel=1e-9, abs=1e-12)


def in_small_steps(branches: tuple[tuple[float, float], ...], depth: list[float], steps: int) -> list[float]:
    """Surface and branches by brute force: backward Euler in small steps, the surface where the push is not below 0."""
    dt, surface, inner = PERIOD / steps, max(0.0, depth[0]), [max(0.0, depth[0])] * len(branches)
    slope = REST + sum(k / (1.0 + dt / tau) for k, tau in branches)
    pushes = [REST * surface]
    for before, now in pairwise(depth):
        for step in range(1, steps + 1):
            at = before + (now - before) * step / steps
            free = sum(k * q / (1.0 + dt / tau) for (k, tau), q in zip(branches, inner, strict=True)) / slope
            surface = max(at, free)
            inner = [(q + dt / tau * surface) / (1.0 + dt / tau) for (_, tau), q in zip(branches, inner, strict=True)]
        pushes.append(slope * (surface - free))
    return pushes


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("turn", [15.0, 60.0])
def test_let_go_and_met_again_it_is_where_its_surface_has_come_to(turn: float) -> None:
    """A tool that taps faster than the tissue recovers, against two hundred small steps a period."""
    branches = ((200.0, 0.1), (300.0, 5e-3))
    depth = [0.004 - 0.006 * math.cos(turn * n * PERIOD) for n in range(600)]
    push = bind_surface(REST, branches, PERIOD)
    found, exact = np.array([push(d) for d in depth]), np.array(in_small_steps(branches, depth, 200))
    assert (exact[1:] == 0.0).sum() > 100
    assert np.abs(found - exact).max() < 0.02 * exact.max()
    np.testing.assert_allclose(found, exact, atol=0.02 * exact.max())


def test_a_dent_that_is_left_comes_back_as_its_differential_equation_says() -> None:
    """(k₀ + k)·s = k·q, q̇ = (s − q)/τ: s = s(0)·e^(−t·k₀/((k₀ + k)·τ)); felt by a tool that comes back later."""
    k, tau, deep = 300.0, 0.02, 0.01
    for wait in (5, 20, 60):
        push = bind_surface(REST, ((k, tau),), PERIOD)
        for _ in range(2000):
            push(deep)
        for _ in range(wait):
            push(-1.0)
        left = k / (REST + k) * deep * math.exp(-(wait + 1) * PERIOD * REST / ((REST + k) * tau))
        lowest = 0.95 * left
        assert push(lowest) == 0.0
        assert push(1.05 * left) > 0.0


@settings(derandomize=True, max_examples=examples(200))
@given(branches=some_branches, depths=st.lists(st.floats(-0.02, 0.02), min_size=2, max_size=40))
def test_it_never_pulls_and_gives_no_more_than_the_stated_leak(
    branches: list[tuple[float, float]], depths: list[float]
) -> None:
    """Held pushes against any jumps: at most what is stored at first, and |ΔF·Δx| of each period."""
    push = bind_surface(REST, branches, PERIOD)
    pushes = np.array([push(depth) for depth in depths])
    assert pushes.min() >= 0.0
    given_away = -float(np.sum(pushes[:-1] * np.diff(depths)))
    leak = float(np.sum(np.abs(np.diff(pushes) * np.diff(depths))))
    assert given_away <= 0.5 * REST * max(0.0, depths[0]) ** 2 + leak + 1e-12


@settings(derandomize=True, max_examples=examples(60))
@given(branches=some_branches, depth=st.floats(1e-4, 0.02), period=st.floats(1e-5, 0.1))
def test_it_neither_explodes_nor_rings(branches: list[tuple[float, float]], depth: float, period: float) -> None:
    """Held at a depth it only ever relaxes, towards the spring that stays, whatever the period."""
    push = bind_surface(REST, branches, period)
    push(0.0)
    pushes = [push(depth) for _ in range(50)]
    rounding = 1e-12 * pushes[0]
    assert all(later <= earlier + rounding for earlier, later in pairwise(pushes))
    assert pushes[-1] >= REST * depth - rounding


def test_begun_inside_it_is_at_rest_there() -> None:
    push = bind_surface(REST, MULTI, PERIOD)
    assert [push(0.01) for _ in range(20)] == pytest.approx([1.0] * 20, rel=1e-12)


def test_what_is_no_number_is_handed_on() -> None:
    push = bind_surface(REST, MULTI, PERIOD)
    assert math.isnan(push(math.nan))
    push = bind_surface(REST, MULTI, PERIOD)
    push(0.0)
    assert math.isnan(push(math.nan))


def test_pressed_is_the_linear_system_of_scipys_solution() -> None:
    """Branches pressed along a sine, from rest: the matrices against the equations written out, and the step."""
    space, turn = pressed(REST, MULTI[:2]), 40.0

    def rates(t: float, q: np.ndarray) -> list[float]:
        depth = 0.01 * (1.0 - math.cos(turn * t))
        return [(depth - each) / tau for each, (_, tau) in zip(q, MULTI, strict=False)]

    solved = solve_ivp(rates, (0.0, 0.07), [0.0, 0.0], rtol=1e-11, atol=1e-14).y[:, -1]
    depth = 0.01 * (1.0 - math.cos(turn * 0.07))
    exact = -REST * depth - sum(k * (depth - q) for (k, _), q in zip(MULTI, solved, strict=False))
    assert float((space.c @ solved + space.d[:, 0] * depth)[0]) == pytest.approx(exact, rel=1e-9)
    push = bind_surface(REST, MULTI[:2], 1e-4)
    found = [push(0.01 * (1.0 - math.cos(turn * n * 1e-4))) for n in range(701)][-1]
    assert -found == pytest.approx(exact, rel=1e-4)
