"""Write an EDS that `reader` reads back and that other programs load, whatever the `Eds` was made from.

It is complete in the keys that CiA 306-1 requires. Objects go into the list of their range: mandatory 1000h, 1001h and
1018h; manufacturer 2000h to 5FFFh; the rest optional. The same `Eds` gives the same text; dates come from `file_info`.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from haptic_fieldbus.eds.lines import fits, text_of, value_range
from haptic_fieldbus.eds.model import DeviceInfo, Eds, EdsEntry, EdsObject, EdsValue, ObjectCode
from haptic_fieldbus.eds.names import HIGHEST, REALS, TIMES, EdsType, member_name, parameter_name
from haptic_fieldbus.eds.reader import DUMMY_TYPES, HIGHEST_ELEMENT

# The objects of an EDS in a form that other programs load, whatever it was made from.
#
# canopen's reader and dcf-tools refuse a whole file for one entry that they cannot take. What is not certain is
# therefore left out, and what every device has is filled in:
#
# - a value whose structure only the device knows becomes a DOMAIN;
# - a value that its type cannot hold is left out, and so is a limit that the values of its own entry break;
# - an entry whose value CiA 301 fixes as a number (identity, PDOs, guards, error behaviour) has a type of numbers;
# - left out are descriptions of data types (below 1000h), objects without entries, sub-index FFh, and a record of a PDO
#   that lacks its other one; a mapping entry that names no object becomes 0, which maps nothing;
# - 1000h, 1001h and 1018h are in every device (CiA 301, 7.5.2).

FIRST_OBJECT = 0x1000
"""Indices below are those of data types, which a PDO maps as unused space."""
_PDOS = range(0x1400, 0x1C00)
MAPPING = 0x200
"""Bit of the index of a PDO's record: set in its mapping record, clear in its communication record."""
_PARAMETERS = {
    0: EdsType.UNSIGNED8, 1: EdsType.UNSIGNED32, 2: EdsType.UNSIGNED8, 3: EdsType.UNSIGNED16,
    4: EdsType.UNSIGNED8, 5: EdsType.UNSIGNED16, 6: EdsType.UNSIGNED8,
}  # fmt: skip
_NUMBERS: Mapping[int, Mapping[int, EdsType]] = {
    **{index: {0: EdsType.UNSIGNED8} for index in (0x1001, 0x100D)},
    **{index: {0: EdsType.UNSIGNED16} for index in (0x100C, 0x1017)},
    **{index: {0: EdsType.UNSIGNED32} for index in (0x1000, 0x1005, 0x1012, 0x1014)},
    **{index: {0: EdsType.UNSIGNED8, -1: EdsType.UNSIGNED32} for index in (0x1016, 0x1018, 0x1600, 0x1A00)},
    0x1029: {0: EdsType.UNSIGNED8, -1: EdsType.UNSIGNED8},
    **dict.fromkeys((0x1400, 0x1800), _PARAMETERS),
}
"""Types by CiA 301 of entries that programs need as numbers, by index (of a PDO: of the first one) and sub-index, -1
for all others."""


def loadable(eds: Eds) -> dict[int, EdsObject]:
    """Return the objects to write, by index."""
    kept = {index: replace(item, entries=entries) for index, item in eds.objects.items() if (entries := _entries(item))}
    objects = {**kept, **dict(_mandatory(kept, eds.device))}
    lone = {index for index in objects if index in _PDOS and index ^ MAPPING not in objects}  # a PDO has two records
    found = {index: item for index, item in objects.items() if index >= FIRST_OBJECT and index not in lone}
    mappings = [index for index in found if index in _PDOS and index & MAPPING]
    return found | {index: _mapped(found[index], found) for index in mappings}


def _entries(item: EdsObject) -> dict[int, EdsEntry]:
    """Return the entries that a file can describe; FFh only repeats the code of the object (CiA 301, 7.4.3)."""
    is_record = not (item.is_simple and set(item.entries) == {0})
    return {
        subindex: _loadable_entry(entry, EdsType.UNSIGNED8 if is_record and not subindex else _type(entry))
        for subindex, entry in item.entries.items()
        if subindex <= HIGHEST_ELEMENT
    }


def _type(entry: EdsEntry) -> EdsType:
    """Return the type to write of an entry that is not the length of a record."""
    standard = _NUMBERS.get(entry.index & ~0x1FF if entry.index in _PDOS else entry.index, {})
    fixed = standard.get(entry.subindex, standard.get(-1))
    if fixed is not None and (entry.type is None or not entry.type.is_integer or entry.type in TIMES):
        return fixed
    return EdsType.DOMAIN if entry.type is None else entry.type


