"""A sweep of a million verdicts, and of 10,000 loops of 10,000 periods: time, memory, what a second process brings.

`python benchmarks/sweep_cost.py [--points N]`. Memory is the largest of any process of the sweep [MB].
"""

import argparse
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
"""Steps of loops a second with two processes."""


def verdicts(count: int, workers: int) -> float:
    """Return the time of so many verdicts of walls [s]."""
    side = isqrt(count)
    points = {"wall.stiffness": np.linspace(1.0, 3000.0, count // side), "wall.damping": np.linspace(0.0, 20.0, side)}
    return sweep("wall", points, workers=workers).wall_s or 0.0


def simulated(count: int, workers: int) -> float:
    """Return the time of so many simulated loops of 10,000 periods [s]."""
    side = isqrt(count)
    points = {"wall.stiffness": np.linspace(1.0, 3000.0, count // side), "wall.damping": np.linspace(0.0, 20.0, side)}
    return sweep("wall", points, engine="loop", steps=STEPS, workers=workers).wall_s or 0.0


def peak() -> float:
    """Return the largest memory of this process and of those that it has ended [MB]."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1e3


def alone(engine: str, count: int, workers: int) -> tuple[float, float]:
    """Return time [s] and memory [MB] of a sweep in a process of its own."""
    command = [sys.executable, __file__, "--only", engine, "--points", str(count), "--workers", str(workers)]
    seconds, memory = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(seconds), float(memory)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--only", choices=["verdict", "loop"])
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    if asked.only:
        print((verdicts if asked.only == "verdict" else simulated)(asked.points, asked.workers), peak())
        return
    print(machine())
    for engine, count in (("verdict", asked.points), ("loop", asked.points // 100)):
        times: dict[int, list[float]] = {}
        for workers in (1, 2, 1, 2):
            seconds, memory = alone(engine, count, workers)
            times.setdefault(workers, []).append(seconds)
            print(
                f"{count} points of {engine}, {workers} processes: {seconds:.1f} s, {memory:.0f} MB, at most "
                f"{MOST_MEMORY:.0f} promised"
            )
        print(f"{engine}: two processes beside one: {min(times[1]) / min(times[2]):.2f} times as fast")
    speed = count * STEPS / min(times[2])
    print(f"loop: {speed:.2g} steps a second with two processes, at least {LEAST_SPEED:.1g} promised")


if __name__ == "__main__":
    main()
