"""The EDS of the simulated drive: complete, judged by other readers, and what the drive answers over SDO."""

import logging
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import canopen
import pytest
from canopen.objectdictionary import ODVariable

from haptic_fieldbus.eds import EdsType, NodeOffset, eds_text, read_eds
from haptic_fieldbus.eds.names import member_name, parameter_name
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.canopen.simulated_eds import dictionary_of, sheet
from haptic_fieldbus.sim.drive.dictionary import AbortCode
from tests.builders import shipped
from tests.eds.vendor_files import both, path_of
from tests.sim.bench import NODE
from tests.sim.canopen.test_canopen_peer import Bench

pytestmark = pytest.mark.thorough(
    "the sheets of all shipped drives", quick=("generic_cia402", "maxon_epos4", "technosoft_ipos", "profile_torque.eds")
)
NAMES = [name for name in shipped() if load_profile(name).drive.usable]
EVERY = both([*NAMES, "profile_torque.eds"], ["maxon_epos4_70_15.eds"])
NAMELESS = ("delta_asda_a2", "zeroerr_erob")
"""Drives without 1008h, by their files."""
DCFCHK = Path(sys.executable).with_name("dcfchk")
"""Of dcf-tools: the checker that comes with Lely's CANopen stack."""


@pytest.fixture(params=EVERY)
def name(request: pytest.FixtureRequest) -> str:
    chosen = str(request.param)
    return chosen if chosen in NAMES else str(path_of(chosen))


@pytest.fixture
def file(name: str, tmp_path: Path) -> Path:
    path = tmp_path / "own.eds"
    path.write_text(eds_text(sheet(load_profile(name))), encoding="utf-8", newline="")
    return path


def variables(path: Path) -> list[Any]:
    """All entries as canopen reads them for our node."""
    found: list[Any] = []
    for item in canopen.import_od(str(path), NODE).values():
        found += [item] if isinstance(item, ODVariable) else list(item.values())
    return [variable for variable in found if variable.index >= 0x1000]


def test_every_entry_of_the_drive_is_in_its_sheet(name: str) -> None:
    profile = load_profile(name)
    found = {(entry.index, entry.subindex) for entry in sheet(profile)}
    assert found == {(entry.index, entry.subindex) for entry in dictionary_of(profile, NODE)}


@pytest.mark.parametrize("name", NAMES)
def test_every_object_has_the_name_of_the_standard(name: str) -> None:
    for index, item in sheet(load_profile(name)).objects.items():
        assert item.name == parameter_name(index)
        of_the_vendor = 0x2000 <= index < 0x6000
        assert of_the_vendor or not item.name.startswith("Object "), "add its name to eds.names"
        for subindex, entry in item.entries.items():
            assert entry.name == (item.name if item.is_simple else member_name(index, subindex))


def test_our_own_reader_finds_no_fault(file: Path, name: str) -> None:
    eds = read_eds(file.read_bytes())
    assert eds.faults == ()
    assert eds.objects.keys() == sheet(load_profile(name)).objects.keys()


def test_canopen_reads_it_without_a_warning(file: Path, name: str, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        node = canopen.RemoteNode(NODE, str(file))
    assert caplog.records == []
    information = node.object_dictionary.device_information
    pdo = canopen_profile(load_profile(name)).pdo
    assert (information.nr_of_RXPDO, information.nr_of_TXPDO) == (pdo.rpdos, pdo.tpdos)
    assert 1_000_000 in information.allowed_baudrates


def test_values_that_follow_the_node_id_are_formulas(name: str) -> None:
    eds = sheet(load_profile(name))
    emergency, first = eds.find(0x1014), eds.find(0x1800, 1)
    assert emergency is not None
    assert emergency.default == NodeOffset(0x80)
    assert first is not None
    assert isinstance(first.default, NodeOffset)
    assert first.default.offset & 0x7FF == 0x180


def test_types_are_those_of_the_values(name: str) -> None:
    eds = sheet(load_profile(name))
    title = eds.find(0x1008)
    assert title is not None or name in NAMELESS
    assert title is None or title.type is EdsType.VISIBLE_STRING


@pytest.mark.skipif(not DCFCHK.exists(), reason="dcfchk is not installed: pip install dcf-tools")
def test_dcfchk_finds_nothing(file: Path) -> None:
    finished = subprocess.run([DCFCHK, "-n", str(NODE), file], capture_output=True, text=True, check=False)
    assert (finished.returncode, finished.stdout, finished.stderr) == (0, "", "")


@pytest.fixture
def bench(name: str) -> Iterator[Bench]:
    subject = Bench(name)
    yield subject
    subject.bus.shutdown()


def test_the_drive_answers_over_sdo_as_its_sheet_says(bench: Bench, file: Path) -> None:
    """Each entry: length, power-on value, and who may read and write."""
    sdo = bench.node.sdo
    for variable in variables(file):
        where = f"{variable.index:04X}h:{variable.subindex:02X}"
        code, data = _uploaded(sdo, variable)
        assert (code == AbortCode.WRITE_ONLY.value) is (variable.access_type == "wo"), where
        if variable.data_type in canopen.objectdictionary.NUMBER_TYPES and not code:
            assert len(data) == len(variable) // 8, where
            if variable.default is not None and variable.access_type != "ro":
                assert variable.decode_raw(data) == variable.default, where


@pytest.mark.thorough("every object of every drive", quick=1)
def test_the_drive_lets_write_what_its_sheet_says(bench: Bench, file: Path) -> None:
    sdo = bench.node.sdo
    for variable in variables(file):
        where = f"{variable.index:04X}h:{variable.subindex:02X}"
        _, data = _uploaded(sdo, variable)
        code = _downloaded(sdo, variable, data or bytes(len(variable) // 8 or 1))
        assert (code == AbortCode.READ_ONLY.value) is (variable.access_type in ("ro", "const")), where
        if variable.data_type in canopen.objectdictionary.INTEGER_TYPES and variable.access_type not in ("ro", "const"):
            assert _announced(sdo, variable, 9) == AbortCode.TOO_LONG.value, where


def _uploaded(sdo: Any, variable: Any) -> tuple[int, bytes]:
    try:
        return 0, sdo.upload(variable.index, variable.subindex)
    except canopen.SdoAbortedError as abort:
        return abort.code, b""


def _announced(sdo: Any, variable: Any, count: int) -> int:
    """The answer to a segmented download of so many octets; a stream of canopen's goes on with it when it is let go."""
    try:
        sdo.request_response(struct.pack("<BHBL", 0x21, variable.index, variable.subindex, count))
    except canopen.SdoAbortedError as abort:
        return int(abort.code)
    return 0


def _downloaded(sdo: Any, variable: Any, data: bytes) -> int:
    if len(data) > 4 and (code := _announced(sdo, variable, len(data))):
        return code
    try:
        sdo.download(variable.index, variable.subindex, data)
    except canopen.SdoAbortedError as abort:
        return int(abort.code)
    return 0
