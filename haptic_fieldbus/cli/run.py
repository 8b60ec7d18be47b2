"""Commands `run`, which renders a scene on a drive, and `demo`, which does so without any hardware."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import typer

from haptic_fieldbus.cli.options import (
    RunOptions,
    SceneOptions,
    check_plot,
    draw,
    note_bitrate,
    option_field,
    options_of,
)
from haptic_fieldbus.cli.output import asks_at_terminal, never_wait
from haptic_fieldbus.cli.screen import ProgressBar, print_json, show
from haptic_fieldbus.cli.view import LOOPBACK, VIEWED_DURATION, viewed
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.running.ending import ended_by_signals

if TYPE_CHECKING:
    from pathlib import Path

    from haptic_fieldbus.api import Trial
    from haptic_fieldbus.assessing.result import Result
    from haptic_fieldbus.planning.plan import Plan
    from haptic_fieldbus.planning.request import Task
    from haptic_fieldbus.recordings.provenance import Provenance
    from haptic_fieldbus.running.live import Live


@options_of(RunOptions)
def run(options: RunOptions) -> None:
    """Render SCENE on a drive, simulated or real, and print the result. `plan` only shows what would run."""
    from haptic_fieldbus import api

    options.check_source()

    if not asks_at_terminal():  # a person at a terminal is to see the plan and the question
        never_wait()
    # Every option is checked before the first bus is opened.
    check_plot(options.plot)
    if options.source is not None:
        _repeat(options)
        return
    task, trial = options.task(), options.given(api.Trial)
    note_bitrate(options.bus)
    run_and_tell(options, task, replace(trial, instruct=None if options.yes or not sys.stderr.isatty() else instruct))


def _repeat(options: RunOptions) -> None:
    """Repeat the run that a file describes, and print its result."""
    from haptic_fieldbus import api
    from haptic_fieldbus.api.provenance import differences_of, repeated
    from haptic_fieldbus.recordings.reading import check_apart, read_provenance

    provenance = read_provenance(cast("Path", options.source))
    check_apart(cast("Path", options.source), options.record, options.plot)
    show([("note", text) for text in differences_of(provenance)], sys.stderr)
    with repeated(provenance) as (task, conditions):
        run_and_tell(options, task, replace(options.given(api.Trial), **conditions), provenance)


def run_and_tell(
    options: SceneOptions, task: "Task", trial: "Trial", repeats: "Provenance | None" = None, *, browser: bool = False
) -> None:
    """Run a trial with the questions of a command, and print its result; `browser` opens the page of `--view`."""
    if not (options.view or options.view_host or options.view_required):
        _run_and_tell(options, task, trial, repeats)
        return
    from haptic_fieldbus.scenes.catalogue import load_scene

    scene = load_scene(str(options.scene)) if repeats is None else None
    duration = VIEWED_DURATION if options.duration is None and repeats is None else trial.duration
    with viewed(
        options.view_host or LOOPBACK, options.view_port, options.view_required, scene, browser=browser
    ) as live:
        trial = replace(trial, live=live, duration=duration)
        # A file or an object is that of one run, and so are faults and scheduled changes.
        if not (repeats or options.record or options.plot or options.as_json or options.change or options.faults):
            _offer_scenes(live, task, trial)
        _run_and_tell(options, task, trial, repeats)
        while (name := live.renew()) is not None:
            live.command = [name if word == str(options.scene) else word for word in live.command]
            options, task = replace(options, scene=name, settings=None), replace(task, scene=name, settings={})
            _run_and_tell(options, task, trial, None)


def _offer_scenes(live: "Live", task: "Task", trial: "Trial") -> None:
    """Let a page of a simulation choose among the scenes of the library."""
    from haptic_fieldbus.planning.refusal import check_stable
    from haptic_fieldbus.planning.selection import plan_task
    from haptic_fieldbus.scenes.catalogue import scene_names

    def check(name: str) -> None:
        found = plan_task(replace(task, scene=name, settings={}))
        if not trial.force:
            check_stable(found)

    live.scenes, live.check_scene = scene_names(), check


def _run_and_tell(options: SceneOptions, task: "Task", trial: "Trial", repeats: "Provenance | None") -> None:
    from haptic_fieldbus import api
    from haptic_fieldbus.planning.request import parse_changes

    changes = parse_changes(options.change or []) if repeats is None else list(repeats.conditions.changes)
    progress = ProgressBar(trial.duration) if sys.stderr.isatty() else None

    def announce(plan: "Plan") -> None:
        """Print the plan that is about to run."""
        from haptic_fieldbus.report.texts import announcement

        # On a real bus the bar is not drawn: drawing takes time of a period, in which the drive waits.
        if progress is not None and not plan.simulated:
            progress.silent = True
        show(_drawn_faults(options.faults, trial.duration, plan), sys.stderr)
        if not options.as_json:
            show(announcement(plan, changes, verbose=options.verbose))
            sys.stdout.flush()  # in a pipe, too, the plan is read before the run and not after it

    confirm = tell_question if options.yes else ask
    if repeats is None:
        trial = replace(trial, changes=changes)
    trial = replace(trial, confirm=confirm, progress=progress, announce=announce)
    with _partial_result(trial.duration, options):
        try:
            result = api.run_task(task, trial, repeats)
        finally:  # before any line is printed: the bar is drawn over its own line
            if progress is not None:
                progress.close()
    if trial.live is not None and not trial.live.goes_on:
        trial.live.end({"text": result.stopped.message if result.stopped else "its duration is over"})
    _tell(result, options)
    if result.recording_fault is not None:
        show([("failed", f"the recording is incomplete: {result.recording_fault}")], sys.stderr)
    _draw(result, options)
    if result.recording_fault is not None:
        raise typer.Exit(1)


def _drawn_faults(source: str | None, duration: float, plan: "Plan") -> list[tuple[None, str]]:
    """Return the lines of a file with the faults of a seed; no lines if the faults come from a file."""
    if source is None:
        return []
    from haptic_fieldbus.sim.faults.drawing import seed_of

    if seed_of(source) is None:
        return []
    from haptic_fieldbus.api import faults_for
    from haptic_fieldbus.sim.faults import toml_of

    head = f"# {source}, {exactly(duration)} s"
    return [(None, line) for line in (head, *toml_of(faults_for(source, duration, plan)).splitlines())]


def ask(text: str) -> bool:
    """Print a warning and return the answer of a person to its last line, the question before a real drive is enabled.

    Raises UsageError when standard input is no terminal: a script must give `--yes`.
    """
    *warning, question = text.splitlines()
    show([(None, line) for line in warning], sys.stderr)
    if not asks_at_terminal():
        raise UsageError("no terminal to confirm on; add --yes")
    try:
        return typer.confirm(question, default=False, err=True)
    except typer.Abort as given_up:
        if isinstance(given_up.__context__, EOFError):
            return False
        raise KeyboardInterrupt from given_up


def instruct(text: str) -> None:
    """Show the instruction for the person at the handle, in one line that is overwritten."""
    sys.stderr.write(f"\r\x1b[K{text}")
    sys.stderr.flush()


def tell_question(text: str, answer: str = "Enabled by --yes.") -> bool:
    """Print a warning, because it contains the traffic heard and the coming steps, and the answer to its last line."""
    *warning, _ = text.splitlines()
    show([(None, line) for line in (*warning, answer)], sys.stderr)
    return True


@contextmanager
def _partial_result(duration: float, options: SceneOptions) -> Iterator[None]:
    """Print the partial result of a run that failed or was stopped early, as lines or as the JSON object, and draw it.

    The error goes on, and its message is the last one.
    """
    with ended_by_signals() as ending:
        try:
            yield
        except HapticFieldbusError as error:
            if error.result is not None:
                _tell(cast("Result", error.result), options)
                _draw_partial(cast("Result", error.result), options)
            raise
        except KeyboardInterrupt as early:
            from haptic_fieldbus.assessing.loop_report import LoopReport

            known: Result | None = getattr(early, "result", None)
            if not ending.when:  # no run has begun
                stopped = ending.stopped(LoopReport(interrupted=True), duration)
                if known is not None:
                    _tell(replace(known, stopped=stopped), options)
            raise


def _tell(result: "Result", options: SceneOptions) -> None:
    """Print a result as lines or as the JSON object; flushed, so that it precedes a message on standard error."""
    if options.as_json:
        print_json(result.to_json())
    else:
        from haptic_fieldbus.report.texts import outcome

        show(outcome(result, verbose=options.verbose))
    sys.stdout.flush()


def _draw(result: "Result", options: SceneOptions) -> None:
    """Draw a result that was printed, if there is a path for its picture; raises HapticFieldbusError."""
    if options.plot is None:
        return
    from haptic_fieldbus.report.plot import draw_run

    draw(options.plot, draw_run(result), result.provenance.mark if result.provenance else "", result)
    if not options.as_json:
        show([("plot", str(options.plot))])
        sys.stdout.flush()


def _draw_partial(result: "Result", options: SceneOptions) -> None:
    """Draw the result of a run that failed, without an error of its own: that of the run comes next."""
    if options.plot is not None and not result.traces:
        show([("plot", "not drawn: the drive was not enabled")], sys.stderr)
        return
    try:
        _draw(result, options)
    except HapticFieldbusError as error:
        show([("failed", str(error))], sys.stderr)


# Command `demo`: a run for the first minute.


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Options of `demo`."""

    port: int | None = option_field("PORT", "Port of the page.", told="8765, or a free one")
    no_browser: bool = option_field(None, "Only print the address of the page.")


@options_of(DemoOptions)
def demo(options: DemoOptions) -> None:
    """Touch a wall on a simulated drive with the mouse, on a page in the browser. To practise a start: `rehearse`."""
    from haptic_fieldbus import api

    asked = SceneOptions(scene="wall", hand="none", view=True, view_port=options.port)
    run_and_tell(asked, asked.task(), asked.given(api.Trial), browser=not options.no_browser)
