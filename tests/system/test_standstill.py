"""Counts that stand still: a hand that leans on a scene for minutes is no fault, and a frozen encoder is one."""

from dataclasses import replace
from random import Random

import pytest

import haptic_fieldbus
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.defaults import DEFAULT_DRIVE
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.planning.encoder_probe import encoder_probe
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.hand import HANDS, Hand, Piece
from tests.builders import endless_rig
from tests.invariants.attach import watched
from tests.invariants.laws import lasted
from tests.softened import softened

LONGEST = 10.0
"""[s] for which a frozen encoder may be under force."""


def standing_still_for(seconds: float) -> Rig:
    rig = haptic_fieldbus.plan("wall").rig
    axes = {name: replace(axis, limits=replace(axis.limits, stall=seconds)) for name, axis in rig.axis.items()}
    return replace(rig, axis=axes)


@pytest.mark.thorough("runs three seconds of a loop, twice")
def test_a_hand_that_goes_on_pushing_gets_further_in_and_is_told_why() -> None:
    """6 N lean on it, and 5 % of rated torque, 2.51 N, are left; the hand then leaves the bench."""
    with pytest.raises(
        SafetyTripError, match=r"2\.\d+ s after enabling: position 0\.1\d* m, beyond the limit of 0\.1 m"
    ) as ended:
        haptic_fieldbus.run("wall", standing_still_for(1.0), duration=4.0, hand="push")
    result = ended.value.result
    assert isinstance(result, Result)
    (told,) = result.warnings
    assert told.startswith("axis handle: the position did not change under force for 1 s, once. A leaning hand")
    assert "no test pulses were possible (the test takes 4.7 s, but limits.stall is 1 s)" in told
    assert "limited to 2.51 N until contact ended" in told
    assert told.endswith("axis.handle.limits.stall in the rig")
    assert haptic_fieldbus.run("wall", standing_still_for(5.0), duration=4.0, hand="push").trips == ()


LEANT_ON = (
    "wall", "damped_wall", "end_stops", "kelvin_voigt", "standard_linear_solid", "generalised_maxwell", "hunt_crossley",
    "spring", "predicted_wall", "proxy", "virtual_coupling", "constant", "detents", "gear_shifter", "grating",
    "knob_menu", "magnet", "texture", "stick_slip", "teleoperation",
)  # fmt: skip
"""Scenes of the library that hold a hand of 6 N; through the others it goes, or they move it."""
AT_LENGTH = ("wall", "damped_wall", "end_stops", "kelvin_voigt")
"""Scenes that are leant on for all of the ten minutes here."""
SLOWLY = 100.0
"""[Hz]; the rate makes the tests fast, and the wall softer where it would be unstable. What is above the limit of its
bench is told so, and leant on all the same."""
FASTER = {"teleoperation": 250.0}
"""[Hz]; what softening alone does not make stable at the low rate."""


def leant_on(scene: str, duration: float, rate: float = SLOWLY) -> Result:
    """A run with the hand that pushes with 6 N; on an endless way, as a softened wall gives way further."""
    rendered = softened(scene, DEFAULT_DRIVE, rate)
    return haptic_fieldbus.run(rendered, endless_rig(rendered), rate=rate, hand="push", duration=duration)


