"""The electronic data sheet of a simulated drive, for programs that need its object dictionary as a file.

The drive is built twice, with two node-IDs; power-on values that differ contain the node-ID. The drive of a vendor's
file keeps the names and types of that file.
"""

from dataclasses import replace

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.eds import DeviceInfo, Eds, EdsEntry, EdsObject, EdsType, EdsValue, NodeOffset, ObjectCode
from haptic_fieldbus.eds.names import member_name, parameter_name
from haptic_fieldbus.protocols.canopen.eds_values import DATA_TYPES
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry, Mappable
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus

BIT_RATES = (10, 20, 50, 125, 250, 500, 800, 1000)
"""Bit rates of the standard [kbit/s]; the simulated wire takes any."""
_TYPES = {ours: type for type, ours in DATA_TYPES.items()}
_STRINGS = (0x1008, 0x1009, 0x100A)
_ARRAYS = (0x1003, 0x1010, 0x1011, 0x1016)
_WRITABLE = {Mappable.RPDO: "rww", Mappable.TPDO: "rwr"}
"""EDS access of an entry that can be read and written; "rw" if it is mappable in no direction or in both directions."""
_MEASURED = range(0x6000, 0xA000)
"""Indices at which read-only values change by themselves, so that a default would be meaningless; except `_FIXED`."""
_FIXED = (0x6075, 0x6076, 0x6502, 0x67FF)
_DUMMIES = tuple(range(2, 8))
"""Dummy entries: integers of one to four octets, as space in an RPDO."""


def sheet(profile: DriveProfile) -> Eds:
    """Return the EDS of the simulated drive with this profile, on the shipped bench."""
    first, second = (dictionary_of(profile, node) for node in (1, 2))
    known = profile.eds if isinstance(profile, EdsProfile) else Eds({})
    objects: dict[int, dict[int, EdsEntry]] = {}
    for entry in sorted(first, key=lambda entry: (entry.index, entry.subindex)):
        other = second.find(entry.index, entry.subindex)
        described = known.find(entry.index, entry.subindex)
        objects.setdefault(entry.index, {})[entry.subindex] = _entry(entry, _default(entry, other), described)
    return Eds(
        objects={index: _object(index, members, known.objects.get(index)) for index, members in objects.items()},
        device=_device(profile, first),
        dummies=_DUMMIES,
        comments=(f"The simulated {profile.title} of haptic-fieldbus, profile {profile.name}",),
    )


def dictionary_of(profile: DriveProfile, node: int) -> Dictionary:
    """Return the dictionary of the simulated drive with this profile and node-ID, on the shipped bench."""
    axis = default_axis(Workspace.LINEAR, bus="", node=node, profile=profile.name)
    return Slave(DriveOnBus(node, profile, axis), lambda _frame: None).drive.dictionary


def _default(entry: Entry, other: Entry) -> EdsValue | None:
    """Return the power-on value; None for a measured value."""
    if entry.type is None:
        return entry.default_text.decode(errors="replace") if entry.index in _STRINGS else entry.default_text or None
    if entry.access is Access.RO and entry.index in _MEASURED and entry.index not in _FIXED:
        return None
    # The first drive has node-ID 1, so the offset to $NODEID is one less.
    return entry.default if entry.default == other.default else NodeOffset(entry.default - 1)


def _entry(entry: Entry, default: EdsValue | None, described: EdsEntry | None) -> EdsEntry:
    """Return one sub-index; types of a vendor's file that are stored as octets appear as in that file."""
    type = described.type if described is not None else _type(entry)
    narrow = entry.type is not None and type in _TYPES.values() and (entry.low, entry.high) != entry.type.limits
    return EdsEntry(
        index=entry.index,
        subindex=entry.subindex,
        name=described.name if described is not None else "",
        type=type,
        access=_WRITABLE.get(entry.mappable, "rw") if entry.access is Access.RW else entry.access.value,
        default=default if described is None or type in _TYPES.values() else described.default,
        low=entry.low if narrow else None,
        high=entry.high if narrow else None,
        mappable=bool(entry.mappable),
    )


def _type(entry: Entry) -> EdsType:
    if entry.type is not None:
        return _TYPES[entry.type]
    return EdsType.VISIBLE_STRING if entry.index in _STRINGS else EdsType.DOMAIN


def _object(index: int, members: dict[int, EdsEntry], described: EdsObject | None) -> EdsObject:
    """Return an object of these sub-indices, each with its name."""
    if described is not None:
        return EdsObject(index, described.name, described.code, members)
    name = parameter_name(index)
    if members.keys() == {0}:
        code = ObjectCode.DOMAIN if members[0].type is EdsType.DOMAIN else ObjectCode.VAR
        return EdsObject(index, name, code, {0: replace(members[0], name=name)})
    named = {number: replace(entry, name=member_name(index, number)) for number, entry in members.items()}
    return EdsObject(index, name, ObjectCode.ARRAY if index in _ARRAYS else ObjectCode.RECORD, named)


def _device(profile: DriveProfile, dictionary: Dictionary) -> DeviceInfo:
    """Return the contents of [DeviceInfo], from 1018h and the number of PDOs."""
    vendor, product, revision = (dictionary.value(0x1018, subindex) for subindex in (1, 2, 3))
    return DeviceInfo(
        vendor_name=profile.drive.vendor,
        vendor_number=vendor,
        product_name=profile.drive.model,
        product_number=product,
        revision_number=revision,
        bit_rates=BIT_RATES,
        rpdos=sum(index in dictionary for index in range(0x1400, 0x1600)),
        tpdos=sum(index in dictionary for index in range(0x1800, 0x1A00)),
        lss=True,
    )
