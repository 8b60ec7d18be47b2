"""Explicit methods on nonlinear rates: as the linear ones where these are linear, in order where they are not."""

import itertools
import math

import numpy as np
import pytest
import scipy.integrate

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.integrators import METHODS, discretise
from haptic_fieldbus.numerics.integrators.method import follow
from haptic_fieldbus.numerics.integrators.staggered import positions
from haptic_fieldbus.study.explicit import EXPLICIT, EXPLICIT_VERLET_LAG_LIMIT, bind_rates
from tests.numerics.systems import SPACES

PENDULUM_ORDERS = {"forward-euler": 1, "semi-implicit": 2, "semi-implicit-drift-first": 1, "verlet": 2, "rk4": 2}
STEPS = {1: (4096, 8192), 2: (512, 1024)}


def pendulum(time: float, states: tuple[float, ...], x: float) -> tuple[float, float]:
    """Hanging from a handle at x, moved sideways."""
    return states[1], -40.0 * math.sin(states[0] - x)


def tired_pendulum(time: float, states: tuple[float, ...], x: float) -> tuple[float, float]:
    """With a brake that depends on speed and on time."""
    return states[1], -40.0 * math.sin(states[0] - x) - 3.0 * states[1] * (1.0 + math.sin(5.0 * time))


ANY_RATES = ("forward-euler", "semi-implicit-drift-first", "rk4")
"""Methods that are the same for linear rates of any kind; the others solve there for what they predict here."""


@pytest.mark.parametrize(
    ("method", "name"),
    [(method, "sprung mass") for method in EXPLICIT]
    + [(method, name) for method in ANY_RATES for name in ("driven", "grounded", "two at once")],
)
def test_where_rates_are_linear_it_is_the_linear_method(method: str, name: str) -> None:
    space, period = SPACES[name], 1e-3
    inputs = np.stack([0.01 * np.sin(np.arange(200) * 0.1), 0.3 * np.cos(np.arange(200) * 0.2)], axis=-1)
    start, (a, b) = [0.02, -0.3, 0.1][: space.order], (space.a.tolist(), space.b.tolist())

    def rates(time: float, states: tuple[float, ...], x: float, v: float) -> list[float]:
        return [sum(map(float.__mul__, (*row, *by), (*states, x, v))) for row, by in zip(a, b, strict=True)]

    one = discretise(space, period, method)
    expected = follow(one, inputs, start).states
    if method == "semi-implicit":
        expected = np.array([one.stored(z, u) for z, u in zip(expected, inputs, strict=True)])
    moving = tuple(state for state, moves in enumerate(positions(space)) if moves)
    advance = bind_rates(rates, start, period, method, moving)
    np.testing.assert_allclose([advance(*row) for row in inputs.tolist()], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", EXPLICIT)
class TestEveryExplicitMethod:
    def test_has_its_order_on_a_pendulum_that_is_moved(self, method: str) -> None:
        errors = [self._error(method, pendulum, steps) for steps in STEPS[PENDULUM_ORDERS[method]]]
        assert math.log2(errors[0] / errors[1]) == pytest.approx(PENDULUM_ORDERS[method], abs=0.05)

    def test_has_its_order_where_rates_depend_on_speed_and_time(self, method: str) -> None:
        claimed = 1 if method == "semi-implicit" else PENDULUM_ORDERS[method]
        errors = [self._error(method, tired_pendulum, steps) for steps in STEPS[claimed]]
        assert math.log2(errors[0] / errors[1]) == pytest.approx(claimed, abs=0.05)

    @staticmethod
    def _error(method: str, rates: object, steps: int) -> float:
        end, start = 0.6, [0.9, 1.0]

        def moved(time: float) -> float:
            return 0.2 * (1.0 - math.cos(7.0 * time))

        advance = bind_rates(rates, start, end / steps, method, (0,))  # type: ignore[arg-type]
        for sample in range(steps + 1):
            found = advance(moved(sample * end / steps))
        exact = scipy.integrate.solve_ivp(
            lambda t, z: rates(t, tuple(z), moved(t)), (0.0, end), start, method="DOP853", rtol=1e-13, atol=1e-14  # type: ignore[operator]
        )  # fmt: skip
        return float(abs(found[0] - exact.y[0, -1]))

    def test_begins_where_it_is_told(self, method: str) -> None:
        assert bind_rates(pendulum, [0.4, 0.0], 1e-3, method, (0,))(0.4) == (0.4, 0.0)

    def test_numbers_that_are_none_are_passed_on(self, method: str) -> None:
        advance = bind_rates(lambda t, z, x: (z[1], -40.0 * (z[0] - x)), [0.0, 0.0], 1e-3, method, (0,))
        for x in (0.0, math.nan, 0.0, 0.0):
            found = advance(x)
        assert not all(map(math.isfinite, found))

    def test_an_overflow_is_passed_on(self, method: str) -> None:
        advance = bind_rates(lambda t, z, x: (z[1], 1e9 * z[0] * abs(z[0])), [1.0, 1.0], 1.0, method, (0,))
        found = [advance(0.0) for _ in range(40)][-1]
        assert not all(map(math.isfinite, found))

    @pytest.mark.parametrize("period", [0.0, -1.0, math.nan])
    def test_a_period_that_is_none_is_refused(self, method: str, period: float) -> None:
        with pytest.raises(UsageError, match="above 0"):
            bind_rates(pendulum, [0.0, 0.0], period, method)


def test_free_motion_by_rk4_is_fourth_order() -> None:
    errors = []
    exact = scipy.integrate.solve_ivp(
        lambda t, z: pendulum(t, tuple(z), 0.0), (0, 0.6), [0.9, 1.0], "DOP853", rtol=1e-13, atol=1e-14
    )
    for steps in (128, 256, 512):
        advance = bind_rates(pendulum, [0.9, 1.0], 0.6 / steps, "rk4")
        for _ in range(steps + 1):
            found = advance(0.0)
        errors.append(math.dist(found, exact.y[:, -1]))
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert orders == pytest.approx([4, 4], abs=0.05)


def test_all_others_need_a_linear_system_and_say_so() -> None:
    for method in set(METHODS) - set(EXPLICIT):
        with pytest.raises(UsageError, match=rf'"{method}" is not for nonlinear rates; there are: forward-euler'):
            bind_rates(pendulum, [0.0, 0.0], 1e-3, method)


@pytest.mark.parametrize("method", EXPLICIT)
def test_a_bristle_of_lugre_that_slips_fast_explodes_beyond_its_limit(method: str) -> None:
    """ż = v − σ0·|v|/g·z is a lag of rate σ0·|v|/g: stable while T·rate is below `lag_limit`, 2 for forward Euler."""
    stiffness, level, period = 1e4, 2.0, 1e-3
    limit = EXPLICIT_VERLET_LAG_LIMIT if method == "verlet" else METHODS[method].lag_limit

    def settled(speed: float) -> float:
        advance = bind_rates(lambda t, z, v: (v - stiffness * abs(v) / level * z[0],), [0.0], period, method)
        return abs(stiffness * [advance(speed) for _ in range(3000)][-1][0])

    slow, fast = (part * limit * level / (stiffness * period) for part in (0.98, 1.02))
    assert settled(slow) == pytest.approx(level, rel=1e-6)
    assert not settled(fast) < 1e6 * level
