"""Commands that need no drive: `plan`, `stability`, `response`, `estimate`."""

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import (
    OF_A_BENCH,
    OF_A_RUN,
    RENDERING,
    JsonOption,
    PlotOption,
    SceneOptions,
    check_plot,
    draw,
    given_by,
    note_bitrate,
    option_field,
    options_of,
)
from haptic_fieldbus.cli.screen import print_json, show, show_result
from haptic_fieldbus.defaults import DEFAULT_AMPLITUDE, DEFAULT_MOTION, DEFAULT_MOTION_DURATION, DEFAULT_RATE
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import KEY_WIDTH, exactly, rounded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from haptic_fieldbus.api.model import EnvironmentModel
    from haptic_fieldbus.api.open_loop import Response


# Command `stability`: the stability limits of a scene, computed before anything moves.

DEVICE_PANEL = "Device instead of a bench (SI, in the workspace of the scene; omitted values are 0)"


@dataclass(frozen=True, kw_only=True)
class StabilityOptions(SceneOptions):
    """Further options of `stability`."""

    mass: float | None = option_field("KG", "Mass or inertia.", DEVICE_PANEL)
    damping: float | None = option_field("N·S/M", "Viscous damping.", DEVICE_PANEL)
    coulomb: float | None = option_field("N", "Coulomb friction.", DEVICE_PANEL)
    resolution: float | None = option_field("M", "One encoder count.", DEVICE_PANEL)
    delay: float | None = option_field(
        "S", "Delay from sampling until the torque acts, without the hold.", DEVICE_PANEL
    )


@options_of(StabilityOptions, without=(*OF_A_RUN, "verbose"))
def stability(options: StabilityOptions) -> None:
    """Compute the stability limits of SCENE. Nothing moves. `report` tests the methods behind it."""
    from haptic_fieldbus.api.provenance import picture_mark
    from haptic_fieldbus.api.stability_limits import Device, judge_scene
    from haptic_fieldbus.report.analysis_texts import notes, stability_json, stability_lines

    task, device = options.task(), options.given(Device)
    check_plot(options.plot)
    note_bitrate(options.bus)
    judgement = judge_scene(task, device)
    if options.plot is not None:
        from haptic_fieldbus.report.analysis_plots import draw_region

        draw(options.plot, draw_region(judgement), picture_mark(task))
    show(notes(judgement), sys.stderr)
    told = partial(stability_json, judgement)
    show_result(stability_lines(judgement), told, as_json=options.as_json, plot=options.plot)


# Command `response`: the force of a scene for a prescribed motion, without a drive.

MOTION_DURATION = f"{exactly(DEFAULT_MOTION_DURATION)}, or the duration of the file"


@dataclass(frozen=True, kw_only=True)
class ResponseOptions(SceneOptions):
    """Further options of `response`."""

    input: str = option_field(
        "MOTION", "Motion of the handle: step, ramp, sine@HZ or FILE.csv.", default=DEFAULT_MOTION
    )
    amplitude: float = option_field(
        "M",
        "Amplitude of the motion: end value of a ramp after one second, factor for a file.",
        default=DEFAULT_AMPLITUDE,
    )
    rate: float | None = option_field("HZ", "Rate of the samples.", RENDERING, told=exactly(DEFAULT_RATE))
    duration: float | None = option_field("S", "Duration of the motion.", RENDERING, told=MOTION_DURATION)
    model: bool = option_field(None, "Print A, B, C, D, poles and transfer function too; --plot then draws the poles.")


