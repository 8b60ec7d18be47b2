"""Command `vcan`: run a command where a real SocketCAN bus is, in the host's kernel or in a guest's."""

import sys
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from haptic_fieldbus.cli.failures import tell
from haptic_fieldbus.cli.options import option
from haptic_fieldbus.cli.screen import show
from haptic_fieldbus.defaults import DEFAULT_VCAN
from haptic_fieldbus.errors import UsageError, VcanError


def vcan(
    command: Annotated[list[str], typer.Argument(metavar="-- COMMAND …", help="The command and its arguments.")],
    interface: Annotated[
        list[str] | None, option("NAME", "Virtual CAN interface, may be repeated.", default=DEFAULT_VCAN)
    ] = None,
    out: Annotated[
        list[Path] | None, option("DIR", "Folder that the command may write to in a guest kernel; may be repeated.")
    ] = None,
    time_limit: Annotated[
        float, option("S", "Time limit of the command in s; then it is ended with exit status 124. \\[default: none]")
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
