"""`report`: error against run time, stability of stiff and extreme cases, and what each part costs."""

import sys
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import JsonOption, option
from haptic_fieldbus.cli.screen import console, plain, print_json, show
from haptic_fieldbus.defaults import DEFAULT_REPORT
from haptic_fieldbus.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

LABEL_WIDTH = 44


def report(
    out: Annotated[
        Path, option("DIR", "Folder for index.html, figures and report.json.", default=DEFAULT_REPORT)
    ] = Path(DEFAULT_REPORT),
    quick: Annotated[bool, typer.Option("--quick", help="Under a minute: fewer steps, shorter runs.")] = False,
    only: Annotated[str | None, typer.Option(metavar="NAME", help="One section, problem or case by its name.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure error against run time, in both senses: what accuracy costs, and how error grows along a run."""
    if find_spec("matplotlib") is None:
        raise UsageError("report needs matplotlib: pip install matplotlib")
    from haptic_fieldbus import api
    from haptic_fieldbus.study.make_report import json_ready, make_report
    from haptic_fieldbus.study.measure.bench import Tools

    words = ["haptic-fieldbus report", f"--out {out}", "--quick" * quick, f"--only {only}" * (only is not None)]
    with _progress() as progress:
        found = make_report(
            out,
            Tools(api.run, api.plan),
            quick=quick,
            only=only,
            progress=progress,
            command=" ".join(filter(None, words)),
        )
    if as_json:
        told = json_ready(found)
        print_json({key: plain(value) for key, value in told.items()} if isinstance(told, dict) else {})
        return
    show([("report", str(out / "index.html")), ("", str(out / "report.json"))])


@contextmanager
def _progress() -> "Iterator[Callable[[str, float], None] | None]":
    """A bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(bar_width=30), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(),
               TextColumn("{task.description}"))  # fmt: skip
    with Progress(*columns, console=console(sys.stderr), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda label, share: bar.update(task, completed=share, description=label[:LABEL_WIDTH])
