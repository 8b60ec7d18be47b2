"""Every velocity estimator: the contract, what is written after its name, and the figures it claims."""

import math
import pkgutil
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics import estimators
from haptic_fieldbus.numerics.estimators import (
    ESTIMATORS,
    bind,
    chosen,
    discrete,
    is_timed,
    linear_form,
    linear_stand_in,
)
from haptic_fieldbus.numerics.linear import StateSpace
from tests.cases import every
from tests.lanes import examples
from tests.numerics.estimator_figures import delay, measured_delay, measured_noise_gain, noise_gain

PERIOD = 1e-3
COUNT = 0.05 / 4096
NOT_LINEAR = [name for name in ESTIMATORS if discrete(name, PERIOD) is None]
LINEAR = [
    *(name for name in ESTIMATORS if name not in NOT_LINEAR),
    "moving-average:window=1",
    "moving-average:window=33",
    "low-pass:pole=0",
    "low-pass:pole=0.95,order=3",
    "filtered-derivative:tau=0.0006,mapping=forward",
    "filtered-derivative:tau=0,mapping=backward",
    "filtered-derivative:tau=0.0001,mapping=trapezoidal",
    "filtered-derivative:tau=0,mapping=exact",
    "least-squares:window=2",
    "least-squares:window=12,order=2",
    "least-squares:window=20,order=4",
    "kalman-velocity:index=100",
    "kalman-acceleration:index=3",
]
ALL = [*LINEAR, *NOT_LINEAR, "foaw-best-fit:window=1", "levant:lipschitz=5"]


@pytest.mark.parametrize("spec", ALL)
class TestEveryEstimator:
    def test_is_listed_under_its_name(self, spec: str) -> None:
        estimator = chosen(spec).estimator
        assert estimator.name == spec.partition(":")[0]
        assert estimator.name in ESTIMATORS
        assert estimator.summary

    @every("where", [0.0, 0.7, -1024.3])
    def test_says_zero_while_the_handle_stands(self, spec: str, where: float) -> None:
        step = bind(spec, PERIOD, COUNT)
        assert {step(where) for _ in range(50)} == {0.0}

    @every("speed", [0.25, -1.5, 0.02])
    def test_finds_a_constant_speed(self, spec: str, speed: float) -> None:
        step = bind(spec, PERIOD, COUNT)
        found = [step(0.3 + speed * PERIOD * period) for period in range(600)]
        assert found[-1] == pytest.approx(speed, rel=1e-7)

    def test_says_zero_again_some_time_after_a_motion(self, spec: str) -> None:
        step = bind(spec, PERIOD, COUNT)
        for period in range(50):
            step(0.01 * period * PERIOD)
        found = [step(0.0005) for _ in range(2000)]
        assert abs(found[-1]) <= COUNT / 1.9

    def test_two_of_a_kind_share_no_memory(self, spec: str) -> None:
        first, second = bind(spec, PERIOD, COUNT), bind(spec, PERIOD, COUNT)
        first(1.0)
        first(2.0)
        assert second(0.5) == 0.0

    def test_a_number_that_is_not_one_is_passed_on(self, spec: str) -> None:
        step = bind(spec, PERIOD, COUNT)
        step(0.0)
        step(0.1)
        assert math.isnan(step(math.nan))

    def test_an_infinite_position_is_passed_on(self, spec: str) -> None:
        step = bind(spec, PERIOD, COUNT)
        step(0.0)
        assert not math.isfinite(step(math.inf))

    def test_works_without_a_known_resolution(self, spec: str) -> None:
        step = bind(spec, PERIOD)
        assert math.isfinite(sum(step(0.001 * math.sin(0.1 * period)) for period in range(200)))

    @every("period", [0.0, -1.0, math.nan, math.inf])
    def test_a_period_that_is_none_is_refused(self, spec: str, period: float) -> None:
        with pytest.raises(UsageError, match="above 0"):
            bind(spec, period)


