"""Command `response`: the force of a scene for a prescribed motion, without a drive."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from haptic_fieldbus.cli.options import RENDERING, SceneOptions, number, option, options_of, seconds
from haptic_fieldbus.cli.pictures import PlotOption, check_plot, draw
from haptic_fieldbus.cli.screen import plain, print_json, show
from haptic_fieldbus.defaults import DEFAULT_AMPLITUDE, DEFAULT_MOTION, DEFAULT_MOTION_DURATION
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly, rounded

if TYPE_CHECKING:
    from haptic_fieldbus.api.model import EnvironmentModel
    from haptic_fieldbus.api.open_loop import Response
    from haptic_fieldbus.planning.task import Rendering

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
            "M",
            "Of the motion; a ramp reaches it after one second, a file is multiplied.",
            default=DEFAULT_AMPLITUDE,
            parser=number,
        ),
    ] = DEFAULT_AMPLITUDE
    duration: Annotated[
        float | None, option("S", "Of the motion.", RENDERING, default=MOTION_DURATION, parser=seconds)
    ] = None
    model: Annotated[
        bool,
        option(None, "Tell A, B, C, D, poles and transfer function too; --plot then draws the poles.", None, "--model"),
    ] = False
    plot: PlotOption = None


@options_of(ResponseOptions)
def response(options: ResponseOptions) -> None:
    """Simulate the open loop: compute the force of SCENE for a prescribed motion of the puck, by any integrator."""
    check_plot(options.plot)
    from haptic_fieldbus import api
    from haptic_fieldbus.api.open_loop import OpenLoop
    from haptic_fieldbus.report.responses import response_lines

    asked = options.given(OpenLoop)
    found = api.response.of(asked)
    title = f"{options.scene}, {options.input}"
    model = _model(asked) if options.model else None
    if options.plot is not None:
        _draw(options.plot, found, model, title)
    if found.diverged:
        show([("diverged", f"a number was no longer finite after {len(found.time)} samples")], sys.stderr)
    if found.alias is not None:
        text = f"{options.input} is not below half the rate: its samples are those of {rounded(found.alias)} Hz"
        show([("warning", text)], sys.stderr)
    if options.as_json:
        told = found.to_json() if model is None else {**found.to_json(), "model": model.to_json()}
        print_json({key: plain(value) for key, value in told.items()})
        return
    show(response_lines(found, f"{title} of {exactly(options.amplitude)}"))
    if model is not None:
        from haptic_fieldbus.report.models import model_lines

        show(model_lines(model))
    if options.plot is not None:
        show([("plot", str(options.plot))])


def _model(asked: "Rendering") -> "EnvironmentModel":
    from haptic_fieldbus.api.model import model_of

    return model_of(asked)


def _draw(path: Path, found: "Response", model: "EnvironmentModel | None", title: str) -> None:
    """Draw the poles of the model, or the response when there is no model; raises UsageError for no poles."""
    if model is not None:
        if not model.integrated.order:
            raise UsageError("--plot: no method integrates anything in this scene, so that there are no poles to draw")
        from haptic_fieldbus.report.plot_model import plot_model

        draw(path, lambda file: plot_model(model, title, file))
        return
    from haptic_fieldbus.report.plot_response import plot_response

    draw(path, lambda file: plot_response(found, title, file))
