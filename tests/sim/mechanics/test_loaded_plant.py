"""The loaded shaft against closed forms, and against scipy's solver with events."""

import math
from typing import Literal

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from haptic_fieldbus.drive.rig import Cogging, CompliantCoupling, Mechanics, RotaryMechanism, Stribeck, Weight
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.drive.settings import DriveSettings, build_plant
from haptic_fieldbus.sim.hand import Grip, Piece
from haptic_fieldbus.sim.mechanics import loaded_plant as module
from haptic_fieldbus.sim.mechanics.loaded_plant import LOAD_SPEED, TWIST, Load, LoadedPlant
from haptic_fieldbus.sim.mechanics.motion import ANGLE, HAND_SPEED, SPEED, Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from tests.sim.bench import DriveBench, axis, profile
from tests.sim.mechanics.event_solver import EventSolver

LAG = 1 / (2 * math.pi * 1000)
SMOOTH = Shaft(inertia=4e-5, damping=0.0, coulomb=0.0, lag=LAG)
ROUGH = Shaft(inertia=4e-5, damping=1e-4, coulomb=2e-3, lag=LAG)
R = 0.05 / (2 * math.pi)
GRIP = Grip(inertia=0.1 * R**2, damping=4 * R**2, stiffness=300 * R**2, pieces=(Piece(0.0, 6 * R),))
HEAVY = Grip(inertia=0.1, damping=1e-6, stiffness=0.05, pieces=(Piece(0.0, 0.0),))
"""Moves on as if nothing could stop it."""
COUPLING = CompliantCoupling(stiffness=20.0, load_inertia=1e-5, damping=1e-3)
LOOSE = CompliantCoupling(stiffness=20.0, load_inertia=1e-5, damping=1e-3, backlash=0.01)
COGGING = Cogging(torque=4e-3, periods_per_revolution=14)
STRIBECK = Stribeck(torque=2e-3, velocity=0.5)
MS = 1_000_000


def _followed(plant: LoadedPlant | Plant, end: float, spacing: float = 1e-3) -> tuple[Matrix, Matrix]:
    """(times [s], states (order, n)) of a plant moved to `end` [s]."""
    plant.advance(round(end * 1e9))
    moments = np.arange(0, plant.t_ns + 1, round(spacing * 1e9))
    times: Matrix = moments.astype(np.float64) * 1e-9
    return times, Trajectory(plant.recorder, plant.t_ns).states(moments).T


# Nothing asked for.


@pytest.mark.parametrize("grip", [None, GRIP], ids=["free", "held"])
@pytest.mark.parametrize("shaft", [SMOOTH, ROUGH], ids=["smooth", "rough"])
def test_with_nothing_asked_for_the_motion_is_that_of_the_rigid_plant(shaft: Shaft, grip: Grip | None) -> None:
    loaded, rigid = LoadedPlant(Load(shaft, Mechanics()), grip, velocity=1.0), Plant(shaft, grip, velocity=1.0)
    for plant in (loaded, rigid):
        plant.start_hand()
        for k in range(60):
            plant.set_target(0.02 * math.sin(0.3 * k))
            plant.advance((k + 1) * MS)
    assert loaded.state[:9] == pytest.approx(rigid.state, rel=1e-9, abs=1e-12)


# Closed forms.


def test_two_masses_and_a_spring_answer_a_torque_step_as_the_closed_form_says() -> None:
    coupling = CompliantCoupling(stiffness=20.0, load_inertia=1e-5)
    plant, u = LoadedPlant(Load(SMOOTH, Mechanics(coupling=coupling)), None), 0.02
    plant.set_target(u)
    t, z = _followed(plant, 0.2, 1.3e-4)
    motor = SMOOTH.inertia - coupling.load_inertia
    ripple = math.sqrt(coupling.stiffness * (1 / motor + 1 / coupling.load_inertia))
    # ψ″ + Ω²·ψ = u·(1 − e^(−t/T))/J_m, the centre of mass moves as if all were rigid
    steady, fading = u / motor / ripple**2, -u / motor / (1 / LAG**2 + ripple**2)
    rise = np.exp(-t / LAG)
    twist = steady + fading * rise - (steady + fading) * np.cos(ripple * t) + fading / LAG / ripple * np.sin(ripple * t)
    centre = u / SMOOTH.inertia * (t**2 / 2 - LAG * t + LAG**2 * (1 - rise))
    assert z[TWIST] == pytest.approx(twist, rel=1e-9, abs=1e-12 * steady)
    assert z[ANGLE] == pytest.approx(centre + coupling.load_inertia / SMOOTH.inertia * twist, rel=1e-10)


