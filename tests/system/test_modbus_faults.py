"""Faults of drives, answers and lines in whole runs over Modbus: how each ends, and that no invariant breaks.

The checker of `tests/invariants` watches these runs too: torque and slew within limits, zero in the stated time,
nothing enables again. Here stands what is said.
"""

from contextlib import suppress
from random import Random

import pytest

from haptic_fieldbus import Result
from haptic_fieldbus.api import run
from haptic_fieldbus.errors import (
    BusError,
    BusTimeoutError,
    DriveFaultError,
    FaultFileError,
    HapticFieldbusError,
    SafetyTripError,
    UnprovedGuardError,
    UsageError,
)
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.hand import HANDS as SHIPPED_HANDS

TCP, RTU = BUSES = ("sim-modbus-tcp", "sim-modbus-rtu@115200")
AT = 1.1
"""[s] after operation enabled, when the hand is in the wall."""
MANY, HALF = 1000, {"wall.stiffness": "max/2"}
HANDS = {TCP: "push", RTU: "tap"}
"""Hands that stay within the travel of the bench: on RTU half the limit is so soft that a push goes too deep."""

Ends = tuple[faults.Fault, type[HapticFieldbusError], str]
ENDING: tuple[Ends, ...] = (
    (faults.AnswerLost("answer_lost", AT, MANY), BusTimeoutError, "feedback lost: the last from node 1"),
    (faults.AnswerSwapped("answer_swapped", AT, MANY), BusTimeoutError, "feedback lost: the last from node 1"),
    (faults.AnswerGarbage("answer_garbage", AT, MANY), BusTimeoutError, "feedback lost: the last from node 1"),
    (faults.AnswerCorrupted("answer_corrupted", AT, MANY), BusTimeoutError, "feedback lost: the last from node 1"),
    (
        faults.AnswerTruncated("answer_truncated", AT, count=MANY),
        BusTimeoutError,
        "feedback lost: the last from node 1",
    ),
    (faults.AnswerWrongUnit("answer_wrong_unit", AT, 9, MANY), BusTimeoutError, "feedback lost: the last from node 1"),
    (faults.AnswerException("answer_exception", AT), BusError, "refused a request with exception 4"),
    (faults.ConnectionReset("connection_reset", AT), BusError, "reset the connection|adapter is gone"),
    (faults.ConnectionReset("connection_reset", AT, 0.01), BusError, "reset the connection|adapter is gone"),
    (faults.Silence("silence", AT), BusTimeoutError, "feedback lost: the last from node 1"),
    (faults.NodeReset("node_reset", AT), DriveFaultError, "switch on disabled by itself"),
    (faults.DriveFault("drive_fault", AT), DriveFaultError, "fault 2310h"),
    (faults.SafeTorqueOff("safe_torque_off", AT), DriveFaultError, "switch on disabled by itself"),
    (faults.MissingNode("missing_node"), BusTimeoutError, "unit 1 .* does not answer"),
    (faults.EncoderJump("encoder_jump", AT, 100_000), SafetyTripError, "speed|position"),
    # A jump as that of a torn value is doubted for a period.
    (faults.EncoderJump("encoder_jump", AT, 65_536), SafetyTripError, "speed .* the limit of"),
)
PASSED = (
    faults.AnswerLost("answer_lost", AT),
    faults.AnswerDelayed("answer_delayed", AT, 0.05),
    faults.AnswerSwapped("answer_swapped", AT),
    faults.AnswerGarbage("answer_garbage", AT),
    faults.AnswerCorrupted("answer_corrupted", AT),
    faults.AnswerTruncated("answer_truncated", AT),
    faults.AnswerWrongUnit("answer_wrong_unit", AT, 9),
    faults.DeadGuard("dead_guard"),
)
"""A single answer more or less ends nothing, and a watchdog that nobody needs neither."""


def rendered(bus: str, *these: faults.Fault, duration: float = 1.3) -> Result:
    return run("wall", bus=bus, settings=HALF, hand=HANDS[bus], duration=duration, faults=these)


