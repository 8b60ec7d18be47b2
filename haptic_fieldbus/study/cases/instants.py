"""Cases of instants that differ from period to period: samples that are lost in a pattern, and a drive's own ticks."""

from collections.abc import Sequence

from haptic_fieldbus.margins import Plant, stiffness_limit
from haptic_fieldbus.margins.patterns import gaps, pattern_growth, pattern_limit
from haptic_fieldbus.margins.plant import sample
from haptic_fieldbus.margins.schedules import Ticks, free_ticks, schedule_limit
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.measure import region
from haptic_fieldbus.study.oracles import events
from haptic_fieldbus.study.oracles.contact import growth_of_turn
from haptic_fieldbus.study.oracles.polynomials import largest

PERIOD = 1e-3
DEVICE, VIRTUAL = Plant(0.1, 2.0, torque_lag=0.16e-3), 0.5
"""Device, and the damper of a wall by backward difference [N·s/m]."""
MOTOR = events.motor(0.1, 2.0, 0.16e-3)
"""The same device."""
AGREEMENT = 1e-6
"""Permitted relative difference of limits."""


def _wall(stiffness: float) -> StateSpace:
    return region.wall(stiffness, VIRTUAL, PERIOD, "backward-difference")


def _growth_by_hand(stiffness: float, turn: float, shots: Sequence[events.Shot]) -> float:
    """Return the growth over a whole turn."""
    return growth_of_turn(MOTOR, turn, shots, stiffness, VIRTUAL, PERIOD)


def _limit_by_hand(turn: float, shots: Sequence[events.Shot]) -> float:
    return largest(lambda stiffness: _growth_by_hand(stiffness, turn, shots) <= 1.0, 1.0, 1.4, 1e-9)


LATE = 0.3e-3
"""Time from a sample to its force [s]."""
LOST = ((1, 2), (1, 1, 3), (5, 1, 1))
"""Patterns, by the numbers of periods for which each force is held."""


def _shots(lengths: Sequence[int]) -> tuple[float, list[events.Shot]]:
    received = [place == 0 for length in lengths for place in range(length)]
    shots = [
        events.Shot(number * PERIOD, (number * PERIOD + LATE,), has_come) for number, has_come in enumerate(received)
    ]
    return len(received) * PERIOD, shots


def missed_frames_pattern(quick: bool) -> CaseResult:
    """Check limit and growth of a late, lagging loop that loses samples in a pattern and holds its last force.

    The damper keeps the last position that came, and divides the way from it by one period.
    """
    found = [pattern_limit(DEVICE, PERIOD, LATE, _wall, gaps(lengths)) for lengths in LOST]
    by_hand = [_limit_by_hand(*_shots(lengths)) for lengths in LOST]
    whole = stiffness_limit(DEVICE, PERIOD, LATE, _wall)
    apart = max(abs(one / other - 1.0) for one, other in zip(found, by_hand, strict=True))
    device, over = sample(DEVICE, PERIOD, LATE), 1.5 * by_hand[0]
    grown = pattern_growth(device, _wall(over), gaps(LOST[0])) ** sum(LOST[0])
    expected = _growth_by_hand(over, *_shots(LOST[0]))
    off = abs(grown / expected - 1.0)
    return CaseResult(
        f"one of three lost {rounded(by_hand[0], 6)} N/m, two of five {rounded(by_hand[1], 6)} N/m, four of seven "
        f"{rounded(by_hand[2], 6)} N/m; over three periods ×{rounded(expected, 6)} at 1.5 times the first",
        f"{values_text(found, 6)} N/m of {rounded(whole, 6)} without losses, apart by {rounded(apart, 1)}; "
        f"×{rounded(grown, 6)}, off by {rounded(off, 1)}",
        apart <= AGREEMENT and off <= AGREEMENT and max(found) < whole and expected > 1.01,
        "each pattern from event to event, with the force before given again for a lost sample",
        tolerance=f"{exactly(AGREEMENT)} of limits and growth",
        used=share_used((apart, AGREEMENT), (off, AGREEMENT)),
    )


TICK, ARRIVAL, AGE = 0.4e-3, 0.25e-3, 0.05e-3
"""Control ticks of a drive, way of a set-point to it, and age of a position at its tick [s]."""
LATENESS = (0.0, 0.15e-3)
"""How late each SYNC of two comes [s]; two periods are five ticks."""
PHASES = (0.0, 0.1e-3, 0.3e-3)


def _ticked(phase: float) -> tuple[float, list[events.Shot]]:
    """Return a turn of two periods, its ticks found by going through them."""
    ticks = [phase + number * TICK for number in range(-10, 20)]
    shots = []
    for number, late in enumerate(LATENESS):
        sync = number * PERIOD + late
        measured = max(tick for tick in ticks if tick <= sync + 1e-9) - AGE
        shots.append(events.Shot(measured, (min(tick for tick in ticks if tick >= sync + ARRIVAL - 1e-9),)))
    return len(LATENESS) * PERIOD, shots


def tick_phase(quick: bool) -> CaseResult:
    """Check the limit of a drive whose ticks are not locked to SYNC, by phase, and that the longest delay bounds it."""
    found, by_hand = [], []
    for phase in PHASES:
        pattern = free_ticks(Ticks(TICK, phase), PERIOD, ARRIVAL, LATENESS, AGE)
        found.append(schedule_limit(DEVICE, PERIOD, pattern, _wall))
        by_hand.append(_limit_by_hand(*_ticked(phase)))
    apart = max(abs(one / other - 1.0) for one, other in zip(found, by_hand, strict=True))
    longest = AGE + TICK + ARRIVAL + TICK + max(LATENESS)
    least = stiffness_limit(DEVICE, PERIOD, longest, _wall)
    return CaseResult(
        f"phases of 0, 0.1, 0.3 ms: {values_text(by_hand, 6)} N/m",
        f"{values_text(found, 6)} N/m, apart by {rounded(apart, 1)}; with the longest delay, {rounded(1e3 * longest)} "
        f"ms, in each period {rounded(least, 6)} N/m",
        apart <= AGREEMENT and least < min(found) < 0.99 * max(found),
        "each pattern from event to event, its ticks gone through one after another",
        tolerance=f"{exactly(AGREEMENT)} of each limit",
        used=share_used((apart, AGREEMENT)),
    )
