"""Every stiff and extreme case is there under its name, and behaves as theory says."""

import pytest

from haptic_fieldbus.study.cases import CASES
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


@pytest.mark.thorough("all cases once more, as long as in a whole report")
@pytest.mark.parametrize("name", CASES)
def test_it_behaves_so_in_a_whole_report_too(name: str) -> None:
    found, _ = run_case(CASES[name], False)
    assert found.passed is True, f"expected {found.expected}, measured {found.measured}, judged by {found.oracle}"
