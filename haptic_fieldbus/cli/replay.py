"""Command `replay`: summarise, draw, convert, compare and repair a recording."""

from pathlib import Path
from typing import Annotated

import typer

from haptic_fieldbus.cli.options import OUTPUT, JsonOption, PlotOption, check_plot, draw, option
from haptic_fieldbus.cli.screen import show_result
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly

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
    if plot is not None:
        from haptic_fieldbus.api.provenance import picture_mark
        from haptic_fieldbus.api.replaying import shown
        from haptic_fieldbus.report.plot import draw_run

        draw(plot, draw_run(shown(found)), origin.mark if origin else picture_mark(files=[file]))
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
    lines += [("run", f"{origin.scene_name}, {origin.date}, version {origin.version}")] if origin else []
    lines += [("written", str(target)) for target in targets]
    lines += [] if plot is None else [("plot", str(plot))]
    lines += [("compare", str(difference or "all set-points are the same"))] if compare else []
    show_result(lines, lambda: told, as_json=as_json)
    if difference is not None:
        raise typer.Exit(DIFFERENT)
