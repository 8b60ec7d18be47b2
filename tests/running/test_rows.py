"""Files of rows: each row as soon as it is passed on, by this process or another, and a disk that takes no more."""

import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus.assessing.loop_report import Record
from haptic_fieldbus.recordings.tables import row_line
from haptic_fieldbus.running.rows import ProcessFile, Rows

COLUMNS = ("t_ns", "handle.position")
KINDS = pytest.mark.parametrize("simulated", [True, False])
FULL = Path("/dev/full")
"""A device that refuses every write, as a full disk does (full(4))."""


def filled(rows: int, capacity: int = 1000) -> Record:
    record = Record(COLUMNS, capacity)
    for k in range(rows):
        record.push((1e15 + k, math.sin(k) * 1e-9))
    return record


@KINDS
def test_rows_are_written_with_their_names_and_every_digit(simulated: bool, tmp_path: Path) -> None:
    path, record = tmp_path / "run.csv", filled(5)
    file = Rows(record, path, simulated=simulated)
    file.flush()
    record.push((7.0, -0.1))
    file.flush()
    file.close()
    assert path.read_text().splitlines()[0] == "t_ns,handle.position"
    assert path.read_text().splitlines()[-1] == "7,-0.1"
    np.testing.assert_array_equal(np.loadtxt(path, delimiter=",", skiprows=1), record.rows())


@KINDS
def test_a_ring_may_go_round_while_its_rows_are_taken(simulated: bool, tmp_path: Path) -> None:
    path, record = tmp_path / "run.csv", Record(COLUMNS, 16)
    file = Rows(record, path, simulated=simulated)
    for k in range(100):
        record.push((k, k))
        if k % 10 == 9:
            file.flush()
    file.close()
    assert np.loadtxt(path, delimiter=",", skiprows=1)[:, 0].tolist() == list(range(100))


@KINDS
def test_a_file_that_cannot_be_made_is_refused_at_once(simulated: bool, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        Rows(filled(0), tmp_path / "nowhere" / "run.csv", simulated=simulated)


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.parametrize("simulated", [True, False])
def test_a_full_disk_is_a_fault_and_never_an_exception(simulated: bool, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.symlink_to(FULL)
    record = filled(100)
    rows = Rows(record, path, simulated=simulated)
    for k in range(3):
        rows.flush()
        record.push((k, k))
    rows.close()
    assert rows.fault is not None
    assert "No space left on device" in str(rows.fault)


@pytest.mark.parametrize("simulated", [True, False])
def test_a_file_that_grows_no_more_ends_with_a_whole_row(simulated: bool, tmp_path: Path) -> None:
    """A limit of the process on the size of files, as a disk that fills up."""
    import resource

    path, limit = tmp_path / "run.csv", 3000
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    record = filled(0, 4000)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        rows = Rows(record, path, simulated=simulated)
        for k in range(400):
            record.push((k, k / 3))
            if k % 20 == 19:
                rows.flush()
        rows.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert rows.fault is not None
    text = path.read_bytes()
    assert text.endswith(b"\n")
    assert len(text) <= limit
    read = [each.encode() for each in text.decode().splitlines(keepends=True)][1:]
    assert len(read) >= 20
    assert read == [row_line((float(k), k / 3)) for k in range(len(read))]


def test_a_writing_process_that_is_killed_does_not_stop_the_run(tmp_path: Path) -> None:
    record = filled(10)
    rows = Rows(record, tmp_path / "run.csv", simulated=False)
    assert isinstance(rows._file, ProcessFile)
    writing = rows._file._process._process
    os.kill(writing.pid, signal.SIGKILL)
    writing.wait()
    for k in range(3):
        record.push((k, k))
        rows.flush()
    rows.close()
    assert rows.fault is not None
    assert "killed" in str(rows.fault)


def test_a_writing_process_that_hangs_makes_nobody_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More rows than the pipe and the memory set aside take: the run goes on without them."""
    monkeypatch.setattr("haptic_fieldbus.buses.writing.PIPE", 100_000)
    record = filled(0, 20_000)
    rows = Rows(record, tmp_path / "run.csv", simulated=False)
    assert isinstance(rows._file, ProcessFile)
    process = rows._file._process._process
    os.kill(process.pid, signal.SIGSTOP)
    try:
        for k in range(20_000):
            record.push((k, k))
            if k % 100 == 99:
                rows.flush()
        assert rows.fault is not None
        assert "too slow" in str(rows.fault)
    finally:
        os.kill(process.pid, signal.SIGCONT)
    rows.close()


def test_a_writing_process_keeps_no_reader_of_the_output_waiting(tmp_path: Path) -> None:
    """It may outlive the run, and a pipe ends when its last writer has gone."""
    there = os.dup(1)
    reading, writing = os.pipe()
    try:
        os.dup2(writing, 1)
        rows = Rows(filled(1), tmp_path / "run.csv", simulated=False)
    finally:
        os.dup2(there, 1)
        os.close(there)
        os.close(writing)
    os.set_blocking(reading, False)
    assert os.read(reading, 1) == b"", "the end of the output"
    os.close(reading)
    rows.close()


def test_other_files_take_no_rows(tmp_path: Path) -> None:
    rows = Rows(filled(3), tmp_path / "run.log", simulated=True)
    rows.flush()
    rows.close()
    assert list(tmp_path.iterdir()) == []
