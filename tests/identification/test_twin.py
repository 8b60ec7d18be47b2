"""The fit to an ordinary run against the plant of the simulation, and against scipy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares

from haptic_fieldbus.drive.rig import LinearMechanism
from haptic_fieldbus.identification import twin
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.identification.twin import NOBODY, HoldingHand, RunRecord, fit_run
from haptic_fieldbus.sim.hand import HANDS, Grip, grip
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from tests.identification.test_fit import COUNT, PERIOD, TRUE, multisine, open_loop
from tests.identification.test_fit import record_of as record_of_shaft
from tests.identification.twins import wrong_with_twins

TRUTH = ShaftModel(5e-5, 1.5e-4, 2e-3, 0.0006, 0.0003)
STATED = ShaftModel(2e-5, 4e-4, 5e-3, 0.0006, 0.0002)
WALL, FACE = 7.6e-3, 2.5
"""Stiffness [N·m/rad] and place [rad] of the wall that the handle meets."""


def held_by(name: str) -> Grip:
    hand = HANDS[name]
    assert hand is not None
    return grip(hand.after(0.2), LinearMechanism("linear", metres_per_revolution=0.05))


def holding(held: Grip) -> HoldingHand:
    pieces = tuple((each.start, each.force, each.slope) for each in held.pieces)
    return HoldingHand(held.inertia, held.damping, held.stiffness, pieces, held.angular_frequency)


def run_record(
    held: Grip, seconds: float = 8.0, torque_scale: float = 1.0, count_scale: float = 1.0, period: float = 0.002
) -> RunRecord:
    """A hand leads the handle of the simulation's plant against a wall; its drive asks for torques in steps."""
    plant = Plant(Shaft(TRUTH.inertia, TRUTH.damping, TRUTH.coulomb, TRUTH.lag), held)
    plant.start_hand()
    count, waiting, positions, torques = 2.0 * math.pi / 4096, list[tuple[int, float]](), list[float](), list[float]()
    for number in range(round(seconds / period)):
        t_ns = round(1e9 * number * period)
        while waiting and waiting[0][0] <= t_ns:
            at_ns, target = waiting.pop(0)
            plant.advance(at_ns)
            plant.set_target(target)
        plant.advance(t_ns)
        positions.append(math.floor(plant.position * count_scale / count + 0.7) * count)
        torques.append(4e-4 * round(-WALL * max(positions[-1] - FACE, 0.0) / 4e-4))
        waiting.append((t_ns + round(1e9 * TRUTH.delay), torque_scale * torques[-1]))
    usable = np.ones(len(positions), bool)
    return RunRecord(period, np.array(positions), np.array(torques), count, usable, holding(held))


@pytest.fixture(scope="module")
def shaken() -> RunRecord:
    return run_record(held_by("shake"))


def test_the_bench_is_found_from_an_ordinary_run(shaken: RunRecord) -> None:
    fit = fit_run(shaken, STATED)
    for name, value in (("inertia", 5e-5), ("viscous_damping", 1.5e-4), ("coulomb_friction", 2e-3)):
        assert fit.values[name].value == pytest.approx(value, rel=0.02), name
        assert fit.values[name].low <= value <= fit.values[name].high
        assert fit.values[name].reason == ""
    assert fit.values["delay_and_lag"].value == pytest.approx(9e-4, abs=5e-5)
    assert fit.values["torque_scale"].value == fit.values["count_scale"].value == 1.0
    assert fit.residual < 0.35, "a record that the model explains leaves the rounding of the encoder, 0.29 counts"
    assert fit.predicted is not None
    assert fit.predicted < 0.35


@pytest.mark.thorough("fits a twin")
def test_other_counts_are_found_where_the_hand_is_known() -> None:
    fit = fit_run(run_record(held_by("shake"), 5.0, count_scale=4.0), replace(STATED, inertia=1.2e-5))
    assert fit.values["count_scale"].value == 4.0
    assert fit.values["torque_scale"].value == 1.0
    assert fit.values["inertia"].value == pytest.approx(5e-5, rel=0.02)


@pytest.mark.thorough("fits scales from three beginnings")
def test_another_torque_is_found_where_the_hand_is_known() -> None:
    fit = fit_run(run_record(held_by("shake"), torque_scale=0.8), STATED)
    assert fit.values["torque_scale"].value == pytest.approx(0.8, rel=0.01)
    assert fit.values["count_scale"].value == 1.0
    assert fit.values["inertia"].value == pytest.approx(5e-5, rel=0.03)


