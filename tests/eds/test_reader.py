"""The reader of EDS files, fault by fault: each is told with its line, and the rest of the file is still read."""

import contextlib
import string
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from haptic_fieldbus.eds import Eds, EdsEntry, EdsType, NodeOffset, ObjectCode, load_eds, read_eds
from haptic_fieldbus.errors import EdsError

LISTS = """\
[DeviceInfo]
[MandatoryObjects]
SupportedObjects=0
[OptionalObjects]
SupportedObjects=1
1=0x{index:04X}
[ManufacturerObjects]
SupportedObjects=0
"""
COMPLETE = {
    "ParameterName": "Controlword",
    "ObjectType": "0x7",
    "DataType": "0x0006",
    "AccessType": "rww",
    "DefaultValue": "0",
    "PDOMapping": "1",
}


def file_of(body: str, index: int = 0x6040) -> str:
    return LISTS.format(index=index) + body


def section(name: str = "6040", /, **changes: str | None) -> str:
    items = COMPLETE | changes
    lines = [f"{key}={value}" for key, value in items.items() if value is not None]
    return "\n".join([f"[{name}]", *lines, ""])


def read(text: str) -> Eds:
    return read_eds(text.encode())


def one(**changes: str | None) -> EdsEntry:
    entry = read(file_of(section(**changes))).find(0x6040)
    assert entry is not None
    return entry


def faults(text: str) -> list[str]:
    return [str(fault) for fault in read(text).faults]


def test_a_complete_file_has_no_fault() -> None:
    eds = read(file_of(section()))
    assert eds.faults == ()
    assert eds.find(0x6040) == EdsEntry(
        0x6040, 0, "Controlword", EdsType.UNSIGNED16, "rww", default=0, mappable=True, line=9
    )
    assert eds.find(0x6040, 1) is None
    assert eds.find(0x6041) is None
    assert 0x6041 not in eds


