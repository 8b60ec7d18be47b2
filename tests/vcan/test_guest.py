"""`haptic-fieldbus vcan --guest`: commands in a guest kernel, and how they end."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import pytest

from haptic_fieldbus.errors import VcanError
from haptic_fieldbus.vcan import runner as guest
from tests.peers.hosts import hear_signals

pytestmark = [
    pytest.mark.thorough("boots guest kernels"),
    pytest.mark.xdist_group("vcan"),
]

ENDS_WITHIN, GONE_WITHIN = 120.0, 5.0
READS_LIKE_A_SHELL = 'it\'s "a" $HOME `b` *\\\n end'


@pytest.fixture(autouse=True)
def _needs() -> None:
    try:
        guest.require_guest()
    except VcanError as error:
        pytest.skip(str(error))


@dataclass(frozen=True)
class Runner:
    """Runs commands in guests, whose kernels name this folder."""

    folder: Path

    def start(self, *words: str, options: Sequence[str] = ()) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-m", "haptic_fieldbus", "vcan", "--guest", *options, "--", *words],
            cwd=self.folder,
            env={**os.environ, "TMPDIR": str(self.folder), "MARK": READS_LIKE_A_SHELL},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=hear_signals,
        )

    def run(self, *words: str, options: Sequence[str] = ()) -> "subprocess.CompletedProcess[str]":
        process = self.start(*words, options=options)
        out, err = process.communicate(timeout=ENDS_WITHIN)
        return subprocess.CompletedProcess(words, process.returncode, out, err)

    def kernels(self) -> int:
        """Processes of guests of this runner that still are there."""
        lines = map(_read, Path("/proc").glob("[0-9]*/cmdline"))
        return sum(guest.KERNEL.encode() in line and os.fsencode(self.folder) in line for line in lines)


def _read(path: Path) -> bytes:
    """Of a process that may be gone by now: nothing then."""
    try:
        return path.read_bytes()
    except OSError:
        return b""


@pytest.fixture
def runner(tmp_path: Path) -> Iterator[Runner]:
    """In a folder whose name is an ordeal; nothing may be left of it."""
    folder = tmp_path / "a folder's"
    folder.mkdir()
    runner = Runner(folder)
    yield runner
    deadline, left = monotonic() + GONE_WITHIN, list[str]()
    while monotonic() < deadline:
        left = [path.name for path in folder.iterdir() if path.name.startswith("haptic-fieldbus-")]
        if not left and not runner.kernels():  # the folder goes after the kernel
            break
    assert runner.kernels() == 0
    assert left == []


def test_words_environment_and_both_outputs_arrive_as_they_are(runner: Runner) -> None:
    script = "import os, sys; print(sys.argv[1:], repr(os.environ['MARK']), os.getcwd()); sys.stderr.write('e\\r\\n')"
    done = runner.run(sys.executable, "-c", script, READS_LIKE_A_SHELL, "", "é")
    assert done.stdout == f"{[READS_LIKE_A_SHELL, '', 'é']!r} {READS_LIKE_A_SHELL!r} {runner.folder}\n"
    assert done.stderr.endswith("\ne\n")  # text mode reads \r\n as \n
    assert done.returncode == 0


def test_long_output_arrives_whole(runner: Runner) -> None:
    done = runner.run("seq", "300000")
    assert done.stdout == "".join(f"{number}\n" for number in range(1, 300_001))


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("false",), 1),
        (("sh", "-c", "exit 77"), 77),
        (("sh", "-c", "kill -SEGV $$"), 139),
        (("sh", "-c", "kill -KILL $$"), 137),
        (("./nothing-here",), 127),
        (("/etc/passwd",), 126),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_the_exit_status_is_that_of_the_command(runner: Runner, words: Sequence[str], status: int) -> None:
    assert runner.run(*words).returncode == status


def test_interfaces_are_there_by_name_and_can_be_configured_without_rights_on_the_host(runner: Runner) -> None:
    script = "ip -brief link show type vcan; ip link add vcan7 type vcan && ip link set vcan7 up && echo made"
    done = runner.run("sh", "-c", script, options=["--interface", "vcan0", "--interface", "left.can"])
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["vcan0", "left.can", "made"]


def test_only_folders_that_are_named_can_be_written_to(runner: Runner) -> None:
    out = runner.folder / "out"
    out.mkdir()
    script = 'echo kept > out/file; echo lost > elsewhere; echo own > "$TMPDIR/own" && cat "$TMPDIR/own"'
    done = runner.run("sh", "-c", script, options=["--out", "out"])
    assert (out / "file").read_text() == "kept\n"
    assert not (runner.folder / "elsewhere").exists()
    assert done.stdout == "own\n"
    assert "Read-only file system" in done.stderr
    assert f"it can write to $TMPDIR, and on the host to {out}" in done.stderr


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount a small disk")
def test_a_full_disk_is_told(runner: Runner) -> None:
    out = runner.folder / "out"
    out.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(out)], check=True)
    try:
        done = runner.run("sh", "-c", "head -c 5000000 /dev/zero > out/file", options=["--out", "out"])
    finally:
        subprocess.run(["umount", str(out)], check=True)
    assert done.returncode != 0
    assert "No space left on device" in done.stderr or "is the disk full?" in done.stderr


def test_a_command_whose_time_is_up_is_ended(runner: Runner) -> None:
    done = runner.run("sleep", "1000", options=["--time-limit", "0.5"])
    assert done.returncode == 124
    assert "the command was ended at its time limit of 0.5 s" in done.stderr


ORDERLY = "trap 'echo orderly; exit 5' INT TERM HUP; echo begun; while :; do sleep 0.1; done"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_reaches_the_command_which_ends_as_it_likes(runner: Runner, number: signal.Signals) -> None:
    process = runner.start("sh", "-c", ORDERLY)
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    out, _ = process.communicate(timeout=ENDS_WITHIN)
    assert (process.returncode, out) == (5, "orderly\n")


def test_a_second_signal_ends_a_command_that_does_not_listen(runner: Runner) -> None:
    process = runner.start("sh", "-c", "trap 'echo no' INT; echo begun; while :; do sleep 0.1; done")
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "no\n"
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=5.0)
    assert process.returncode == 130


def test_nothing_is_left_of_a_guest_whose_runner_is_killed(runner: Runner) -> None:
    process = runner.start("sh", "-c", "echo begun; while :; do :; done")
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    assert runner.kernels() > 1
    process.kill()
    process.communicate(timeout=ENDS_WITHIN)


def test_what_a_command_leaves_behind_ends_with_it(runner: Runner) -> None:
    assert runner.run("sh", "-c", "setsid sleep 1000 & echo done").stdout == "done\n"


def test_two_guests_share_no_bus(runner: Runner) -> None:
    wait_for_neighbour = "while [ ! -e beside/$2 ]; do :; done"
    send_until_heard = "while [ ! -e beside/$1.heard ]; do cansend vcan0 $1#; done"
    listen = "(candump -n 20 vcan0; touch beside/$1.heard) & touch beside/$1"
    script = f"{listen}; {wait_for_neighbour}; {send_until_heard}; wait"
    (runner.folder / "beside").mkdir()
    both = [
        runner.start("sh", "-c", script, "sh", own, other, options=["--out", "beside"])
        for own, other in [("101", "102"), ("102", "101")]
    ]
    heard = [process.communicate(timeout=ENDS_WITHIN)[0].splitlines() for process in both]
    assert [[line.split()[1] for line in lines] for lines in heard] == [["101"] * 20, ["102"] * 20]
