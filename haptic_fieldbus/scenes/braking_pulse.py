"""A brief braking of the handle when it crosses a place, as a bump or a click is felt.

For `duration` after the crossing F = −B·v, limited to |F| ≤ `saturation`: with a large B this is an opposing force of
that size at all but the slowest speeds, which fades with the speed instead of turning the handle round. The crossing is
noticed once the handle has been `rearm` away from the place; a handle that jitters on it gives one pulse. A crossing
during a pulse begins it anew.

In continuous time F·v ≤ 0 at every instant: it only ever takes energy. Sampled and held at T it can give −B·v·Δx in a
period within which the handle turns. Periods are counted, so it needs no clock; a duration is rounded to whole periods,
at least one.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.condition import Side, bind
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Duration, Law, Length, Place, PositiveDamping, PositiveEffort
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class BrakingPulse:
    """`damping` [N·s/m or N·m·s/rad] up to `saturation` [N or N·m] for `duration` [s] after crossing `position`.

    `position` and `rearm` [m or rad]; without a `saturation` the force has no limit.
    """

    axis: str
    damping: PositiveDamping
    duration: Duration
    rearm: Length
    position: Place = 0.0
    saturation: PositiveEffort | None = None
    name: str = "braking_pulse"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY)

    def begin(self, period: float) -> Law:
        """Remembers on which side the handle has been far enough away, and how many periods are left."""
        side = Side.limited(self.damping, 0.0, self.saturation)
        brake, place, rearm = bind(0.0, 0.0, side, side), self.position, self.rearm
        length = max(1, round(min(self.duration / period, 2.0**53)))
        came_from, left = 0.0, 0

        def pulse(position: float, velocity: float) -> float:
            nonlocal came_from, left
            away = position - place
            if came_from and came_from * away <= 0.0:
                came_from, left = 0.0, length
            if not -rearm < away < rearm:
                came_from = 1.0 if away > 0.0 else -1.0
            if not left:
                return 0.0 * away  # 0, but not for what is no number
            left -= 1
            return brake(velocity)

        return pulse

    def linearised(self) -> StateSpace:
        """The damping during a pulse, as if it lasted."""
        return gain([[0.0, -self.damping]])