@pytest.mark.thorough("ten minutes of virtual time each at 100 Hz, 15 s of the processor")
@pytest.mark.parametrize("scene", AT_LENGTH)
def test_a_hand_that_leans_for_ten_minutes_is_no_fault(scene: str) -> None:
    """No trip, no cap, and a score that does not change by a tenth."""
    short, long = leant_on(scene, 5.0), leant_on(scene, 600.0)
    assert long.trips == ()
    assert long.warnings == short.warnings
    assert not [told for told in long.warnings if "exceeds the limit" not in told]
    force = long.traces[0].force
    assert abs(force[-1]) == pytest.approx(abs(force[len(force) // 2]), abs=0.5)
    assert long.passivity[0].largest < 0.1 * long.passivity[0].limit
    assert 0.0 < long.passivity[0].booked["pulses"] < 0.1
    assert short.torque_error is not None
    assert long.torque_error is not None
    assert long.torque_error.contact == pytest.approx(short.torque_error.contact, rel=0.1)


@pytest.mark.thorough("20 s of virtual time each at 100 Hz, a second of the processor")
@pytest.mark.parametrize("scene", LEANT_ON)
def test_every_scene_that_holds_a_hand_may_be_leant_on(scene: str) -> None:
    """Its encoder is asked seven times."""
    long = leant_on(scene, 20.0, FASTER.get(scene, SLOWLY))
    assert long.trips == ()
    assert not [told for told in long.warnings if "did not change" in told]


@pytest.mark.thorough("up to 100 s of virtual time at 1 kHz, 30 s of the processor in all")
@pytest.mark.parametrize(("scene", "duration"), [("wall", 100.0), ("spring", 15.0), ("teleoperation", 15.0)])
def test_a_hand_leans_on_the_shipped_bench_and_its_score_stays(scene: str, duration: float) -> None:
    """A wall for longer than the rule of 90 s lets it; and what is touched so slowly that a pulse could be a motion."""
    result, short = (haptic_fieldbus.run(scene, duration=each, hand="push") for each in (duration, 3.0))
    assert result.trips == ()
    assert result.warnings == ()
    assert result.torque_error is not None
    assert short.torque_error is not None
    assert result.torque_error.contact == pytest.approx(short.torque_error.contact, rel=0.1)


RATES: dict[str, tuple[float | None, ...]] = {
    "sim": (250.0, 100.0, 50.0, 50.0),
    "sim-modbus-tcp": (100.0, 50.0, 50.0),
    "sim-modbus-rtu@115200": (None, 30.0, 30.0),
}
"""By the bus [Hz]; None: that of the line itself."""
DRIVES = {"sim": DEFAULT_DRIVE}


def frozen(seed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[str, float, float]:
    """Freeze an encoder under force: the trip, how long the motor had torque then, and how long it may [s].

    Drawn are bus, rate, friction, counts, how strong a hand leans on a wall, and when the encoder freezes.
    """
    random = Random(f"frozen/{seed}")
    bus = random.choice(list(RATES))
    rate = random.choice(RATES[bus])
    bench = endless_rig("wall", DRIVES.get(bus, "generic_cia402_modbus"), bus)
    friction, counts = random.uniform(0.0, 4e-3), random.choice((1024, 4096, 16384))
    axis = replace(bench.axis["handle"], coulomb_friction=friction, encoder_counts_per_revolution=counts)
    rig = replace(bench, axis={"handle": axis})
    settings: dict[str, str | float] = {"wall.stiffness": "max/2", "wall.position": 0.0}
    plan = haptic_fieldbus.plan("wall", rig, rate=rate, settings=settings)
    probe = encoder_probe(plan.axes[0], plan.period)
    assert probe is not None
    force, at = random.uniform(1.2, 3.0) * (probe.least + 0.3), random.uniform(0.8, 1.3)
    monkeypatch.setitem(HANDS, "lean", Hand("lean", (Piece(0.0, 0.0, force / 0.5), Piece(0.5, force))))
    with watched(keep=True) as found, pytest.raises(SafetyTripError) as ended:
        haptic_fieldbus.run(
            "wall", rig, rate=rate, settings=settings, hand="lean", fade_in=0.1, duration=at + LONGEST + 1.0,
            faults=(faults.PositionStuck("position_stuck", at),),
        )  # fmt: skip
    assert found.broken == []
    (witness,) = found.witnesses
    result = ended.value.result
    assert isinstance(result, Result)
    assert witness.faults_ns is not None
    took = lasted(witness, axis.node, witness.faults_ns + round(1e9 * at))
    return result.trips[0].name, took, probe.time + witness.stated.deadlines["own limit or trip"]


@pytest.mark.thorough("50 runs of six seconds of virtual time each, 17 s of the processor")
@pytest.mark.parametrize("part", range(10))
def test_a_frozen_encoder_under_force_is_torque_free_within_ten_seconds(
    part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """500 runs in all, on CANopen and Modbus; each within the time that its plan states."""
    for seed in range(50 * part, 50 * part + 50):
        trip, took, stated = frozen(seed, monkeypatch)
        assert trip == TripKind.ENCODER_STILL.value, seed
        assert 0.0 < took <= min(stated, LONGEST), seed


def test_a_frozen_encoder_is_noticed_on_each_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of them in the quick lane."""
    for seed in (4, 9, 15):
        trip, took, stated = frozen(seed, monkeypatch)
        assert trip == TripKind.ENCODER_STILL.value
        assert 3.0 < took <= stated < LONGEST
