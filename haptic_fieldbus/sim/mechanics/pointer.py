"""A hand that a pointer leads: a spring and a damper from the pointer to the mass of the hand, which holds the handle.

The force is computed once a period from the place that the loop has read, and held. The damper is critical for the mass
of the hand, or as strong as a held force can be at a long period.
"""

import math

from haptic_fieldbus.drive.rig import LinearMechanism, RotaryMechanism
from haptic_fieldbus.sim.hand import LEVER, Hand, grip, hand_named
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.motion import HAND_SPEED, STRETCH

STRONGEST = 20.0
"""Largest force of the hand on its mass [N]; rotary with the lever of the hand."""
_POINTED = Hand("pointer")


class PointedHandle:
    """The handle of one simulated axis, as a pointer leads it; efforts and places are in the workspace."""

    def __init__(self, body: Body, mechanism: LinearMechanism | RotaryMechanism) -> None:
        self._body, self._mechanism = body, mechanism
        self._lever = LEVER if isinstance(mechanism, RotaryMechanism) else 1.0
        self._grip = grip(_POINTED, mechanism)

    def pull(self, position: float, target: float, period: float) -> None:
        """Pull the handle at `position` towards `target` [m or rad] for one period [s]; another hand lets go."""
        square, hand = self._lever**2, _POINTED
        damping = min(2.0 * math.sqrt(hand.stiffness * hand.mass), 0.5 * hand.mass / period) * square
        ratio = self._mechanism.ratio * self._mechanism.sign
        holds, state = self._body.is_held_by(self._grip), self._body.state
        place = position + state[STRETCH] * ratio if holds else position
        speed = state[HAND_SPEED] * ratio if holds else 0.0
        effort = hand.stiffness * square * (target - place) - damping * speed
        most = STRONGEST * self._lever
        self._body.lead(self._grip, max(-most, min(effort, most)) * ratio)

    def let_go(self) -> None:
        """Let go of the handle."""
        self._body.let_go()

    def take(self, name: str) -> None:
        """Let the force of a named hand act from now on; raises UsageError for an unknown one.

        The hand is that of the pointer, so only hands of its mass without a sine of force are themselves.
        """
        hand = hand_named(name)
        self._body.let_go()
        if hand is not None:
            self._body.lead(self._grip, 0.0)
            self._body.plan_pieces(grip(hand, self._mechanism))
