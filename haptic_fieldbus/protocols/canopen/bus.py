"""CAN buses as users and rig files write them."""

import re
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Annotated, ClassVar

from annotated_types import Gt

from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, SIMULATION
from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.drive.fields import STRICT
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.bus_name import BusName

"""[bit/s]; taken where the bit rate cannot be known."""
BITRATES = (10_000, 1_000_000)
"""[bit/s]; the least and the greatest of CiA 301, table 1."""
NODES = range(1, 128)
"""Node-IDs, CiA 301, 7.3.5."""
BUS_FORMS = "sim[@BITRATE] or INTERFACE:CHANNEL[@BITRATE], for example sim, socketcan:can0, pcan:PCAN_USBBUS1@1000000"

SIMULATION_INTERFACE = "haptic_sim"

# python-can's own interfaces; importing `can` only to name them would cost every command 0.1 s. A test compares.
CAN_INTERFACES = (
    "canalystii", "cantact", "etas", "gs_usb", "iscan", "ixxat", "kvaser", "neousys", "neovi", "nican", "nixnet",
    "pcan", "robotell", "seeedstudio", "serial", "slcan", "socketcan", "socketcand", "systec", "udp_multicast",
    "usb2can", "vector", "virtual",
)  # fmt: skip
LINUX_CHANNEL = re.compile(r"(v|sl)?can\d+(@.*)?")


@dataclass(frozen=True)
class CanSection(BusSection):
    """A CAN bus of a rig, by python-can's names; bit rate in bit/s."""

    bitrate: Annotated[int, Gt(0)] = DEFAULT_BIT_RATE
    protocol: ClassVar[str] = "canopen"
    __pydantic_config__: ClassVar[dict[str, object]] = STRICT

    @property
    def simulated(self) -> bool:
        return self.interface == SIMULATION_INTERFACE


def can_section(section: BusSection) -> CanSection:
    """A bus that is known to be one of CAN; TypeError for another."""
    if not isinstance(section, CanSection):
        raise TypeError(f"{section.interface}:{section.channel} is no CAN bus")
    return section


def parse_bus(text: str) -> BusName:
    """Take a bus name apart; raises UsageError with the nearest names and the known forms."""
    interface, colon, channel = text.partition(":")
    if not colon:
        return _parse_bare(text)
    if interface == SIMULATION:
        raise UsageError(f'bus "{text}": the simulated bus has no channel, it is written sim[@BITRATE]')
    if interface == SIMULATION_INTERFACE:
        return _parse_simulation(text, channel)
    return _parse_can(text, interface, channel)


def in_place_of(section: CanSection, named: BusName, channel: str | None) -> CanSection:
    """The bus that was named, in the place of one of a rig; `channel` where the rig has several."""
    new = named.section
    if not isinstance(new, CanSection):
        raise UsageError(f'bus "{named.text}" is no CAN bus, the rig\'s {section.interface}:{section.channel} is one')
    bitrate = section.bitrate if named.text == SIMULATION else new.bitrate
    return CanSection(new.interface, channel or new.channel, bitrate)


def _parse_bare(text: str) -> BusName:
    name, at, bitrate = text.partition("@")
    if name == SIMULATION:
        speed = _bitrate(text, bitrate) if at else DEFAULT_BIT_RATE
        return BusName(text, CanSection(SIMULATION_INTERFACE, SIMULATION, speed))
    if name in can_interfaces():
        raise UsageError(f'bus "{text}" lacks its channel: {name}:CHANNEL[@BITRATE]')
    if LINUX_CHANNEL.fullmatch(name):
        raise UsageError(f'bus "{text}" lacks its interface; nearest: socketcan:{text}. Buses are {BUS_FORMS}')
    raise UsageError(f'no bus "{text}"{suggestion(name, (SIMULATION, *can_interfaces()))}. Buses are {BUS_FORMS}')


def _parse_simulation(text: str, rest: str) -> BusName:
    """The interface as a rig names it; its channel may itself hold @, for drives and their nodes."""
    channel, _, digits = rest.rpartition("@")
    if channel and digits.isdecimal() and int(digits) >= BITRATES[0]:
        return BusName(text, CanSection(SIMULATION_INTERFACE, channel, _bitrate(text, digits)))
    return BusName(text, CanSection(SIMULATION_INTERFACE, rest))


def _parse_can(text: str, interface: str, rest: str) -> BusName:
    if interface not in can_interfaces():
        near = suggestion(interface, can_interfaces())
        raise UsageError(f'no bus interface "{interface}" in "{text}"{near}. Buses are {BUS_FORMS}')
    channel, at, digits = rest.rpartition("@") if "@" in rest else (rest, "", "")
    if not channel:
        raise UsageError(f'bus "{text}" lacks its channel: {interface}:CHANNEL[@BITRATE]')
    if at:
        return BusName(text, CanSection(interface, channel, _bitrate(text, digits)))
    assumed = f"the bit rate of {text} is not known; 1 Mbit/s is assumed. Give it as {text}@BITRATE"
    return BusName(text, CanSection(interface, channel), assumed)


def can_interfaces() -> tuple[str, ...]:
    """The names of python-can's interfaces, those that other packages add included."""
    added = {entry.name for entry in entry_points(group="can.interface")} - {SIMULATION_INTERFACE}
    return tuple(sorted(added | set(CAN_INTERFACES)))


def _bitrate(text: str, digits: str) -> int:
    if not digits.isdecimal():
        raise UsageError(f'bus "{text}": after @ stands the bit rate in bit/s, for example @500000')
    if not BITRATES[0] <= int(digits) <= BITRATES[1]:
        raise UsageError(f'bus "{text}": {digits} bit/s is outside of what CAN can do, {BITRATES[0]} to {BITRATES[1]}')
    return int(digits)
