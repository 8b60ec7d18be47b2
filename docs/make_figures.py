"""Pictures of the pages: `python docs/make_figures.py` draws all, and with names, such as `lecture/step.png`, these.

A picture that a command draws is drawn by that command; the others show parts that no command has by itself. Each file
tells as text what it shows (`report.drawing.content`); a test compares this with what would be drawn today.
"""

import io
import json
import math
import re
import sys
from collections.abc import Callable
from contextlib import chdir, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from haptic_fieldbus import api
from haptic_fieldbus.cli import main
from haptic_fieldbus.numerics import estimators
from haptic_fieldbus.numerics.estimators.tachometer import bind_position
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report.drawing import BLUE, CONTENT, GREY, INK, VERMILION, dress, figure, line, name_lines, save
from haptic_fieldbus.study.measure import loops, work_precision
from haptic_fieldbus.study.measure.bench import bench_of
from haptic_fieldbus.study.measure.loops import loop_growth
from haptic_fieldbus.study.measure.problems import problems, step_counts
from haptic_fieldbus.study.page import sources as sources_page
from haptic_fieldbus.study.page import work_precision as work_precision_page

PROJECT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(PROJECT))
from tests.pictures import differences  # noqa: E402

FOLDER = PROJECT / "docs" / "images"
NUMBER = re.compile(r"[-−+\d.e]+")
COLOURS = 256
"""Colours of a file; more would make it larger, and not better to read."""

COMMANDS = {
    "demo.png": "run wall --drive maxon_epos4 --hand release --duration 3",
    "lecture/step.png": "response sprung_mass --input step --amplitude 0.01",
    "lecture/euler.png": "response sprung_mass --method forward-euler --amplitude 0.01 --duration 10",
    "lecture/slow.png": "response sprung_mass --method trapezoidal --amplitude 0.01 --rate 10 --duration 3",
    "lecture/poles.png": "response sprung_mass --model --rate 20",
    "lecture/free_puck.png": "response free_puck --amplitude 0.01 --duration 2",
    "lecture/wall.png": "run wall --duration 3",
    "lecture/chatter.png": "run wall --set wall.stiffness=20000 --force --hand release --duration 3",
    "lecture/coarse.png": "run wall --rig examples/lecture/coarse_encoder.toml --set wall.stiffness=1000 --duration 3",
    "lecture/region.png": "stability damped_wall",
}
NOISE_RATE, NOISE_TIME = 100.0, 10.0
ESTIMATORS = ("backward-difference", "low-pass:pole=0.97", "moving-average:window=63", "least-squares:window=63")


def noise() -> Figure:
    """Differentiation amplifies noise: y = sin t + 0.1·sin 10t, as the lecture has it, and what filters make of it."""
    period = 1.0 / NOISE_RATE
    times = np.arange(0.0, NOISE_TIME, period)
    signal = np.sin(times) + 0.1 * np.sin(10.0 * times)
    told = ["y = sin t + 0.1 sin 10t; the fast part is noise. Estimators that smooth more are later."]
    drawn = figure(6.0, title="Noise 10 % becomes 100 %", subtitle=told)
    top, bottom = drawn.subplots(2, 1, sharex=True)
    top.plot(times, np.sin(times), color=GREY, linewidth=1.2, label="sin t")
    top.plot(times, signal, color=BLUE, linewidth=1.6, label="y")
    bottom.plot(times, np.cos(times), color=GREY, linewidth=1.2, label="exact, cos t")
    for name in ESTIMATORS:
        found = [estimate(value) for estimate in (estimators.bind(name, period),) for value in signal.tolist()]
        bottom.plot(times[1:], found[1:], **line(name.partition(":")[0], name, marked=False))
    dress(top, "position", "", "y [1]")
    dress(bottom, "its derivative, by estimator", "time [s]", "derivative of y [1/s]")
    for panel in (top, bottom):
        panel.margins(x=0, y=0.15)
    name_lines(drawn)
    return drawn


