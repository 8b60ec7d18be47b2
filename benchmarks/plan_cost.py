"""Processor time of a plan of each library scene with its limits and its text, beside starting Python.

The dearest scene counts. Each measurement is a process of its own, which has judged no scene before. Starting Python
takes 11.5 ms on the machine of reference, where a plan may take 0.15 s: a ratio of 13.
"""

import json
import subprocess
import sys
from contextlib import ExitStack
from time import process_time

from rows import Figure, Pair, Row, show
from start_cost import ENVIRONMENT, used

FIRST = "inertia"
"""A scene whose plan loads the profile, which all scenes have in common."""
ALLOWED = 13.0


def plans() -> dict[str, float]:
    """Return the processor time of the plan of each scene in this process [s]."""
    from haptic_fieldbus import plan
    from haptic_fieldbus.planning.explain import explain, plan_json
    from haptic_fieldbus.scenes.catalogue import scene_names

    found = {}
    for scene in (FIRST, *scene_names()):
        begun = process_time()
        planned = plan(scene)
        explain(planned, verbose=True)
        plan_json(planned)
        found[scene] = process_time() - begun
    return found


def in_a_process() -> dict[str, float]:
    """Return the times of `plans` in a process that has judged no scene before [s]."""
    command = [sys.executable, __file__, "--plans"]
    told = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=ENVIRONMENT).stdout
    found: dict[str, float] = json.loads(told)
    return found


def start() -> float:
    """Return the processor time of starting Python [s]."""
    return min(used("-c", "pass") for _ in range(5))


def pair(_: ExitStack) -> Pair:
    return lambda: (max(in_a_process().values()), start())


FIGURES = (Figure("plan of the dearest library scene, with its limits", "starting Python", ALLOWED, pair),)


if __name__ == "__main__":
    if "--plans" in sys.argv:
        print(json.dumps(plans()))
    else:
        show([Row(scene, time, start(), ALLOWED) for scene, time in in_a_process().items()])
