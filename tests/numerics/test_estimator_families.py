"""Each family of estimators against an oracle of its own."""

import itertools
import math

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.margins import stiffness_limit
from haptic_fieldbus.numerics.estimators import bind, discrete
from haptic_fieldbus.numerics.estimators.differences import POLES
from haptic_fieldbus.numerics.estimators.kalman import acceleration_gains, velocity_gains
from haptic_fieldbus.numerics.estimators.levant import ROOT_GAIN, SIGN_GAIN
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.numerics.transfer import transfer_function
from tests.lanes import examples
from tests.loops import BENCH
from tests.numerics.estimator_figures import measured_delay, measured_noise_gain

PERIOD = 1e-3
COUNT = 0.05 / 4096
WALK = st.lists(st.floats(-2e-5, 2e-5), min_size=1, max_size=60)


def in_counts(position: float) -> float:
    return COUNT * math.floor(position / COUNT)


def test_the_backward_difference_is_the_way_made_over_the_period() -> None:
    step = bind("backward-difference", 0.5)
    assert [step(position) for position in (1.0, 2.0, 2.0, -1.0)] == [0.0, 2.0, 0.0, -6.0]


class TestFilteredDerivative:
    @pytest.mark.parametrize(("mapping", "scipys", "alpha"), [
        ("forward", "gbt", 0.0), ("backward", "gbt", 1.0), ("trapezoidal", "bilinear", None), ("exact", "foh", None),
    ])  # fmt: skip
    @pytest.mark.parametrize("tau", [0.0007, 0.002, 0.1])
    def test_is_s_over_tau_s_plus_1_as_scipy_maps_it(
        self, mapping: str, scipys: str, alpha: float | None, tau: float
    ) -> None:
        num, den, _ = scipy.signal.cont2discrete(([1.0, 0.0], [tau, 1.0]), PERIOD, method=scipys, alpha=alpha)
        system = discrete(f"filtered-derivative:tau={tau},mapping={mapping}", PERIOD)
        assert system is not None
        ours = transfer_function(system)
        for z in np.exp(1j * np.array([0.01, 0.5, 3.0])):
            assert ours(z) == pytest.approx(np.polyval(num[0], z) / np.polyval(den, z), rel=1e-10)

    @pytest.mark.thorough("4 cases of one rule", quick=1)
    @pytest.mark.parametrize("mapping", POLES)
    def test_the_lectures_noise_is_filtered_as_the_continuous_filter_does_it(self, mapping: str) -> None:
        """y = sin t + 0.1·sin 10t: the tenth of noise is as large as the signal once differentiated."""
        tau, times = 0.3, np.arange(0.0, 60.0, PERIOD)
        step = bind(f"filtered-derivative:tau={tau},mapping={mapping}", PERIOD)
        raw = bind("backward-difference", PERIOD)
        noisy = np.sin(times) + 0.1 * np.sin(10.0 * times)
        for estimate, noise in ((raw, 1.0), (step, 1.0 / math.hypot(1.0, 10.0 * tau))):
            found = np.array([estimate(y) for y in noisy.tolist()])[-round(2 * math.pi / PERIOD) * 4 :]
            at = times[-len(found) :]
            basis = np.stack([np.cos(10.0 * at), np.sin(10.0 * at), np.cos(at), np.sin(at)], axis=-1)
            fitted = np.linalg.lstsq(basis, found, rcond=None)[0]
            assert math.hypot(*fitted[:2]) == pytest.approx(noise, rel=5e-3)


class TestLeastSquares:
    @pytest.mark.parametrize(("window", "order"), [(2, 1), (8, 1), (8, 2), (15, 3), (30, 4)])
    def test_is_the_slope_of_numpys_polynomial_at_the_newest(self, window: int, order: int) -> None:
        rng = np.random.default_rng(3)
        positions = 5.0 + np.cumsum(rng.normal(0, 1e-4, 80))
        step = bind(f"least-squares:window={window},order={order}", PERIOD)
        found = [step(x) for x in positions.tolist()]
        for newest in range(window, 80):
            recent = positions[newest - window + 1 : newest + 1]
            fitted = np.polynomial.Polynomial.fit(np.arange(1 - window, 1) * PERIOD, recent - 5.0, order)
            assert found[newest] == pytest.approx(fitted.deriv()(0.0), rel=1e-8, abs=1e-9)

    def test_a_parabola_is_not_late_for_order_two(self) -> None:
        step = bind("least-squares:window=9,order=2", PERIOD)
        found = [step(0.5 * 3.0 * (n * PERIOD) ** 2) for n in range(100)]
        assert found[-1] == pytest.approx(3.0 * 99 * PERIOD, rel=1e-9)