@pytest.mark.thorough("fits by two programs")
def test_the_values_without_a_hand_are_those_of_scipys_least_squares() -> None:
    shaft = record_of_shaft(TRUE, multisine(3000, 0.02))
    positions, torques = np.array(shaft.positions), np.array(shaft.torques)
    record = RunRecord(PERIOD, positions, torques, COUNT, np.ones(3000, bool))
    fit = fit_run(record, ShaftModel(1e-5, 1e-3, 1e-3, 0.0012, 0.001))
    scales = np.array([4e-5, 2e-4, 1e-3, 1.0])

    def error(x: np.ndarray) -> np.ndarray:
        inertia, damping, delay, offset = x * scales
        model = ShaftModel(inertia, damping, 0.0, delay, TRUE.lag)
        off: np.ndarray = (open_loop(model, list(shaft.torques)) - positions) / COUNT + offset
        return off

    theirs = least_squares(
        error, [1.3, 0.7, 1.0, 0.0], diff_step=1e-4, bounds=([0.1, 0.0, 0.1, -9.0], [9.0, 9.0, 1.9, 9.0])
    )
    inertia, damping, delay, _ = theirs.x * scales
    assert fit.values["inertia"].value == pytest.approx(inertia, rel=0.01)
    assert fit.values["viscous_damping"].value == pytest.approx(damping, rel=0.1)
    assert fit.values["delay_and_lag"].value == pytest.approx(delay + TRUE.lag, abs=3e-5)


def test_friction_that_is_not_excited_is_named_and_no_hand_tells_no_scale() -> None:
    shaft = record_of_shaft(TRUE, multisine(3000, 0.02))
    record = RunRecord(PERIOD, np.array(shaft.positions), np.array(shaft.torques), COUNT, np.ones(3000, bool))
    fit = fit_run(record, ShaftModel(1e-5, 1e-3, 1e-3, 0.0012, 0.001))
    assert fit.values["coulomb_friction"].reason == "it is small beside the torques of the experiment"
    assert fit.values["count_scale"].value == fit.values["torque_scale"].value == 1.0


def test_a_handle_that_hardly_moves_is_refused(shaken: RunRecord) -> None:
    with pytest.raises(ValueError, match="moves for less than 2 s"):
        fit_run(replace(shaken, usable=np.zeros(len(shaken.positions), bool)), STATED)


def test_a_run_of_few_pieces_has_none_to_check(shaken: RunRecord) -> None:
    count = 1250
    short = replace(
        shaken, positions=shaken.positions[:count], torques=shaken.torques[:count], usable=shaken.usable[:count]
    )
    assert fit_run(short, STATED).predicted is None


@pytest.mark.thorough("fits a twin")
def test_a_wrong_hand_tells_no_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(twin, "MOST_STEPS", 5)  # no step helps a wrong hand
    shaken = run_record(held_by("shake"), 4.0, period=0.01)
    values = fit_run(replace(shaken, hand=holding(held_by("sine"))), STATED).values
    for name in ("torque_scale", "count_scale"):
        assert values[name].value == 1.0
        assert values[name].reason == "its interval is too wide, so the stated hand may be wrong"


def test_values_that_a_wrong_hand_hides_are_not_called_small(shaken: RunRecord) -> None:
    fit = fit_run(replace(shaken, hand=NOBODY), STATED)
    reasons = {each.reason for name, each in fit.values.items() if name != "torque_scale" and each.reason}
    assert fit.residual > 20.0
    assert reasons == {"another bench or hand moved the handle: the model does not explain the motion"}


def test_a_soak_is_judged_by_shares() -> None:
    good = {"twins": {"benches": 60, "predicted": 54, "named": 171, "false": 3}}
    bad = {"twins": {"benches": 60, "predicted": 53, "named": 170, "false": 4}}
    assert list(wrong_with_twins([good, {"broken": []}])) == []
    assert len(list(wrong_with_twins([bad]))) == 3
    few = {"benches": 6, "named": 18, "false": 0}
    assert [len(list(wrong_with_twins([{"twins": few | {"predicted": each}}]))) for each in (5, 4)] == [0, 1]


@pytest.mark.parametrize("name", ["shake", "push", "tap", "sine"])
def test_the_impulse_of_a_hand_is_the_integral_of_its_force(name: str) -> None:
    held = held_by(name)

    def force(t: float) -> float:
        piece = next((each for each in reversed(held.pieces) if each.start <= t), None)
        if piece is None:
            return 0.0
        passed, omega = t - piece.start, held.angular_frequency
        if not omega:
            return piece.force + piece.slope * passed
        return piece.force * math.cos(omega * passed) + piece.slope / omega * math.sin(omega * passed)

    starts = [each.start for each in held.pieces if each.start < 3.0]
    whole, _ = quad(force, 0.0, 3.0, points=starts, limit=400)
    found = holding(held).impulse(np.array([3.0]))[0]
    assert found == pytest.approx(whole, rel=1e-6, abs=1e-9 * abs(held.pieces[0].force + held.pieces[0].slope))
