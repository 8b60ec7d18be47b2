"""The laws of a sign that is not known find what was tampered with in the evidence of sound runs."""

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.sim import faults
from tests.invariants.attach import watched
from tests.invariants.proofs import broken
from tests.invariants.witness import Witness
from tests.system.sign_bench import REVERSED, unseen_rig

RPDO = 0x201
MS = 1_000_000


@cache
def _ran(*these: faults.Fault) -> Witness:
    with watched(keep=True) as found:
        try:
            run("wall", rig=unseen_rig(Task("wall")), hand="push", duration=1.2, faults=these,
                settings={"wall.position": 0.0})  # fmt: skip
        except SafetyTripError:
            assert these
    assert found.broken == []
    (witness,) = found.witnesses
    return witness


def evidence(*these: faults.Fault) -> Witness:
    """Observations of a sound run; a copy to tamper with."""
    witness = _ran(*these)
    return replace(witness, shafts=deepcopy(witness.shafts), frames=list(witness.frames), clock=None)


def laws_broken(witness: Witness) -> set[str]:
    return {name for name, _ in broken(witness)}


def ask_for(witness: Witness, torque: float, after: float) -> None:
    """Tamper with the set-points of 20 periods from so long after enabling [s] on."""
    enabled_ns = witness.enabled_ns
    assert enabled_ns is not None
    since_ns = enabled_ns + round(after * 1e9)
    places = [at for at, frame in enumerate(witness.frames) if frame[1] == RPDO and frame[0] >= since_ns]
    raw = round(torque / witness.shafts[1].unit).to_bytes(2, "little", signed=True)
    for at in places[:20]:
        t_ns, can_id, data, sender = witness.frames[at]
        witness.frames[at] = (t_ns, can_id, data[:2] + raw, sender)


def test_pulses_and_the_force_after_them_break_nothing() -> None:
    witness = evidence()
    assert laws_broken(witness) == set()
    (axis,) = witness.stated.axes
    assert axis.probe is not None
    largest = max(abs(torque) for _, torque in witness.shafts[1].targets)
    assert largest > axis.unseen, "the sign is seen, and force rises"


@pytest.mark.parametrize(("share", "is_found"), [(0.99, False), (1.25, True), (-1.25, True)])
def test_more_than_the_pulses_before_the_sign_can_have_been_seen_is_found(share: float, is_found: bool) -> None:
    """The faded-in limit would permit it long since."""
    witness = evidence()
    (axis,) = witness.stated.axes
    assert axis.probe is not None
    faded = 0.07 / axis.fade_in * axis.torque
    assert faded > 1.25 * axis.unseen
    ask_for(witness, share * axis.unseen, after=0.065)
    assert axis.probe.least > 0.087
    assert ("torque within limits" in laws_broken(witness)) is is_found


def test_a_limit_that_does_not_fade_in_from_there_is_found() -> None:
    witness = evidence()
    (axis,) = witness.stated.axes
    assert axis.probe is not None
    ask_for(witness, 0.5 * axis.torque, after=axis.probe.least + 0.005)
    assert "torque within limits" in laws_broken(witness)


def test_the_permitted_torque_is_that_of_the_text() -> None:
    """5 N until the sign can have been seen, then it rises from 5 % of rated torque within the fade-in."""
    (axis,) = evidence().stated.axes
    assert axis.probe is not None
    assert axis.unseen == pytest.approx(0.099 * 0.4)
    least, period = axis.probe.least, 1e-3
    permitted = axis.permitted(np.array([0.0, 0.99 * least, least + 0.05, 10.0]), period)
    assert permitted[:2] == pytest.approx(axis.unseen)
    assert permitted[2] == pytest.approx(0.05 * 0.4 + (0.05 + 2 * period) / axis.fade_in * axis.torque)
    assert permitted[3] >= axis.torque


@pytest.mark.parametrize(
    "change",
    [{"permitted": 0.03}, {"share": 0.05}, {"pulses": 0.05}],
    ids=["at the handle", "of rated torque", "as stated"],
)
def test_a_bound_above_what_is_promised_is_found_even_if_the_plan_states_it(change: dict[str, float]) -> None:
    witness = evidence()
    (axis,) = witness.stated.axes
    assert axis.probe is not None
    changed = replace(axis, probe=replace(axis.probe, **change))
    witness = replace(witness, stated=replace(witness.stated, axes=(changed,)))
    assert laws_broken(witness) == {"little torque before the sign is seen"}


def test_more_than_5_newton_at_the_motor_before_the_sign_is_seen_is_found() -> None:
    witness = evidence()
    (axis,), shaft, enabled_ns = witness.stated.axes, witness.shafts[1], witness.enabled_ns
    assert axis.probe is not None
    assert enabled_ns is not None
    shaft.targets = sorted([*shaft.targets, (enabled_ns + 50 * MS + 1, 1.01 * axis.probe.permitted)])
    assert "little torque before the sign is seen" in laws_broken(witness)


@pytest.mark.parametrize("wrong", REVERSED)
def test_force_with_a_wrong_sign_is_found(wrong: str) -> None:
    witness = evidence(REVERSED[wrong])
    assert laws_broken(witness) == set()
    (axis,), shaft = witness.stated.axes, witness.shafts[1]
    at_ns = max(t_ns for t_ns, torque in shaft.targets if torque)
    shaft.targets = sorted([*shaft.targets, (at_ns, 1.1 * axis.unseen)])
    assert laws_broken(witness) == {"a wrong sign gets no force", "little torque before the sign is seen"}


def test_two_wrong_signs_are_a_right_one() -> None:
    """Encoder and motor reversed: no loop can tell, so force may rise."""
    witness = evidence(*REVERSED.values())
    (axis,), shaft = witness.stated.axes, witness.shafts[1]
    shaft.targets = sorted([*shaft.targets, (max(t_ns for t_ns, torque in shaft.targets if torque), 2.0 * axis.unseen)])
    assert laws_broken(witness) == set()


def test_a_sign_that_is_known_to_be_right_takes_no_pulses() -> None:
    witness = evidence()
    axes = tuple(replace(axis, probe=None) for axis in witness.stated.axes)
    assert laws_broken(replace(witness, stated=replace(witness.stated, axes=axes))) == {"torque within limits"}
