"""The ring of rows, and files of frames and rows."""

from contextlib import closing
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.assessing.loop_report import Record
from haptic_fieldbus.buses.canopen.frames import CandumpWriter, open_frame_writer


@given(capacity=st.integers(1, 20), pushed=st.integers(0, 70))
def test_the_ring_holds_the_last_rows_in_order_of_time(capacity: int, pushed: int) -> None:
    record = Record(("k", "square"), capacity)
    for k in range(pushed):
        record.push((k, k * k))
    expected = list(range(pushed))[-capacity:] if pushed else []
    assert len(record) == len(expected)
    assert record.pushed == pushed
    assert record.column("k").tolist() == expected
    assert record.column("square").tolist() == [k * k for k in expected]
    assert record.rows().shape == (len(expected), 2)


def test_columns_are_copies() -> None:
    record = Record(("a",), 2)
    record.push((1.0,))
    column = record.column("a")
    record.push((2.0,))
    record.push((3.0,))
    assert column.tolist() == [1.0]


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(Exception, match="2 items"):
        Record(("a", "b"), 1).push((1.0,))


FRAMES = (
    (0, 0x080, b"", "(0000000000.000000) can0 080#"),
    (1_234_567_890, 0x181, b"\x27\x00\xff", "(0000000001.234567) can0 181#2700FF"),
    (2_000_000_999, 0x8000_0080, b"\x01", "(0000000002.000000) can0 00000080#01"),
    (3_000_000_000, 0x4000_0581, b"", "(0000000003.000000) can0 581#R"),
    (4_000_000_000, 0x2000_0040, bytes(8), "(0000000004.000000) can0 20000040#0000000000000000"),
)


def test_candump_lines_are_those_of_can_utils(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    with closing(CandumpWriter(path)) as writer:
        for t_ns, can_id, data, _ in FRAMES:
            writer(t_ns, can_id, data)
    assert path.read_bytes().decode() == "".join(line + "\n" for *_, line in FRAMES)


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_python_can_reads_back_every_frame(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    writer = open_frame_writer(path)
    assert writer is not None
    sent = [(k * 1_000_000, 0x181 + k, bytes(range(k))) for k in range(9)]
    for t_ns, can_id, data in sent:
        writer(t_ns, can_id, data)
    writer.close()
    with can.LogReader(path) as reader:
        read = [(message.arbitration_id, bytes(message.data)) for message in reader]
    assert read == [(can_id, data) for _, can_id, data in sent]


def test_candump_names_the_channel_of_each_bus_spaces_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    with closing(CandumpWriter(path)) as writer:
        left, right = writer.channel("left"), writer.channel("right arm")
        right(1_000, 0x080, b"")
        left(2_000, 0x181, b"\x01")
    assert path.read_text() == "(0000000000.000001) right_arm 080#\n(0000000000.000002) left 181#01\n"


def test_blf_numbers_the_channels_in_the_order_in_which_they_were_asked_for(tmp_path: Path) -> None:
    writer = open_frame_writer(tmp_path / "run.blf")
    assert writer is not None
    channels = [writer.channel(name) for name in ("left", "right")]
    for at, (number, can_id) in enumerate([(1, 0x080), (0, 0x181), (1, 0x182)]):
        channels[number](at * 1_000_000, can_id, b"")
    writer.close()
    with can.LogReader(tmp_path / "run.blf") as reader:
        read = [(message.channel, message.arbitration_id) for message in reader]
    assert read == [(1, 0x080), (0, 0x181), (1, 0x182)]


def test_a_file_of_anything_else_takes_no_frames() -> None:
    assert open_frame_writer(Path("run.csv")) is None
