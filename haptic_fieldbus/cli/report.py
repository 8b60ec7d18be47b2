"""Commands `report`, which measures error, stability and cost of all methods, and `bench`, which measures speed."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptic_fieldbus.cli.failures import print_object
from haptic_fieldbus.cli.options import JsonOption, option
from haptic_fieldbus.cli.screen import moving_bar, show, show_result
from haptic_fieldbus.defaults import DEFAULT_REPORT
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.running.ending import ended_by_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from haptic_fieldbus.assessing.result import Result

LABEL_WIDTH = 44
"""Longest label beside the progress bar [characters]."""
NO_FIGURE = 2
"""Exit status of the benchmarks without a figure to measure."""
GRACE = 10.0
"""Time that the benchmarks and their processes have to end after a signal [s]."""


def report(
    out: Annotated[
        Path, option("DIR", "Folder for index.html, figures and report.json.", default=DEFAULT_REPORT)
    ] = Path(DEFAULT_REPORT),
    quick: Annotated[
        bool, option(None, "Fewer steps and shorter runs; takes under a minute.", None, "--quick")
    ] = False,
    only: Annotated[str | None, typer.Option(metavar="NAME", help="Run only this section, problem or case.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure error, stability and computing time of all methods. For the limits of one scene use `stability`."""
    if find_spec("matplotlib") is None:
        raise UsageError("report needs matplotlib; in a checkout, run: pip install -e '.[plot]'")
    from haptic_fieldbus import api
    from haptic_fieldbus.api.provenance import picture_mark
    from haptic_fieldbus.study.make_report import json_ready, make_report
    from haptic_fieldbus.study.measure.bench import Tools

    # The page shows the command with which it can be made again.
    words = ["haptic-fieldbus report", f"--out {out}", "--quick" * quick, f"--only {only}" * (only is not None)]
    with moving_bar("{task.percentage:>3.0f} %", "{task.description}") as update:

        def progress(label: str, share: float) -> None:
            update(completed=share, total=1.0, description=label[:LABEL_WIDTH])

        made = make_report(
            out,
            Tools(_interruptible(api.run), api.plan),
            quick=quick,
            only=only,
            progress=progress,
            command=" ".join(filter(None, words)),
            mark=picture_mark(),
        )
    show([("warning", warning) for warning in made.warnings], sys.stderr)
    told = json_ready(made.content)
    lines = [("found" if number == 0 else "", f"- {sentence}") for number, sentence in enumerate(made.findings)]
    lines += [("report", str(out / "index.html")), ("", str(out / "report.json"))]
    show_result(lines, lambda: told if isinstance(told, dict) else {}, as_json=as_json)


def bench(
    short: Annotated[bool, option(None, "Fewer rounds; takes under a minute.", None, "--short")] = False,
    only: Annotated[str, typer.Option(metavar="WORD", help="Measure only figures whose name contains WORD.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Measure how fast this computer runs the loop and its parts, each beside a reference of the same run.

    The exit status is 1 when a ratio is above its bound.
    """
    from haptic_fieldbus.protocols.catalogue import profile_folder

    # In a process of its own, which has loaded nothing yet.
    program = [sys.executable, str(profile_folder().parent / "benchmarks" / "bench.py"), "--only", only]
    status = _called([*program, *["--short"] * short, *["--json"] * as_json])
    if as_json and status == NO_FIGURE:
        print_object(UsageError(f'--only "{only}": no figure has this word in its name'))
    raise typer.Exit(status)


def _called(program: list[str]) -> int:
    """Run a program and return its exit status; a signal ends it with all processes that it started.

    It gets a session of its own, so that Ctrl-C reaches this process alone.
    """
    with ended_by_signals() as ending:
        ending.hold()  # a signal while it is started would leave it behind
        with subprocess.Popen(program, start_new_session=True) as child:
            try:
                ending.resume()
                return child.wait()
            except KeyboardInterrupt:
                _end(child)
                raise


def _end(child: "subprocess.Popen[bytes]") -> None:
    try:
        _send(child, "SIGTERM")
        with suppress(subprocess.TimeoutExpired):
            child.wait(GRACE)
    finally:
        _send(child, "SIGKILL")


def _send(child: "subprocess.Popen[bytes]", name: str) -> None:
    """Send a signal to the session of a child; on Windows, which has none, end the child."""
    if sys.platform == "win32":
        child.kill()
        return
    with suppress(ProcessLookupError):
        os.killpg(child.pid, getattr(signal, name))


def _interruptible(run: "Callable[..., Result]") -> "Callable[..., Result]":
    """Return `run` in a wrapper: a signal during the run ends the report too."""

    def call(*args: Any, **kwargs: Any) -> "Result":
        with ended_by_signals() as ending:
            try:
                result = run(*args, **kwargs)
                ending.resume()
            finally:
                ending.when = ""  # the report ends, not a run on drives
        return result

    return call