class TestFoaw:
    @staticmethod
    def by_definition(recent: list[float], band: float, best: bool, longest: int) -> float:
        """Try each window in turn, newest first, every sample of it against the line; the last that passes."""
        slope = (recent[0] - recent[1]) / PERIOD
        for length in range(1, min(longest, len(recent) - 1) + 1):
            samples = np.array(recent[: length + 1])
            times = -np.arange(length + 1) * PERIOD
            tried = float(np.polyfit(times, samples - samples[0], 1)[0]) if best else (
                (samples[0] - samples[-1]) / (length * PERIOD)
            )  # fmt: skip
            if np.abs(samples[0] + tried * times - samples).max() > band:
                break
            slope = tried
        return slope

    @settings(derandomize=True, max_examples=examples(60))
    @given(ways=WALK, best=st.booleans())
    def test_is_the_last_window_before_the_first_that_leaves_the_band(self, ways: list[float], best: bool) -> None:
        band, longest = 1.234567e-5, 12
        step = bind(f"foaw-{'best' if best else 'end'}-fit:window={longest},band={band}", PERIOD)
        before = [0.3] * (longest + 1)
        step(0.3)
        for position in (0.3 + np.cumsum(ways)).tolist():
            before = [position, *before[:longest]]
            assert step(position) == pytest.approx(self.by_definition(before, band, best, longest), rel=1e-6, abs=1e-8)

    @pytest.mark.thorough("2 cases of one rule", quick=1)
    @pytest.mark.parametrize("fit", ["foaw-end-fit", "foaw-best-fit"])
    def test_slow_motions_have_less_noise_and_fast_ones_less_delay_than_a_fixed_window(self, fit: str) -> None:
        slow = [in_counts(0.002 * n * PERIOD) for n in range(3000)]
        plain, adaptive = bind("backward-difference", PERIOD), bind(fit, PERIOD, COUNT)
        errors = [np.std([step(x) for x in slow][100:]) for step in (plain, adaptive)]
        assert errors[1] < errors[0] / 5
        assert measured_delay(bind(fit, PERIOD, COUNT), PERIOD, COUNT, speed=0.02, acceleration=20.0) < 2.5 * PERIOD
        assert measured_delay(bind("moving-average:window=16", PERIOD), PERIOD, COUNT, 0.02, 20.0) > 7 * PERIOD

    @pytest.mark.thorough("8 cases of one rule", quick=3)
    @pytest.mark.parametrize("fit", ["foaw-end-fit", "foaw-best-fit"])
    @pytest.mark.parametrize("damping", [2.0, 20.0, 100.0, 400.0])
    def test_no_window_of_it_has_a_lower_limit_of_stability_than_the_one_it_is_judged_by(
        self, fit: str, damping: float
    ) -> None:
        """Else the verdict on the loop would promise too much."""
        linear = "moving-average:window={}" if fit == "foaw-end-fit" else "least-squares:window={}"
        windows = [linear.format(length + (fit == "foaw-best-fit")) for length in (1, 2, 4, 8)]
        limits = [self.limit(estimator, damping) for estimator in windows]
        assert self.limit(fit, damping) <= min(limits)

    @staticmethod
    def limit(estimator: str, damping: float) -> float:
        def contact(stiffness: float) -> StateSpace:
            return environment(gain([[-stiffness, -damping]]), period=PERIOD, method=None, estimator=estimator)

        return stiffness_limit(BENCH, PERIOD, 0.4e-3, contact)

    @pytest.mark.thorough("2 cases of one rule", quick=1)
    @pytest.mark.parametrize("fit", ["foaw-end-fit", "foaw-best-fit"])
    def test_noise_within_the_band_is_that_of_the_longest_window(self, fit: str) -> None:
        """A band wide enough: √2/(16·T) for the chord, the least squares of 17 positions for the slope."""
        theory = math.sqrt(2.0) / 16 if fit == "foaw-end-fit" else math.sqrt(12.0 / (17 * (17**2 - 1)))
        found = measured_noise_gain(bind(f"{fit}:band=1", PERIOD), 1e-5, 12_000) * PERIOD
        assert found == pytest.approx(theory, rel=0.05)


