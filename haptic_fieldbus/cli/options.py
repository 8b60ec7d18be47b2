"""The options that commands share, each declared once, and the value of the API that they make together."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ParamSpec, TypeVar

import typer

from haptic_fieldbus.defaults import DEFAULT_BUS, DEFAULT_DRIVE, DEFAULT_NODE, DEFAULT_RATE
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly

if TYPE_CHECKING:
    from haptic_fieldbus.planning.task import Rendering

P = ParamSpec("P")
Options = TypeVar("Options")
Asked = TypeVar("Asked", bound="Rendering")

BENCH, RENDERING, SIMULATION, OUTPUT = "Bench", "Rendering", "Simulation", "Output"
SHOWN = (
    "scene", "input", "amplitude", "drive", "bus", "node", "rig",
    "rate", "duration", "settings", "change", "method", "estimator",
)  # fmt: skip
"""The first options of the help, in their order; others follow as their command lists them."""


HANDS = "push, tap, sine, guide, release or none."


def option(
    metavar: str | None, text: str, panel: str | None = None, *names: str, default: float | str | None = None
) -> object:
    """An option with its help, which ends with the default; without names it is called as its field."""
    told = "" if default is None else rf" \[default: {exactly(default) if isinstance(default, float) else default}]"
    return typer.Option(*names, metavar=metavar, help=text + told, rich_help_panel=panel, show_default=False)


JsonOption = Annotated[bool, option(None, "Print one JSON object and nothing else.", None, "--json")]


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """A scene and how it is rendered."""

    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="A scene of the library by name, or the path of a scene file.")
    ]
    rate: Annotated[float, option("HZ", "Periods a second.", RENDERING, default=DEFAULT_RATE)] = DEFAULT_RATE
    settings: Annotated[
        list[str] | None,
        option("ELEMENT.PARAMETER=VALUE", "Change the scene; may be repeated.", RENDERING, "--set"),
    ] = None
    method: Annotated[str | None, option("NAME", "Integrator of virtual states.", RENDERING)] = None
    estimator: Annotated[str | None, option("NAME", "Velocity estimator.", RENDERING)] = None
    as_json: JsonOption = False

    def given(self, kind: type[Asked]) -> Asked:
        """The value of the API; what was not given is left to its defaults. Raises UsageError."""
        from haptic_fieldbus.planning.request import parse_settings

        names = {field.name for field in fields(kind)}
        values = {name: value for name, value in vars(self).items() if name in names and value is not None}
        return kind(**{**values, "settings": parse_settings(self.settings or [])})


@dataclass(frozen=True, kw_only=True)
class BenchOptions(SceneOptions):
    """A scene on a bench."""

    drive: Annotated[str | None, option("PROFILE", "Drive profile by name or path.", BENCH, default=DEFAULT_DRIVE)] = (
        None
    )
    bus: Annotated[
        str | None,
        option("BUS", "sim@BITRATE, or INTERFACE:CHANNEL@BITRATE such as socketcan:can0.", BENCH, default=DEFAULT_BUS),
    ] = None
    node: Annotated[int | None, option("ID", "Node-ID of the first axis.", BENCH, default=DEFAULT_NODE)] = None
    rig: Annotated[Path | None, option("FILE", "Rig file: your bench. --bus sim simulates it.", BENCH)] = None

    def given(self, kind: type[Asked]) -> Asked:
        """As for a scene; options that exclude one another are refused."""
        named = {"--drive": self.drive, "--node": self.node}
        wrong = [name for name, value in named.items() if value is not None]
        if self.rig is not None and wrong:
            raise UsageError(f"--rig says which drives and nodes there are; leave out {' and '.join(wrong)}")
        return super().given(kind)


def options_of(make: Callable[P, Options]) -> Callable[[Callable[[Options], None]], Callable[P, None]]:
    """Decorate a command of one value: the fields of `make` are its options, in the order of `SHOWN`."""

    def decorated(command: Callable[[Options], None]) -> Callable[P, None]:
        options = inspect.signature(make).parameters.values()

        @wraps(command)
        def call(*args: P.args, **kwargs: P.kwargs) -> None:
            command(make(*args, **kwargs))

        ordered = sorted(options, key=lambda each: (*SHOWN, each.name).index(each.name))
        vars(call)["__signature__"] = inspect.Signature(ordered)
        return call

    return decorated


def note_assumed_bitrate(bus: str | None) -> list[tuple[str, str]]:
    """A line about a bit rate that nobody told and no interface tells."""
    from haptic_fieldbus.protocols.registry import parse_bus

    assumed = "" if bus is None else parse_bus(bus).assumed
    return [("note", assumed)] if assumed else []
