"""A sweep of a million verdicts, and of 10,000 loops of 10,000 periods: time, memory, what a second process brings.

`python benchmarks/sweep_cost.py [--points N]`. Memory is the largest of any process of the sweep [MB]. On a busy
machine the wall clock tells little; processor time tells what two processors would do that have nothing else.
The exit status is 1 when memory or speed, by processor time, is not as promised.
"""

import argparse
import os
import resource
import subprocess
import sys
from contextlib import ExitStack
from math import isqrt

import numpy as np
from rows import Figure, Pair, cost, machine

from haptic_fieldbus.numerics.batch import loops, run

MOST_MEMORY = 500.0
"""[MB]"""
STEPS = 10_000
LEAST_SPEED = 2e7
"""Periods of loops a second with two processors."""
WIDE = 1.6
"""Times as fast with a second processor."""


SIDE_BY_SIDE, ARRAYS = 1024, 17
"""Loops of a chunk of a sweep; multiplications of arrays in a step of them, each with an addition."""


def step_of_loops() -> float:
    """Return the time of a step of loops with an encoder and a lag, side by side [s]."""
    given = loops(
        mass=0.6, damping=1.5, period=1e-3, delay=3e-4, stiffness=np.linspace(100.0, 2000.0, SIDE_BY_SIDE),
        virtual_damping=2.0, lag=1.6e-4, resolution=1e-5, velocity=1.0,
    )  # fmt: skip
    return cost(lambda: run(given, 500), 1, repeat=3) / 500


def numpy_alone() -> float:
    """Return the time that numpy needs for as many products and sums of arrays [s]."""
    factor, total, product = np.full(SIDE_BY_SIDE, 0.5), np.ones(SIDE_BY_SIDE), np.empty(SIDE_BY_SIDE)

    def step() -> None:
        for _ in range(ARRAYS):
            np.multiply(total, factor, out=product)
            np.add(total, product, out=product)

    return cost(step, 500, repeat=3)


def pair(_: ExitStack) -> Pair:
    """Measure in a process of its own, as the workers of a sweep are: beside runs in its process a step is slower."""

    def measured() -> tuple[float, float]:
        command = [sys.executable, __file__, "--only", "step"]
        ours, reference = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
        return float(ours), float(reference)

    return measured


FIGURES = (Figure(f"step of {SIDE_BY_SIDE} loops of a sweep", f"{ARRAYS} products and sums of arrays", 3.5, pair),)


def swept(engine: str, count: int, workers: int) -> float:
    """Return the time of so many points [s]."""
    side = isqrt(count)
    points = {"wall.stiffness": np.linspace(1.0, 3000.0, count // side), "wall.damping": np.linspace(0.0, 20.0, side)}
    from haptic_fieldbus import sweep  # needs pyarrow, which the figure above does without

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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--only", choices=["verdict", "loop", "step"])
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    if asked.only == "step":
        print(step_of_loops(), numpy_alone())
        return 0
    if asked.only:
        before = sum(os.times()[:4])
        seconds = swept(asked.only, asked.points, asked.workers)
        print(seconds, sum(os.times()[:4]) - before, peak())
        return 0
    print(machine())
    broken = False
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
        broken |= max(memory_one, memory_two) > MOST_MEMORY
        print(
            f"{engine}: {one / two:.2f} times as fast with two, {2.0 * busy_one / busy_two:.2f} by processor time; "
            f"{WIDE} expected"
        )
        if engine == "loop":
            broken |= 2.0 * count * STEPS / busy_two < LEAST_SPEED
            print(
                f"loop: {count * STEPS / two:.2g} periods a second with two processes, "
                f"{2.0 * count * STEPS / busy_two:.2g} by processor time; at least {LEAST_SPEED:.0g} promised"
            )
    return int(broken)


if __name__ == "__main__":
    sys.exit(main())
