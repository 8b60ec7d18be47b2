"""Read an EDS or DCF as vendors ship it: usable content is taken, every mistake is listed with its line.

Theory (CiA 306-1): `[1018]` describes an object, `[1018sub1]` one of its sub-indices. An array of equal elements may be
written by `CompactSubObj`, with names in `[1018Name]` and configured values in `[1018Value]`. The three lists
`[MandatoryObjects]`, `[OptionalObjects]` and `[ManufacturerObjects]` give the objects of the device; a section that
none of them lists is read all the same. Only a file without a single object is refused.

A key of an object that is missing or wrong becomes a fault and gets the nearest meaning. Reference: CiA 306-1, object
description (ParameterName, ObjectType, DataType, AccessType, LowLimit, HighLimit, DefaultValue, PDOMapping, SubNumber,
CompactSubObj) and, in a DCF, ParameterValue.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from haptic_fieldbus.documents import EDS_SIZE, read_octets
from haptic_fieldbus.eds.lines import Faults, FileSection, sections_of, text_of_octets
from haptic_fieldbus.eds.model import ACCESS_TYPES, DeviceInfo, Eds, EdsEntry, EdsObject, ObjectCode
from haptic_fieldbus.eds.names import EdsType
from haptic_fieldbus.errors import EdsError, Fault

ACCESS_WHEN_MISSING = "ro"
"""Access of an entry that gives none: read-only does no harm."""
HIGHEST_ELEMENT = 0xFE
"""Highest sub-index of an array element (CiA 301, 7.4.3); FFh describes the object itself."""
Sections = Mapping[str, FileSection]
"""Sections of a file by their names in lower case."""
_TYPES, _CODES = {type.value: type for type in EdsType}, {code.value: code for code in ObjectCode}


def _object(index: int, head: FileSection | None, members: Mapping[int, FileSection], sections: Sections) -> EdsObject:
    """Return an object from its own section, None if there is none, and the sections of its sub-indices.

    `sections` are all of the file, for compact arrays.
    """
    if head is None:
        first = next(iter(members.values()))
        first.note("", f"[{index:04X}], the object itself, is missing: treated as a record")
        return EdsObject(index, "", ObjectCode.RECORD, _members(index, members), first.line)
    code, compact = _code(head), head.number("CompactSubObj") or 0
    if not 0 <= compact <= HIGHEST_ELEMENT:
        head.note("CompactSubObj", f"{compact}, expected 0 to {HIGHEST_ELEMENT}: treated as 0")
        compact = 0
    found = EdsObject(index, _name(head), code, {}, head.line)
    if compact:
        entries = _compact(index, head, compact, sections) | _members(index, members)
    elif found.is_simple and not members:
        entries = {0: _entry(index, head, 0, code)}
    else:
        entries = _members(index, members)
        if found.is_simple:
            head.note("ObjectType", "a variable with sub-indices: treated as a record")
        elif head.number("SubNumber") != len(members):
            said = head.text("SubNumber") or "missing"
            head.note("SubNumber", f"{said}, but the file has {len(members)} sub-indices")
    return replace(found, entries=dict(sorted(entries.items())))


def _entry(index: int, section: FileSection, subindex: int, code: ObjectCode = ObjectCode.VAR) -> EdsEntry:
    """Return one sub-index from the section that describes it."""
    type = _type(section, code)
    return EdsEntry(
        index=index,
        subindex=subindex,
        name=_name(section),
        type=type,
        access=_access(section, type),
        default=section.value("DefaultValue", type),
        parameter=section.value("ParameterValue", type),
        low=_limit(section, "LowLimit", type),
        high=_limit(section, "HighLimit", type),
        mappable=bool(section.number("PDOMapping")),
        line=section.line,
    )


def _members(index: int, members: Mapping[int, FileSection]) -> dict[int, EdsEntry]:
    return {each: _entry(index, section, each, _code(section)) for each, section in sorted(members.items())}


def _compact(index: int, head: FileSection, count: int, sections: Sections) -> dict[int, EdsEntry]:
    """Return the entries of `CompactSubObj`: `count` equal elements, and sub-index 0 with their number."""
    empty = FileSection("", 0, [])
    names, values = (sections.get(f"{index:04x}{kind}", empty) for kind in ("name", "value"))
    # The object's own section describes all of its elements.
    pattern = _entry(index, head, 1)
    length = EdsEntry(index, 0, "Number of entries", EdsType.UNSIGNED8, ACCESS_WHEN_MISSING, count, line=head.line)
    entries = {0: length}
    for each in range(1, count + 1):
        name = names.text(str(each)) or f"{pattern.name}{each}"
        entries[each] = replace(pattern, subindex=each, name=name, parameter=values.value(str(each), pattern.type))
    return entries


def _name(section: FileSection) -> str:
    name = section.text("ParameterName")
    if not name:
        section.note("ParameterName", "missing")
    return name


def _code(section: FileSection) -> ObjectCode:
    """Return the object code; a variable when it is missing (CiA 306-1) or unknown."""
    number = section.number("ObjectType")
    if number is not None and number not in _CODES:
        section.note("ObjectType", f"{number} is not an object code: treated as a variable")
    return _CODES.get(number or 0, ObjectCode.VAR)


def _type(section: FileSection, code: ObjectCode) -> EdsType | None:
    """Return the data type; None when it is missing or not basic. A domain may leave it out."""
    number, is_given = section.number("DataType"), bool(section.text("DataType"))
    if not is_given and code is ObjectCode.DOMAIN:
        return EdsType.DOMAIN
    if not is_given:
        section.note("DataType", "missing: the length of the value is not known")
    elif number is not None and number not in _TYPES:
        section.note("DataType", f"{number:04X}h is no basic data type: its length is not known")
    # No type has the index 0, so a number that is missing or not understood gives None.
    return _TYPES.get(number or 0)


def _access(section: FileSection, type: EdsType | None) -> str:
    access = section.text("AccessType").lower()
    if access in ACCESS_TYPES:
        return access
    if type is not EdsType.DOMAIN or access:
        found = f'"{access}"' if access else "missing"
        section.note("AccessType", f"{found}, expected one of {', '.join(ACCESS_TYPES)}: treated as ro")
    return ACCESS_WHEN_MISSING


def _limit(section: FileSection, key: str, type: EdsType | None) -> int | float | None:
    """Return a limit; None for texts and octets, which have none."""
    value = section.value(key, type) if type is None or type.is_integer or type.size else None
    return value if isinstance(value, int | float) else None


LISTS = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
BIT_RATES = (10, 20, 50, 100, 125, 250, 500, 800, 1000)
COMMISSIONING = ("devicecomissioning", "devicecommissioning")
"""Names of the section with the node-ID: CiA 306 spells it with one m, some files with two."""
DUMMY_TYPES = range(1, 8)
"""Indices of the basic data types for which `[DummyUsage]` has a key."""
# The standard names sections without 0x; it is tolerated.
_OBJECT = re.compile(r"(?:0x)?([0-9a-f]{4})$")
_SUBINDEX = re.compile(r"(?:0x)?([0-9a-f]{4})sub(?:0x)?([0-9a-f]{1,3})$")
_HIGHEST_SUBINDEX = 0xFF
MOST_ENTRIES = 50_000
"""Most entries of a file; one line of a compact array stands for 254. The largest drives have some thousands."""


def load_eds(path: str | Path) -> Eds:
    """Read the file of a device; raises EdsError when it cannot be read or holds no object."""
    try:
        data = read_octets(path, EDS_SIZE)
    except OSError as error:
        raise EdsError(path, [Fault("", f"cannot be read: {error.strerror}")]) from error
    return read_eds(data, str(path))


def read_eds(data: bytes, source: str = "") -> Eds:
    """Read the content of a file, named `source` in errors; raises EdsError when it holds no object."""
    faults = Faults()
    sections = sections_of(text_of_octets(data, faults), faults)
    objects = _objects(sections, faults)
    if not objects:
        raise EdsError(source, [*faults, Fault("", "no object: expected sections such as [1000] or [6040]")])
    _check_lists(sections, objects, faults)
    empty = FileSection("", 0, faults)
    dummies, comments, about = (sections.get(name, empty) for name in ("dummyusage", "comments", "fileinfo"))
    commissioning = next((sections[name] for name in COMMISSIONING if name in sections), empty)
    return Eds(
        objects=objects,
        device=_device(sections.get("deviceinfo"), faults),
        node=commissioning.number("NodeID"),
        dummies=tuple(number for number in DUMMY_TYPES if dummies.number(f"Dummy{number:04d}")),
        file_info={item.key: item.value for item in about.items.values()},
        # The key `Lines` is only the number of the lines.
        comments=tuple(item.value for key, item in comments.items.items() if key.startswith("line") and key != "lines"),
        source=source,
        # A key that is read twice, such as SupportedObjects, notes its fault twice.
        faults=tuple(sorted(dict.fromkeys(faults), key=lambda fault: fault.line or 0)),
    )


def _objects(sections: Sections, faults: list[Fault]) -> dict[int, EdsObject]:
    """Return all objects in the order of their indices, each with its sub-indices."""
    heads: dict[int, FileSection] = {}
    members: dict[int, dict[int, FileSection]] = {}
    for name, section in sections.items():
        head, member = _OBJECT.match(name), _SUBINDEX.match(name)
        if head is not None:
            heads[int(head[1], 16)] = section
        elif member is not None and int(member[2], 16) <= _HIGHEST_SUBINDEX:
            members.setdefault(int(member[1], 16), {})[int(member[2], 16)] = section
    objects: dict[int, EdsObject] = {}
    count = 0
    for index in sorted(heads.keys() | members.keys()):
        objects[index] = _object(index, heads.get(index), members.get(index, {}), sections)
        count += len(objects[index].entries)
        if count > MOST_ENTRIES:
            faults.append(Fault(f"[{index:04X}]", f"more than {MOST_ENTRIES} entries: the others are omitted"))
            break
    return objects


def _check_lists(sections: Sections, objects: Mapping[int, EdsObject], faults: list[Fault]) -> None:
    """Note every listed object without a description, and every described object that no list has."""
    listed: set[int] = set()
    for name in LISTS:
        section = sections.get(name.lower())
        if section is None:
            faults.append(Fault(f"[{name}]", "the list of objects is missing"))
            continue
        for item in section.items.values():
            number = section.number(item.key)
            if item.key.lower() == "supportedobjects" or number is None:
                continue
            listed.add(number)
            if number not in objects:
                faults.append(Fault(f"[{section.name}] {item.key}", f"[{number:04X}] is not in this file", item.line))
        count, entries = section.number("SupportedObjects"), len(section.items.keys() - {"supportedobjects"})
        if count is not None and count != entries:
            section.note("SupportedObjects", f"{count}, but {entries} are listed")
    for index, found in objects.items():
        if index not in listed:
            faults.append(Fault(f"[{index:04X}]", "is in no list of objects", found.line))


def _device(section: FileSection | None, faults: list[Fault]) -> DeviceInfo:
    if section is None:
        faults.append(Fault("[DeviceInfo]", "this section is missing"))
        return DeviceInfo()
    number = section.number
    if number("CompactPDO"):
        line = section.items["compactpdo"].line
        faults.append(Fault("[DeviceInfo] CompactPDO", "missing PDO parameters are not added", line))
    granularity = number("Granularity")
    return DeviceInfo(
        vendor_name=section.text("VendorName"),
        vendor_number=number("VendorNumber"),
        product_name=section.text("ProductName"),
        product_number=number("ProductNumber"),
        revision_number=number("RevisionNumber"),
        order_code=section.text("OrderCode"),
        bit_rates=tuple(rate for rate in BIT_RATES if number(f"BaudRate_{rate}")),
        rpdos=number("NrOfRXPDO"),
        tpdos=number("NrOfTXPDO"),
        granularity=8 if granularity is None else granularity,
        lss=bool(number("LSS_Supported")),
    )
