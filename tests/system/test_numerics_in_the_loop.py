"""Every method and every estimator in a whole run on the simulated bench."""

import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.estimators import ESTIMATORS, linear_stand_in
from haptic_fieldbus.numerics.integrators import METHODS

DURATION = 0.8
"""[s]; the hand is at its full force after half a second."""


@pytest.mark.thorough("a run for every method", quick=2)
@pytest.mark.parametrize("method", METHODS)
def test_a_sprung_mass_is_rendered_by_every_method(method: str) -> None:
    result = run("sprung_mass", method=method, duration=DURATION)
    assert result.cycles == round(DURATION * 1000)
    assert not result.trips
    assert result.torque_error is not None
    assert result.torque_error.rms < 0.5


@pytest.mark.thorough("a run for every estimator", quick=1)
@pytest.mark.parametrize("estimator", [*ESTIMATORS, "least-squares:window=6,order=2", "foaw-best-fit:window=8"])
def test_a_wall_that_damps_is_rendered_by_every_estimator(estimator: str) -> None:
    result = run("damped_wall", estimator=estimator, duration=DURATION)
    assert result.cycles == round(DURATION * 1000)
    assert not result.trips
    assert result.torque_error is not None
    assert result.torque_error.rms < 0.2


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_the_plan_says_by_what_stability_is_judged_where_the_estimator_is_not_linear(estimator: str) -> None:
    (step,) = [step for step in plan("damped_wall", estimator=estimator).steps if step.startswith("velocity: ")]
    other = linear_stand_in(estimator)
    lost = ", and with the velocity 0" if estimator == "levant" else ""  # the motor can be faster than it follows
    remark = f" (not linear: stability is checked with {other}{lost})" if other else ""
    assert step == f"velocity: {estimator}{remark}"


def test_a_parameter_that_is_wrong_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(UsageError, match=r"window=0: expected a whole number from 1 to 256"):
        run("wall", estimator="moving-average:window=0")


def test_a_filter_that_is_unstable_at_the_rate_of_the_loop_is_refused_with_the_limit() -> None:
    with pytest.raises(UsageError, match=r"needs tau above 0.002 s, half of the period"):
        plan("damped_wall", estimator="filtered-derivative:tau=0.001,mapping=forward", rate=250.0)
