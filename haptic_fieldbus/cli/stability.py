"""Command `stability`: the stability limits of a scene, computed before anything moves."""

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from haptic_fieldbus.cli.options import BenchOptions, note_assumed_bitrate, number, option, options_of, seconds
from haptic_fieldbus.cli.pictures import PlotOption, check_plot, draw
from haptic_fieldbus.cli.screen import plain, print_json, show

if TYPE_CHECKING:
    from haptic_fieldbus.protocols.traffic import Json

DEVICE_PANEL = "Device, instead of a bench (SI, in the scene's workspace; what is not given is 0)"


@dataclass(frozen=True, kw_only=True)
class StabilityOptions(BenchOptions):
    """Further options of `stability`."""

    mass: Annotated[float | None, option("KG", "Mass or inertia.", DEVICE_PANEL, parser=number)] = None
    damping: Annotated[float | None, option("N·S/M", "Viscous damping.", DEVICE_PANEL, parser=number)] = None
    coulomb: Annotated[float | None, option("N", "Coulomb friction.", DEVICE_PANEL, parser=number)] = None
    resolution: Annotated[float | None, option("M", "One encoder count.", DEVICE_PANEL, parser=number)] = None
    delay: Annotated[
        float | None, option("S", "From sampling to acting, the hold not counted.", DEVICE_PANEL, parser=seconds)
    ] = None
    plot: PlotOption = None


@options_of(StabilityOptions)
def stability(options: StabilityOptions) -> None:
    """Compute up to which stiffness SCENE is passive, stable, and at rest between encoder counts."""
    from haptic_fieldbus.api.judging import Inquiry, judge_scene
    from haptic_fieldbus.report.stability import notes, stability_lines

    inquiry = options.given(Inquiry)
    check_plot(options.plot)
    show(note_assumed_bitrate(options.bus), sys.stderr)
    judgement = judge_scene(inquiry)
    if options.plot is not None:
        from haptic_fieldbus.report.plot_region import plot_region

        draw(options.plot, lambda path: plot_region(judgement, path))
    show(notes(judgement), sys.stderr)
    if options.as_json:
        found = {key: plain(value) for key, value in judgement.stability.to_json().items()}
        ways: list[Json] = [way.to_json() for way in judgement.ways]
        print_json({**found, "assumed": list(judgement.assumed), "ways": ways})
        return
    show(stability_lines(judgement))
    if options.plot is not None:
        show([("plot", str(options.plot))])
