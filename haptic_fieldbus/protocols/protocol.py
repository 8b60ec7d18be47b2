"""Interface between planning and a fieldbus protocol; nothing here opens a bus."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from haptic_fieldbus.defaults import DEFAULT_DRIVE, DEFAULT_RATE, SIMULATION
from haptic_fieldbus.documents import Document, KeyPath
from haptic_fieldbus.drive.profile import DataType, DriveProfile, PowerTable
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import Fault, ProfileError
from haptic_fieldbus.protocols.traffic import AxisTraffic, BusTraffic
from haptic_fieldbus.signals import Signal

# A bus as users write it, `sim` or `socketcan:can0@500000`, parsed by its protocol.

_BIT_RATE = re.compile(r"([0-9]{1,12}(?:\.[0-9]{1,12})?)([kM]?)(?:bit/s)?")
_FACTORS = {"": 1, "k": 10**3, "M": 10**6}


@dataclass(frozen=True)
class BusName:
    """The text that a user wrote, and the bus of a rig that it stands for."""

    text: str
    section: BusSection
    assumed: str = ""
    """Sentence about a value that the text leaves open and that was assumed; empty when there is none."""

    @property
    def simulated(self) -> bool:
        """True when the bus is simulated."""
        return self.section.simulated


def bit_rate(text: str) -> int | None:
    """Return a bit rate [bit/s] as a bus name has it after its @, `500000`, `500k` or `1M`; None for another text."""
    match = _BIT_RATE.fullmatch(text)
    rate = Fraction(match[1]) * _FACTORS[match[2]] if match else Fraction(1, 2)
    return int(rate) if rate.denominator == 1 else None


Members = Mapping[str, tuple[DriveProfile, AxisTraffic]]
"""Axes on a bus: name → (profile, traffic)."""


Signals = Sequence[Signal]
Profile = TypeVar("Profile", bound=DriveProfile)
Traffic = TypeVar("Traffic", bound=AxisTraffic)


@dataclass(frozen=True)
class BusMember(Generic[Profile, Traffic]):
    """One axis on a bus of one protocol: its name, profile and traffic."""

    axis: str
    profile: Profile
    traffic: Traffic


def traffic_as(kind: type[Traffic], words: str, traffic: AxisTraffic) -> Traffic:
    """Return the traffic of an axis as that of one protocol; raises TypeError when another protocol made it."""
    if not isinstance(traffic, kind):
        raise TypeError(f"expected {words}, not {type(traffic).__name__}")
    return traffic


class FieldbusProtocol(Protocol):
    """One fieldbus protocol, as planning uses it; `name` is its name in profile files."""

    name: str
    profile: type[DriveProfile]
    """Schema of its profile files."""
    section: type[BusSection]
    """Schema of its buses in rig files."""
    nodes: range
    """Numbers that a drive on its bus may have."""
    fits_profiles: bool = False
    """True when a run fits profiles of no particular drive to the drives that it meets (`BusAccess.fitted`)."""
    default_drive: str = DEFAULT_DRIVE
    """Profile of a drive on its buses when none is named."""

    def wanted_node(self, node: int, interface: str) -> str:
        """Return what the number of a drive must be on a bus of this interface, in words; empty when `node` is good."""
        return "" if node in self.nodes else f"a whole number from {self.nodes[0]} to {self.nodes[-1]}"

    def simulated_bus(self, profile: DriveProfile) -> str:
        """Return the name of a simulated bus on which a drive of its own can be."""
        return SIMULATION

    def vendor_profile(self, path: str | Path) -> DriveProfile:
        """Return the profile described by a vendor's file; raises ProfileError or EdsError."""
        raise ProfileError(path, [Fault("", f"{self.name} reads no vendors' files")])

    def check_profile(self, document: Document) -> None:
        """Note faults that the schema of a profile cannot state; by default there are none."""

    def parse_bus(self, text: str) -> BusName:
        """Return a bus as the command line names it; raises UsageError with the known forms."""

    def bus_name(self, section: BusSection) -> BusName:
        """Return a bus of a rig as the command line would name it; raises UsageError when it cannot be named."""
        return BusName(f"{section.interface}:{section.channel}", section)

    def in_place_of(self, section: BusSection, named: BusName, channel: str | None) -> BusSection:
        """Return the section of the bus that replaces the bus `section` of a rig.

        `channel` replaces the channel of the named bus when the rig has several buses; else it is None.
        """
        return named.section

    def power_table(self, profile: DriveProfile) -> PowerTable:
        """Return the table of statuswords and controlwords by which the master commands the power state."""

    def axis_traffic(
        self, axis: RigAxis, section: BusSection, profile: DriveProfile, incoming: Signals, outgoing: Signals
    ) -> AxisTraffic:
        """Lay out the signals of one axis on its bus.

        Raises PlanError (ImageTooLargeError) when the drive cannot carry them.
        """

    def bus_traffic(self, section: BusSection, members: Members, rate: float, waiting: float) -> BusTraffic:
        """Return the traffic of a bus at `rate` [Hz], whose feedback waits for that of other buses, `waiting` in s."""

    def ways(self, section: BusSection, members: Members, rate: float | None, waiting: float) -> Sequence[BusTraffic]:
        """Return the ways of the exchange that fit into a period, at least one, the one with the shortest delay first.

        Without a rate each has its own. By default `bus_traffic` is the only way.
        """
        return (self.bus_traffic(section, members, DEFAULT_RATE if rate is None else rate, waiting),)


