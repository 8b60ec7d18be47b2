"""The plant against closed forms, against scipy's solve_ivp, and against its own energy balance."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import Grip, Piece
from haptic_fieldbus.sim.mechanics import motion
from haptic_fieldbus.sim.mechanics.motion import ANGLE, FORCE, HAND_SPEED, SPEED, STRETCH, TORQUE, Motion, Shaft, State
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

LAG = 1 / (2 * math.pi * 1000)
SHAFT = Shaft(inertia=4e-5, damping=1e-4, coulomb=0.0, lag=LAG)
ROUGH = Shaft(inertia=4e-5, damping=1e-4, coulomb=2e-3, lag=LAG)
R = 0.05 / (2 * math.pi)
GRIP = Grip(inertia=0.1 * R**2, damping=4 * R**2, stiffness=300 * R**2, pieces=(Piece(0.0, 6 * R),))
MS = 1_000_000


def test_a_torque_step_gives_the_closed_form_of_inertia_damper_and_lag() -> None:
    plant, u = Plant(SHAFT, None), 0.02
    plant.set_target(u)
    pole = SHAFT.damping / SHAFT.inertia
    # J·ω' = u·(1 − e^(−t/T)) − b·ω
    slow = u / SHAFT.damping
    fast = u / SHAFT.inertia / (1 / LAG - pole)
    t = np.arange(0, 1001) * 1e-3
    for moment in range(1001):
        plant.advance(moment * MS)
    position, velocity, torque = Trajectory(plant.recorder, plant.t_ns).sample(np.arange(0, 1001) * MS)
    a = -slow - fast
    expected_velocity = slow + a * np.exp(-pole * t) + fast * np.exp(-t / LAG)
    expected_position = slow * t + a / pole * (1 - np.exp(-pole * t)) + fast * LAG * (1 - np.exp(-t / LAG))
    assert velocity == pytest.approx(expected_velocity, rel=1e-9, abs=1e-12)
    assert position == pytest.approx(expected_position, rel=1e-9, abs=1e-12)
    assert torque == pytest.approx(u * (1 - np.exp(-t / LAG)), rel=1e-9, abs=1e-14)
    assert (plant.position, plant.velocity, plant.torque) == pytest.approx(
        (position[-1], velocity[-1], torque[-1]), rel=1e-10
    )


def test_a_torque_step_against_coulomb_friction_gives_the_closed_form_from_its_breakaway_on() -> None:
    plant, u = Plant(ROUGH, None), 0.02
    plant.set_target(u)
    t = np.arange(0, 1001) * 1e-3
    for moment in range(1001):
        plant.advance(moment * MS)
    _, velocity, torque = Trajectory(plant.recorder, plant.t_ns).sample(np.arange(0, 1001) * MS)
    # u·(1 − e^(−t/T)) reaches the friction at t0; from there J·ω' = u·(1 − e^(−t/T)) − c − b·ω.
    pole, since = ROUGH.damping / ROUGH.inertia, t + LAG * math.log(1 - ROUGH.coulomb / u)
    slow = (u - ROUGH.coulomb) / ROUGH.damping
    fast = (u - ROUGH.coulomb) / ROUGH.inertia / (1 / LAG - pole)
    moving = slow + fast * np.exp(-since / LAG) - (slow + fast) * np.exp(-pole * since)
    assert velocity == pytest.approx(np.where(since > 0, moving, 0.0), rel=1e-9, abs=1e-12)
    assert torque == pytest.approx(u * (1 - np.exp(-t / LAG)), rel=1e-9, abs=1e-14)


def test_a_shaft_that_rests_is_not_followed_step_by_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bench stands unused for a day: nothing moves, and the next question is answered at once."""
    plants = [Plant(ROUGH, None, velocity=1.0) for _ in "ab"]
    for t_ms in range(1, 2001):
        plants[0].advance(t_ms * MS)
    plants[1].advance(2000 * MS)
    assert plants[1].state == plants[0].state
    steps: list[int] = []
    step = Motion.step

    def counted(motion: Motion, state: State, span_ns: int) -> State:
        steps.append(span_ns)
        return step(motion, state, span_ns)

    monkeypatch.setattr(Motion, "step", counted)
    plants[1].advance(86_400_000 * MS)
    assert len(steps) < 5
    assert (plants[1].state, plants[1].t_ns) == (plants[0].state, 86_400_000 * MS)
    plants[1].set_target(0.4)
    plants[1].advance(plants[1].t_ns + 100 * MS)
    assert plants[1].velocity > 0.0, "it can be moved as before"


