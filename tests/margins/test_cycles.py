"""Predicted limit cycles beside the same loop simulated, friction, encoder and saturation exact."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, quantisation_limit
from haptic_fieldbus.numerics.batch import Loops, Running, loops
from haptic_fieldbus.study.cases.friction import edge_chatter
from tests.loops import PERIOD, Array, wall

STEP = 1e-5


def motion(many: Loops, settle: int, kept: int) -> Array:
    """Positions at the samples after it has settled, (kept,)."""

    def positions() -> Iterator[float]:
        running = Running(many)
        running.advance(settle)
        for _ in range(kept):
            running.advance(1)
            yield float(running.state[0][0])

    return np.fromiter(positions(), dtype=np.float64)


def measured(positions: Array) -> tuple[float, float]:
    """Amplitude and angular frequency of what moves."""
    moving = positions - positions.mean()
    upwards = np.flatnonzero((moving[1:] > 0.0) & (moving[:-1] <= 0.0))
    span = (upwards[-1] - upwards[0]) / (len(upwards) - 1) * PERIOD
    return float(np.ptp(moving)) / 2.0, 2.0 * math.pi / float(span)


def pressed(plant: Plant, delay: float, stiffness: float, damping: float = 0.0) -> Loops:
    """A wall pressed to the edge between one count and two."""
    return loops(
        mass=plant.mass, damping=plant.damping, period=PERIOD, delay=delay, stiffness=stiffness,
        virtual_damping=damping, resolution=STEP, coulomb=plant.coulomb, push=1.5 * stiffness * STEP,
        position=1.5 * STEP,
    )  # fmt: skip


class TestChatterOverTheEdgeOfACount:
    @pytest.mark.thorough("simulates until the cycle has settled", quick=1)
    @pytest.mark.parametrize(
        ("plant", "delay", "damping"),
        [
            (Plant(0.63, 1.58, 0.0, STEP), 0.0, 0.0),
            (Plant(0.63, 1.58, 0.0, STEP), 1e-3, 0.0),
            (Plant(0.1, 5.0, 0.0, STEP), 0.3e-3, 0.0),
            (Plant(2.0, 10.0, 0.001, STEP), 2e-3, 0.0),
            (Plant(2.0, 10.0, 0.002, STEP), 2e-3, 0.0),
        ],
    )
    def test_is_as_large_and_as_fast_as_predicted(self, plant: Plant, delay: float, damping: float) -> None:
        found = edge_chatter(plant, PERIOD, delay, wall(600.0, damping))
        assert found is not None
        amplitude, turn = measured(motion(pressed(plant, delay, 600.0, damping), 5000, 1000))
        assert amplitude == pytest.approx(found.amplitude, rel=0.2)
        assert turn == pytest.approx(found.angular_frequency, rel=0.2)

    def test_is_told_right_in_order_of_magnitude_when_it_lasts_a_few_samples_only(self) -> None:
        plant = Plant(0.63, 1.58, 0.0, STEP)
        found = edge_chatter(plant, PERIOD, 0.3e-3, wall(600.0, 1.0))
        assert found is not None
        amplitude, _ = measured(motion(pressed(plant, 0.3e-3, 600.0, 1.0), 5000, 500))
        assert 0.4 < found.amplitude / amplitude < 1.2

    @pytest.mark.thorough("simulates until the cycle has died")
    @pytest.mark.parametrize("stiffness", [200.0, 600.0])
    def test_ends_where_friction_bridges_a_count(self, stiffness: float) -> None:
        """K ≤ 2·fc/D: rest; below, a cycle, in prediction and simulation alike."""
        for share, rests in ((1.05, True), (0.9, False)):
            plant = Plant(2.0, 10.0, share * 0.5 * stiffness * STEP, STEP)
            assert (edge_chatter(plant, PERIOD, 2e-3, wall(stiffness)) is None) is rests
            assert bool(np.ptp(motion(pressed(plant, 2e-3, stiffness), 3000, 200)) == 0.0) is rests
            limit = quantisation_limit(plant)
            assert limit is not None
            assert (limit >= stiffness) is rests

    def test_needs_an_encoder_and_a_stable_loop(self) -> None:
        assert edge_chatter(Plant(0.63, 1.58), PERIOD, 0.0, wall(600.0)) is None
        assert edge_chatter(Plant(0.63, 1.58, 0.0, STEP), PERIOD, 0.0, wall(6000.0)) is None
        assert edge_chatter(Plant(0.63, 0.0, 0.0, STEP), PERIOD, 0.0, wall(600.0)) is None
