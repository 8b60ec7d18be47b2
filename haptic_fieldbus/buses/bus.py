"""The contract of a bus towards the loop, and the facts that a bus reads from its drives.

The loop calls `open`, or the parts of it with questions in between, `read`, `write`, `stop` and `close`. `read` and
`stop` have parts as well (`StepwiseBus`). A group of buses calls each part on all of its buses before the next part, so
that the buses work side by side.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

from haptic_fieldbus.drive.objects import Identity
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.traffic import BusTraffic
from haptic_fieldbus.signals import LinkFlag


@dataclass(frozen=True)
class DriveFacts:
    """Facts that a drive reported when it was inspected."""

    axis: str
    node: int
    title: str
    identity: Identity
    rated_torque: float | None
    """[N·m]; from the drive's own object, None where it has none."""
    link_loss: str
    """Sentence for people: the reaction that is configured for the loss of the master, and its deadline."""
    changes: tuple[str, ...] = ()
    """Sentences for people: values of the drive that the run changes and puts back."""
    listened: str = ""
    """Sentence for people: what was heard on the bus before anything was sent; empty when nobody listened."""


class Bus(Protocol):
    """Exchange of process images with the drives of one bus, or of a group of buses.

    Faults of the link to one axis are flags in the input image. During the exchange only a dead bus raises.
    """

    @property
    def facts(self) -> dict[str, DriveFacts]:
        """Facts of each drive by the name of its axis; filled by `inspect`."""

    @property
    def warnings(self) -> list[str]:
        """Faults that stopped nothing, one sentence each."""

    @property
    def causes(self) -> Mapping[str, tuple[LinkFlag, int]]:
        """By axis, the event since `start` that best explains other faults, with its code.

        It may have come later than the trip. Events that our own `stop` caused are left out.
        """

    @property
    def foreign_load(self) -> Mapping[str, float]:
        """By axis, the share of its bus that frames of other devices took; empty where none can be heard."""

    def open(self, plan: Plan) -> None:
        """Configure the drives and start them, torque-free: `inspect`, `configure` and `start`.

        Raises BusError or DriveFaultError; no drive then takes part in the exchange.
        """

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """Check the drives without writing to them.

        `image` is the input image of the whole plan; later exchanges fill in the part of this bus.
        Raises BusError or DriveFaultError.
        """

    def configure(self, plan: Plan) -> None:
        """Configure the inspected drives; from here on `stop` has something to undo. Raises BusError."""

    def start(self) -> None:
        """Let the drives take part in the exchange, torque-free; raises BusError."""

    def read(self, deadline_ns: int) -> bytearray:
        """Exchange feedback once and return the input image, by the deadline [ns]; the buffer is reused."""

    def write(self, image: bytes | bytearray) -> None:
        """Send the output image; set-points that cannot be sent are dropped, never queued."""

    def ask(self, axis: str) -> int | None:
        """Read the statusword of a drive outside of the exchange. This does not feed the drive's watchdog.

        None without an answer in some milliseconds. Raises BusError only when the bus itself is dead.
        """

    def acknowledge(self) -> None:
        """Clear the faults of drives on a stopped bus that lost their master.

        Raises DriveFaultError for a fault of another origin, which is left as it is, or BusError.
        """

    def stop(self) -> bool:
        """Take the torque away from every drive, now; True when all confirmed that their motors are off.

        Raises nothing: neither one drive nor one bus nor a log keeps another drive from being freed.
        """

    def close(self) -> None:
        """Stop unless already stopped, and release the bus; raises no BusError."""


class StepwiseBus(Bus, Protocol):
    """The bus of one protocol, with the parts of `read` and `stop` that a group calls one by one on all of its buses.

    `collect` writes the instant at which the drives latched into the header of the image, for the group too.
    """

    def prepare(self, deadline_ns: int) -> None:
        """Process all that arrived since the last exchange, until the deadline [ns] at the latest."""

    def begin(self) -> None:
        """Request feedback from the drives."""

    def collect(self, deadline_ns: int) -> bytearray:
        """Receive the feedback until the deadline [ns], write the headers, and return the input image."""

    def release(self) -> None:
        """Begin `stop`: take the torque away by every way that needs no answer. Raises nothing."""

    def settle(self) -> bool:
        """Wait some milliseconds for the drives to be free; True when they are, or the time is over.

        Meanwhile nothing feeds the drives' watchdogs, so that a silent drive switches itself off. Raises nothing.
        """

    def leave(self) -> bool:
        """End `stop`: leave the drives; True when all confirmed that their motors are off. Raises nothing."""


OfProtocol = TypeVar("OfProtocol", bound=BusTraffic)


def traffic_of(plan: Plan, kind: type[OfProtocol]) -> OfProtocol:
    """Return the traffic of the only bus in this part of a plan; raises TypeError for a bus of another protocol."""
    (bus,) = plan.buses
    if not isinstance(bus.traffic, kind):
        raise TypeError(f"bus {bus.name} is one of {bus.protocol}")
    return bus.traffic


class InSteps:
    """Mixin with `open`, `read` and `stop`, composed of the parts that a group calls one by one."""

    @property
    def foreign_load(self) -> Mapping[str, float]:
        """Empty: a bus that can hear other devices overrides this."""
        return {}

    def open(self: Bus, plan: Plan) -> None:
        """Inspect the drives, configure them and start them; raises BusError or DriveFaultError after `stop`."""
        try:
            self.inspect(plan, bytearray(plan.image.input_size))
            self.configure(plan)
            self.start()
        except BaseException:
            self.stop()
            raise

    def read(self: StepwiseBus, deadline_ns: int) -> bytearray:
        """Exchange feedback once and return the input image; raises BusError only when the bus itself is dead."""
        self.prepare(deadline_ns)
        self.begin()
        return self.collect(deadline_ns)

    def stop(self: StepwiseBus) -> bool:
        """Take the torque away from every drive, now; True when all confirmed that their motors are off."""
        self.release()
        while not self.settle():
            pass
        return self.leave()
