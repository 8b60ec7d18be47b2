"""Recordings read back: by us, by the libraries of their formats, and after they were cut off anywhere."""

import json
import os
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from haptic_fieldbus import RecordedRun, UsageError, compare_recording, read_provenance, read_recording, repeat, run
from haptic_fieldbus.api.replaying import shown
from haptic_fieldbus.assessing.loop_report import Record
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.recordings.mcap import McapFile
from haptic_fieldbus.recordings.provenance import side_file
from haptic_fieldbus.report.plot import draw_run
from haptic_fieldbus.running.rows import Rows
from haptic_fieldbus.running.session import Session
from haptic_fieldbus.scenes.catalogue import load_scene
from tests.cli.command import Command

DURATION, FADE_IN = 0.6, 0.1


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that changes in all formats; the file is a folder's `run` with each suffix."""
    folder = tmp_path_factory.mktemp("recorded")
    for suffix in (".mcap", ".csv", ".log", ".blf"):
        run("damped_wall", duration=DURATION, fade_in=FADE_IN, record=folder / f"run{suffix}",
            settings={"wall.position": 0.001}, changes=[(0.2, {"wall.stiffness": 300.0})])  # fmt: skip
    read_recording(folder / "run.mcap").write(folder / "run.parquet")
    return folder / "run"


def of(recorded: Path, suffix: str) -> Path:
    return recorded.with_suffix(suffix)


@pytest.mark.parametrize("suffix", [".mcap", ".parquet"])
def test_every_format_of_rows_has_the_numbers_of_the_text(suffix: str, recorded: Path) -> None:
    text, found = read_recording(of(recorded, ".csv")), read_recording(of(recorded, suffix))
    assert list(found.columns) == list(text.columns)
    assert np.array_equal(found.table(), text.table())
    assert found.units == text.units
    assert found.units["handle.position"] == "m"
    assert found.units["handle.force"] == "N"
    assert found.complete
    assert found.provenance is not None
    assert found.provenance.conditions.changes == ((0.2, {"wall.stiffness": 300.0}),)
    assert found.provenance.drives["handle"]["title"] == "maxon EPOS4"


