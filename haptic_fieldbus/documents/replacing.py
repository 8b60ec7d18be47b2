"""Replacement of a file as a whole: whoever reads it, at whatever time, finds the old content or the new one.

The new content goes into a file beside the old one, reaches the disk, and takes its name in one step (POSIX rename).
A process that is killed in between leaves the old file whole, and a file ending in `.new` beside it. A symbolic link
stays one: its target is replaced.
"""

import errno
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from haptic_fieldbus.documents.octets import TOML_SIZE, read_octets

ATTEMPTS = 5
"""How often a file that somebody else writes at the same time is edited anew."""


def edit_file(path: str | Path, edit: Callable[[str], str], most: int = TOML_SIZE) -> None:
    """Replace the content of a regular file of UTF-8 by what `edit` makes of it; its mode stays.

    `edit` may be called several times, when the file changes meanwhile. Raises OSError with the reason as `strerror`,
    UnicodeDecodeError (a ValueError), and what `edit` raises; the file is then as it was.
    """
    target = Path(os.path.realpath(path))
    for _ in range(ATTEMPTS):
        before = _state(target)
        # Not by a text file, whose line endings would change.
        edited = edit(read_octets(target, most).decode("utf-8")).encode("utf-8")
        if _replaced(target, edited, before):
            return
    raise OSError(errno.EAGAIN, "somebody else writes it at the same time")


def _replaced(target: Path, content: bytes, before: os.stat_result) -> bool:
    """Write and rename; False when the file is no longer as it was, and nothing was replaced."""
    # A rename asks only for the rights to the folder, but who took the right to write meant the file.
    if not before.st_mode & stat.S_IWUSR or not os.access(target, os.W_OK):
        raise OSError(errno.EACCES, "it is read-only")
    with _aside(target, content, before) as name:
        if _seen(before) != _seen(_state(target)):
            return False
        os.replace(name, target)
    _sync_folder(target.parent)
    return True


def write_file(target: Path, content: bytes) -> None:
    """Create a file, or replace the whole of it; raises OSError, and the file is then as it was."""
    with _aside(target, content) as name:
        os.replace(name, target)
    _sync_folder(target.parent)


def remove_file(target: Path) -> None:
    """Remove a file for good, if it is there; raises OSError."""
    target.unlink(missing_ok=True)
    if target.parent.is_dir():
        _sync_folder(target.parent)


@contextmanager
def _aside(target: Path, content: bytes, rights: os.stat_result | None = None) -> Iterator[str]:
    """Write a file beside the target onto the disk, and yield its name; it is removed unless it was renamed."""
    descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".new", dir=target.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            if rights is not None and hasattr(os, "fchown"):  # Windows has neither modes nor owners of this kind
                _keep_rights(descriptor, rights)
            os.fsync(descriptor)
        yield name
    finally:
        with suppress(FileNotFoundError):
            os.unlink(name)


def _keep_rights(descriptor: int, before: os.stat_result) -> None:
    """Give a new file the mode of the old one, and its owner where we may."""
    os.fchmod(descriptor, stat.S_IMODE(before.st_mode))
    if before.st_uid != os.geteuid():  # root, for whom the file must not become its own
        with suppress(PermissionError):
            os.fchown(descriptor, before.st_uid, before.st_gid)


def _state(target: Path) -> os.stat_result:
    return os.stat(target)


def _seen(found: os.stat_result) -> tuple[int, int, int, int]:
    """Return what changes when somebody writes or replaces a file."""
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _sync_folder(folder: Path) -> None:
    """Let the new name reach the disk, where a folder can be synchronised."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows opens no folder
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with suppress(OSError):  # some file systems cannot; the file itself is on the disk already
            os.fsync(descriptor)
    finally:
        os.close(descriptor)
