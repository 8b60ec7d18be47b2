"""What a fieldbus protocol does for a plan, before anything is opened."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.power import PowerTable
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import Fault, ProfileError
from haptic_fieldbus.protocols.bus_name import BusName
from haptic_fieldbus.protocols.traffic import AxisTraffic, BusTraffic
from haptic_fieldbus.signals import Signal

Members = Mapping[str, tuple[DriveProfile, AxisTraffic]]
"""The axes on a bus, by name."""


class FieldbusProtocol(Protocol):
    """One protocol; `name` is what profiles call it."""

    @property
    def name(self) -> str: ...

    @property
    def profile(self) -> type[DriveProfile]:
        """The schema of its profile files."""

    @property
    def section(self) -> type[BusSection]:
        """The schema of a bus in a rig file."""

    @property
    def nodes(self) -> range:
        """Numbers that a drive on its bus may have."""

    @property
    def bus_forms(self) -> str:
        """How its buses are written, with examples."""

    def vendor_profile(self, path: str | Path) -> DriveProfile:
        """The profile that a vendor's file makes; raises ProfileError or EdsError."""
        raise ProfileError(path, [Fault("", f"{self.name} reads no vendors' files")])

    def check_profile(self, document: Document) -> None:
        """Note faults that the schema of a profile cannot state; none unless there are rules."""

    def parse_bus(self, text: str) -> BusName:
        """A bus as the command line names it; raises UsageError with the known forms."""

    def bus_name(self, section: BusSection) -> BusName:
        """A bus of a rig as the command line would name it; raises UsageError where there can be none."""
        return BusName(f"{section.interface}:{section.channel}", section)

    def in_place_of(self, section: BusSection, named: BusName, channel: str | None) -> BusSection:
        """The bus that was named, in the place of one of a rig; `channel` where the rig has several."""
        return named.section

    def power_table(self, profile: DriveProfile) -> PowerTable:
        """How the status of this drive tells power states, and which command asks for the next."""

    def axis_traffic(
        self, axis: RigAxis, profile: DriveProfile, incoming: Sequence[Signal], outgoing: Sequence[Signal]
    ) -> AxisTraffic:
        """Lay out these signals; raises PlanError (ImageTooLargeError) where the drive cannot carry them."""

    def bus_traffic(self, section: BusSection, members: Members, rate: float, waiting: float) -> BusTraffic:
        """What the bus carries at `rate` [Hz]; its feedback waits so long [s] for that of other buses."""
