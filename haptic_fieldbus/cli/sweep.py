"""Command `sweep`: many points of a scene, judged or run, into a folder."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.cli.options import (
    OF_A_VIEW,
    OUTPUT,
    RENDERING,
    SceneOptions,
    check_plot,
    draw,
    option_field,
    options_of,
)
from haptic_fieldbus.cli.screen import moving_bar, show_result
from haptic_fieldbus.defaults import DEFAULT_ENGINE, DEFAULT_STEPS, DEFAULT_SWEEP
from haptic_fieldbus.errors import UsageError, raise_all
from haptic_fieldbus.numerals import percent, rounded

if TYPE_CHECKING:
    from haptic_fieldbus.api.sweep_folder import Sweep
    from haptic_fieldbus.scenes.catalogue import Setting

POINTS = "Points"
TOLD = ("points", "computed", "wall_s", "loop_steps_per_s", "stable_fraction", "outcomes")
"""Figures of a sweep that are keys of `--json` too."""


@dataclass(frozen=True, kw_only=True)
class SweepOptions(SceneOptions):
    """Further options of `sweep`."""

    grid: list[str] | None = option_field(
        "NAME=LO:HI:N[:log]",
        "Values of a parameter, or NAME=V1,V2; every product of all is a point. Names are ELEMENT.PARAMETER, "
        "rig.AXIS.KEY, rate, method and estimator; with the engine full also hand, seed, duration and fade_in.",
        POINTS,
    )
    sample: int | None = option_field(
        "N", "Draw N points between NAME=LO:HI[:log] instead, as a Latin hypercube.", POINTS
    )
    engine: str = option_field(
        "NAME",
        "verdict judges the loop, loop simulates it in sustained contact, full runs it.",
        RENDERING,
        default=DEFAULT_ENGINE,
    )
    steps: int = option_field("N", "Periods of each loop of the engine loop.", RENDERING, default=DEFAULT_STEPS)
    out: Path = option_field(
        "FOLDER", "Folder of the rows; a sweep that was ended goes on.", OUTPUT, default=Path(DEFAULT_SWEEP)
    )
    scheduler: str | None = option_field(
        "ADDRESS", "Dask scheduler whose workers do the work, such as tcp://host:8786.", POINTS
    )
    workers: int | None = option_field("N", "Number of processes.", POINTS, told="one a processor")
    force: bool = option_field(None, "Run points above the limit too (engine full).", RENDERING)


LEFT_OUT = ("change", "faults", "prove", "record", "yes", "anonymous", "verbose", *OF_A_VIEW)
"""Options of `run` that a sweep has not."""


@options_of(SweepOptions, without=LEFT_OUT)
def sweep(options: SweepOptions) -> None:
    """Judge or run SCENE at many points and keep a row for each. For one point use `stability` or `run`.

    The same command goes on with a folder whose rows are not complete. Refusals and trips are rows.
    """
    check_plot(options.plot)
    given = parse_grid(options.grid or [], options.sample)
    from haptic_fieldbus.api import Trial
    from haptic_fieldbus.api.provenance import picture_mark
    from haptic_fieldbus.api.sweep_folder import SweepPoints
    from haptic_fieldbus.api.sweeping import SweepRequest, sweep_task

    task, trial, asked = options.task(), options.given(Trial), options.given(SweepRequest)
    asked.check()
    try:
        points = SweepPoints.of(given, options.sample, options.seed)
    except TypeError as error:  # a text where a number belongs
        raise UsageError(str(error).replace("points: ", "--grid ")) from None
    if options.plot is not None and not points.varied_numbers:
        raise UsageError("--plot: nothing to draw: no parameter with numbers is varied")
    with moving_bar("{task.completed} of {task.total} points") as update:
        asked = replace(asked, progress=lambda done, total: update(completed=done, total=total))
        found = sweep_task(task, trial, points, asked)
    if options.plot is not None:
        draw(options.plot, found.plot(), picture_mark(task))
    told = {name: getattr(found, name) for name in TOLD} | {"out": found.path}
    show_result(_lines(found), lambda: told, as_json=options.as_json, plot=options.plot)


def _lines(found: "Sweep") -> Iterator[tuple[str, str]]:
    """Yield the lines about points, their outcomes with the first line of the first message of each, and rows."""
    there = found.points - found.computed
    before = f", {there} of them before" if there else ""
    speed = f", {rounded(found.loop_steps_per_s / 1e6)} million steps a second" if found.loop_steps_per_s else ""
    yield "points", f"{found.points}{before}, in {rounded(found.wall_s or 0.0)} s{speed}"
    for name in (name for name, count in found.outcomes.items() if name != "done" and count):
        rows = (row for table in found.tables(("outcome", "message")) for row in table.to_pylist())
        first, *_ = str(next(row["message"] for row in rows if row["outcome"] == name)).split("\n", 1)
        yield name, f"{found.outcomes[name]}; first: {first}"
    if (share := found.stable_fraction) is not None:
        good = "untripped" if found.engine == "full" else "stable"
        cycles = f", {percent(found.limit_cycle_fraction)} with a limit cycle" if found.limit_cycle_fraction else ""
        yield good, f"{percent(share)} of the points that were not refused{cycles}"
    yield "rows", str(found.path)


def parse_grid(texts: Sequence[str], sample: int | None) -> dict[str, Any]:
    """Return the values of each parameter, or with a sample its range; raises one UsageError for all faults."""
    if not texts:
        raise UsageError("no points: expected --grid NAME=LO:HI:N, such as --grid wall.stiffness=100:3000:50")
    from haptic_fieldbus.planning.request import parse_pairs

    points, faults = dict[str, Any](), list[str]()
    expected = "NAME=LO:HI:N, NAME=LO:HI:N:log or NAME=V1,V2" if sample is None else "NAME=LO:HI, or NAME=LO:HI:log"
    for name, text in parse_pairs(texts, "--grid", expected).items():
        try:
            points[name] = _values(text, drawn=sample is not None)
        except ValueError:
            faults.append(f'--grid "{name}={text}": expected {expected}')
    raise_all(faults)
    return points


def _values(text: str, *, drawn: bool) -> "list[Setting]":
    """Return the values of LO:HI:N or LO:HI:N:log, or those between commas; raises ValueError.

    Of values that are `drawn`, LO:HI or LO:HI:log, it is the range.
    """
    from haptic_fieldbus.planning.selection import plain_value

    if ":" not in text and not drawn:
        return [plain_value(part.strip()) for part in text.split(",")]
    low, high, *words = text.split(":")
    number, *how = ("1", *words) if drawn else words
    count, ends = int(number), (float(low), float(high))
    from numpy import geomspace, linspace

    from haptic_fieldbus.api.sweep_folder import LONGEST_LIST

    known = how in ([], ["log"]) and all(map(isfinite, ends)) and 0 < count <= LONGEST_LIST
    if not known or (how and not drawn and min(ends) <= 0.0):
        raise ValueError
    if drawn:
        return [plain_value(low.strip()), plain_value(high.strip()), *how]
    values: list[Setting] = (geomspace if how else linspace)(*ends, count).tolist()
    return values