def test_coulomb_friction_alone_stops_the_shaft_where_the_closed_form_says() -> None:
    shaft = Shaft(4e-5, 0.0, 2e-3, LAG)
    plant = Plant(shaft, None, velocity=7.0)
    deceleration = shaft.coulomb / shaft.inertia
    plant.advance(300 * MS)
    stop = 7.0 / deceleration
    times = np.array([0.02, 0.1, stop - 1e-6, stop + 1e-6, 0.3])
    position, velocity, _ = Trajectory(plant.recorder, plant.t_ns).sample(np.round(times * 1e9).astype(np.int64))
    times = np.round(times * 1e9) * 1e-9
    moving = np.minimum(times, stop)
    assert velocity == pytest.approx(7.0 - deceleration * moving, rel=1e-9, abs=1e-12)
    assert position == pytest.approx(7.0 * moving - deceleration * moving**2 / 2, rel=1e-12)
    assert plant.velocity == 0.0
    assert plant.position == pytest.approx(7.0**2 / (2 * deceleration), rel=1e-13)


def test_coulomb_and_viscous_friction_together_decay_as_the_closed_form_says() -> None:
    plant = Plant(ROUGH, None, velocity=20.0)
    plant.advance(400 * MS)
    pole, level = ROUGH.damping / ROUGH.inertia, ROUGH.coulomb / ROUGH.damping
    stop = math.log(1 + 20.0 / level) / pole
    moments = np.arange(0, 400 * MS, 3_333_333)
    t = np.minimum(moments * 1e-9, stop)
    position, velocity, _ = Trajectory(plant.recorder, plant.t_ns).sample(moments)
    assert velocity == pytest.approx((20.0 + level) * np.exp(-pole * t) - level, rel=1e-9, abs=1e-11)
    assert position == pytest.approx((20.0 + level) / pole * (1 - np.exp(-pole * t)) - level * t, rel=1e-11)
    assert stop < 0.4


def test_the_shaft_sticks_until_the_torque_exceeds_friction_and_then_slips_at_that_instant() -> None:
    plant = Plant(ROUGH, None)
    plant.set_target(ROUGH.coulomb * 0.999)
    plant.advance(50 * MS)
    assert plant.position == 0.0
    plant.set_target(ROUGH.coulomb * 2)
    start = plant.t_ns
    breakaway = start * 1e-9 + LAG * math.log((2 - 0.999 * (1 - math.exp(-0.05 / LAG))) / 1.0)
    plant.advance(start + 5 * MS)
    trajectory = Trajectory(plant.recorder, plant.t_ns)
    before, after = math.floor(breakaway * 1e9), math.ceil(breakaway * 1e9)
    _, velocity, _ = trajectory.sample(np.array([before, after, after + 1000]))
    assert velocity[0] == 0.0
    assert 0.0 <= velocity[1] < velocity[2]


@pytest.mark.parametrize("sign", [1, -1])
def test_motion_with_friction_is_symmetric(sign: int) -> None:
    plant = Plant(ROUGH, None, velocity=sign * 3.0)
    plant.set_target(sign * -0.01)
    plant.advance(200 * MS)
    mirror = Plant(ROUGH, None, velocity=3.0)
    mirror.set_target(-0.01)
    mirror.advance(200 * MS)
    assert plant.state == tuple(sign * value for value in mirror.state)


def test_a_reversal_passes_through_rest_without_sticking_when_the_pull_exceeds_friction() -> None:
    plant = Plant(Shaft(4e-5, 0.0, 2e-3, LAG), None, velocity=1.0)
    plant.set_target(-0.01)
    plant.advance(100 * MS)
    _, velocity, _ = Trajectory(plant.recorder, plant.t_ns).sample(np.arange(0, 100 * MS, 10_000))
    assert velocity[-1] < 0
    assert np.count_nonzero(velocity == 0.0) <= 1