class TestNumbers:
    """CiA 306-1: decimal, hexadecimal with 0x, octal with a leading 0."""

    @pytest.mark.parametrize(
        ("text", "value"),
        [("16", 16), ("0x10", 16), ("0X1f", 31), ("020", 16), ("001", 1), ("008", 8), ("0", 0), ("00", 0), (" 7 ", 7)],
    )
    def test_forms(self, text: str, value: int) -> None:
        assert one(DefaultValue=text).default == value

    @pytest.mark.parametrize(
        ("text", "type", "value"),
        [
            ("-1", "0x3", -1),
            ("-0x8000", "0x3", -32768),
            ("0xFFFF", "0x3", -1),
            ("0xFFFFFFFE", "0x3", -2),
            ("0x7FFF", "0x3", 32767),
            ("0x80", "0x2", -128),
            ("0xFFFF", "0x4", 65535),
            ("1", "0x1", 1),
        ],
    )
    def test_negative_numbers_have_a_sign_or_are_twos_complement(self, text: str, type: str, value: int) -> None:
        assert one(DefaultValue=text, DataType=type).default == value

    @pytest.mark.parametrize(
        ("text", "value"),
        [
            ("$NODEID", NodeOffset(0)),
            ("$NODEID+0x180", NodeOffset(0x180)),
            ("$NodeID + 0x200", NodeOffset(0x200)),
            ("0x80000200+$NODEID", NodeOffset(0x8000_0200)),
            ("$NODEID+0x80000000+0x180", NodeOffset(0x8000_0180)),
        ],
    )
    def test_formulas_with_the_node_id(self, text: str, value: NodeOffset) -> None:
        entry = one(DefaultValue=text, DataType="0x7")
        assert entry.default == value
        assert entry.value(5) == value.offset + 5

    @pytest.mark.parametrize(
        ("text", "type", "value"),
        [
            ("0x41200000", "0x8", 10.0),
            ("2.5", "0x8", 2.5),
            ("0", "0x8", 0.0),
            ("0x3FF8000000000000", "0x11", 1.5),
            ("servo", "0x9", "servo"),
            ("0 1 2", "0x9", "0 1 2"),
            ("01 fF", "0xA", b"\x01\xff"),
            ("0x0102", "0xF", b"\x01\x02"),
        ],
    )
    def test_values_of_other_types(self, text: str, type: str, value: object) -> None:
        assert one(DefaultValue=text, DataType=type).default == value


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ParameterName": None}, "line 9: [6040] ParameterName: missing"),
        ({"ObjectType": "0x63"}, "line 11: [6040] ObjectType: 99 is not an object code: treated as a variable"),
        ({"DataType": None}, "line 9: [6040] DataType: missing: the length of the value is not known"),
        ({"DataType": "0x40"}, "line 12: [6040] DataType: 0040h is no basic data type: its length is not known"),
        ({"DataType": "sixteen"}, 'line 12: [6040] DataType: "sixteen" is not a number'),
        (
            {"AccessType": None},
            "line 9: [6040] AccessType: missing, expected one of ro, wo, rw, rwr, rww, const: treated as ro",
        ),
        (
            {"AccessType": "always"},
            'line 13: [6040] AccessType: "always", expected one of ro, wo, rw, rwr, rww, const: treated as ro',
        ),
        ({"DefaultValue": "0x1G"}, 'line 14: [6040] DefaultValue: "0x1G" is not a number'),
        ({"DefaultValue": "65536"}, 'line 14: [6040] DefaultValue: "65536" does not fit into UNSIGNED16'),
        ({"DefaultValue": "-1"}, 'line 14: [6040] DefaultValue: "-1" does not fit into UNSIGNED16'),
        (
            {"DefaultValue": "$NODEID*2"},
            'line 14: [6040] DefaultValue: "$NODEID*2" is no sum of $NODEID and a number',
        ),
        ({"DataType": "0x8", "DefaultValue": "much"}, 'line 14: [6040] DefaultValue: "much" is not a number'),
        (
            {"DataType": "0x8", "DefaultValue": "0x4120000000"},
            'line 14: [6040] DefaultValue: "0x4120000000" does not fit into REAL32',
        ),
        ({"DataType": "0xA", "DefaultValue": "xyz"}, 'line 14: [6040] DefaultValue: "xyz" is no row of octets'),
        ({"PDOMapping": "yes"}, 'line 15: [6040] PDOMapping: "yes" is not a number'),
        (
            {"DefaultValue": "1 ; one"},
            "line 14: [6040] DefaultValue: a comment after a value; expected it on a separate line",
        ),
    ],
)
def test_a_fault_of_an_entry_is_told_with_its_line_and_the_entry_is_kept(
    changes: dict[str, str | None], message: str
) -> None:
    text = file_of(section(**changes))
    assert faults(text) == [message]
    entry = read(text).find(0x6040)
    assert entry is not None
    assert entry.access in ("rww", "ro")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("[6040]\n" + section(), "line 10: [6040]: already in line 9: both are merged"),
        (section() + "DataType=0x6\n", "line 16: [6040] DataType: already in line 12"),
        (section() + "nonsense\n", 'line 16: [6040]: "nonsense" is no key with a value'),
        (section() + section("6041"), "line 16: [6041]: is in no list of objects"),
        (
            section("6040sub1"),
            "line 9: [6040sub1]: [6040], the object itself, is missing: treated as a record",
        ),
        (
            section(ObjectType="9") + section("6040sub0"),
            "line 9: [6040] SubNumber: missing, but the file has 1 sub-indices",
        ),
        (
            section(ObjectType="9", SubNumber="2") + section("6040sub0"),
            "line 16: [6040] SubNumber: 2, but the file has 1 sub-indices",
        ),
        (
            section() + section("6040sub1"),
            "line 11: [6040] ObjectType: a variable with sub-indices: treated as a record",
        ),
        ("", None),
    ],
)
def test_a_fault_of_the_form_is_told_with_its_line(body: str, message: str | None) -> None:
    if message is None:
        with pytest.raises(EdsError, match="no object: expected sections such as"):
            read(file_of(body))
    else:
        assert faults(file_of(body)) == [message]


def test_faults_of_lists_are_told() -> None:
    text = file_of(section()).replace("SupportedObjects=1", "SupportedObjects=3") + "[OptionalObjects]\n2=0x6041\n"
    assert faults(text) == [
        "line 5: [OptionalObjects] SupportedObjects: 3, but 2 are listed",
        "line 16: [OptionalObjects]: already in line 4: both are merged",
        "line 17: [OptionalObjects] 2: [6041] is not in this file",
    ]


def test_missing_sections_are_told_and_not_needed() -> None:
    eds = read("stray\n" + section())
    assert eds.device.vendor_number is None
    assert [str(fault) for fault in eds.faults] == [
        "[MandatoryObjects]: the list of objects is missing",
        "[OptionalObjects]: the list of objects is missing",
        "[ManufacturerObjects]: the list of objects is missing",
        "[DeviceInfo]: this section is missing",
        'line 1: "stray" is before the first section',
        "line 2: [6040]: is in no list of objects",
    ]


