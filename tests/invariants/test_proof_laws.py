"""The laws of proofs find what was tampered with in the evidence of a run that proves its guards first."""

from copy import deepcopy
from dataclasses import replace
from functools import cache

import pytest

from haptic_fieldbus import api
from haptic_fieldbus.errors import UnprovedGuardError
from haptic_fieldbus.sim import faults
from tests.invariants import outcome
from tests.invariants.attach import watched
from tests.invariants.outcome import Ended
from tests.invariants.parts import parts_of
from tests.invariants.proofs import broken, let_go_after
from tests.invariants.witness import MASTER, Witness
from tests.invariants.words import State

RPDO, EMCY = 0x201, 0x081
MS = 1_000_000


@cache
def _ran(prove: bool = True, *these: faults.Fault) -> Witness:
    with watched(keep=True) as found:
        try:
            api.run("wall", duration=1.1, hand="push", prove=prove, faults=these,
                    settings={"wall.position": 0.0})  # fmt: skip
        except UnprovedGuardError:
            assert these
    assert found.broken == []
    (witness,) = found.witnesses
    return witness


def evidence(prove: bool = True, *these: faults.Fault) -> Witness:
    """Observations of a sound run; a copy to tamper with."""
    witness = _ran(prove, *these)
    return replace(
        witness, shafts=deepcopy(witness.shafts), frames=list(witness.frames), earlier=list(witness.earlier), clock=None
    )


def laws_broken(witness: Witness) -> set[str]:
    return {name for name, _ in broken(witness)}


def proof_of(witness: Witness) -> Witness:
    return parts_of(witness)[0]


def in_the_proof(witness: Witness) -> int:
    """An instant while the drive is enabled and hears its master [ns]."""
    enabled_ns = proof_of(witness).enabled_ns
    assert enabled_ns is not None
    return enabled_ns + MS // 2


def test_a_run_with_a_proof_is_sound_and_has_two_parts() -> None:
    witness = evidence()
    assert laws_broken(witness) == set()
    proof, run = parts_of(witness)
    assert (proof.proves, run.proves) == (True, False)
    assert 0.03 < (let_go_after(proof, proof.stated.axes[0]) or 0.0) < 0.0505
    assert sum(number == 4 for _, number in witness.shafts[1].transitions) == 2
    assert any(torque for _, torque in run.shafts[1].targets)


def test_the_parts_lose_nothing() -> None:
    witness = evidence()
    proof, run = parts_of(witness)
    assert proof.frames + run.frames == witness.frames
    assert proof.shafts[1].transitions + run.shafts[1].transitions == witness.shafts[1].transitions
    assert run.shafts[1].state is State.DISABLED


def test_torque_on_the_wire_while_a_guard_is_proved_is_found() -> None:
    witness = evidence()
    at = next(place for place, frame in enumerate(witness.frames) if frame[:2] >= (in_the_proof(witness), RPDO))
    witness.frames.insert(at, (in_the_proof(witness), RPDO, b"\x0f\0\1\0", MASTER))
    assert "proofs are torque-free" in laws_broken(witness)


def test_torque_at_the_motor_while_a_guard_is_proved_is_found() -> None:
    witness = evidence()
    witness.shafts[1].targets = sorted([*witness.shafts[1].targets, (in_the_proof(witness), 1e-4)])
    assert laws_broken(witness) == {"proofs are torque-free"}


def test_torque_of_a_proof_that_ended_the_run_is_found() -> None:
    witness = evidence(True, faults.DeadGuard("dead_guard"))
    assert witness.proves
    witness.shafts[1].targets = sorted([*witness.shafts[1].targets, (in_the_proof(witness), 1e-4)])
    assert laws_broken(witness) == {"proofs are torque-free"}


def test_enabling_twice_within_one_proof_is_found() -> None:
    witness = evidence()
    released_ns = witness.earlier[0].released_ns
    assert released_ns is not None
    shaft = witness.shafts[1]
    shaft.transitions = sorted([*shaft.transitions, *((released_ns + number, number) for number in (2, 3, 4, 9))])
    assert "nothing enables again" in laws_broken(witness)


def test_enabling_again_after_a_run_is_no_proof() -> None:
    """With or without torque: what was not called a proof is none."""
    witness = evidence()
    witness.earlier[0] = replace(witness.earlier[0], proves=False)
    assert "proofs come first" in laws_broken(witness)
    alone = evidence(False)
    assert laws_broken(alone) == set()
    alone.shafts[1].transitions += [(alone.seen_ns, number) for number in (2, 3, 4)]
    assert laws_broken(alone) == {"nothing enables again"}


def test_enabling_again_in_the_run_after_a_proof_is_found() -> None:
    witness = evidence()
    witness.shafts[1].transitions += [(witness.seen_ns, number) for number in (2, 3, 4)]
    assert "nothing enables again" in laws_broken(witness)
    witness = evidence()
    witness.frames.append((witness.seen_ns, RPDO, b"\x0f\0\0\0", MASTER))
    assert laws_broken(witness) == {"nothing enables again"}


