"""Command `estimate`: a velocity estimator, a filter or an integration on a recorded signal."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import typer

from haptic_fieldbus.cli.options import JsonOption, number, option, options_of
from haptic_fieldbus.cli.pictures import PlotOption, check_plot, draw
from haptic_fieldbus.cli.screen import plain, print_json, show


@dataclass(frozen=True, kw_only=True)
class EstimateOptions:
    """Options of `estimate`."""

    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="CSV with the columns time and position, or time and velocity; SI.")
    ]
    estimator: Annotated[
        str | None,
        option(
            "NAME",
            "Velocity estimator, with its parameters; of velocities it is a filter, and trapezoidal integrates them. "
            r"\[default: backward-difference of positions, trapezoidal of velocities]",
        ),
    ] = None
    resolution: Annotated[
        float | None,
        option("STEP", r"One step of the signal. \[default: the least difference of two values]", parser=number),
    ] = None
    plot: PlotOption = None
    as_json: JsonOption = False


@options_of(EstimateOptions)
def estimate(options: EstimateOptions) -> None:
    """Estimate velocity or position from the signal in FILE, and tell noise, delay and drift of the estimator."""
    check_plot(options.plot)
    from haptic_fieldbus.api.estimation import SignalRequest, estimate_from
    from haptic_fieldbus.report.estimates import estimate_lines

    names = (field.name for field in fields(SignalRequest))
    found = estimate_from(SignalRequest(**{name: getattr(options, name) for name in names}))
    if options.plot is not None:
        from haptic_fieldbus.report.plot_estimate import plot_estimate

        draw(options.plot, lambda path: plot_estimate(found, options.file.name, path))
    if options.as_json:
        print_json({key: plain(value) for key, value in found.to_json().items()})
        return
    show(estimate_lines(found, options.file.name))
    if options.plot is not None:
        show([("plot", str(options.plot))])
