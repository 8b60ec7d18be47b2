"""Typer application: all commands and groups of commands."""

import sys
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from haptic_fieldbus.cli import profiles, scenes
from haptic_fieldbus.cli.bench import doctor, scan, watch
from haptic_fieldbus.cli.failures import tell
from haptic_fieldbus.cli.identify import identify
from haptic_fieldbus.cli.options import option, seconds
from haptic_fieldbus.cli.planning import estimate, plan, response, stability
from haptic_fieldbus.cli.rehearse import rehearse
from haptic_fieldbus.cli.replay import replay
from haptic_fieldbus.cli.report import bench, report
from haptic_fieldbus.cli.run import demo, run
from haptic_fieldbus.cli.screen import show
from haptic_fieldbus.cli.simulate import simulate
from haptic_fieldbus.cli.sweep import sweep
from haptic_fieldbus.cli.view import view
from haptic_fieldbus.defaults import DEFAULT_VCAN
from haptic_fieldbus.errors import UsageError, VcanError

# Command `vcan`: run a command where a real SocketCAN bus is, in the host's kernel or in a guest's.


def vcan(
    command: Annotated[list[str], typer.Argument(metavar="-- COMMAND …", help="The command and its arguments.")],
    interface: Annotated[
        list[str] | None, option("NAME", "Virtual CAN interface, may be repeated.", default=DEFAULT_VCAN)
    ] = None,
    out: Annotated[
        list[Path] | None, option("DIR", "Folder that the command may write to in a guest kernel; may be repeated.")
    ] = None,
    time_limit: Annotated[
        float,
        option(
            "S",
            "Time limit of the command in s; then it is ended with exit status 124. \\[default: none]",
            parser=seconds,
        ),
    ] = inf,
    guest: Annotated[bool, option(None, "Always use a guest kernel.", None, "--guest")] = False,
) -> None:
    """Run a command with virtual SocketCAN interfaces. `simulate` hosts drives on them.

    The exit status is that of the command.
    The interfaces are those of this machine, if it has them or this user may create them.
    Otherwise a guest kernel (User-Mode Linux) provides them. It needs no rights and sees the same files.
    In a guest kernel the command can write to the folders of --out only.
    """
    from haptic_fieldbus.vcan.runner import GuestTask, run

    if not time_limit > 0.0:
        raise UsageError(f"--time-limit {time_limit:g}: expected more than 0 s")
    errand = GuestTask(command, interface or [DEFAULT_VCAN], out or (), time_limit, guest)
    try:
        status = run(errand, lambda text: show([("vcan", text)], sys.stderr))
    except VcanError as error:
        tell(error)
        status = error.status
    raise typer.Exit(status)


app = typer.Typer(
    name="haptic-fieldbus",
    help="Turn servo drives into haptic interfaces: virtual walls, springs and masses that a hand can feel.",
    epilog="Try: haptic-fieldbus run wall",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,  # an unexpected error keeps Python's own traceback
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    """Print the version and exit when `--version` is given."""
    if asked:
        from importlib.metadata import version

        typer.echo(f"haptic-fieldbus {version('haptic-fieldbus')}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, metavar="", help="Print the version and exit."),
    ] = False,
) -> None:
    """Accept the options of the program itself."""


START, BENCH_PANEL, STUDY, FILES = (
    "Start: feel a scene",
    "Bench: drives and buses",
    "Study: a scene without a drive",
    "Files: scenes and drive profiles",
)
# `--help` lists the panels and their commands in this order.
COMMANDS: dict[str, tuple[Callable[..., None], ...]] = {
    START: (run, demo, view, rehearse, plan),
    BENCH_PANEL: (doctor, scan, watch, identify, simulate),
    STUDY: (stability, sweep, response, estimate, replay, report, bench),
}
for panel, commands in COMMANDS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(command)
app.command(context_settings={"allow_interspersed_args": False}, rich_help_panel=BENCH_PANEL)(vcan)
app.add_typer(scenes.app, name="scenes", rich_help_panel=FILES)
app.add_typer(profiles.app, name="profiles", rich_help_panel=FILES)
