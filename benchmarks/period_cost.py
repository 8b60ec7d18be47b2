"""One period: the cycle beside scenes written by hand with the same guards, and a whole simulated run."""

import math
import struct
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count, islice
from itertools import cycle as endless
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import by_hand
from rows import Figure, Pair, Row, show

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.cycle.cycle import Cycle

PERIODS = 10_000
COUNTS = 2000
"""Encoder counts of the handle, in the wall."""
TWIST = 500
"""Encoder counts between the handles of a shaft."""
FADE_IN, AGREEING = 1000, 1000
"""Periods after which force has faded in, and periods behind them in which both loops must send the same."""
BATCHES, BATCH = 200, 100
"""Batches of a round, and periods of each: so few that other programs seldom come between them."""
MASS = """\
description = "A mass on a spring, so heavy that it stays where it is"
[axis.handle]
workspace = "linear"
[[element]]
kind = "sprung_mass"
axis = "handle"
stiffness = 200.0
mass = 1e9
"""
WAYS = (0, 1, 2, 3, 4, 3, 2, 1)
"""Motion of the handle in contact [counts]; one that stands still for long is another way through the cycle."""


def wall_pair(stack: ExitStack) -> Pair:
    """Decode to encode in contact with a wall, faded in, while the handle moves by a few counts."""
    return one_axis(Cycle(plan("wall")), by_hand.wall())


def mass_pair(stack: ExitStack) -> Pair:
    """Decode to encode with a virtual mass, at a handle that moves by a few counts."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mass.toml"
        path.write_text(MASS, encoding="utf-8")
        return one_axis(Cycle(plan(path)), by_hand.mass(200.0, 1e9))


def one_axis(cycle: Cycle, loop: by_hand.Loop) -> Pair:
    """Lead the handle to its place and fade in; then measure there from decode to encode."""

    def image(t_ns: int, counts: int, output: bytes) -> bytes:
        return by_hand.ONE.pack(t_ns, 100_000, 0, 0, 0x0637, counts, *struct.unpack("<2xh", output))

    return pair(cycle, loop, image, [*range(0, COUNTS, 20), *[COUNTS] * FADE_IN], bytes(4))


def coupled_pair(stack: ExitStack) -> Pair:
    """Decode to encode with a shaft between two handles, twisted and faded in; its right handle is in the wall."""

    def image(t_ns: int, counts: int, output: bytes) -> bytes:
        left, right = struct.unpack("<2xh2xh", output)
        first, second = (0x0637, max(0, counts - TWIST), left), (0x0637, counts, right)
        return by_hand.TWO.pack(t_ns, 100_000, 0, 0, 100_000, 0, 0, *first, *second)

    return pair(
        Cycle(plan("virtual_shaft")), by_hand.shaft(), image, [*range(0, COUNTS, 5), *[COUNTS] * FADE_IN], bytes(8)
    )


def pair(
    cycle: Cycle, loop: by_hand.Loop, image: Callable[[int, int, bytes], bytes], way: list[int], output: bytes
) -> Pair:
    """Return the pair of both loops, first led along this way [counts]; raises SystemExit if their outputs differ.

    `image` makes the feedback of a time [ns] from the counts and the output before. Images are made before the time is
    taken, and each has a time of its own: one that comes again, or a pause between two rounds, is a fault.
    """
    (step, tripped), latches, ways = loop, count(1_000_000, 1_000_000), endless(WAYS)
    around = [way[-1] + each for each in islice(ways, AGREEING)]
    for counts, t_ns in zip([*way, *around], latches, strict=False):  # in this order no time is left out
        feedback = image(t_ns, counts, output)
        output, theirs = bytes(cycle.step(feedback)), bytes(step(feedback))
        if output != theirs:
            raise SystemExit(f"at {t_ns} ns the cycle sends {output.hex()}, the loop by hand {theirs.hex()}")

    def both() -> tuple[float, float]:
        ours, hand = math.inf, math.inf
        for _ in range(BATCHES):
            images = [image(next(latches), way[-1] + next(ways), output) for _ in range(BATCH)]
            ours, hand = min(ours, time_of(cycle.step, images)), min(hand, time_of(step, images))
        assert cycle.trip is None, cycle.trip
        assert not tripped(), tripped()
        return ours, hand

    return both


def time_of(step: Callable[[bytes], bytearray], images: list[bytes]) -> float:
    """Return the time of a period [s], as the mean of these images."""
    begun = perf_counter()
    for image in images:
        step(image)
    return (perf_counter() - begun) / len(images)


FIGURES = (
    Figure("cycle of a wall on one axis", "the same loop and guards by hand", 1.35, wall_pair),
    Figure("cycle of a virtual mass on one axis", "the same loop and guards by hand", 2.2, mass_pair),
    Figure("cycle of two coupled axes", "the same loop and guards by hand", 3.6, coupled_pair),
)


def simulation_row() -> Row:
    """A simulated period, everything included, beside starting Python (10 ms on the machine of reference)."""
    starts = [_python_starts() for _ in range(10)]
    begun = perf_counter()
    run("wall", duration=PERIODS / 1000.0)
    return Row(
        "simulated period, beside 1/1000 of a Python start", (perf_counter() - begun) / PERIODS, min(starts) / 1000
    )


def _python_starts() -> float:
    begun = perf_counter()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    return perf_counter() - begun


if __name__ == "__main__":
    ours, by_hand_too = wall_pair(ExitStack())()
    show([Row("cycle", ours, by_hand_too, FIGURES[0].bound), simulation_row()])
