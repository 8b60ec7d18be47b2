"""Commands that measure a bench with its own drive: `identify` and `certify`.

`identify` finds the values of the bench by two short experiments. `certify` finds the largest stiffness that is seen
well damped on it, and the onset that taps tell.
"""

import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from haptic_fieldbus.cli.options import (
    BENCH,
    BUSES,
    OF_A_RUN,
    OUTPUT,
    RATE,
    RENDERING,
    SIMULATION,
    JsonOption,
    PlotOption,
    ProfilesOption,
    SceneOptions,
    check_plot,
    draw,
    given_by,
    note_bitrate,
    option,
    option_field,
    options_of,
)
from haptic_fieldbus.cli.output import never_wait
from haptic_fieldbus.cli.run import ask, instruct, tell_question
from haptic_fieldbus.cli.screen import plain, show, show_result
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.errors import UsageError, raise_all
from haptic_fieldbus.numerals import OutputRow, exactly, in_unit, lines_of, object_of, rounded, rounded_limit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from haptic_fieldbus.identification import IdentifiedBench


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions:
    """Options of `identify`."""

    rig: Annotated[Path, option("FILE", "Rig file of the bench; gets the measured values.", BENCH)]
    axis: str | None = option_field("NAME", "Axis of the rig.", BENCH, told="the only one")
    bus: str | None = option_field("BUS", f"{BUSES} The rig file is then not changed.", BENCH, told="that of the rig")
    rate: float | None = option_field("HZ", f"Loop rate in Hz. \\[default: {RATE}]", RENDERING)
    travel: float | None = option_field(
        "M", "Travel of the handle in m or rad.", RENDERING, told="that of the rig, or a turn of the motor"
    )
    effort: float | None = option_field("N", "Largest force in N or N·m.", RENDERING, told="25 % of rated torque")
    speed: float | None = option_field("M/S", "Largest speed in m/s or rad/s.", RENDERING, told="four travels a second")
    with_mass: float | None = option_field(
        "KG", "Check the rig by a known mass, fixed to a linear handle since the last run.", RENDERING
    )
    with_inertia: float | None = option_field(
        "KGM2", "The same by a known inertia on a rotary handle, in kg·m².", RENDERING
    )
    skip: list[str] | None = option_field(
        "NAME", "Leave out rest, friction (slow pushes) or dynamics (all that follows); may be repeated.", RENDERING
    )
    dry_run: bool = option_field(None, "Only say what would move.", RENDERING)
    seed: int = option_field("N", "Random seed.", SIMULATION, default=DEFAULT_SEED)
    plot: PlotOption = None
    yes: bool = option_field(None, "Enable a real drive without asking.")
    profiles: ProfilesOption = None
    as_json: JsonOption = False


@options_of(IdentifyOptions)
def identify(options: IdentifyOptions) -> None:
    """Measure inertia, friction, damping and delay of a bench with its own drive, and write them into the rig file."""
    from haptic_fieldbus.api.identification import BenchTask, bounds_of
    from haptic_fieldbus.api.identification import identify as measure_bench
    from haptic_fieldbus.api.provenance import picture_mark

    check_plot(options.plot)
    if options.plot is not None and "dynamics" in (options.skip or ()):
        raise UsageError("--skip dynamics: expected without --plot, which draws them")
    note_bitrate(options.bus)
    task = given_by(options, BenchTask)
    if options.dry_run:
        lines = list(bounds_of(task).lines())
        show_result(lines_of([OutputRow("move", lines)]), lambda: {"move": lines}, as_json=options.as_json)
        return
    if not sys.stdin.isatty():
        never_wait()
    mark = "" if options.plot is None else picture_mark(files=[options.rig])  # of the rig file before it is changed
    found = measure_bench(
        task,
        confirm=tell_question if options.yes else ask,
        instruct=None if options.yes or not sys.stderr.isatty() else instruct,
        announce=lambda told: _announce(told.lines(), options),
        progress=lambda stage: show([("stage", stage)], sys.stderr) if sys.stderr.isatty() else None,
    )
    show_result(lines_of(_rows(found)), found.to_json, as_json=options.as_json)
    if options.plot is not None:
        from haptic_fieldbus.report.analysis_plots import draw_identified

        draw(options.plot, draw_identified(found), mark)
        if not options.as_json:
            show([("plot", str(options.plot))])


def _announce(lines: Iterable[str], options: "IdentifyOptions | CertifyOptions") -> None:
    """Say what will move, beside a JSON object on standard error."""
    talk = sys.stderr if options.as_json else sys.stdout
    show(lines_of([OutputRow("move", lines)]), talk)
    talk.flush()