@pytest.mark.thorough("6 cases of one rule", quick=2)
@pytest.mark.parametrize("lever", [0.5, -2.0])
@pytest.mark.parametrize("amplitude", [0.01, 2.0, 3.1])
def test_a_weight_on_a_lever_swings_as_the_elliptic_functions_say(amplitude: float, lever: float) -> None:
    gravity = Weight(torque=0.03, hanging_at=0.3)
    start = (amplitude + gravity.hanging_at) / lever
    plant = LoadedPlant(Load(SMOOTH, Mechanics(gravity=gravity), lever), None, position=start)
    t, z = _followed(plant, 2.0)
    frequency, k = math.sqrt(gravity.torque * abs(lever) / SMOOTH.inertia), math.sin(amplitude / 2)
    _, cn, dn, _ = ellipj(frequency * t, k**2)
    angle = 2 * np.arcsin(k * cn / dn)
    assert lever * z[ANGLE] - gravity.hanging_at == pytest.approx(angle, abs=1e-8 * amplitude)
    quarter_ns = round(ellipk(k**2) / frequency * 1e9)
    position, _, _ = Trajectory(plant.recorder, plant.t_ns).sample(np.array([quarter_ns, 3 * quarter_ns]))
    assert lever * position == pytest.approx([gravity.hanging_at] * 2, abs=1e-7)


@pytest.mark.thorough("4 cases of one rule", quick=1)
@pytest.mark.parametrize("speed", [0.001, 3.0, 5.5, 50.0])
def test_cogging_lets_the_shaft_swing_or_pass_as_the_elliptic_functions_say(speed: float) -> None:
    n = COGGING.periods_per_revolution
    plant = LoadedPlant(Load(SMOOTH, Mechanics(cogging=COGGING)), None, velocity=speed)
    t, z = _followed(plant, 1.0)
    frequency = math.sqrt(COGGING.torque * n / SMOOTH.inertia)
    k = n * speed / 2 / frequency
    if k < 1:
        angle = 2 * np.arcsin(k * ellipj(frequency * t, k**2)[0])
    else:
        angle = 2 * ellipj(k * frequency * t, 1 / k**2)[3]
    assert n * z[ANGLE] == pytest.approx(angle, abs=1e-8)


def test_a_small_oscillation_in_a_cog_has_the_frequency_of_its_stiffness() -> None:
    plant = LoadedPlant(Load(SMOOTH, Mechanics(cogging=COGGING)), None, velocity=1e-4)
    plant.advance(2_000 * MS)
    speed = Trajectory(plant.recorder, plant.t_ns).sample(np.arange(0, 2_000 * MS, 10_000))[1]
    falls = np.flatnonzero((speed[:-1] > 0) & (speed[1:] <= 0))
    crossing = falls + speed[falls] / (speed[falls] - speed[falls + 1])
    period = np.diff(crossing).mean() * 1e-5
    assert 2 * math.pi / period == pytest.approx(math.sqrt(4e-3 * 14 / SMOOTH.inertia), rel=1e-7)


@pytest.mark.parametrize("torque", [5e-3, -5e-3])
def test_a_weight_on_a_linear_mechanism_falls_as_the_closed_form_says(torque: float) -> None:
    plant = LoadedPlant(Load(ROUGH, Mechanics(gravity=Weight(torque))), None)
    t, z = _followed(plant, 0.5)
    pole, final = ROUGH.damping / ROUGH.inertia, (abs(torque) - ROUGH.coulomb) / ROUGH.damping
    assert z[SPEED] == pytest.approx(math.copysign(final, torque) * (1 - np.exp(-pole * t)), rel=1e-10, abs=1e-12)


