"""The plane of damping and friction, handles let run against describing functions and against the quadrants."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.study.measure.region import Ending, border, plane
from haptic_fieldbus.study.page.stability import part


@pytest.mark.thorough("simulates until the motion has settled", quick=1)
@pytest.mark.parametrize("start", [5.0, 20.0, 100.0])
def test_motions_of_one_size_end_as_describing_functions_say(start: float) -> None:
    found = plane(start, 14, 2000)
    assert found.agreement == 1.0
    assert set(np.unique(found.outcome)) == set(Ending)


@pytest.mark.thorough("simulates until the motion has settled")
def test_large_motions_know_the_quadrants_alone() -> None:
    found = plane(1e5, 12, 3000)
    beta, sigma = np.meshgrid(found.axis, found.axis)
    expected = np.where(beta < 0.5, Ending.GROWS, np.where(sigma < 0.5, Ending.CYCLES, Ending.RESTS))
    apart = (np.abs(beta - 0.5) > 0.06) & (np.abs(sigma - 0.5) > 0.06)
    np.testing.assert_array_equal(found.outcome[apart], expected[apart])


def test_a_border_in_the_wrong_place_is_seen() -> None:
    assert replace(plane(20.0, 14, 2000), start=40.0).agreement < 0.97


def test_the_border_ends_where_damping_takes_what_the_hold_gives() -> None:
    np.testing.assert_array_equal(border(20.0, np.array([0.5, 0.7])), 0.0)
    assert border(20.0, np.array([0.0]))[0] == pytest.approx(np.pi / 8 * 20.0 / np.sqrt(20.0))


def test_the_page_tells_how_many_ended_as_predicted() -> None:
    text, document = part([plane(20.0, 6, 500)])
    assert "Friction and encoder" in text
    assert "of the plane away from it agree" in text
    assert document.startswith("<")
