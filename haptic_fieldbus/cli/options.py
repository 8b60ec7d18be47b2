"""Options that commands share, each declared once, and their conversion to arguments of the API.

The options of a command are the fields of a dataclass; another command extends it. `options_of` makes Typer see the
fields as parameters; `task` and `given` turn their values into the dataclasses that the API takes.
"""

import inspect
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar, cast

import typer

from haptic_fieldbus.cli.screen import show
from haptic_fieldbus.defaults import (
    DEFAULT_BUS,
    DEFAULT_DRIVE,
    DEFAULT_DURATION,
    DEFAULT_ESTIMATOR,
    DEFAULT_FADE_IN,
    DEFAULT_HAND,
    DEFAULT_METHOD,
    DEFAULT_MODBUS_DRIVE,
    DEFAULT_NODE,
    DEFAULT_RATE,
    DEFAULT_SEED,
)
from haptic_fieldbus.errors import HapticFieldbusError, UsageError, raise_all
from haptic_fieldbus.numerals import exactly

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from haptic_fieldbus.planning.request import Task


P = ParamSpec("P")
Options = TypeVar("Options")
Asked = TypeVar("Asked")

BENCH, RENDERING, SIMULATION, OUTPUT, VIEW = "Bench", "Rendering", "Simulation", "Output", "View"
BUSES = (
    "sim@BITRATE, or INTERFACE:CHANNEL@BITRATE such as socketcan:can0; on Modbus sim-modbus-tcp, "
    "sim-modbus-rtu@BAUD, modbus-tcp:HOST:PORT or modbus-rtu:DEVICE@BAUD."
)
"""Names of buses, for the help."""
DRIVE = f"{DEFAULT_DRIVE} on CAN, {DEFAULT_MODBUS_DRIVE} on Modbus"
"""Default of the drive, for the help."""
RATE = f"{exactly(DEFAULT_RATE)} on CAN, the highest possible on Modbus"
"""Default of the rate, for the help."""
SHOWN = (
    "scene", "input", "amplitude", "drive", "bus", "node", "rig", "axes", "zero", "profiles",
    "rate", "duration", "settings", "change", "method", "estimator",
    "mass", "damping", "coulomb", "resolution", "delay",
)  # fmt: skip
"""Options that the help lists first, in this order; others follow in the order of their dataclass."""


HANDS = "Motion of the simulated hand: push, tap, sine, guide, shake, release or none."
"""Names of the simulated hands, for the help."""
OPTION = "option"
"""Key of the metadata of a field, whose value is the option."""


def number(text: str, quantity: str = "") -> float:
    """Return the number of an option; with the name of a `Quantity` it may have a unit, such as 1kHz or "500 ms".

    Raises BadParameter, which names the option, with the spelling to use.
    """
    from haptic_fieldbus.documents.quantities import Quantity, parse_quantity, refuse_comma
    from haptic_fieldbus.signals import Workspace

    with suppress(ValueError):
        return float(text)
    try:
        if quantity:
            return parse_quantity(text, Quantity[quantity], Workspace.LINEAR)
        refuse_comma(text)
        expected = "a number without a unit"
    except ValueError as error:
        expected = str(error).replace(" without quotes", "")
    raise typer.BadParameter(f'"{text}"; expected {expected}')


def frequency(text: str) -> float:
    """Return the frequency of an option [Hz]."""
    return number(text, "FREQUENCY")


def seconds(text: str) -> float:
    """Return the time of an option [s]."""
    return number(text, "TIME")


PARSERS = {"HZ": frequency, "S": seconds}
"""Parsers of numbers with these names of a value."""


def option(
    metavar: str | None,
    text: str,
    panel: str | None = None,
    *names: str,
    default: object = None,
    parser: Callable[[str], object] | None = None,
) -> object:
    """Return an option whose help text ends with the default; without `names` it has the name of its field.

    A `metavar` of None is that of a switch, which takes no value.
    """
    told = "" if default is None else rf" \[default: {exactly(default) if isinstance(default, float) else default}]"
    return typer.Option(
        *names, metavar=metavar or "", help=text + told, rich_help_panel=panel, show_default=False,
        parser=parser or PARSERS.get(metavar or ""),
    )  # fmt: skip


def option_field(
    metavar: str | None, text: str, panel: str | None = None, *names: str, default: Any = None, told: object = None
) -> Any:
    """Return an option as a field of a dataclass for `options_of`, which adds what follows from the kind of the field.

    `told` says in words what a default of None is.
    """
    made = option(metavar, text, panel, *names, default=told if default is None else default)
    return field(default=False if metavar is None else default, metadata={OPTION: made})


JsonOption = Annotated[bool, option(None, "Print one JSON object and nothing else.", None, "--json")]
VerboseOption = Annotated[bool, option(None, "Print all details.", None, "--verbose", "-v")]
OWN_PROFILES = "the folder in the environment variable HAPTIC_FIELDBUS_PROFILES"
ProfilesOption = Annotated[
    str | None, option("DIR", "Folder of your own drive profiles.", BENCH, "--profiles", default=OWN_PROFILES)
]
PlotOption = Annotated[Path | None, option("PATH", "File of the picture: .png, .svg or .pdf.", OUTPUT)]


