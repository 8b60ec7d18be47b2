"""Command `run`: render a scene on a drive."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import (
    BENCH,
    HANDS,
    OUTPUT,
    RENDERING,
    SIMULATION,
    BenchOptions,
    PlotOption,
    check_plot,
    draw,
    note_assumed_bitrate,
    option,
    options_of,
    seconds,
)
from haptic_fieldbus.cli.output import never_wait
from haptic_fieldbus.cli.screen import ProgressBar, bar, print_json, show
from haptic_fieldbus.defaults import DEFAULT_DURATION, DEFAULT_FADE_IN, DEFAULT_HAND, DEFAULT_SEED
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.running.ending import ended_by_signals

if TYPE_CHECKING:
    from haptic_fieldbus.api import Trial
    from haptic_fieldbus.assessing.result import Result
    from haptic_fieldbus.planning.plan import Plan


@dataclass(frozen=True, kw_only=True)
class RunOptions(BenchOptions):
    """Further options of `run`."""

    duration: Annotated[
        float, option("S", "Time from enabling on.", RENDERING, default=DEFAULT_DURATION, parser=seconds)
    ] = DEFAULT_DURATION
    change: Annotated[
        list[str] | None,
        option(
            "S:ELEMENT.PARAMETER=VALUE",
            "Change the scene while it runs, S seconds from enabling on; may be repeated.",
            RENDERING,
        ),
    ] = None
    force: Annotated[bool, option(None, "Go on although the loop would be unstable.", RENDERING, "--force")] = False
    fade_in: Annotated[
        float,
        option("S", "Time from enabling to the full force limit.", RENDERING, default=DEFAULT_FADE_IN, parser=seconds),
    ] = DEFAULT_FADE_IN
    hand: Annotated[
        str | None,
        option("NAME", HANDS, SIMULATION, default=f"that of the scene, or {DEFAULT_HAND}"),
    ] = None
    seed: Annotated[int, option("N", "Of all that is random.", SIMULATION, default=DEFAULT_SEED)] = DEFAULT_SEED
    faults: Annotated[
        str | None, option("FILE", "Faults of drive, bus, host and hand; random@SEED draws some.", SIMULATION)
    ] = None
    prove: Annotated[
        bool,
        option(None, "Prove first, at zero torque, that drives left alone let go.", BENCH, "--prove"),
    ] = False
    record: Annotated[Path | None, option("PATH", "Frames as .log (candump) or .blf, rows as .csv.", OUTPUT)] = None
    plot: PlotOption = None
    yes: Annotated[bool, option(None, "Enable a real drive without asking.", None, "--yes")] = False


@options_of(RunOptions)
def run(options: RunOptions) -> None:
    """Render SCENE on a drive, and report how well it went."""
    from haptic_fieldbus import api

    if not sys.stdin.isatty():  # a person at a terminal is to see the plan and the question
        never_wait()
    # Every option is checked before the first bus is opened.
    trial = options.given(api.Trial)
    check_plot(options.plot)
    show(note_assumed_bitrate(options.bus), sys.stderr)
    run_and_tell(options, replace(trial, instruct=None if options.yes or not sys.stderr.isatty() else instruct))


def run_and_tell(options: RunOptions, trial: "Trial") -> None:
    """Run a trial with the questions of a command, and print its result."""
    from haptic_fieldbus import api
    from haptic_fieldbus.planning.request import parse_changes

    changes = parse_changes(options.change or [])
    progress = bar(trial.duration)
    trial = replace(
        trial,
        changes=changes,
        confirm=_tell_question if options.yes else _ask,
        progress=progress,
        announce=_announcer(options, progress, changes),
    )
    with _partial_result(trial.duration, options.as_json):
        try:
            result = api.run.of(trial)
        finally:  # before any line is printed: the bar is drawn over its own line
            if progress is not None:
                progress.close()
    _finish(result, options.plot, options.as_json)


def _drawn_faults(options: RunOptions, plan: "Plan") -> list[tuple[None, str]]:
    """Return the lines of the file of faults that a seed stands for; none when faults come from a file."""
    if options.faults is None:
        return []
    from haptic_fieldbus.sim.faults.drawing import seed_of

    if seed_of(options.faults) is None:
        return []
    from haptic_fieldbus.api import faults_for
    from haptic_fieldbus.sim.faults import toml_of

    head = f"# {options.faults}, {exactly(options.duration)} s"
    these = faults_for(options.faults, options.duration, plan)
    return [(None, line) for line in (head, *toml_of(these).splitlines())]


def _ask(text: str) -> bool:
    """Print a warning and return the answer of a person to its last line, the question before a real drive is enabled.

    Raises UsageError when standard input is no terminal: a script must give `--yes`.
    """
    *warning, question = text.splitlines()
    show([(None, line) for line in warning], sys.stderr)
    if not sys.stdin.isatty():
        raise UsageError("nobody is there to confirm; a script says --yes")
    try:
        return typer.confirm(question, default=False, err=True)
    except typer.Abort as given_up:
        if isinstance(given_up.__context__, EOFError):
            return False
        raise KeyboardInterrupt from given_up


def instruct(text: str) -> None:
    """Show what a person is to do at the handle, in one line that is written over."""
    sys.stderr.write(f"\r\x1b[K{text}")
    sys.stderr.flush()


def _tell_question(text: str) -> bool:
    """Print the question that `--yes` answers, since it says what was heard and what is about to happen."""
    show([(None, line) for line in text.splitlines()], sys.stderr)
    return True


def _announcer(
    options: RunOptions, progress: ProgressBar | None, changes: Sequence[tuple[float, dict[str, str]]]
) -> Callable[["Plan"], None]:
    """Return a function that prints the plan that is about to run."""

    def announce(plan: "Plan") -> None:
        from haptic_fieldbus.report.texts import announcement

        # On a real bus the bar is not drawn: drawing takes time of a period, in which the drive waits.
        if progress is not None and not plan.simulated:
            progress.silent = True
        show(_drawn_faults(options, plan), sys.stderr)
        if not options.as_json:
            show(announcement(plan, changes))
            sys.stdout.flush()  # in a pipe, too, the plan is read before the run and not after it

    return announce


@contextmanager
def _partial_result(duration: float, as_json: bool) -> Iterator[None]:
    """Print the partial result of a run that failed or was stopped early, as lines or as the JSON object.

    The error goes on.
    """
    with ended_by_signals() as ending:
        try:
            yield
        except HapticFieldbusError as error:
            _tell_known(getattr(error, "result", None), as_json)
            raise
        except KeyboardInterrupt as early:
            from haptic_fieldbus.assessing.loop_report import LoopReport

            known: Result | None = getattr(early, "result", None)
            if not ending.when:  # no run has begun
                stopped = ending.stopped(LoopReport(interrupted=True), duration)
                _tell_known(known and replace(known, stopped=stopped), as_json)
            raise


def _tell_known(result: "Result | None", as_json: bool) -> None:
    if result is not None:
        _tell(result, as_json)


def _finish(result: "Result", plot: Path | None, as_json: bool) -> None:
    """Print the result as lines or as the JSON object, and draw the picture if asked for.

    Exit with 1 when the recording ended before the run.
    """
    _tell(result, as_json)
    if plot is not None:
        _draw(result, plot)
        if not as_json:
            show([("plot", str(plot))])
    if result.recording_fault is not None:
        sys.stdout.flush()
        show([("failed", f"the recording is not complete: {result.recording_fault}")], sys.stderr)
        raise typer.Exit(1)


def _tell(result: "Result", as_json: bool) -> None:
    """Print a result as lines or as the JSON object; flushed, so that it precedes a message on standard error."""
    if as_json:
        print_json(result.to_json())
    else:
        from haptic_fieldbus.report.texts import outcome

        show(outcome(result))
    sys.stdout.flush()


def _draw(result: "Result", path: Path) -> None:
    from haptic_fieldbus.report.plot import plot_run

    draw(path, lambda place: plot_run(result, place))
