"""Statements of a plan about the places at which its loop was judged."""

import haptic_fieldbus
from haptic_fieldbus.planning.explain import explain


def test_the_worst_place_and_the_crest_of_detents_are_told() -> None:
    """Valleys every 12 mm, so that crests lie 6 mm beside them; there the ideal leaves as a mass on −471 N/m does."""
    text = explain(haptic_fieldbus.plan("detents"))
    assert "worst equilibrium that 50.3 N can hold: " in text
    assert "471.2 N/m, spectral radius 0.999146" in text
    assert "spectral radius of the ideal 1.02644, of this loop" in text


def test_a_wall_has_neither() -> None:
    text = explain(haptic_fieldbus.plan("wall"))
    assert "worst equilibrium" not in text
    assert "unstable equilibrium" not in text
