"""Names of CAN buses, as users and rig files write them."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib.metadata import entry_points
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, SIMULATION
from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.drive.fields import STRICT, Measured, NonNegativeTime
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.protocol import BusName, bit_rate

BITRATES = (10_000, 1_000_000)
"""Lowest and highest bit rate of CiA 301, table 1 [bit/s]."""
NODES = range(1, 128)
"""Node-IDs (CiA 301, 7.3.5)."""
LISTENING = 1.0
"""Time for which a master listens before it sends [s]."""
LONGEST_LISTENING = 60.0
"""[s]."""
BUS_FORMS = "sim[@BITRATE] or INTERFACE:CHANNEL[@BITRATE], for example sim, socketcan:can0, pcan:PCAN_USBBUS1@1000000"

SIMULATION_INTERFACE = "haptic_sim"
"""Interface of python-can under which the simulated bus is registered."""

# The interfaces of python-can itself. Importing `can` for their names would cost every command 0.1 s, so they are
# listed here, and a test compares the lists.
CAN_INTERFACES = (
    "canalystii", "cantact", "etas", "gs_usb", "iscan", "ixxat", "kvaser", "neousys", "neovi", "nican", "nixnet",
    "pcan", "robotell", "seeedstudio", "serial", "slcan", "socketcan", "socketcand", "systec", "udp_multicast",
    "usb2can", "vector", "virtual",
)  # fmt: skip
LINUX_CHANNEL = re.compile(r"(v|sl)?can\d+(@.*)?")
"""Usual name of a CAN interface under Linux, which users write without `socketcan:`."""


ARGUMENT = re.compile(r",(?=[A-Za-z_]\w*=)")
"""Separator between a bus name and its further arguments, and between these; any other comma belongs to the channel."""
Argument = bool | int | float | str
"""Type of an argument of an interface in a rig file."""
_OF_THE_BUS = "belongs to the bus itself; move it one table up"
OURS = {
    "interface": _OF_THE_BUS,
    "channel": _OF_THE_BUS,
    "bitrate": _OF_THE_BUS,
    "bustype": "is the old name of interface; remove it",
    "receive_own_messages": "would make the master receive its own frames as those of another master; remove it",
    "ignore_config": "is not passed to the interface; remove it",
    "config_context": "is not passed to the interface; remove it",
}
"""Arguments of python-can that are not for a rig to give, and why."""


@dataclass(frozen=True)
class CanSection(BusSection):
    """A CAN bus of a rig, by the names of python-can; the bit rate is in bit/s."""

    bitrate: Annotated[int, Ge(BITRATES[0]), Le(BITRATES[1]), Measured(Quantity.BIT_RATE)] = DEFAULT_BIT_RATE
    """Bit rate of the bus [bit/s]."""
    listen: Annotated[float, Ge(0.0), Le(LONGEST_LISTENING), Measured(Quantity.TIME)] = LISTENING
    """Time for which the master listens for another master before it sends anything [s]; 0: no listening."""
    master_node: Annotated[int, Ge(NODES[0]), Le(NODES[-1])] | None = None
    """Node-ID of the master's heartbeat; None: the highest that no drive of the rig has."""
    adapter_latency: NonNegativeTime | None = None
    """Delay that the adapter adds to each received and to each sent frame [s]. None: 0 in the plan, and an assumed time
    in the limit of a real bus."""
    jitter: NonNegativeTime | None = None
    """Largest lateness of the host in a period [s]. None: 0 in the plan, and an assumed time in the limit of a
    real bus."""
    arguments: Mapping[str, Argument] = field(default_factory=dict)
    """Further arguments of the interface, with python-can's names: `ttyBaudrate`, `host`, `port`."""
    protocol: ClassVar[str] = "canopen"
    __pydantic_config__: ClassVar[dict[str, object]] = STRICT

    def __post_init__(self) -> None:
        for name in self.arguments.keys() & OURS.keys():
            raise ValueError(f"arguments: {name} {OURS[name]}")

    @property
    def simulated(self) -> bool:
        return self.interface == SIMULATION_INTERFACE

    @property
    def lateness(self) -> float:
        return self.jitter or 0.0

    @property
    def wires(self) -> str:
        """Key that distinguishes one pair of wires from another: the same channel name may exist on several hosts."""
        return f"{super().wires}{sorted(self.arguments.items())}"

    @property
    def route(self) -> str:
        return f"{self.wires}, adapter_latency {self.adapter_latency}"

    def in_place_of_real(self) -> "CanSection":
        return StandInCanSection(**vars(self))


