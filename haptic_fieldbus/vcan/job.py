"""Folder in which the guest finds what it shall do, and the host's folders that it shall write to."""

import os
import shlex
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from haptic_fieldbus.errors import UsageError, VcanError

OWN_FOLDERS = ("/dev", "/proc", "/run", "/sys")
"""Where the guest has folders of its own, so that those of the host are not seen."""
TMPDIR = "/run/tmp"
OWN_ENVIRONMENT = {
    "TMPDIR": TMPDIR,
    "XDG_CACHE_HOME": f"{TMPDIR}/cache",
    "XDG_STATE_HOME": f"{TMPDIR}/state",
    "PYTHONDONTWRITEBYTECODE": "1",
}
"""Environment of the command in the guest, besides that of the caller: where it can write, for few can elsewhere."""


@dataclass(frozen=True)
class Job:
    """A command for the guest: its words and environment, interfaces, folders to write to, size of the terminal."""

    command: Sequence[str]
    environment: Mapping[str, str]
    interfaces: Sequence[str]
    writable: Sequence[Path]
    terminal: os.terminal_size | None

    def require_folders(self) -> None:
        """Raise UsageError when a folder is not there, or not seen by the guest."""
        for folder in self.writable:
            if not folder.is_dir():
                raise UsageError(f'--out "{folder}": no such folder')
            if not os.access(folder, os.W_OK | os.X_OK):
                raise UsageError(f'--out "{folder}": this user must not write to it')
        for folder in (Path.cwd(), *self.writable):
            hidden = next((own for own in OWN_FOLDERS if folder.resolve().is_relative_to(own)), None)
            if hidden is not None:
                raise UsageError(f"{folder}: the guest kernel has a {hidden} of its own; use a folder elsewhere")


@contextmanager
def written(job: Job) -> Iterator[Path]:
    """Yield a folder with the first program of the guest, its settings and the command; removed at the end.

    Raises VcanError when it cannot be written.
    """
    try:
        folder = Path(tempfile.mkdtemp(prefix="haptic-fieldbus-vcan-"))
    except OSError as error:
        raise VcanError(f"no temporary folder for the guest kernel: {error.strerror or error}") from error
    try:
        try:
            (folder / "init").write_bytes(files("haptic_fieldbus.vcan").joinpath("guest.sh").read_bytes())
            (folder / "settings").write_bytes(os.fsencode(_settings(job)))
            (folder / "command").write_bytes(os.fsencode(_command(job)))
        except OSError as error:
            raise VcanError(f"{folder} cannot be written: {error.strerror}") from error
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _settings(job: Job) -> str:
    """Variables and one function, for the shell of the guest."""
    columns, rows = job.terminal or ("", "")
    folders = [f'"$1" {shlex.quote(str(folder.resolve()))}' for folder in job.writable]
    return (
        f"interfaces={shlex.quote(' '.join(job.interfaces))} columns={columns} rows={rows}\n"
        f"each_writable() {{\n{chr(10).join([':', *folders])}\n}}\n"
    )


def _command(job: Job) -> str:
    """A script that becomes the command: 126 or 127 when that cannot be started, as env(1) has it."""
    environment = {**job.environment, **OWN_ENVIRONMENT}
    words = [*(f"{name}={value}" for name, value in environment.items()), *job.command]
    return (
        "echo $$ >/run/command.pid\n"
        f"mkdir -p {TMPDIR}/cache {TMPDIR}/state\n"
        f"cd {shlex.quote(os.getcwd())} || exit 126\n"
        f"exec env -i -- {' '.join(map(shlex.quote, words))}\n"
    )
