"""`vcan`: what is said when a command cannot be run; tests/vcan has those that are."""

from pathlib import Path

import pytest

from haptic_fieldbus.vcan import runner
from tests.cli.command import Command

PACKAGES = "apt-get install user-mode-linux kmod iproute2"


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of all programs that can be found, `true` among them."""
    folder = tmp_path / "programs"
    folder.mkdir()
    for name in ("true", "sleep", "rm"):
        (folder / name).symlink_to(f"/bin/{name}")
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setattr(runner, "SYSTEM_FOLDERS", ())
    monkeypatch.setattr(runner, "MODULES", tmp_path)
    return folder


def kernel(programs: Path, script: str) -> None:
    """Let a script be the guest kernel, with all that it needs."""
    for name in runner.PROGRAMS:
        (programs / name).write_text(f"#!/bin/sh\n{script}\n")
        (programs / name).chmod(0o755)
    module = programs.parent / "6.1" / "kernel" / "drivers" / "net" / "can" / "vcan.ko"
    module.parent.mkdir(parents=True)
    module.touch()


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (("--", "no-such-program"), 127, 'no program "no-such-program" in the folders of PATH'),
        (("--", "./no-such-program"), 127, 'no program "./no-such-program"\n'),
        (("--", "/etc/passwd"), 126, "/etc/passwd: no permission to run it"),
        (("--interface", "a b", "--", "true"), 2, 'interface "a b": expected 1 to 15 letters'),
        (("--interface", "sixteen_letters_", "--", "true"), 2, "expected 1 to 15 letters"),
        (("--interface", "a", "--interface", "a", "--", "true"), 2, "interfaces a, a: each can be named once"),
        (("--interface", "lo", "--", "true"), 2, 'interface "lo" exists and is not a vcan'),
        (("--time-limit", "0", "--", "true"), 2, "--time-limit 0: expected more than 0 s"),
        (("--guest", "--", "true"), 125, "no guest kernel without linux.uml, insmod, ip. Either, as root: modprobe"),
        (("--guest", "--", "true"), 125, PACKAGES),
    ],
)
def test_what_cannot_be_run_is_told(
    command: Command, programs: Path, words: tuple[str, ...], status: int, said: str
) -> None:
    finished = command("vcan", *words)
    assert finished.status == status
    assert said in finished.err
    assert finished.out == ""


def test_a_kernel_without_the_module_is_told(command: Command, programs: Path) -> None:
    kernel(programs, "exit 0")
    for module in programs.parent.rglob("vcan.ko"):
        module.unlink()
    finished = command("vcan", "--guest", "--", "true")
    assert finished.status == 125
    assert "has no module vcan" in finished.err
    assert "apt-get install --reinstall user-mode-linux" in finished.err


@pytest.mark.parametrize(
    ("folder", "said"), [("nowhere", '--out "nowhere": no such folder'), ("/sys", "the guest kernel has its own /sys")]
)
def test_a_folder_that_cannot_be_written_to_is_told(command: Command, programs: Path, folder: str, said: str) -> None:
    kernel(programs, "exit 0")
    finished = command("vcan", "--guest", "--out", folder, "--", "true")
    assert finished.status == 2
    assert said in finished.err


def test_too_little_room_for_the_memory_of_the_guest_is_told(
    command: Command, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel(programs, "exit 0")
    monkeypatch.setattr(runner, "MEMORY_MB", 2**40)
    finished = command("vcan", "--guest", "--", "true")
    assert finished.status == 125
    assert "set TMPDIR to another one" in finished.err


def test_a_kernel_that_ends_at_once_shows_what_it_said(command: Command, programs: Path) -> None:
    kernel(programs, "echo 'Kernel panic - not syncing: no such luck'; exit 1")
    finished = command("vcan", "--guest", "--", "true")
    assert finished.status == 125
    assert "the guest kernel ended before the command did" in finished.err
    assert "Kernel panic - not syncing: no such luck" in finished.err


def test_a_kernel_that_does_not_boot_is_ended(
    command: Command, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel(programs, "echo 'checking memory'; exec sleep 1000")
    monkeypatch.setattr(runner, "BOOT_LIMIT_S", 0.2)
    finished = command("vcan", "--guest", "--", "true")
    assert finished.status == 125
    assert "the guest kernel was not ready within 0.2 s" in finished.err
    assert "checking memory" in finished.err


def test_what_the_guest_says_is_understood_in_pieces_of_any_size() -> None:
    said = b"ready\nunwritten /a b\nstatus 3\n"
    whole, pieces = runner.GuestReports(), runner.GuestReports()
    whole.hear(said)
    for octet in said:
        pieces.hear(bytes([octet]))
    assert pieces == whole
    assert (whole.ready, whole.unwritten, whole.status, whole.failed) == (True, ["/a b"], 3, None)