def test_a_weight_that_friction_holds_stays_where_it_is() -> None:
    plant = LoadedPlant(Load(ROUGH, Mechanics(gravity=Weight(1.99e-3))), None)
    plant.advance(100 * MS)
    assert plant.position == plant.velocity == 0.0


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("torque", [4e-3, -4e-3])
def test_a_load_that_falls_through_its_play_bounces_as_the_closed_form_says(torque: float) -> None:
    """The motor sticks. The load falls half the play, presses the spring for part of a sine, and comes back."""
    shaft = Shaft(4e-5, 0.0, coulomb=1.0, lag=LAG)
    coupling = CompliantCoupling(stiffness=20.0, load_inertia=1e-5, backlash=0.02)
    plant = LoadedPlant(Load(shaft, Mechanics(coupling=coupling, gravity=Weight(torque))), None)
    t, z = _followed(plant, 0.5, 1.7e-4)
    fall, height = abs(torque) / coupling.load_inertia, coupling.backlash / 2
    speed, ripple = math.sqrt(2 * fall * height), math.sqrt(coupling.stiffness / coupling.load_inertia)
    contact = 2 / ripple * (math.pi - math.atan(speed * ripple / fall))
    flight = speed / fall
    # Counted from the middle of a contact.
    phase = np.mod(t + flight + contact / 2, 2 * flight + contact)
    phase = np.where(phase > flight + contact / 2, (2 * flight + contact) - phase, phase)
    deep = fall / ripple**2 * (1 + math.sqrt(1 + (speed * ripple / fall) ** 2) * np.cos(ripple * phase))
    since = phase - contact / 2
    overlap = np.where(since < 0, 0.0 + deep, -speed * since + fall * since**2 / 2)
    assert -math.copysign(1, torque) * z[TWIST] - height == pytest.approx(overlap, abs=1e-9)
    assert np.all(z[SPEED] == 0.0)


@pytest.mark.thorough("simulates thousands of bounces")
def test_without_friction_the_play_alone_lets_both_bounce_for_ever() -> None:
    """Two free masses: the relative speed only changes its sign at each flank."""
    coupling = CompliantCoupling(stiffness=500.0, load_inertia=1e-5, backlash=0.02)
    plant = LoadedPlant(Load(SMOOTH, Mechanics(coupling=coupling)), None)
    plant.set_target(0.02)
    plant.advance(2 * MS)
    plant.set_target(0.0)
    plant.advance(6 * MS)  # the motor's torque has faded
    times = np.arange(6 * MS, 506 * MS, 10_000)
    plant.advance(506 * MS)
    z = Trajectory(plant.recorder, plant.t_ns).states(times).T
    relative = np.abs(z[SPEED] - z[LOAD_SPEED])
    free = np.abs(z[TWIST]) < coupling.backlash / 2
    assert relative[free] == pytest.approx(np.full(free.sum(), relative.max()), rel=1e-9)
    motor = SMOOTH.inertia - coupling.load_inertia
    ripple = math.sqrt(coupling.stiffness * (1 / motor + 1 / coupling.load_inertia))
    rises = np.flatnonzero((z[TWIST][:-1] <= 0) & (z[TWIST][1:] > 0))
    crossing = rises - z[TWIST][rises] / (z[TWIST][rises + 1] - z[TWIST][rises])
    period = 2 * (coupling.backlash / relative.max() + math.pi / ripple)
    assert np.diff(crossing) * 1e-5 == pytest.approx(np.full(len(crossing) - 1, period), rel=1e-9)


# Against a general solver with events.

