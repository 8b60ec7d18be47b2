"""The protocols that there are, by the name that a profile gives: our own, and those that other packages add.

A package adds one by an entry point in the group `haptic_fieldbus.protocols`; its name is that of the protocol, and the
first word of its buses (`toy`, `toy:CHANNEL`).
"""

import re
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from haptic_fieldbus.defaults import DEFAULT_PROTOCOL
from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.bus_name import BusName
from haptic_fieldbus.protocols.protocol import FieldbusProtocol

GROUP = "haptic_fieldbus.protocols"
"""Of a profile that names none, and of buses that begin with no other's word."""
BUILT_IN = {DEFAULT_PROTOCOL: "haptic_fieldbus.protocols.canopen.protocol"}
TRAFFIC_KEYS = {DEFAULT_PROTOCOL: "pdos", "modbus": "registers"}
"""Keys of `plan --json` that are always there, null where no axis speaks the protocol."""
UNBUILT = {"modbus": ("modbus-tcp", "modbus-rtu", "sim-modbus-tcp", "sim-modbus-rtu")}
"""Protocols that are known and not available yet, with the first words of their buses."""


def protocol_names() -> list[str]:
    """Of all that can be used."""
    return sorted({*BUILT_IN, *added(GROUP)})


def protocol_named(name: str) -> FieldbusProtocol:
    """Raises UsageError for a name that there is not, or not yet."""
    if name in BUILT_IN:
        built_in: FieldbusProtocol = import_module(BUILT_IN[name]).PROTOCOL
        return built_in
    if name in added(GROUP):
        theirs: FieldbusProtocol = added(GROUP)[name].load()
        return theirs
    if name in UNBUILT:
        raise UsageError(
            f"{name.capitalize()} is not available yet in this version; there is: {', '.join(protocol_names())}"
        )
    raise UsageError(f'no protocol "{name}"{suggestion(name, protocol_names())}')


def protocol_of_bus(word: str) -> FieldbusProtocol:
    """Of a bus that begins with this word, an interface in a rig or the name of a simulation; raises UsageError."""
    if word in added(GROUP):
        return protocol_named(word)
    unbuilt = next((name for name, words in UNBUILT.items() if word in words), None)
    if unbuilt is not None:
        forms = "; ".join(protocol_named(each).bus_forms for each in protocol_names())
        raise UsageError(f"{unbuilt.capitalize()} is not available yet in this version; buses are {forms}")
    return protocol_named(DEFAULT_PROTOCOL)


def parse_bus(text: str) -> BusName:
    """Take a bus name apart; raises UsageError with the nearest names and the known forms."""
    try:
        protocol = protocol_of_bus(re.split("[:@]", text)[0])
    except UsageError as error:
        raise UsageError(f'bus "{text}": {error}') from None
    return protocol.parse_bus(text)


def added(group: str) -> dict[str, EntryPoint]:
    """What other packages add to a group, by name."""
    return {entry.name: entry for entry in entry_points(group=group)}
