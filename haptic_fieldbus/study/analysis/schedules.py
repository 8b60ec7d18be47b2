"""A loop whose samples and forces come at instants that differ from period to period, in a pattern that repeats.

A control tick that is not locked to SYNC, a position that is older than its latch, an adapter, a late host: each shifts
the instant at which a position is measured, or the instant from which its force acts. Between two instants the device
moves under a constant force, exactly. A pattern of N periods is therefore one linear map. Its eigenvalue of the largest
modulus decides stability (Floquet). A constant delay is a pattern of one period.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import EnvironmentOf, Plant, check_times, dynamics, limit_of, through_torque_loop
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, zoh
from haptic_fieldbus.numerics.sampled import spectral_radius


@dataclass(frozen=True)
class Instants:
    """Instants of one period [s], counted from its nominal beginning k·T."""

    measured: float
    """Instant at which the position was measured; negative if it was measured before the latch."""
    acts: float
    """Instant from which its force acts."""


@dataclass(frozen=True)
class Ticks:
    """Control ticks of a drive at phase + n·period [s], in the time of the loop."""

    period: float
    phase: float = 0.0

    def after(self, instant: float) -> float:
        """Return the first tick from `instant` on."""
        return self.phase + math.ceil((instant - self.phase) / self.period - 1e-9) * self.period

    def before(self, instant: float) -> float:
        """Return the last tick up to `instant`."""
        return self.phase + math.floor((instant - self.phase) / self.period + 1e-9) * self.period


def free_ticks(
    ticks: Ticks, period: float, arrival: float, lateness: Sequence[float], latency: float = 0.0
) -> tuple[Instants, ...]:
    """Return the pattern of a drive whose ticks are not locked to SYNC, for the lateness [s] of each SYNC.

    A set-point arrives `arrival` after SYNC. The position at SYNC is that of the last tick, older by `latency`. The
    pattern repeats only if its periods together are a whole number of ticks; otherwise raises UsageError.
    """
    turns = len(lateness) * period / ticks.period
    if abs(turns - round(turns)) > 1e-6:
        raise UsageError(f"{len(lateness)} periods are {exactly(turns)} ticks: expected a whole number")
    syncs = [place * period + late for place, late in enumerate(lateness)]
    return tuple(
        Instants(ticks.before(sync) - latency - place * period, ticks.after(sync + arrival) - place * period)
        for place, sync in enumerate(syncs)
    )


def schedule_growth(plant: Plant, period: float, pattern: Sequence[Instants], environment: StateSpace) -> float:
    """Return the mean growth of the loop in a period of the pattern; below 1 is stable.

    The environment is that of a contact. Without a restoring force, an eigenvalue is 1, and it counts.
    """
    return float(spectral_radius(_map(plant, period, pattern, environment)) ** (1.0 / len(pattern)))


def schedule_limit(plant: Plant, period: float, pattern: Sequence[Instants], environment_of: EnvironmentOf) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which the loop with this pattern is stable.

    0 and ∞ have the meaning of `linear.limit_of`. Raises UsageError for impossible times [s].
    """
    check_times(period, 0.0)
    return limit_of(
        lambda stiffness: schedule_growth(plant, period, pattern, environment_of(stiffness)),
        plant.mass / period**2 + plant.damping / period,
    )


@dataclass(frozen=True)
class _Event:
    """A measurement, or the beginning of a force, at an instant of the pattern [s]."""

    at: float
    acts: bool


def _events(period: float, pattern: Sequence[Instants]) -> list[_Event]:
    """Return the events of one turn of the pattern in their order; each is shifted into [0, N·T)."""
    turn = len(pattern) * period
    found = []
    for place, each in enumerate(pattern):
        for instant, acts in ((each.measured, False), (each.acts, True)):
            found.append(_Event((place * period + instant) % turn, acts))
    # A force that acts at the very instant of a measurement does not change it.
    return sorted(found, key=lambda event: (event.at, event.acts))


def _waiting(period: float, pattern: Sequence[Instants]) -> int:
    """Return the forces that are computed before the beginning of the pattern and act after it."""
    turn = len(pattern) * period
    count = 0
    for place, each in enumerate(pattern):
        begins, ends = place * period + each.measured, place * period + each.acts
        # Forces of the turns before and of this one that are measured before 0 and act from 0 on.
        count += math.floor(ends / turn) - math.floor(begins / turn)
    return count


def _map(plant: Plant, period: float, pattern: Sequence[Instants], environment: StateSpace) -> Matrix:
    """Return the map of one turn on (device, environment, acting force, waiting forces, the oldest first)."""
    a, b = through_torque_loop(*dynamics(plant), plant.torque_lag)
    order, inner = len(a), environment.order
    waiting = _waiting(period, pattern)
    # Each row is one state now, as it follows from the states at the beginning of the turn.
    rows = np.eye(order + inner + 1 + waiting)
    device, memory, force, queue = (
        rows[:order],
        rows[order : order + inner],
        rows[order + inner],
        [*rows[order + inner + 1 :]],
    )
    now, turn = 0.0, len(pattern) * period
    for event in _events(period, pattern):
        device, now = _moved(a, b, event.at - now, device, force), event.at
        if event.acts:
            force = queue.pop(0)
        else:
            queue.append(environment.c[0] @ memory + environment.d[0, 0] * device[0])
            memory = environment.a @ memory + np.outer(environment.b[:, 0], device[0])
    return np.vstack([_moved(a, b, turn - now, device, force), memory, force, *queue])


def _moved(a: Matrix, b: Matrix, span: float, device: Matrix, force: Matrix) -> Matrix:
    """Return the rows of the device after `span` [s] under a force."""
    transition, gain = zoh(a, b, span)
    moved: Matrix = transition @ device + np.outer(gain[:, 0], force)
    return moved
