"""Commands `profiles list|show|check|new`: the drive profiles, and the source of each value."""

import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from datetime import datetime
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import JsonOption, ProfilesOption
from haptic_fieldbus.cli.screen import FAULTY, check_files, faults_to_json, faults_told, print_json, show, show_table
from haptic_fieldbus.errors import EdsError, UsageError
from haptic_fieldbus.numerals import exactly

if TYPE_CHECKING:
    from haptic_fieldbus.drive.profile import DriveProfile
    from haptic_fieldbus.protocols.canopen.eds_check import Comparison


# The parts of `profiles check` and `profiles new` that read a vendor's EDS.

UNUSABLE = 4
"""Exit status for a drive that cannot be used for force: refused before torque."""


def check_against(name: str, eds: Path, profiles: str | None, as_json: bool) -> None:
    """Compare a profile with a vendor's file and print agreements and differences.

    Raises `typer.Exit` with status 2 when the file shows a fault of the profile.
    """
    from haptic_fieldbus.eds import load_eds
    from haptic_fieldbus.protocols.canopen.profile import canopen_profile
    from haptic_fieldbus.protocols.catalogue import load_profile
    from haptic_fieldbus.sim.canopen.eds_proof import proof_of

    found = proof_of(canopen_profile(load_profile(name, profiles)), load_eds(eds))
    if as_json:
        known = [vars(each.fault) | {"reason": each.reason} for each in found.known]
        print_json({
            "errors": faults_to_json((str(eds), fault) for fault in found.faults),
            "known": [{key: each[key] for key in ("key", "line", "message", "reason")} for each in known],
            "agreed": [{"key": each.key, "line": each.line, "shows": each.shows} for each in found.agreed],
        })  # fmt: skip
    else:
        _show(name, eds, found)
    if found.faults:
        raise typer.Exit(FAULTY)


def _show(name: str, eds: Path, found: "Comparison") -> None:
    rows = ((each.key, each.shows, "" if each.line is None else str(each.line)) for each in found.agreed)
    show_table(("key", "the file has", "line"), rows)
    for known in found.known:
        show([(None, ""), (None, f"known difference: {known.fault}"), (None, f"  {known.reason}")])
    if found.faults:
        show([(None, "")])
        show((None, f"{eds}: {fault}") for fault in found.faults)
    counts = f"{_count(len(found.agreed), 'value')} of {name} in {found.source}"
    differing = f", {_count(len(found.known), 'difference')} with a reason" if found.known else ""
    show([(None, ""), (None, f"{counts}{differing}, {_count(len(found.faults), 'fault')}")])


def _count(count: int, noun: str) -> str:
    return f"{count or 'no'} {noun}{'' if count == 1 else 's'}"


def _name(title: str) -> str:
    """Return a name for a profile: the letters and digits of vendor and model."""
    return re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_") or "drive"


def _write(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8", newline="") as file:  # the line ends of an EDS are those of its format
            file.write(text)
    except FileExistsError as error:
        raise UsageError(f"{path} exists; name another file") from error
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}") from error


app = typer.Typer(help="List, show, check and draft drive profiles: what a drive model offers.", no_args_is_help=True)

OF_EDS = ("eds", "lacks")
"""Fields of a profile that an object of JSON leaves out."""
# Order of the sections in `profiles show`.
SECTIONS = (
    "line", "identity", "serial", "power", "torque", "position", "velocity", "mode", "pdo", "setup", "sync",
    "commissioning", "watchdog", "link_loss", "timing", "simulation",
)  # fmt: skip
IN_HEXADECIMAL = (
    "object", "heartbeat_consumer", "interpolation_time", "cycle_period", "vendor_id", "product_codes", "absent",
    "supported_modes", "controlword", "address", "mask", "bits", "readable",
    "maps",
)  # fmt: skip
"""Keys whose whole numbers are written as in vendors' manuals: indices, identities and bit fields."""