# Checks of a profile that its dataclasses cannot state, on any protocol.

TORQUES: tuple[KeyPath, ...] = (("torque", "target"), ("torque", "actual"), ("torque", "demand"))
"""Torques in the steps of the drive: keys with the same types and units."""


def check_usable(document: Document) -> bool:
    """Return whether a profile is for rendering force; one that is not has to say why."""
    usable = document.value("drive", "usable") is not False
    if not usable and "drive.usable" not in document.table("sources"):
        document.fault(("drive", "usable"), 'false without a reason; expected an entry "drive.usable" in [sources]')
    return usable


def check_motion(document: Document) -> None:
    """Note a profile that has neither a position nor a velocity, so that the motion of the handle is unknown."""
    if "position" not in document.data and "velocity" not in document.data:
        expected = "position.actual, velocity.actual or both"
        document.fault(("position",), f"missing, like [velocity]; expected {expected}")


def check_types(document: Document, types: Mapping[KeyPath, Sequence[str]]) -> None:
    """Note types with which force cannot be rendered."""
    known = [each.value for each in DataType]
    for path, possible in types.items():
        found = document.value(*path, "type")
        # A type that is unknown altogether has its fault from the schema.
        if isinstance(found, str) and found in known and found not in possible:
            document.refuse((*path, "type"), " or ".join(f'"{name}"' for name in possible))


def check_fits(document: Document, path: KeyPath, value: object, type_name: object) -> None:
    """Note a whole number that its type cannot hold."""
    if type_name in [each.value for each in DataType] and type(value) is int:
        low, high = DataType(type_name).limits
        if not low <= value <= high:
            document.refuse(path, f"{low} to {high}, which fit into {type_name}")


def check_units(document: Document, units: Mapping[KeyPath, Sequence[str]]) -> None:
    """Note units with which force cannot be rendered."""
    for path, possible in units.items():
        if document.table(*path) and document.value(*path, "unit") not in possible:
            document.refuse((*path, "unit"), " or ".join(f'"{name}"' for name in possible))


def check_echo(document: Document, ways: Collection[str], kind: str) -> None:
    """Note a way of proving set-points for which the profile names no object or register, the `kind` of protocol."""
    way = document.value("torque", "echo")
    if isinstance(way, str) and way in ways and not document.table("torque", str(way)):
        document.fault(("torque", "echo"), f'"{way}" without torque.{way}; expected this {kind} too, or "none"')