def _rates(shaft: Shaft, grip: Grip | None, target: float) -> Callable[[float, Matrix], list[float]]:
    """The smooth equations, written out once more; friction acts against `y[1]`'s sign by tanh-free sign."""

    def rates(_t: float, y: Matrix) -> list[float]:
        angle, speed, torque, hand_angle, hand_speed = y
        coupling = 0.0
        if grip is not None:
            coupling = grip.stiffness * (hand_angle - angle) + grip.damping * (hand_speed - speed)
        hand = (grip.pieces[0].force - coupling) / grip.inertia if grip is not None else 0.0
        friction = -shaft.coulomb * np.sign(speed)
        return [
            speed,
            (torque + coupling + friction - shaft.damping * speed) / shaft.inertia,
            (target - torque) / shaft.lag,
            hand_speed,
            hand,
        ]

    return rates


@pytest.mark.parametrize("coulomb", [0.0, 2e-3])
def test_a_held_shaft_moves_as_a_general_solver_says(coulomb: float) -> None:
    shaft = Shaft(4e-5, 1e-4, coulomb, LAG)
    plant = Plant(shaft, GRIP, velocity=0.5, position=0.3)
    plant.start_hand()
    plant.set_target(-0.02)
    moments = np.arange(1, 21) * 2 * MS
    for moment in moments:
        plant.advance(int(moment))
    solution = solve_ivp(
        _rates(shaft, GRIP, -0.02), (0, 0.04), [0.3, 0.5, 0.0, 0.3, 0.5], method="DOP853",
        t_eval=moments * 1e-9, rtol=1e-12, atol=1e-13, max_step=1e-4,
    )  # fmt: skip
    states = Trajectory(plant.recorder, plant.t_ns).states(moments)
    # With friction the general solver steps over the kink of a reversal; that costs it digits, not the plant.
    tolerance = 1e-9 if coulomb == 0.0 else 2e-6
    assert states[:, ANGLE] == pytest.approx(solution.y[0], abs=tolerance)
    assert states[:, SPEED] == pytest.approx(solution.y[1], abs=50 * tolerance)
    assert states[:, STRETCH] == pytest.approx(solution.y[3] - solution.y[0], abs=tolerance)
    assert states[:, HAND_SPEED] == pytest.approx(solution.y[4], abs=50 * tolerance)


@pytest.mark.parametrize("steps", [[1], [400_000, 600_000], [137_251, 55_000, 807_749], [333_333]])
def test_how_the_time_is_cut_into_steps_does_not_matter(steps: list[int]) -> None:
    plant, reference = Plant(ROUGH, GRIP), Plant(ROUGH, GRIP)
    for subject in (plant, reference):
        subject.start_hand()
    end_ns = 3 * MS if steps == [1] else 30 * MS
    if steps == [1]:
        steps = [1_000]
    while plant.t_ns < end_ns:
        for step in steps:
            plant.advance(plant.t_ns + step)
    reference.advance(plant.t_ns)
    assert plant.state == pytest.approx(reference.state, rel=1e-10, abs=1e-14)


@pytest.mark.parametrize("grip", [None, GRIP], ids=["free", "held"])
def test_energy_is_neither_made_nor_lost(grip: Grip | None) -> None:
    plant = Plant(ROUGH, grip, velocity=-2.0)
    plant.start_hand()
    times = np.arange(0, 60 * MS + 1, 1_000)
    for k in range(60):
        plant.set_target(0.02 * math.sin(0.3 * k))
        plant.advance((k + 1) * MS)
    trajectory = Trajectory(plant.recorder, plant.t_ns)

    z = trajectory.states(times).T
    speed = z[SPEED]
    # Power that enters less power that is turned to heat [W].
    power = z[TORQUE] * speed - ROUGH.damping * speed**2 - ROUGH.coulomb * np.abs(speed)
    stored = 0.5 * ROUGH.inertia * speed**2
    if grip is not None:
        power += z[FORCE] * z[HAND_SPEED] - grip.damping * (z[HAND_SPEED] - speed) ** 2
        stored += 0.5 * grip.inertia * z[HAND_SPEED] ** 2 + 0.5 * grip.stiffness * z[STRETCH] ** 2
    assert np.any(np.diff(np.sign(speed)) != 0)
    assert simpson(power, x=times * 1e-9) == pytest.approx(stored[-1] - stored[0], abs=1e-8 * stored.max())


