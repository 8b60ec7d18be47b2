"""Patterns of measuring and acting against scipy, one event after the other, and against the constant delay."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import stiffness_limit
from haptic_fieldbus.study.cases.timing import Instants, Ticks, free_ticks, schedule_limit
from tests.loops import BENCH, LAG, PERIOD, Array, wall, with_damping

PLANT = replace(BENCH, torque_lag=LAG)


def growth_by_hand(pattern: Sequence[Instants], stiffness: float, turns: int = 40) -> float:
    """Run the pattern for many turns from several starts, by scipy's exponential; the growth of the last ones.

    State: [x, v, motor force]; a measurement and its force meet again in a dictionary, by their number.
    """
    a = np.array([[0, 1, 0], [0, -PLANT.damping / PLANT.mass, 1 / PLANT.mass], [0, 0, -1 / LAG]])
    count, rows = len(pattern), []
    for start in np.eye(3):
        z, force, now = start.copy(), 0.0, -2 * PERIOD
        known: dict[int, float] = {}
        sizes: list[Array] = []
        events = sorted(
            (((turn * count + place) * PERIOD + at, kind, turn * count + place)
             for turn in range(turns) for place, each in enumerate(pattern)
             for at, kind in ((each.measured, 0), (each.acts, 1)))
        )  # fmt: skip
        for at, kind, number in events:
            system = np.zeros((4, 4))
            system[:3, :3], system[2, 3] = a, 1 / LAG
            z = (scipy.linalg.expm(system * (at - now)) @ [*z, force])[:3]
            now = at
            if kind:
                force = known.pop(number)
            else:
                known[number] = -stiffness * z[0]
                if number % count == 0:
                    sizes.append(z.copy())
        rows.append(sizes)
    states = np.array(rows).transpose(1, 2, 0)
    late = np.linalg.norm(states[-1]) / np.linalg.norm(states[turns // 2])
    return float(late)


@pytest.mark.thorough("10 cases of one rule", quick=3)
@pytest.mark.parametrize("delay", [0.2, 0.4, 1.0, 1.3, 2.7])
@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_a_constant_delay_is_a_pattern_of_one_period_or_two(delay: float, shift: float) -> None:
    exchange = Instants(-shift * delay * PERIOD, (1.0 - shift) * delay * PERIOD)
    expected = stiffness_limit(PLANT, PERIOD, delay * PERIOD, with_damping(0.3))
    for pattern in ([exchange], [exchange] * 2):
        assert schedule_limit(PLANT, PERIOD, pattern, with_damping(0.3)) == pytest.approx(expected, rel=1e-8)


@pytest.mark.thorough("runs long patterns by hand")
@pytest.mark.parametrize("phase", [0.0, 0.1e-3, 0.3e-3])
def test_the_limit_is_where_the_pattern_run_by_hand_begins_to_grow(phase: float) -> None:
    lateness = [0.0, 0.2e-3, 0.05e-3, 0.1e-3]
    pattern = free_ticks(Ticks(0.4e-3, phase), PERIOD, 0.277e-3, lateness, latency=0.06e-3)
    limit = schedule_limit(PLANT, PERIOD, pattern, wall)
    # The motion is an oscillation of some 20 turns: over many of them its size tells the growth.
    below, above = (growth_by_hand(pattern, part * limit, 400) for part in (0.97, 1.03))
    assert below < 1.0 < above


def test_free_ticks_repeat_only_with_whole_numbers_of_them() -> None:
    assert len(free_ticks(Ticks(0.4e-3), PERIOD, 0.277e-3, [0.0, 0.0])) == 2
    with pytest.raises(UsageError, match=r"expected a whole number"):
        free_ticks(Ticks(0.4e-3), PERIOD, 0.277e-3, [0.0])


def test_a_position_is_of_the_tick_before_and_a_force_from_the_tick_after() -> None:
    first, second = free_ticks(Ticks(0.4e-3, 0.1e-3), PERIOD, 0.277e-3, [0.0, 0.0], latency=0.05e-3)
    assert (first.measured, first.acts) == pytest.approx((-0.35e-3, 0.5e-3))
    assert (second.measured, second.acts) == pytest.approx((-0.15e-3, 0.3e-3))
