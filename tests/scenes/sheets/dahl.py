"""A bristle that takes all that it is given; its slope is twice its stiffness just after a reversal, and then less."""

from haptic_fieldbus.numerics.relaxation import SAMPLED_EXCESS
from haptic_fieldbus.scenes.dahl import Dahl
from tests.scenes.sheet import Sheet, passing, resting, spring_leak

SHEET = Sheet(
    examples=(
        Dahl("handle", coulomb=1.5, stiffness=800.0),
        Dahl("handle", coulomb=0.2, stiffness=2e4),
    ),
    steepness=lambda dahl: (2.0 * dahl.stiffness, 0.0, 0.0),
    continuous=lambda dahl, motion: 0.0,
    sampled=lambda dahl, motion: SAMPLED_EXCESS * spring_leak(dahl.stiffness, motion),
    silent=lambda dahl: [resting(0.02, 0.02, 0.02)],
    signs=lambda dahl: [(passing(0.0, 0.05, 0.2), -1), (passing(0.0, -0.05, 0.2), 1), (resting(0.0, 1e-6), -1)],
)
