"""Error along a run: the virtual mass swings freely behind a held puck, for up to ten million steps of the loop's own.

The puck is held at 0 and the mass starts 10 mm away, so F(t) = k·A·cos(ωt) for ever and the energy never changes. The
phase n·T·ω is reduced in 50 decimal digits: the reference is right to the last digit after ten million steps too. The
loop's step starts at rest; two samples of input bring it to the start, as two inputs can bring two states anywhere. The
true states at a sample follow from two successive forces, since two outputs tell two states.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal, localcontext
from itertools import repeat

import numpy as np

from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.integrators import OneStep
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, WAY, sprung_mass

PERIOD = 1e-3
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459")
DIGITS = 50
PER_DECADE = 12
WINDOW = 160
"""Steps up to each place looked at, half a turn of the mass, over which the largest error counts."""


@dataclass(frozen=True)
class Growth:
    """How one method goes astray; all lists of the same length."""

    method: str
    steps: tuple[int, ...]
    error: tuple[float, ...]
    """Largest error of the force around there, as a share of its amplitude."""
    energy: tuple[float, ...]
    """Energy over its start, minus 1."""
    diverged_at: int | None
    """The first place looked at where numbers are no longer finite."""


def places(total: int) -> list[int]:
    """Steps to look at, evenly on a logarithmic scale and at least a window apart, the last one `total`."""
    count = max(2, round(PER_DECADE * math.log10(total / WINDOW)))
    found: list[int] = []
    for place in np.geomspace(WINDOW, total, count).round().astype(int).tolist():
        if not found or place - found[-1] >= WINDOW:
            found.append(place)
    return found


def exact_force(step: int, period: float = PERIOD) -> float:
    """k·A·cos(ω·step·T) [N], the phase in 50 digits."""
    with localcontext(prec=DIGITS):
        phase = (Decimal(STIFFNESS) / Decimal(MASS)).sqrt() * Decimal(period) * step % (2 * PI)
    return STIFFNESS * WAY * math.cos(float(phase))


def start(one: OneStep, step: Callable[[float], float]) -> None:
    """Bring a fresh step from rest to the mass at 10 mm, at rest: the first input fixes the origin."""
    system = one.system
    wanted = one.stored(np.array([WAY, 0.0]), np.zeros(2))
    g = system.b[:, 0]
    first, second = np.linalg.solve(np.column_stack([system.a @ g, g]), wanted)
    for position in (0.0, float(first), float(second)):
        step(position)


def energy(one: OneStep, forces: tuple[float, float]) -> float:
    """Of the mass [J] at the sample of the second force, the puck at 0."""
    system, (by_state, _) = one.system, one.state
    observed = np.vstack([system.c, system.c @ system.a])
    position, velocity = by_state @ (system.a @ np.linalg.solve(observed, np.array(forces)))
    with np.errstate(over="ignore"):
        return float(0.5 * STIFFNESS * position**2 + 0.5 * MASS * velocity**2)


def free_swing(method: str, total: int) -> Growth:
    """Run the loop's step `total` times and look at it on the way."""
    one = integrators.discretise(sprung_mass(), PERIOD, method)
    step = integrators.bind(sprung_mass(), PERIOD, method)
    start(one, step)
    begin, amplitude = 0.5 * STIFFNESS * WAY**2, STIFFNESS * WAY
    rows: list[tuple[int, float, float]] = []
    done, diverged_at = 0, None
    for place in places(total):
        deque(map(step, repeat(0.0, place - WINDOW - done)), maxlen=0)
        forces = list(map(step, repeat(0.0, WINDOW)))
        if not all(map(math.isfinite, forces)):
            diverged_at = place
            break
        errors = [abs(force - exact_force(place - WINDOW + index)) for index, force in enumerate(forces)]
        rows.append((place, max(errors) / amplitude, energy(one, (forces[-2], forces[-1])) / begin - 1.0))
        done = place
    seen, found, drift = zip(*rows, strict=True)
    return Growth(method, seen, found, drift, diverged_at)