def test_an_array_may_be_written_compactly() -> None:
    body = (
        section(ObjectType="8", CompactSubObj="3", DefaultValue="7")
        + "[6040Name]\nNrOfEntries=1\n2=second\n[6040Value]\nNrOfEntries=1\n3=9\n"
    )
    eds = read(file_of(body))
    assert eds.faults == ()
    assert [entry.name for entry in eds] == ["Number of entries", "Controlword1", "second", "Controlword3"]
    assert [entry.value(1) for entry in eds] == [3, 7, 7, 9]
    assert eds.objects[0x6040].code is ObjectCode.ARRAY


def test_a_domain_needs_neither_type_nor_access() -> None:
    eds = read(file_of(section(ObjectType="2", DataType=None, AccessType=None, DefaultValue=None)))
    assert eds.faults == ()
    assert next(iter(eds)).type is EdsType.DOMAIN


def test_case_and_blanks_do_not_matter() -> None:
    eds = read(file_of("[6040]\n  parametername = Word \nOBJECTTYPE=7\ndatatype=6\naccesstype=RWW\n;comment\n"))
    assert eds.faults == ()
    entry = eds.find(0x6040)
    assert entry is not None
    assert (entry.name, entry.type, entry.access) == ("Word", EdsType.UNSIGNED16, "rww")


def test_the_device_is_described() -> None:
    text = file_of(section()).replace(
        "[DeviceInfo]\n",
        "[DeviceInfo]\nVendorName=acme\nVendorNumber=001\nProductNumber=\nBaudRate_500=1\nBaudRate_1000=0x1\n"
        "NrOfTXPDO=4\nGranularity=0\nLSS_Supported=1\nCompactPDO=1\n",
    )
    eds = read(text + "[DeviceComissioning]\nNodeID=0x7F\n[DummyUsage]\nDummy0005=1\nDummy0006=0\n")
    device = eds.device
    assert (device.vendor_name, device.vendor_number, device.product_number) == ("acme", 1, None)
    assert (device.bit_rates, device.tpdos, device.rpdos, device.granularity) == ((500, 1000), 4, None, 0)
    assert (device.lss, eds.node, eds.dummies) == (True, 127, (5,))
    assert [str(fault) for fault in eds.faults] == [
        "line 10: [DeviceInfo] CompactPDO: missing PDO parameters are not added"
    ]


def test_a_number_of_the_device_that_is_none_is_told() -> None:
    eds = read(file_of(section()).replace("[DeviceInfo]\n", "[DeviceInfo]\nVendorNumber=acme\n"))
    assert eds.device.vendor_number is None
    assert [str(fault) for fault in eds.faults] == ['line 2: [DeviceInfo] VendorNumber: "acme" is not a number']


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_every_usual_encoding_is_read(encoding: str) -> None:
    eds = read_eds(file_of(section(ParameterName="Kühlkörper")).encode(encoding))
    assert eds.faults == ()
    assert eds.objects[0x6040].entries[0].name == "Kühlkörper"


def test_windows_1252_is_read_and_told() -> None:
    eds = read_eds(file_of(section(ParameterName="Kühlkörper „40°“")).encode("cp1252"))
    assert eds.objects[0x6040].entries[0].name == "Kühlkörper „40°“"
    assert [str(fault) for fault in eds.faults] == ["line 10: octet FCh is no UTF-8: the file is read as Windows-1252"]


def test_line_ends_of_every_system_are_read() -> None:
    for end in ("\r\n", "\r", "\n"):
        assert read_eds(file_of(section()).replace("\n", end).encode()).faults == ()


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(EdsError, match=r"none\.eds: cannot be read: No such file"):
        load_eds(tmp_path / "none.eds")


LINES = st.one_of(
    st.sampled_from(
        ["[6040]", "[6040sub1]", "[6040Name]", "[DeviceInfo]", "ObjectType=8", "ObjectType=7", "CompactSubObj=2",
         "DataType=0x8", "DataType=6", "DefaultValue=0x1", "LowLimit=-1", "AccessType=ro", "1=0x6040", "=", "[", "[]"]
    ),
    st.text(alphabet=string.printable, max_size=20),
)  # fmt: skip


@given(st.lists(LINES, max_size=12))
@example(["[6040]", "CompactSubObj=2"])
def test_no_row_of_lines_makes_the_reader_fail_otherwise_than_by_an_eds_error(lines: list[str]) -> None:
    with contextlib.suppress(EdsError):
        assert read("\n".join(lines)).objects


@given(st.binary(max_size=200))
def test_no_row_of_octets_makes_the_reader_fail_otherwise_than_by_an_eds_error(data: bytes) -> None:
    with pytest.raises(EdsError):
        read_eds(data)
