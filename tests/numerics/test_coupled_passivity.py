"""The share of damping that coupled axes need, against energy in the time domain and the sampled formula."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus.margins.coupled import PassivityPort, damping_share, stores
from haptic_fieldbus.numerics.coupled import embedded
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.numerics.passivity import damping_needed, hold
from tests.cases import every
from tests.loops import DELAYS, LAG, PERIOD, Array, sprung_mass, wall
from tests.pairs import shaft

PAIRS = [
    ((1.5, 1.5), (0.0, 0.0), 1.0),
    ((1.5, 0.4), (0.0, 1.0), 1.0),
    ((1.5, 0.4), (0.33, 0.33), -2.0),
    ((0.7, 3.0), (0.5, 1.7), 0.4),
    ((2.0, 0.9), (2.0, 0.25), 3.0),
]
"""(dampings, delays in periods, ratio)"""


def ports(dampings: tuple[float, float], delays: tuple[float, float], lag: float = 0.0) -> list[PassivityPort]:
    return [PassivityPort(damping, delay * PERIOD, lag) for damping, delay in zip(dampings, delays, strict=True)]


class TestAgainstTheEnergyOfEveryPeriodicMotion:
    """All motions of a period of so many samples, each axis on straight lines between the instants that matter to it.

    Between two of its instants a constant speed dissipates least, b·Δx²/Δt.
    """

    PERIODS = 90

    def share(
        self, dampings: tuple[float, float], delays: tuple[float, float], force: Callable[[Array, Array], Array]
    ) -> float:
        """`force` gives both forces of the rows that hold the positions now and before, as rows."""
        instants = [2 if math.fmod(delay, 1.0) else 1 for delay in delays]
        starts, size = [0, instants[0] * self.PERIODS], sum(instants) * self.PERIODS
        identity = np.eye(size)

        def place(axis: int, k: int, instant: int = 0) -> Array:
            row = (instants[axis] * k + instant) % (instants[axis] * self.PERIODS)
            unit: Array = identity[starts[axis] + row]
            return unit

        dissipated, work = np.zeros((size, size)), np.zeros((size, size))
        for k in range(self.PERIODS):
            now, before = (np.array([place(0, at), place(1, at)]) for at in (k, k - 1))
            forces = force(now, before)
            for axis, (damping, delay) in enumerate(zip(dampings, delays, strict=True)):
                switch = math.fmod(delay, 1.0)
                for instant, span in enumerate([switch, 1.0 - switch] if switch else [1.0]):
                    way = place(axis, k, instant + 1) - place(axis, k, instant)
                    dissipated += damping * np.outer(way, way) / (span * PERIOD)
                begins = k + math.floor(delay), instants[axis] - 1
                way = place(axis, begins[0] + 1, begins[1]) - place(axis, *begins)
                work += 0.5 * (np.outer(forces[axis], way) + np.outer(way, forces[axis]))
        # A shift dissipates nothing, and its constant force does no work on a motion that comes back: means are fixed.
        means = np.zeros((2, size))
        means[0, : starts[1]], means[1, starts[1] :] = 1.0, 1.0
        basis = scipy.linalg.null_space(means)
        return float(scipy.linalg.eigh(basis.T @ work @ basis, basis.T @ dissipated @ basis, eigvals_only=True)[-1])

    @pytest.mark.thorough("searches for the worst motion of 15 shafts", quick=1)
    @pytest.mark.parametrize(("dampings", "delays", "ratio"), PAIRS)
    @pytest.mark.parametrize("damping", [0.0, 0.3, -0.3])
    def test_a_shaft_needs_what_its_worst_motion_needs(
        self, dampings: tuple[float, float], delays: tuple[float, float], ratio: float, damping: float
    ) -> None:
        def force(now: Array, before: Array) -> Array:
            twist, rate = (part[0] - ratio * part[1] for part in (now, (now - before) / PERIOD))
            torque = -250.0 * twist - damping * rate
            return np.array([torque, -ratio * torque])

        expected = self.share(dampings, delays, force)
        found = damping_share(shaft(damping, ratio)(250.0), ports(dampings, delays), PERIOD)
        assert found == pytest.approx(expected, rel=8e-3)

    @pytest.mark.thorough("searches for the worst motion of 5 shafts", quick=1)
    @pytest.mark.parametrize(("dampings", "delays", "ratio"), PAIRS)
    def test_so_does_a_shaft_between_handles_with_walls_of_their_own(
        self, dampings: tuple[float, float], delays: tuple[float, float], ratio: float
    ) -> None:
        def force(now: Array, before: Array) -> Array:
            torque = -250.0 * (now[0] - ratio * now[1])
            return np.array([torque - 90.0 * now[0], -ratio * torque - 40.0 * now[1]])

        loop = parallel([shaft(0.0, ratio)(250.0), embedded(wall(90.0), 0, 2), embedded(wall(40.0), 1, 2)])
        found = damping_share(loop, ports(dampings, delays), PERIOD)
        assert found == pytest.approx(self.share(dampings, delays, force), rel=8e-3)


class TestAgainstTheFormula:
    ANGLE = np.linspace(1e-4, math.pi, 20_001)

    @pytest.mark.thorough("sweeps the frequencies of 30 shafts", quick=6)
    @pytest.mark.parametrize(("dampings", "delays", "ratio"), PAIRS)
    @pytest.mark.parametrize("lag", [0.0, LAG, 2 * PERIOD])
    @pytest.mark.parametrize("damping", [0.0, 0.3])
    def test_with_its_share_the_hermitian_form_touches_zero(
        self, dampings: tuple[float, float], delays: tuple[float, float], ratio: float, lag: float, damping: float
    ) -> None:
        """M(θ) = b − ½·(P·H + H*·P*) − H*·S/(4·b)·H by brute force, H written out."""
        g, z = np.array([1.0, -ratio]), np.exp(1j * self.ANGLE)
        scalar = -(250.0 + damping * (1 - 1 / z) / PERIOD)
        force = scalar[:, None, None] * np.outer(g, g)
        adjoint = force.conj().swapaxes(1, 2)
        share = damping_share(shaft(damping, ratio)(250.0), ports(dampings, delays, lag), PERIOD)
        least = []
        for part in (share, 0.999 * share):
            form = np.zeros_like(force) + part * np.diag(dampings)
            for i, delay in enumerate(delays):
                behind = hold(self.ANGLE, PERIOD, delay * PERIOD, lag)
                form[:, i, :] -= 0.5 * behind.displacement[:, None] * force[:, i, :]
                form[:, :, i] -= 0.5 * behind.displacement.conj()[:, None] * adjoint[:, :, i]
                weight = behind.spread / (4 * part * dampings[i])
                form -= weight[:, None, None] * adjoint[:, :, i : i + 1] * force[:, i : i + 1, :]
            least.append(np.linalg.eigvalsh(form)[:, 0].min() / min(dampings))
        assert least[0] == pytest.approx(0.0, abs=1e-6)
        assert least[1] < -1e-5

    @pytest.mark.parametrize("damping", [0.0, 0.5, -0.5])
    @pytest.mark.parametrize("ratio", [1.0, 0.1, -3.0])
    def test_without_delay_a_shaft_needs_what_colgate_and_schenkel_ask_of_one_device(
        self, damping: float, ratio: float
    ) -> None:
        """K·T/2 + |B| ≤ 1/(1/b1 + n²/b2)"""
        expected = (250.0 * PERIOD / 2 + abs(damping)) * (1 / 1.5 + ratio**2 / 0.4)
        found = damping_share(shaft(damping, ratio)(250.0), ports((1.5, 0.4), (0.0, 0.0)), PERIOD)
        assert found == pytest.approx(expected, rel=1e-9)

    @every("delay", DELAYS)
    @every("lag", [0.0, LAG])
    @every("ratio", [1.0, 0.1, -3.0])
    def test_with_equal_delays_a_shaft_is_one_device_of_the_dampings_in_series(
        self, delay: float, lag: float, ratio: float
    ) -> None:
        one = 1 / (1 / 1.5 + ratio**2 / 0.4)
        needed = damping_needed(wall(250.0, 0.2), PERIOD, delay * PERIOD, lag)
        share = damping_share(shaft(0.2, ratio)(250.0), ports((1.5, 0.4), (delay, delay), lag), PERIOD)
        assert share == pytest.approx(needed / one, rel=1e-9)

    @pytest.mark.parametrize("delay", DELAYS)
    def test_axes_that_nothing_couples_need_what_the_needier_needs(self, delay: float) -> None:
        loop = parallel([embedded(wall(300.0, 0.1), 0, 2), embedded(wall(100.0), 1, 2)])
        expected = max(
            damping_needed(wall(300.0, 0.1), PERIOD, delay * PERIOD) / 1.5,
            damping_needed(wall(100.0), PERIOD, 0.0) / 0.4,
        )
        assert damping_share(loop, ports((1.5, 0.4), (delay, 0.0)), PERIOD) == pytest.approx(expected, rel=1e-9)


class TestWhatNoDampingIsEnoughFor:
    BOTH = ports((1.5, 0.4), (0.0, 1.0))

    def share(self, loop: StateSpace) -> float:
        return damping_share(loop, self.BOTH, PERIOD)

    def test_a_device_without_damping_in_a_coupling(self) -> None:
        assert damping_share(shaft()(1e-6), ports((1.5, 0.0), (0.0, 0.0)), PERIOD) == math.inf

    def test_but_one_that_the_coupling_leaves_alone_needs_none(self) -> None:
        free = damping_share(embedded(wall(300.0), 0, 2), ports((1.5, 0.0), (0.0, 0.3)), PERIOD)
        assert free == pytest.approx(300.0 * PERIOD / 2 / 1.5)
        assert damping_share(gain([[0.0, 0.0], [0.0, 0.0]]), ports((0.0, 0.0), (0.0, 0.0)), PERIOD) == 0.0

    @pytest.mark.parametrize("back", [0.0, 0.999999, -1.0])
    def test_a_coupling_that_gives_back_less_than_it_takes(self, back: float) -> None:
        """A follower without feedback: going around a loop in (x1, x2) gives energy, the more the slower."""
        assert self.share(gain([[-100.0, 100.0 * back], [100.0, -100.0]])) == math.inf

    def test_a_spring_that_pushes_apart(self) -> None:
        assert self.share(gain([[100.0, -100.0], [-100.0, 100.0]])) == math.inf
        assert not stores(gain([[-1.0, -2.0], [-2.0, -1.0]]))
        assert stores(gain([[-2.0, 1.0], [1.0, -2.0]]))

    @pytest.mark.parametrize("ratio", [-2.5, 0.4, 3.3, 30.0])
    def test_but_not_a_soft_spring_beside_a_damper_whose_terms_cancel_at_rest(self, ratio: float) -> None:
        damping = 0.1 / (1.0 + ratio**2)
        assert self.share(shaft(damping, ratio)(1e-9 * damping)) == pytest.approx(
            self.share(shaft(damping, ratio)(0.0)), rel=1e-6
        )

    def test_an_undamped_virtual_mass(self) -> None:
        assert self.share(embedded(sprung_mass(0.5, "exact-foh")(100.0), 0, 2)) == math.inf