class TestKalman:
    @pytest.mark.parametrize("index", [1e-5, 0.01, 0.1, 1.0, 30.0])
    @pytest.mark.parametrize("states", [2, 3])
    def test_gains_are_those_of_the_riccati_equation(self, index: float, states: int) -> None:
        f = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])[:states, :states]
        noise, h = np.array([[0.5], [1.0], [1.0]])[:states], np.eye(1, states)
        p = scipy.linalg.solve_discrete_are(f.T, h.T, index**2 * noise @ noise.T, np.eye(1))
        expected = (p @ h.T / (h @ p @ h.T + 1.0)).ravel()
        found = (velocity_gains if states == 2 else acceleration_gains)(index)
        np.testing.assert_allclose(found[:states], expected, rtol=1e-6)

    def test_a_large_index_trusts_the_encoder_only(self) -> None:
        """Then a constant-velocity filter has v ← (x − x_before)·2 − v: twice the mean speed, less that of before."""
        alpha, beta, _ = velocity_gains(1e6)
        assert (alpha, beta) == pytest.approx((1.0, 2.0), rel=1e-2)

    @pytest.mark.thorough("filters a long signal many times")
    def test_it_does_better_than_any_low_pass_on_what_it_is_made_for(self) -> None:
        """A random acceleration from period to period, seen through an encoder."""
        rng, index = np.random.default_rng(5), 0.1
        sigma = COUNT / math.sqrt(12.0)
        accelerations = rng.normal(0, index * sigma / PERIOD**2, 20_000)
        speeds = np.cumsum(accelerations) * PERIOD
        positions = np.cumsum(speeds) * PERIOD - 0.5 * accelerations * PERIOD**2
        measured = (positions + rng.normal(0, sigma, len(positions))).tolist()

        def error(spec: str) -> float:
            step = bind(spec, PERIOD)
            return float(np.sqrt(np.mean((np.array([step(x) for x in measured]) - speeds)[200:] ** 2)))

        ours = error(f"kalman-velocity:index={index}")
        assert ours < min(error(f"low-pass:pole={pole}") for pole in (0.0, 0.5, 0.7, 0.8, 0.85, 0.9, 0.95))
        assert ours < min(error(f"least-squares:window={window}") for window in (2, 4, 8, 12, 16))


