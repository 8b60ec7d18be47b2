"""The parts of `profiles check` and `profiles new` that read a vendor's EDS."""

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from haptic_fieldbus.cli.checking import FAULTY, faults_to_json
from haptic_fieldbus.cli.screen import plain, print_json, show, show_table
from haptic_fieldbus.errors import UsageError

UNUSABLE = 4
"""Exit status for a drive that cannot be used for force: refused before torque."""

if TYPE_CHECKING:
    from haptic_fieldbus.protocols.canopen.vendor.check import Comparison
    from haptic_fieldbus.protocols.canopen.vendor.draft import Draft


def check_against(name: str, eds: Path, profiles: str | None, as_json: bool) -> None:
    """Compare a profile with a vendor's file and print what agrees and what does not.

    Raises `typer.Exit` with status 2 when the file shows a fault of the profile.
    """
    from haptic_fieldbus.eds import load_eds
    from haptic_fieldbus.protocols.canopen.profile import canopen_profile
    from haptic_fieldbus.protocols.catalogue import load_profile
    from haptic_fieldbus.sim.canopen.proof import proof_of

    found = proof_of(canopen_profile(load_profile(name, profiles)), load_eds(eds))
    if as_json:
        print_json(
            {
                "errors": plain(faults_to_json((str(eds), fault) for fault in found.faults)),
                "known": [
                    {"key": each.fault.key, "line": each.fault.line, "message": each.fault.message,
                     "reason": each.reason} for each in found.known
                ],
                "agreed": [{"key": each.key, "line": each.line, "shows": each.shows} for each in found.agreed],
            }
        )  # fmt: skip
    else:
        _show(name, eds, found)
    if found.faults:
        raise typer.Exit(FAULTY)


def _show(name: str, eds: Path, found: "Comparison") -> None:
    rows = ((each.key, each.shows, "" if each.line is None else str(each.line)) for each in found.agreed)
    show_table(("key", "the file has", "line"), rows)
    for known in found.known:
        show([(None, ""), (None, f"differs, as the profile says: {known.fault}"), (None, f"  {known.reason}")])
    if found.faults:
        show([(None, "")])
        show((None, f"{eds}: {fault}") for fault in found.faults)
    counts = f"{_count(len(found.agreed), 'value')} of {name} in {found.source}"
    differing = f", {_count(len(found.known), 'difference')} with a reason" if found.known else ""
    show([(None, ""), (None, f"{counts}{differing}, {_count(len(found.faults), 'fault')}")])


def _count(count: int, noun: str) -> str:
    return f"{count or 'no'} {noun}{'' if count == 1 else 's'}"


def write_draft(eds: Path, name: str | None, output: Path | None, as_json: bool) -> None:
    """Write the profile that a vendor's file describes, and print what the file cannot know.

    Raises UsageError for a name that is none, and when the file is there already or cannot be written, and `typer.Exit`
    with status 4 for a drive that cannot be used for force.
    """
    from haptic_fieldbus.documents import is_path
    from haptic_fieldbus.eds import load_eds
    from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
    from haptic_fieldbus.protocols.canopen.vendor.draft import draft_of

    profile = profile_from_eds(load_eds(eds))
    if name is not None and (is_path(name) or not name or (output is not None and output.stem != name)):
        raise UsageError(f'--name "{name}": expected a name such as {_name(profile.title)}, and that of --output')
    path = output or Path(f"{name or _name(profile.title)}.toml")
    if path.suffix != ".toml":
        raise UsageError(f"--output {path}: expected the path of a .toml file")
    draft = draft_of(profile, eds.name)
    _write(path, draft.text)
    if as_json:
        assumed = [{"key": each.key, "value": each.value, "why": each.why} for each in draft.assumed]
        usable = profile.drive.usable
        print_json({"file": str(path), "name": path.stem, "usable": usable, "assumed": plain(assumed)})
    else:
        _tell(path, eds, draft)
    if not profile.drive.usable:
        show([("fault", f"not usable for force: {profile.sources['drive.usable']}")], sys.stderr)
        raise typer.Exit(UNUSABLE)


def _name(title: str) -> str:
    """Return a name for a profile: the letters and digits of vendor and model."""
    return re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_") or "drive"


def _write(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise UsageError(f"{path} is there already; give another --name or --output") from error
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}") from error


def _tell(path: Path, eds: Path, draft: "Draft") -> None:
    """Print what was written, what was assumed, and what comes next."""
    show([(None, f"{path}: {draft.known} values from {eds.name} and the standards, {len(draft.assumed)} assumed")])
    show_table(("assumed", "value"), ((each.key, each.value) for each in draft.assumed))
    show([(None, f"Next: find these out, then haptic-fieldbus profiles check {path} --eds {eds}")])
