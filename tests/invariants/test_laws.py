"""Each law finds what was tampered with in the evidence of a sound run, and nothing else does."""

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from haptic_fieldbus import api
from haptic_fieldbus.defaults import DEFAULT_MODBUS_DRIVE
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.sim import faults
from tests.builders import endless_rig
from tests.invariants import causes, outcome
from tests.invariants.attach import watched
from tests.invariants.laws import LAWS, ending, lasted, work_after
from tests.invariants.outcome import Ended
from tests.invariants.proofs import PROOF_LAWS, broken
from tests.invariants.witness import MASTER, STRANGER, Witness
from tests.invariants.words import ARROWS, STEP, Command, State, command_of, state_of

RPDO, TPDO = 0x201, 0x181
EVENT = 0.25
"""[s] of the fault, in contact."""
MS = 1_000_000


@cache
def _ran(*these: faults.Fault) -> tuple[Witness, str | None]:
    error = None
    with watched(keep=True) as found:
        try:
            api.run("wall", duration=0.4, fade_in=0.1, hand="push", faults=these, settings={"wall.position": 0.0})
        except HapticFieldbusError as raised:
            error = type(raised).__name__
    assert found.broken == []
    (witness,) = found.witnesses
    return witness, error


def evidence(*these: faults.Fault) -> Witness:
    """Observations of a sound run; a copy to tamper with."""
    witness, _ = _ran(*these)
    return replace(witness, shafts=deepcopy(witness.shafts), frames=list(witness.frames), clock=None)


def laws_broken(witness: Witness) -> set[str]:
    return {name for name, _ in broken(witness)}


def with_target(data: bytes, permille: int) -> bytes:
    return data[:2] + permille.to_bytes(2, "little", signed=True)


def tamper(witness: Witness, can_id: int, change: Callable[[int, bytes], bytes], place: int = -100) -> None:
    """Change one frame of the wire: the one at this place among those with its identifier."""
    at = [number for number, frame in enumerate(witness.frames) if frame[1] == can_id][place]
    t_ns, _, data, sender = witness.frames[at]
    witness.frames[at] = (t_ns, can_id, change(t_ns, data), sender)


def test_a_sound_run_breaks_nothing() -> None:
    assert laws_broken(evidence()) == set()
    assert len(evidence().frames) > 1000


def test_a_set_point_beyond_the_limit_is_found() -> None:
    witness = evidence()
    tamper(witness, RPDO, lambda t_ns, data: with_target(data, -1002))
    assert laws_broken(witness) == {"torque within limits", "slew within limits"}


def test_a_set_point_before_its_limit_has_faded_in_is_found() -> None:
    witness = evidence()
    for place in range(-400, -380):
        tamper(witness, RPDO, lambda t_ns, data: with_target(data, 150), place)
    assert laws_broken(witness) == {"torque within limits"}


def test_a_target_of_the_motor_beyond_the_limit_is_found() -> None:
    witness = evidence()
    witness.shafts[1].targets.insert(-50, (witness.shafts[1].targets[-50][0], 0.5))
    assert laws_broken(witness) == {"torque within limits"}


def test_a_step_beyond_the_slew_limit_is_found() -> None:
    witness = evidence()
    tamper(witness, RPDO, lambda t_ns, data: with_target(data, 300))
    assert laws_broken(witness) == {"slew within limits"}


@pytest.mark.parametrize("state", ["after", "before"])
def test_torque_outside_of_operation_is_found(state: str) -> None:
    witness = evidence()
    shaft = witness.shafts[1]
    t_ns = witness.seen_ns if state == "after" else next(t_ns for t_ns, number in shaft.transitions if number == 4) - 1
    shaft.targets = sorted([*shaft.targets, (t_ns, 0.01)])
    assert "no torque outside of operation" in laws_broken(witness)


