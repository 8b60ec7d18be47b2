"""The mode of operation of a profile, and the objects that every drive of CiA 402 needs, beside the file."""

from collections.abc import Iterator

from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.protocols.canopen.vendor.named import Use, finding_of
from haptic_fieldbus.protocols.canopen.vendor.values import supported_modes

TORQUE_MODES = (4, 10)
"""Modes of CiA 402-2 with a target torque: profile torque, cyclic synchronous torque."""
KEY = "torque.mode_of_operation"
_MANUFACTURER_BITS = 0xFFFF_0000
"""Bits of 6502h for modes of the manufacturer, which are negative."""
_AUTOMATON = (
    (0x6040, DataType.UINT16, Use.RECEIVED),
    (0x6041, DataType.UINT16, Use.SENT),
    (0x6060, DataType.INT8, Use.WRITTEN),
    (0x6061, DataType.INT8, Use.READ),
)


def mode_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield what the file shows of the mode, and of the objects by which it is set and confirmed."""
    for index, type, use in _AUTOMATON:
        yield finding_of("drive.usable", ObjectEntry(index, type), use, eds)
    mode = profile.torque.mode_of_operation
    if mode > 0 and mode not in TORQUE_MODES:
        yield Finding(KEY, "", fault=f"{mode} is no torque mode of CiA 402-2; expected 4 (profile torque), 10 (cyclic) "
                      "or a negative one of the manufacturer")  # fmt: skip
    yield _within_limits(mode, eds)
    yield from _supported(mode, eds)


def _within_limits(mode: int, eds: Eds) -> Finding:
    entry = eds.find(0x6060)
    low, high = (entry.low, entry.high) if entry is not None else (None, None)
    outside = (low is not None and mode < low) or (high is not None and mode > high)
    line = entry.line if entry is not None else None
    if low is None and high is None:
        return Finding(KEY, "[6060] sets no limit to it", line)
    takes = f"[6060] takes {low} to {high}"
    return Finding(KEY, takes, line, f"{mode}; {takes}" if outside else "", 0x6060)


def _supported(mode: int, eds: Eds) -> Iterator[Finding]:
    """Yield whether 6502h names the mode, if the file gives its value."""
    modes, entry = supported_modes(eds), eds.find(0x6502)
    if not modes or entry is None:
        return
    named = modes & _MANUFACTURER_BITS if mode < 0 else modes >> mode - 1 & 1 if mode else 0
    shows = f"[6502] DefaultValue {modes:X}h"
    fault = "" if named else f"{mode}, which 6502h = {modes:X}h does not name; expected one that it names"
    yield Finding(KEY, shows, entry.line, fault, 0x6502)
