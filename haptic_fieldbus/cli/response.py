"""`response`: what a scene answers to a prescribed motion, without a drive."""

import sys
from typing import Annotated

import typer

from haptic_fieldbus.cli.options import EstimatorOption, JsonOption, MethodOption, RateOption, SceneArgument, SetOption
from haptic_fieldbus.cli.pictures import PlotOption, check_plot, draw
from haptic_fieldbus.cli.screen import plain, print_json, show


def response(
    scene: SceneArgument,
    motion: Annotated[
        str, typer.Option("--input", metavar="MOTION", help="Of the puck: step, ramp, sine@HZ or FILE.csv.")
    ] = "step",
    amplitude: Annotated[
        float,
        typer.Option(metavar="M", help="Of the motion; a ramp reaches it after one second, a file is multiplied."),
    ] = 1.0,
    rate: RateOption = 1000.0,
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help=r"\[default: 1, or that of the file]", rich_help_panel="Rendering"),
    ] = None,
    settings: SetOption = None,
    method: MethodOption = None,
    estimator: EstimatorOption = None,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate the open loop: the force of SCENE for a prescribed motion of the puck, by any method."""
    check_plot(plot)
    from haptic_fieldbus import api
    from haptic_fieldbus.report.responses import responses
    from haptic_fieldbus.request import parse_settings

    found = api.response(
        scene,
        input=motion,
        amplitude=amplitude,
        method=method,
        estimator=estimator,
        rate=rate,
        duration=duration,
        settings=parse_settings(settings or []),
    )
    if plot is not None:
        from haptic_fieldbus.report.plot_response import plot_response

        draw(plot, lambda path: plot_response(found, f"{scene}, {motion}", path))
    if found.diverged:
        show([("diverged", f"a number was no longer finite after {len(found.time)} samples")], sys.stderr)
    if as_json:
        print_json({key: plain(value) for key, value in found.to_json().items()})
        return
    show(responses(found, f"{scene}, {motion} of {amplitude:g}"))
    if plot is not None:
        show([("plot", str(plot))])
