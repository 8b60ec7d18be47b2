"""A bus as a user writes it, `sim` or `socketcan:can0@500000`, taken apart by its protocol."""

from dataclasses import dataclass

from haptic_fieldbus.drive.rig import BusSection


@dataclass(frozen=True)
class BusName:
    """What was written, and the bus of a rig that it stands for."""

    text: str
    section: BusSection
    assumed: str = ""
    """What it leaves open and was taken for granted, as a sentence."""

    @property
    def simulated(self) -> bool:
        return self.section.simulated
