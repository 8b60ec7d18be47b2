"""Samples that are kept of a motion."""

import numpy as np
import pytest

from haptic_fieldbus.sim.hand import Grip, Piece
from haptic_fieldbus.sim.mechanics.motion import FORCE, Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

SHAFT = Shaft(4e-5, 1e-4, 2e-3, 1.6e-4)
GRIP = Grip(6e-6, 2.5e-4, 0.019, pieces=(Piece(0.0, 0.05), Piece(0.003, -0.02)))


def _moved(grip: Grip | None = None) -> Plant:
    plant = Plant(SHAFT, grip, velocity=1.0)
    plant.start_hand()
    for k in range(10):
        plant.set_target(0.005 * (-1) ** k)
        plant.advance((k + 1) * 1_000_000)
    return plant


@pytest.mark.parametrize("grip", [None, GRIP], ids=["free", "held"])
def test_samples_at_any_time_are_what_the_plant_was_at(grip: Grip | None) -> None:
    plant = Plant(SHAFT, grip, velocity=1.0)
    plant.start_hand()
    kept = []
    for k in range(40):
        plant.advance(k * 251_123)
        kept.append((plant.t_ns, plant.position, plant.velocity, plant.torque))
        if k % 7 == 0:
            plant.set_target(0.01 * (-1) ** k)
    times, position, velocity, torque = np.array(kept).T
    sampled = Trajectory(plant.recorder, plant.t_ns).sample(times.astype(np.int64))
    for ours, expected in zip(sampled, (position, velocity, torque), strict=True):
        assert ours == pytest.approx(expected, rel=1e-9, abs=1e-13)


def test_targets_are_told_with_the_time_of_their_taking_over() -> None:
    times, torques = Trajectory(_moved().recorder, 10_000_000).targets()
    assert times.tolist() == [k * 1_000_000 for k in range(10)]
    assert torques.tolist() == [0.005 * (-1) ** k for k in range(10)]


def test_the_force_of_the_hand_is_told() -> None:
    force = Trajectory(_moved(GRIP).recorder, 10_000_000).states(np.array([0, 2_999_999, 3_000_000, 10_000_000]))[
        :, FORCE
    ]
    assert force.tolist() == [0.05, 0.05, -0.02, -0.02]


@pytest.mark.parametrize("moment", [-1, 10_000_001])
def test_a_time_outside_the_motion_is_refused(moment: int) -> None:
    with pytest.raises(ValueError, match="known from 0 to 10000000 ns"):
        Trajectory(_moved().recorder, 10_000_000).sample(np.array([moment]))


def test_no_times_give_no_samples() -> None:
    position, _, _ = Trajectory(_moved().recorder, 10_000_000).sample(np.array([], dtype=np.int64))
    assert position.shape == (0,)


def test_later_motion_does_not_change_a_trajectory() -> None:
    plant = _moved()
    trajectory = Trajectory(plant.recorder, plant.t_ns)
    before = trajectory.states(np.array([9_500_000]))
    plant.set_target(1.0)
    plant.advance(20_000_000)
    assert np.array_equal(trajectory.states(np.array([9_500_000])), before)


def test_a_constant_target_needs_no_new_segments() -> None:
    plant = Plant(Shaft(4e-5, 1e-4, 0.0, 1.6e-4), None)
    for k in range(100):
        plant.set_target(0.01)
        plant.advance((k + 1) * 1_000_000)
    assert len(plant.recorder.flow_of_segment) == 2