def test_the_library_of_mcap_decodes_each_period_by_its_schema(recorded: Path) -> None:
    rows = read_recording(of(recorded, ".csv"))
    with of(recorded, ".mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(rows)
        decoded = list(reader.iter_decoded_messages())
        metadata = [json.loads(each.metadata["json"]) for each in reader.iter_metadata()]
    assert [each.name for each in summary.schemas.values()] == ["haptic_fieldbus.Period"]
    for row, (_, channel, message, period) in enumerate(decoded):
        assert channel.topic == "run"
        assert message.log_time == rows["t_ns"][row]
        assert period.handle_position == rows["handle.position"][row]
        assert period.handle_target_torque == rows["handle.target torque"][row]
    beside = json.loads(side_file(of(recorded, ".csv")).read_text())
    assert beside.pop("count") == len(rows)
    assert metadata[-1] == beside | {"date": metadata[-1]["date"]}


def test_pyarrow_and_pandas_read_the_parquet_file(recorded: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_parquet(of(recorded, ".parquet"))
    found = read_recording(of(recorded, ".mcap")).to_frame()
    assert frame.equals(found)


def test_frames_are_the_same_in_both_formats(recorded: Path) -> None:
    text, binary = read_recording(of(recorded, ".log")), read_recording(of(recorded, ".blf"))
    assert np.array_equal(text["can_id"], binary["can_id"])
    assert text["data"].tolist() == binary["data"].tolist()
    assert not text.rows
    targets = [struct.unpack("<Hh", data)[1] for data in text["data"][text["can_id"] == 0x201]]
    rows = read_recording(of(recorded, ".csv"))
    # The loop writes one RPDO a period; the end of the run adds torque-free ones.
    assert targets[: len(rows)] == [int(each) for each in rows["handle.target torque"]]
    with pytest.raises(UsageError, match="frames, not rows"):
        text.table()


@pytest.mark.parametrize("suffix", [".mcap", ".parquet", ".csv"])
def test_a_run_is_repeated_from_any_recording(suffix: str, recorded: Path, tmp_path: Path) -> None:
    repeat(of(recorded, suffix), record=tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == of(recorded, ".csv").read_bytes()


def test_a_file_that_was_cut_off_anywhere_is_read_up_to_its_last_whole_chunk(recorded: Path, tmp_path: Path) -> None:
    whole, octets = read_recording(of(recorded, ".mcap")), of(recorded, ".mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    chunks = 0

    @settings(max_examples=25, deadline=None)
    @given(st.integers(0, len(octets) - 1))
    def cut(size: int) -> None:
        nonlocal chunks
        path.write_bytes(octets[:size])
        try:
            found = read_recording(path)
        except UsageError:
            assert size < 40_000  # the first provenance and chunk
            return
        assert not found.complete
        assert np.array_equal(found.table(), whole.table()[: len(found)]) or not len(found)
        chunks = max(chunks, len(found))

    cut()
    path.write_bytes(octets[:-1])
    assert len(read_recording(path)) == len(whole)
    path.write_bytes(octets[: octets.index(b"haptic_fieldbus.Period")])  # the provenance alone
    with pytest.raises(UsageError, match="cut off before its first chunk"):
        read_recording(path)
    # Each tenth of a second is on the disk by itself.
    path.write_bytes(octets[: int(len(octets) * 0.7)])
    assert len(whole) - len(read_recording(path)) <= 250


def test_a_text_that_was_cut_off_is_read_up_to_its_last_whole_line(recorded: Path, tmp_path: Path) -> None:
    for suffix in (".csv", ".log"):
        octets = of(recorded, suffix).read_bytes()
        (tmp_path / f"cut{suffix}").write_bytes(octets[:-7])
        found = read_recording(tmp_path / f"cut{suffix}")
        assert len(found) == octets.count(b"\n") - (2 if suffix == ".csv" else 1)
        assert not found.complete
        assert found.provenance is None


@pytest.mark.parametrize("suffix", [".csv", ".log", ".blf"])
def test_a_recording_that_ends_between_two_lines_is_not_complete(suffix: str, recorded: Path, tmp_path: Path) -> None:
    """As after a kill: the file ends with a whole piece, and beside it stands the provenance from before the run."""
    path = tmp_path / f"run{suffix}"
    octets, beside = of(recorded, suffix).read_bytes(), side_file(of(recorded, suffix)).read_text()
    path.write_bytes(octets)
    side_file(path).write_text(beside)
    assert read_recording(path).complete
    if suffix == ".blf":
        # https://bitbucket.org/tobylorenz/vector_blf: the size of the file stands at octet 16 of its header.
        path.write_bytes(octets[:16] + struct.pack("<Q", 144) + octets[24:])
        assert not read_recording(path).complete
        return
    path.write_bytes(octets[: octets.rindex(b"\n", 0, -1) + 1])
    assert not read_recording(path).complete
    path.write_bytes(octets)
    side_file(path).write_text(json.dumps(json.loads(beside) | {"count": None}))
    assert not read_recording(path).complete
    older = json.loads(beside)
    del older["count"]
    side_file(path).write_text(json.dumps(older))
    assert read_recording(path).complete


@pytest.mark.parametrize("suffix", [".csv", ".mcap", ".parquet"])
def test_a_copy_of_a_recording_that_was_cut_off_is_not_complete(suffix: str, recorded: Path, tmp_path: Path) -> None:
    for complete in (True, False):
        source = replace(read_recording(of(recorded, ".csv")), complete=complete)
        source.write(tmp_path / f"{complete}{suffix}")
        assert read_recording(tmp_path / f"{complete}{suffix}").complete is complete


@pytest.mark.parametrize("suffix", [".csv", ".mcap", ".parquet"])
def test_a_file_that_cannot_be_written_is_named_and_not_left_torn(suffix: str, recorded: Path, tmp_path: Path) -> None:
    found = read_recording(of(recorded, ".csv"))
    found.write(str(tmp_path / f"text{suffix}"))
    assert len(read_recording(tmp_path / f"text{suffix}")) == len(found)
    with pytest.raises(UsageError, match=f"run{suffix}: cannot be written: .*No such file or directory"):
        found.write(tmp_path / "none" / f"run{suffix}")
    program = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000));"
        "from haptic_fieldbus import read_recording; read_recording(sys.argv[1]).write(sys.argv[2])"
    )
    words = [sys.executable, "-c", program, str(of(recorded, ".csv")), str(tmp_path / f"full{suffix}")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert re.search(f"UsageError: .*full{suffix}: cannot be written: .*File too large", done.stderr)
    assert not list(tmp_path.glob("full*"))


def test_a_full_disk_leaves_no_complete_recording(tmp_path: Path) -> None:
    program = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000));"
        "from haptic_fieldbus import run;"
        "[run('wall', duration=0.5, record='lim' + each) for each in ('.csv', '.log')]"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True, capture_output=True)
    for suffix in (".csv", ".log"):
        found = read_recording(tmp_path / f"lim{suffix}")
        assert (len(found) > 50, found.complete) == (True, False)


