"""What the ledger of an axis is granted, by the elements and couplings that act on it."""

import pytest

from haptic_fieldbus.planning.energy import TWIST, axis_terms
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import plan_of, scene_of

PERIOD = 1e-3


def test_stiffness_of_walls_and_of_the_axis_own_couplings_is_granted_and_no_other() -> None:
    plan = plan_of(scene_of(Wall("left", 100.0), Wall("right", 100.0, name="other")))
    axis = plan.axes[0]
    own, others = Coupling(("left", "right"), 50.0), Coupling(("right", "third"), 1e6)
    alone, tied, beside = (
        axis_terms(axis, axis.elements, couplings, PERIOD).damping for couplings in ((), (own,), (own, others))
    )
    assert tied == pytest.approx(alone * (1.0 + TWIST * 50.0 / 100.0))
    assert beside == tied
