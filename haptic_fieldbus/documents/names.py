"""Shipped files by name, and suggestions for names that do not exist."""

import difflib
from collections.abc import Iterable
from pathlib import Path

from haptic_fieldbus.errors import UsageError, wrong_kind

LISTED = 12
"""The longest list of names that is shown when none is near; a longer one would hide the message."""

COMPARED = 200
"""Most names, and most letters of one, that are compared; comparing takes the product of their lengths."""

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
    """Return whether `name` is the path of a file, and not the name of a shipped one; raises TypeError for neither."""
    if not isinstance(name, str | Path):
        raise wrong_kind("name", "a name or a path", name)
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
        listed = f"To list them: haptic-fieldbus {kind}s list"
        raise UsageError(f'no {kind} "{name}"{suggestion(str(name), {*names, *others})}. {listed}')
    return folder / f"{name}.toml"


def beside(path: Path, name: str, *folders: Path) -> Path:
    """Return the file that the file at `path` names: inside its folder, or inside one of `folders`.

    A file from elsewhere must not reach others of this computer. Links are followed before the folders are compared.
    Raises UsageError for a name that leads out of them.
    """
    allowed = (path.resolve().parent, *folders)
    try:
        found = (allowed[0] / name).resolve()
    except (OSError, ValueError, RuntimeError):  # a circle of links, a NUL
        found = Path(name)
    if Path(name).is_absolute() or not any(found.is_relative_to(folder) for folder in allowed):
        raise UsageError(f'no file "{name}" in the folder of this file or below')
    return found