LABELS = {"inertia": "inertia", "viscous_damping": "damping", "coulomb_friction": "friction", "delay_and_lag": "delay",
          "torque_lag": "lag"}  # fmt: skip
"""Values that people are shown, and their words."""


def _rows(found: "IdentifiedBench") -> "Iterator[OutputRow]":
    """Yield the result as lines."""
    from haptic_fieldbus.identification import further_texts, interval_text

    if (fit := found.fit) is None:
        bounds = found.breakaway.items()
        told = (f"{in_unit(low, 'N·m')} to {in_unit(high, 'N·m')} {way}" for way, (low, high) in bounds)
        yield OutputRow("breakaway", [", ".join(told)])
    else:
        for name, label in LABELS.items():
            each = fit.values[name]
            more = ", with the lag of the torque loop" if name == "delay_and_lag" else ""
            yield OutputRow(label, [f"{interval_text(each)}{more}", *filter(None, [each.reason])])
        if fit.resonance:
            yield OutputRow("resonance", [interval_text(fit.resonance)])
        else:
            yield OutputRow("beside", further_texts(fit))
        left, unused = rounded(fit.residual), rounded(found.check or 0.0)
        yield OutputRow(
            "fit", [f"leaves {left} counts unexplained, {unused} in a part of the motion that it did not use"]
        )
    if found.limit is not None:
        limit, unit, _ = found.limit
        yield OutputRow("limit", [f"{rounded_limit(limit)} {unit} for a wall at {exactly(found.rate)} Hz"])
    if fit is not None:
        yield OutputRow("scale", [found.scale_text])
    yield OutputRow("warning", found.warnings)
    if found.written:
        yield OutputRow("rig", [f"[axis.{found.axis}.identified] written into {found.written}"])


CERTIFIED = ("seen", "onset", "predicted", "bench", "date")
KEPT = ("seed", "yes")
"""Options of `run` that this command has too."""


@dataclass(frozen=True, kw_only=True)
class CertifyOptions(SceneOptions):
    """Options of `certify`."""

    by_hand: bool = option_field(None, "You tap the handle yourself, up to the limit; else the drive does.", RENDERING)
    share: float = option_field("SHARE", "Largest stiffness, as a share of the onset.", RENDERING, default=0.8)
    above: bool = option_field(None, "With --yes, go above the limit without asking; nobody holds.")
    plot: Path | None = option_field(
        "PATH", "Page: .pdf, .png or .svg, with its values beside it as .json.", OUTPUT, "--out", "--plot"
    )


@options_of(CertifyOptions, without=[*(each for each in OF_A_RUN if each not in KEPT), "verbose"])
def certify(options: CertifyOptions) -> None:
    """Raise the stiffness of SCENE in steps and tap it: the largest one that is well damped, and the onset. Measure
    first: `identify`."""
    from haptic_fieldbus.api.certification import CertifyTask
    from haptic_fieldbus.api.certification import certify as raise_stiffness
    from haptic_fieldbus.api.provenance import picture_mark
    from haptic_fieldbus.planning.request import file_faults

    check_plot(options.plot)
    values = None if options.plot is None else options.plot.with_suffix(".json")
    if values is not None and values.exists():
        raise UsageError(f"{values}: exists; move it away")
    raise_all(file_faults("out", values, (".json",)))
    note_bitrate(options.bus)
    if not sys.stdin.isatty():
        never_wait()
    mark = "" if options.plot is None else picture_mark(files=[options.rig] if options.rig else [])
    found = raise_stiffness(
        CertifyTask(options.task(), options.by_hand, options.share, options.seed),
        confirm=tell_question if options.yes else ask,
        above=tell_question if options.above else None if options.yes or not sys.stdin.isatty() else ask,
        instruct=None if options.yes or not sys.stderr.isatty() else instruct,
        announce=lambda told: _announce(told, options),
        progress=lambda stiffness, unit: (
            show([("tapping", in_unit(stiffness, unit))], sys.stderr) if sys.stderr.isatty() else None
        ),
    )
    rows = list(found.rows())
    certificate = object_of(rows, CERTIFIED)
    show_result(lines_of(rows), lambda: certificate, as_json=options.as_json)
    if options.plot is not None and values is not None:
        from haptic_fieldbus.report.plot import draw_certificate

        draw(options.plot, draw_certificate(found), mark)
        try:
            values.write_text(json.dumps(plain(certificate), indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise UsageError(f'out "{values}": {error.strerror}') from error
        if not options.as_json:
            show([("out", f"{options.plot}, {values.name}")])
