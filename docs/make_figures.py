"""The figures of docs/explanation/lecture.md: `python docs/make_figures.py`.

Those that a command draws are drawn by that command; the others show parts that no command has by itself.
"""

import math
from collections.abc import Callable
from os import chdir
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from haptic_fieldbus import api
from haptic_fieldbus.cli import main
from haptic_fieldbus.numerics import estimators
from haptic_fieldbus.numerics.estimators.tachometer import bind_position
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report.drawing import (
    BLUE,
    GREY,
    INK,
    VERMILION,
    dress,
    figure,
    line,
)
from haptic_fieldbus.study.measure import loops, work_precision
from haptic_fieldbus.study.measure.bench import bench_of
from haptic_fieldbus.study.measure.loops import loop_growth
from haptic_fieldbus.study.measure.problems import problems, step_counts
from haptic_fieldbus.study.page import growth as growth_page
from haptic_fieldbus.study.page import integrator as integrator_page
from haptic_fieldbus.study.page import work_precision as work_precision_page

PROJECT = Path(__file__).resolve().parents[1]
FOLDER = PROJECT / "docs" / "images" / "lecture"
DPI = 80

COMMANDS = {
    "step.png": "response sprung_mass --input step --amplitude 0.01",
    "euler.png": "response sprung_mass --method forward-euler --amplitude 0.01 --duration 10",
    "slow.png": "response sprung_mass --method trapezoidal --amplitude 0.01 --rate 10 --duration 3",
    "poles.png": "response sprung_mass --model --rate 20",
    "free_puck.png": "response free_puck --amplitude 0.01 --duration 2",
    "wall.png": "run wall --duration 3",
    "chatter.png": "run wall --set wall.stiffness=20000 --force --hand release --duration 3",
    "coarse.png": "run wall --rig examples/lecture/coarse_encoder.toml --set wall.stiffness=1000 --duration 3",
    "region.png": "stability damped_wall",
}
NOISE_RATE, NOISE_TIME = 100.0, 10.0
ESTIMATORS = ("backward-difference", "low-pass:pole=0.97", "moving-average:window=63", "least-squares:window=63")


def noise() -> Figure:
    """Differentiation amplifies noise: y = sin t + 0.1·sin 10t, as the lecture has it, and what filters make of it."""
    period = 1.0 / NOISE_RATE
    times = np.arange(0.0, NOISE_TIME, period)
    signal = np.sin(times) + 0.1 * np.sin(10.0 * times)
    drawn = figure(5.2)
    top, bottom = drawn.subplots(2, 1, sharex=True)
    top.plot(times, np.sin(times), color=GREY, linewidth=1.2, label="sin t")
    top.plot(times, signal, color=BLUE, linewidth=1.6, label="y = sin t + 0.1 sin 10t")
    bottom.plot(times, np.cos(times), color=GREY, linewidth=1.2, label="cos t, what is wanted")
    for name in ESTIMATORS:
        found = [estimate(value) for estimate in (estimators.bind(name, period),) for value in signal.tolist()]
        bottom.plot(times[1:], found[1:], **line(name.partition(":")[0], name, marked=False))
    top.set_ylim(-1.4, 1.9)
    bottom.set_ylim(-2.4, 3.6)
    dress(top, "10 % of noise in the position …", "", "y [1]")
    dress(bottom, "… is 100 % of noise in its derivative", "time [s]", "ẏ [1/s]")
    for panel in (top, bottom):
        panel.legend(loc="upper right", frameon=False, fontsize=9, ncols=3)
        panel.margins(x=0)
    return drawn


def tachometer() -> Figure:
    """Position by the trapezoid from a tachometer: slow signals are rounded away, fast ones are missed."""
    drawn = figure(3.6)
    left, right = drawn.subplots(1, 2)
    period, step = 1e-3, 0.01
    times = np.arange(0.0, 10.0, period)
    slow = 0.02 * np.sin(times)
    for rounding, colour, name in ((np.floor, VERMILION, "rounded down"), (np.round, BLUE, "rounded to the nearest")):
        integrate = bind_position(period)
        left.plot(
            times, [1e3 * integrate(v) for v in (step * rounding(slow / step)).tolist()], color=colour, label=name
        )
    left.plot(times, 20.0 * (1.0 - np.cos(times)), color=INK, linewidth=1.0, linestyle="--", label="true position")
    dress(left, "a slow motion, velocity in steps of 10 mm/s", "time [s]", "position [mm]")
    frequency = np.linspace(1.0, 500.0, 400)
    half = math.pi * frequency * period
    right.plot(frequency, half / np.tan(half), color=BLUE, label="amplitude kept, at 1 kHz")
    dress(right, "fast motions", "frequency [Hz]", "share of the amplitude [1]")
    for panel in (left, right):
        panel.legend(frameon=False, fontsize=9)
    return drawn


def cost() -> Figure:
    """Error against cost for the lecture's own problem, as the report draws it."""
    problem, steps = problems()["sprung-mass-step"], step_counts(quick=True)
    costs = work_precision.step_costs(problem, METHODS)
    return work_precision_page.draw([work_precision.measure(problem, each, steps, costs[each]) for each in METHODS])


def along_the_run() -> Figure:
    """Error along the run, as the report draws it."""
    return growth_page.draw([loops.free_swing(method, 10**6) for method in METHODS])


def in_the_loop() -> Figure:
    """Growth rates, as the report draws them."""
    bench = bench_of(api.plan("wall"))
    return integrator_page.draw([loop_growth(bench, method, 60) for method in METHODS])


DRAWN: dict[str, Callable[[], Figure]] = {
    "noise.png": noise,
    "tachometer.png": tachometer,
    "cost.png": cost,
    "growth.png": along_the_run,
    "loop.png": in_the_loop,
}


def make() -> None:
    """All of them."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    chdir(PROJECT)  # commands name files of examples/
    for name, words in COMMANDS.items():
        try:
            main([*words.split(), "--plot", str(FOLDER / name)])
        except SystemExit as stopped:
            if stopped.code:
                raise
    for name, draw in DRAWN.items():
        draw().savefig(FOLDER / name, dpi=DPI)


if __name__ == "__main__":
    make()