def _loadable_entry(entry: EdsEntry, type: EdsType) -> EdsEntry:
    """Return an entry without what its type cannot hold."""
    given = (entry.default, entry.parameter)
    default, parameter = (value if value is not None and fits(value, type) else None for value in given)
    limits = (entry.low, entry.high)
    low, high = (limit if limit is not None and fits(limit, type) else None for limit in limits)
    ranges = [value_range(value) for value in (default, parameter) if value is not None]
    if type not in REALS and (type in TIMES or not type.is_integer):  # values without limits
        low = high = None
    return replace(
        entry,
        type=type,
        default=default,
        parameter=parameter,
        low=None if low is None or any(least < low for least, _ in ranges) else low,
        high=None if high is None or any(most > high for _, most in ranges) else high,
    )


def _mandatory(objects: Mapping[int, EdsObject], device: DeviceInfo) -> Iterator[tuple[int, EdsObject]]:
    """Yield the objects that every device has and that are missing, or lack what every device has in them."""
    for index, type in ((0x1000, EdsType.UNSIGNED32), (0x1001, EdsType.UNSIGNED8)):
        if index not in objects or 0 not in objects[index].entries:
            name = parameter_name(index)
            yield index, EdsObject(index, name, ObjectCode.VAR, {0: EdsEntry(index, 0, name, type, "ro")})
    identity = objects.get(0x1018)
    entries = {} if identity is None else dict(identity.entries)
    if 0 not in entries or 1 not in entries:
        vendor = (device.vendor_number or 0) & 0xFFFF_FFFF
        entries.setdefault(0, EdsEntry(0x1018, 0, HIGHEST, EdsType.UNSIGNED8, "ro", max(entries, default=1) or 1))
        entries.setdefault(1, EdsEntry(0x1018, 1, member_name(0x1018, 1), EdsType.UNSIGNED32, "ro", vendor))
        yield 0x1018, EdsObject(0x1018, parameter_name(0x1018), ObjectCode.RECORD, dict(sorted(entries.items())))


def _mapped(item: EdsObject, objects: Mapping[int, EdsObject]) -> EdsObject:
    """Return the mapping record of a PDO whose entries name objects of the file, or nothing."""
    wrong = {
        subindex: replace(entry, default=0, parameter=None, low=None, high=None)
        for subindex, entry in item.entries.items()
        if subindex and not all(_exists(value, objects) for value in (entry.default, entry.parameter))
    }
    return replace(item, entries={**item.entries, **wrong})


def _exists(value: EdsValue | None, objects: Mapping[int, EdsObject]) -> bool:
    """Return whether a mapping entry names an entry of the file or unused space, or maps nothing."""
    if not isinstance(value, int) or value == 0:
        return value is None or value == 0
    index, subindex = value >> 16, value >> 8 & 0xFF
    if index < FIRST_OBJECT:
        return index in DUMMY_TYPES and not subindex
    return index in objects and subindex in objects[index].entries


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
    known = {key.lower(): text for key, text in eds.file_info.items()}
    lines = [
        *_section("FileInfo", ((key, known[key.lower()]) for key in FILE_KEYS if key.lower() in known)),
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
    """Yield the lines of an object and of its sub-indices."""
    name, entries = f"{item.index:04X}", item.entries
    if item.is_simple and set(entries) == {0}:
        yield from _section(name, _entry(entries[0]))
        return
    # A variable with sub-indices is written as the record that the reader takes it for, and so is the description of a
    # structure, which readers know as no object of a device.
    code = ObjectCode.ARRAY if item.code is ObjectCode.ARRAY else ObjectCode.RECORD
    head = {"ParameterName": item.name, "ObjectType": f"0x{code:X}", "SubNumber": f"0x{len(entries):X}"}
    yield from _section(name, head.items())
    for entry in entries.values():
        yield from _section(f"{name}sub{entry.subindex:X}", _entry(entry))


def _entry(entry: EdsEntry) -> Iterator[tuple[str, object]]:
    code = ObjectCode.DOMAIN if entry.type is EdsType.DOMAIN else ObjectCode.VAR
    yield from (("ParameterName", entry.name), ("ObjectType", f"0x{code:X}"))
    if entry.type is not None:
        yield "DataType", f"0x{entry.type:04X}"
    yield "AccessType", entry.access
    values = (entry.low, entry.high, entry.default, entry.parameter)
    for key, value in zip(("LowLimit", "HighLimit", "DefaultValue", "ParameterValue"), values, strict=True):
        if value is not None:
            yield key, text_of(value, entry.type)
    yield "PDOMapping", int(entry.mappable)


def _numbered(values: Iterable[object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Return the values with the keys 1, 2, 3 …, behind a prefix."""
    return ((f"{prefix}{number}", value) for number, value in enumerate(values, start=1))


def _section(name: str, items: Iterable[tuple[str, object]]) -> list[str]:
    return [f"[{name}]", *(f"{key}={value}" for key, value in items), ""]