@pytest.mark.thorough("every kind on both lines", quick=1)
@pytest.mark.parametrize("bus", BUSES)
@pytest.mark.parametrize(("fault", "error", "said"), ENDING, ids=[f"{fault.kind}" for fault, *_ in ENDING])
def test_what_lasts_ends_the_run_with_a_sentence(
    fault: faults.Fault, error: type[HapticFieldbusError], said: str, bus: str
) -> None:
    with pytest.raises(error, match=said):
        rendered(bus, fault)


@pytest.mark.thorough("every kind on both lines", quick=1)
@pytest.mark.parametrize("bus", BUSES)
@pytest.mark.parametrize("fault", PASSED, ids=[fault.kind for fault in PASSED])
def test_one_answer_more_or_less_ends_nothing(fault: faults.Fault, bus: str) -> None:
    result = rendered(bus, fault)
    assert result.trips == ()
    assert result.torque_error is not None


@pytest.mark.thorough("many runs")
@pytest.mark.parametrize("seed", range(60))
def test_drawn_faults_break_no_invariant(seed: int) -> None:
    """How a run ends is judged by the checker; here it may end in any way that the program has a name for."""
    draw = Random(f"modbus/{seed}")
    scene, hand = draw.choice(scene_names()), draw.choice(tuple(SHIPPED_HANDS))
    with suppress(HapticFieldbusError):
        run(scene, bus=TCP, hand=hand, duration=1.0, fade_in=0.1, faults=f"random@{seed}", seed=seed)
    with suppress(HapticFieldbusError):
        run("wall", bus=RTU, settings=HALF, hand=HANDS[RTU], duration=1.2, faults=f"random@{seed}", seed=seed)


@pytest.mark.thorough("a run")
def test_a_line_that_is_slower_than_the_plan_counts_is_named() -> None:
    """0.2 ms more on each answer leave no period with feedback; the way out is told beside the end."""
    with pytest.raises(BusTimeoutError, match="feedback lost: the last from node 1") as ended:
        rendered(TCP, faults.AnswerDelayed("answer_delayed", AT, 0.0002, MANY))
    assert isinstance(ended.value.result, Result)
    (told,) = (each for each in ended.value.result.warnings if "too late for their period" in each)
    assert "Measure round_trip with haptic-fieldbus doctor" in told


@pytest.mark.thorough("proofs of guards")
@pytest.mark.parametrize("bus", BUSES)
def test_a_watchdog_that_does_not_act_is_found_before_there_is_force(bus: str) -> None:
    run("wall", bus=bus, settings=HALF, duration=0.1, prove=True)
    with pytest.raises(UnprovedGuardError, match="did not fire in time"):
        run("wall", bus=bus, settings=HALF, duration=0.1, prove=True, faults=(faults.DeadGuard("dead_guard"),))


def test_a_fault_of_another_protocol_is_refused_before_anything_moves() -> None:
    with pytest.raises(UsageError, match='no bus of this run supports the fault "bus_off"'):
        rendered(TCP, faults.BusOff("bus_off", AT))
    with pytest.raises(UsageError, match='no bus of this run supports the fault "answer_lost"'):
        run("wall", faults=(faults.AnswerLost("answer_lost", AT),))
    with pytest.raises(UsageError, match='fault "silence" is of node 9; the drives have: 1'):
        run("wall", faults=(faults.Silence("silence", AT, node=9),))
    with pytest.raises(FaultFileError, match=r"at: -1\.0; expected a number from 0"):
        run("wall", faults=(faults.Silence("silence", -1.0),))


@pytest.mark.thorough("the same run twice")
@pytest.mark.parametrize("bus", BUSES)
def test_the_same_seed_gives_the_same_run(bus: str) -> None:
    first, second = (rendered(bus, faults.AnswerGarbage("answer_garbage", AT)) for _ in range(2))
    assert (first.traces[0].position == second.traces[0].position).all()
    assert (first.traces[0].force == second.traces[0].force).all()