@app.command("list")
def list_profiles(profiles: ProfilesOption = None, as_json: JsonOption = False) -> None:
    """List the shipped profiles and your own. A broken profile is reported; the others are listed."""
    from haptic_fieldbus.protocols.catalogue import profile_summaries

    found = profile_summaries(profiles)
    summaries = [each for each in found.values() if isinstance(each, dict)]
    faults = [told for name, each in found.items() if not isinstance(each, dict) for told in faults_told(name, each)]
    if as_json:
        print_json({"profiles": summaries, "errors": faults_to_json(faults)})
        return
    show_table(("name", "drive", "protocol", "usable", "evidence", "from"), map(_row, summaries))
    show([("fault", f"{source}: {fault}") for source, fault in faults], sys.stderr)


def _row(summary: Mapping[str, str | bool]) -> tuple[str, ...]:
    """Return the cells of a profile in the list."""
    from haptic_fieldbus.protocols.catalogue import profile_folder

    source = Path(str(summary["source"]))
    return (
        str(summary["name"]),
        f"{summary['vendor']} {summary['model']}",
        str(summary["protocol"]),
        "yes" if summary["usable"] else "no",
        str(summary["evidence"]),
        "shipped" if source.parent == profile_folder() else str(source),
    )


@app.command("show")
def show_profile(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A profile by name, or the path of its file.")],
    eds: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the EDS of the simulated drive, for other CANopen programs."),
    ] = None,
    profiles: ProfilesOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show each value of a profile with its source. For the path of a vendor's EDS, show the profile made from it."""
    from haptic_fieldbus.protocols.catalogue import load_profile

    profile = load_profile(name, profiles)
    if eds is not None:
        _write_eds(profile, eds)
    if as_json:
        # Without the vendor's EDS from which the profile may have been made.
        print_json({each.name: getattr(profile, each.name) for each in fields(profile) if each.name not in OF_EDS})
        return
    if eds is not None:
        show([(None, f"{eds}: the EDS of the simulated {profile.title}")])
        return
    reason = profile.sources.get("drive.usable", "no reason given")
    usable = "usable" if profile.drive.usable else f"not usable for force: {reason}"
    show([(None, f"{profile.title} · {profile.drive.protocol} · {usable} · evidence: {profile.drive.evidence}")])
    if not profile.drive.usable:
        show([(None, f"not usable because {profile.sources['drive.usable']}")])
    show([(None, profile.source), (None, "")])
    width = max(len(key) for key, _, _ in _rows(profile))
    for key, value, source in _rows(profile):
        show([(None, f"{key:{width}}  {value}"), ("", source)])


@app.command("check")
def check_profiles(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Names or paths; default: all shipped profiles and your own."),
    ] = None,
    eds: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Compare one profile with the EDS or DCF of its vendor.")
    ] = None,
    profiles: ProfilesOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check profiles or vendors' EDS files, and list all faults of each with line and key."""
    from haptic_fieldbus.protocols.catalogue import known_names

    if eds is not None:
        if not names or len(names) != 1:
            raise UsageError("--eds FILE compares one profile: give its name or path first")
        check_against(names[0], eds, profiles, as_json)
        return
    check_files(names or known_names(profiles), partial(_check_profile, profiles), as_json)


def _check_profile(profiles: str | None, name: str) -> None:
    """Load a profile; raises DocumentError or UsageError.

    A profile can be made from an EDS with faults in parts that it does not need. Here all faults of an EDS count.
    """
    from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile
    from haptic_fieldbus.protocols.catalogue import load_profile

    profile = load_profile(name, profiles)
    if isinstance(profile, EdsProfile) and profile.faults():
        raise EdsError(name, profile.faults())