class TestLevant:
    @settings(derandomize=True, max_examples=examples(60))
    @given(ways=WALK)
    def test_each_step_solves_the_implicit_inclusion(self, ways: list[float]) -> None:
        """e = b − T·λ1·√L·√|e|·ξ − T²·λ0·L·ξ with ξ in Sgn(e), and v′ = v − T·λ0·L·ξ."""
        bound = 4.0
        step = bind(f"levant:lipschitz={bound}", PERIOD)
        step(0.0)
        x, v = 0.0, 0.0
        for position in np.cumsum(ways).tolist():
            after = step(position)
            chosen = (v - after) / (PERIOD * SIGN_GAIN * bound)
            ahead = x + PERIOD * v - position
            assert abs(chosen) <= 1.0 + 1e-9
            if abs(chosen) < 1.0 - 1e-9:
                error = 0.0
                assert ahead == pytest.approx(PERIOD**2 * SIGN_GAIN * bound * chosen, rel=1e-6, abs=1e-15)
            else:
                rest = abs(ahead) - PERIOD**2 * SIGN_GAIN * bound
                half = 0.5 * PERIOD * ROOT_GAIN * math.sqrt(bound)
                root = float(np.roots([1.0, 2 * half, -max(rest, 0.0)]).max())
                error = math.copysign(root**2, ahead)
                assert abs(error) + 2 * half * root == pytest.approx(rest, rel=1e-6, abs=1e-15)
            x, v = position + error, after

    def test_below_the_bound_the_error_is_that_of_one_period(self) -> None:
        """Exact but for the sampling: late by half a period at any acceleration below L."""
        step = bind("levant:lipschitz=10", PERIOD)
        times = np.arange(3000) * PERIOD
        found = np.array([step(x) for x in (0.1 * np.sin(9.0 * times)).tolist()])
        assert np.abs(found - 0.9 * np.cos(9.0 * times))[500:].max() < 8.1 * PERIOD * 0.55

    def test_the_velocity_never_changes_faster_than_the_bound(self) -> None:
        """That is how it filters counts: a jump of the encoder moves the velocity by λ0·L·T at most."""
        step = bind("levant:lipschitz=5", PERIOD, COUNT)
        found = [step(in_counts(0.013 * n * PERIOD)) for n in range(2000)]
        assert max(abs(b - a) for a, b in itertools.pairwise(found)) <= SIGN_GAIN * 5 * PERIOD * (1 + 1e-9)
        assert np.std(found[200:]) < 0.5 * COUNT / PERIOD

    def test_it_does_not_chatter(self) -> None:
        step = bind("levant:lipschitz=50", PERIOD)
        found = [step(0.4 * n * PERIOD) for n in range(500)]
        assert np.ptp(found[200:]) < 1e-9


class TestTickInterval:
    def test_a_slow_speed_is_seen_between_counts_where_a_difference_sees_spikes(self) -> None:
        speed = 0.7e-3
        slow = [in_counts(speed * n * PERIOD) for n in range(2000)]
        ticks, plain = bind("tick-interval", PERIOD, COUNT), bind("backward-difference", PERIOD)
        found, spikes = [ticks(x) for x in slow][200:], [plain(x) for x in slow][200:]
        assert np.abs(np.array(found) / speed - 1).max() < PERIOD * speed / COUNT * 1.5
        assert max(spikes) == pytest.approx(COUNT / PERIOD)
        assert min(spikes) == 0.0

    def test_while_no_count_comes_the_speed_is_bounded_by_one_count_over_the_wait(self) -> None:
        step = bind("tick-interval", PERIOD, COUNT)
        step(0.0)
        step(5 * COUNT)
        found = [step(5 * COUNT) for _ in range(10)]
        np.testing.assert_allclose(found, COUNT / (PERIOD * np.arange(1, 11)), rtol=1e-9)

    def test_without_a_known_count_the_last_way_bounds_it(self) -> None:
        step = bind("tick-interval", PERIOD)
        step(0.0)
        step(0.4)
        assert [step(0.4) for _ in range(4)][-1] == pytest.approx(0.1 / PERIOD)

    def test_a_count_taken_back_is_no_way(self) -> None:
        """A handle that trembles on the edge of a count stands."""
        step = bind("tick-interval", PERIOD, COUNT)
        step(0.0)
        step(COUNT)
        assert [step(COUNT * (n % 2)) for n in range(6)] == [0.0] * 6

    def test_a_jittered_sample_is_no_speed_when_its_time_is_given(self) -> None:
        """One encoder count a nominal period, the samples up to 30 % early or late."""
        rng = np.random.default_rng(1)
        times_ns = np.arange(500) * 1e6 + rng.uniform(-3e5, 3e5, 500)
        speed = 0.3
        step, plain = bind("tick-interval", PERIOD, COUNT), bind("backward-difference", PERIOD)
        found = [step(speed * t * 1e-9, t) for t in times_ns.tolist()][2:]
        assert found == pytest.approx([speed] * 498, rel=1e-9)
        assert np.ptp([plain(speed * t * 1e-9) for t in times_ns.tolist()][2:]) > 0.2 * speed

    def test_a_clock_that_stands_or_goes_backwards_gives_no_infinite_speed(self) -> None:
        step = bind("tick-interval", PERIOD, COUNT)
        step(0.0, 0.0)
        moving = step(0.001, 1e6)
        assert [step(0.002, 1e6), step(0.003, 0.5e6), step(0.003, 0.4e6)] == [moving] * 3
