"""Every number of every library scene, changed to and fro while it runs: no guard takes a live change for a fault."""

import math
from collections.abc import Iterator
from itertools import cycle, islice

import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.live_changes import plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.builders import endless_rig

DURATION, EVERY = 20.0, 0.23
"""[s]; a change begins while the handle moves, is pressed in, or is on its way out, at another phase each time."""


def accepted(running: Plan) -> Iterator[dict[str, float]]:
    """Yield the changes that are possible: each number of each element less, then more, each time back."""
    for element in running.scene.elements:
        for name, value in vars(element).items():
            if isinstance(value, float) and math.isfinite(value) and value != 0.0:
                steps = [{f"{element.name}.{name}": factor * value} for factor in (0.8, 1.0, 1.15, 1.0)]
                if all(is_possible(running, step) for step in steps):
                    yield from steps


def is_possible(running: Plan, settings: dict[str, float]) -> bool:
    try:
        plan_change(running, running, settings)
    except HapticFieldbusError:
        return False
    return True


@pytest.mark.thorough("every number of every scene")
@pytest.mark.parametrize("scene", scene_names())
def test_changes_end_no_run(scene: str) -> None:
    possible = list(accepted(plan(scene)))
    times = [EVERY * (number + 1) for number in range(int(DURATION / EVERY) - 1)]
    changes = list(zip(times, islice(cycle(possible), len(times)), strict=False))
    result = run(scene, endless_rig(scene), duration=DURATION, changes=changes)
    assert result.trips == ()
    assert len(result.changes) == len(changes)
    if not possible:
        pytest.skip(f"no number of {scene} can be changed while it runs")
