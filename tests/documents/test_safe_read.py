"""Only regular files of bounded size are read, and nothing else makes a reader wait or grow."""

import contextlib
import os
import stat
from pathlib import Path

import pytest

from haptic_fieldbus.documents.safe_read import read_octets
from tests.documents.hostile import DEVICES, READERS, said_of

SUFFIXES = (".toml", ".eds", ".dcf", ".csv")


@pytest.mark.thorough("a process for each kind of device file", quick=2)
@pytest.mark.parametrize("kind", DEVICES)
def test_every_reader_refuses_what_is_no_file(kind: str, tmp_path: Path) -> None:
    make, words = DEVICES[kind]
    for suffix in SUFFIXES:
        make(tmp_path / f"x{suffix}")
    for reader, said in said_of(tmp_path, READERS).items():
        assert said is not None, reader
        assert words in said, reader


def test_the_whole_file_is_returned_and_one_octet_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345678")
    assert read_octets(path, 8) == b"12345678"
    with pytest.raises(OSError, match="too large; expected at most 7 octets"):
        read_octets(path, 7)


def test_a_file_that_tells_no_size_is_read_up_to_the_bound() -> None:
    assert Path("/proc/self/environ").stat().st_size == 0
    assert read_octets("/proc/self/status", 1 << 16).startswith(b"Name:")
    with pytest.raises(OSError, match="too large"):
        read_octets("/proc/self/status", 10)


def test_a_fifo_that_takes_the_place_of_a_file_is_refused_after_opening(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_text("a = 1")
    honest = os.stat

    def swapped(place: Path) -> os.stat_result:
        found = honest(place)
        path.unlink()
        os.mkfifo(path)
        return found

    monkeypatch.setattr("os.stat", swapped)
    with pytest.raises(OSError, match="it is a FIFO"):
        read_octets(path, 100)
    assert stat.S_ISFIFO(honest(path).st_mode)


def test_no_descriptor_is_left_open(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345678")
    before = len(os.listdir("/proc/self/fd"))
    for most in (7, 8):
        with contextlib.suppress(OSError):
            read_octets(path, most)
    assert len(os.listdir("/proc/self/fd")) == before
