"""Standard output and error: readers that do not read, readers that are gone, encodings without a character."""

import io
import json
import os
import pty
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from haptic_fieldbus.cli.output import SPELT, OutputThread, behind, free_output, in_ascii, never_wait
from tests.peers.hosts import STARTS_WITHIN

SOON = 0.01
"""Patience with a reader that never reads [s]."""


def reading(descriptor: int) -> str:
    """All that was written, once every writer has closed its end."""
    with open(descriptor, encoding="utf-8") as file:
        return file.read()


@contextmanager
def streams(monkeypatch: pytest.MonkeyPatch, out: int, err: int) -> Iterator[None]:
    """Standard output and standard error on these descriptors, inside `free_output`."""
    with open(out, "w", encoding="utf-8") as first, open(err, "w", encoding="utf-8") as second:
        monkeypatch.setattr(sys, "stdout", first)
        monkeypatch.setattr(sys, "stderr", second)
        monkeypatch.setattr("haptic_fieldbus.cli.output.PATIENCE", SOON)
        with free_output(lambda: False):
            yield


def full() -> tuple[int, int]:
    """A pipe that takes no more octets."""
    out, into = os.pipe()
    os.set_blocking(into, False)
    with suppress(BlockingIOError):
        while True:
            os.write(into, b"x" * 4096)
    os.set_blocking(into, True)
    return out, into


def test_what_is_written_comes_in_order_and_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    out, into = os.pipe()
    with streams(monkeypatch, into, os.dup(into)):
        print("ordinary", flush=True)
        never_wait()
        for number in range(500):
            print(number, file=sys.stderr if number % 2 else sys.stdout, flush=True)
    assert reading(out).split() == ["ordinary", *map(str, range(500))]


def test_a_reader_that_does_not_read_holds_up_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    stuck, into = full()
    err, into_err = os.pipe()
    with streams(monkeypatch, into, into_err):
        never_wait()
        assert not behind(sys.stdout)
        print("the result " * 1000, flush=True)
        print("switch the power off", file=sys.stderr)
        assert behind(sys.stdout)
    assert reading(err) == "switch the power off\n"
    os.close(stuck)


def test_a_reader_that_is_gone_ends_no_command_that_moves_a_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    out, into = os.pipe()
    os.close(out)
    err, into_err = os.pipe()
    with streams(monkeypatch, into, into_err):
        never_wait()
        print("nobody reads this", flush=True)
        print("somebody reads this", file=sys.stderr)
    assert reading(err) == "somebody reads this\n"


def test_a_reader_that_is_gone_ends_any_other_command(monkeypatch: pytest.MonkeyPatch) -> None:
    out, into = os.pipe()
    os.close(out)
    err, into_err = os.pipe()
    with streams(monkeypatch, into, into_err), pytest.raises(BrokenPipeError):
        print("nobody reads this", flush=True)
    assert reading(err) == ""


def test_a_stream_that_somebody_made_non_blocking_is_written_whole() -> None:
    """As a terminal that another program shares; the first answer is None, "it would block"."""

    class Shared(io.RawIOBase):
        def __init__(self) -> None:
            self.taken, self.answers = b"", [None, 3, None]

        def write(self, octets: object) -> int | None:
            assert isinstance(octets, bytes)
            count = self.answers.pop(0) if self.answers else len(octets)
            self.taken += octets[: count or 0]
            return count

    stream, thread = Shared(), OutputThread()
    thread.take(stream, b"abcdefgh")
    thread.finish(STARTS_WITHIN)
    assert stream.taken == b"abcdefgh"


@pytest.mark.parametrize(
    ("text", "told"),
    [("0.25 N·m", "0.25 N.m"), ("60 µs", "60 us"), ("x²", "x2"), ("é", "e"), ("漢", "?"), ("a\udcffb", "a?b")],
)
def test_a_character_that_the_encoding_lacks_is_spelt(text: str, told: str) -> None:
    codec = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
    with pytest.raises(UnicodeEncodeError) as lacking:
        codec.write(text)
    start, end = lacking.value.start, lacking.value.end
    assert in_ascii(lacking.value) == (told[start : len(told) - (len(text) - end)], end)
    assert all(spelling.isascii() for spelling in SPELT.values())


def test_other_errors_of_an_encoding_stay_errors() -> None:
    with pytest.raises(UnicodeDecodeError):
        in_ascii(UnicodeDecodeError("ascii", b"\xff", 0, 1, "not ASCII"))


ASCII_COMMANDS = """
import sys
from haptic_fieldbus.cli import main
for words in sys.argv[1:]:
    try:
        main(words.split())
    except SystemExit as ended:
        print("status", ended.code)
"""
LINES = (
    "run --help", "run wall --duration 0.1", "plan damped_wall", "stability wall", "scenes list",
    "profiles show maxon_epos4", "response sprung_mass", "run wäll", "run wall --set wall.stiffness=1e9", "plan ½.toml",
)  # fmt: skip


@pytest.mark.thorough("every command once more", quick=("ascii",))
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_no_text_fails_for_want_of_a_character(encoding: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "LANG": "C", "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-c", ASCII_COMMANDS, *LINES], env=environment, capture_output=True, check=False
    )
    out, err = done.stdout.decode(encoding), done.stderr.decode(encoding)
    assert done.returncode == 0, err
    assert [line for line in out.splitlines() if line.startswith("status")] == [
        *["status 0"] * 7, "status 2", "status 4", "status 2",
    ], err  # fmt: skip
    assert "no scene" in err or "wall" in err


