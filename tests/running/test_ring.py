"""The ring in shared memory: what a reader gets is whole, and readers that die leave it as it is."""

import os
import struct
import subprocess
import sys
import tempfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.running.ring import RingReader, RingWriter


def row_of(number: int, columns: int) -> tuple[float, ...]:
    """Return the row that a test pushes as number 0, 1, …: each value tells row and column."""
    return tuple(number + 1e-3 * column for column in range(columns))


@given(columns=st.integers(1, 12), capacity=st.integers(1, 9), pushed=st.integers(0, 40), first=st.integers(-3, 45))
def test_a_reader_gets_the_newest_rows_in_order(columns: int, capacity: int, pushed: int, first: int) -> None:
    writer = RingWriter(columns, capacity)
    try:
        for number in range(pushed):
            writer.push(row_of(number, columns))
        begin, rows = RingReader(writer.fd).since(first)
        # The slot of the oldest row is where the writer may be, so a full ring gives all rows but that one.
        oldest = max(first, 0, pushed - capacity + 1 if pushed >= capacity else 0)
        assert [tuple(row) for row in rows] == [row_of(number, columns) for number in range(oldest, pushed)]
        assert not len(rows) or begin == oldest
    finally:
        writer.close()


@given(torn=st.integers(0, 7))
def test_a_row_that_is_being_written_is_not_returned(torn: int) -> None:
    writer = RingWriter(3, 8)
    try:
        for number in range(8):
            writer.push(row_of(number, 3))
        # The first number of a slot is that of a row to come, as while the writer is in it.
        os.pwrite(writer.fd, struct.pack("d", 99.0), 64 + torn * 5 * 8)
        begin, rows = RingReader(writer.fd).since(0)
        assert [tuple(row) for row in rows] == [row_of(number, 3) for number in range(max(torn, 0) + 1, 8)]
        assert begin == torn + 1
    finally:
        writer.close()


def test_a_row_of_another_length_is_refused() -> None:
    writer = RingWriter(3, 8)
    with pytest.raises(struct.error):
        writer.push((1.0, 2.0))
    assert RingReader(writer.fd).pushed == 0
    writer.close()


@pytest.mark.parametrize("octets", [b"", b"too short", bytes(4096)])
def test_what_is_no_ring_is_refused(octets: bytes) -> None:
    with tempfile.TemporaryFile() as file:
        file.write(octets)
        file.flush()
        with pytest.raises(ValueError, match="no ring"):
            RingReader(file.fileno())


def test_a_reader_cannot_write() -> None:
    writer = RingWriter(1, 4)
    reader = RingReader(writer.fd)
    with pytest.raises(TypeError):
        reader._memory[0:1] = b"x"
    writer.close()


FAST_WRITER = """
import sys
from haptic_fieldbus.running.ring import RingWriter
writer = RingWriter(20, 64)
print(writer.fd, flush=True)
number = 0
while True:
    writer.push((float(number),) * 20)
    number += 1
"""
READER = """
import os, sys
from haptic_fieldbus.running.ring import RingReader
reader = RingReader(os.open(sys.argv[1], os.O_RDONLY))
while reader.pushed < 1: pass
print("reads", flush=True)
{then}
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/fd"), reason="needs /proc to hand a descriptor to a foreign process")
def test_no_row_is_torn_while_another_process_writes_as_fast_as_it_can() -> None:
    with subprocess.Popen([sys.executable, "-c", FAST_WRITER], stdout=subprocess.PIPE, text=True) as writer:
        try:
            assert writer.stdout is not None
            fd = os.open(f"/proc/{writer.pid}/fd/{writer.stdout.readline().strip()}", os.O_RDONLY)
            reader = RingReader(fd)
            os.close(fd)
            seen = 0
            while seen < 2000:
                begin, rows = reader.since(reader.pushed - 40)
                seen += len(rows)
                assert (rows == rows[:, :1]).all()
                assert [row[0] for row in rows] == [*range(begin, begin + len(rows))]
        finally:
            writer.kill()


@pytest.mark.thorough("starts 51 processes")
@pytest.mark.skipif(not os.path.exists("/proc/self/fd"), reason="needs /proc to hand a descriptor to a foreign process")
def test_the_ring_lives_though_fifty_readers_are_killed() -> None:
    writer = RingWriter(2, 16)
    path, endless = f"/proc/{os.getpid()}/fd/{writer.fd}", READER.format(then="while True: reader.since(0)")
    writer.push((0.0, 0.0))
    for number in range(1, 51):
        with subprocess.Popen([sys.executable, "-c", endless, path], stdout=subprocess.PIPE, text=True) as reader:
            assert reader.stdout is not None
            assert reader.stdout.readline() == "reads\n"
            reader.kill()
        writer.push((float(number), 0.0))
    last = READER.format(then="print(reader.pushed, reader.since(0)[1][-1][0])")
    told = subprocess.run([sys.executable, "-c", last, path], capture_output=True, text=True, check=True)
    assert told.stdout == "reads\n51 50.0\n"
    writer.close()
