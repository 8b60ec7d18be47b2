"""`profiles`: what the drive profiles say, and where each value comes from."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import JsonOption
from haptic_fieldbus.cli.screen import plain, print_json, show, show_table

if TYPE_CHECKING:
    from haptic_fieldbus.drive.profile import DriveProfile

app = typer.Typer(help="The drive profiles: list, show, check.", no_args_is_help=True)

SECTIONS = ("identity", "torque", "position", "pdo", "link_loss", "timing")
IN_HEXADECIMAL = ("object", "heartbeat_consumer", "vendor_id", "product_codes")


@app.command("list")
def list_profiles(as_json: JsonOption = False) -> None:
    """List the profiles that are shipped."""
    from haptic_fieldbus.drive.catalogue import profile_summaries

    summaries = profile_summaries()
    if as_json:
        print_json({"profiles": plain(summaries)})
        return
    headings = ("name", "drive", "protocol", "usable", "evidence")
    show_table(
        headings,
        (
            (
                str(summary["name"]),
                f"{summary['vendor']} {summary['model']}",
                str(summary["protocol"]),
                "yes" if summary["usable"] else "no",
                str(summary["evidence"]),
            )
            for summary in summaries
        ),
    )


@app.command("show")
def show_profile(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A profile by name, or the path of its file.")],
    as_json: JsonOption = False,
) -> None:
    """Show a profile: each value with its source."""
    from haptic_fieldbus.drive.catalogue import load_profile

    profile = load_profile(name)
    if as_json:
        print_json(asdict(profile, dict_factory=lambda pairs: {key: plain(value) for key, value in pairs}))
        return
    usable = "usable" if profile.drive.usable else "not usable for force"
    show([(None, f"{profile.title} · {profile.drive.protocol} · {usable} · evidence: {profile.drive.evidence}")])
    show([(None, profile.source), (None, "")])
    width = max(len(key) for key, _, _ in _rows(profile))
    for key, value, source in _rows(profile):
        show([(None, f"{key:{width}}  {value}"), ("", source)])


@app.command("check")
def check_profiles(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Names or paths; all shipped ones unless given.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check profiles: all faults of each file, with line and key."""
    from haptic_fieldbus.cli.checking import check
    from haptic_fieldbus.drive.catalogue import load_profile, profile_names

    check(names or profile_names(), load_profile, as_json)


def _rows(profile: "DriveProfile") -> Iterator[tuple[str, str, str]]:
    for section in SECTIONS:
        for key, value in vars(getattr(profile, section)).items():
            if value not in (None, ()):
                name = f"{section}.{key}"
                yield name, _text(key, value), _source(name, profile.sources)


def _source(name: str, sources: Mapping[str, str]) -> str:
    """That of the key, of what it holds, or of its section."""
    inner = "; ".join(text for key, text in sources.items() if key.startswith(f"{name}."))
    return sources.get(name) or inner or sources.get(name.partition(".")[0], "default")


def _text(key: str, value: object) -> str:
    """A value as people write it: indices and identities in hexadecimal."""
    if is_dataclass(value):
        parts = {
            name: member for name, member in vars(value).items() if member != "" and (name, member) != ("subindex", 0)
        }
        texts = [_text(name, member) if name != "value" else f"= {member}" for name, member in parts.items()]
        return " ".join(texts)
    if isinstance(value, tuple):
        return ", ".join(_text(key, member) for member in value)
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, int) and key in IN_HEXADECIMAL:
        return f"{value:04X}h"
    return f"{value:g}" if isinstance(value, float) else str(value)
