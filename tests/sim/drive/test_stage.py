"""The drive's own loops: damped on any rig, exact at rest, and its torque step in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from haptic_fieldbus.sim.drive.settings import DriveSettings
from haptic_fieldbus.sim.hand import HANDS
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from tests.sim.bench import MS, DriveBench, axis, profile
from tests.sim.drive.sentences import read

ENABLE = 0x0F
FRICTION, DAMPING, INERTIA, RATED = 2e-3, 1e-4, 4e-5, 0.4
LAG = 1 / (2 * math.pi * profile().timing.torque_bandwidth)

# inertia [kg·m²], damping [N·m·s/rad], friction [N·m], rated torque [N·m], torque bandwidth [Hz], control period [s]
RIGS = {
    "the shipped bench": (4e-5, 1e-4, 2e-3, 0.4, 1000.0, 4e-4),
    "a small motor": (1e-7, 1e-7, 1e-5, 0.005, 2000.0, 1e-4),
    "a heavy axis": (0.5, 0.05, 0.2, 100.0, 200.0, 1e-3),
    "a slow torque loop": (4e-5, 0.0, 0.0, 0.4, 30.0, 1e-3),
    "much damping": (4e-5, 0.05, 0.0, 0.4, 1000.0, 5e-4),
    "no control period": (4e-5, 1e-4, 2e-3, 0.4, 1000.0, 0.0),
    "no friction": (4e-5, 0.0, 0.0, 0.4, 1000.0, 4e-4),
}


def _bench(rig: str, **settings: object) -> DriveBench:
    inertia, damping, friction, rated, bandwidth, period = RIGS[rig]
    base = profile()
    timed = replace(base, timing=replace(base.timing, torque_bandwidth=bandwidth, control_period=period))
    built = axis(inertia=inertia, viscous_damping=damping, coulomb_friction=friction, rated_torque=rated)
    return DriveBench(timed, built, settings=DriveSettings(**settings))  # type: ignore[arg-type]


def _enable(bench: DriveBench, mode: int) -> None:
    assert bench.write(0x6060, 0, mode, "b") is None
    for word in (0x06, 0x07, ENABLE):
        assert bench.write(0x6040, 0, word, "H") is None


class TestTorqueStep:
    """τ = u(1 − e^(−t/T)); the shaft breaks away at τ = fc and then J·ω' = τ − fc − b·ω."""

    TARGET = 0.25 * RATED

    def _closed_form(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, speed and torque at times after the step; written out by hand."""
        u, tau = self.TARGET, LAG
        start = -tau * math.log(1 - FRICTION / u)
        torque = u * -np.expm1(-t / tau)
        s = np.maximum(t - start, 0.0)
        # J·ω' + b·ω = A·(1 − e^(−s/T)), A = u − fc, from rest.
        a, pole = u - FRICTION, DAMPING / INERTIA
        k = a / (INERTIA * (pole - 1 / tau))
        speed = a / DAMPING - k * np.exp(-s / tau) + (k - a / DAMPING) * np.exp(-pole * s)
        angle = a / DAMPING * s + k * tau * np.expm1(-s / tau) - (k - a / DAMPING) / pole * np.expm1(-pole * s)
        return angle, speed, torque

    def _moments(self) -> np.ndarray:
        return np.concatenate((np.arange(0, 2 * MS, 1_000), np.arange(2 * MS, 300 * MS, 777_777)))

    def test_shaft_and_motor_follow_the_closed_form_to_1e_9(self) -> None:
        bench = DriveBench(drive_axis=axis(coulomb_friction=FRICTION, viscous_damping=DAMPING, inertia=INERTIA))
        bench.enable()
        bench.sync()
        bench.control(ENABLE, 250)
        begin = bench.t_ns
        for _ in range(300):
            bench.run(MS)
            bench.sync()
        moments = self._moments()
        position, velocity, torque = Trajectory(bench.drive.plant.recorder, bench.t_ns).sample(begin + moments)
        angle, speed, motor = self._closed_form(moments * 1e-9)
        for found, expected in ((position, angle), (velocity, speed), (torque, motor)):
            assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()

    @pytest.mark.thorough("integrates with an adaptive solver")
    def test_the_closed_form_solves_the_equations(self) -> None:
        """The oracle's oracle: numerical integration of the equations as they stand in the class."""

        def slope(t: float, y: np.ndarray) -> list[float]:
            torque = self.TARGET * -math.expm1(-t / LAG)
            pull = torque - DAMPING * y[1]
            return [y[1], (pull - FRICTION) / INERTIA if pull > FRICTION or y[1] > 0 else 0.0]

        solved = solve_ivp(slope, (0.0, 0.01), [0.0, 0.0], rtol=1e-10, atol=1e-14, max_step=1e-6)
        angle, speed, _ = self._closed_form(solved.t)
        assert np.abs(solved.y[0] - angle).max() < 1e-5 * angle.max()
        assert np.abs(solved.y[1] - speed).max() < 1e-5 * speed.max()


class TestSpeedLoop:
    """A step in cyclic synchronous velocity mode."""

    @pytest.mark.thorough("7 cases of one rule", quick=2)
    @pytest.mark.parametrize("rig", RIGS)
    def test_a_step_is_followed_without_overshoot_and_without_lasting_error_on_any_rig(self, rig: str) -> None:
        bench = _bench(rig)
        _enable(bench, 9)
        bandwidth = bench.drive.stage.gains.bandwidth
        # A step that the torque can follow: the lag asks for J·v·a/2 at its beginning.
        inertia, damping, friction, rated, *_ = RIGS[rig]
        speed = 0.4 * (rated - friction) / (inertia * bandwidth / 2 + damping)
        target = round(speed * 4096 / (2 * math.pi))
        assert bench.write(0x60FF, 0, target, "i") is None
        seen = []
        for _ in range(60):
            bench.run(round(1e9 / bandwidth))
            seen.append(read(bench, 0x606C) / target)
        assert max(seen) < 1.06
        assert seen[-1] == pytest.approx(1.0, abs=0.002 + 2 / target)

    def test_the_step_is_a_first_order_lag_of_twice_the_bandwidths_time(self) -> None:
        bench = _bench("no friction")
        _enable(bench, 9)
        bandwidth = bench.drive.stage.gains.bandwidth
        assert bandwidth == pytest.approx(1 / (4 * (4e-4 + LAG)))
        assert bench.write(0x60FF, 0, 20_000, "i") is None
        begin = bench.t_ns
        for _ in range(30):
            bench.run(MS)
            expected = -20_000 * math.expm1(-0.5 * bandwidth * (bench.t_ns - begin) * 1e-9)
            assert read(bench, 0x606C) == pytest.approx(expected, abs=0.09 * 20_000)

    def test_after_saturation_it_does_not_overshoot_more_than_a_twentieth(self) -> None:
        bench = _bench("the shipped bench")
        assert bench.write(0x6072, 0, 100, "H") is None
        _enable(bench, 9)
        assert bench.write(0x60FF, 0, 60_000, "i") is None
        highest = 0
        for _ in range(400):
            bench.run(MS)
            highest = max(highest, read(bench, 0x606C))
        assert 60_000 <= highest < 63_000


class TestPositionLoop:
    """In profile position and cyclic synchronous position mode."""

    @pytest.mark.thorough("7 cases of one rule", quick=2)
    @pytest.mark.parametrize("rig", RIGS)
    def test_a_positioning_ends_on_its_count_on_any_rig(self, rig: str) -> None:
        """It overshoots by what the torque loop is late: a speed error of a·T, made good in 1/bandwidth."""
        bench = _bench(rig)
        late = 1 / (2 * math.pi * RIGS[rig][4]) / bench.drive.stage.gains.bandwidth * read(bench, 0x6083)
        assert bench.write(0x6067, 0, 2, "I") is None
        _enable(bench, 1)
        assert bench.write(0x607A, 0, 10_000, "i") is None
        assert bench.write(0x6040, 0, ENABLE | 0x10, "H") is None
        highest = 0
        for _ in range(1000):
            bench.run(5 * MS)
            highest = max(highest, read(bench, 0x6064))
            if read(bench, 0x6041) & 0x0400:
                break
        bench.run(500 * MS)
        assert read(bench, 0x6064) == pytest.approx(10_000, abs=2)
        assert highest <= 10_040 + 1.5 * late

    def test_a_constant_speed_costs_the_following_error_of_the_gain_and_none_with_velocity_offset(self) -> None:
        bench = _bench("the shipped bench")
        assert bench.write(0x60C2, 1, 1, "B") is None
        _enable(bench, 8)
        speed, gain = 10, bench.drive.stage.gains.position  # counts a millisecond
        for forward, error in ((0, 1000 * speed / gain), (1000 * speed, 0.0)):
            assert bench.write(0x60B1, 0, forward, "i") is None
            for _ in range(500):
                target = read(bench, 0x607A) + speed
                assert bench.write(0x607A, 0, target, "i") is None
                bench.run(MS)
            assert read(bench, 0x60F4) == pytest.approx(error, abs=3)

    def test_a_pushing_hand_leaves_no_error(self) -> None:
        """6 N on the handle; the integral of the speed loop holds against it."""
        bench = DriveBench(hand=HANDS["push"])
        _enable(bench, 8)
        bench.run(900 * MS)
        assert abs(read(bench, 0x6074)) > 50
        assert read(bench, 0x60F4) == pytest.approx(0, abs=2)

    def test_a_stuck_encoder_is_what_the_loop_sees(self) -> None:
        bench = _bench("the shipped bench")
        _enable(bench, 8)
        bench.run(5 * MS)
        bench.drive.servo.stuck_until_ns = bench.t_ns + 50 * MS
        assert bench.write(0x607A, 0, 1000, "i") is None
        bench.run(40 * MS)
        assert read(bench, 0x60F4) == pytest.approx(1000, abs=1)
        assert bench.drive.plant.position > 0.5