def test_a_disk_that_is_full_for_a_while_leaves_no_complete_recording(tmp_path: Path) -> None:
    from haptic_fieldbus.recordings.mcap import McapFile

    record, whole, full = Record(("t_ns", "x"), 100), McapFile.take, [True, False]

    def take(self: McapFile, octets: bytes) -> None:
        if full and full.pop():
            raise OSError(28, "No space left on device")
        whole(self, octets)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(McapFile, "take", take)
        rows = Rows(record, tmp_path / "x.mcap", simulated=True)
        for number in range(3):
            record.push((1e6 * number, 0.0))
            rows.flush()
        rows.close()
    assert rows.fault is not None
    assert not read_recording(tmp_path / "x.mcap").complete


@pytest.mark.parametrize("suffix", [".csv", ".mcap", ".log"])
@pytest.mark.parametrize("refused", [(CanopenBus, "inspect"), (Session, "_ask")], ids=["by the bus", "by a person"])
def test_a_run_that_never_begins_leaves_the_earlier_recording(
    suffix: str, refused: tuple[type, str], tmp_path: Path
) -> None:
    path = tmp_path / f"old{suffix}"
    run("wall", duration=0.05, record=path)
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(*refused, raising)
        with pytest.raises(BusError):
            run("wall", duration=0.05, record=path)
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before
    run("wall", duration=0.07, record=path)
    assert {each.name for each in tmp_path.iterdir()} == {*before}
    assert path.read_bytes() != before[path.name]


def raising(*_: object) -> None:
    raise BusError("the adapter is not there")


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_a_run_is_not_repeated_over_itself(suffix: str, command: Command, tmp_path: Path) -> None:
    path = tmp_path / f"bench{suffix}"
    run("wall", duration=0.05, record=path)
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / f"other{suffix}").symlink_to(path)
    for record in (path, tmp_path / "link" / f"other{suffix}"):
        with pytest.raises(UsageError, match="this file is repeated, and would be overwritten"):
            repeat(path, record=record)
        assert command("run", "--from", path, "--record", record).status == 2
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir() if each.is_file()} == before