def test_enabling_again_is_found_on_the_wire_and_in_the_drive() -> None:
    witness = evidence()
    last_ns = witness.seen_ns
    witness.frames += [(last_ns, RPDO, b"\x0f\0\0\0", MASTER)]
    assert laws_broken(witness) == {"nothing enables again"}
    witness = evidence()
    witness.shafts[1].transitions += [(last_ns, 2), (last_ns, 3), (last_ns, 4)]
    assert laws_broken(witness) == {"nothing enables again"}


def test_a_transition_that_the_standard_does_not_know_is_found() -> None:
    witness = evidence()
    witness.shafts[1].transitions.remove(next(each for each in witness.shafts[1].transitions if each[1] == 3))
    assert laws_broken(witness) == {"the automaton never skips"}


def test_a_command_that_skips_a_state_is_found() -> None:
    witness = evidence()
    first = next(place for place, frame in enumerate(witness.frames) if frame[1] == RPDO)
    t_ns, can_id, _, sender = witness.frames[first]
    witness.frames[first] = (t_ns, can_id, b"\x0f\0\0\0", sender)
    assert "the automaton never skips" in laws_broken(witness)


@pytest.mark.parametrize(
    "fault",
    [
        faults.DriveFault("drive_fault", EVENT),
        faults.EncoderJump("encoder_jump", EVENT, 5000),
        faults.Silence("silence", EVENT),
        faults.HostPaused("host_paused", EVENT, 0.2),
    ],
)
def test_torque_that_lasts_too_long_after_a_fault_is_found(fault: faults.Fault) -> None:
    witness = evidence(fault)
    ((_, cause, event_ns),) = ending(witness)
    stated = witness.stated.deadlines[cause]
    assert 0.0 < lasted(witness, 1, event_ns) <= stated
    late_ns = event_ns + round(1.1e9 * stated)
    shaft = witness.shafts[1]
    before = max(torque for torque in shaft.targets if torque[0] < event_ns)[1]
    shaft.targets = [each for each in shaft.targets if each[0] < event_ns] + [(late_ns, before), (late_ns + 9, 0.0)]
    assert "zero in time" in laws_broken(witness)


def test_torque_after_the_order_to_let_go_is_found() -> None:
    witness = evidence()
    assert witness.released_ns is not None
    shaft = witness.shafts[1]
    last = max(t_ns for t_ns, torque in shaft.targets if torque)
    shaft.targets = [(t_ns, torque) for t_ns, torque in shaft.targets if t_ns <= last]
    shaft.targets.append((witness.released_ns + 10 * MS, 0.0))
    assert "zero in time" in laws_broken(witness)


def test_torque_that_grows_after_a_fault_is_found() -> None:
    witness = evidence(faults.Silence("silence", EVENT))
    ((_, _, event_ns),) = ending(witness)
    shaft = witness.shafts[1]
    shaft.targets = sorted([*shaft.targets, (event_ns + 5 * MS, 0.3)])
    assert "energy after a fault bounded" in laws_broken(witness)


def test_work_after_a_fault_that_no_torque_and_time_explain_is_found() -> None:
    """A shaft that was driven on for a hundred turns by the torque of the event."""
    witness = evidence(faults.Silence("silence", EVENT))
    ((_, _, event_ns),) = ending(witness)
    shaft = witness.shafts[1]
    held = next(torque for t_ns, torque in reversed(shaft.targets) if t_ns < event_ns)
    shaft.angles[event_ns] = shaft.angles[max(t_ns for t_ns in shaft.angles if t_ns <= event_ns)]
    for t_ns in [each for each in shaft.angles if each > event_ns]:
        shaft.angles[t_ns] += math.copysign(100.0 * math.tau, held)
    assert work_after(witness, shaft, event_ns) == pytest.approx(100.0 * math.tau * abs(held), rel=0.01)
    assert "energy after a fault bounded" in laws_broken(witness)


