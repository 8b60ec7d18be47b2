"""Error along a run: the virtual mass swings freely behind a held puck, for up to ten million steps of the loop.

The puck is held at 0 and the mass starts 10 mm away, so F(t) = k·A·cos(ωt) for ever, and the energy never changes. The
phase n·T·ω is reduced with 50 decimal digits, so the reference is right to the last digit after ten million steps too.
The step of the loop starts at rest; two samples of input bring it to the start, because two inputs can reach any two
states. The true states at a sample follow from two successive forces, because two outputs determine two states.
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
"""Period of the loop [s]."""
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459")
DIGITS = 50
"""Decimal digits in which the phase is reduced."""
PER_DECADE = 12
"""Places per decade of steps."""
WINDOW = 160
"""Steps before each place over which the largest error is taken: half a turn of the mass, π/(ω·T) = 157."""


@dataclass(frozen=True)
class Growth:
    """Error and energy of one method along a run; all tuples have the same length."""

    method: str
    steps: tuple[int, ...]
    """Places: numbers of steps done."""
    error: tuple[float, ...]
    """Largest error of the force in the window before each place, as a share of its amplitude."""
    energy: tuple[float, ...]
    """Energy at each place over that at the start, minus 1."""
    diverged_at: int | None
    """First place at which a number is no longer finite; None when all are."""


def places(total: int) -> list[int]:
    """Return the places of a run, even on a logarithmic scale and at least a window apart."""
    count = max(2, round(PER_DECADE * math.log10(total / WINDOW)))
    found: list[int] = []
    for place in np.geomspace(WINDOW, total, count).round().astype(int).tolist():
        if not found or place - found[-1] >= WINDOW:
            found.append(place)
    return found


def exact_force(step: int, period: float = PERIOD) -> float:
    """Return k·A·cos(ω·step·T) [N], its phase reduced in `DIGITS` digits."""
    # Decimal(float) is exact: the period is that of the loop to the last bit, not the number it is written as.
    with localcontext(prec=DIGITS):
        phase = (Decimal(STIFFNESS) / Decimal(MASS)).sqrt() * Decimal(period) * step % (2 * PI)
    return STIFFNESS * WAY * math.cos(float(phase))


def start(one: OneStep, step: Callable[[float], float]) -> None:
    """Bring a fresh step from rest to a mass that rests 10 mm away, by three inputs; the first fixes the origin."""
    system = one.system
    wanted = one.stored(np.array([WAY, 0.0]), np.zeros(2))
    g = system.b[:, 0]
    first, second = np.linalg.solve(np.column_stack([system.a @ g, g]), wanted)
    for position in (0.0, float(first), float(second)):
        step(position)


def energy(one: OneStep, forces: tuple[float, float]) -> float:
    """Return the energy of the mass [J] at the sample of the second force; the puck is at 0."""
    system, (by_state, _) = one.system, one.state
    observed = np.vstack([system.c, system.c @ system.a])
    position, velocity = by_state @ (system.a @ np.linalg.solve(observed, np.array(forces)))
    with np.errstate(over="ignore"):  # forward Euler grows up to infinity
        return float(0.5 * STIFFNESS * position**2 + 0.5 * MASS * velocity**2)


def free_swing(method: str, total: int) -> Growth:
    """Run the step of the loop `total` times, and compare it with the exact force at the places of the run."""
    one = integrators.discretise(sprung_mass(), PERIOD, method)
    step = integrators.bind(sprung_mass(), PERIOD, method)
    start(one, step)
    begin, amplitude = 0.5 * STIFFNESS * WAY**2, STIFFNESS * WAY
    rows: list[tuple[int, float, float]] = []
    done, diverged_at = 0, None
    for place in places(total):
        # A deque without room drops the forces of the steps in between at the speed of C.
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
