"""A bus as users write it, `sim` or `socketcan:can0@500000`, parsed by its protocol."""

from dataclasses import dataclass

from haptic_fieldbus.drive.rig import BusSection


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
