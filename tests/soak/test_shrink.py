"""Shrinking: what is left fails, and nothing of it can be left out."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.faults.drawing import drawn
from tests.soak.shrink import Faults, shrunk


@given(st.lists(st.integers(0, 10_000), min_size=1, max_size=4))
def test_what_is_left_fails_and_needs_each_of_its_faults(seeds: list[int]) -> None:
    these = tuple(fault for seed in seeds for fault in drawn(seed, 1.0))
    kinds = {these[0].kind, these[-1].kind}

    def fails(some: Faults) -> bool:
        return kinds <= {fault.kind for fault in some}

    left = shrunk(these, fails)
    assert fails(left)
    assert len(left) == len(kinds)


def test_values_become_plainer() -> None:
    (left,) = shrunk(
        (faults.FrameDropped("frame_dropped", 0.1234, "rpdo", 57),),
        lambda some: bool(some) and getattr(some[0], "count", 0) >= 7,
    )
    assert left == faults.FrameDropped("frame_dropped", 0.1, "rpdo", 7)


def test_a_run_that_fails_without_faults_needs_none() -> None:
    assert shrunk(drawn(3, 1.0), lambda some: True) == ()


def test_what_does_not_fail_is_refused() -> None:
    with pytest.raises(ValueError, match="do not fail"):
        shrunk((faults.ErrorFrame("error_frame", 0.1),), lambda some: False)
