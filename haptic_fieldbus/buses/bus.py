"""What every bus does for the loop: five verbs, and what it found out about the drives."""

from dataclasses import dataclass
from typing import Protocol

from haptic_fieldbus.planning import Plan


@dataclass(frozen=True)
class DriveFacts:
    """What a drive said about itself while it was configured; None where it has no such object."""

    axis: str
    node: int
    title: str
    vendor_id: int
    product_code: int
    revision: int | None
    serial: int | None
    rated_torque: float | None
    """[N·m]; as the drive states it."""
    link_loss: str
    """What happens when the master is gone, as the drive confirmed it."""


class Bus(Protocol):
    """Moves process images; faults of the link are flags in the input image, and only a dead bus raises."""

    @property
    def facts(self) -> dict[str, DriveFacts]:
        """By axis; filled by `open`."""
        ...

    @property
    def warnings(self) -> list[str]:
        """What went wrong without stopping anything, as sentences."""
        ...

    @property
    def restarted(self) -> frozenset[str]:
        """Axes whose device restarted since it was configured."""
        ...

    def open(self, plan: Plan) -> None:
        """Configure and start the drives, torque-free; raises BusError or DriveFaultError, nothing half done."""
        ...

    def read(self, deadline_ns: int) -> bytearray:
        """One exchange of feedback; the image is reused, and is returned at the deadline at the latest."""
        ...

    def write(self, image: bytes | bytearray) -> None:
        """Send the output image; what cannot be sent is dropped, never queued."""
        ...

    def stop(self) -> bool:
        """A torque-free image on the wire now, then disable; True when every drive confirmed. Raises no BusError."""
        ...

    def close(self) -> None:
        """Stop, if that was not done, and let go of the bus; raises no BusError."""
        ...