def test_torque_of_the_run_after_a_proof_is_held_to_its_limits() -> None:
    witness = evidence()
    at = [place for place, frame in enumerate(witness.frames) if frame[1] == RPDO][-100]
    t_ns, can_id, data, sender = witness.frames[at]
    witness.frames[at] = (t_ns, can_id, data[:2] + (1002).to_bytes(2, "little"), sender)
    assert laws_broken(witness) == {"torque within limits", "slew within limits"}


@pytest.mark.parametrize(("copies", "is_found"), [(4, False), (5, True)])
def test_more_than_five_proofs_are_found(copies: int, is_found: bool) -> None:
    witness = evidence()
    (proof,) = witness.earlier
    before = replace(proof, begun_ns=proof.begun_ns - 1, ended_ns=proof.begun_ns)
    witness.earlier = [before] * copies + [proof]
    assert (laws_broken(witness) == {"proofs come first"}) is is_found


def test_a_proof_that_nobody_asked_for_is_found() -> None:
    witness = replace(evidence(), may_prove=False)
    assert laws_broken(witness) == {"proofs come first"}


def test_a_proof_that_is_not_over_before_the_run_is_found() -> None:
    witness = evidence()
    witness.earlier[0] = replace(witness.earlier[0], released_ns=None)
    assert "proofs come first" in laws_broken(witness)


def test_a_fault_that_is_cleared_and_was_no_lost_master_is_found() -> None:
    witness = evidence()
    (proof,) = witness.earlier
    assert proof.released_ns is not None
    shaft = witness.shafts[1]
    cleared = [(proof.released_ns + place, number) for place, number in enumerate((13, 14, 15), start=MS)]
    shaft.transitions = sorted([*shaft.transitions, *cleared])
    assert laws_broken(witness) == set(), "the drive has told that it lost its master"
    told = next(place for place, frame in enumerate(witness.frames) if frame[1] == EMCY)
    t_ns, can_id, data, sender = witness.frames[told]
    witness.frames[told] = (t_ns, can_id, b"\x10\x23" + data[2:], sender)
    assert laws_broken(witness) == {"only a lost master is acknowledged"}


def test_a_fault_that_is_cleared_in_the_run_is_found() -> None:
    witness = evidence()
    witness.shafts[1].transitions += [(witness.seen_ns, number) for number in (13, 14, 15)]
    assert laws_broken(witness) == {"only a lost master is acknowledged"}


@pytest.mark.parametrize("late", [None, 60 * MS])
def test_a_run_after_a_guard_that_did_not_act_is_found(late: int | None) -> None:
    witness = evidence()
    shaft, proof = witness.shafts[1], proof_of(witness)
    left = next(each for each in shaft.transitions if each[1] == 9)
    written = max(t_ns for t_ns, can_id, _, _ in proof.frames if can_id == RPDO and t_ns < left[0])
    assert proof.released_ns is not None
    when_ns = proof.released_ns + 1 if late is None else written + late
    witness.earlier[0] = replace(witness.earlier[0], released_ns=max(proof.released_ns, when_ns - (late is None)))
    shaft.transitions[shaft.transitions.index(left)] = (when_ns, 9)
    assert "guards act before a run" in laws_broken(witness)


def test_a_run_on_a_real_bus_without_the_proof_is_found() -> None:
    alone = evidence(False)
    axes = tuple(replace(axis, unproved=True) for axis in alone.stated.axes)
    alone.stated = replace(alone.stated, axes=axes)
    assert laws_broken(alone) == set(), "a simulation trusts the drives that it brings along"
    assert laws_broken(replace(alone, must_prove=True)) == {"guards act before a run"}
    assert laws_broken(replace(evidence(), stated=alone.stated, must_prove=True)) == set()


class TestOutcome:
    """Exit status 4 says that a guard did not act, and nothing else."""

    REFUSED = Ended("UnprovedGuardError", "did not act", 0, None)

    def wrong(self, witness: Witness, ended: Ended) -> list[str]:
        return [name for name, _ in outcome.wrong([witness], ended)]

    @pytest.mark.parametrize("factor", [None, 1.5])
    def test_a_guard_that_does_not_act_or_acts_late_is_refused(self, factor: float | None) -> None:
        assert self.wrong(evidence(True, faults.DeadGuard("dead_guard", factor=factor)), self.REFUSED) == []

    def test_guards_that_have_acted_are_not_refused(self) -> None:
        assert self.wrong(evidence(), self.REFUSED) == ["exit status right"]
        proof = proof_of(evidence())
        assert self.wrong(proof, self.REFUSED) == ["exit status right"]
        assert self.wrong(evidence(False), self.REFUSED) == ["exit status right"]

    def test_a_run_that_was_no_more_than_a_proof_is_found(self) -> None:
        assert self.wrong(proof_of(evidence()), Ended(None, "", 1100, None)) == ["exit status right"]
