"""Coupled axes against a loop written out by hand, the loop of one axis, and transfer functions."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, sample
from haptic_fieldbus.margins.bodies import HungBody, sample_with
from haptic_fieldbus.margins.coupled import CoupledAxes
from haptic_fieldbus.numerics import coupled, sampled
from haptic_fieldbus.numerics.coupled import embedded, environment, shift_modes, spring_damper
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.numerics.passivity import frequency_response, frequency_responses
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from tests.loops import BENCH, DELAYS, LAG, PERIOD, sprung_mass, wall, with_damping
from tests.pairs import ESTIMATORS, PairByHand, shaft

LAGGING = replace(BENCH, torque_lag=LAG)
PAIRS = [
    PairByHand((BENCH, BENCH), (0.0, 0.0)),
    PairByHand((LAGGING, BENCH), (0.33, 0.33), damping=0.4),
    PairByHand((LAGGING, Plant(0.05, 0.8)), (0.33, 1.7), damping=0.4, ratio=0.3),
    PairByHand((Plant(2.0, 0.1), Plant(0.05, 0.8, torque_lag=2 * PERIOD)), (2.0, 0.5), ratio=-2.5),
    PairByHand((Plant(1e-3, 3.0), LAGGING), (1.0, 0.0), damping=-0.1, ratio=10.0),
    PairByHand((LAGGING, Plant(0.05, 0.8)), (0.5, 2.7), damping=0.4, ratio=2.0, wall=900.0),
]


def devices(pair: PairByHand) -> list[sampled.SampledPlant]:
    return [sample(axis.plant, PERIOD, axis.delay) for axis in pair.axes()]


class TestLoopMatrix:
    @pytest.mark.parametrize("pair", PAIRS, ids=range(len(PAIRS)))
    @pytest.mark.parametrize("stiffness", [0.0, 30.0, 2000.0])
    def test_has_the_characteristic_polynomial_of_the_loop_written_by_hand(
        self, pair: PairByHand, stiffness: float
    ) -> None:
        """Polynomials, as double eigenvalues have half their digits only; both have more states at 0."""
        loop = CoupledAxes(pair.axes(), PERIOD).together(shaft(pair.damping, pair.ratio)(stiffness))
        ours, by_hand = (
            np.trim_zeros(np.where(np.abs(found) < 1e-9, 0.0, found), "b")
            for found in (np.poly(coupled.loop_matrix(devices(pair), loop)), np.poly(pair.period_map(stiffness)))
        )
        length = max(len(ours), len(by_hand))
        ours, by_hand = (np.pad(found, (0, length - len(found))) for found in (ours, by_hand))
        np.testing.assert_allclose(ours, by_hand, atol=1e-8 * np.abs(by_hand).max())

    @pytest.mark.parametrize("delay", DELAYS)
    def test_of_one_axis_is_that_of_the_scalar_loop(self, delay: float) -> None:
        plant, environment_of_one = sample(LAGGING, PERIOD, delay * PERIOD), wall(700.0, 1.1)
        np.testing.assert_array_equal(
            coupled.loop_matrix([plant], environment_of_one), sampled.loop_matrix(plant, environment_of_one)
        )

    @pytest.mark.parametrize("delay", DELAYS)
    def test_of_three_axes_that_nothing_couples_has_the_modes_of_each(self, delay: float) -> None:
        plants = [sample(plant, PERIOD, delay * PERIOD) for plant in (BENCH, Plant(0.05, 0.8), Plant(2.0, 3.0))]
        walls = [wall(stiffness, 0.3) for stiffness in (100.0, 500.0, 900.0)]
        all_walls = parallel([embedded(one, place, 3) for place, one in enumerate(walls)])
        expected = max(sampled.growth(plant, one) for plant, one in zip(plants, walls, strict=True))
        assert coupled.growth(plants, all_walls) == pytest.approx(expected, abs=1e-12)


class TestGrowth:
    @pytest.mark.parametrize("pair", PAIRS, ids=range(len(PAIRS)))
    @pytest.mark.parametrize("stiffness", [1.0, 300.0, 5000.0])
    def test_is_that_of_the_loop_written_by_hand(self, pair: PairByHand, stiffness: float) -> None:
        loop = CoupledAxes(pair.axes(), PERIOD).together(shaft(pair.damping, pair.ratio)(stiffness))
        assert coupled.growth(devices(pair), loop) == pytest.approx(pair.growth(stiffness), abs=1e-9)

    @pytest.mark.parametrize("delay", DELAYS)
    @pytest.mark.parametrize("stiffness", [10.0, 900.0, 4000.0])
    def test_of_equal_axes_is_that_of_one_at_twice_the_coupling_or_of_a_free_one(
        self, delay: float, stiffness: float
    ) -> None:
        plant = sample(LAGGING, PERIOD, delay * PERIOD)
        difference, mean = (sampled.growth(plant, wall(2 * part * stiffness, 2 * part * 0.4)) for part in (1.0, 0.0))
        found = coupled.growth([plant, plant], shaft(0.4)(stiffness))
        assert found == pytest.approx(max(difference, mean), abs=1e-11)

    @pytest.mark.parametrize("ratio", [0.2, 1.0, -3.0])
    def test_of_a_virtual_shaft_with_a_mass_inside_is_below_one(self, ratio: float) -> None:
        """x1 – spring – virtual mass – spring – n·x2: the modes of the map, the shift left out by hand."""
        plants = [sample(plant, PERIOD, delay) for plant, delay in ((BENCH, 3e-4), (Plant(0.3, 4.0), 0.0))]
        loop = environment(_sprung_shaft(ratio), period=PERIOD, method="exact-foh", estimators=(None, None))
        modes = np.linalg.eigvals(coupled.loop_matrix(plants, loop))
        nearest = int(np.argmin(np.abs(modes - 1.0)))
        assert modes[nearest] == pytest.approx(1.0, abs=1e-10)
        expected = float(np.abs(np.delete(modes, nearest)).max())
        assert coupled.growth(plants, loop) == pytest.approx(expected, abs=1e-10)
        assert expected < 1.0 - 1e-5


class TestShiftModes:
    PLANTS = (sample(BENCH, PERIOD, 3e-4), sample(Plant(0.05, 0.8, torque_lag=LAG), PERIOD, 1.2e-3))

    @pytest.mark.parametrize("ratio", [1.0, 0.25, -4.0, 1e-4, 1e4])
    @pytest.mark.parametrize("stiffness", [1e-6, 1.0, 1e9])
    def test_both_ends_of_a_shaft_may_be_turned_alike(self, ratio: float, stiffness: float) -> None:
        directions, _ = shift_modes(self.PLANTS, shaft(0.3, ratio)(stiffness))
        assert directions.shape == (2, 1)
        assert directions[0, 0] == pytest.approx(ratio * directions[1, 0])

    def test_a_damper_and_no_coupling_at_all_leave_each_handle_anywhere(self) -> None:
        for damping in (0.0, 2.0):
            assert shift_modes(self.PLANTS, shaft(damping)(0.0))[0].shape == (2, 2)
            assert coupled.growth(self.PLANTS, shaft(damping)(0.0)) < 1.0 - 1e-4

    @pytest.mark.parametrize(("held", "ratio"), [(1e-3, 1.0), (1.0, -3.0), (1e6, 1.0), (1e12, 1.0), (1e-3, 1e6)])
    def test_a_wall_on_one_end_holds_both(self, held: float, ratio: float) -> None:
        """However soft beside the shaft: what counts is that nothing cancels it."""
        pair = PairByHand((BENCH, BENCH), (0.0, 0.0), wall=held)
        assert shift_modes(self.PLANTS, CoupledAxes(pair.axes(), PERIOD).together(shaft(0.0, ratio)(50.0)))[
            0
        ].shape == (2, 0)

    def test_a_device_on_a_spring_holds_what_it_is_tied_to(self) -> None:
        anchored = sample_with(BENCH, [HungBody(mass=0.4, stiffness=2e4, anchor=500.0)], PERIOD, 0.0)
        plants = [anchored, self.PLANTS[0]]
        assert shift_modes(plants, shaft()(50.0))[0].shape == (2, 0)
        directions, _ = shift_modes(plants, shaft()(0.0))
        np.testing.assert_allclose(np.abs(directions), [[0.0], [1.0]], atol=1e-12)
        alone = max(sampled.spectral_radius(anchored.transition), sampled.growth(plants[1], wall(0.0)))
        assert coupled.growth(plants, shaft()(0.0)) == pytest.approx(alone, abs=1e-12)

    def test_an_environment_follows_its_handles(self) -> None:
        loop = environment(_sprung_shaft(2.0), period=PERIOD, method="exact-zoh", estimators=(None, None))
        directions, states = shift_modes(self.PLANTS, loop)
        np.testing.assert_allclose(states / directions[0], [[1.0], [0.0]], atol=1e-9)

    @pytest.mark.parametrize("name", ["backward-difference", "low-pass:pole=0.7", "least-squares"])
    def test_a_spring_that_yields_in_time_leaves_each_handle_anywhere(self, name: str) -> None:
        """Spring and damper in series, its state the spring's own stretch: at rest 0, but for rounding."""
        space = StateSpace(
            np.array([[-50.0]]), np.array([[0.0, 1.0, 0.0, -1.0]]), np.array([[-3e4], [3e4]]), np.zeros((2, 4))
        )
        loop = environment(space, period=PERIOD, method="forward-euler", estimators=(name, name))
        assert shift_modes(self.PLANTS, loop)[0].shape == (2, 2)

    def test_a_coupling_that_adds_up_the_twist_has_no_more_shifts_than_a_spring(self) -> None:
        """F = ∓∑(x1 − x2): at rest by itself, but not while it is twisted."""
        one = np.eye(1)
        added = StateSpace(one, np.array([[1.0, -1.0]]), np.array([[-0.01], [0.01]]), np.zeros((2, 2)))
        directions, _ = shift_modes(self.PLANTS, added)
        np.testing.assert_allclose(directions / directions[0], [[1.0], [1.0]], atol=1e-12)


