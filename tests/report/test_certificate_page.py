"""The page of a certificate."""

import math

import pytest

from haptic_fieldbus.identification.estimates import Estimate
from haptic_fieldbus.report.plot import draw_certificate
from tests.identification.test_certificate import certificate
from tests.pictures import misplaced

ONSET = Estimate(500.0, 450.0, 550.0, "N/m", "friction hides it")


@pytest.mark.parametrize(("onset", "predicted"), [(ONSET, 1000.0), (None, 1000.0), (None, math.inf)])
def test_all_of_its_text_stands_on_the_page(onset: Estimate | None, predicted: float) -> None:
    """A warning takes two lines; a contact that is always stable has no predicted onset to draw."""
    found = certificate(None, 0.5, 0.8, onset=onset, predicted=predicted)
    assert bool(found.contradiction) == (onset is not None)
    drawn = draw_certificate(found)
    low, high = drawn.axes[1].get_xlim()
    assert low == 0.0
    assert math.isfinite(high)
    assert high >= 300.0
    assert misplaced(drawn) == []
