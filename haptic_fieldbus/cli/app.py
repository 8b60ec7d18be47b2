"""Typer application: all commands and groups of commands.

Only the modules of the commands that are invoked are imported. For the others the lines of `--help` stand here.
"""

from collections.abc import Collection
from importlib import import_module
from typing import Annotated

import typer

START, BENCH_PANEL, STUDY, FILES = (
    "Start: feel a scene",
    "Bench: drives and buses",
    "Study: a scene without a drive",
    "Files: scenes and drive profiles",
)
# `--help` lists the panels and their commands in this order.
COMMANDS: dict[str, dict[str, str]] = {
    START: {
        "run:run": "Render SCENE on a drive, simulated or real, and print the result. `plan` only shows what would"
        " run.",
        "run:demo": "Touch a wall on a simulated drive with the mouse, on a page in the browser. To practise a start:"
        " `rehearse`.",
        "view:view": "Show a run that was begun with --view as a page in the browser. To watch drives without torque:"
        " `watch`.",
        "rehearse:rehearse": "Practise the first start of a real drive on a simulated one in real time. With your"
        " drive: `run --rig`.",
        "planning:plan": "Print what `run SCENE` would do in each period, with delay, limits and deadlines. Nothing"
        " moves.",
    },
    BENCH_PANEL: {
        "bench:doctor": "Check adapter, bus and computer, with a remedy for each fault. To find the drives use `scan`.",
        "bench:scan": "List the nodes of a bus with their profiles, by reading alone. For live values use `watch`.",
        "bench:watch": "Show position, speed and state of drives without torque, until Ctrl-C. To render use `run`.",
        "identify:identify": "Measure inertia, friction, damping and delay of a bench with its own drive, and write"
        " them into the rig file.",
        "identify:certify": "Raise the stiffness of SCENE in steps and tap it: the largest one that is well damped,"
        " and the onset. Measure first: `identify`.",
        "recordings:twin": "Fit the bench of a recorded run as a simulation, for `run --bus sim`, or say what changed"
        " on it.",
        "simulate:simulate": "Host simulated drives for other programs, in real time, until Ctrl-C. `run --bus sim`"
        " needs none.",
        "vcan:vcan": "Run a command with virtual SocketCAN interfaces. `simulate` hosts drives on them.",
    },
    STUDY: {
        "planning:stability": "Compute the stability limits of SCENE. Nothing moves. `report` tests the methods behind"
        " it.",
        "sweep:sweep": "Judge or run SCENE at many points and keep a row for each. For one point use `stability` or"
        " `run`.",
        "planning:response": "Compute the force of SCENE for a given motion, without a drive. For the closed loop use"
        " `run`.",
        "planning:estimate": "Apply a velocity estimator to a signal in FILE. To use one in a loop: `run --estimator`.",
        "recordings:replay": "Summarise a recording; draw, convert, compare or repair it. To simulate its run again:"
        " `run --from`.",
        "report:report": "Measure error, stability and computing time of all methods. For the limits of one scene use"
        " `stability`.",
        "report:bench": "Measure how fast this computer runs the loop and its parts, each beside a reference of the"
        " same run.",
    },
}
GROUPS: dict[str, str] = {
    "scenes": "List, show and check scenes: what the hand feels.",
    "profiles": "List, show, check and draft drive profiles: what a drive model offers.",
}
NAMES = frozenset(home.partition(":")[2] for panel in COMMANDS.values() for home in panel) | GROUPS.keys()
"""Names of all commands and groups."""


def application(words: Collection[str] = NAMES) -> typer.Typer:
    """Return the application, complete in the commands whose names are among the words of a command line."""
    app = typer.Typer(
        name="haptic-fieldbus",
        help="Turn servo drives into haptic interfaces: virtual walls, springs and masses that a hand can feel.",
        epilog="Try: haptic-fieldbus run wall",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,  # an unexpected error keeps Python's own traceback
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    for panel, commands in COMMANDS.items():
        for home, line in commands.items():
            module, _, name = home.partition(":")
            if name in words:
                settings = {"allow_interspersed_args": False} if name == "vcan" else None
                command = getattr(import_module(f"haptic_fieldbus.cli.{module}"), name)
                app.command(context_settings=settings, rich_help_panel=panel)(command)
            else:
                app.command(name, help=line, rich_help_panel=panel)(_not_invoked)
    for name, line in GROUPS.items():
        group = import_module(f"haptic_fieldbus.cli.{name}").app if name in words else typer.Typer(help=line)
        app.add_typer(group, name=name, rich_help_panel=FILES)
    return app


def _not_invoked() -> None:
    """Stand for a command that a command line does not name."""


def _version(asked: bool) -> None:
    """Print the version and exit when `--version` is given."""
    if asked:
        from importlib.metadata import version

        typer.echo(f"haptic-fieldbus {version('haptic-fieldbus')}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, metavar="", help="Print the version and exit."),
    ] = False,
) -> None:
    """Accept the options of the program itself."""