@options_of(ResponseOptions, without=(*OF_A_BENCH, "verbose", *set(OF_A_RUN).difference(["duration"])))
def response(options: ResponseOptions) -> None:
    """Compute the force of SCENE for a given motion, without a drive. For the closed loop use `run`."""
    check_plot(options.plot)
    from haptic_fieldbus.api.open_loop import OpenLoop, open_loop
    from haptic_fieldbus.api.provenance import picture_mark
    from haptic_fieldbus.report.analysis_texts import model_lines, response_lines

    task = options.task()
    found = open_loop(task, options.given(OpenLoop))
    title = f"{options.scene}, {options.input}"
    model = None
    if options.model:
        from haptic_fieldbus.api.model import model_of

        model = model_of(task)
    if options.plot is not None:
        draw(options.plot, _figure(found, model, title), picture_mark(task))
    if found.diverged:
        show([("diverged", f"not finite after {len(found.time)} samples")], sys.stderr)
    if found.alias is not None:
        text = f"{options.input} is not below half the rate: its samples show {rounded(found.alias)} Hz"
        show([("warning", text)], sys.stderr)
    lines = response_lines(found, f"{title} of {exactly(options.amplitude)}") + (model_lines(model) if model else [])
    beside = {"model": model.to_json()} if model else {}
    show_result(lines, lambda: {**found.to_json(), **beside}, as_json=options.as_json, plot=options.plot)


def _figure(found: "Response", model: "EnvironmentModel | None", title: str) -> "Figure":
    """Return the poles of the model, or the response when there is no model; raises UsageError for no poles."""
    if model is not None:
        if not model.integrated.order:
            raise UsageError("--plot: this scene has no virtual states, so there are no poles to draw")
        from haptic_fieldbus.report.analysis_plots import draw_model

        return draw_model(model, title)
    from haptic_fieldbus.report.analysis_plots import draw_response

    return draw_response(found, title)


# Command `estimate`: a velocity estimator, a filter or an integration on a recorded signal.


@dataclass(frozen=True, kw_only=True)
class EstimateOptions:
    """Options of `estimate`."""

    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="CSV with the columns time and position, or time and velocity; SI.")
    ]
    estimator: str | None = option_field(
        "NAME",
        "Velocity estimator with its parameters. For a file of velocities: a filter, or trapezoidal to integrate. "
        "\\[default: backward-difference for positions, trapezoidal for velocities]",
    )
    resolution: float | None = option_field(
        "STEP", "One step of the signal. \\[default: the smallest difference of two values]"
    )
    plot: PlotOption = None
    as_json: JsonOption = False


@options_of(EstimateOptions)
def estimate(options: EstimateOptions) -> None:
    """Apply a velocity estimator to a signal in FILE. To use one in a loop: `run --estimator`."""
    check_plot(options.plot)
    from haptic_fieldbus.api.estimation import SignalRequest, estimate_from
    from haptic_fieldbus.api.provenance import picture_mark
    from haptic_fieldbus.report.analysis_texts import estimate_lines

    mark = "" if options.plot is None else picture_mark(files=[options.file])
    found = estimate_from(given_by(options, SignalRequest))
    if options.plot is not None:
        from haptic_fieldbus.report.analysis_plots import draw_estimate

        draw(options.plot, draw_estimate(found, options.file.name), mark)
    lines = estimate_lines(found, options.file.name)
    show_result(lines, found.to_json, as_json=options.as_json, plot=options.plot)


# Command `plan`: compile a scene for a bench and explain the plan; no bus is opened.


@dataclass(frozen=True, kw_only=True)
class PlanOptions(SceneOptions):
    """Further options of `plan`."""

    verbose: bool = option_field(
        None, "Print the verdict, the nominal limits and the worst case too.", None, "--verbose", "-v"
    )


@options_of(PlanOptions, without=(*OF_A_RUN, "plot"))
def plan(options: PlanOptions) -> None:
    """Print what `run SCENE` would do in each period, with delay, limits and deadlines. Nothing moves."""
    from haptic_fieldbus.planning.explain import explain, plan_json
    from haptic_fieldbus.planning.selection import plan_task

    task = options.task()
    note_bitrate(options.bus)
    compiled = plan_task(task)
    if options.as_json:
        print_json(plan_json(compiled))
    else:
        # `explain` writes the same column of keys; taken apart, the keys become bold and long lines are wrapped.
        text = explain(compiled, verbose=options.verbose)
        show((line[:KEY_WIDTH].strip(), line[KEY_WIDTH:]) for line in text.splitlines())
