"""Device of one mass under held forces, in closed form and plain numbers.

A plant m·ẍ = −b·ẋ + F is driven by a held force F_k = −K·x_k, which acts from td after its sample. With τ = m/b and
ε(t) = 1 − exp(−t/τ), a force f moves the plant from rest within t by f·(t − τ·ε)/b, to the speed f·ε/b.
"""

import math
from collections.abc import Callable
from typing import Protocol


class Massive(Protocol):
    """Device with a mass [kg] and a damping [N·s/m], or their rotary counterparts."""

    @property
    def mass(self) -> float: ...

    @property
    def damping(self) -> float: ...


def moved_by_force(device: Massive, x: float, v: float, force: float, span: float) -> tuple[float, float]:
    """Return position [m] and velocity [m/s] after a span [s] of constant force [N]."""
    if not device.damping:
        a = force / device.mass
        return x + span * (v + 0.5 * a * span), v + a * span
    tau = device.mass / device.damping
    part = -math.expm1(-span / tau)  # keeps its digits when the span is short
    return x + tau * part * v + force * (span - tau * part) / device.damping, v + part * (force / device.damping - v)


def sampled_positions(
    device: Massive,
    period: float,
    law: Callable[[float], float],
    steps: int,
    *,
    delay: float = 0.0,
    push: float = 0.0,
    start: tuple[float, float] = (1e-3, 0.0),
) -> list[float]:
    """Return the positions at the samples [m]; fewer than `steps` when the loop diverged.

    `law` maps a position to a force, `delay` is in periods, `push` is a constant force of the hand [N], and `start` is
    position and velocity at the first sample.
    """
    whole = math.floor(delay)
    rest = (delay - whole) * period
    x, v = start
    forces = [0.0] * (whole + 2)
    positions = []
    for _ in range(steps):
        positions.append(x)
        forces = [law(x), *forces[:-1]]
        if rest:  # until the delay is over, the force of the sample before still acts
            x, v = moved_by_force(device, x, v, forces[whole + 1] + push, rest)
        x, v = moved_by_force(device, x, v, forces[whole] + push, period - rest)
        if not abs(x) < 1e100:
            break
    return positions


def growth_of(positions: list[float]) -> float:
    """Return ln of the greatest |position| in the last tenth over that in the first tenth."""
    tenth = max(1, len(positions) // 10)
    return math.log(max(map(abs, positions[-tenth:])) / max(map(abs, positions[:tenth])))