@app.command("new")
def new_profile(
    eds: Annotated[Path, typer.Option(metavar="FILE", help="The EDS or DCF of the drive's vendor.")],
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the profile; default: that of --output, otherwise from the EDS."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write (.toml); default: NAME.toml in this folder.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draft a profile from a vendor's EDS: each value with its section; values that no EDS contains are marked assumed.

    The exit status is 4 if the drive cannot be used for force; the command prints the reason and writes the draft.
    """
    from haptic_fieldbus.documents import is_path
    from haptic_fieldbus.eds import load_eds
    from haptic_fieldbus.protocols.canopen.from_eds import draft_of, profile_from_eds

    profile = profile_from_eds(load_eds(eds))
    if name is not None and (is_path(name) or not name or (output is not None and output.stem != name)):
        raise UsageError(f'--name "{name}": expected a name such as {_name(profile.title)}, equal to that of --output')
    path = output or Path(f"{name or _name(profile.title)}.toml")
    if path.suffix != ".toml":
        raise UsageError(f"--output {path}: expected the path of a .toml file")
    draft = draft_of(profile, eds.name)
    _write(path, draft.text)
    if as_json:
        print_json({"file": path, "name": path.stem, "usable": profile.drive.usable, "assumed": draft.assumed})
    else:
        known = f"{draft.known} values from {eds.name} and the standards, {len(draft.assumed)} assumed"
        show([(None, f"{path}: {known}")])
        show_table(("assumed", "value"), ((each.key, each.value) for each in draft.assumed))
        show([(None, f"Next: find these values, then run haptic-fieldbus profiles check {path} --eds {eds}")])
    if not profile.drive.usable:
        show([("fault", f"not usable for force: {profile.sources['drive.usable']}")], sys.stderr)
        raise typer.Exit(UNUSABLE)


def _write_eds(profile: "DriveProfile", path: Path) -> None:
    """Write the EDS of the profile's simulated drive; raises UsageError when the file cannot be written."""
    from haptic_fieldbus.eds import eds_text
    from haptic_fieldbus.sim.canopen.simulated_eds import sheet

    now = datetime.now().astimezone()
    made = {
        "FileName": path.name,
        "FileVersion": "1",
        "FileRevision": "0",
        "EDSVersion": "4.0",
        "Description": f"Simulated {profile.title}",
        "CreationTime": f"{now:%I:%M%p}",
        "CreationDate": f"{now:%m-%d-%Y}",
        "CreatedBy": "haptic-fieldbus",
    }
    _write(path, eds_text(replace(sheet(profile), file_info=made)))


def _rows(profile: "DriveProfile") -> Iterator[tuple[str, str, str]]:
    """Yield key, value and source of each value that is stated or differs from its default."""
    for section in SECTIONS:
        table = getattr(profile, section, None)
        if table and not is_dataclass(table):  # rows of registers
            yield section, _text(section, table), _source(section, profile.sources)
        for field in fields(table) if is_dataclass(table) else ():
            name, value = f"{section}.{field.name}", getattr(table, field.name)
            if value not in (None, (), {}) and value is not False and _is_told(name, value, field, profile.sources):
                # The objects of a simulated drive fill screens: its EDS shows them (--eds).
                text = f"{len(value)} entries" if isinstance(value, dict) else _text(field.name, value)
                yield name, text, _source(name, profile.sources)


def _is_told(name: str, value: object, field: "Field[object]", sources: Mapping[str, str]) -> bool:
    """Return whether a value is shown: it has a source of its own, or differs from its default."""
    own = any(key == name or key.startswith(f"{name}.") for key in sources)
    return own or value != (field.default if field.default_factory is MISSING else field.default_factory())


def _source(name: str, sources: Mapping[str, str]) -> str:
    """Return the source of a key: its own, or those of its inner keys, or that of its section, or nothing."""
    inner = "; ".join(text for key, text in sources.items() if key.startswith(f"{name}."))
    return sources.get(name) or inner or sources.get(name.partition(".")[0], "")


def _text(key: str, value: object) -> str:
    """Return a value as people write it, with indices and identities in hexadecimal."""
    if is_dataclass(value):
        return " ".join(_member(name, member) for name, member in vars(value).items() if _is_said(name, member))
    if isinstance(value, Mapping):
        return ", ".join(map(str, value))
    if isinstance(value, tuple):
        return ", ".join(_text(key, member) for member in value)
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, int) and key in IN_HEXADECIMAL:
        return f"{value:04X}h"
    return exactly(value) if isinstance(value, float) else str(value)


def _is_said(name: str, member: object) -> bool:
    """Return whether a member of an object is shown; sub-index 0 is left out, as most objects have no other."""
    return member not in ("", None) and member is not False and (name, member) != ("subindex", 0)


def _member(name: str, member: object) -> str:
    """Return a member of an object as people write it beside the others."""
    if name == "subindex":
        return f":{member:02X}"
    if member is True:
        return name
    return f"= {member}" if name == "value" else _text(name, member)
