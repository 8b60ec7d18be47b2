"""Every stiff and extreme case is there under its name, and behaves as theory says."""

import itertools
import math
from collections.abc import Callable

import pytest

from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.passivity import Array
from haptic_fieldbus.numerics.sampled import SampledPlant
from haptic_fieldbus.study.case import greatest, largest_error, relative_error
from haptic_fieldbus.study.cases import CASES, closed_loop, integrators
from haptic_fieldbus.study.measure.loops import flicked
from haptic_fieldbus.study.page.stability import run_case
from tests.number_style import strange_numbers

SLUGS = """
tiny-h h-sweep forward-euler-any-t float-overflow rk4-at-its-limit semi-implicit-at-its-limit lecture-constants
damper-b-equals-kt mass-to-zero mass-zero-refused mass-negative-refused energy-drift-1e7-steps zero-input-stays-zero
stiff-held-puck free-puck light-puck sampled-free-puck wall-at-boundary-below wall-at-boundary-above wall-1.5x-over
delay-half-sample delay-one-sample delay-two-samples delay-ten-samples z-width-damping z-width-delay z-width-filter
pure-damper-limit filtered-damper-passivity half-sample-wall bounce-energy passivity-observer-timing
passivity-observer-delay coarse-encoder one-count-wall coulomb-rescue local-stability slow-loop undamped-wall
velocity-quantisation zero-transition-window differentiator-tau-below-half-t lecture-noise tachometer-drift
tachometer-alias jittered-sampling dropped-frames lost-bus stale-position non-finite-input denormal-input encoder-wrap
encoder-jump clock-backwards saturation-ledger hunt-crossley-fast-impact contact-shorter-than-a-sample
multi-scale-tissue lugre-fast-slip coulomb-stop detent-too-sharp hand-lets-go rotary-equals-linear long-clock
start-inside-the-wall modbus-one-period torque-lag coupled-axes
compliant-transmission varying-slope missed-frames-pattern tick-phase fade-return
gaps-given-up leak-allowance controller-damping stored-energy worst-of-ranges estimator-weight rounding-bridged
magnet-outside score-by-hand straight-line-step
"""


def test_every_case_is_there_under_its_name() -> None:
    assert sorted(CASES) == sorted(SLUGS.split())


@pytest.mark.thorough("all cases of the report", quick=3)
@pytest.mark.parametrize("name", CASES)
def test_it_behaves_as_theory_says(name: str) -> None:
    found, _ = run_case(CASES[name], True)
    assert found.passed is True, f"expected {found.expected}, measured {found.measured}, judged by {found.oracle}"
    assert found.used is None or found.used <= 1.0
    texts = (found.expected, found.measured, found.oracle, found.tolerance)
    assert min(map(len, texts)) > 3
    assert strange_numbers("\n".join(texts), is_prose=True) == []


@pytest.mark.parametrize("place", range(3))
def test_a_number_that_is_missing_is_never_the_smaller_one(place: int) -> None:
    numbers = [0.0, 2.0, 1.0]
    assert (greatest(numbers), relative_error([1.0, 2.0, 1.5], [1.0] * 3), largest_error(numbers, [0.0] * 3)) == (
        2,
        1,
        2,
    )
    numbers[place] = math.nan
    assert math.isnan(greatest(numbers))
    assert math.isnan(relative_error(numbers, [1.0] * 3))
    assert math.isnan(largest_error(numbers, [0.0] * 3))


def test_a_case_fails_on_forces_that_are_no_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """They begin after 100 steps, so that the first numbers that are compared are right."""

    def lost_step(space: StateSpace, period: float, method: str) -> Callable[..., float]:
        step, count = bind(space, period, method), itertools.count()
        return lambda *inputs: step(*inputs) if next(count) < 100 else math.nan

    def lost(plant: SampledPlant, virtual: StateSpace, steps: int) -> Array:
        forces = flicked(plant, virtual, steps)
        forces[100:] = math.nan
        return forces

    monkeypatch.setattr(integrators, "bind", lost_step)
    monkeypatch.setattr(closed_loop, "flicked", lost)
    for name in ("mass-to-zero", "zero-input-stays-zero", "sampled-free-puck"):
        assert not run_case(CASES[name], True)[0].passed, name


@pytest.mark.thorough("all cases once more, as long as in a whole report")
@pytest.mark.parametrize("name", CASES)
def test_it_behaves_so_in_a_whole_report_too(name: str) -> None:
    found, _ = run_case(CASES[name], False)
    assert found.passed is True, f"expected {found.expected}, measured {found.measured}, judged by {found.oracle}"
