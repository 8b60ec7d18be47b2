"""`run`: render a scene on a drive."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import (
    BusOption,
    ChangeOption,
    DriveOption,
    EstimatorOption,
    ForceOption,
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
from haptic_fieldbus.cli.screen import Bar, bar, print_json, show
from haptic_fieldbus.errors import HapticFieldbusError, UsageError

if TYPE_CHECKING:
    from haptic_fieldbus.planning import Plan
    from haptic_fieldbus.result import Result

SIMULATION, OUTPUT = "Simulation", "Output"


def run(
    scene: SceneArgument,
    drive: DriveOption = None,
    bus: BusOption = None,
    node: NodeOption = None,
    rig: RigOption = None,
    rate: RateOption = 1000.0,
    duration: Annotated[
        float, typer.Option(metavar="S", help=r"Time from enabling on. \[default: 10]", rich_help_panel="Rendering")
    ] = 10.0,
    settings: SetOption = None,
    change: ChangeOption = None,
    method: MethodOption = None,
    estimator: EstimatorOption = None,
    force: ForceOption = False,
    hand: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=r"push, tap, sine, guide, release or none. \[default: that of the scene, or push]",
            rich_help_panel=SIMULATION,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Of all that is random.", rich_help_panel=SIMULATION)] = 0,
    faults: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Faults of drive and link.", rich_help_panel=SIMULATION)
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Frames as .log (candump) or .blf, rows as .csv.", rich_help_panel=OUTPUT),
    ] = None,
    plot: PlotOption = None,
    as_json: JsonOption = False,
    yes: Annotated[bool, typer.Option("--yes", help="Enable a real drive without asking.")] = False,
) -> None:
    """Render SCENE on a drive, and say how well it went."""
    chosen = Selection(drive, bus, node, rig, rate, settings, method, estimator).arguments()
    check_plot(plot)
    show(note_assumed_bitrate(bus), sys.stderr)
    from haptic_fieldbus import api
    from haptic_fieldbus.request import parse_changes

    changes = parse_changes(change or [])
    progress = bar(rate)
    with _object_of_failure(as_json):
        try:
            result = api.run(
                scene,
                **chosen,
                duration=duration,
                hand=hand,
                seed=seed,
                faults=faults or (),
                record=record,
                force=force,
                changes=changes,
                confirm=(lambda _: True) if yes else _ask,
                progress=progress,
                announce=_announcer(as_json, progress, changes),
            )
        finally:
            if progress is not None:
                progress.close()
    _finish(result, plot, as_json)


def _ask(text: str) -> bool:
    """Put the question of a real drive, the last line of the text, to a person; without one, only --yes answers it."""
    *warning, question = text.splitlines()
    show([(None, line) for line in warning], sys.stderr)
    if not sys.stdin.isatty():
        raise UsageError("nobody is there to confirm; a script says --yes")
    return typer.confirm(question, default=False, err=True)


def _announcer(
    as_json: bool, progress: Bar | None, changes: Sequence[tuple[float, dict[str, str]]]
) -> Callable[["Plan"], None]:
    """Tell what is about to run; on a real bus the loop then draws nothing, for its time belongs to the drive."""

    def announce(plan: "Plan") -> None:
        from haptic_fieldbus.report.words import announcement, is_simulated

        if progress is not None and not is_simulated(plan):
            progress.silent = True
        if not as_json:
            show(announcement(plan, changes))
            sys.stdout.flush()

    return announce


@contextmanager
def _object_of_failure(as_json: bool) -> Iterator[None]:
    """What is known of a run that failed, as lines or as the JSON object, before its error is told."""
    try:
        yield
    except HapticFieldbusError as error:
        result: Result | None = getattr(error, "result", None)
        if result is not None and as_json:
            print_json(result.to_json())
        elif result is not None:
            _tell(result)
        raise


def _finish(result: "Result", plot: Path | None, as_json: bool) -> None:
    _draw(result, plot)
    if as_json:
        print_json(result.to_json())
        return
    _tell(result)
    if plot is not None:
        show([("plot", str(plot))])


def _tell(result: "Result") -> None:
    from haptic_fieldbus.report.words import outcome

    show(outcome(result))
    sys.stdout.flush()


def _draw(result: "Result", path: Path | None) -> None:
    if path is None:
        return
    from haptic_fieldbus.report.plot import plot_run

    draw(path, lambda place: plot_run(result, place))
