"""Exact motion of linear systems, against scipy and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.mechanics import motion as module
from haptic_fieldbus.sim.mechanics.motion import Flow
from tests.cases import every

OSCILLATOR = np.array([[0.0, 1.0], [-1.0e6, -20.0]])
"""1000 rad/s."""
INTEGRATORS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])


@every("a", [OSCILLATOR, INTEGRATORS, np.diag([-6283.0, -1.0, 0.0])])
@every("span_ns", [0.0, 0.37, 1.0, 12_345.678, 400_000.0, 1_000_000.0, 7_654_321.25])
def test_any_span_agrees_with_the_matrix_exponential(a: Matrix, span_ns: float) -> None:
    z = np.linspace(1.0, 2.0, len(a))
    flow = Flow(a)
    reference = expm(a * span_ns * 1e-9) @ z
    scale = np.abs(reference).max()
    assert flow.advance(z, span_ns) == pytest.approx(reference, abs=1e-12 * scale)
    assert flow.advance_many(z[np.newaxis], np.array([span_ns]))[0] == pytest.approx(reference, abs=1e-12 * scale)
    assert flow.transition(int(span_ns)) @ z == pytest.approx(expm(a * int(span_ns) * 1e-9) @ z, abs=1e-12 * scale)


@pytest.mark.thorough("60 digits for each state")
@given(st.lists(st.floats(0, 3e6), min_size=1, max_size=20))
def test_many_states_are_advanced_each_by_its_own_span(spans: list[float]) -> None:
    flow = Flow(OSCILLATOR)
    states = np.column_stack([np.ones(len(spans)), np.linspace(-5, 5, len(spans))])
    many = flow.advance_many(states, np.array(spans))
    for row, state, span in zip(many, states, spans, strict=True):
        assert row == pytest.approx(flow.advance(state, span), rel=1e-11, abs=1e-11)


def test_the_cache_of_transitions_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_TRANSITIONS", 3)
    flow = Flow(OSCILLATOR)
    first = flow.transition(1)
    for span_ns in range(2, 9):
        flow.transition(span_ns)
    assert len(flow._transitions) <= 3
    assert np.array_equal(flow.transition(1), first)


class TestFirstNegative:
    """When a linear form first becomes negative."""

    z = np.array([1.0, 0.0])
    form = np.array([1.0, 0.0])

    def test_a_sign_change_is_found_to_rounding(self) -> None:
        undamped = Flow(np.array([[0.0, 1.0], [-1.0e6, 0.0]]))
        found = undamped.first_negative(self.z, 2e6, self.form, 0.0)
        assert found == pytest.approx(math.pi / 2 * 1e6, rel=1e-12)

    def test_a_dip_between_two_positive_ends_is_found(self) -> None:
        undamped = Flow(np.array([[0.0, 1.0], [-1.0e6, 0.0]]))
        # √2·(cos(ωt + π/4) + 0.9) is negative around ωt = 3π/4 only; both ends are positive.
        found = undamped.first_negative(np.array([1.0, -1000.0]), 5.0e6, self.form, 0.9 * math.sqrt(2))
        root = math.acos(-0.9) - math.pi / 4
        assert found == pytest.approx(root * 1e6, rel=1e-11)

    def test_a_dip_that_stays_positive_is_no_event(self) -> None:
        undamped = Flow(np.array([[0.0, 1.0], [-1.0e6, 0.0]]))
        assert undamped.first_negative(np.array([1.0, -1000.0]), 5.0e6, self.form, 1.5) is None

    def test_a_dip_shorter_than_the_taylor_span_is_found(self) -> None:
        flow = Flow(INTEGRATORS)
        # (h − 0.5 µs)² − tiny, in seconds²
        z = np.array([0.5**2 * 1e-12 * (1 - 1e-6), -1e-6, 2.0])
        found = flow.first_negative(z, 1000.0, np.array([1.0, 0.0, 0.0]), 0.0)
        assert found == pytest.approx(500 * (1 - 1e-3), rel=1e-9)
        assert flow.first_negative(z * [1 + 2e-6, 1, 1], 1000.0, np.array([1.0, 0.0, 0.0]), 0.0) is None

    def test_nothing_is_found_where_nothing_crosses(self) -> None:
        assert Flow(np.array([[-1.0]])).first_negative(np.array([1.0]), 1e9, np.array([1.0]), 0.0) is None
