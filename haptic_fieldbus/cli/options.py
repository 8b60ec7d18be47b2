"""The options that commands share, and the selection that they make together."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from haptic_fieldbus.errors import UsageError

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="A scene of the library by name, or the path of a scene file.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]

BENCH = "Bench"
DriveOption = Annotated[
    str | None,
    typer.Option(
        metavar="PROFILE", help=r"Drive profile by name or path. \[default: maxon_epos4]", rich_help_panel=BENCH
    ),
]
BusOption = Annotated[
    str | None,
    typer.Option(
        metavar="BUS",
        help=r"sim@BITRATE, or INTERFACE:CHANNEL@BITRATE such as socketcan:can0. \[default: sim]",
        rich_help_panel=BENCH,
    ),
]
NodeOption = Annotated[
    int | None, typer.Option(metavar="ID", help=r"Node-ID of the first axis. \[default: 1]", rich_help_panel=BENCH)
]
RigOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Rig file: your bench. --bus sim simulates it.", rich_help_panel=BENCH),
]

RENDERING = "Rendering"
RateOption = Annotated[
    float, typer.Option(metavar="HZ", help=r"Periods a second. \[default: 1000]", rich_help_panel=RENDERING)
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="ELEMENT.PARAMETER=VALUE", help="Change the scene; may be repeated.", rich_help_panel=RENDERING
    ),
]
ChangeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--change",
        metavar="S:ELEMENT.PARAMETER=VALUE",
        help="Change the scene while it runs, S seconds from enabling on; may be repeated.",
        rich_help_panel=RENDERING,
    ),
]
MethodOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Integrator of virtual states.", rich_help_panel=RENDERING)
]
EstimatorOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Velocity estimator.", rich_help_panel=RENDERING)
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Go on although the loop would be unstable.", rich_help_panel=RENDERING)
]


class Selected(TypedDict, total=False):
    """What `run` and `plan` of the API take alike; what was not given is left to their defaults."""

    rig: Path
    drive: str
    bus: str
    node: int
    rate: float
    settings: dict[str, str]
    method: str
    estimator: str


@dataclass
class Selection:
    """The options of a scene on a bench, as given."""

    drive: str | None = None
    bus: str | None = None
    node: int | None = None
    rig: Path | None = None
    rate: float = 1000.0
    settings: list[str] | None = field(default=None)
    method: str | None = None
    estimator: str | None = None

    def arguments(self) -> Selected:
        """For the API; raises UsageError for options that exclude one another."""
        from haptic_fieldbus.request import parse_settings

        if self.rig is not None:
            named = {"--drive": self.drive, "--node": self.node}
            given = [option for option, value in named.items() if value is not None]
            if given:
                raise UsageError(f"--rig says which drives and nodes there are; leave out {' and '.join(given)}")
        values = {**vars(self), "settings": parse_settings(self.settings or [])}
        selected: Selected = {name: value for name, value in values.items() if value is not None}  # type: ignore[assignment]
        return selected


def note_assumed_bitrate(bus: str | None) -> list[tuple[str, str]]:
    """A line about a bit rate that nobody told and no interface tells."""
    from haptic_fieldbus.request import parse_bus

    if bus is None or parse_bus(bus).bitrate_known:
        return []
    return [("note", f"the bit rate of {bus} is not known; 1 Mbit/s is assumed. Give it as {bus}@BITRATE")]
