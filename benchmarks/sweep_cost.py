"""A sweep of a million verdicts, and of 10,000 loops of 10,000 periods: time, memory, what a second process brings.

`python benchmarks/sweep_cost.py [--points N]`. Memory is the largest of any process of the sweep [MB]. On a busy
machine the wall clock tells little; processor time tells what two processors would do that have nothing else.
"""

import argparse
import os
import resource
import subprocess
import sys
from math import isqrt

import numpy as np
from rows import machine

from haptic_fieldbus import sweep

MOST_MEMORY = 500.0
"""[MB]"""
STEPS = 10_000
LEAST_SPEED = 2e7
"""Periods of loops a second with two processors."""
WIDE = 1.6
"""Times as fast with a second processor."""


def swept(engine: str, count: int, workers: int) -> float:
    """Return the time of so many points [s]."""
    side = isqrt(count)
    points = {"wall.stiffness": np.linspace(1.0, 3000.0, count // side), "wall.damping": np.linspace(0.0, 20.0, side)}
    return sweep("wall", points, engine=engine, steps=STEPS, workers=workers).wall_s or 0.0


def peak() -> float:
    """Return the largest memory of this process and of those that it has ended [MB]."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1e3


def alone(engine: str, count: int, workers: int) -> tuple[float, float, float]:
    """Return time [s], processor time [s] and memory [MB] of a sweep in a process of its own."""
    command = [sys.executable, __file__, "--only", engine, "--points", str(count), "--workers", str(workers)]
    seconds, processor, memory = map(
        float, subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    )
    return seconds, processor, memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--only", choices=["verdict", "loop"])
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    if asked.only:
        before = sum(os.times()[:4])
        seconds = swept(asked.only, asked.points, asked.workers)
        print(seconds, sum(os.times()[:4]) - before, peak())
        return
    print(machine())
    for engine, count in (("verdict", asked.points), ("loop", asked.points // 100)):
        found: dict[int, list[tuple[float, float, float]]] = {1: [], 2: []}
        for workers in (1, 2) * 3:
            found[workers].append(alone(engine, count, workers))
        (one, busy_one, memory_one), (two, busy_two, memory_two) = (
            tuple(map(min, zip(*found[workers], strict=True))) for workers in (1, 2)
        )
        print(
            f"{count} points of {engine}: {one:.1f} s with one process, {two:.1f} s with two; processor time "
            f"{busy_one:.1f} s and {busy_two:.1f} s; {max(memory_one, memory_two):.0f} MB, at most "
            f"{MOST_MEMORY:.0f} promised"
        )
        print(
            f"{engine}: {one / two:.2f} times as fast with two, {2.0 * busy_one / busy_two:.2f} by processor time; "
            f"{WIDE} expected"
        )
        if engine == "loop":
            print(
                f"loop: {count * STEPS / two:.2g} periods a second with two processes, "
                f"{2.0 * count * STEPS / busy_two:.2g} by processor time; at least {LEAST_SPEED:.0g} promised"
            )


if __name__ == "__main__":
    main()
