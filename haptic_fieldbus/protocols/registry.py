"""The known protocols, by the name that profiles give them: those of this package, and those of other packages.

Another package adds a protocol by an entry point in the group `haptic_fieldbus.protocols`. The name of the entry point
is the name of the protocol, and the first word of its bus names (`toy`, `toy:CHANNEL`).
"""

import re
from importlib import import_module
from importlib.metadata import EntryPoint

from haptic_fieldbus.defaults import DEFAULT_PROTOCOL, SIMULATION
from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.documents.own_parts import own_entry_points
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.protocol import BusName, FieldbusProtocol

GROUP = "haptic_fieldbus.protocols"
"""Protocol of a profile that names none, and of a bus whose first word belongs to no other protocol."""
BUILT_IN = {
    DEFAULT_PROTOCOL: "haptic_fieldbus.protocols.canopen.protocol",
    "modbus": "haptic_fieldbus.protocols.modbus.protocol",
}
"""Protocols of this package: name → module, which has the protocol as `PROTOCOL`."""
TRAFFIC_KEYS = {DEFAULT_PROTOCOL: "pdos", "modbus": "registers"}
"""Protocol → key of its traffic in `plan --json`; each key is always there, null when no axis uses the protocol."""
WORDS = dict.fromkeys(("modbus-tcp", "modbus-rtu", "sim-modbus-tcp", "sim-modbus-rtu"), "modbus")
"""First word of a bus name → protocol of this package; all other words are interfaces of the default protocol."""


def protocol_names() -> list[str]:
    """Return the names of all available protocols, sorted."""
    return sorted({*BUILT_IN, *added(GROUP)})


def protocol_named(name: str) -> FieldbusProtocol:
    """Return the protocol of that name; raises UsageError when it is unknown."""
    if name in BUILT_IN:  # imported here, because a run needs the modules of its own protocols alone
        built_in: FieldbusProtocol = import_module(BUILT_IN[name]).PROTOCOL
        return built_in
    if name in added(GROUP):
        theirs: FieldbusProtocol = added(GROUP)[name].load()
        return theirs
    raise UsageError(f'no protocol "{name}"{suggestion(name, protocol_names())}')


def protocol_of_bus(word: str) -> FieldbusProtocol:
    """Return the protocol of a bus by its first word: an interface of a rig, or the name of a simulation."""
    if word != SIMULATION and (word in WORDS or word in added(GROUP)):
        return protocol_named(WORDS.get(word, word))
    # CAN interfaces are not listed here, so the default protocol has to refuse a word that nobody knows.
    return protocol_named(DEFAULT_PROTOCOL)


def parse_bus(text: str) -> BusName:
    """Parse the name of a bus; raises UsageError with the nearest names and the known forms."""
    word = re.split("[:@]", text)[0]  # ends at the channel or at the bit rate
    slip = next((name for name in WORDS.values() if word.startswith((name, f"{SIMULATION}-{name}"))), None)
    return (protocol_named(slip) if slip else protocol_of_bus(word)).parse_bus(text)


def added(group: str) -> dict[str, EntryPoint]:
    """Return the entry points that other packages add to a group, by name."""
    return {name: entries[-1] for name, entries in own_entry_points(group).items()}
