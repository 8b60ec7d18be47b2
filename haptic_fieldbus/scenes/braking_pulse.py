"""A brief braking force each time the handle crosses a position, felt as a bump or a click.

For `duration` after the crossing F = −B·v, limited to |F| ≤ `saturation`. With a large B the force has that size at all
but the slowest speeds, and fades near standstill, so that it never turns the handle round. A crossing counts only after
the handle has been `rearm` away from the position: a handle that jitters on it gets one pulse. A crossing during a
pulse starts the pulse anew.

In continuous time F·v ≤ 0 at every instant: the element only takes energy. Sampled and held for T, it can give −B·v·Δx
in a period within which the handle turns. The law counts periods and needs no clock; `duration` is rounded to whole
periods, at least one.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.condition import Side, bind
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Duration, Law, Length, Place, PositiveDamping, PositiveEffort
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class BrakingPulse:
    """Brakes with `damping` [N·s/m or N·m·s/rad], at most `saturation` [N or N·m], for `duration` [s] after a crossing.

    A crossing counts if the handle was at least `rearm` away from `position` before [m or rad]. Without `saturation`
    the force has no limit.
    """

    axis: str
    damping: PositiveDamping
    duration: Duration
    rearm: Length
    position: Place = 0.0
    saturation: PositiveEffort | None = None
    name: str = "braking_pulse"
    __pydantic_config__: ClassVar = STRICT
    by_event: ClassVar[bool] = True
    """Each pulse begins with a crossing."""
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION, Signal.VELOCITY)

    def begin(self, period: float) -> Law:
        """Return a law that remembers the side on which the handle was far enough away, and the periods left."""
        side = Side.limited(self.damping, 0.0, self.saturation)
        brake, place, rearm = bind(0.0, 0.0, side, side), self.position, self.rearm
        # The bound replaces an infinite quotient, which round() would refuse.
        length = max(1, round(min(self.duration / period, 2.0**53)))
        # The side from which a crossing counts, as a sign; 0 until the handle has been `rearm` away.
        came_from, left = 0.0, 0

        def pulse(position: float, velocity: float) -> float:
            nonlocal came_from, left
            away = position - place
            if came_from and came_from * away <= 0.0:
                came_from, left = 0.0, length
            if not -rearm < away < rearm:
                came_from = 1.0 if away > 0.0 else -1.0
            if not left:
                return 0.0 * away  # 0, but not-a-number where the position is
            left -= 1
            return brake(velocity)

        return pulse

    def stored(self, position: float) -> float:
        """Return 0 J: a damper stores no energy."""
        return 0.0

    @property
    def phases(self) -> tuple[tuple[float, float], ...]:
        """Return the damping of a pulse, and nothing before and after it."""
        return (0.0, self.damping), (0.0, 0.0)

    def linearised(self) -> StateSpace:
        """Return the damping of a pulse, as a permanent damper."""
        return gain([[0.0, -self.damping]])