def given_by(options: object, kind: type[Asked]) -> Asked:
    """Return a value of the API made from the options of its fields; omitted options have its defaults.

    Options such as --plot and --json concern the command alone and are not among its fields.
    """
    names = inspect.signature(kind).parameters
    values: Any = {name: value for name, value in vars(options).items() if name in names and value is not None}
    return kind(**values)


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Options of the commands that take a scene: those of `run`; other commands leave out some of them."""

    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="A scene of the library by name, or the path of a scene file.")
    ]
    rate: float | None = option_field("HZ", f"Loop rate in Hz. \\[default: {RATE}]", RENDERING)
    settings: list[str] | None = option_field(
        "ELEMENT.PARAMETER=VALUE", "Set a parameter of the scene; may be repeated.", RENDERING, "--set"
    )
    method: str | None = option_field(
        "NAME", "Integrator of the virtual states, such as rk4; a wrong name lists all.", RENDERING, told=DEFAULT_METHOD
    )
    estimator: str | None = option_field(
        "NAME", "Velocity estimator, such as moving-average:window=4; a wrong name lists all.", RENDERING,
        told=DEFAULT_ESTIMATOR,
    )  # fmt: skip
    as_json: JsonOption = False
    drive: str | None = option_field("PROFILE", "Drive profile by name or path.", BENCH, told=DRIVE)
    bus: str | None = option_field("BUS", BUSES, BENCH, told=DEFAULT_BUS)
    node: int | None = option_field("ID", "Node-ID of the first axis.", BENCH, told=DEFAULT_NODE)
    rig: Path | None = option_field("FILE", "Rig file of your bench; --bus sim simulates it.", BENCH)
    axes: list[str] | None = option_field(
        "SCENE_AXIS=RIG_AXIS", "Assign an axis of the scene to an axis of the rig; may be repeated.", BENCH, "--axis"
    )
    zero: str | None = option_field(
        "here", "Zero is the position of the handle at enabling, instead of the zero of the rig.", BENCH
    )
    profiles: ProfilesOption = None
    duration: float | None = option_field(
        "S", "Duration of the run, from enabling on.", RENDERING, told=DEFAULT_DURATION
    )
    change: list[str] | None = option_field(
        "S:ELEMENT.PARAMETER=VALUE", "Change the scene S seconds after enabling; may be repeated.", RENDERING
    )
    force: bool = option_field(None, "Run above the limit; on a real bus with 5 % of rated torque.", RENDERING)
    fade_in: float = option_field(
        "S", "Time from enabling until the full force limit.", RENDERING, default=DEFAULT_FADE_IN
    )
    hand: str | None = option_field("NAME", HANDS, SIMULATION, told=f"the hand of the scene, or {DEFAULT_HAND}")
    seed: int = option_field("N", "Random seed.", SIMULATION, default=DEFAULT_SEED)
    faults: str | None = option_field(
        "FILE", "File of faults of drive, bus, host and hand; random@SEED draws random ones.", SIMULATION
    )
    prove: bool = option_field(None, "Test the drive watchdogs at zero torque first.", BENCH)
    record: Path | None = option_field(
        "PATH", "Record frames as .log (candump) or .blf, or rows as .csv or .mcap.", OUTPUT
    )
    plot: PlotOption = None
    view: bool = option_field(None, "Show the run on a page in the browser; simulations run in real time.", VIEW)
    view_host: str | None = option_field("HOST", "Serve the page to other computers.", VIEW)
    view_port: int | None = option_field("PORT", "Port of the page.", VIEW, told="8765, or a free one")
    view_required: bool = option_field(None, "End the run when no page shows it any more.", VIEW)
    yes: bool = option_field(None, "Enable a real drive without asking.")
    anonymous: bool = option_field(None, "Leave host, user and paths out of what is recorded.", OUTPUT)
    verbose: VerboseOption = False

    def task(self) -> "Task":
        """Return the scene on its bench; raises one UsageError for options that are malformed or contradict."""
        from haptic_fieldbus.planning.request import Task, parse_axes, parse_settings

        refuse_beside_rig(self.rig, self.drive, self.node)
        # As of a variable of a shell; other empty names have their own message.
        if empty := [name for name in ("drive", "bus") if getattr(self, name) == ""]:
            raise UsageError("\n".join(f"--{name}: empty; expected a name" for name in empty))
        found = replace(self.given(Task), settings=parse_settings(self.settings or []))
        return replace(found, axes=parse_axes(self.axes)) if self.axes else found

    def given(self, kind: type[Asked]) -> Asked:
        """Return a value of the API made from these options, as `given_by` does."""
        return given_by(self, kind)


@dataclass(frozen=True, kw_only=True)
class RunOptions(SceneOptions):
    """Options of `run`: a scene and how it is rendered, or a file that says both."""

    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help="A scene of the library by name, or a scene file.")
    ] = None  # type: ignore[assignment]
    duration: float | None = option_field(
        "S", "Duration of the run, from enabling on; 3600 if a page shows it.", RENDERING, told=DEFAULT_DURATION
    )
    source: Path | None = option_field(
        "FILE", "Repeat the run of a recording, picture or JSON object in simulation.", OUTPUT, "--from"
    )

    def check_source(self) -> None:
        """Raise UsageError for options beside --from that the file decides, and for neither a scene nor a file."""
        if self.source is None:
            if self.scene is None:
                raise UsageError("no scene: expected SCENE or --from FILE")
            return
        beside = ("source", "record", "plot", "as_json", "yes", "anonymous", "verbose", *OF_A_VIEW)
        given = [each.name for each in fields(self) if getattr(self, each.name) != each.default]
        names = {"scene": "SCENE", "settings": "--set", "axes": "--axis"}
        wrong = [names.get(name, f"--{name.replace('_', '-')}") for name in given if name not in beside]
        if wrong:
            raise UsageError(f"--from already sets the whole run; omit {', '.join(wrong)}")


OF_A_BENCH = ("drive", "bus", "node", "rig", "axes", "zero", "profiles")
OF_A_VIEW = ("view", "view_host", "view_port", "view_required")
OF_A_RUN = (
    "duration", "change", "force", "fade_in", "hand", "seed", "faults", "prove", "record", "yes", "anonymous",
    *OF_A_VIEW,
)  # fmt: skip
"""Options of `run` that other commands leave out."""


def refuse_beside_rig(rig: Path | None, drive: str | None, node: int | None) -> None:
    """Raise UsageError for a drive or node-ID beside a rig, which has its own."""
    wrong = [name for name, value in {"--drive": drive, "--node": node}.items() if value is not None]
    if rig is not None and wrong:
        raise UsageError(f"--rig already sets drives and nodes; omit {' and '.join(wrong)}")


def options_of(
    make: Callable[P, Options], without: Collection[str] = ()
) -> Callable[[Callable[[Options], None]], Callable[P, None]]:
    """Return a decorator for a command that takes one dataclass: the fields of `make` become its options.

    Fields that are named in `without` keep their defaults.
    """

    def decorated(command: Callable[[Options], None]) -> Callable[P, None]:
        known = {each.name: each.metadata[OPTION] for each in fields(cast(Any, make)) if OPTION in each.metadata}
        # What follows from the kind of a field: a number is refused in our words, and a switch has no opposite.
        for each in (each for each in fields(cast(Any, make)) if each.name in known):
            if each.type in (float, float | None):
                known[each.name].parser = known[each.name].parser or number
            elif each.type is bool and known[each.name].default is ...:  # where typer keeps the first of given names
                known[each.name].param_decls = (f"--{each.name.replace('_', '-')}",)
        options = [
            each.replace(annotation=Annotated[each.annotation, known[each.name]]) if each.name in known else each
            for each in inspect.signature(make).parameters.values()
            if each.name not in without
        ]

        @wraps(command)
        def call(*args: P.args, **kwargs: P.kwargs) -> None:
            command(make(*args, **kwargs))

        # Typer reads the signature. The sort is stable, and a name outside SHOWN is found at its end: others follow.
        ordered = sorted(options, key=lambda each: (*SHOWN, each.name).index(each.name))
        vars(call)["__signature__"] = inspect.Signature(ordered)
        return call

    return decorated


def note_bitrate(bus: str | None) -> None:
    """Print a note about an assumed bit rate of the bus; none when the bit rate is given or known.

    Raises UsageError for an unknown bus.
    """
    from haptic_fieldbus.protocols.registry import parse_bus

    if bus is not None and (assumed := parse_bus(bus).assumed):
        show([("note", assumed)], sys.stderr)


# Option `--plot`: checked before a command does anything, drawn when it is done.


def check_plot(path: Path | None, name: str = "plot") -> None:
    """Check that the picture can be drawn and its file written; call it before anything moves.

    `name` is that of the option. Raises UsageError that lists all faults.
    """
    from haptic_fieldbus.planning.request import PLOT_SUFFIXES, file_faults

    wrong = file_faults(name, path, PLOT_SUFFIXES)
    if path is not None and find_spec("matplotlib") is None:
        wrong.append(f"--{name} needs matplotlib; in a checkout, run: pip install -e '.[plot]'")
    raise_all(wrong)


def draw(path: Path, figure: "Figure", mark: str, result: object = None) -> None:
    """Write a picture with the mark of its provenance into a file that was checked before.

    Raises HapticFieldbusError when it cannot be written, with a `result` that was printed already.
    """
    from haptic_fieldbus.report.drawing import save

    try:
        save(figure, path, mark)
    except OSError as error:
        raise not_written("plot", path, error, result) from error


def not_written(option: str, path: Path, error: OSError, result: object = None) -> HapticFieldbusError:
    """Return the error for a file that was checked before the command and cannot be written after it."""
    found = HapticFieldbusError(f'{option} "{path}": cannot be written: {error.strerror or error}')
    found.result = result
    return found
