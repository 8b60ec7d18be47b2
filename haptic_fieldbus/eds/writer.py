"""Write an EDS that `reader` reads back and that other programs load, whatever the `Eds` was made from.

It is complete in the keys that CiA 306-1 requires. Objects go into the list of their range: mandatory 1000h, 1001h and
1018h; manufacturer 2000h to 5FFFh; the rest optional. The same `Eds` gives the same text; dates come from `file_info`.
"""

from collections.abc import Iterable, Iterator, Mapping

from haptic_fieldbus.eds.loadable import loadable
from haptic_fieldbus.eds.model import DeviceInfo, Eds, EdsEntry, EdsObject, ObjectCode
from haptic_fieldbus.eds.reader import DUMMY_TYPES
from haptic_fieldbus.eds.types import EdsType
from haptic_fieldbus.eds.values import text_of

BIT_RATES = (10, 20, 50, 125, 250, 500, 800, 1000)
MANDATORY = (0x1000, 0x1001, 0x1018)
MANUFACTURER = range(0x2000, 0x6000)
FILE_KEYS = (
    "FileName", "FileVersion", "FileRevision", "EDSVersion", "Description", "CreationTime", "CreationDate",
    "CreatedBy", "ModificationTime", "ModificationDate", "ModifiedBy", "LastEDS",
)  # fmt: skip
"""Keys of [FileInfo] (CiA 306-1, 4.5.2, and 5.2 for LastEDS)."""
_LINE_END = "\r\n"
"""End of a line: EDS files are texts of MS-DOS (CiA 306-1)."""


def eds_text(eds: Eds) -> str:
    """Return the text of the whole file, to be encoded as UTF-8."""
    objects = loadable(eds)
    indices = sorted(objects)
    lists = {
        "MandatoryObjects": [index for index in indices if index in MANDATORY],
        "OptionalObjects": [index for index in indices if index not in MANDATORY and index not in MANUFACTURER],
        "ManufacturerObjects": [index for index in indices if index in MANUFACTURER],
    }
    lines = [
        *_section("FileInfo", _file(eds.file_info)),
        *_section("DeviceInfo", _device(eds.device)),
        *_section("DummyUsage", ((f"Dummy{number:04d}", int(number in eds.dummies)) for number in DUMMY_TYPES)),
        *_section("Comments", [("Lines", len(eds.comments)), *_numbered(eds.comments, "Line")]),
    ]
    for name, members in lists.items():
        listed = (f"0x{index:04X}" for index in members)
        lines += _section(name, [("SupportedObjects", len(members)), *_numbered(listed)])
        for index in members:
            lines += _object(objects[index])
    return _LINE_END.join(lines)


def _file(information: Mapping[str, str]) -> Iterator[tuple[str, object]]:
    known = {key.lower(): text for key, text in information.items()}
    return ((key, known[key.lower()]) for key in FILE_KEYS if key.lower() in known)


def _device(device: DeviceInfo) -> Iterator[tuple[str, object]]:
    yield "VendorName", device.vendor_name
    # Keys that CiA 306-1 requires: a number that is not known becomes 0.
    yield "VendorNumber", f"0x{(device.vendor_number or 0) & 0xFFFF_FFFF:08X}"
    yield "ProductName", device.product_name
    yield "ProductNumber", f"0x{(device.product_number or 0) & 0xFFFF_FFFF:08X}"
    yield "RevisionNumber", f"0x{(device.revision_number or 0) & 0xFFFF_FFFF:08X}"
    yield "OrderCode", device.order_code
    for rate in BIT_RATES:
        yield f"BaudRate_{rate}", int(rate in device.bit_rates)
    yield from (("SimpleBootUpMaster", 0), ("SimpleBootUpSlave", 1), ("Granularity", device.granularity))
    yield from (("DynamicChannelsSupported", 0), ("GroupMessaging", 0), ("CompactPDO", 0))
    yield from (("NrOfRXPDO", device.rpdos or 0), ("NrOfTXPDO", device.tpdos or 0), ("LSS_Supported", int(device.lss)))


def _object(item: EdsObject) -> Iterator[str]:
    name, entries = f"{item.index:04X}", item.entries
    if item.is_simple and set(entries) == {0}:
        yield from _section(name, _entry(entries[0], _simple_code(entries[0])))
        return
    # A variable with sub-indices is written as the record that the reader takes it for, and so is the description of a
    # structure, which readers know as no object of a device.
    code = ObjectCode.ARRAY if item.code is ObjectCode.ARRAY else ObjectCode.RECORD
    yield from _section(
        name,
        [("ParameterName", item.name), ("ObjectType", f"0x{code:X}"), ("SubNumber", f"0x{len(entries):X}")],
    )
    for entry in entries.values():
        yield from _section(f"{name}sub{entry.subindex:X}", _entry(entry, _simple_code(entry)))


def _simple_code(entry: EdsEntry) -> ObjectCode:
    return ObjectCode.DOMAIN if entry.type is EdsType.DOMAIN else ObjectCode.VAR


def _entry(entry: EdsEntry, code: ObjectCode) -> Iterator[tuple[str, object]]:
    yield "ParameterName", entry.name
    yield "ObjectType", f"0x{code:X}"
    if entry.type is not None:
        yield "DataType", f"0x{entry.type:04X}"
    yield "AccessType", entry.access
    for key, value in (
        ("LowLimit", entry.low),
        ("HighLimit", entry.high),
        ("DefaultValue", entry.default),
        ("ParameterValue", entry.parameter),
    ):
        if value is not None:
            yield key, text_of(value, entry.type)
    yield "PDOMapping", int(entry.mappable)


def _numbered(values: Iterable[object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Return the values with the keys 1, 2, 3 …, behind a prefix."""
    return ((f"{prefix}{number}", value) for number, value in enumerate(values, start=1))


def _section(name: str, items: Iterable[tuple[str, object]]) -> list[str]:
    return [f"[{name}]", *(f"{key}={value}" for key, value in items), ""]
