"""A file is replaced as a whole: after a kill, on a full disk or without rights the old one is there, whole."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_fieldbus.documents.edits import edit_file, remove_file, write_file

OLD, NEW = "old\r\nlines # kept\n", "new\r\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_bytes(OLD.encode())
    return path


def renewed(text: str) -> str:
    assert text == OLD
    return NEW


def test_the_new_content_stands_with_the_mode_of_the_old_one_and_nothing_beside_it(path: Path) -> None:
    path.chmod(0o640)
    edit_file(path, renewed)
    assert path.read_bytes() == NEW.encode()
    assert path.stat().st_mode & 0o777 == 0o640
    assert os.listdir(path.parent) == [path.name]


def test_a_link_stays_one_and_its_target_changes(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    link = folder / "bench.toml"
    link.symlink_to("../rig.toml")
    edit_file(link, renewed)
    assert link.is_symlink()
    assert path.read_bytes() == NEW.encode()
    assert os.listdir(folder) == [link.name]


def test_what_somebody_writes_meanwhile_is_what_is_edited(path: Path) -> None:
    seen = []

    def edit(text: str) -> str:
        seen.append(text)
        if len(seen) == 1:
            path.write_text("theirs", encoding="utf-8")
        return f"{text} and ours"

    edit_file(path, edit)
    assert seen == [OLD, "theirs"]
    assert path.read_text() == "theirs and ours"
    assert os.listdir(path.parent) == [path.name]


def test_somebody_who_never_stops_writing_is_told(path: Path) -> None:
    texts = iter(range(1000))

    def edit(_text: str) -> str:
        path.write_text("x" * next(texts), encoding="utf-8")
        return NEW

    with pytest.raises(OSError, match="another program writes it"):
        edit_file(path, edit)
    assert os.listdir(path.parent) == [path.name]


def _fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("spoil", "error"),
    [
        (lambda path: path.chmod(0o444), PermissionError),
        (lambda path: path.unlink(), FileNotFoundError),
        (lambda path: (path.unlink(), path.mkdir()), OSError),
        (_fifo, OSError),
        (lambda path: path.write_bytes(b"\xff"), ValueError),
        (lambda path: path.write_bytes(b"x" * 300_000), OSError),
        (lambda path: (path.unlink(), path.symlink_to("/dev/full")), OSError),
    ],
)
def test_a_file_that_cannot_be_replaced_stays(
    spoil: Callable[[Path], object], error: type[Exception], path: Path
) -> None:
    spoil(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(error):
        edit_file(path, lambda _text: NEW)
    assert (path.read_bytes() if path.is_file() else None) == before
    assert all(not name.endswith(".new") for name in os.listdir(path.parent))


def test_a_file_is_created_replaced_and_removed_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "note.json"
    for content in (b"one", b"", b"three"):
        write_file(path, content)
        assert path.read_bytes() == content
    assert os.listdir(tmp_path) == [path.name]
    remove_file(path)
    remove_file(path)
    assert os.listdir(tmp_path) == []
    remove_file(tmp_path / "no folder" / path.name)


def test_an_edit_that_raises_leaves_the_file(path: Path) -> None:
    def edit(_text: str) -> str:
        raise ValueError("no such table")

    with pytest.raises(ValueError, match="no such table"):
        edit_file(path, edit)
    assert path.read_bytes() == OLD.encode()


EDIT, WRITE = "edit_file(path, lambda text: new)", "write_file(path, new.encode())"


def in_a_process(path: Path, before: str, change: str = EDIT) -> "subprocess.CompletedProcess[str]":
    """Change the file in a process of its own, after some lines of Python."""
    code = f"""
import os, resource, signal, sys
from pathlib import Path
from haptic_fieldbus.documents.edits import edit_file, write_file
path, new = Path({str(path)!r}), {NEW!r} * 1000
{before}
try:
    {change}
except OSError as error:
    print(error.errno)
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("change", [EDIT, WRITE])
@pytest.mark.parametrize("call", ["os.replace", "os.fsync"])
def test_after_a_kill_before_the_rename_the_old_file_is_whole(call: str, change: str, path: Path) -> None:
    killed = in_a_process(path, f"{call} = lambda *_: os.kill(os.getpid(), signal.SIGKILL)", change)
    assert killed.returncode == -signal.SIGKILL
    assert path.read_bytes() == OLD.encode()
    edit_file(path, renewed)  # what was left behind is in nobody's way
    assert path.read_bytes() == NEW.encode()


@pytest.mark.parametrize("change", [EDIT, WRITE])
def test_on_a_full_disk_the_old_file_is_whole_and_nothing_is_left(change: str, path: Path) -> None:
    full = in_a_process(path, "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))", change)
    assert (full.returncode, full.stdout.strip()) == (0, str(errno.EFBIG)), full.stderr
    assert path.read_bytes() == OLD.encode()
    assert os.listdir(path.parent) == [path.name]


@pytest.mark.skipif(os.geteuid() != 0, reason="a process of another user is needed, which only root can start")
def test_in_a_folder_that_may_not_be_written_the_file_stays(path: Path) -> None:
    path.chmod(0o666)
    for folder in (path.parent, *path.parent.parents[:2]):
        folder.chmod(0o755)
    denied = in_a_process(path, "os.setgid(65534); os.setuid(65534)")
    assert (denied.returncode, denied.stdout.strip()) == (0, str(errno.EACCES)), denied.stderr
    assert path.read_bytes() == OLD.encode()


def test_the_mark_in_front_of_a_file_stays_and_no_edit_sees_it(path: Path) -> None:
    """Some editors of Windows write one."""
    path.write_bytes(b"\xef\xbb\xbf" + OLD.encode())
    edit_file(path, renewed)
    assert path.read_bytes() == b"\xef\xbb\xbf" + NEW.encode()
