"""When a target acts, and what the encoder shows."""

import math

import pytest

from haptic_fieldbus.sim.drive.servo import FirmwareTimes, Servo
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from tests.cases import every

SHAFT = Shaft(4e-5, 0.0, 0.0, 1e-4)
TICK = 400_000


def _servo(period_ns: int = TICK, **options: float) -> Servo:
    plant = Plant(SHAFT, None, position=options.get("position", 0.0), velocity=options.get("velocity", 0.0))
    return Servo(plant, counts_per_revolution=4096, timing=FirmwareTimes(period_ns), phase=options.get("phase", 0.0))


def _targets(servo: Servo) -> list[tuple[int, float]]:
    times, torques = Trajectory(servo.plant.recorder, servo.plant.t_ns).targets()
    return list(zip(times.tolist(), torques.tolist(), strict=True))


@pytest.mark.parametrize(("arrival", "acts"), [(1, 400_000), (400_000, 400_000), (400_001, 800_000), (0, 0)])
def test_a_target_acts_at_the_next_tick_counted_from_power_on(arrival: int, acts: int) -> None:
    servo = _servo()
    servo.advance(arrival)
    servo.command(0.1, arrival)
    servo.advance(5_000_000)
    assert _targets(servo) == [(acts, 0.1)]


@pytest.mark.parametrize(("delay", "acts"), [(10, 400_000), (400_000, 400_000), (700_000, 800_000)])
def test_ticks_are_counted_from_the_end_of_the_last_sync(delay: int, acts: int) -> None:
    servo = _servo()
    sync = 1_234_567
    servo.sync(sync)
    servo.command(0.1, sync + delay)
    servo.advance(5_000_000)
    assert _targets(servo) == [(sync + acts, 0.1)]


def test_a_sync_is_a_tick_itself() -> None:
    servo = _servo()
    servo.sync(0)
    servo.command(0.1, 900_000)
    servo.sync(1_000_000)
    servo.advance(5_000_000)
    assert _targets(servo) == [(1_000_000, 0.1)]


def test_of_two_targets_before_a_tick_the_later_one_acts() -> None:
    servo = _servo()
    servo.command(0.1, 10)
    servo.command(0.2, 20)
    servo.advance(5_000_000)
    assert _targets(servo) == [(TICK, 0.2)]


def test_a_target_whose_tick_has_come_acts_even_when_the_next_one_arrives_before_anybody_looked() -> None:
    servo = _servo()
    servo.command(0.1, 10)
    servo.command(0.2, 500_000)
    servo.advance(5_000_000)
    assert _targets(servo) == [(400_000, 0.1), (800_000, 0.2)]


def test_without_a_control_period_a_target_acts_at_once() -> None:
    servo = _servo(period_ns=0)
    servo.command(0.1, 123)
    servo.advance(5_000_000)
    assert _targets(servo) == [(123, 0.1)]


def test_cutting_the_torque_acts_at_once_and_forgets_what_waits() -> None:
    servo = _servo()
    servo.command(0.1, 0)
    servo.command(0.2, 450_000)
    servo.cut(500_000)
    servo.advance(5_000_000)
    assert _targets(servo) == [(0, 0.1), (500_000, 0.0)]


class TestEncoder:
    """counts = floor(N·θ/2π + phase + 1/2), 32 bits."""

    @every("phase", [-0.5, -0.2, 0.0, 0.3, 0.49])
    @every("counts", [-1000.6, -1.0, -0.5, 0.0, 0.49, 0.5, 12.3, 4095.999])
    def test_it_rounds_down_to_whole_counts(self, counts: float, phase: float) -> None:
        servo = _servo(position=counts * 2 * math.pi / 4096, phase=phase)
        angle = servo.plant.position
        assert servo.counts() == math.floor(angle * 4096 / (2 * math.pi) + phase + 0.5)

    @pytest.mark.parametrize("phase", [-0.5, -0.1, 0.49])
    def test_it_shows_zero_where_it_was_switched_on_whatever_its_phase(self, phase: float) -> None:
        assert _servo(phase=phase).counts() == 0

    @pytest.mark.parametrize(
        ("jump", "shown"), [(2**31 - 1, 2**31 - 1), (2**31, -(2**31)), (-(2**31) - 1, 2**31 - 1), (2**32, 0)]
    )
    def test_it_wraps_at_32_bits(self, jump: int, shown: int) -> None:
        servo = _servo()
        servo.jump(jump)
        assert servo.counts() == shown

    def test_a_stuck_encoder_shows_what_it_showed_until_it_is_free(self) -> None:
        servo = _servo(velocity=10.0)
        servo.advance(1_000_000)
        shown = servo.counts()
        servo.stuck_until_ns = 3_000_000
        servo.advance(2_000_000)
        assert servo.counts() == shown
        servo.advance(3_000_000)
        assert servo.counts() == round(0.03 * 4096 / (2 * math.pi))
