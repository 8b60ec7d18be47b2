"""How short may a period be on one CAN bus at 1 Mbit/s, beside the sum of its frames at their worst lengths?

Walls on one to six axes run in virtual time on the simulated bus, at a shorter and shorter period, once with the exact
length of each frame and once with each frame at its worst length (most stuff bits). A period is *stable* when in half a
second of operation enabled none is missed, each begins in time, and no two samples in a row are late. (A sign of life
of a drive comes when it likes, and may delay one sample beyond its period.)

`python benchmarks/bus_limit.py --write` writes the table of docs/reference/performance.md. As figures of `bench.py`:
the shortest period that a plan grants beside that at which the frames of the exchange alone take 90 % of the bus, for
one to four axes; infinite where it is not stable.
"""

import math
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from rows import Figure, Pair, put_on_page

import haptic_fieldbus as h
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.protocols.canopen.pdo import INTERFRAME_SPACE_BITS, worst_case_bits
from haptic_fieldbus.protocols.canopen.traffic import LARGEST_BUS_LOAD, CanTraffic
from haptic_fieldbus.sim.canopen import link
from haptic_fieldbus.sim.canopen.link import Frame

AXES = (1, 2, 3, 4, 6)
DRIVE = "generic_cia402"
LEAST, UP_TO = 0.95, 4
"""Share of the rate of 90 % that a plan must grant, and the number of axes up to which."""
DURATION = 0.5
"""[s] of operation enabled."""
STEP = 1e-6
"""To which a period is searched [s]."""


def scene(axes: int) -> str:
    return 'description = "Walls"\n' + "".join(
        f'[axis.{name}]\nworkspace = "linear"\n[[element]]\nkind = "wall"\nname = "wall_{name}"\naxis = "{name}"\n'
        "position = 0.02\nstiffness = 300.0\n"
        for name in "abcdef"[:axes]
    )


def worst_length(frame: Frame) -> int:
    """Return the bits of a frame with the most stuff bits, without the space after it."""
    return worst_case_bits(len(frame.data)) - INTERFRAME_SPACE_BITS


def stable(path: Path, period: float, *, worst: bool) -> bool:
    """Run at this period [s], and tell whether it is stable."""
    period_ns, late, good = round(1e9 * period), [False], [True]
    count = LoopReport.count

    def counted(report: LoopReport, latch_ns: int, length_ns: int, age_ns: int, compute_ns: int, late_ns: int) -> int:
        before, late[0] = late[0], age_ns >= period_ns
        good[0] &= report.missed == 0 and late_ns == 0 and not (before and late[0])
        return count(report, latch_ns, length_ns, age_ns, compute_ns, late_ns)

    with ExitStack() as stack:
        stack.enter_context(patch.object(LoopReport, "count", counted))
        stack.enter_context(patch.object(CanTraffic, "check", lambda traffic, bus: None))
        if worst:
            stack.enter_context(patch.object(link, "wire_bits", worst_length))
        try:
            h.run(path, bus="sim", drive=DRIVE, rate=1.0 / period, duration=DURATION, hand="none")
        except h.HapticFieldbusError:
            return False
    return good[0]


def shortest(path: Path, frames: float, *, worst: bool) -> float:
    """Return the shortest stable period [s], to a microsecond; `frames` is the sum of the worst lengths [s]."""
    least, most = 0.6 * frames, 1.4 * frames + 1e-4
    while most - least > STEP:
        middle = 0.5 * (least + most)
        if stable(path, middle, worst=worst):
            most = middle
        else:
            least = middle
    return most


def traffic_of(path: Path) -> CanTraffic:
    """Return the traffic at the highest rate that a plan grants."""
    (bus,) = h.plan(path, bus="sim", drive=DRIVE, rate=500.0).buses
    traffic = bus.traffic
    assert isinstance(traffic, CanTraffic)
    for _ in range(3):  # signs of life are counted in periods, so their share changes with the rate
        traffic = replace(traffic, rate=traffic.highest_rate)
    return traffic


@contextmanager
def written(axes: int) -> Iterator[Path]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "walls.toml"
        path.write_text(scene(axes), encoding="utf-8")
        yield path


def pair(axes: int, _: ExitStack) -> Pair:
    with written(axes) as path:
        traffic = traffic_of(path)
        granted = 1.0 / traffic.highest_rate
        ours = granted if stable(path, granted, worst=False) else math.inf
    reference = traffic.period_bits / (LARGEST_BUS_LOAD * traffic.bitrate)
    return lambda: (ours, reference)


def name_of(axes: int) -> str:
    return f"{axes} axis" if axes == 1 else f"{axes} axes"


FIGURES = tuple(
    Figure(f"shortest period of {name_of(axes)} at 1 Mbit/s", "90 % of the bus", 1.0 / LEAST, partial(pair, axes))
    for axes in AXES
    if axes <= UP_TO
)


def rows() -> Iterator[str]:
    """Yield the lines of the table."""
    yield (
        "| axes | frames at worst [µs] | 90 % of the bus [Hz] | a plan grants [Hz] | share | stable from, exact "
        "lengths [µs] | worst lengths [µs] | delay at that rate [µs] |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for axes in AXES:
        with written(axes) as path:
            traffic = traffic_of(path)
            frames = traffic.period_bits / traffic.bitrate
            reference, granted = LARGEST_BUS_LOAD / frames, traffic.highest_rate
            exact, worst = (shortest(path, frames, worst=each) for each in (False, True))
            delay = traffic.delay("a").transport
        yield (
            f"| {axes} | {1e6 * frames:.0f} | {reference:.0f} | {granted:.0f} | {100 * granted / reference:.1f} % | "
            f"{1e6 * exact:.0f} | {1e6 * worst:.0f} | {1e6 * delay:.0f} |"
        )


def main() -> None:
    """Measure and print, or write the page."""
    text = "\n".join(rows()) + "\n"
    print(text)
    if "--write" in sys.argv:
        put_on_page("bus_limit.py --write", text)


if __name__ == "__main__":
    main()
