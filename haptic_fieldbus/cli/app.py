"""Typer application: all commands and groups of commands."""

from typing import Annotated

import typer

from haptic_fieldbus.cli import profiles, scenes
from haptic_fieldbus.cli.doctor import doctor
from haptic_fieldbus.cli.estimate import estimate
from haptic_fieldbus.cli.plan import plan
from haptic_fieldbus.cli.rehearse import rehearse
from haptic_fieldbus.cli.report import report
from haptic_fieldbus.cli.response import response
from haptic_fieldbus.cli.run import run
from haptic_fieldbus.cli.scan import scan
from haptic_fieldbus.cli.simulate import simulate
from haptic_fieldbus.cli.stability import stability
from haptic_fieldbus.cli.vcan import vcan
from haptic_fieldbus.cli.watch import watch

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
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Accept the options of the program itself."""


# `--help` lists the commands in this order.
app.command()(run)
app.command()(plan)
app.command()(stability)
app.command()(response)
app.command()(estimate)
app.command()(report)
app.command()(rehearse)
app.command()(simulate)
app.command()(scan)
app.command()(watch)
app.command()(doctor)
app.command(context_settings={"allow_interspersed_args": False})(vcan)
app.add_typer(profiles.app, name="profiles")
app.add_typer(scenes.app, name="scenes")
