"""Needle insertion: a capsule that punctures, then friction along the shaft and a cutting force at the tip.

The model follows Okamura, Simone & O'Leary (Force modeling for needle insertion into soft tissue, IEEE Trans.
Biomedical Engineering 51(10), 2004, 1707, doi:10.1109/TBME.2004.831542), who add stiffness, friction and cutting:

    before puncture   P·((1 − c)·u + c·u²), u = d/D: a nonlinear spring up to the effort P at the depth D
    at D              the capsule gives way: its force is gone, its stored energy is spent
    from then on      friction (modified Karnopp) + drag·ḋ, both ways, and cutting while the tip goes deeper than ever

Karnopp's friction holds a sticking body with exactly the force that acts on it, which an impedance display does not
measure. Here a spring, `grip`, holds it: up to `breakaway`, then the needle slips with `friction` until it is slower
than `slow` (Okamura's Δv/2). The cutting edge is a spring of that stiffness too: it holds up to `cutting`, moves on
with a tip that cuts, and only pushes outwards. Outside of the tissue all forces are zero. With `heals` the next
insertion punctures anew; without it the needle enters the open hole again.

Energy, in continuous time. The needle gives back at most the energy that it took, and never more than it stores: before
puncture the capsule's P·D·((1 − c)/2 + c/3), afterwards breakaway²/(2·grip) + cutting²/(2·grip). It is passive. Sampled
and held, it leaks at most K·Σ(Δx)²/2 with K the largest of its stiffnesses (`stiffness`), slips, cuts and exits between
samples included, and for `drag` as much as any held damper.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import (
    STRICT,
    Damping,
    Effort,
    Law,
    Length,
    Place,
    PositiveEffort,
    Share,
    Speed,
    Stiffness,
    below,
)
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Needle:
    """Tissue that starts at `position` [m or rad]; the force `puncture` [N or N·m] punctures it at `depth` [m or rad].

    Before puncture the force grows with the depth; the share `curvature` of it grows with the square of the depth.
    After puncture `friction`, `breakaway` while sticking (0: equal to `friction`), `cutting` on the way deeper [N or
    N·m] and `drag` [N·s/m or N·m·s/rad] act. The needle sticks with the stiffness `grip` [N/m or N·m/rad]. It sticks
    again below the speed `slow` [m/s or rad/s]. If the tissue `heals`, the next insertion punctures it again. `side` is
    the side on which the tissue lies.
    """

    axis: str
    puncture: PositiveEffort
    depth: Length
    grip: Stiffness
    friction: Effort = 0.0
    breakaway: Effort = 0.0
    cutting: Effort = 0.0
    drag: Damping = 0.0
    slow: Speed = 0.005
    curvature: Share = 0.5
    position: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    heals: bool = True
    name: str = "needle"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        """Raise ValueError when `breakaway` is given but below `friction`."""
        if 0.0 < self.breakaway < self.friction:
            raise ValueError(
                f"breakaway {exactly(self.breakaway)}: expected 0, or from friction ({exactly(self.friction)}) up"
            )

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Position, and velocity only where the force depends on the speed of slipping."""
        return (Signal.POSITION, Signal.VELOCITY) if self.drag or self.breakaway else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return a law that remembers whether the capsule is open, and where friction and the edge hold."""
        inwards = 1.0 if self.side == "positive" else -1.0
        surface, capsule, whole_depth, drag, heals = self.position, self._capsule, self.depth, self.drag, self.heals
        along, tip = _bind_friction(self), _bind_edge(self.grip, self.cutting)
        is_open = is_out = False

        def force(position: float, velocity: float = 0.0) -> float:
            nonlocal is_open, is_out
            depth, speed = inwards * (position - surface), inwards * velocity
            if depth <= 0.0:
                is_open, is_out = is_open and not heals, True
                return 0.0
            if not is_open and depth < whole_depth:
                return -inwards * capsule(depth)
            # Friction starts anew at every entry, the edge only at a puncture: in an open hole nothing is left to cut.
            push = along(depth, speed, afresh=not is_open or is_out) + tip(depth, afresh=not is_open) + drag * speed
            is_open, is_out = True, False
            return -inwards * push

        return force

    def penetration(self, position: float) -> float:
        """Return the depth of the tip below the surface of the tissue [m or rad], capsule open or not."""
        return below(position, self.position, self.side)

    def _capsule(self, depth: float) -> float:
        """Return the push of the closed capsule at a depth [N or N·m]."""
        part = depth / self.depth
        return self.puncture * part * (1.0 - self.curvature + self.curvature * part)

    @property
    def stiffness(self) -> float:
        """The larger stiffness of the capsule as it gives way and of the grip after it [N/m or N·m/rad]."""
        return max(stiffness for stiffness, _ in self.phases)

    def with_stiffness(self, stiffness: float) -> Self:
        scaled = ("puncture", "grip", "friction", "breakaway", "cutting", "drag")
        factor = stiffness / self.stiffness
        return replace(self, **{name: factor * getattr(self, name) for name in scaled})

    @property
    def reserve(self) -> float:
        """Largest energy that capsule, or friction and cutting edge, can hold [J]."""
        capsule = self.puncture * self.depth * (0.5 * (1.0 - self.curvature) + self.curvature / 3.0)
        gripping = max(self.friction, self.breakaway) ** 2 + self.cutting**2
        return max(capsule, 0.5 * gripping / self.grip)

    @property
    def phases(self) -> tuple[tuple[float, float], ...]:
        """Return the phases: both ends of the closed capsule, without drag; then the open tissue, with drag."""
        slope = self.puncture / self.depth
        held = self.grip * ((self.friction > 0.0 or self.breakaway > 0.0) + (self.cutting > 0.0))
        capsule = ((slope * (1.0 - self.curvature), 0.0), (slope * (1.0 + self.curvature), 0.0))
        return (*capsule, (held, self.drag), (0.0, self.drag), (0.0, 0.0))

    def linearised(self) -> StateSpace:
        """Return the largest stiffness, with the drag."""
        return gain([[-self.stiffness, -self.drag]])


def _bind_friction(needle: Needle) -> Callable[..., float]:
    """Return (depth, speed, afresh) → push of the shaft's friction; `afresh` relaxes its spring at this depth."""
    grip, slipping_at, slow = needle.grip, needle.friction, needle.slow
    sticking_at = needle.breakaway or needle.friction
    anchor, slips, direction = 0.0, False, 0.0

    def push(depth: float, speed: float, afresh: bool) -> float:
        nonlocal anchor, slips, direction
        if afresh:
            anchor, slips = depth, False
        # A slipping needle sticks again when it is slower than `slow`, or has turned round.
        slips = slips and direction * speed >= slow
        held = grip * (depth - anchor)
        if abs(held) > (slipping_at if slips else sticking_at):
            slips, direction = True, math.copysign(1.0, held)
            held = direction * slipping_at
            anchor = depth - held / grip
        return held

    return push


def _bind_edge(grip: float, cutting: float) -> Callable[..., float]:
    """Return (depth, afresh) → push of the cutting edge, which moves on with a tip that cuts and never back."""
    edge = 0.0

    def push(depth: float, afresh: bool) -> float:
        nonlocal edge
        if afresh:
            edge = depth
        held = grip * (depth - edge)
        if held > cutting:
            held, edge = cutting, depth - cutting / grip
        return 0.0 if held <= 0.0 else held

    return push
