"""The CANopen master: SYNC out, TPDOs in, RPDOs out, a heartbeat when it is due, all in the thread of the loop.

One period is `read` and `write`:

- `read` first processes the frames since the last exchange: heartbeats, emergencies, and late TPDOs, which are dropped.
  Then it sends SYNC and receives until every TPDO is in or the deadline is reached. Faults become flags in the header
  of the image; the cycle decides about them.
- `write` sends the RPDOs and, every few periods, the heartbeat of the master.

`stop` sends torque-free set-points before it does anything else. With several buses, `group` calls the parts of `open`,
`read` and `stop` one by one, each on all buses.

Reference: CiA 301 7.2.2 (PDO), 7.2.5 (SYNC), 7.2.8 (NMT).
"""

import can

from haptic_fieldbus.buses.bus import DriveFacts, InSteps
from haptic_fieldbus.buses.canopen.frames import FrameLog
from haptic_fieldbus.buses.canopen.link import BUS_OFF, EXCEPTION, Exchange, Link
from haptic_fieldbus.buses.canopen.node import NmtState, Node
from haptic_fieldbus.buses.canopen.setup import ENERGISED, Setup
from haptic_fieldbus.buses.canopen.wire import Wire, frame
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError, BusTimeoutError
from haptic_fieldbus.planning.image import HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID, SYNC_COB_ID, placed
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.signals import Signal

SYNC_BITS = 48
"""Bits of the SYNC frame 080h without data, from start of frame to end of frame, with its four stuff bits."""
LOST_HEARTBEATS = 3
"""Heartbeat periods of silence after which a node shows no sign of life."""
REFUSED_WRITES = 3
"""Periods in a row with refused set-points that make an exception; a single one only holds the torque longer."""
STOP_PERIODS = 20
"""Exchanges in which `stop` waits for torque-free statuswords, before it reads them by SDO."""
PARTING_TIMEOUT = 0.03
"""[s]; for each SDO answer after the last exchange. Shorter than the drives' deadline for our heartbeat."""
PARTING_TRIES = 4


