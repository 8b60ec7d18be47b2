"""What every bus does for the loop, alone or in a group, and what it found out about the drives.

The loop uses `open`, `read`, `write`, `stop` and `close`. A group of buses does each of the others on all of its buses
before the next, so that they run side by side.
"""

from dataclasses import dataclass
from typing import Protocol

from haptic_fieldbus.planning.plan import Plan


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
        """By axis; filled by `inspect`."""

    @property
    def warnings(self) -> list[str]:
        """What went wrong without stopping anything, as sentences."""

    @property
    def restarted(self) -> frozenset[str]:
        """Axes whose device restarted since it was configured."""

    @property
    def fresh(self) -> bool:
        """Did all feedback of the last exchange come?"""

    @property
    def latch_ns(self) -> int:
        """When the drives latched the feedback of the last exchange."""

    def open(self, plan: Plan) -> None:
        """Configure and start the drives, torque-free; raises BusError or DriveFaultError, nothing half done."""

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """Look at the drives and write nothing; of `image`, the process image, this bus fills its own places."""

    def configure(self, plan: Plan) -> None:
        """The drives that were inspected; from here on there is something to undo."""

    def start(self) -> None:
        """Let the drives take part in the exchange, torque-free."""

    def read(self, deadline_ns: int) -> bytearray:
        """One exchange of feedback; the image is reused, and is returned at the deadline at the latest."""

    def prepare(self, deadline_ns: int) -> None:
        """Take in what came since the last exchange."""

    def begin(self) -> None:
        """Ask for feedback."""

    def collect(self, deadline_ns: int) -> bytearray:
        """Take it in, and write the headers."""

    def write(self, image: bytes | bytearray) -> None:
        """Send the output image; what cannot be sent is dropped, never queued."""

    def stop(self) -> bool:
        """A torque-free image on the wire now, then disable; True when every drive confirmed. Raises no BusError."""

    def release(self) -> None:
        """A torque-free image on the wire now, and no more; raises no BusError."""

    def close(self) -> None:
        """Stop, if that was not done, and let go of the bus; raises no BusError."""


class InSteps:
    """`open` and `read` made of the verbs that a group uses."""

    def open(self: Bus, plan: Plan) -> None:
        """Inspect, configure, start."""
        self.inspect(plan, bytearray(plan.image.input_size))
        self.configure(plan)
        self.start()

    def read(self: Bus, deadline_ns: int) -> bytearray:
        """Prepare, begin, collect; raises BusError only when the bus itself is dead."""
        self.prepare(deadline_ns)
        self.begin()
        return self.collect(deadline_ns)
