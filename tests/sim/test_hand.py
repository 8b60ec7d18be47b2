"""The hands: forces over time, and what the motor shaft feels of them."""

import math

import numpy as np
import pytest

from haptic_fieldbus.drive.rig import LinearMechanism, RotaryMechanism
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import HANDS, Hand, grip, hand_named
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

LINEAR = LinearMechanism("linear", metres_per_revolution=0.05)
RATIO = 0.05 / (2 * math.pi)


def _force(name: str, times: Matrix) -> Matrix:
    """Force on the hand's mass [N] at these times after enabling [s], read back through a linear mechanism."""
    hand = HANDS[name]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(hand, LINEAR))
    plant.advance(100_000_000)
    plant.start_hand()
    plant.advance(100_000_000 + round(times.max() * 1e9))
    trajectory = Trajectory(plant.recorder, plant.t_ns)
    return trajectory.hand_force(100_000_000 + np.round(times * 1e9).astype(np.int64)) / RATIO


def _expected(name: str, t: float) -> float:
    if name == "push":
        return min(12 * t, 6.0)
    if name == "release":
        return min(12 * t, 6.0) if t < 2 else 0.0
    if name == "guide":
        return 1000.0 * 0.03 * (0.5 * math.pi) ** 2 * math.cos(0.5 * math.pi * t)
    if name == "shake":
        return 1000.0 * 0.03 * (2.0 * math.pi) ** 2 * math.cos(2.0 * math.pi * t)
    if name == "sine":
        return 4 * math.sin(2 * math.pi * t)
    return 10.0 if any(start <= t < start + 0.05 for start in (0.5, 1.5, 2.5)) else 0.0


@pytest.mark.parametrize("name", [name for name, hand in HANDS.items() if hand is not None])
def test_the_force_of_each_hand_is_the_one_that_its_name_promises(name: str) -> None:
    times = np.array([0.0, 0.1, 0.25, 0.499, 0.52, 0.549, 0.551, 1.0, 1.51, 1.999, 2.001, 2.53, 3.3])
    assert _force(name, times) == pytest.approx([_expected(name, t) for t in times], abs=1e-9)


def test_a_guiding_hand_leads_the_handle_over_its_stroke_and_back_whatever_it_meets() -> None:
    """x = 30 mm·(1 − cos ωt), period 4 s; at the end of the stroke friction holds the handle back by at most fc/k."""
    hand = HANDS["guide"]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(hand, LINEAR))
    plant.start_hand()
    for t in (0.5, 1.0, 2.0, 3.0, 4.0):
        plant.advance(round(t * 1e9))
        assert plant.position * RATIO == pytest.approx(0.03 * (1.0 - math.cos(0.5 * math.pi * t)), abs=2e-3)


def test_before_the_drive_is_enabled_a_hand_exerts_no_force() -> None:
    hand = HANDS["push"]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 0.0, 1e-4), grip(hand, LINEAR))
    plant.advance(1_000_000_000)
    assert plant.position == 0.0


def test_a_pushing_hand_presses_its_force_into_a_held_handle() -> None:
    """Six newtons at rest against friction and motor: δ = F/k."""
    hand = HANDS["push"]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 1.0, 1e-4), grip(hand, LINEAR))
    plant.start_hand()
    plant.advance(5_000_000_000)
    stretch = plant.state[3] * RATIO
    assert stretch == pytest.approx(6.0 / 300.0, rel=1e-6)


def test_a_grip_transforms_forces_by_the_ratio_and_impedances_by_its_square() -> None:
    felt = grip(Hand("test"), LINEAR)
    assert (felt.inertia, felt.damping, felt.stiffness) == pytest.approx((0.1 * RATIO**2, 4 * RATIO**2, 300 * RATIO**2))


def test_on_a_rotary_mechanism_a_newton_is_a_twentieth_of_a_newton_metre() -> None:
    push = HANDS["push"]
    assert push is not None
    felt = grip(push, RotaryMechanism("rotary", gear_ratio=2.0))
    assert felt.pieces[1].force == pytest.approx(6 * 0.05 / 2)
    assert felt.stiffness == pytest.approx(300 * (0.05 / 2) ** 2)


@pytest.mark.parametrize("sign", [1, -1])
def test_force_is_positive_towards_positive_positions_of_the_workspace(sign: int) -> None:
    push = HANDS["push"]
    assert push is not None
    mechanism = LinearMechanism("linear", metres_per_revolution=0.05, sign=sign)  # type: ignore[arg-type]
    plant = Plant(Shaft(4e-5, 1e-4, 0.0, 1e-4), grip(push, mechanism))
    plant.start_hand()
    plant.advance(100_000_000)
    assert plant.position * sign > 0


def test_a_hand_may_wait_before_it_begins() -> None:
    release = HANDS["release"]
    assert release is not None
    later = release.after(0.25)
    assert [piece.start for piece in later.pieces] == [0.25, 0.75]
    assert later.release == 2.25
    push = HANDS["push"]
    assert push is not None
    assert push.after(1.0).release is None


def test_hands_are_found_by_name() -> None:
    assert hand_named("tap") is HANDS["tap"]
    assert hand_named("none") is None
    with pytest.raises(UsageError, match='no hand "punch"; hands are: push, tap, sine, guide, shake, release, none'):
        hand_named("punch")
