"""The options that commands share, each declared once, and the value of the API that they make together."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ParamSpec, TypeVar

import typer

from haptic_fieldbus.errors import UsageError

if TYPE_CHECKING:
    from haptic_fieldbus.planning.task import Rendering

P = ParamSpec("P")
Options = TypeVar("Options")
Asked = TypeVar("Asked", bound="Rendering")

BENCH, RENDERING, SIMULATION, OUTPUT = "Bench", "Rendering", "Simulation", "Output"
SHOWN = (
    "scene", "input", "amplitude", "drive", "bus", "node", "rig", "profiles",
    "rate", "duration", "settings", "change", "method", "estimator",
)  # fmt: skip
"""The first options of the help, in their order; others follow as their command lists them."""


def option(metavar: str | None, text: str, panel: str | None = None, *names: str) -> object:
    """An option with its help; without names it is called as its field."""
    return typer.Option(*names, metavar=metavar, help=text, rich_help_panel=panel)


JsonOption = Annotated[bool, option(None, "Print one JSON object and nothing else.", None, "--json")]
ProfilesOption = Annotated[
    str | None,
    option("DIR", r"Folder of your own drive profiles. \[default: HAPTIC_FIELDBUS_PROFILES]", BENCH, "--profiles"),
]


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """A scene and how it is rendered."""

    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="A scene of the library by name, or the path of a scene file.")
    ]
    rate: Annotated[float, option("HZ", r"Periods a second. \[default: 1000]", RENDERING)] = 1000.0
    settings: Annotated[
        list[str] | None,
        option("ELEMENT.PARAMETER=VALUE", "Change the scene; may be repeated.", RENDERING, "--set"),
    ] = None
    method: Annotated[str | None, option("NAME", "Integrator of virtual states.", RENDERING)] = None
    estimator: Annotated[str | None, option("NAME", "Velocity estimator.", RENDERING)] = None
    as_json: JsonOption = False

    def given(self, asked: type[Asked]) -> Asked:
        """The value of the API; what was not given is left to its defaults. Raises UsageError."""
        from haptic_fieldbus.planning.request import parse_settings

        names = {field.name for field in fields(asked)}
        values = {name: value for name, value in vars(self).items() if name in names and value is not None}
        return asked(**{**values, "settings": parse_settings(self.settings or [])})


@dataclass(frozen=True, kw_only=True)
class BenchOptions(SceneOptions):
    """A scene on a bench."""

    drive: Annotated[
        str | None, option("PROFILE", r"Drive profile by name or path. \[default: maxon_epos4]", BENCH)
    ] = None
    bus: Annotated[
        str | None,
        option("BUS", r"sim@BITRATE, or INTERFACE:CHANNEL@BITRATE such as socketcan:can0. \[default: sim]", BENCH),
    ] = None
    node: Annotated[int | None, option("ID", r"Node-ID of the first axis. \[default: 1]", BENCH)] = None
    rig: Annotated[Path | None, option("FILE", "Rig file: your bench. --bus sim simulates it.", BENCH)] = None
    profiles: ProfilesOption = None

    def given(self, asked: type[Asked]) -> Asked:
        """As for a scene; options that exclude one another are refused."""
        named = {"--drive": self.drive, "--node": self.node}
        wrong = [name for name, value in named.items() if value is not None]
        if self.rig is not None and wrong:
            raise UsageError(f"--rig says which drives and nodes there are; leave out {' and '.join(wrong)}")
        return super().given(asked)


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
