"""Estimates from a recorded signal, against scipy's filters and closed forms."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from haptic_fieldbus.api.estimation import Estimation, SignalRequest, estimate_from
from haptic_fieldbus.errors import DocumentError, UsageError
from haptic_fieldbus.numerics.estimators import ESTIMATORS, bind

Array = NDArray[np.float64]
PERIOD = 0.01
TIMES: Array = PERIOD * np.arange(400.0)


def estimated(folder: Path, quantity: str, values: Array, spec: str | None = None, times: Array = TIMES) -> Estimation:
    path = folder / "signal.csv"
    rows = zip(times.tolist(), values.tolist(), strict=True)
    path.write_text(f"time,{quantity}\n" + "".join(f"{time!r},{value!r}\n" for time, value in rows))
    return estimate_from(SignalRequest(file=path, estimator=spec))


@pytest.fixture
def noise() -> Array:
    return np.random.default_rng(2).normal(size=len(TIMES))


@pytest.mark.parametrize(
    ("spec", "numerator", "denominator"),
    [
        ("backward-difference", [1.0], [1.0]),
        ("moving-average:window=5", [0.2] * 5, [1.0]),
        ("low-pass:pole=0.7", [0.3], [1.0, -0.7]),
        ("low-pass:pole=0.7,order=2", [0.09], [1.0, -1.4, 0.49]),
        ("filtered-derivative:tau=0.03,mapping=backward", [0.25], [1.0, -0.75]),
    ],
)
class TestFirAndIirFilters:
    def test_positions_give_the_filtered_difference(
        self, spec: str, numerator: list[float], denominator: list[float], noise: Array, tmp_path: Path
    ) -> None:
        found = estimated(tmp_path, "position", noise, spec).estimate
        expected = signal.lfilter(numerator, denominator, np.diff(noise, prepend=noise[0]) / PERIOD)
        assert found.quantity == "velocity"
        np.testing.assert_allclose(found.values, expected, rtol=1e-9, atol=1e-9)

    def test_velocities_are_filtered(
        self, spec: str, numerator: list[float], denominator: list[float], noise: Array, tmp_path: Path
    ) -> None:
        found = estimated(tmp_path, "velocity", noise, spec).estimate
        assert found.quantity == "velocity"
        np.testing.assert_allclose(found.values, signal.lfilter(numerator, denominator, noise), rtol=1e-9, atol=1e-9)

    def test_noise_and_delay_are_those_of_the_coefficients(
        self, spec: str, numerator: list[float], denominator: list[float], noise: Array, tmp_path: Path
    ) -> None:
        impulse = signal.lfilter(numerator, denominator, np.eye(1, 400)[0])
        of_positions = np.convolve(impulse, [1.0, -1.0]) / PERIOD
        late = PERIOD * float(impulse @ np.arange(400))
        filtered = estimated(tmp_path, "velocity", noise, spec).estimate
        assert filtered.noise_gain == pytest.approx(math.hypot(*impulse), rel=1e-9)
        assert filtered.delay == pytest.approx(late, abs=1e-12)
        differenced = estimated(tmp_path, "position", noise, spec).estimate
        assert differenced.noise_gain == pytest.approx(math.hypot(*of_positions), rel=1e-9)
        assert differenced.delay == pytest.approx(late + 0.5 * PERIOD, abs=1e-12)
        assert differenced.drift is None


@pytest.mark.parametrize("spec", ["moving-average:window=6", "low-pass", "kalman-velocity", "least-squares:order=2"])
def test_a_velocity_on_a_ramp_is_late_by_the_delay(spec: str, tmp_path: Path) -> None:
    """Positions t²/2 have the velocity t, and the estimate t − delay."""
    found = estimated(tmp_path, "position", 0.5 * TIMES**2, spec).estimate
    assert found.delay is not None
    assert TIMES[-1] - found.values[-1] == pytest.approx(found.delay, abs=1e-6)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_is_the_one_of_the_loop(name: str, noise: Array, tmp_path: Path) -> None:
    found = estimated(tmp_path, "position", noise, name)
    step = bind(name, PERIOD, found.resolution)
    timed = name == "tick-interval"
    expected = [step(x, 1e7 * k) if timed else step(x) for k, x in enumerate(noise.tolist())]
    np.testing.assert_allclose(found.estimate.values, expected, rtol=1e-9, atol=1e-9)
    is_linear = name not in ("foaw-end-fit", "foaw-best-fit", "levant", "tick-interval")
    assert (found.estimate.noise_gain is not None) == (found.estimate.delay is not None) == is_linear


class TestIntegration:
    def test_it_is_what_velocities_get_and_that_of_scipy_at_any_times(self, noise: Array, tmp_path: Path) -> None:
        from scipy.integrate import cumulative_trapezoid

        times: Array = np.random.default_rng(3).uniform(0.001, 0.1, len(noise)).cumsum()
        found = estimated(tmp_path, "velocity", noise, times=times)
        assert (found.estimator, found.estimate.quantity) == ("trapezoidal", "position")
        np.testing.assert_allclose(found.estimate.values, cumulative_trapezoid(noise, times, initial=0.0), atol=1e-12)

    def test_readings_that_are_rounded_down_drift_by_half_a_step_a_second(self, tmp_path: Path) -> None:
        """A ramp crosses its steps evenly, so the mean error is half a step; the bound is just that."""
        step, ramp = 0.1, TIMES
        found = estimated(tmp_path, "velocity", step * np.floor(ramp / step + 1e-9))
        assert found.resolution == pytest.approx(step)
        assert found.estimate.drift == pytest.approx(0.5 * step * TIMES[-1], rel=1e-9)
        short = 0.5 * ramp[-1] ** 2 - found.estimate.values[-1]
        assert short == pytest.approx(found.estimate.drift, rel=0.11)  # a row lies on the edge of every tenth step

    def test_its_noise_grows_with_the_root_of_the_time(self, noise: Array, tmp_path: Path) -> None:
        found = estimated(tmp_path, "velocity", noise).estimate
        assert found.noise_gain == pytest.approx(PERIOD * math.sqrt(len(TIMES) - 1 - 0.5), rel=1e-9)
        assert found.delay == 0.0

    def test_positions_are_not_integrated(self, noise: Array, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"trapezoidal integrates velocities, but .* has positions"):
            estimated(tmp_path, "position", noise, "trapezoidal")


class TestTimes:
    def test_a_jitter_is_told_and_taken_as_even(self, noise: Array, tmp_path: Path) -> None:
        late = TIMES.copy()
        late[7] += 0.2 * PERIOD
        found = estimated(tmp_path, "position", noise, times=late)
        assert found.period == PERIOD
        assert found.unevenness == pytest.approx(0.2)

    def test_a_missing_row_is_a_fault_with_its_line(self, noise: Array, tmp_path: Path) -> None:
        gap: Array = np.delete(TIMES, 10)
        sentence = (
            r"line 12: time: 0\.02 s after the row before; expected about 0\.01 s, because .* 1 such rows in total"
        )
        with pytest.raises(DocumentError, match=sentence):
            estimated(tmp_path, "position", noise[:-1], times=gap)

    @pytest.mark.parametrize("period", [1e-12, 1e12])
    def test_a_period_that_no_signal_has_is_refused(self, period: float, tmp_path: Path) -> None:
        with pytest.raises(DocumentError, match=r"between two rows; expected 1e-9 to 1e9 s"):
            estimated(tmp_path, "velocity", np.zeros(3), times=np.linspace(0.0, 2.0 * period, 3))


def test_the_step_of_a_signal_is_found_or_given(tmp_path: Path) -> None:
    counts = 0.3 * np.round(5.0 * np.sin(TIMES))
    found = estimated(tmp_path, "position", counts, "foaw-end-fit")
    assert found.resolution == pytest.approx(0.3)
    encoder = np.round(1.220703125e-5 * np.round(2000.0 * np.sin(TIMES)), 9)
    assert estimated(tmp_path, "position", encoder).resolution == pytest.approx(1.22e-5, rel=1e-3)
    few = np.round(2.827 * np.cos(0.3 * np.arange(len(TIMES) // 3 * 2)), 9)
    assert estimated(tmp_path, "velocity", few, times=TIMES[: len(few)]).resolution == 1e-9
    estimated(tmp_path, "position", counts)
    given = estimate_from(SignalRequest(file=tmp_path / "signal.csv", resolution=0.0))
    assert given.resolution == 0.0
    assert estimated(tmp_path, "position", np.ones(len(TIMES))).resolution == 0.0
    with pytest.raises(UsageError, match="resolution -1: expected a number from 0 up"):
        estimate_from(SignalRequest(file=tmp_path / "signal.csv", resolution=-1.0))


@pytest.mark.parametrize("spec", ["magic", "low-pass:pole=2", "least-squares:window=2,order=2"])
def test_an_estimator_that_does_not_exist_is_refused(spec: str, noise: Array, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no estimator|pole=2: expected|too short"):
        estimated(tmp_path, "position", noise, spec)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_largest_numbers_and_shortest_periods_give_finite_estimates(name: str, tmp_path: Path) -> None:
    """JSON has no infinities."""
    found = estimated(tmp_path, "position", np.array([0.0, 1e100, -1e100] * 5), name, times=np.linspace(0.0, 14e-9, 15))
    assert np.isfinite(found.estimate.values).all()