@dataclass(frozen=True)
class StandInCanSection(CanSection):
    """The simulated bus in the place of a real one of a rig."""

    stands_for_real: ClassVar[bool] = True


def can_section(section: BusSection) -> CanSection:
    """Return the section as a CAN bus; raises TypeError when it is one of another protocol."""
    if not isinstance(section, CanSection):
        raise TypeError(f"{section.interface}:{section.channel} is not a CAN bus")
    return section


def parse_bus(text: str) -> BusName:
    """Parse the name of a CAN bus; raises UsageError with the nearest names and the known forms."""
    interface, colon, channel = text.partition(":")
    if not colon:
        return _parse_bare(text)
    if interface == SIMULATION:
        raise UsageError(f'bus "{text}": the simulated bus has no channel; write sim[@BITRATE]')
    is_simulated = interface == SIMULATION_INTERFACE
    return _parse_simulation(text, channel) if is_simulated else _parse_can(text, interface, channel)


def in_place_of(section: CanSection, named: BusName, channel: str | None) -> CanSection:
    """Return the `named` bus in the place of `section` of a rig; `channel`, unless None, replaces the named channel.

    Raises UsageError when the named bus is no CAN bus.
    """
    new, own = named.section, f"{section.interface}:{section.channel}"
    if not isinstance(new, CanSection):
        raise UsageError(f'bus "{named.text}" is not a CAN bus, but {own} of the rig is')
    # A simulation without a bit rate is that of the bus which it replaces.
    bitrate = section.bitrate if named.text == SIMULATION else new.bitrate
    # The arguments of one interface are not those of another.
    arguments = section.arguments if new.interface == section.interface else {}
    found = replace(
        section, interface=new.interface, channel=channel or new.channel, bitrate=bitrate, arguments=arguments
    )
    return found.in_place_of_real() if found.simulated and not section.simulated else found


def _parse_bare(text: str) -> BusName:
    """Parse a name without a colon: the simulated bus, or a slip that gets advice."""
    name, at, bitrate = text.partition("@")
    if name == SIMULATION:
        speed = _bitrate(text, bitrate) if at else DEFAULT_BIT_RATE
        return BusName(text, CanSection(SIMULATION_INTERFACE, SIMULATION, speed))
    if name in can_interfaces():
        raise UsageError(f'bus "{text}" has no channel: {name}:CHANNEL[@BITRATE]')
    if LINUX_CHANNEL.fullmatch(name):
        raise UsageError(f'bus "{text}" has no interface; nearest: socketcan:{text}. Buses are {BUS_FORMS}')
    raise UsageError(f'no bus "{text}"{suggestion(name, (SIMULATION, *can_interfaces()))}. Buses are {BUS_FORMS}')


def _parse_simulation(text: str, rest: str) -> BusName:
    """Parse a simulated bus as a rig names it, `haptic_sim:CHANNEL[@BITRATE]`."""
    # The channel may itself have an @ before node-IDs, so only a number as large as a bit rate is taken for one.
    channel, _, digits = rest.rpartition("@")
    if channel and (bit_rate(digits) or 0) >= BITRATES[0]:
        return BusName(text, CanSection(SIMULATION_INTERFACE, channel, _bitrate(text, digits)))
    return BusName(text, CanSection(SIMULATION_INTERFACE, rest))


