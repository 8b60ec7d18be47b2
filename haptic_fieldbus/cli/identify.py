"""Commands that measure a bench with its own drive: `identify` and `certify`.

`identify` finds the values of the bench by two short experiments. `certify` finds the largest stiffness that is seen
well damped on it, and the onset that taps tell.
"""

import json
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    not_written,
    note_bitrate,
    option,
    option_field,
    options_of,
)
from haptic_fieldbus.cli.output import asks_at_terminal, never_wait
from haptic_fieldbus.cli.run import ask, instruct, tell_question
from haptic_fieldbus.cli.screen import plain, show, show_result
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.errors import UsageError, raise_all
from haptic_fieldbus.numerals import OutputRow, in_unit, lines_of, object_of, rounded, rounded_limit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from haptic_fieldbus.identification import IdentifiedBench
    from haptic_fieldbus.identification.estimates import Estimate


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
    speed: float | None = option_field(
        "M/S", "Largest speed in m/s or rad/s; the motor is switched off at 0.9 of it.", RENDERING,
        told="four travels a second, and 3 counts of the encoder in a period",
    )  # fmt: skip
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
    mark = "" if options.plot is None else picture_mark(files=[options.rig])  # of the rig file before it is changed
    found = measure_bench(
        task, **_dialogue(options), announce=lambda told: _announce(told.lines(), options),
        progress=lambda stage: _show_progress("stage", stage),
    )  # fmt: skip
    show_result(lines_of(_rows(found)), found.to_json, as_json=options.as_json)
    if options.plot is not None:
        from haptic_fieldbus.report.analysis_plots import draw_identified

        draw(options.plot, draw_identified(found), mark, found)
        if not options.as_json:
            show([("plot", str(options.plot))])


def _dialogue(options: "IdentifyOptions | CertifyOptions") -> dict[str, Any]:
    """Return how a person is asked and instructed, as arguments of the API; without one the output never waits."""
    if not asks_at_terminal():
        never_wait()
    is_guided = not options.yes and sys.stderr.isatty()
    return {"confirm": tell_question if options.yes else ask, "instruct": instruct if is_guided else None}


def _announce(lines: Iterable[str], options: "IdentifyOptions | CertifyOptions") -> None:
    """Say what will move, beside a JSON object on standard error."""
    talk = sys.stderr if options.as_json else sys.stdout
    show(lines_of([OutputRow("move", lines)]), talk)
    talk.flush()


def _show_progress(label: str, text: str) -> None:
    if sys.stderr.isatty():
        show([(label, text)], sys.stderr)


WORDS = {"inertia": "inertia", "viscous_damping": "damping", "coulomb_friction": "friction", "delay_and_lag": "delay",
         "torque_lag": "lag", "torque_scale": "torque", "encoder_counts_per_revolution": "counts"}  # fmt: skip
"""Words for values that people are shown."""


def told_value(name: str, value: "Estimate") -> str:
    """Return a measured value with its interval."""
    from haptic_fieldbus.identification import interval_text

    return interval_text(value) + (", with the lag of the torque loop" if name == "delay_and_lag" else "")


def _rows(found: "IdentifiedBench") -> "Iterator[OutputRow]":
    """Yield the result as lines."""
    from haptic_fieldbus.api.identification import KEPT
    from haptic_fieldbus.identification import NOT_CHECKED, further_texts

    if (fit := found.fit) is None:
        bounds = found.breakaway.items()
        told = (f"{in_unit(low, 'N·m')} to {in_unit(high, 'N·m')} {way}" for way, (low, high) in bounds)
        yield OutputRow("breakaway", [", ".join(told)])
    else:
        for name in KEPT:
            each = fit.values[name]
            yield OutputRow(WORDS[name], [told_value(name, each), *filter(None, [each.reason])])
        if fit.resonance:
            yield OutputRow("resonance", [told_value("resonance", fit.resonance)])
        else:
            yield OutputRow("beside", further_texts(fit))
        unused = f"{rounded(found.check or 0.0)} in a part of the motion that it did not use"
        yield OutputRow("fit", [f"leaves {rounded(fit.residual)} counts unexplained, {unused}"])
    if found.limit is not None:
        limit, unit, _ = found.limit
        yield OutputRow("limit", [f"{rounded_limit(limit)} {unit} for a wall at {rounded(found.rate)} Hz"])
    if fit is not None:
        yield OutputRow("scale", [found.scale.text() if found.scale else NOT_CHECKED])
    yield OutputRow("warning", found.warnings)
    if found.written:
        yield OutputRow("rig", [f"[axis.{found.announced.axis}.identified] written into {found.written}"])


CERTIFIED = ("seen", "onset", "predicted", "bench", "date")
OF_BOTH = ("seed", "yes")
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


@options_of(CertifyOptions, without=[*(each for each in OF_A_RUN if each not in OF_BOTH), "verbose"])
def certify(options: CertifyOptions) -> None:
    """Raise the stiffness of SCENE in steps and tap it: the largest one that is well damped, and the onset. Measure
    first: `identify`."""
    from haptic_fieldbus.api.certification import CertifyTask
    from haptic_fieldbus.api.certification import certify as raise_stiffness
    from haptic_fieldbus.api.provenance import picture_mark

    check_plot(options.plot, "out")
    values = None if options.plot is None else options.plot.with_suffix(".json")
    check_new(values)
    note_bitrate(options.bus)
    mark = "" if options.plot is None else picture_mark(files=[options.rig] if options.rig else [])
    in_person = None if options.yes or not asks_at_terminal() else ask
    found = raise_stiffness(
        CertifyTask(options.task(), options.by_hand, options.share, options.seed), **_dialogue(options),
        above=partial(tell_question, answer="Confirmed by --above.") if options.above else in_person,
        announce=lambda told: _announce(told, options),
        progress=lambda stiffness, unit: _show_progress("tapping", in_unit(stiffness, unit)),
    )  # fmt: skip
    rows = list(found.rows())
    certificate = object_of(rows, CERTIFIED)
    show_result(lines_of(rows), lambda: certificate, as_json=options.as_json)
    if options.plot is not None and values is not None:
        from haptic_fieldbus.report.plot import draw_certificate

        draw(options.plot, draw_certificate(found), mark, found)
        write_new(values, json.dumps(plain(certificate), indent=2) + "\n", found)
        if not options.as_json:
            show([("out", f"{options.plot}, {values.name}")])


def check_new(out: Path | None) -> None:
    """Raise UsageError when a file exists or cannot be written; no file is right."""
    from haptic_fieldbus.planning.request import file_faults

    if out is not None and out.exists():
        raise UsageError(f"{out}: exists; move it away")
    raise_all(file_faults("out", out, () if out is None else (out.suffix,)))


def write_new(out: Path, text: str, result: object = None) -> None:
    """Write a file that was checked before; raises HapticFieldbusError, with a `result` that was printed already.

    A part of a file is removed: another command would read it.
    """
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        with suppress(OSError):
            out.unlink()
        raise not_written("out", out, error, result) from error
