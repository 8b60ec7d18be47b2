"""Shipped files by name, and suggestions for names that do not exist."""

import difflib
from collections.abc import Iterable
from pathlib import Path

from haptic_fieldbus.errors import UsageError

LISTED = 12
"""The longest list of names that is shown when none is near; a longer one would hide the message."""

_EDS_SUFFIXES = (".eds", ".dcf")
_SUFFIXES = (".toml", *_EDS_SUFFIXES)


def nearest(name: str, names: Iterable[str]) -> list[str]:
    """Return up to three of `names` that are similar to `name` or contain it, the nearest first."""
    # In reverse, so that of names that differ in case alone the first stays.
    by_lower = {candidate.lower(): candidate for candidate in sorted(names, reverse=True)}
    wanted = name.lower()
    close = difflib.get_close_matches(wanted, by_lower, n=3, cutoff=0.6)
    containing = sorted(lower for lower in by_lower if len(wanted) > 2 and wanted in lower and lower not in close)
    return [by_lower[lower] for lower in (close + containing)[:3]]


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown name: the nearest names, else all if they are few, else nothing."""
    known = sorted(names)
    near = nearest(name, known)
    if near:
        return f"; nearest: {', '.join(near)}"
    return f"; known: {', '.join(known)}" if 0 < len(known) <= LISTED else ""


def file_names(folder: Path) -> list[str]:
    """Return the names of the TOML files in a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def is_path(name: str | Path) -> bool:
    """Return whether `name` is the path of a file, and not the name of a shipped one."""
    return isinstance(name, Path) or name.lower().endswith(_SUFFIXES) or "/" in name or "\\" in name


def is_eds(name: str | Path) -> bool:
    """Return whether `name` is that of an EDS or DCF."""
    return str(name).lower().endswith(_EDS_SUFFIXES)


def file_of(kind: str, name: str | Path, folder: Path, others: Iterable[str] = ()) -> Path:
    """Return the file of a shipped profile or scene (`kind`), or the path itself when `name` is one.

    Raises UsageError when `folder` has no such file; the sentence suggests names of the folder and of `others`.
    """
    if is_path(name):
        return Path(name)
    names = file_names(folder)
    if name not in names:
        listed = f"{kind.capitalize()}s are listed by: haptic-fieldbus {kind}s list"
        raise UsageError(f'no {kind} "{name}"{suggestion(str(name), {*names, *others})}. {listed}')
    return folder / f"{name}.toml"