@pytest.mark.parametrize("spec", LINEAR)
class TestEveryLinearEstimator:
    @settings(derandomize=True, max_examples=examples(25))
    @given(positions=st.lists(st.floats(-1, 1), min_size=1, max_size=40))
    def test_runs_as_the_linear_system_that_stability_is_judged_by(self, spec: str, positions: list[float]) -> None:
        step, system = bind(spec, PERIOD), self.system(spec)
        step(0.0)
        state = np.zeros(system.order)
        for position in positions:
            expected = float(system.c[0] @ state + system.d[0, 0] * position)
            state = system.a @ state + system.b[:, 0] * position
            assert step(position) == pytest.approx(expected, rel=1e-9, abs=1e-8)

    def test_is_stable(self, spec: str) -> None:
        assert np.abs(np.linalg.eigvals(self.system(spec).a)).max(initial=0.0) < 1.0

    def test_its_noise_gain_is_its_closed_form(self, spec: str) -> None:
        choice = chosen(spec)
        if choice.estimator.noise_gain is not None:
            assert noise_gain(self.system(spec)) == pytest.approx(
                choice.estimator.noise_gain(choice.setup(PERIOD)), rel=1e-9
            )

    def test_its_noise_gain_is_the_norm_of_its_impulse_response(self, spec: str) -> None:
        step = bind(spec, PERIOD)
        step(0.0)
        impulse = [step(float(sample == 0)) for sample in range(4000)]
        assert noise_gain(self.system(spec)) == pytest.approx(math.hypot(*impulse), rel=1e-6)

    def test_noise_comes_out_as_the_theory_says(self, spec: str) -> None:
        found = measured_noise_gain(bind(spec, PERIOD), 1e-5, 12_000)
        assert found == pytest.approx(noise_gain(self.system(spec)), rel=0.08)

    def test_its_delay_is_its_closed_form(self, spec: str) -> None:
        choice = chosen(spec)
        assert choice.estimator.delay is not None
        claimed = choice.estimator.delay(choice.setup(PERIOD))
        assert delay(self.system(spec), PERIOD) == pytest.approx(claimed, rel=1e-7, abs=1e-12)

    def test_a_rising_velocity_is_as_late_as_the_theory_says(self, spec: str) -> None:
        found = measured_delay(bind(spec, PERIOD), PERIOD, 0.0, speed=0.02, acceleration=1.0)
        assert found == pytest.approx(delay(self.system(spec), PERIOD), rel=1e-3, abs=1e-8)

    def test_slow_sines_come_out_as_their_velocity(self, spec: str) -> None:
        """H(e^{jωT}) → jω·(1 − jω·delay)"""
        system, omega = self.system(spec), 0.5
        z = np.exp(1j * omega * PERIOD)
        states = np.linalg.solve(z * np.eye(system.order) - system.a, system.b[:, 0].astype(complex))
        found = complex(system.c[0] @ states + system.d[0, 0])
        assert found == pytest.approx(1j * omega * (1 - 1j * omega * delay(system, PERIOD)), rel=2e-3)

    @staticmethod
    def system(spec: str) -> StateSpace:
        found = discrete(spec, PERIOD)
        assert found is not None
        return found


def test_there_is_a_default() -> None:
    assert DEFAULT_ESTIMATOR in ESTIMATORS


def test_only_the_one_that_counts_time_takes_it() -> None:
    assert [name for name in ESTIMATORS if is_timed(name)] == ["tick-interval"]


def test_an_unstable_estimator_amplifies_noise_without_bound() -> None:
    assert noise_gain(StateSpace(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)))) == math.inf


STAND_INS = {
    "foaw-end-fit": "moving-average:window=16",
    "foaw-best-fit": "least-squares:window=17",
    "foaw-best-fit:window=1": "least-squares:window=2",
}


@pytest.mark.parametrize("spec", [*NOT_LINEAR, "foaw-best-fit:window=1"])
def test_what_is_no_linear_system_is_judged_as_one_and_says_so(spec: str) -> None:
    assert discrete(spec, PERIOD) is None
    stand_in = linear_stand_in(spec)
    assert stand_in == STAND_INS.get(spec, "backward-difference")
    expected = discrete(stand_in, PERIOD)
    assert expected is not None
    for name in "abcd":
        np.testing.assert_array_equal(getattr(linear_form(spec, PERIOD), name), getattr(expected, name))


def test_what_is_linear_is_judged_as_itself() -> None:
    assert linear_stand_in("low-pass") is None
    assert linear_form("low-pass:order=3", PERIOD).order == 4


