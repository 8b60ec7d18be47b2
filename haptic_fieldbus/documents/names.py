"""Files by name, and the names that somebody may have meant."""

import difflib
from collections.abc import Iterable
from pathlib import Path

from haptic_fieldbus.errors import UsageError

LISTED = 12
"""So many names are listed when none is near; more would hide the message."""

_EDS_SUFFIXES = (".eds", ".dcf")
_SUFFIXES = (".toml", *_EDS_SUFFIXES)


def nearest(name: str, names: Iterable[str]) -> list[str]:
    """Up to three of `names` that are nearly `name`, or contain it; the nearest first."""
    by_lower = {candidate.lower(): candidate for candidate in sorted(names, reverse=True)}
    wanted = name.lower()
    close = difflib.get_close_matches(wanted, by_lower, n=3, cutoff=0.6)
    containing = sorted(lower for lower in by_lower if len(wanted) > 2 and wanted in lower and lower not in close)
    return [by_lower[lower] for lower in (close + containing)[:3]]


def suggestion(name: str, names: Iterable[str]) -> str:
    """The end of a sentence about an unknown name: the nearest ones, or all when none is near and they are few."""
    known = sorted(names)
    near = nearest(name, known)
    if near:
        return f"; nearest: {', '.join(near)}"
    return f"; known: {', '.join(known)}" if 0 < len(known) <= LISTED else ""


def file_names(folder: Path) -> list[str]:
    """The names of the TOML files of a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def is_path(name: str | Path) -> bool:
    """Whether a file is meant, and not the name of a shipped one."""
    return isinstance(name, Path) or name.lower().endswith(_SUFFIXES) or "/" in name or "\\" in name


def is_eds(name: str | Path) -> bool:
    """Whether an EDS or DCF is meant."""
    return str(name).lower().endswith(_EDS_SUFFIXES)


def file_of(kind: str, name: str | Path, folder: Path, others: Iterable[str] = ()) -> Path:
    """The file of a shipped profile or scene (`kind`), or the path itself when one is given; raises UsageError.

    `others` are names that are known from elsewhere, for the sentence.
    """
    if is_path(name):
        return Path(name)
    names = file_names(folder)
    if name not in names:
        listed = f"{kind.capitalize()}s are listed by: haptic-fieldbus {kind}s list"
        raise UsageError(f'no {kind} "{name}"{suggestion(str(name), {*names, *others})}. {listed}')
    return folder / f"{name}.toml"