def test_a_sine_force_and_a_ramp_are_followed_exactly() -> None:
    frequency = 2 * math.pi
    grip = Grip(1.0, 0.0, 0.0, angular_frequency=frequency, pieces=(Piece(0.0, 0.0, 4.0 * frequency),))
    plant = Plant(SHAFT, grip)
    plant.start_hand()
    plant.advance(1_234 * MS)
    # A free hand mass of 1: ν' = 4·sin(ωt)
    assert plant.state[HAND_SPEED] == pytest.approx(4 / frequency * (1 - math.cos(frequency * 1.234)), rel=1e-11)
    ramp = Grip(1.0, 0.0, 0.0, pieces=(Piece(0.0, 0.0, 12.0), Piece(0.5, 6.0)))
    plant = Plant(SHAFT, ramp)
    plant.start_hand()
    plant.advance(1_000 * MS)
    assert plant.state[HAND_SPEED] == pytest.approx(0.5 * 12 * 0.25 + 6 * 0.5, rel=1e-12)


def test_a_hand_at_rest_before_its_clock_starts_adds_its_mass_only() -> None:
    plant = Plant(ROUGH, GRIP)
    plant.advance(100 * MS)
    assert plant.state == Plant(ROUGH, GRIP).state


@pytest.mark.parametrize("coulomb", [0.0, 2e-3])
def test_a_hand_that_lets_go_leaves_the_shaft_as_it_was(coulomb: float) -> None:
    shaft = Shaft(4e-5, 1e-4, coulomb, LAG)
    grip = Grip(GRIP.inertia, GRIP.damping, GRIP.stiffness, pieces=GRIP.pieces, release=0.01)
    plant, held = Plant(shaft, grip), Plant(shaft, GRIP)
    for subject in (plant, held):
        subject.start_hand()
        subject.advance(10 * MS)
    assert plant.position == held.position
    assert plant.velocity == held.velocity > 0
    free = Plant(shaft, None, position=plant.position, velocity=plant.velocity)
    plant.advance(20 * MS)
    free.advance(10 * MS)
    assert plant.position == pytest.approx(free.position, rel=1e-12)
    assert plant.velocity == pytest.approx(free.velocity, rel=1e-10, abs=1e-15)


def test_a_hand_that_lets_go_of_a_shaft_at_rest_lets_it_go_where_the_motor_pulls() -> None:
    # The hand holds the shaft against the motor by its spring; friction alone would not.
    grip = Grip(GRIP.inertia, GRIP.damping, GRIP.stiffness, pieces=(Piece(0.0, -0.01),), release=5.0)
    plant = Plant(ROUGH, grip)
    plant.start_hand()
    plant.set_target(0.01)
    plant.advance(4_999 * MS)
    assert plant.velocity == 0.0
    plant.advance(5_001 * MS)
    assert plant.velocity > 0.0


def test_starting_a_hand_that_is_not_there_changes_nothing() -> None:
    plant = Plant(ROUGH, None)
    plant.start_hand()
    plant.advance(MS)
    assert plant.state == Plant(ROUGH, None).state


def test_a_mode_that_keeps_changing_inside_one_step_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haptic_fieldbus.sim.mechanics.plant._MAX_EVENTS", 1)
    plant = Plant(ROUGH, None, velocity=1e-3)
    plant.set_target(-0.02)
    plant.advance(MS)
    assert plant.velocity == 0.0
    plant.advance(2 * MS)
    assert plant.velocity < 0.0


def test_the_tables_of_a_mode_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "MAX_TRANSITIONS", 4)
    plant = Plant(SHAFT, GRIP, velocity=1.0)
    for step in range(1, 20):
        plant.advance(plant.t_ns + step)
    reference = Plant(SHAFT, GRIP, velocity=1.0)
    reference.advance(plant.t_ns)
    assert plant.state == pytest.approx(reference.state, rel=1e-13, abs=1e-18)