def test_set_points_without_effect_that_nobody_notices_are_found() -> None:
    witness = evidence(faults.MissingRpdos("missing_rpdos", 10.0))  # it never happens
    for place in range(-150, -10):
        tamper(witness, RPDO, lambda t_ns, data: with_target(data, 200), place)
    assert "what has no effect is noticed" in laws_broken(witness)


@pytest.mark.parametrize(("seconds", "is_found"), [(0.05, True), (0.5, False)])
def test_a_frozen_encoder_that_nobody_notices_is_found(seconds: float, is_found: bool) -> None:
    """Its counts stand still for 150 ms of the run under 6 N; so it may, up to the stated time."""
    witness = evidence(faults.PositionStuck("position_stuck", EVENT))
    (axis,) = witness.stated.axes
    assert axis.question is not None
    assert 3.0 < axis.question.seconds < 10.0
    question = replace(axis.question, torque=0.01, pulse=0.001, seconds=seconds)
    tampered = replace(witness, stated=replace(witness.stated, axes=(replace(axis, question=question),)))
    assert ("a frozen encoder is noticed" in laws_broken(tampered)) is is_found


def test_every_law_is_tried_here() -> None:
    text = "".join(file.read_text(encoding="utf-8") for file in Path(__file__).parent.glob("test_*laws.py"))
    assert [name for name in (*LAWS, *PROOF_LAWS) if f'"{name}"' not in text] == []


class TestOutcome:
    """Exit status and recordings."""

    def wrong(self, ended: Ended, *these: faults.Fault) -> list[str]:
        return [name for name, _ in outcome.wrong([_ran(*these)[0]], ended)]

    def test_a_sound_end_is_right(self) -> None:
        assert self.wrong(Ended(None, "", 400, None)) == []

    def test_a_fault_that_ends_nothing_is_found(self) -> None:
        fault = faults.DriveFault("drive_fault", EVENT)
        assert self.wrong(Ended("DriveFaultError", "", 250, None), fault) == []
        witness = evidence(fault)
        assert witness.released_ns is not None
        witness.released_ns += 100 * MS
        assert [name for name, _ in outcome.wrong([witness], Ended(None, "", 400, None))] == ["exit status right"]

    def test_another_exit_status_is_found(self) -> None:
        jump = faults.EncoderJump("encoder_jump", EVENT, 5000)
        assert self.wrong(Ended("SafetyTripError", "", 250, None), jump) == []
        assert self.wrong(Ended("BusError", "", 250, None), jump) == ["exit status right"]

    def test_a_foreign_exception_is_found(self) -> None:
        assert self.wrong(Ended("ZeroDivisionError", "", 0, None)) == ["exit status right"]

    def test_a_harmless_fault_that_ends_the_run_is_found(self) -> None:
        fault = faults.ErrorFrame("error_frame", EVENT)
        assert self.wrong(Ended("BusError", "", 250, None), fault) == ["exit status right"]

    def test_a_cable_that_was_off_at_the_end_cannot_have_confirmed(self) -> None:
        fault = faults.Silence("silence", 0.38)
        assert _ran(fault)[1] == "BusError"
        assert self.wrong(Ended(None, "", 400, None), fault) == ["exit status right"]

    @pytest.mark.parametrize("rows", ["a,b\n1,2\n3,4\n", "a,b\n1,2\n3", "a,b\n1,2\n"])
    def test_rows_that_are_missing_or_cut_off_are_found(self, rows: str, tmp_path: Path) -> None:
        file = tmp_path / "run.csv"
        file.write_text(rows, encoding="utf-8")
        complete = rows.endswith("3,4\n")
        assert (self.wrong(Ended(None, "", 2, file)) == []) is complete

    def test_set_points_that_are_missing_in_a_log_are_found(self, tmp_path: Path) -> None:
        file = tmp_path / "run.log"
        sent = sum(frame[1] == RPDO and frame[3] == MASTER for frame in _ran()[0].frames)
        for count, right in ((sent, True), (sent - 1, False)):
            file.write_text("(1.0) sim 201#0F000000\n" * count, encoding="utf-8")
            assert (self.wrong(Ended(None, "", 400, file)) == []) is right