def test_parameters_are_read_with_and_without_spaces() -> None:
    assert chosen("least-squares: window = 9 , order=2").given == {"window": 9.0, "order": 2.0}
    assert chosen("filtered-derivative:mapping=backward").given == {"mapping": "backward"}


def test_a_band_that_is_not_given_is_one_encoder_count() -> None:
    assert chosen("foaw-best-fit").setup(PERIOD, COUNT).number("band") == COUNT
    assert chosen("foaw-best-fit:band=1e-4").setup(PERIOD, COUNT).number("band") == 1e-4


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("foaw", r'no estimator "foaw"; nearest: foaw-\w+-fit; there are: backward-difference, '),
        ("xyz", r'no estimator "xyz"; there are: backward-difference, .*, tick-interval$'),
        ("moving-average:windw=3", r'moving-average: no parameter "windw"; nearest: window; there are: window$'),
        ("backward-difference:window=3", r'no parameter "window"; there are: none$'),
        ("moving-average:window", r'no parameter "window"; nearest: window'),
        ("moving-average:window=0", r"window=0: expected a whole number from 1 to 256$"),
        ("moving-average:window=2.5", r"window=2.5: expected a whole number from 1 to 256$"),
        ("moving-average:window=nan", r"window=nan: expected a whole number"),
        ("moving-average:window=x", r"window=x: expected a whole number"),
        ("moving-average:window=3,window=4", r"moving-average: window is set twice"),
        ("low-pass:pole=1", r"low-pass: pole=1: expected a number from 0 to 0.9999$"),
        ("filtered-derivative:tau=-1", r"tau=-1: expected a number from 0 to 10 s$"),
        ("filtered-derivative:mapping=tustin", r"mapping=tustin: expected one of forward, backward, .*, exact"),
        ("foaw-best-fit:band=-1", r"band=-1: expected a number from 0 m or rad up$"),
        ("foaw-best-fit:band=inf", r"band=inf: expected a number from 0 m or rad up$"),
        ("levant:lipschitz=0", r"lipschitz=0: expected a number from 1e-6 to 1e9 m/s² or rad/s²$"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_the_nearest_name_or_the_limits(spec: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        bind(spec, PERIOD)


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        (
            "filtered-derivative:tau=0.0005,mapping=forward",
            r"tau=0.0005 s by the forward mapping is unstable at a period of 0.001 s; it needs tau above 0.0005 s",
        ),
        ("filtered-derivative:tau=0,mapping=forward", r"needs tau above 0.0005 s, half of the period$"),
        ("filtered-derivative:tau=0,mapping=trapezoidal", r"trapezoidal mapping is unstable .* needs tau above 0$"),
        ("least-squares:window=3,order=3", r"window=3 is too short for order=3; expected at least 4 positions"),
    ],
)
def test_parameters_that_do_not_go_together_are_refused_with_the_limit(spec: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        discrete(spec, PERIOD)


def test_the_forward_mapping_is_refused_exactly_where_it_is_unstable() -> None:
    """tau = T/2 has its pole at −1."""
    assert discrete("filtered-derivative:tau=0.000501,mapping=forward", PERIOD) is not None
    with pytest.raises(UsageError):
        discrete("filtered-derivative:tau=0.000501,mapping=forward", 1.01e-3)


def test_only_the_family_that_is_named_is_imported() -> None:
    code = (
        "import sys; from haptic_fieldbus.numerics import estimators as e; e.bind('backward-difference', 1e-3); "
        "print(*sorted(m.rpartition('.')[2] for m in sys.modules if m.startswith(e.__name__ + '.')))"
    )
    out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert out.split() == ["differences", "estimator"]


def test_every_family_is_listed_in_full() -> None:
    assert estimators.estimator_named("levant").name == "levant"
    listed = {name: estimators.estimator_named(name).name for name in ESTIMATORS}
    assert list(listed) == list(listed.values())
    for each in pkgutil.iter_modules(estimators.__path__, f"{estimators.__name__}."):
        for estimator in getattr(import_module(each.name), "ESTIMATORS", ()):
            assert estimator.name in ESTIMATORS, f"add {estimator.name} to ESTIMATORS in {estimators.__file__}"
