"""EDS values for tests, made from the simulated drive's own, so that no vendor's file is needed."""

from dataclasses import replace
from functools import cache

from haptic_fieldbus.eds import Eds, EdsEntry, EdsObject, EdsType, ObjectCode, eds_text, read_eds
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.canopen.simulated_eds import sheet


@cache
def generic() -> Eds:
    """The EDS of the simulated generic drive, as a program reads it from the file."""
    return own("generic_cia402")


def own(profile: str | CanopenProfile) -> Eds:
    """Written and read again."""
    loaded = load_profile(profile) if isinstance(profile, str) else profile
    return read_eds(eds_text(sheet(loaded)).encode(), "own.eds")


def without(eds: Eds, *indices: int) -> Eds:
    return replace(eds, objects={index: item for index, item in eds.objects.items() if index not in indices})


def without_member(eds: Eds, index: int, subindex: int) -> Eds:
    item = eds.objects[index]
    return _with(eds, replace(item, entries={sub: entry for sub, entry in item.entries.items() if sub != subindex}))


def changed(eds: Eds, index: int, subindex: int = 0, /, **changes: object) -> Eds:
    """One entry otherwise, or a new one."""
    item = eds.objects.get(index) or EdsObject(index, f"new {index:04X}h", ObjectCode.VAR)
    entry = item.entries.get(subindex) or EdsEntry(index, subindex, "new", EdsType.UNSIGNED16, "rw")
    return _with(eds, replace(item, entries={**item.entries, subindex: replace(entry, **changes)}))  # type: ignore[arg-type]


def _with(eds: Eds, item: EdsObject) -> Eds:
    return replace(eds, objects={**eds.objects, item.index: item})
