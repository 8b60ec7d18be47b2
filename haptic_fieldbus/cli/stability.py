"""`stability`: the limits of a scene before anything moves."""

import sys
from typing import Annotated

import typer

from haptic_fieldbus.cli.options import (
    BusOption,
    DriveOption,
    EstimatorOption,
    JsonOption,
    MethodOption,
    NodeOption,
    RateOption,
    RigOption,
    SceneArgument,
    Selection,
    SetOption,
    note_assumed_bitrate,
)
from haptic_fieldbus.cli.pictures import PlotOption, check_plot, draw
from haptic_fieldbus.cli.screen import plain, print_json, show

DEVICE = "Device, instead of a bench (SI, in the scene's workspace; what is not given is 0)"


def _option(unit: str, text: str) -> object:
    return typer.Option(metavar=unit, help=text, rich_help_panel=DEVICE)


def stability(
    scene: SceneArgument,
    drive: DriveOption = None,
    bus: BusOption = None,
    node: NodeOption = None,
    rig: RigOption = None,
    rate: RateOption = 1000.0,
    settings: SetOption = None,
    method: MethodOption = None,
    estimator: EstimatorOption = None,
    mass: Annotated[float | None, _option("KG", "Mass or inertia.")] = None,
    damping: Annotated[float | None, _option("N·S/M", "Viscous damping.")] = None,
    coulomb: Annotated[float | None, _option("N", "Coulomb friction.")] = None,
    resolution: Annotated[float | None, _option("M", "One encoder count.")] = None,
    delay: Annotated[float | None, _option("S", "From sampling to acting, the hold not counted.")] = None,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Judge SCENE: up to which stiffness it is passive, stable, and at rest between encoder counts."""
    chosen = Selection(drive, bus, node, rig, rate, settings, method, estimator).arguments()
    check_plot(plot)
    show(note_assumed_bitrate(bus), sys.stderr)
    from haptic_fieldbus.judging import device_of, judge_scene
    from haptic_fieldbus.report import limits

    device = device_of(mass=mass, damping=damping, coulomb=coulomb, resolution=resolution, delay=delay)
    judged = judge_scene(scene, **chosen, device=device)
    if plot is not None:
        from haptic_fieldbus.report.plot_region import plot_region

        draw(plot, lambda path: plot_region(judged, path))
    show(limits.notes(judged), sys.stderr)
    if as_json:
        print_json({key: plain(value) for key, value in judged.stability.to_json().items()})
        return
    show(limits.limits(judged))
    if plot is not None:
        show([("plot", str(plot))])
