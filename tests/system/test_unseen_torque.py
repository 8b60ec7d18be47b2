"""Torque at the simulated motor before the sign is seen, on benches that are not as their rig says.

The motor's torque is that of the simulation, which shares no code with the limits of the plan.
"""

from collections import Counter

import pytest

from tests.system.slipped_bench import DESCRIPTIVE, DRIVES, SECONDS, SHARE, before_the_sign, drawn, wrong_with

pytestmark = pytest.mark.unwatched("the bench is not as its rig says, by which a witness would judge it")
PARTS, PART = 20, 100


def judged(seeds: range, seconds: float) -> Counter[str]:
    """Draw benches and check each; how many of each kind there were."""
    found: Counter[str] = Counter()
    for seed in seeds:
        bench = drawn(seed)
        torque = before_the_sign(bench, seconds)
        assert [*wrong_with(bench, torque)] == [], seed
        found.update([bench.drive, *bench.keys, "refused" if torque.plan is None else "planned"])
        found["with torque"] += torque.share > 0.0
        found["near the bound"] += torque.share > 0.9 * SHARE
    return found


def test_slips_in_a_rig_raise_no_torque_before_the_sign_is_seen() -> None:
    """One rig for each drive; which of them come near the bound changes with the number of drives."""
    found = judged(range(len(DRIVES)), 0.25)
    assert all(found[drive] for drive in DRIVES)
    assert found["with torque"] > 5


@pytest.mark.thorough("draws 2,000 rigs")
@pytest.mark.parametrize("part", range(PARTS))
def test_slips_in_2000_rigs_raise_no_torque_before_the_sign_is_seen(part: int) -> None:
    found = judged(range(part * PART, (part + 1) * PART), SECONDS)
    assert all(found[drive] for drive in DRIVES)
    assert all(found[key] for key in DESCRIPTIVE)
    assert found["with torque"] > PART // 4
    assert found["near the bound"] > 0