SYSTEMS = {
    "coupling": (Mechanics(coupling=COUPLING), None, GRIP, 2.0, -0.02),
    "backlash": (Mechanics(coupling=LOOSE), None, GRIP, 2.0, -0.02),
    "backlash, free": (Mechanics(coupling=LOOSE), None, None, 2.0, 0.003),
    "weight on a spring": (Mechanics(coupling=LOOSE, gravity=Weight(0.01)), None, GRIP, 0.0, -0.02),
    "lever on a spring": (Mechanics(coupling=COUPLING, gravity=Weight(0.01, 0.3)), -0.7, None, 1.0, -0.015),
    "cogging": (Mechanics(cogging=COGGING), None, GRIP, 0.0, 0.003),
    "stick-slip": (Mechanics(stribeck=STRIBECK), None, HEAVY, 0.4, 0.0),
    "all": (Mechanics(LOOSE, Weight(0.01, 0.3), COGGING, STRIBECK), -0.7, GRIP, 3.0, -0.03),
    "all, free": (Mechanics(LOOSE, Weight(0.005), COGGING, STRIBECK), None, None, -3.0, 0.004),
}


@pytest.mark.thorough("integrates nine systems with a general solver", quick=1)
@pytest.mark.parametrize("name", SYSTEMS)
def test_the_motion_is_the_one_of_a_general_solver_with_events(name: str) -> None:
    mechanics, lever, grip, velocity, target = SYSTEMS[name]
    load = Load(ROUGH, mechanics, lever)
    plant = LoadedPlant(load, grip, position=0.2, velocity=velocity)
    plant.start_hand()
    plant.set_target(target)
    t, z = _followed(plant, 1.0 if name == "stick-slip" else 0.12)
    solver = EventSolver(load, grip, target, 0.2, velocity)
    y = solver.run(t, 2e-4)
    assert solver.changes >= 1
    assert z[ANGLE] == pytest.approx(y[0], abs=1e-10)
    assert z[SPEED] == pytest.approx(y[1], abs=1e-8)
    if mechanics.coupling is not None:
        assert z[ANGLE] - z[TWIST] == pytest.approx(y[3], abs=1e-10)
        assert z[LOAD_SPEED] == pytest.approx(y[4], abs=1e-8)
    if grip is not None:
        assert z[HAND_SPEED] == pytest.approx(y[6], abs=1e-8)


# How it is done changes nothing.


@pytest.mark.thorough("9 cases of one rule", quick=3)
@pytest.mark.parametrize("name", SYSTEMS)
def test_how_often_the_shaft_is_looked_at_changes_nothing(name: str) -> None:
    mechanics, lever, grip, velocity, target = SYSTEMS[name]
    often, seldom = (
        LoadedPlant(Load(ROUGH, mechanics, lever), grip, position=0.2, velocity=velocity) for _ in range(2)
    )
    for plant in (often, seldom):
        plant.start_hand()
        plant.set_target(target)
    for moment in range(0, 50 * MS, 137_251):
        often.advance(moment)
    for plant in (often, seldom):
        plant.advance(50 * MS)
    assert often.state == seldom.state


