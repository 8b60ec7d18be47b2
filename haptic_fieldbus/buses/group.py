"""A group of buses that behaves as one bus.

Each bus fills the part of the one process image that belongs to its axes. There is no thread. The SYNC frames are sent
directly after each other; while the group waits for one bus, the feedback of the others gathers in their controllers.
When one bus stays silent until the deadline, the others are still read without waiting, so only its own axes are stale.

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

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import TypeVar

from haptic_fieldbus.buses.bus import DriveFacts, InSteps, StepwiseBus
from haptic_fieldbus.planning.image import HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.signals import LinkFlag

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