def test_json_has_escapes_where_the_encoding_lacks_a_character() -> None:
    program = [sys.executable, "-m", "haptic_fieldbus", "plan", "damped_wall", "--json"]
    objects = [
        subprocess.run(
            program, env={**os.environ, "PYTHONIOENCODING": encoding}, capture_output=True, check=True
        ).stdout.decode(encoding)
        for encoding in ("ascii", "utf-8")
    ]
    assert json.loads(objects[0]) == json.loads(objects[1])
    assert not objects[1].isascii()


def reader_that_stops(master: int, words: bytes) -> bytes:
    """Read from a terminal until these words have come, and press Ctrl-S."""
    told = b""
    while words not in told:
        assert select.select([master], [], [], STARTS_WITHIN)[0], told
        told += os.read(master, 4096)
    os.write(master, b"\x13")
    return told


def started(out: int, *words: str) -> "subprocess.Popen[bytes]":
    program = [sys.executable, "-m", "haptic_fieldbus", *words]
    return subprocess.Popen(program, stdin=subprocess.DEVNULL, stdout=out, stderr=out)


def on_a_terminal(end: Callable[["subprocess.Popen[bytes]"], None], seconds: str) -> int:
    master, slave = pty.openpty()
    process = started(slave, "run", "wall", "--duration", seconds)
    try:
        reader_that_stops(master, b"limit")
        end(process)
        return process.wait(STARTS_WITHIN)
    finally:
        process.kill()
        process.wait()
        os.close(slave)
        os.close(master)


@pytest.mark.thorough("waits for a reader that does not read")
def test_a_stopped_terminal_holds_up_no_end() -> None:
    assert on_a_terminal(lambda _: None, "1") == 0
    assert on_a_terminal(lambda process: process.send_signal(signal.SIGTERM), "36000") == 143


@pytest.mark.thorough("waits for a reader that does not read")
@pytest.mark.parametrize("words", ["run wall --duration 0.2", "run wall --duration 0.2 --json"])
def test_a_full_pipe_holds_up_no_end(words: str) -> None:
    out, into = full()
    process = started(into, *words.split())
    assert process.wait(STARTS_WITHIN) == 0
    os.close(into)
    os.close(out)


@pytest.mark.thorough("waits for a reader that does not read")
def test_a_command_that_waits_for_its_reader_ends_by_a_signal() -> None:
    """Until then it waits: the table is longer than the pipe."""
    out, into = os.pipe()
    process = started(into, "response", "sprung_mass", "--duration", "20", "--json")
    os.read(out, 1)
    process.send_signal(signal.SIGTERM)
    assert process.wait(STARTS_WITHIN) == 143
    os.close(into)
    os.close(out)


@pytest.mark.thorough("starts a process for each", quick=1)
@pytest.mark.parametrize("words", ["run wall --duration 0.2", "run wall --duration 0.2 --json"])
def test_a_closed_pipe_changes_no_exit_status(words: str) -> None:
    out, into = os.pipe()
    os.close(out)
    process = started(into, *words.split())
    os.close(into)
    assert process.wait(STARTS_WITHIN) == 0


@pytest.mark.thorough("waits for a reader that does not read")
def test_hosted_drives_end_in_order_although_nobody_reads(tmp_path: Path) -> None:
    out, into = full()
    rig = tmp_path / "rig.toml"
    process = started(into, "simulate", "--bus", "modbus-tcp:127.0.0.1:0", "--write-rig", str(rig))
    while not rig.exists():  # written when the bus is open, before the first line
        assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    assert process.wait(STARTS_WITHIN) == 0
    os.close(into)
    os.close(out)


@pytest.mark.thorough("starts a process for each", quick=2)
@pytest.mark.parametrize(
    ("words", "streams", "status", "told"),
    [
        ("plan wall", "> /dev/full", 1, "the output is not complete: No space left on device"),
        ("plan wall --json", "> /dev/full", 1, "the output is not complete: No space left on device"),
        ("run wall --duration 0.1", "> /dev/full", 1, "the output is not complete: No space left on device"),
        ("plan wall", "2>&-", 0, ""),
        ("plan nope", "2>&-", 2, ""),
        ("plan nope", ">&-", 2, 'no scene "nope"'),
        ("profiles check maxon_epos4", ">&-", 0, ""),
        ("run wall --duration 0.1", ">&-", 0, ""),
        ("run wall --duration 0.1", "2>&-", 0, ""),
        ("run wall --duration 0.1", ">&- 2>&-", 0, ""),
        ("run wall --duration 0.1", "<&-", 0, ""),
        ("run wall --duration 0.1", "<&- >&- 2>&-", 0, ""),
        ("rehearse", "<&-", 2, "no terminal to confirm on; add --yes"),
    ],
)
def test_an_output_that_is_full_or_closed_is_told_once_and_changes_no_other_status(
    words: str, streams: str, status: int, told: str
) -> None:
    shell = f'"{sys.executable}" -m haptic_fieldbus {words} {streams}'
    done = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert told in done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert done.stderr.count("the output is not complete") == told.count("the output is not complete")


@pytest.mark.parametrize("words", [("profiles", "show", "maxon_epos4"), ("run", "--help"), ("scenes", "list")])
def test_a_reader_that_wants_no_more_does_not_change_the_exit_status(words: tuple[str, ...]) -> None:
    """As `| head -1` in a shell with pipefail."""
    command = [sys.executable, "-m", "haptic_fieldbus", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert (process.stderr.read(), process.wait()) == (b"", 0)
