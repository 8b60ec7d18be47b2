"""Every velocity estimator: contract, and the backward difference in particular."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.estimators import DEFAULT_ESTIMATOR, ESTIMATORS, bind, discrete


@pytest.mark.parametrize("name", ESTIMATORS)
class TestEveryEstimator:
    def test_is_listed_under_its_name(self, name: str) -> None:
        assert ESTIMATORS[name].name == name

    def test_says_zero_first(self, name: str) -> None:
        assert bind(name, 1e-3)(0.7) == 0.0

    def test_says_zero_while_the_handle_stands(self, name: str) -> None:
        step = bind(name, 1e-3)
        assert {step(0.7) for _ in range(50)} == {0.0}

    def test_finds_a_constant_speed(self, name: str) -> None:
        step = bind(name, 1e-3)
        found = [step(0.3 + 0.25e-3 * period) for period in range(200)]
        assert found[-1] == pytest.approx(0.25, rel=1e-9)

    @settings(derandomize=True)
    @given(positions=st.lists(st.floats(-1, 1), min_size=1, max_size=30))
    def test_runs_as_the_linear_system_that_stability_is_judged_by(self, name: str, positions: list[float]) -> None:
        step, system = bind(name, 1e-3), discrete(name, 1e-3)
        step(0.0)
        state = np.zeros(system.order)
        for position in positions:
            expected = float(system.c[0] @ state + system.d[0, 0] * position)
            state = system.a @ state + system.b[:, 0] * position
            assert step(position) == pytest.approx(expected, rel=1e-9, abs=1e-9)

    def test_two_of_a_kind_share_no_memory(self, name: str) -> None:
        first, second = bind(name, 1e-3), bind(name, 1e-3)
        first(1.0)
        assert second(0.5) == 0.0

    def test_a_number_that_is_not_one_is_passed_on(self, name: str) -> None:
        step = bind(name, 1e-3)
        step(0.0)
        assert np.isnan(step(float("nan")))


def test_the_backward_difference_is_the_way_made_over_the_period() -> None:
    step = bind("backward-difference", 0.5)
    assert [step(position) for position in (1.0, 2.0, 2.0, -1.0)] == [0.0, 2.0, 0.0, -6.0]


def test_there_is_a_default() -> None:
    assert DEFAULT_ESTIMATOR in ESTIMATORS


def test_an_unknown_name_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(UsageError, match=r'no estimator "foaw"; there are: backward-difference'):
        bind("foaw", 1e-3)
