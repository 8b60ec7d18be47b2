"""Gaps in the feedback, counted, against the sums written out and against the eigenvalues of their pattern."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.cycle.gaps import Gaps
from haptic_fieldbus.margins.patterns import gaps as pattern_of
from haptic_fieldbus.margins.patterns import pattern_limit
from haptic_fieldbus.margins.plant import Plant
from haptic_fieldbus.numerics.linear import gain

PERIOD, PERIOD_NS = 0.001, 1_000_000


def fed(lengths: list[int], margin: float = math.inf) -> tuple[Gaps, int]:
    """What a loop counts whose samples come so many periods apart, and when the last one came."""
    counted, t_ns = Gaps(PERIOD, margin), 0
    for steps in lengths:
        t_ns += steps * PERIOD_NS
        if steps > 1:
            counted.note(t_ns, steps)
    return counted, t_ns


@given(st.lists(st.sampled_from([1, 1, 1, 1, 2, 3, 5]), min_size=50, max_size=200))
def test_share_and_stretch_are_the_sums_over_a_second(lengths: list[int]) -> None:
    """The second that the gaps are in is filled up with samples that came in time."""
    counted, _ = fed(lengths)
    second = lengths + [1] * (1000 - sum(lengths))
    assert counted.share == pytest.approx(sum(steps - 1 for steps in second) / 1000)
    assert counted.stretch == pytest.approx(sum(steps**2 for steps in second) / sum(second))


def test_gaps_are_forgotten_after_a_second() -> None:
    counted, t_ns = fed([5] * 10)
    counted.note(t_ns + 2_000_000_000, 2)
    assert counted.share == pytest.approx(0.001)


@pytest.mark.parametrize("lengths", [[1, 1, 3], [2], [1, 4]])
def test_the_stretch_is_what_the_pattern_costs_in_stiffness(lengths: list[int]) -> None:
    """Against the largest eigenvalue of the pattern, of a lightly damped mass."""
    plant = Plant(mass=0.6, damping=0.2)

    def limit(pattern: list[int]) -> float:
        return pattern_limit(plant, PERIOD, 0.0, lambda stiffness: gain([[-stiffness, 0.0]]), pattern_of(pattern))

    counted, _ = fed(lengths * (1000 // sum(lengths)))
    assert limit([1]) / limit(lengths) == pytest.approx(counted.stretch, rel=0.02)


def test_a_loop_is_given_up_when_its_margin_is_used_up() -> None:
    lengths = [1] * 45 + [5]  # stretch 1.4
    for margin, given_up in ((1.3, True), (1.5, False)):
        assert fed(lengths * 20, margin)[0].too_many is given_up


def test_two_gaps_are_no_pattern_however_long() -> None:
    assert not fed([20, 20], margin=1.1)[0].too_many
    assert fed([20, 20, 20], margin=1.1)[0].too_many


def test_with_a_fifth_missing_no_margin_helps() -> None:
    assert not fed([1, 1, 1, 1, 1, 2] * 140)[0].too_many
    assert fed([1, 1, 2] * 250)[0].too_many
