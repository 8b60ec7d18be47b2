"""Feedback that stays away for 20 ms while a hand leans on a wall: force and energy of the true motion."""

import re

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.sim.faults import MissingTpdos
from tests.builders import endless_rig
from tests.system.sign_bench import unseen_rig

CONTACT = 2.0
"""[s] after operation enabled; the pushing hand has come to rest in the wall."""
RESTING_FORCE = 6.0
"""[N] of the pushing hand, which the wall balances; beside it friction, 2 mN·m of the motor or 0.25 N."""
ENTERED, SPEED = 0.7221, 0.29
"""When this hand brings the handle to the wall [s after operation enabled], and how fast it is then [m/s]."""
FRICTION = 2.0e-3 / (0.05 / (2 * np.pi))


def leaning(missing: int) -> Result:
    return run("wall", duration=4.0, faults=[MissingTpdos("missing_tpdos", CONTACT, missing)])


@pytest.mark.thorough("two runs of four seconds", quick=1)
@pytest.mark.parametrize("missing", [20, 25])
def test_after_a_gap_in_contact_no_force_is_above_that_before_it(missing: int) -> None:
    trace = leaning(missing).traces[0]
    before = np.abs(trace.force[(trace.times > CONTACT - 0.1) & (trace.times < CONTACT)]).max()
    after = np.abs(trace.force[trace.times > CONTACT])
    assert before == pytest.approx(RESTING_FORCE, abs=FRICTION + 0.05)
    assert after.max() <= before + 1e-9


@pytest.mark.thorough("runs with gaps")
def test_the_energy_that_a_gap_costs_the_hand_is_what_its_push_does_meanwhile() -> None:
    """The hand pushes a handle that nobody holds: what it falls through, the wall gives back no more of.

    Work of the motor on the handle from the gap on, that is ∫F·dx of the true motion, is never above zero by more than
    the wall's own leak: the handle is let in under a force that fades, and is not thrown out.
    """
    trace = leaning(20).traces[0]
    late = trace.times > CONTACT - 0.001
    force, position = trace.force[late], trace.position[late]
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(position))
    assert work.max() <= 1e-4
    assert work.min() > -0.2


@pytest.mark.thorough("each shipped wall for 20 s with single gaps all over")
@pytest.mark.parametrize("hand", ["push", "tap", "release"])
def test_single_missing_samples_all_over_a_run_are_no_reason_to_stop(hand: str) -> None:
    faults = [MissingTpdos("missing_tpdos", 0.7 + 0.05 * number, 1) for number in range(300)]
    assert run("wall", endless_rig("wall"), duration=20.0, hand=hand, faults=faults).cycles == 20_000


def test_a_force_that_a_gap_took_is_told() -> None:
    """The feedback stays away while a hand leans that then pushes harder: no more than before comes back."""
    found = leaning(20)
    whole = run("wall", duration=4.0)
    assert found.traces[0].position[-1] - whole.traces[0].position[-1] > 0.005
    told = next(text for text in found.warnings if "stayed limited" in text)
    assert "after a long feedback gap the force stayed limited to its value before the gap" in told
    assert "the limit ends when the handle leaves contact" in told
    assert not [text for text in found.warnings if "requested more" in text]


@pytest.mark.thorough("three runs of two seconds and a half", quick=1)
@pytest.mark.parametrize("missing", [5, 15, 20])
def test_a_wall_that_a_gap_hides_stands_where_the_handle_is_seen_again(missing: int) -> None:
    """Feedback stays away from just before the handle enters the wall, which then is as much deeper for the hand."""
    found = run("wall", endless_rig("wall"), duration=2.5, faults=[MissingTpdos("missing_tpdos", 0.721, missing)])
    whole = run("wall", endless_rig("wall"), duration=2.5)
    (told,) = [text for text in found.warnings if "gap" in text]
    beside = re.search(r"after a feedback gap the scene was displaced by up to ([\d.]+) mm", told)
    assert beside is not None
    hidden = (0.721 + missing * 1e-3 - ENTERED) * SPEED
    assert 1e-3 * float(beside.group(1)) == pytest.approx(hidden, abs=2e-3 * SPEED), "to two samples"
    deeper = found.traces[0].position[-1] - whole.traces[0].position[-1]
    assert deeper == pytest.approx(1e-3 * float(beside.group(1)), abs=2.0 * FRICTION / 600.0)


@pytest.mark.thorough("a run of seconds")
def test_many_short_gaps_leave_a_wall_that_holds() -> None:
    """Three missing samples in each tenth of a second, as a computer whose host takes it away for a moment."""
    gaps = [MissingTpdos("missing_tpdos", 0.1 * number, 3) for number in range(1, 80)]
    found = run("wall", endless_rig("wall"), duration=8.0, faults=gaps)
    assert found.traces[0].position[-1] - 0.02 == pytest.approx(RESTING_FORCE / 600.0, abs=2e-3)


def test_feedback_that_breaks_off_the_proof_of_the_sign_is_named_as_the_reason() -> None:
    gaps = [MissingTpdos("missing_tpdos", 0.02 + 0.04 * number, 2) for number in range(25)]
    found = run("wall", unseen_rig(Task("wall")), duration=1.0, faults=gaps)
    (told,) = [text for text in found.warnings if "motor direction" in text]
    assert "feedback gaps interrupted the check" in told
    assert "too short" not in told