def _parse_can(text: str, interface: str, rest: str) -> BusName:
    """Parse a real bus, INTERFACE:CHANNEL[@BITRATE][,ARGUMENT=VALUE …].

    A missing bit rate is assumed, in a sentence of the result.
    """
    if interface not in can_interfaces():
        near = suggestion(interface, can_interfaces())
        raise UsageError(f'no bus interface "{interface}" in "{text}"{near}. Buses are {BUS_FORMS}')
    place, *given = ARGUMENT.split(rest)
    # The last @ separates the bit rate; a channel may have one of its own.
    channel, at, digits = place.rpartition("@") if "@" in place else (place, "", "")
    if not channel:
        raise UsageError(f'bus "{text}" has no channel: {interface}:CHANNEL[@BITRATE]')
    arguments = {name: _value(value) for name, _, value in (each.partition("=") for each in given)}
    for name in arguments.keys() & OURS.keys():
        raise UsageError(f'bus "{text}": {name} {OURS[name]}')
    if at:
        return BusName(text, CanSection(interface, channel, _bitrate(text, digits), arguments=arguments))
    assumed = f"the bit rate of {text} is unknown; 1 Mbit/s is assumed. Write it as {interface}:{place}@BITRATE"
    return BusName(text, CanSection(interface, channel, arguments=arguments), assumed)


def _value(text: str) -> Argument:
    """Return the truth value or number that a text stands for, else the text itself."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def can_interfaces() -> tuple[str, ...]:
    """Return the interface names of python-can, including those of other packages, without the simulated one."""
    added = {entry.name for entry in entry_points(group="can.interface")} - {SIMULATION_INTERFACE}
    return tuple(sorted(added | set(CAN_INTERFACES)))


def _bitrate(text: str, digits: str) -> int:
    """Return the bit rate [bit/s]; raises UsageError for a text or a number that is none."""
    rate = bit_rate(digits)
    if rate is None:
        raise UsageError(f'bus "{text}": expected the bit rate in bit/s after @, for example @500000, @500k or @1M')
    if not BITRATES[0] <= rate <= BITRATES[1]:
        raise UsageError(f'bus "{text}": {rate} bit/s; expected {BITRATES[0]} to {BITRATES[1]} for CAN')
    return rate


# Names of the COB-IDs of CANopen's predefined connection set (CiA 301 7.3.5).

NMT_COB_ID = 0x000
EMCY_COB_ID = 0x080
SDO_RESPONSE_COB_ID = 0x580
SDO_REQUEST_COB_ID = 0x600
RPDO_COB_IDS, TPDO_COB_IDS = (0x200, 0x300, 0x400, 0x500), (0x180, 0x280, 0x380, 0x480)
"""Of PDO 1 to 4 of node 0; those of a node have its node-ID added."""
FROM_A_NODE = (EMCY_COB_ID, *TPDO_COB_IDS, SDO_RESPONSE_COB_ID, 0x700)
"""Frames that only a node itself sends, listed for node 0."""
REMOTE = 0x8000
"""Bit that marks a remote frame, where a COB-ID is kept in 16 bits."""

BROADCASTS = {NMT_COB_ID: "NMT command", 0x080: "SYNC", 0x100: "time stamp", 0x7E4: "LSS answer", 0x7E5: "LSS request"}
SERVICES = {
    EMCY_COB_ID: "emergency of node",
    **{cob_id: f"TPDO{number} of node" for number, cob_id in enumerate(TPDO_COB_IDS, start=1)},
    **{cob_id: f"set-point (RPDO{number}) for node" for number, cob_id in enumerate(RPDO_COB_IDS, start=1)},
    SDO_RESPONSE_COB_ID: "SDO answer of node",
    SDO_REQUEST_COB_ID: "SDO request to node",
    0x700: "heartbeat of node",
}


def cob_id_words(cob_id: int) -> str:
    """Return a COB-ID with its meaning: `SYNC (080h)`, `heartbeat of node 127 (77Fh)`; with `REMOTE`, of a request."""
    if cob_id & REMOTE:
        return f"node guarding request to node {cob_id & 0x7F} ({cob_id & ~REMOTE:03X}h)"
    base, node = cob_id & 0x780, cob_id & 0x7F
    service = f"{SERVICES[base]} {node}" if base in SERVICES and node in NODES else "frame"
    return f"{BROADCASTS.get(cob_id, service)} ({cob_id:03X}h)"
