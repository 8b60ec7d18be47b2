"""How many times real time is a simulated run, with and without its assessment, beside a bare prototype?

The prototype is a wall, a hand and a shaft as one loop by hand: two linear steps, the octets of three frames, and the
force. It has no wire, no object dictionary, no guards and no record. Each figure is that of the fastest periods,
because other programs only ever make a period slower, and runs and prototype take turns. An assessment is added by its
processor time. `python benchmarks/virtual_time.py` ends with 1 when a ratio leaves its bound; `--write` puts the table
into docs/reference/performance.md.
"""

import struct
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from unittest.mock import patch

from rows import Figure, Pair, machine, put_on_page

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.summary import Assessment

FASTEST = 0.02
"""Share of the periods that are the figure."""
ROUNDS, DURATION = 5, 3.0
"""How often each run is repeated, and its duration [s]."""
SIX = 'description = "Six walls"\n' + "".join(
    f'[axis.{name}]\nworkspace = "linear"\n[[element]]\nkind = "wall"\nname = "wall_{name}"\naxis = "{name}"\n'
    "position = 0.02\nstiffness = 300.0\n"
    for name in "abcdef"
)


@dataclass(frozen=True)
class Kind:
    """One kind of run; `bound` is the largest ratio to the prototype that is promised."""

    name: str
    bound: float
    bus: str = "sim"
    six: bool = False
    """At 500 Hz, because the frames of six axes do not fit into 1 ms."""


KINDS = (
    Kind("CANopen", 32.0),
    Kind("Modbus TCP", 44.0, "sim-modbus-tcp"),
    Kind("CANopen, six axes at 500 Hz", 230.0, six=True),
)


def prototype(periods: int) -> float:
    """Return the time of a period of the loop by hand [s]."""
    position, speed, torque, stretch, hand, target = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    feedback, command, times = struct.Struct("<Hih"), struct.Struct("<Hh"), []
    for number in range(periods):
        begun = perf_counter()
        for step in (4e-4, 6e-4):
            friction = -2e-3 if speed > 0.0 else 2e-3
            pull = 300.0 * stretch + 4.0 * (hand - speed)
            position, stretch = position + step * speed, stretch + step * (hand - speed)
            speed += step * (torque + friction + pull - 1e-3 * speed) * 2.0
            hand += step * (6.0 * min(1.0, 2e-3 * number) - pull) * 10.0
            torque += 0.9 * (target - torque)
        octets = (b"", feedback.pack(0x0637, round(position * 1e5), round(max(-32e3, min(32e3, torque * 1e2)))))
        _, counts, _ = feedback.unpack(octets[1])
        here = counts * 1e-5
        force = -600.0 * (here - 0.02) if here > 0.02 else 0.0
        force = max(-50.0, min(50.0, force))
        _, permille = command.unpack(command.pack(0x0F, round(force * 100.0)))
        target = permille * 1e-2
        times.append(perf_counter() - begun)
    return fastest(times)


def fastest(times: list[float]) -> float:
    """Return the time of the fastest periods [s]."""
    return sorted(times)[int(FASTEST * len(times))]


def simulated(kind: Kind) -> tuple[float, float]:
    """Return the time of a period [s], and what its assessment adds."""
    begins, count, finish = list[float](), LoopReport.count, Assessment.finish
    assessing = [0.0]

    def counted(report: LoopReport, *times: int) -> int:
        begins.append(perf_counter())
        return count(report, *times)

    def finished(assessment: Assessment, elapsed: float) -> object:
        begun = process_time()
        try:
            return finish(assessment, elapsed)
        finally:
            assessing[0] = process_time() - begun

    with (
        TemporaryDirectory() as folder,
        patch.object(LoopReport, "count", counted),
        patch.object(Assessment, "finish", finished),
    ):
        scene, rate = "wall", 1000.0
        if kind.six:
            scene, rate = str(Path(folder) / "six.toml"), 500.0
            Path(scene).write_text(SIX, encoding="utf-8")
        run(scene, bus=kind.bus, rate=rate, duration=DURATION, hand="push")
    periods = [after - before for before, after in pairwise(begins)]
    return fastest(periods), assessing[0] / len(begins)


def rows() -> list[tuple[Kind, float, float, float]]:
    """Return (kind, period, assessment, prototype) of each kind of run [s], the least of all rounds."""
    found = []
    for kind in KINDS:
        runs, bare = [], []
        for _ in range(ROUNDS):
            bare.append(prototype(10_000))
            runs.append(simulated(kind))
        found.append((kind, min(each[0] for each in runs), min(each[1] for each in runs), min(bare)))
    return found


def pair(kind: Kind, _: ExitStack) -> Pair:
    """A period of a simulated run, beside one of the prototype."""
    return lambda: (simulated(kind)[0], prototype(10_000))


FIGURES = tuple(
    Figure(f"period in virtual time, {kind.name}", "a bare prototype", kind.bound, partial(pair, kind))
    for kind in KINDS
)


def table(found: list[tuple[Kind, float, float, float]]) -> str:
    """Return the figures as a table."""
    lines = [
        "| run | a period [µs] | times real time | with assessment | prototype [µs] | ratio | at most |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind, period, assessing, bare in found:
        length = 2e-3 if kind.six else 1e-3
        lines.append(
            f"| {kind.name} | {period * 1e6:.0f} | {length / period:.1f} | {length / (period + assessing):.1f} | "
            f"{bare * 1e6:.1f} | {period / bare:.1f} | {kind.bound:g} |"
        )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Measure, print, and judge."""
    found = rows()
    text = f"Measured on {machine()}.\n\n{table(found)}"
    print(text)
    if "--write" in sys.argv:
        put_on_page("virtual_time.py --write", text)
    return 1 if any(period > kind.bound * bare for kind, period, _, bare in found) else 0


if __name__ == "__main__":
    sys.exit(main())
