"""Command `response`: the force of a scene for a prescribed motion, without a drive."""

import sys
from dataclasses import dataclass
from typing import Annotated

from haptic_fieldbus.cli.options import RENDERING, SceneOptions, option, options_of
from haptic_fieldbus.cli.pictures import PlotOption, check_plot, draw
from haptic_fieldbus.cli.screen import plain, print_json, show
from haptic_fieldbus.defaults import DEFAULT_AMPLITUDE, DEFAULT_MOTION, DEFAULT_MOTION_DURATION
from haptic_fieldbus.numerals import exactly

MOTION_DURATION = f"{exactly(DEFAULT_MOTION_DURATION)}, or that of the file"


@dataclass(frozen=True, kw_only=True)
class ResponseOptions(SceneOptions):
    """Further options of `response`."""

    input: Annotated[str, option("MOTION", "Of the puck: step, ramp, sine@HZ or FILE.csv.", default=DEFAULT_MOTION)] = (
        DEFAULT_MOTION
    )
    amplitude: Annotated[
        float,
        option(
            "M", "Of the motion; a ramp reaches it after one second, a file is multiplied.", default=DEFAULT_AMPLITUDE
        ),
    ] = DEFAULT_AMPLITUDE
    duration: Annotated[float | None, option("S", "Of the motion.", RENDERING, default=MOTION_DURATION)] = None
    plot: PlotOption = None


@options_of(ResponseOptions)
def response(options: ResponseOptions) -> None:
    """Simulate the open loop: compute the force of SCENE for a prescribed motion of the puck, by any integrator."""
    check_plot(options.plot)
    from haptic_fieldbus import api
    from haptic_fieldbus.api.open_loop import OpenLoop
    from haptic_fieldbus.report.responses import response_lines

    found = api.response.of(options.given(OpenLoop))
    title = f"{options.scene}, {options.input}"
    if options.plot is not None:
        from haptic_fieldbus.report.plot_response import plot_response

        draw(options.plot, lambda path: plot_response(found, title, path))
    if found.diverged:
        show([("diverged", f"a number was no longer finite after {len(found.time)} samples")], sys.stderr)
    if options.as_json:
        print_json({key: plain(value) for key, value in found.to_json().items()})
        return
    show(response_lines(found, f"{title} of {exactly(options.amplitude)}"))
    if options.plot is not None:
        show([("plot", str(options.plot))])