class CanopenBus(InSteps):
    """A CANopen master on any python-can bus; with `owned`, `close` also shuts the python-can bus down."""

    def __init__(self, can_bus: can.BusABC, clock: Clock, log: FrameLog | None = None, *, owned: bool = False) -> None:
        self.facts: dict[str, DriveFacts] = {}
        self.warnings: list[str] = []
        self._can_bus = can_bus if owned else None
        self._clock = clock
        self._wire = Wire(can_bus, clock, can_bus.channel_info, log)
        self._sync = frame(SYNC_COB_ID)
        self._plan: Plan | None = None
        self._setups: tuple[Setup, ...] = ()
        self._links: tuple[Link, ...] = ()
        self._exchange = Exchange()
        self._image = bytearray()
        self._outputs: tuple[tuple[int, int, int], ...] = ()
        self._statuswords: tuple[int, ...] = ()
        self._started = False
        self._synced = False
        self.latch_ns = 0
        """Instant at which the drives latched the data of the last exchange [ns]: the nominal end of SYNC."""

    def open(self, plan: Plan) -> None:
        """Inspect all drives, then configure all, then start all.

        Raises BusError or DriveFaultError; the drives that were written to are then left pre-operational.
        """
        try:
            super().open(plan)
        except BaseException:
            if self._plan is not None:  # `configure` had begun; before it nothing was written
                self._leave_operational()
            self._plan = None
            raise

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """Check all drives without writing to them, and fill `facts`.

        `image` is the input image; later exchanges fill in the part of this bus. Raises BusTimeoutError,
        BusConfigurationError or DriveFaultError, TypeError for a bus of another protocol.
        """
        # Frames from before must reach no handler: an old boot-up message would be taken for a restart.
        self._wire.mute()
        self._wire.drain(self._clock.now_ns() + plan.period_ns)
        self._bind(plan, image)
        self.facts = {setup.axis.name: setup.inspect() for setup in self._setups}

    def configure(self, plan: Plan) -> None:
        """Configure all inspected drives; raises BusError."""
        self._plan = plan  # from here on `stop` has something to undo
        for setup in self._setups:
            setup.configure()

    def start(self) -> None:
        """Set all nodes operational, torque-free; raises BusError."""
        self._started = True  # first, since a node may be operational already when a later one fails
        for setup in self._setups:
            setup.start()

    def _bind(self, plan: Plan, image: bytearray) -> None:
        """Prepare nodes, links, frames and offsets, so that the loop looks nothing up."""
        traffic = traffic_of(plan)
        nodes = [Node(self._wire, axis.node, f"node {axis.node} (axis {axis.name})") for axis in plan.axes]
        self._setups = tuple(
            Setup(node, axis, traffic, traffic.member(axis.name)) for node, axis in zip(nodes, plan.axes, strict=True)
        )
        self._image = image
        self._links = tuple(
            Link(setup.node, placed(setup.member.traffic.tpdos, places.inputs[0]), places.header, self._image)
            for setup, places in zip(self._setups, plan.image.axes, strict=True)
        )
        for link in self._links:
            link.listen(self._wire, self._exchange)
        self._outputs = tuple(
            (pdo.cob_id, offset, offset + pdo.size)
            for setup, places in zip(self._setups, plan.image.axes, strict=True)
            for pdo, offset in placed(setup.member.traffic.rpdos, places.outputs[0])
        )
        self._statuswords = statusword_places(plan)
        self._heartbeat = frame(HEARTBEAT_COB_ID + traffic.master_node, bytes((NmtState.OPERATIONAL,)))
        self._heartbeat_limit_ns = LOST_HEARTBEATS * traffic.node_heartbeat_ms * 1_000_000
        self._heartbeat_every = traffic.heartbeat_every
        self._sync_ns = round(SYNC_BITS * 1e9 / traffic.bitrate)
        self._periods_to_heartbeat = 0
        self._refused_writes = 0
        self._started = False

    def prepare(self, deadline_ns: int) -> None:
        """Process all frames since the last exchange, until the deadline [ns] at the latest, and begin a new one."""
        self._exchange.taking = False
        self._wire.drain(deadline_ns)
        self._exchange.missing = sum([link.begin() for link in self._links])

    def begin(self) -> None:
        """Send SYNC; without room in the transmit queue there will be no feedback."""
        self._exchange.taking = True
        self.latch_ns = self._clock.now_ns() + self._sync_ns
        self._synced = self._wire.offer(self._sync)

    def collect(self, deadline_ns: int) -> bytearray:
        """Receive until every TPDO is in or the deadline [ns] is reached, write the headers, return the input image."""
        wire, exchange, latch_ns = self._wire, self._exchange, self.latch_ns
        if self._synced:  # without SYNC no TPDO will come
            while exchange.missing and wire.pump(deadline_ns):
                pass
        exchange.taking = False
        flags = (BUS_OFF if wire.bus_off else 0) | (EXCEPTION if self._refused_writes >= REFUSED_WRITES else 0)
        now_ns = self._clock.now_ns()
        HEADER.pack_into(self._image, 0, latch_ns)
        for link in self._links:
            link.finish(latch_ns, now_ns, self._heartbeat_limit_ns, flags)
        return self._image

    def write(self, image: bytes | bytearray) -> None:
        """Send the RPDOs, then the heartbeat when it is due; raises BusError only when the bus itself is dead."""
        accepted = True
        for cob_id, start, end in self._outputs:
            accepted &= self._wire.offer(frame(cob_id, image[start:end]))
        self._refused_writes = 0 if accepted else self._refused_writes + 1
        if self._periods_to_heartbeat == 0:
            self._periods_to_heartbeat = self._heartbeat_every
            self._wire.offer(self._heartbeat)
        self._periods_to_heartbeat -= 1

    def stop(self) -> bool:
        """Send torque-free set-points, wait until the drives confirm, then set them pre-operational.

        Return True when every drive confirmed, or when none had been started. Raises no BusError.
        The watch of the drives on our heartbeat is switched off only when every started drive confirmed. Otherwise it
        stays on, and disables a drive that could not be reached.
        """
        if self._plan is None:
            return True
        self.release()
        confirmed = not self._started or self._await_release(self._plan)
        self._leave_operational()
        if self._started and confirmed:
            self._release_guards()
        self._plan, self._started = None, False
        if self._wire.refusal is not None:
            self.warnings.append(str(self._wire.refusal))
        return confirmed

    @property
    def restarted(self) -> frozenset[str]:
        """Names of the axes whose node sent a boot-up message since it was configured."""
        return frozenset(setup.axis.name for setup in self._setups if setup.node.booted)

    @property
    def fresh(self) -> bool:
        """True when all feedback of the last exchange arrived and the controller is not bus-off."""
        return not self._wire.bus_off and all(link.fresh for link in self._links)

    def release(self) -> None:
        """Send torque-free set-points now, once the nodes may be operational; raises no BusError.

        Controlword *disable voltage* and target torque 0 both consist of zero octets.
        """
        if not self._started:
            return
        for cob_id, start, end in self._outputs:
            try:
                self._wire.send(frame(cob_id, bytes(end - start)))
            except BusError as error:
                self.warnings.append(f"torque-free set-point {cob_id:03X}h was not sent: {error}")

    def _await_release(self, plan: Plan) -> bool:
        """Exchange torque-free images until fresh statuswords show no energised motor; False when that fails."""
        torque_free = bytes(plan.image.output_size)
        deadline_ns = self._clock.now_ns()
        try:
            for _ in range(STOP_PERIODS):
                image = self.read(deadline_ns + plan.period_ns)
                if all(link.fresh for link in self._links) and not any(map(_energised, self._words(image))):
                    return True
                self.write(torque_free)
                deadline_ns += plan.period_ns
                self._clock.sleep_until(deadline_ns)
            # PDOs alone confirmed nothing: a node that left operational sends none, but still answers SDO requests.
            return not any(self._ask_energised(setup) for setup in self._setups)
        except BusError as error:
            self.warnings.append(f"no confirmation that torque is off: {error}")
            return False

    def _ask_energised(self, setup: Setup) -> bool:
        """Read by SDO whether the motor is energised; try several times, since a restarting drive answers late."""
        for _ in range(PARTING_TRIES - 1):
            try:
                return setup.energised(PARTING_TIMEOUT)
            except BusTimeoutError:
                continue
        return setup.energised(PARTING_TIMEOUT)

    def _words(self, image: bytearray) -> list[int]:
        return [image[offset] | image[offset + 1] << 8 for offset in self._statuswords]

    def _leave_operational(self) -> None:
        for setup in self._setups:
            try:
                setup.node.command(NmtState.PRE_OPERATIONAL)
            except BusError as error:
                self.warnings.append(f"{setup.node.label} was not told to go pre-operational: {error}")

    def _release_guards(self) -> None:
        for setup in self._setups:
            try:
                # The SDO transfers take time, in which the drives that still watch must not miss our heartbeat.
                self._wire.offer(self._heartbeat)
                setup.release_guard(PARTING_TIMEOUT)
            except BusError as error:
                self.warnings.append(f"left with its heartbeat guard on, so it may report an error: {error}")

    def close(self) -> None:
        """Stop unless already stopped, and shut down the python-can bus if it is owned; raises no BusError."""
        self.stop()
        self._plan = None
        if self._can_bus is not None:
            self._can_bus.shutdown()
            self._can_bus = None


def traffic_of(plan: Plan) -> CanTraffic:
    """Return the traffic of the only bus in this part of a plan; raises TypeError for a bus of another protocol."""
    (bus,) = plan.buses
    if not isinstance(bus.traffic, CanTraffic):
        raise TypeError(f"bus {bus.name} is one of {bus.protocol}")
    return bus.traffic


def statusword_places(plan: Plan) -> tuple[int, ...]:
    """Return the offset of each axis' statusword in the input image, in the order of the axes."""
    places = []
    for axis, image in zip(plan.axes, plan.image.axes, strict=True):
        offset = image.inputs[0]
        for mapped in axis.traffic.incoming:
            if mapped.signal is Signal.STATUSWORD:
                places.append(offset)
            offset += mapped.type.size
    return tuple(places)


def _energised(statusword: int) -> bool:
    return CIA402.state(statusword) in ENERGISED
