"""Read an EDS or DCF as vendors ship it: usable content is taken, every mistake is listed with its line.

Theory (CiA 306-1): `[1018]` describes an object, `[1018sub1]` one of its sub-indices. An array of equal elements may be
written by `CompactSubObj`, with names in `[1018Name]` and configured values in `[1018Value]`. The three lists
`[MandatoryObjects]`, `[OptionalObjects]` and `[ManufacturerObjects]` give the objects of the device; a section that
none of them lists is read all the same. Only a file without a single object is refused.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from haptic_fieldbus.documents import EDS_SIZE, read_octets
from haptic_fieldbus.eds.lines import Faults, FileSection, sections_of, text_of_octets
from haptic_fieldbus.eds.model import DeviceInfo, Eds, EdsObject
from haptic_fieldbus.eds.objects import ObjectReader
from haptic_fieldbus.errors import EdsError, Fault

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
    empty = FileSection("", 0)
    dummies, comments, about = (sections.get(name, empty) for name in ("dummyusage", "comments", "fileinfo"))
    commissioning = next((sections[name] for name in COMMISSIONING if name in sections), empty)
    return Eds(
        objects=objects,
        device=_device(sections.get("deviceinfo"), faults),
        node=commissioning.number("NodeID", faults),
        dummies=tuple(number for number in DUMMY_TYPES if dummies.number(f"Dummy{number:04d}", faults)),
        file_info={item.key: item.value for item in about.items.values()},
        # The key `Lines` is only the number of the lines.
        comments=tuple(item.value for key, item in comments.items.items() if key.startswith("line") and key != "lines"),
        source=source,
        # A key that is read twice, such as SupportedObjects, notes its fault twice.
        faults=tuple(sorted(dict.fromkeys(faults), key=lambda fault: fault.line or 0)),
    )


def _objects(sections: Mapping[str, FileSection], faults: list[Fault]) -> dict[int, EdsObject]:
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
        objects[index] = ObjectReader(index, sections, faults).read(heads.get(index), members.get(index, {}))
        count += len(objects[index].entries)
        if count > MOST_ENTRIES:
            faults.append(Fault(f"[{index:04X}]", f"more than {MOST_ENTRIES} entries: the others are omitted"))
            break
    return objects


def _check_lists(sections: Mapping[str, FileSection], objects: Mapping[int, EdsObject], faults: list[Fault]) -> None:
    """Note every listed object without a description, and every described object that no list has."""
    listed: set[int] = set()
    for name in LISTS:
        section = sections.get(name.lower())
        if section is None:
            faults.append(Fault(f"[{name}]", "the list of objects is missing"))
            continue
        for item in section.items.values():
            number = section.number(item.key, faults)
            if item.key.lower() == "supportedobjects" or number is None:
                continue
            listed.add(number)
            if number not in objects:
                faults.append(Fault(f"[{section.name}] {item.key}", f"[{number:04X}] is not in this file", item.line))
        count, entries = section.number("SupportedObjects", faults), len(section.items)
        entries -= "supportedobjects" in section
        if count is not None and count != entries:
            faults.append(section.fault("SupportedObjects", f"{count}, but {entries} are listed"))
    for index, found in objects.items():
        if index not in listed:
            faults.append(Fault(f"[{index:04X}]", "is in no list of objects", found.line))


def _device(section: FileSection | None, faults: list[Fault]) -> DeviceInfo:
    if section is None:
        faults.append(Fault("[DeviceInfo]", "this section is missing"))
        return DeviceInfo()

    def number(key: str) -> int | None:
        return section.number(key, faults)

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