class TestWords:
    """The checker's own reading of the standard."""

    def test_each_statusword_of_the_table_is_one_state(self) -> None:
        table = {0x0: "NOT_READY", 0x40: "DISABLED", 0x21: "READY", 0x23: "SWITCHED_ON", 0x27: "ENABLED",
                 0x07: "QUICK_STOP", 0x0F: "REACTION", 0x08: "FAULT"}  # fmt: skip
        for bits, name in table.items():
            assert state_of(0xFF90 | bits) is State[name]
        assert state_of(0x01) is None

    def test_each_controlword_of_the_table_is_one_command(self) -> None:
        words = {0x00: "DISABLE_VOLTAGE", 0x02: "QUICK_STOP", 0x06: "SHUTDOWN", 0x07: "SWITCH_ON",
                 0x0F: "ENABLE_OPERATION", 0x80: "FAULT_RESET"}  # fmt: skip
        for word, name in words.items():
            assert command_of(word) is Command[name]

    def test_every_state_can_be_reached_and_left_alone(self) -> None:
        assert {end for _, end in ARROWS.values()} == set(State)
        assert all(Command.DISABLE_VOLTAGE in commands for commands in STEP.values())


def test_other_faults_lengthen_the_way_and_say_by_how_much() -> None:
    stated = evidence().stated
    alone = [faults.HostPaused("host_paused", EVENT, 0.5)]
    # The computer stands still when the loop waits the next time.
    assert causes.allowed(causes.STOPPED, alone, stated) == stated.deadlines[causes.STOPPED] + stated.period
    both = [*alone, faults.HostLate("host_late", EVENT, 0.01, 3)]
    assert causes.allowed(causes.STOPPED, both, stated) > 0.5 + 0.03 + stated.deadlines[causes.STOPPED]


def test_frames_of_a_stranger_are_not_the_masters() -> None:
    fault = faults.ForeignFrame("foreign_frame", EVENT, RPDO, (0x0F, 0, 0x20, 0x03), 1)
    witness = evidence(fault)
    assert any(sender == STRANGER for _, _, _, sender in witness.frames)
    assert laws_broken(witness) == set()


class TestAnotherMaster:
    """Set-points of another master on Modbus, every 50 ms."""

    FAULT = faults.ForeignSetPoints("foreign_set_points", 0.3, 0.8, 0.05)

    def evidence(self) -> Witness:
        told = pytest.raises(HapticFieldbusError, match="another master on sim-modbus-tcp")
        with watched(keep=True) as found, told:
            api.run("wall", endless_rig("wall", DEFAULT_MODBUS_DRIVE, "sim-modbus-tcp"), rate=50.0, duration=1.0,
                    fade_in=0.1, faults=[self.FAULT], settings={"wall.stiffness": "max/3"})  # fmt: skip
        assert found.broken == []
        (witness,) = found.witnesses
        return replace(witness, clock=None)

    def test_that_acted_longer_than_stated_is_found(self) -> None:
        witness = self.evidence()
        assert laws_broken(witness) == set()
        deadlines = {**witness.stated.deadlines, causes.OTHER_MASTER: 0.02}
        broken_by = laws_broken(replace(witness, stated=replace(witness.stated, deadlines=deadlines)))
        assert broken_by == {"set-points of another master are noticed"}

    def test_that_is_too_short_to_be_seen_is_not(self) -> None:
        witness = self.evidence()
        axes = tuple(replace(axis, blind=0.02) for axis in witness.stated.axes)
        stated = replace(witness.stated, axes=axes, deadlines={**witness.stated.deadlines, causes.OTHER_MASTER: 0.0})
        assert laws_broken(replace(witness, stated=stated)) == set()