class TestEnvironment:
    def test_a_shaft_pulls_both_ends_together(self) -> None:
        """F1 = −K·(x1 − n·x2) − B·(v1 − n·v2), F2 = −n·F1, velocities by differences."""
        found = shaft(0.7, 3.0)(40.0)
        state, before = np.zeros(found.order), np.zeros(2)
        for x in np.array([[0.1, 0.3], [-0.2, 0.4], [0.5, 0.5]]):
            twist, rate = (part[0] - 3.0 * part[1] for part in (x, (x - before) / PERIOD))
            np.testing.assert_allclose(found.c @ state + found.d @ x, (-40.0 * twist - 0.7 * rate) * np.array([1, -3]))
            state, before = found.a @ state + found.b @ x, x

    def test_without_damping_there_is_no_estimator_in_it(self) -> None:
        found = environment(spring_damper(40.0), period=PERIOD, method=None, estimators=(None, None))
        np.testing.assert_array_equal(found.d, [[-40.0, 40.0], [40.0, -40.0]])
        assert found.order == 0

    @pytest.mark.parametrize("method", ["exact-foh", "forward-euler", "verlet"])
    def test_on_one_axis_it_is_that_of_the_scalar_loop(self, method: str) -> None:
        space = StateSpace(
            np.array([[0.0, 1.0], [-900.0, -20.0]]), np.array([[0.0, 0.0], [900.0, 20.0]]),
            np.array([[450.0, 10.0]]), np.array([[-450.0, -10.0]]),
        )  # fmt: skip
        name = "low-pass:pole=0.7"
        angle = np.linspace(0.01, 3.0, 7)
        one = sampled.environment(space, period=PERIOD, method=method, estimator=name)
        same = environment(space, period=PERIOD, method=method, estimators=(name,))
        both = environment(embedded(space, 1, 2), period=PERIOD, method=method, estimators=(None, name))
        expected = frequency_response(one, angle)
        np.testing.assert_allclose(frequency_response(same, angle), expected, rtol=1e-12)
        found = frequency_responses(both, angle)
        np.testing.assert_allclose(found[:, 1, 1], expected, rtol=1e-12)
        found[:, 1, 1] = 0.0
        np.testing.assert_array_equal(found, np.zeros_like(found))

    def test_each_velocity_is_that_of_its_own_estimator(self) -> None:
        names = ("backward-difference", "moving-average:window=4")
        found = environment(spring_damper(0.0, 1.0), period=PERIOD, method=None, estimators=names)
        z = np.exp(0.4j)
        first, second = (1 - 1 / z) / PERIOD, (1 - z**-4) / (4 * PERIOD)
        expected = np.array([[-first, second], [first, -second]])
        np.testing.assert_allclose(frequency_responses(found, np.array([0.4]))[0], expected, rtol=1e-12)

    def test_virtual_states_without_a_method_are_refused(self) -> None:
        space = embedded(SprungMass("handle", 600.0, 0.5).dynamics, 0, 2)
        with pytest.raises(UsageError, match="integrator"):
            environment(space, period=PERIOD, method=None, estimators=(None, None))

    def test_velocity_without_an_estimator_is_refused(self) -> None:
        with pytest.raises(UsageError, match="estimator on each"):
            environment(spring_damper(1.0, 1.0), period=PERIOD, method=None, estimators=(ESTIMATORS[0], None))

    def test_a_part_of_one_axis_acts_on_that_axis_alone(self) -> None:
        found = embedded(gain([[-3.0, -2.0]]), 1, 3)
        np.testing.assert_array_equal(found.d, [[0.0] * 6, [0.0, 0.0, -3.0, -2.0, 0.0, 0.0], [0.0] * 6])
        follower = embedded(sprung_mass(0.5, "exact-foh")(100.0), 0, 2)
        assert (follower.b.shape, follower.c.shape, follower.d.shape) == ((2, 2), (2, 2), (2, 2))
        np.testing.assert_array_equal(embedded(with_damping(0.2)(5.0), 0, 1).d, wall(5.0, 0.2).d)


def _sprung_shaft(ratio: float) -> StateSpace:
    """A virtual mass of 0.2 kg between a spring to x1 and one to n·x2."""
    stiffness, mass = 200.0, 0.2
    pull = stiffness * np.array([[1.0, 0.0, ratio, 0.0]])
    a = np.array([[0.0, 1.0], [-2 * stiffness / mass, -1.0 / mass]])
    c = stiffness * np.array([[1.0, 0.0], [ratio, 0.0]])
    d = -stiffness * np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, ratio**2, 0.0]])
    b = np.vstack([np.zeros((1, 4)), pull / mass])
    return StateSpace(a, b, c, d)
