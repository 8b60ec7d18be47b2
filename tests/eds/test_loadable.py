"""EDS files that are written here load in other programs, whatever they were made from."""

import logging
import string
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import canopen
import dcf  # type: ignore[import-untyped]
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.eds import (
    DeviceInfo,
    Eds,
    EdsEntry,
    EdsObject,
    EdsType,
    NodeOffset,
    ObjectCode,
    eds_text,
    read_eds,
)
from haptic_fieldbus.eds.model import ACCESS_TYPES
from tests.eds.peculiar import SHEETS
from tests.eds.sheets import changed, generic, without, without_member
from tests.eds.vendor_files import FILES, both, eds_of

NODE = 5
NUMBERS = st.integers(-(1 << 63), (1 << 64) - 1) | st.integers(-200, 300)
NAMES = st.text(string.ascii_letters + string.digits + " =;#[]%$é\t", max_size=20)
VALUES = st.none() | NUMBERS | st.floats() | NAMES | st.binary(max_size=9) | NUMBERS.map(NodeOffset)
LIMITS = st.none() | NUMBERS | st.floats()
INDICES = st.sampled_from((0x1000, 0x1001, 0x1018, 0x1400, 0x1600, 0x1801, 0x1A01, 0x1A02)) | st.integers(0, 0xFFFF)


@contextmanager
def written(eds: Eds) -> Iterator[Path]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "own.eds"
        path.write_text(eds_text(eds), encoding="utf-8", newline="")
        yield path


def load(path: Path) -> dcf.Device:
    """As each of the other readers does it; raises what they raise."""
    logging.disable(logging.CRITICAL)
    try:
        canopen.import_od(str(path), NODE)
    finally:
        logging.disable(logging.NOTSET)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = dcf.parse_file(str(path))
        assert dcf.lint(found), [str(each.message) for each in told]
        return dcf.Device(found, {"NODEID": NODE})


@st.composite
def objects(draw: st.DrawFn) -> EdsObject:
    index = draw(INDICES)
    subindices = draw(st.sets(st.integers(0, 0xFF), max_size=4))
    entries = {
        subindex: EdsEntry(
            index, subindex, draw(NAMES), draw(st.none() | st.sampled_from(EdsType)),
            draw(st.sampled_from(ACCESS_TYPES)),
            draw(VALUES), draw(VALUES), draw(LIMITS), draw(LIMITS), draw(st.booleans()),
        )
        for subindex in sorted(subindices)
    }  # fmt: skip
    return EdsObject(index, draw(NAMES), draw(st.sampled_from(ObjectCode)), entries)


@st.composite
def sheets(draw: st.DrawFn) -> Eds:
    found = draw(st.lists(objects(), max_size=6))
    device = DeviceInfo(draw(NAMES), draw(NUMBERS), draw(NAMES), draw(NUMBERS), draw(NUMBERS), draw(NAMES))
    comments = tuple(draw(st.lists(NAMES, max_size=3)))
    return Eds({each.index: each for each in found}, device, comments=comments, file_info={"FileName": draw(NAMES)})


@given(sheets())
def test_any_sheet_at_all_loads_in_canopen_and_in_dcf_tools(eds: Eds) -> None:
    with written(eds) as path:
        load(path)
    assert read_eds(eds_text(eds).encode()).objects


@pytest.mark.thorough("other readers take a second for each sheet", quick=5)
@pytest.mark.parametrize(
    "eds",
    [
        changed(generic(), 0x1003, 1, type=None, default=3, low=1, high=9),
        changed(generic(), 0x6071, type=None),
        changed(generic(), 0x1018, 0, type=EdsType.UNSIGNED32, default=4),
        changed(generic(), 0x2000, type=EdsType.REAL32, default=0.1, low=0.0, high=1e300),
        changed(generic(), 0x6060, default=-128, low=0),
        changed(generic(), 0x1A00, 1, default=0x2FFF_0010),
        without(generic(), 0x1000, 0x1001, 0x1018),
        without(generic(), 0x1601, 0x1802),
        without_member(generic(), 0x1018, 1),
        changed(changed(generic(), 0x1A00, 1, default=0x2FFF_0010), 0x1A00, 1, low=1, high=2),
        changed(without(generic(), 0x1800), 0x1800, type=None, default=7),
        changed(generic(), 0x0040, 1),
        Eds({}),
    ],
)
def test_what_stopped_a_reader_is_written_otherwise_or_left_out(eds: Eds) -> None:
    with written(eds) as path:
        load(path)


def test_reals_are_written_as_dcf_tools_read_them() -> None:
    eds = changed(generic(), 0x2000, type=EdsType.REAL32, default=2.5)
    with written(eds) as path:
        assert load(path)[0x2000][0].parse_value() == 2.5
    entry = read_eds(eds_text(eds).encode()).find(0x2000)
    assert entry is not None
    assert entry.default == 2.5


def test_a_negative_offset_to_the_node_id_is_read_by_all() -> None:
    eds = changed(generic(), 0x2000, type=EdsType.INTEGER16, default=NodeOffset(-7))
    with written(eds) as path:
        assert load(path)[0x2000][0].parse_value() == NODE - 7
        theirs = canopen.import_od(str(path), NODE).get_variable(0x2000)
        assert theirs is not None
        assert theirs.default == NODE - 7


@pytest.mark.parametrize("name", both(SHEETS, FILES))
def test_every_vendors_file_loads_everywhere_once_it_is_written_here(name: str) -> None:
    eds = eds_of(name)
    with written(eds) as path:
        device = load(path)
    assert {index for index in eds.objects if index >= 0x1000} <= device.keys() | {0x1018}


@pytest.mark.thorough("a process for each file", quick=("profile_torque.eds",))
@pytest.mark.parametrize("name", both(SHEETS, FILES[::4]))
def test_dcfgen_makes_a_network_of_a_vendors_file(name: str) -> None:
    with written(eds_of(name)) as path:
        network = path.with_name("network.yml")
        network.write_text(f"master:\n  node_id: 1\ndrive:\n  dcf: {path}\n  node_id: {NODE}\n")
        program = str(Path(sys.executable).with_name("dcfgen"))
        made = subprocess.run([program, "-d", path.parent, network], capture_output=True, text=True, check=False)
        assert made.returncode == 0, made.stderr
        assert (path.parent / "master.dcf").exists()
