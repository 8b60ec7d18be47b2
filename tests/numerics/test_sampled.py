"""Environments of the loop, and the damping they need, against energy in the time domain."""

import math

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.numerics.sampled import environment, split_delay
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from tests.loops import DELAYS, PERIOD, wall


@pytest.mark.parametrize(("delay", "parts"), [(0.0, (0, 0.0)), (0.25, (0, 0.25)), (1.0, (1, 0.0)), (2.75, (2, 0.75))])
def test_a_delay_is_whole_periods_and_a_rest(delay: float, parts: tuple[int, float]) -> None:
    whole, fraction = split_delay(delay * 3e-4, 3e-4)
    assert (whole, fraction / 3e-4) == pytest.approx(parts)


def test_a_delay_a_rounding_below_a_whole_period_is_a_whole_one() -> None:
    assert split_delay(0.1 + 0.2 - 1e-16, 0.1) == (3, 0.0)


class TestDampingNeeded:
    """Against the energy of every periodic motion, written down in the time domain."""

    @staticmethod
    def least_damping(stiffness: float, damping: float, delay: float, periods: int = 120) -> float:
        """Smallest b for which b·(dissipation) − (work of the held force) ≥ 0, motions of period `periods`·T.

        Between two instants that matter a constant speed dissipates least, Δx²/Δt for b = 1.
        """
        whole = math.floor(delay / PERIOD + 1e-9)
        switch = delay - whole * PERIOD
        instants = 2 if switch > 1e-12 else 1
        size = instants * periods
        dissipated, work = np.zeros((size, size)), np.zeros((size, size))
        spans = [switch, PERIOD - switch] if instants == 2 else [PERIOD]
        for here in range(size):
            there, span = (here + 1) % size, spans[here % instants]
            way = np.zeros(size)
            way[here], way[there] = -1.0, 1.0
            dissipated += np.outer(way, way) / span
        for k in range(periods):
            force, way = np.zeros(size), np.zeros(size)
            force[instants * k] -= stiffness + damping / PERIOD
            force[instants * ((k - 1) % periods)] += damping / PERIOD
            begins = instants * (k + whole) + instants - 1
            way[begins % size] -= 1.0
            way[(begins + instants) % size] += 1.0
            work += 0.5 * (np.outer(force, way) + np.outer(way, force))
        # Shifting everything costs and gives nothing: leave it out by fixing the mean.
        basis = scipy.linalg.null_space(np.ones((1, size)))
        return float(scipy.linalg.eigh(basis.T @ work @ basis, basis.T @ dissipated @ basis, eigvals_only=True)[-1])

    @pytest.mark.thorough("18 searches for the worst motion", quick=("0.0-0.0",))
    @pytest.mark.parametrize("delay", DELAYS)
    @pytest.mark.parametrize("damping", [0.0, 0.9, -0.9])
    def test_the_damping_needed_is_that_of_the_worst_periodic_motion(self, delay: float, damping: float) -> None:
        expected = self.least_damping(800.0, damping, delay * PERIOD)
        assert damping_needed(wall(800.0, damping), PERIOD, delay * PERIOD) == pytest.approx(expected, rel=8e-3)

    def test_colgate_and_schenkel_for_a_filtered_spring(self) -> None:
        angle = np.linspace(1e-4, math.pi, 20_000)
        z = np.exp(1j * angle)
        h = 300.0 * 0.2 / (z - 0.8)
        expected = (PERIOD / 2 / (1 - np.cos(angle)) * ((1 - z**-1) * h).real).max()
        filtered = StateSpace(np.array([[0.8]]), np.array([[0.2]]), np.array([[-300.0]]), np.array([[0.0]]))
        assert damping_needed(filtered, PERIOD, 0.0) == pytest.approx(expected, rel=1e-6)


class TestEnvironment:
    def test_without_velocity_there_is_no_estimator_in_it(self) -> None:
        found = environment(Wall("handle", 600.0).linearised(), period=PERIOD, method=None, estimator=None)
        assert found.order == 0
        np.testing.assert_array_equal(found.d, [[-600.0]])

    def test_a_damper_works_on_the_estimated_velocity(self) -> None:
        """F_k = −K·x_k − B·(x_k − x_{k−1})/T"""
        found, state, before = wall(600.0, 2.0), np.zeros(1), 0.0
        for x in (0.1, 0.3, -0.2):
            force = float(found.c[0] @ state + found.d[0, 0] * x)
            assert force == pytest.approx(-600.0 * x - 2.0 * (x - before) / PERIOD)
            state, before = found.a @ state + found.b[:, 0] * x, x

    def test_virtual_states_and_velocity_go_together(self) -> None:
        """The chain estimator → integrator has the product of their transfer functions."""
        space = StateSpace(
            np.array([[0.0, 1.0], [-900.0, -20.0]]), np.array([[0.0, 0.0], [900.0, 20.0]]),
            np.array([[450.0, 10.0]]), np.array([[-450.0, -10.0]]),
        )  # fmt: skip
        found = environment(space, period=PERIOD, method="forward-euler", estimator="backward-difference")
        z = np.exp(0.3j)
        states = np.linalg.solve((z - 1) / PERIOD * np.eye(2) - space.a, space.b @ [1.0, (1 - 1 / z) / PERIOD])
        expected = space.c[0] @ states + space.d[0] @ [1.0, (1 - 1 / z) / PERIOD]
        inner = np.linalg.solve(z * np.eye(3) - found.a, found.b.astype(complex))
        assert complex((found.c @ inner + found.d)[0, 0]) == pytest.approx(complex(expected))

    def test_states_without_a_method_follow_straight_lines_exactly(self) -> None:
        """Beside scipy's first-order hold; its states are other ones, so the transfer functions are compared."""
        space = SprungMass("handle", 600.0, 0.5).dynamics
        found = environment(space, period=PERIOD, method=None, estimator=None)
        a, b, c, d, _ = scipy.signal.cont2discrete((space.a, space.b[:, :1], space.c, space.d[:, :1]), PERIOD, "foh")
        for z in np.exp(1j * np.array([0.01, 0.3, 2.0, 3.1])):
            ours = found.c @ np.linalg.solve(z * np.eye(2) - found.a, found.b.astype(complex)) + found.d
            expected = c @ np.linalg.solve(z * np.eye(2) - a, b.astype(complex)) + d
            np.testing.assert_allclose(ours, expected, rtol=1e-9)

    def test_velocity_without_an_estimator_is_refused(self) -> None:
        with pytest.raises(UsageError, match="estimator"):
            environment(gain([[-600.0, -1.0]]), period=PERIOD, method=None, estimator=None)
