"""Several buses as one: begin on all, then collect; write on all; and stop all, whatever becomes of one.

Each bus serves the axes of its own in the one process image. There is no thread: the SYNCs go out one directly after
the other, and while one bus is waited for, the others' feedback gathers in their controllers. When nothing more comes
from one until the deadline, the others are still read without waiting, so only its own axes are stale.

The image has one instant, `t_ns`: the nominal end of the last SYNC, when every drive had latched. An axis' age counts
from its own bus' SYNC. What lies between the first latch and the last, the skew, is small against the period: the SYNC
of a slower bus is longer (48 µs more at 500 kbit/s than at 1 Mbit/s), and on each bus one frame that is just being sent
must end first: a heartbeat, at most 65 bits, for nothing else is on its way when a period begins. Measured in the
simulation, where a call to send takes no time: over 4000 periods of two buses of one bit rate 0 in 99 of 100 periods,
and 3 bits at most. On real controllers the time of that call is added.

Reference: CiA 301 7.2.5 (SYNC): it synchronises the devices of one bus; nothing synchronises buses but their master.
"""

from collections.abc import Mapping
from contextlib import ExitStack

from haptic_fieldbus.buses.bus import Bus, DriveFacts, InSteps
from haptic_fieldbus.planning.image import HEADER
from haptic_fieldbus.planning.plan import Plan


class BusGroup(InSteps):
    """Buses by their names in the plan."""

    def __init__(self, buses: Mapping[str, Bus]) -> None:
        self._named = dict(buses)
        self._buses = tuple(buses.values())
        self._image = bytearray()

    @property
    def facts(self) -> dict[str, DriveFacts]:
        return {axis: facts for bus in self._buses for axis, facts in bus.facts.items()}

    @property
    def warnings(self) -> list[str]:
        return [sentence for bus in self._buses for sentence in bus.warnings]

    @property
    def restarted(self) -> frozenset[str]:
        return frozenset[str]().union(*(bus.restarted for bus in self._buses))

    @property
    def fresh(self) -> bool:
        return all(bus.fresh for bus in self._buses)

    @property
    def latch_ns(self) -> int:
        """Of the last."""
        return max([bus.latch_ns for bus in self._buses])

    def open(self, plan: Plan) -> None:
        """Inspect the drives of all buses, then configure all, then start all; when one fails, all are closed.

        Raises BusError or DriveFaultError.
        """
        try:
            super().open(plan)
        except BaseException:
            self.close()
            raise

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """All buses share the image."""
        self._image = image
        for part in plan.buses:
            self._named[part.name].inspect(plan.on(part), image)

    def configure(self, plan: Plan) -> None:
        """Each bus gets its part of the plan."""
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
        for bus in self._buses:
            bus.collect(deadline_ns)
        HEADER.pack_into(self._image, 0, self.latch_ns)
        return self._image

    def write(self, image: bytes | bytearray) -> None:
        """Each bus sends the set-points of its axes; raises BusError when one of the buses is dead."""
        for bus in self._buses:
            bus.write(image)

    def stop(self) -> bool:
        """Torque-free set-points on all buses, also when one of them raises; then each bus is stopped for itself.

        Buses whose feedback came are first: the wait for one that is dead must not outlast their drives' guards.
        """
        confirmed: list[bool] = []
        with ExitStack() as last_in_first_out:
            for bus in sorted(self._buses, key=lambda bus: bus.fresh):
                last_in_first_out.callback(lambda bus: confirmed.append(bus.stop()), bus)
            for bus in reversed(self._buses):
                last_in_first_out.callback(bus.release)
        return all(confirmed)

    def release(self) -> None:
        for bus in self._buses:
            bus.release()

    def close(self) -> None:
        """Stop, if that was not done, and let go of all buses."""
        with ExitStack() as last_in_first_out:
            for bus in self._buses:
                last_in_first_out.callback(bus.close)
            last_in_first_out.callback(self.stop)