@pytest.mark.thorough("9 cases of one rule", quick=3)
@pytest.mark.parametrize("name", SYSTEMS)
def test_how_long_the_legs_are_changes_nothing_beyond_the_tolerance(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanics, lever, grip, velocity, target = SYSTEMS[name]
    found = []
    for longest_ns in (1 << 22, 1 << 17):
        monkeypatch.setattr(module, "_LONGEST_NS", longest_ns)
        plant = LoadedPlant(Load(ROUGH, mechanics, lever), grip, position=0.2, velocity=velocity)
        plant.start_hand()
        plant.set_target(target)
        plant.advance(50 * MS)
        found.append(plant.state)
    assert found[0] == pytest.approx(found[1], rel=1e-9, abs=1e-11)


@pytest.mark.thorough("9 cases of one rule", quick=3)
@pytest.mark.parametrize("name", SYSTEMS)
def test_a_sample_at_any_time_is_what_the_plant_was_at(name: str) -> None:
    mechanics, lever, grip, velocity, _ = SYSTEMS[name]
    plant = LoadedPlant(Load(ROUGH, mechanics, lever), grip, velocity=velocity)
    plant.start_hand()
    kept = []
    for k in range(120):
        plant.advance(k * 251_123)
        kept.append((plant.t_ns, plant.position, plant.velocity, plant.torque))
        if k % 7 == 0:
            plant.set_target(0.01 * (-1) ** k)
    times, *expected = np.array(kept).T
    for ours, theirs in zip(
        Trajectory(plant.recorder, plant.t_ns).sample(times.astype(np.int64)), expected, strict=True
    ):
        assert ours == pytest.approx(theirs, rel=1e-10, abs=1e-12)


def test_a_hand_that_lets_go_of_the_load_leaves_it_and_the_motor_as_they_were() -> None:
    grip = Grip(GRIP.inertia, GRIP.damping, GRIP.stiffness, pieces=GRIP.pieces, release=0.02)
    mechanics = Mechanics(LOOSE, Weight(0.01), COGGING, STRIBECK)
    plant, held = LoadedPlant(Load(ROUGH, mechanics), grip), LoadedPlant(Load(ROUGH, mechanics), GRIP)
    for subject in (plant, held):
        subject.start_hand()
        subject.advance(20 * MS)
    same = [ANGLE, SPEED, TWIST, LOAD_SPEED]
    assert [plant.state[at] for at in same] == [held.state[at] for at in same]
    plant.advance(40 * MS)
    held.advance(40 * MS)
    assert plant.velocity != held.velocity


def test_too_many_events_in_succession_are_left_out_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MAX_EVENTS", 1)
    plant = LoadedPlant(Load(ROUGH, Mechanics(cogging=COGGING)), None, velocity=1e-3)
    plant.set_target(-0.02)
    plant.advance(100 * MS)
    assert plant.velocity < 0.0


def test_a_leg_that_can_be_no_shorter_is_taken_as_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_HALVINGS", 0)
    plant = LoadedPlant(Load(SMOOTH, Mechanics(cogging=COGGING)), None, velocity=1000.0)
    plant.advance(10 * MS)
    assert plant.position == pytest.approx(10.0, rel=1e-2)


# From a rig.


def test_a_rig_that_asks_for_nothing_gets_the_rigid_plant_and_any_other_a_loaded_one() -> None:
    built = [
        build_plant(profile(), axis(simulation=mechanics), None, DriveSettings(position=0.2, velocity=1.0), 7)
        for mechanics in (Mechanics(), Mechanics(stribeck=STRIBECK))
    ]
    assert [type(plant) for plant in built] == [Plant, LoadedPlant]
    assert [(plant.t_ns, plant.position, plant.velocity) for plant in built] == [(7, 0.2, 1.0)] * 2


@pytest.mark.parametrize("sign", [1, -1])
def test_the_lever_of_a_rig_hangs_where_the_handle_not_the_motor_is_at_its_angle(sign: Literal[1, -1]) -> None:
    mechanism = RotaryMechanism("rotary", gear_ratio=4.0, sign=sign)
    gravity = Weight(torque=0.01, hanging_at=0.5)
    simulated = axis(
        Workspace.ROTARY, mechanism=mechanism, simulation=Mechanics(gravity=gravity), viscous_damping=6e-4,
        coulomb_friction=0.0,
    )  # fmt: skip
    plant = build_plant(profile(), simulated, None, DriveSettings(), 0)
    plant.advance(5_000 * MS)
    assert sign * plant.position / 4.0 == pytest.approx(0.5, abs=1e-9)


def test_a_weight_of_a_linear_rig_pulls_with_its_sign() -> None:
    plant = build_plant(profile(), axis(simulation=Mechanics(gravity=Weight(-0.01))), None, DriveSettings(), 0)
    plant.advance(10 * MS)
    assert plant.velocity < 0.0


def test_a_drive_on_a_loaded_shaft_counts_the_turns_of_its_motor() -> None:
    bench = DriveBench(drive_axis=axis(simulation=Mechanics(LOOSE, Weight(0.01), COGGING, STRIBECK)))
    bench.run(100 * MS)
    bench.drive.servo.advance(bench.t_ns)
    assert bench.drive.plant.position != 0.0
    assert bench.drive.servo.counts() == math.floor(bench.drive.plant.position * 4096 / (2 * math.pi) + 0.5)
