"""Command `twin`: the bench of a recorded run as a simulation, and what changed since."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.identify import WORDS, check_new, told_value, write_new
from haptic_fieldbus.cli.options import (
    BENCH,
    HANDS,
    OUTPUT,
    JsonOption,
    PlotOption,
    ProfilesOption,
    check_plot,
    draw,
    option,
    seconds,
)
from haptic_fieldbus.cli.screen import show_result
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import OutputRow, exactly, lines_of, rounded

if TYPE_CHECKING:
    from collections.abc import Iterator

    from haptic_fieldbus.api.twin import BenchTwin

# Command `replay`: summarise, draw, convert, compare and repair a recording.


DIFFERENT = 1
"""Exit status when a set-point of today differs from the recorded one."""


FORMATS = ("csv", "mcap", "parquet")
"""Formats of rows, by the suffixes of their files."""


def row_format(text: str) -> str:
    """Return the format of an option; raises BadParameter, which names all formats."""
    if text not in FORMATS:
        raise typer.BadParameter(f'"{text}"; expected {", ".join(FORMATS)}')
    return text


def replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Rows (.csv, .mcap, .parquet) or frames (.log, .blf).")],
    to: Annotated[
        str | None, option("FORMAT", "Write rows as csv, mcap or parquet beside FILE.", OUTPUT, parser=row_format)
    ] = None,
    compare: Annotated[
        bool, option(None, "Compute the set-points anew from the recorded feedback.", None, "--compare")
    ] = False,
    repair: Annotated[
        bool, option(None, "Write an MCAP file that was cut off anew, with its index, beside FILE.", None, "--repair")
    ] = False,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Summarise a recording; draw, convert, compare or repair it. To simulate its run again: `run --from`.

    With --compare, the recorded feedback goes through today's cycle. The exit status is 1 when a set-point differs.
    """
    from haptic_fieldbus.recordings.reading import read_recording

    check_plot(plot)
    if repair and file.suffix != ".mcap":
        raise UsageError("--repair: only an MCAP file has an index")
    found = read_recording(file)
    targets = [file.with_suffix(f".{to}")] if to else []
    targets += [file.with_name(f"{file.stem}.repaired.mcap")] if repair else []
    if taken := [str(target) for target in targets if target.exists()]:
        raise UsageError(f"{', '.join(taken)}: exists; move it away")
    for target in targets:
        found.write(target)
    difference, origin, kind = None, found.provenance, "rows" if found.rows else "frames"
    if compare:
        from haptic_fieldbus.api.replaying import compare_recording

        difference = compare_recording(found)
    warnings: tuple[str, ...] = ()
    if plot is not None:
        from haptic_fieldbus.api.provenance import picture_mark
        from haptic_fieldbus.api.replaying import shown
        from haptic_fieldbus.report.plot import draw_run

        result = shown(found)
        warnings = result.warnings
        draw(plot, draw_run(result), origin.mark if origin else picture_mark(files=[file]))
    duration = float(found.time[-1]) if len(found) else 0.0
    told = {
        "recording": file, "kind": kind, "count": len(found), "duration_s": duration, "complete": found.complete,
        "columns": {name: found.units.get(name) for name in found.columns},
        "scene": origin.scene_name if origin else None, "date": origin.date if origin else None,
        "version": origin.version if origin else None, "written": targets,
        "first_difference": difference,
    }  # fmt: skip
    lines = [("recording", f"{len(found)} {kind}, {exactly(round(duration, 6))} s")]
    lines += [] if found.complete else [("", "cut off: read up to the last whole part")]
    rehearsed = ", rehearsed: the drives were simulated" if origin and origin.rehearsed else ""
    lines += [("run", f"{origin.scene_name}, {origin.date}, version {origin.version}{rehearsed}")] if origin else []
    lines += [("written", str(target)) for target in targets]
    lines += [] if plot is None else [("plot", str(plot)), *(("warning", each) for each in warnings)]
    lines += [("compare", str(difference or "all set-points are the same"))] if compare else []
    show_result(lines, lambda: told, as_json=as_json)
    if difference is not None:
        raise typer.Exit(DIFFERENT)


def twin(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="Rows of an ordinary run (.csv, .mcap, .parquet).")
    ],
    rig: Annotated[Path, option("FILE", "Rig file of the bench; with --check, its twin.", BENCH)],
    axis: Annotated[str | None, option("NAME", "Axis of the rig.", BENCH, default="the only one")] = None,
    hand: Annotated[str | None, option("NAME", HANDS, BENCH, default="that of a simulated run")] = None,
    free: Annotated[
        list[str] | None,
        option("FROM:TO", "Time in s from the first row in which nobody held the handle, may be repeated.", BENCH),
    ] = None,
    out: Annotated[Path | None, option("FILE", "Write the twin, a rig file.", OUTPUT)] = None,
    check: Annotated[bool, option(None, "Say what changed since the twin was made.", OUTPUT, "--check")] = False,
    profiles: ProfilesOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fit the bench of a recorded run as a simulation, for `run --bus sim`, or say what changed on it.

    With --check, the exit status is 1 when a value changed.
    """
    from haptic_fieldbus.api.twin import KEPT
    from haptic_fieldbus.api.twin import twin as fit_twin

    check_new(out)
    times = [_times(each) for each in free or ()]
    found = fit_twin(recording, rig, axis=axis, hand=hand, free=times, profiles=profiles)
    if check and not found.compared:
        raise UsageError(f"{rig}: no twin, since it has no [axis.{found.axis}.identified]")
    if out is not None:
        if all(found.fit.values[name].reason for name in KEPT):
            raise UsageError(f"{out}: not written, since {recording} tells no value; without --out, each says why")
        write_new(out, found.text)
    rows = [*_rows(found, check), OutputRow("written", [] if out is None else [str(out)])]
    show_result(lines_of(rows), found.to_json, as_json=as_json)
    if check and found.changed:
        raise typer.Exit(DIFFERENT)


def _times(text: str) -> tuple[float, float]:
    """Return begin and end of a time [s]."""
    first, colon, last = text.partition(":")
    times = (seconds(first or "0"), seconds(last)) if colon else (0.0, 0.0)
    if not 0.0 <= times[0] < times[1]:
        raise UsageError(f'--free "{text}": expected FROM:TO, such as 12:18.5')
    return times


def _rows(found: "BenchTwin", check: bool) -> "Iterator[OutputRow]":
    """Yield the result as lines."""
    from haptic_fieldbus.api.twin import KEPT

    fit = found.fit
    for name in KEPT:
        each = fit.values[name]
        yield OutputRow(WORDS[name], [f"not told: {each.reason}" if each.reason else told_value(name, each)])
    for name, label in (("torque_scale", "torque"), ("count_scale", "counts")):
        scale = fit.values[name]
        if scale.reason:
            yield OutputRow(label, [f"not told: {scale.reason}; the values hold for that of the rig"])
        elif scale.value != 1.0:
            yield OutputRow(label, [f"{rounded(scale.value)} times those of the rig"])
    unused = "" if fit.predicted is None else f", {rounded(fit.predicted)} in a part that it did not use"
    left = f"leaves {rounded(fit.residual)} counts unexplained{unused}"
    yield OutputRow("fit", [f"{rounded(fit.seconds)} s of motion, hand {found.hand}; {left}"])
    yield OutputRow("warning", found.warnings)
    if check:
        told = [f"{WORDS[each.name]} {each.text}" for each in found.changed]
        yield OutputRow("changed", told or ["nothing that this recording tells"])
        if found.unknown:
            yield OutputRow("unknown", [", ".join(WORDS[name] for name in found.unknown)])
