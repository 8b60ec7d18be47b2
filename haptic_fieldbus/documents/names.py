"""Shipped files by name, and suggestions for names that do not exist."""

import difflib
from collections.abc import Iterable
from pathlib import Path

from haptic_fieldbus.errors import UsageError, wrong_kind

LISTED = 12
"""Longest list of names shown if none is similar; a longer one would hide the message."""

COMPARED = 200
"""Largest number of compared names, and of letters of a name; the time grows with the product of lengths."""

_EDS_SUFFIXES = (".eds", ".dcf")
_SUFFIXES = (".toml", *_EDS_SUFFIXES)


def nearest(name: str, names: Iterable[str]) -> list[str]:
    """Return up to three of `names` that are similar to `name` or contain it, the nearest first."""
    # In reverse, so that of names that differ in case alone the first stays.
    by_lower = {candidate.lower(): candidate for candidate in sorted(names, reverse=True)[-COMPARED:]}
    wanted = name.lower()[:COMPARED]
    close = difflib.get_close_matches(wanted, by_lower, n=3, cutoff=0.6)
    containing = sorted(lower for lower in by_lower if len(wanted) > 2 and wanted in lower and lower not in close)
    return [by_lower[lower] for lower in (close + containing)[:3]]


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown name: similar names, otherwise all if they are few, or nothing."""
    known = sorted(names)
    if near := nearest(name, known):
        return f"; nearest: {', '.join(near)}"
    return f"; known: {', '.join(known)}" if 0 < len(known) <= LISTED else ""


def file_names(folder: Path) -> list[str]:
    """Return the names of the TOML files in a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def is_path(name: str | Path) -> bool:
    """Return True for the path of a file, False for the name of a shipped file; raises TypeError for neither."""
    if not isinstance(name, str | Path):
        raise wrong_kind("name", "a name or a path", name)
    return isinstance(name, Path) or name.lower().endswith(_SUFFIXES) or "/" in name or "\\" in name


def is_eds(name: str | Path) -> bool:
    """Return whether `name` is the name of an EDS or DCF."""
    return str(name).lower().endswith(_EDS_SUFFIXES)


def file_of(kind: str, name: str | Path, folder: Path, others: Iterable[str] = ()) -> Path:
    """Return the file of a shipped profile or scene (`kind`), or the path itself when `name` is one.

    Raises UsageError if `folder` has no such file; it suggests names from the folder and from `others`.
    """
    if is_path(name):
        return Path(name)
    names = file_names(folder)
    if name not in names:
        file, at, node = str(name).partition("@")
        if kind == "profile" and at and node.isdecimal():
            raise UsageError(f'no {kind} "{name}"; the node has an option of its own: --drive {file} --node {node}')
        listed = f"To list them: haptic-fieldbus {kind}s list"
        raise UsageError(f'no {kind} "{name}"{suggestion(str(name), {*names, *others})}. {listed}')
    return folder / f"{name}.toml"


def beside(path: Path, name: str, *folders: Path) -> Path:
    """Return the file that the file at `path` names: inside its folder, or inside one of `folders`.

    A foreign file must not read other files of this computer. Links are followed before the folders are compared.
    Raises UsageError for a name that leads out of these folders.
    """
    allowed = (path.resolve().parent, *folders)
    try:
        found = (allowed[0] / name).resolve()
    except (OSError, ValueError, RuntimeError):  # a circle of links, a NUL
        found = Path(name)
    if Path(name).is_absolute() or not any(found.is_relative_to(folder) for folder in allowed):
        raise UsageError(f'no file "{name}" in the folder of this file or below')
    return found
