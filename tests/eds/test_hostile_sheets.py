"""Files that claim too much: numbers of elements, of digits, of faults; read in bounded memory and time."""

import contextlib
from pathlib import Path

import pytest

from haptic_fieldbus.eds import read_eds
from haptic_fieldbus.eds.lines import MOST_FAULTS
from haptic_fieldbus.eds.reader import MOST_ENTRIES
from haptic_fieldbus.errors import EdsError
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.sim.canopen.simulated_eds import sheet
from tests.documents.hostile import READERS, said_of

NUMBERS = (
    "0xFFFFFFFF", "0xFFFFFFFFFFFFFFFFFF", "9" * 5000, "0x" + "f" * 100_000, "-1", "-0x80000000", "$NODEID+0xFF",
    "07" * 3000,
)  # fmt: skip
LINES = {
    "compact": "[1003]\nParameterName=x\nObjectType=8\nDataType=7\nCompactSubObj=0xFFFFFFFF\n",
    "compact, all": "".join(f"[{index:04X}]\nObjectType=8\nCompactSubObj=254\n" for index in range(0x1000, 0x9000)),
    "blanks": "[1000]\nParameterName=a" + " " * 1_000_000 + "b\n",
    "semicolons": "[1000]\nParameterName=a" + " ;" * 500_000 + "\n",
    "no keys": "[1000]\n" + "x\n" * 500_000,
    "keys": "[1000]\n" + "".join(f"k{number}=1\n" for number in range(150_000)),
    "sections": "".join(f"[s{number}]\n" for number in range(150_000)),
    "one key": "[1000]\n" + "a=1\n" * 400_000,
    "lines": "\n" * 1_900_000,
    "brackets": "[" * 1_900_000,
}  # fmt: skip


@pytest.mark.thorough("a process for each file", quick=("compact", "brackets"))
@pytest.mark.parametrize("kind", LINES)
def test_a_file_that_claims_too_much_is_read_in_bounded_memory(kind: str, tmp_path: Path) -> None:
    (tmp_path / "x.eds").write_text(LINES[kind])
    (tmp_path / "x.dcf").write_text(LINES[kind])
    for said in said_of(tmp_path, {name: READERS[name] for name in ("eds", "dcf")}).values():
        assert said is None or len(said) < 200_000


def test_a_compact_array_has_as_many_elements_as_there_are_sub_indices() -> None:
    eds = read_eds(LINES["compact"].encode())
    assert any("CompactSubObj: 4294967295, expected 0 to 254" in str(fault) for fault in eds.faults)
    most = read_eds(LINES["compact"].replace("0xFFFFFFFF", "254").encode())
    assert len(most.objects[0x1003].entries) == 255


def test_entries_and_faults_are_counted_and_the_others_left_out() -> None:
    eds = read_eds(LINES["compact, all"].encode())
    assert MOST_ENTRIES < len(list(eds)) <= MOST_ENTRIES + 255
    assert len(eds.faults) <= MOST_FAULTS + 1
    assert any("are omitted" in fault.message for fault in eds.faults)


KEYS = ("ObjectType", "DataType", "AccessType", "PDOMapping", "SubNumber", "CompactSubObj", "LowLimit", "HighLimit",
        "DefaultValue", "ParameterValue")  # fmt: skip
DEVICE = ("VendorNumber", "ProductNumber", "RevisionNumber", "NrOfRXPDO", "NrOfTXPDO", "Granularity", "CompactPDO")
WHOLE = (
    (0x1000, 7), (0x1018, 7), (0x1400, 7), (0x1600, 7), (0x1800, 7), (0x1A00, 7), (0x6040, 6), (0x6041, 6),
    (0x6060, 2), (0x6061, 2), (0x6064, 4), (0x6071, 3), (0x6076, 7), (0x6077, 3), (0x6502, 7),
)  # fmt: skip


def described(index: int, type_: int, extra: str = "") -> str:
    access = "rww" if index in (0x6040, 0x6071, 0x6060) else "rw"
    base = f"ParameterName=x\nDataType={type_}\nAccessType={access}\nPDOMapping=1\n"
    if index < 0x1018 or index >= 0x6000:
        return f"[{index:04X}]\nObjectType=7\n{base}{extra}"
    inner = "".join(f"[{index:04X}sub{number}]\nObjectType=7\n{base}{extra}" for number in range(6))
    return f"[{index:04X}]\nParameterName=x\nObjectType=9\nSubNumber=6\n{inner}"


def test_the_plain_file_is_a_drive() -> None:
    eds = read_eds("".join(described(*each) for each in WHOLE).encode())
    assert sheet(profile_from_eds(eds)).objects


@pytest.mark.thorough("every key with every number", quick=3)
@pytest.mark.parametrize("number", NUMBERS, ids=lambda text: text[:12])
@pytest.mark.parametrize("key", KEYS)
def test_every_key_with_every_number_gives_a_drive_or_a_sentence(key: str, number: str) -> None:
    for chosen in WHOLE:
        text = "".join(described(*each, extra=f"{key}={number}\n" * (each == chosen)) for each in WHOLE)
        with contextlib.suppress(EdsError):
            assert sheet(profile_from_eds(read_eds(text.encode()))).objects


@pytest.mark.thorough("80 cases of one rule", quick=27)
@pytest.mark.parametrize("number", NUMBERS, ids=lambda text: text[:12])
@pytest.mark.parametrize("key", [*DEVICE, "SupportedObjects", "1", "NodeID"])
def test_every_key_of_the_device_with_every_number_gives_a_drive_or_a_sentence(key: str, number: str) -> None:
    heads = "".join(
        f"[{name}]\n{key}={number}\n" for name in ("DeviceInfo", "OptionalObjects", "DeviceComissioning", "DummyUsage")
    )
    text = heads + "".join(described(*each) for each in WHOLE)
    assert sheet(profile_from_eds(read_eds(text.encode()))).objects