def tachometer() -> Figure:
    """Position by the trapezoid from a tachometer: slow signals are rounded away, fast ones are missed."""
    drawn = figure(
        4.4, title="Rounding down: 50 mm drift", subtitle=["Position from a tachometer by the trapezoid, at 1 kHz"]
    )
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
    right.plot(frequency, half / np.tan(half), color=BLUE, label="amplitude that is left")
    dress(right, "fast motions", "frequency [Hz]", "share of the amplitude [1]")
    name_lines(drawn)
    return drawn


def cost() -> Figure:
    """Error against cost for the lecture's own problem, as the report draws it."""
    problem, steps = problems()["sprung-mass-step"], step_counts(quick=True)
    costs = work_precision.step_costs(problem, METHODS)
    return work_precision_page.draw([work_precision.measure(problem, each, steps, costs[each]) for each in METHODS])


def along_the_run() -> Figure:
    """Error along the run, as the report draws it."""
    return work_precision_page.draw_growth([loops.free_swing(method, 10**6) for method in METHODS])


def in_the_loop() -> Figure:
    """Growth rates, as the report draws them."""
    bench = bench_of(api.plan("wall"))
    return sources_page.draw_integrator([loop_growth(bench, method, 60) for method in METHODS])


DRAWN: dict[str, Callable[[], Figure]] = {
    "lecture/noise.png": noise,
    "lecture/tachometer.png": tachometer,
    "lecture/cost.png": cost,
    "lecture/growth.png": along_the_run,
    "lecture/loop.png": in_the_loop,
}


PICTURES = (*COMMANDS, *DRAWN)


def draw(name: str, path: Path) -> None:
    """Draw a picture into a file."""
    if name in DRAWN:
        save(DRAWN[name](), path)
        return
    with chdir(PROJECT), redirect_stdout(io.StringIO()):  # commands name files of examples/
        try:
            main([*COMMANDS[name].split(), "--plot", str(path)])
        except SystemExit as stopped:
            if stopped.code:
                raise


def shown(path: Path) -> dict[str, Any]:
    """Return what a picture shows, as its file tells; empty when it does not tell."""
    with Image.open(path) as image:
        found: dict[str, Any] = json.loads(getattr(image, "text", {}).get(CONTENT, "{}"))
        return found


def make(names: tuple[str, ...]) -> None:
    """Draw pictures into the folder of the pages, in files as small as possible.

    A picture is kept if it would show the same texts, and lines that nobody sees to differ: processors round
    differently. Of one of measured times, the times may differ.
    """
    for name in names:
        path, drawing = FOLDER / name, io.BytesIO()
        with TemporaryDirectory() as folder:
            drawn = Path(folder) / path.name
            draw(name, drawn)
            now = shown(drawn)
            drawing.write(drawn.read_bytes())
        if path.exists() and is_alike(shown(path), now):
            continue
        words = PngInfo()
        words.add_text(CONTENT, json.dumps(now), zip=True)
        with Image.open(drawing) as image:
            small = image.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
        small.save(path, optimize=True, pnginfo=words)


def is_measured(content: dict[str, Any]) -> bool:
    """Return whether a picture shows measured times; such a panel tells no range."""
    return any(not panel["range"] for panel in content["panels"])


def without_ticks(content: dict[str, Any]) -> dict[str, Any]:
    """Return what a picture shows, without the numbers at its ticks: measured times move them."""
    return {**content, "texts": [text for text in content.get("texts", []) if not NUMBER.fullmatch(text)]}


def is_alike(then: dict[str, Any], now: dict[str, Any]) -> bool:
    """Return whether a file that shows `then` may stay where `now` would be drawn."""
    if is_measured(now):
        then, now = without_ticks(then), without_ticks(now)
    return then.get("texts") == now["texts"] and not differences(then, now)


if __name__ == "__main__":
    make(tuple(sys.argv[1:]) or PICTURES)
