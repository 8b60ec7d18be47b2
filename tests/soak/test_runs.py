"""Seeded runs with faults, over library scenes and shipped profiles of both protocols: no invariant breaks.

A seed that fails is told with its faults as the text of a file: `haptic-fieldbus run SCENE --faults FILE` repeats it,
`python -m tests.soak.find replay SEED FILE` judges it.
"""

import json

import pytest

from haptic_fieldbus.sim.faults.drawing import ANSWER_RECIPES, RECIPES
from tests.soak.case import CAN, RTU, TCP, case_of, kinds, profiles, scenes
from tests.soak.planted import PROJECT, called

QUICK_RUNS, QUICK_DURATION = 10, 0.4
THOROUGH_RUNS, SHARE = 1000, 100


def test_some_seeds_break_nothing() -> None:
    assert json.loads(called(PROJECT, "judge", "0", str(QUICK_RUNS), str(QUICK_DURATION))) == []


@pytest.mark.thorough("a hundred runs each")
@pytest.mark.parametrize("first", range(0, THOROUGH_RUNS, SHARE))
def test_many_seeds_break_nothing(first: int) -> None:
    assert json.loads(called(PROJECT, "judge", str(100_000 + first), str(SHARE), "1.0")) == []


def test_seeds_reach_every_scene_profile_and_kind() -> None:
    cases = [case_of(seed) for seed in range(1000)]
    assert {case.scene for case in cases} == set(scenes())
    assert {case.drive for case in cases} == {*profiles(), *profiles("modbus")}
    assert {case.bus for case in cases} == {CAN, TCP, RTU}
    assert {fault.kind for case in cases for fault in case.faults} == {*RECIPES, *ANSWER_RECIPES}
    assert {fault.kind for case in cases if case.bus != CAN for fault in case.faults} == set(kinds())
