"""Command `identify`: the bench measures itself, by two short experiments with its own drive."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from haptic_fieldbus.cli.options import (
    BENCH,
    BUSES,
    RATE,
    RENDERING,
    SIMULATION,
    JsonOption,
    PlotOption,
    ProfilesOption,
    check_plot,
    draw,
    frequency,
    note_assumed_bitrate,
    number,
    option,
    options_of,
)
from haptic_fieldbus.cli.output import never_wait
from haptic_fieldbus.cli.run import ask, instruct, tell_question
from haptic_fieldbus.cli.screen import plain, print_json, show
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.numerals import OutputRow, lines_of, rounded

if TYPE_CHECKING:
    from collections.abc import Iterator

    from haptic_fieldbus.api.identification import BenchTask
    from haptic_fieldbus.identification import Announcement, IdentifiedBench


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions:
    """Options of `identify`."""

    rig: Annotated[Path, option("FILE", "Rig file of the bench; gets the measured values.", BENCH)]
    axis: Annotated[str | None, option("NAME", "Axis of the rig.", BENCH, default="the only one")] = None
    bus: Annotated[
        str | None, option("BUS", f"{BUSES} The rig file is then not changed.", BENCH, default="that of the rig")
    ] = None
    rate: Annotated[
        float | None, option("HZ", f"Loop rate in Hz. \\[default: {RATE}]", RENDERING, parser=frequency)
    ] = None
    travel: Annotated[
        float | None,
        option(
            "M",
            "Travel of the handle in m or rad.",
            RENDERING,
            default="that of the rig, or a turn of the motor",
            parser=number,
        ),
    ] = None
    effort: Annotated[
        float | None,
        option("N", "Largest force in N or N·m.", RENDERING, default="25 % of rated torque", parser=number),
    ] = None
    speed: Annotated[
        float | None,
        option("M/S", "Largest speed in m/s or rad/s.", RENDERING, default="four travels a second", parser=number),
    ] = None
    dry_run: Annotated[bool, option(None, "Only say what would move.", RENDERING, "--dry-run")] = False
    seed: Annotated[int, option("N", "Random seed.", SIMULATION, default=DEFAULT_SEED)] = DEFAULT_SEED
    plot: PlotOption = None
    yes: Annotated[bool, option(None, "Enable a real drive without asking.", None, "--yes")] = False
    profiles: ProfilesOption = None
    as_json: JsonOption = False

    def bench_task(self) -> "BenchTask":
        """Return the request for the API."""
        from haptic_fieldbus.api.identification import BenchTask

        return BenchTask(
            self.rig, axis=self.axis, bus=self.bus, rate=self.rate, travel=self.travel, effort=self.effort,
            speed=self.speed, profiles=self.profiles, seed=self.seed,
        )  # fmt: skip


@options_of(IdentifyOptions)
def identify(options: IdentifyOptions) -> None:
    """Measure inertia, friction, damping and delay of a bench with its own drive, and write them into the rig file."""
    from haptic_fieldbus.api.identification import bounds_of
    from haptic_fieldbus.api.identification import identify as measure_bench
    from haptic_fieldbus.api.provenance import picture_mark

    check_plot(options.plot)
    show(note_assumed_bitrate(options.bus), sys.stderr)
    talk = sys.stderr if options.as_json else sys.stdout

    def announce(told: "Announcement") -> None:
        show([("move" if number == 0 else "", line) for number, line in enumerate(told.lines())], talk)
        talk.flush()

    if options.dry_run:
        announce(bounds_of(options.bench_task()))
        return
    if not sys.stdin.isatty():
        never_wait()
    mark = "" if options.plot is None else picture_mark(files=[options.rig])  # of the rig file before it is changed
    found = measure_bench(
        options.bench_task(),
        confirm=tell_question if options.yes else ask,
        instruct=None if options.yes or not sys.stderr.isatty() else instruct,
        announce=announce,
        progress=lambda stage: show([("stage", stage)], sys.stderr) if sys.stderr.isatty() else None,
    )
    if options.as_json:
        print_json({key: plain(value) for key, value in found.to_json().items()})
    else:
        show(lines_of(_rows(found)))
    sys.stdout.flush()
    if options.plot is not None:
        from haptic_fieldbus.report.analysis_plots import draw_identified

        draw(options.plot, draw_identified(found), mark)
        if not options.as_json:
            show([("plot", str(options.plot))])


LABELS = {
    "inertia": "inertia",
    "viscous_damping": "damping",
    "coulomb_friction": "friction",
    "delay_and_lag": "delay",
    "torque_lag": "lag",
}
"""Values that people are shown, and their words."""


def _rows(found: "IdentifiedBench") -> "Iterator[OutputRow]":
    """Yield the result as lines."""
    from haptic_fieldbus.identification import interval_text

    for name, label in LABELS.items():
        each = found.fit.values[name]
        more = ", with the lag of the torque loop" if name == "delay_and_lag" else ""
        yield OutputRow(label, [f"{interval_text(each)}{more}", *filter(None, [each.reason])])
    left, unused = rounded(found.fit.residual), rounded(found.check)
    yield OutputRow("fit", [f"leaves {left} counts unexplained, {unused} in a part of the motion that it did not use"])
    yield OutputRow("warning", found.warnings)
    if found.written:
        yield OutputRow("rig", [f"[axis.{found.axis}.identified] written into {found.written}"])
