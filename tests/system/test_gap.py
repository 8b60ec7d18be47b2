"""Feedback that stays away for 20 ms while a hand leans on a wall: force and energy of the true motion."""

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.sim.faults import MissingTpdos
from tests.builders import endless_rig

CONTACT = 2.0
"""[s] after operation enabled; the pushing hand has come to rest in the wall."""
RESTING_FORCE = 6.0
"""[N] of the pushing hand, which the wall balances; beside it friction, 2 mN·m of the motor or 0.25 N."""
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
