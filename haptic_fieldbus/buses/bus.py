"""The contract of a bus towards the loop, and the facts that a bus reads from its drives.

The loop calls `open`, or the parts of it with questions in between, `read`, `write`, `stop` and `close`. `read` and
`stop` have parts as well (`StepwiseBus`). A group of buses calls each part on all of its buses before the next part, so
that the buses work side by side.

Each bus of a group fills the part of the one process image that belongs to its axes. There is no thread. The SYNC
frames are sent directly after each other; while the group waits for one bus, the feedback of the others gathers in
their controllers. When one bus stays silent until the deadline, the others are still read without waiting, so only its
own axes are stale.

The image has one instant, `t_ns`: the nominal end of the last SYNC, when every drive has latched. The age of an axis
counts from the SYNC of its own bus. The skew, the time from the first latch to the last, has three causes:

- The SYNC of a slower bus is longer (48 µs more at 500 kbit/s than at 1 Mbit/s).
- A frame that is on the wire must end before SYNC. When a period begins this can only be a heartbeat or an answer to
  node guarding, at most 65 bits, and where an echo is asked by SDO its answer, at most 135 bits.
- On real controllers each call to send takes time.

The skew is small against the period. In the simulation, where a call to send takes no time, two buses of the same bit
rate had a skew of 0 in 99 of 100 periods and of 3 bits at most (4000 periods).

Reference: CiA 301 7.2.5 (SYNC). SYNC synchronises the devices of one bus; only the master synchronises several buses.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol, TypeVar

from haptic_fieldbus.drive.profile import Identity, MappedSignal
from haptic_fieldbus.planning.image import HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.traffic import BusTraffic
from haptic_fieldbus.signals import LinkFlag, Signal


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


Offsets = Mapping[Signal, int]
"""Offset of each signal in an image."""


def offsets_of(signals: Iterable[MappedSignal], start: int) -> Offsets:
    """Return the offset of each signal in an image in which they follow one another from `start`."""
    offsets = {}
    for mapped in signals:
        offsets[mapped.signal] = start
        start += mapped.type.size
    return offsets


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


Returned = TypeVar("Returned")


class BusGroup(InSteps):
    """Several buses behind the interface of one; `buses` maps the names in the plan to the buses."""

    def __init__(self, buses: Mapping[str, StepwiseBus]) -> None:
        self._named = dict(buses)
        self._buses = tuple(buses.values())
        self._unsettled: tuple[StepwiseBus, ...] = ()
        self._failures: list[str] = []
        self._image = bytearray()

    @property
    def facts(self) -> dict[str, DriveFacts]:
        return {axis: facts for bus in self._buses for axis, facts in bus.facts.items()}

    @property
    def warnings(self) -> list[str]:
        return [*[sentence for bus in self._buses for sentence in bus.warnings], *self._failures]

    @property
    def causes(self) -> dict[str, tuple[LinkFlag, int]]:
        return {axis: cause for bus in self._buses for axis, cause in bus.causes.items()}

    @property
    def foreign_load(self) -> dict[str, float]:
        return {axis: load for bus in self._buses for axis, load in bus.foreign_load.items()}

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """Inspect the drives of each bus; all buses share `image`. Raises BusError or DriveFaultError."""
        self._image = image
        for part in plan.buses:
            self._named[part.name].inspect(plan.on(part), image)

    def configure(self, plan: Plan) -> None:
        """Configure the drives of each bus by its part of the plan; raises BusError."""
        for part in plan.buses:
            self._named[part.name].configure(plan.on(part))

    def start(self) -> None:
        for bus in self._buses:
            bus.start()

    def prepare(self, deadline_ns: int) -> None:
        for bus in self._buses:
            bus.prepare(deadline_ns)

    def begin(self) -> None:
        for bus in self._buses:
            bus.begin()

    def collect(self, deadline_ns: int) -> bytearray:
        latest_ns = 0
        for bus in self._buses:
            bus.collect(deadline_ns)
            # Each bus writes its own latch into the shared header; the instant of the image is the last of them.
            latest_ns = max(latest_ns, HEADER.unpack_from(self._image)[0])
        HEADER.pack_into(self._image, 0, latest_ns)
        return self._image

    def write(self, image: bytes | bytearray) -> None:
        """Let each bus send the set-points of its axes; raises BusError when a bus is dead."""
        for bus in self._buses:
            bus.write(image)

    def ask(self, axis: str) -> int | None:
        """Ask the drive of an axis, which must be on one of the buses."""
        return next(bus for bus in self._buses if axis in bus.facts).ask(axis)

    def acknowledge(self) -> None:
        for bus in self._buses:
            bus.acknowledge()

    def release(self) -> None:
        """Send zero torque on all buses before listening to any of them."""
        self._unsettled = self._buses
        for bus in self._buses:
            self._tried(bus.release, None)

    def settle(self) -> bool:
        """Listen to each bus that is not settled yet; answers on the other buses are kept meanwhile."""
        self._unsettled = tuple(bus for bus in self._unsettled if not self._tried(bus.settle, True))
        return not self._unsettled

    def leave(self) -> bool:
        confirmed = [self._tried(bus.leave, False) for bus in self._buses]  # each, also after one that did not
        return all(confirmed)

    def _tried(self, part: Callable[[], Returned], otherwise: Returned) -> Returned:
        """Call a part of `stop`; a bus that breaks its contract and raises must not keep the others from it."""
        try:
            return part()
        except Exception as error:
            self._failures.append(f"stopping a bus failed: {error}")
            return otherwise

    def close(self) -> None:
        """Stop unless already stopped, and release all buses, also when one of them raises."""
        with ExitStack() as last_in_first_out:
            for bus in self._buses:
                last_in_first_out.callback(bus.close)
            last_in_first_out.callback(self.stop)
