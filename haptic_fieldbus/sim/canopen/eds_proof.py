"""Proof of a profile against the EDS of its drive: the profile itself, and the simulated drive that it describes."""

from collections.abc import Callable, Iterator
from typing import cast

from haptic_fieldbus.eds import Eds, EdsEntry, NodeOffset
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.eds_check import Comparison, compare
from haptic_fieldbus.protocols.canopen.eds_values import Finding, data_type
from haptic_fieldbus.protocols.canopen.profile import AccessType, CanopenProfile, SimulatedObject
from haptic_fieldbus.sim.canopen.model import ACCESS, BENCH_VALUES, SHOWN_VALUES, WAYS
from haptic_fieldbus.sim.canopen.simulated_eds import dictionary_of
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry, Mappable

# Comparison of the object dictionary of a simulated drive with a vendor's file.
#
# The result is in the form of [simulation.objects]: what a profile must say for its simulated drive to have what the
# file describes. Values that the drive measures, or that describe the bench rather than the model, are not compared.

_READ_ONLY = (Access.RO, Access.CONST)
_APPLICATION = 0x6000
"""First index from which the drive measures its read-only values."""


def differences(
    dictionary: Dictionary, eds: Eds, node: int, concerns: Callable[[int], bool]
) -> dict[str, SimulatedObject]:
    """Return the differences of the file from the dictionary of node-ID `node`, for objects that `concerns` selects.

    The key of an object that is not in the file at all has no sub-index.
    """
    found: dict[str, SimulatedObject] = {}
    implemented = {(entry.index, entry.subindex): entry for entry in dictionary if concerns(entry.index)}
    described = {(entry.index, entry.subindex): entry for entry in eds if concerns(entry.index)}
    for index, subindex in sorted(implemented.keys() | described.keys()):
        entry, other = implemented.get((index, subindex)), described.get((index, subindex))
        key = f"{index:04X}:{subindex:02X}"
        if other is None:
            found[key if index in eds else f"{index:04X}"] = SimulatedObject(absent=True)
        elif entry is None or (data_type(other) is not entry.type and data_type(other) is not None):
            found[key] = _whole(other)
        elif (change := _change(entry, other, node)) != SimulatedObject():
            found[key] = change
    return found


def _whole(other: EdsEntry) -> SimulatedObject:
    """Return all properties of an entry in the file."""
    type, value = data_type(other), _given(other)
    low, high = (_number(other.low), _number(other.high)) if type is not None else (None, None)
    if low is not None and high is not None and low >= high:
        low = high = None  # limits without room are a slip of the file, or mean a value that cannot be changed
    return SimulatedObject(
        type=type,
        access=cast(AccessType, other.access),
        value=value,
        low=low,
        high=high,
        mappable=other.mappable or None,
    )


def _change(entry: Entry, other: EdsEntry, node: int) -> SimulatedObject:
    """Return the properties that differ in the file, for an entry of the same type."""
    access = cast(AccessType, other.access)
    ways = WAYS[access] if other.mappable else Mappable.NO
    same_access = ACCESS[access] is entry.access or (ACCESS[access] in _READ_ONLY and entry.access in _READ_ONLY)
    whole = _whole(other)
    type_limits = entry.type.limits if entry.type is not None else (entry.low, entry.high)
    low = type_limits[0] if whole.low is None else whole.low
    high = type_limits[1] if whole.high is None else whole.high
    return SimulatedObject(
        access=None if same_access and ways is entry.mappable else access,
        value=None if not _compared(entry, other) or other.value(node) == entry.default else whole.value,
        low=None if entry.type is None or low == entry.low else low,
        high=None if entry.type is None or high == entry.high else high,
        mappable=None if ways is entry.mappable else other.mappable,
    )


def _compared(entry: Entry, other: EdsEntry) -> bool:
    """Return whether the file gives a power-on value that the simulated drive may take over."""
    if entry.type is None or _given(other) is None or entry.index in BENCH_VALUES:
        return False
    measured = entry.access in _READ_ONLY and entry.index >= _APPLICATION and entry.subindex == 0
    return not measured or entry.index in SHOWN_VALUES


def _given(other: EdsEntry) -> int | str | None:
    if isinstance(formula := other.formula, NodeOffset):
        return f"$NODEID+0x{formula.offset:X}"
    return _number(formula)


def _number(value: object) -> int | None:
    return value if isinstance(value, int) else None


_NODE = 5
_STANDARD = (range(0x1000, 0x1F00), range(0x6000, 0x6800))
"""Objects of CiA 301, and of CiA 402-2 for one axis, which programs for any drive read; without the objects of CiA
302."""


def proof_of(profile: CanopenProfile, eds: Eds) -> Comparison:
    """Return the comparison of the file with the profile, and with its simulated drive if the profile describes it."""
    return compare(profile, eds, tuple(_simulated(profile, eds)) if profile.simulation.objects else ())


def _simulated(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield each object of the simulated drive that differs from the file."""
    named = {written.object for written in profile.setup.writes}
    named |= {shown.object for shown in profile.commissioning.shown} | {profile.torque.target.object}

    def concerns(index: int) -> bool:
        return index in named or any(index in standard for standard in _STANDARD)

    try:
        dictionary = dictionary_of(profile, _NODE)
    except UsageError as error:
        yield Finding("simulation", "", fault=f"cannot be simulated: {error}")
        return
    for place, shown in differences(dictionary, eds, _NODE, concerns).items():
        index, _, subindex = place.partition(":")
        number = int(index, 16)
        line = eds.objects[number].line if number in eds else None
        fault = f"{place}: the file has {_words(shown)}, the simulated drive has it otherwise"
        if shown.absent:
            fault = f"{place}: the file does not have it, the simulated drive does"
        yield Finding("simulation.objects", "", line, fault, number, int(subindex or "0", 16))


def _words(shown: SimulatedObject) -> str:
    given = {name: value for name, value in vars(shown).items() if value is not None and name != "absent"}
    return ", ".join(f"{name} {getattr(value, 'value', value)}" for name, value in given.items())