@pytest.mark.parametrize("name", ["wall 12:30", "a\\b", "two\nlines", "x" * 240])
def test_a_scene_of_any_name_is_recorded_read_and_repeated(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    run(replace(load_scene("wall"), name=name), duration=0.05, record=path)
    assert read_recording(path).complete
    repeat(path, record=tmp_path / "b.csv")
    assert path.read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_a_record_through_a_link_to_a_file_that_is_not_there_leaves_the_link(tmp_path: Path) -> None:
    target, link = tmp_path / "big.csv", tmp_path / "run.csv"
    link.symlink_to(target)
    run("wall", duration=0.05, record=link)
    assert link.is_symlink()
    assert read_recording(target).columns


def test_another_process_writes_the_same_file(recorded: Path, tmp_path: Path) -> None:
    """As on a real bus: rows go through a pipe."""
    found = read_recording(of(recorded, ".mcap"))
    assert found.provenance is not None
    record = Record(list(found.columns), len(found))
    file = Rows(record, tmp_path / "b.mcap", simulated=False, provenance=found.provenance)
    for row in found.table().tolist():
        record.push(row)
        if record.pushed % 100 == 0:
            file.flush()
    file.close(found.provenance)
    assert file.fault is None
    again = read_recording(tmp_path / "b.mcap")
    assert again.complete
    assert np.array_equal(again.table(), found.table())
    assert again.provenance == found.provenance


# `replay`.


def test_a_recording_is_summarised_converted_and_drawn(recorded: Path, command: Command, tmp_path: Path) -> None:
    source = tmp_path / "run.mcap"
    source.write_bytes(of(recorded, ".mcap").read_bytes())
    done = command("replay", str(source), "--to", "csv", "--plot", str(tmp_path / "run.png"))
    assert done.status == 0
    assert "rows, 0.6" in done.out
    assert "damped_wall" in done.out
    assert (tmp_path / "run.csv").read_bytes() == of(recorded, ".csv").read_bytes()
    assert read_provenance(tmp_path / "run.png") == read_provenance(source)
    other = command("replay", str(source), "--to", "xlsx")
    assert other.status == 2
    assert '"xlsx"; expected csv, mcap, parquet' in other.err
    refused = command("replay", str(source), "--to", "csv")
    assert (refused.status, "exists" in refused.err) == (2, True)
    told = json.loads(command("replay", str(source), "--json").out)
    assert told["complete"] is True
    assert told["columns"]["handle.velocity"] == "m/s"


def test_a_cut_file_is_written_anew_with_its_index(recorded: Path, command: Command, tmp_path: Path) -> None:
    source = tmp_path / "run.mcap"
    octets = of(recorded, ".mcap").read_bytes()
    source.write_bytes(octets[: len(octets) * 3 // 4])
    done = command("replay", str(source), "--repair")
    assert "cut off" in done.out
    mended = read_recording(tmp_path / "run.repaired.mcap")
    assert not mended.complete
    assert len(mended) == len(read_recording(source)) > 100
    with (tmp_path / "run.repaired.mcap").open("rb") as stream:
        assert make_reader(stream).get_summary() is not None
    assert command("replay", str(of(recorded, ".csv")), "--repair").status == 2


def test_a_recording_without_units_is_drawn_without_them(tmp_path: Path) -> None:
    """A rotary one: its positions are those of the file, and no axis says millimetres."""
    run("knob_menu", duration=0.3, record=tmp_path / "knob.csv")
    for beside, label, factor in ((True, "position [°]", 180.0 / np.pi), (False, "position [m or rad]", 1.0)):
        if not beside:
            side_file(tmp_path / "knob.csv").unlink()
        found = read_recording(tmp_path / "knob.csv")
        panel = draw_run(shown(found)).axes[0]
        assert panel.get_ylabel() == label
        assert float(np.max(panel.lines[0].get_ydata())) == pytest.approx(factor * found["knob.position"].max())


def test_the_picture_of_a_recording_has_the_wall_and_when_it_was_changed(recorded: Path) -> None:
    found = read_recording(of(recorded, ".csv"))
    whole, over = draw_run(shown(found)).axes[:2]
    assert "wall" in {text.get_text() for text in whole.texts}
    assert [float(np.asarray(line.get_xdata())[0]) for line in whole.lines if line.get_linestyle() == ":"] == [0.2]
    lines = {str(line.get_label()): line for line in over.lines}
    assert lines["wall"].get_xdata() == pytest.approx([1.0, 1.0], rel=1e-12), "in mm"
    place, law = (np.asarray(each) for each in lines["force at rest"].get_data())
    assert law == pytest.approx(np.where(place > 1.0, -0.6 * (place - 1.0), 0.0), abs=1e-9)
    assert found.provenance is not None
    without = shown(replace(found, provenance=replace(found.provenance, scene=None)))  # as of an own element
    assert "force at rest" not in {str(line.get_label()) for panel in draw_run(without).axes for line in panel.lines}
    (warning,) = without.warnings
    assert "not drawn: the recorded run cannot be repeated: an element of its scene is an object of Python" in warning


@pytest.mark.parametrize("suffix", [".mcap", ".parquet", ".csv"])
def test_recorded_feedback_gives_the_recorded_set_points(suffix: str, recorded: Path) -> None:
    assert compare_recording(of(recorded, suffix)) is None


def test_a_controller_that_was_changed_by_one_line_differs_from_a_named_period(
    recorded: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The planted change: the wall is stiffer by 2 %."""
    from haptic_fieldbus.scenes.wall import Wall

    rows = read_recording(of(recorded, ".mcap"))
    forces = np.flatnonzero(rows["handle.target torque"])
    law: Callable[..., float] = Wall.force

    monkeypatch.setattr(Wall, "force", lambda self, *feedback: 1.02 * law(self, *feedback))
    difference = compare_recording(rows)
    assert difference is not None
    assert difference.column == "handle.target torque"
    assert forces[0] <= difference.period <= forces[-1]
    assert difference.recorded == rows["handle.target torque"][difference.period]
    assert difference.today != difference.recorded
    told = command("replay", str(of(recorded, ".mcap")), "--compare", "--json")
    assert told.status == 1
    assert json.loads(told.out)["first_difference"]["period"] == difference.period


def test_faults_are_compared_too(tmp_path: Path) -> None:
    run("wall", duration=0.5, record=tmp_path / "a.mcap", faults="random@4", settings={"wall.position": 0.002})
    assert compare_recording(tmp_path / "a.mcap") is None


def test_what_cannot_be_compared_is_said(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="frames, not rows"):
        compare_recording(of(recorded, ".log"))
    (tmp_path / "bare.csv").write_bytes(of(recorded, ".csv").read_bytes())
    with pytest.raises(UsageError, match="no provenance"):
        compare_recording(tmp_path / "bare.csv")
    found = read_recording(of(recorded, ".csv"))
    columns = {name: values for name, values in found.columns.items() if name != "handle.statusword"}
    with pytest.raises(UsageError, match=r"today's plan needs handle\.statusword, not recorded"):
        compare_recording(RecordedRun(found.path, columns, found.units, found.provenance, complete=True))


OF_A_DRAWING = "t_ns,handle.command,handle.position\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "row 1.*the first of them t_ns"),
        ("time,position\n0,1\n1,2\n", "row 1.*the first of them t_ns"),
        ("\ufefftime,position\r\n0,1\r\n", 'row 1: "time,position"; expected names'),
        ("time,position\r0,1\r", 'row 1: "time,position"; expected names'),
        ("time,position", 'row 1: "time,position"; expected names'),
        ("t_ns,t_ns\n0,1\n5,6\n", "row 1.*each once"),
        ("t_ns,x\nnan,1\n1,2\n", "row 2, column t_ns: nan; expected a finite time"),
        ("t_ns,x\n0,1\ninf,2\ninf,2\n", "row 3, column t_ns: inf; expected a finite time"),
        ("t_ns,x\n1000000,1\n0,2\n", "row 3, column t_ns: 0; expected a finite time, later than"),
    ],
)
def test_a_table_that_is_no_recording_names_row_and_column(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(UsageError, match=f"a.csv: {words}"):
        read_recording(tmp_path / "a.csv")


@pytest.mark.parametrize("times", [[0.0, 2.0, 1.0], [0.0, 1.0, 1.0]], ids=str)
@pytest.mark.parametrize("suffix", [".mcap", ".parquet"])
def test_rows_of_any_format_have_rising_times(suffix: str, times: list[float], tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    RecordedRun(path, {"t_ns": np.array(times)}, {}, None, complete=True).write(path)
    with pytest.raises(UsageError, match=r"column t_ns: 1; expected a finite time, later than"):
        read_recording(path)


def test_a_table_of_another_program_is_read_with_its_mark_and_its_ends_of_lines(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbft_ns,handle.position\r\n0,2\r\n1000000,3\r\n")
    found = read_recording(tmp_path / "a.csv")
    assert list(found.columns) == ["t_ns", "handle.position"]
    assert found["handle.position"].tolist() == [2.0, 3.0]
    assert found.rows


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_ns,handle.command\n0,1\n1000000,2\n", "no column handle.position"),
        (OF_A_DRAWING + "0,1,2\n1000000,nan,3\n", "row 3, column handle.command: nan; expected a finite number"),
        (OF_A_DRAWING + "0,1,inf\n1000000,1,3\n", "row 2, column handle.position: inf; expected a finite number"),
    ],
)
def test_what_cannot_be_drawn_is_said(text: str, words: str, command: Command, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    done = command("replay", str(tmp_path / "a.csv"), "--plot", str(tmp_path / "a.png"))
    assert (done.status, re.search(words, done.err) is not None) == (2, True)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.nan, r"row 42, column handle\.statusword: nan; expected the raw value of a drive"),
        (np.inf, r"row 42, column handle\.statusword: inf"),
        (1e30, r"row 42, column handle\.statusword: 1e\+30"),
        (0.5, r"row 42, column handle\.statusword: 0\.5"),
        (70000.0, "row 42: .*expected the raw value of a drive"),
    ],
)
def test_a_raw_value_that_no_drive_sends_is_not_compared(value: float, words: str, recorded: Path) -> None:
    found = read_recording(of(recorded, ".csv"))
    found["handle.statusword"][40] = value
    with pytest.raises(UsageError, match=words):
        compare_recording(found)


def test_what_is_no_recording_is_said(tmp_path: Path) -> None:
    for name, octets, message in (
        ("a.txt", b"", "expected a recording"),
        ("a.mcap", b"no", "no MCAP file"),
        ("a.csv", b"t_ns,x\n1,2,3\nx", r'line 2: "1,2,3"; expected 2 numbers between commas'),
        ("b.csv", b"t_ns,x\n1,2\n\n3,4\nhello,5\n6,7\n", r'line 5: "hello,5"; expected 2 numbers'),
        ("c.csv", b"t_ns,x\n1,2\nhello,5\n6,7\n", r'line 3: "hello,5"; expected 2 numbers between commas'),
        ("d.csv", b"t_ns,x\n1,2\n\xf0\xf1,5\n", "line 3: not UTF-8: octet 0xF0"),
        ("e.log", b"", "an empty file; expected frames"),
        ("f.log", b"(1.0) can0 123#00\n\xb5\n", "line 2: not UTF-8: octet 0xB5"),
        ("a.log", b"no\n", "line 1 is not as candump -L writes it"),
        ("odd.log", b"(1.0) can0 123#0\n", "line 1 is not as candump -L writes it"),
        ("fd.log", b"(1.0) can0 123#00 R\n(1.0) can0 123##4AABB R\n", "line 2 is a frame of CAN FD; remove such lines"),
        ("a.blf", b"no" * 200, "no recording of this format"),
        ("a.parquet", b"PAR1" * 20, "no recording of this format"),
    ):
        (tmp_path / name).write_bytes(octets)
        with pytest.raises(UsageError, match=message):
            read_recording(tmp_path / name)
    with pytest.raises(UsageError, match="No such file"):
        read_recording(tmp_path / "none.csv")
    for suffix in (".csv", ".mcap", ".log", ".blf", ".parquet"):
        os.mkfifo(tmp_path / f"fifo{suffix}")
        (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
        for name, kind in (("fifo", "a FIFO"), ("zero", "a device")):
            with pytest.raises(UsageError, match=f"it is {kind}; expected a regular file"):
                read_recording(tmp_path / f"{name}{suffix}")
    with pytest.raises(TypeError, match="path: expected"):
        read_recording(3)  # type: ignore[arg-type]


WITHOUT = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("pandas", "pyarrow", "mcap", "distributed", "matplotlib"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Blocked())
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if name in ("pandas", "pyarrow", "mcap", "distributed") else found(name)
import haptic_fieldbus as h
h.run("wall", duration=0.01, record="a.csv")
h.run("wall", duration=0.01, record="a.log")
h.repeat("a.csv")
assert len(h.read_recording("a.csv"))
with h.session("wall", duration=0.01) as live:
    list(live)
assert h.compare_recording("a.csv") is None
for call in (
    lambda: h.run("wall", duration=0.01, record="a.mcap"),
    lambda: h.read_recording("a.csv").to_arrow(),
    lambda: h.sweep("wall", {"rate": [500.0]}, out="sweep"),
):
    try:
        call()
    except h.UsageError as error:
        print(error)
"""


def test_without_the_extras_all_else_works_and_they_are_named(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == [
        "this needs mcap; in a checkout, run: pip install -e '.[data]'",
        *["this needs pyarrow; in a checkout, run: pip install -e '.[data]'"] * 2,
    ], done.stderr


def size_of(path: Path) -> int:
    """Of a file that may not be there: a command makes and removes it once to see whether it can be written."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


@pytest.mark.thorough("ends a process in the middle of its run")
def test_a_run_that_is_killed_leaves_its_whole_chunks(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "haptic_fieldbus", "run", "wall", "--duration", "10000", "--record", str(path)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while size_of(path) < 300_000:
            assert process.poll() is None
    finally:
        process.kill()
        process.wait()
    found = read_recording(path)
    assert not found.complete
    assert len(found) > 1000
    assert compare_recording(found) is None


def test_identifiers_have_the_flags_that_tell_kinds_of_frames_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("".join(f"(1.000000) can0 {each}\n" for each in ("181#", "00000181#", "701#R", "20000004#00")))
    assert [hex(each) for each in read_recording(path)["can_id"]] == ["0x181", "0x80000181", "0x40000701", "0x20000004"]
    messages = [
        can.Message(arbitration_id=0x181, is_extended_id=False),
        can.Message(arbitration_id=0x181, is_extended_id=True),
        can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True),
    ]
    with can.BLFWriter(tmp_path / "a.blf") as writer:
        for message in messages:
            writer.on_message_received(message)
    assert [hex(each) for each in read_recording(tmp_path / "a.blf")["can_id"]] == ["0x181", "0x80000181", "0x40000701"]


def test_frames_have_what_candump_adds_to_them(tmp_path: Path) -> None:
    """Lengths of remote frames, length codes, and the direction that `candump -x` and python-can write."""
    lines = ("123#R8", "12345678#R3 T", "123#1122334455667788_B R", "123#11 T", "20000080# R", "123#R8_B")
    path = tmp_path / "a.log"
    path.write_text("".join(f"(1.000000) can0 {each}\n" for each in lines))
    found = read_recording(path)
    assert [hex(each) for each in found["can_id"]] == [
        "0x40000123", "0xd2345678", "0x123", "0x123", "0x20000080", "0x40000123"
    ]  # fmt: skip
    assert [each.hex() for each in found["data"]] == ["", "", "1122334455667788", "11", "", ""]


def test_rows_without_provenance_have_none_of_another_recording(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    run("wall", duration=0.05, record=path)
    found = read_recording(path)
    replace(found, provenance=None).write(path)
    assert read_recording(path).provenance is None


def test_frames_of_a_binary_file_that_ends_within_an_object_are_kept(tmp_path: Path) -> None:
    path, message = tmp_path / "a.blf", can.Message(arbitration_id=0x181, is_extended_id=False)
    with can.BLFWriter(path, max_container_size=100) as writer:
        for _ in range(50):
            writer.on_message_received(message)
    octets = path.read_bytes()
    last = octets.rindex(b"LOBJ")
    for size in (last + 1, last + 9):
        path.write_bytes(octets[:size])
        found = read_recording(path)
        assert (len(found) > 40, found.complete) == (True, False)


def test_a_table_without_times_is_no_recording(tmp_path: Path) -> None:
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pyarrow.table({"a": [1.0, 2.0]}), tmp_path / "a.parquet")
    with pytest.raises(UsageError, match="it has no column t_ns"):
        read_recording(tmp_path / "a.parquet")


def test_messages_of_another_length_are_no_rows(tmp_path: Path) -> None:
    """Three of three octets are one row of nine octets only together."""
    file = McapFile(tmp_path / "a.mcap", ["t_ns"], {}, "")
    for octets in (b"one", b"two", b"six"):
        file._writer.add_message(file._channel, 0, octets, 0)
    file.close("")
    with pytest.raises(UsageError, match=r"a\.mcap: no MCAP file of a run: a message with other fields"):
        read_recording(tmp_path / "a.mcap")


def test_the_library_of_mcap_decodes_columns_of_any_letters(tmp_path: Path) -> None:
    from haptic_fieldbus.recordings.mcap import McapFile

    file = McapFile(tmp_path / "a.mcap", ["t_ns", "größe.position"], {}, "")
    file.take(np.array([1e6, 0.5]).tobytes())
    file.close("")
    with (tmp_path / "a.mcap").open("rb") as stream:
        messages = [
            each for *_, each in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        ]
    assert [each.gr_e_position for each in messages] == [0.5]
    assert list(read_recording(tmp_path / "a.mcap").columns) == ["t_ns", "größe.position"]
