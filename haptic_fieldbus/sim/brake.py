"""Slowing down by the motor, as quick stop and fault reaction ask for.

A speed controller at the control ticks, torque proportional to speed and limited; the shaft is at rest when it is
slower than `REST`. A hand that keeps pushing cannot prevent the end: it comes after `LONGEST_NS`.
"""

from dataclasses import dataclass

REST = 0.2
"""[rad/s]"""
LONGEST_NS = 1_000_000_000
_TICKS = 8
"""The speed falls by 1/e in so many ticks when the torque is not limited."""


@dataclass(frozen=True)
class Brake:
    """One braking, begun at `begin_ns`; inertia [kg·m²], limit [N·m], tick [s]."""

    begin_ns: int
    inertia: float
    limit: float
    tick: float

    def torque(self, velocity: float) -> float:
        """Against the motion [N·m]."""
        return max(-self.limit, min(self.limit, -velocity * self.inertia / (_TICKS * self.tick)))

    def finished(self, velocity: float, t_ns: int) -> bool:
        """At rest, or given up."""
        return abs(velocity) < REST or t_ns - self.begin_ns >= LONGEST_NS
