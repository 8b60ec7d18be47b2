"""The CANopen master: SYNC out, TPDOs in, RPDOs out, a proof of life when it is due, all in the thread of the loop.

One period is `read` and `write`:

- `read` first processes the frames since the last exchange: heartbeats, emergencies, and late TPDOs, which are dropped.
  Then it sends SYNC and receives until every TPDO is in or the deadline is reached. Faults become flags in the header
  of the image; the cycle decides about them.
- `write` sends the RPDOs and, every few periods, the proofs of our life that the guards of the drives expect: our
  heartbeat, and a request of node guarding to each drive under life guarding. Who does not write proves nothing.
  Where a period has no room behind the RPDOs, they follow the next SYNC, and take the bus while the host computes.
  Last come the questions to drives that show their target torque only when they are asked, see `TargetReadback`.

`stop` consists of `release`, `settle` and `leave`; `canopen.release` tells how. With several buses, `group` calls the
parts of `open`, `read` and `stop` one by one, each on all buses.

Reference: CiA 301 7.2.2 (PDO), 7.2.5 (SYNC), 7.2.8 (NMT).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from struct import pack_into

import can

from haptic_fieldbus.buses import release
from haptic_fieldbus.buses.bus import offsets_of, traffic_of
from haptic_fieldbus.buses.canopen.frames import FrameLog
from haptic_fieldbus.buses.canopen.guard import Guard, ProofsOfLife
from haptic_fieldbus.buses.canopen.link import BUS_OFF, EXCEPTION, Exchange, Link, OutgoingPdo
from haptic_fieldbus.buses.canopen.node import (
    ABORTED,
    DOWNLOAD_DONE,
    REPEATED,
    NmtState,
    Node,
    address,
    request,
    uploaded_value,
)
from haptic_fieldbus.buses.canopen.other_master import ForeignLoad, ForeignMaster, OneMaster, listen
from haptic_fieldbus.buses.canopen.setup import CONTROLWORD, ERROR_CODE, STATUSWORD, TORQUE_LIMITS, NodeSetup
from haptic_fieldbus.buses.canopen.wire import MOST_WAITING, CanPort, Received, Wire
from haptic_fieldbus.buses.torque_limits import TorqueLimits
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.profile import ENERGISED, ObjectEntry
from haptic_fieldbus.drive.rig import SHARES_OF_RATED
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.canopen.pdo import SYNC_COB_ID, placed
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.protocols.canopen.watch_traffic import ASK_EVERY
from haptic_fieldbus.protocols.cia402 import CIA402, DISABLE_VOLTAGE
from haptic_fieldbus.protocols.traffic import answer_time
from haptic_fieldbus.signals import LinkFlag, Signal

# The way to zero torque on one CAN bus: one design for a trip, an ordinary end and an exception.
#
# 1. `begin` sends, to every drive and without waiting for anything, the torque-free set-point with controlword 0 (RPDO)
#    and the controlword 0 once more as an expedited SDO download of 6040h. Each acts where the other does not: an RPDO
#    only in a node that is operational and has it enabled, the download in a pre-operational node too.
# 2. `look` asks for a statusword, by SYNC and TPDO or by an SDO upload of 6041h, and listens for one slice of time. A
#    drive that is still silent after the first looks is told to go pre-operational, since a node that somebody stopped
#    takes no SDO requests, and the download is repeated.
# 3. A drive that says that its motor is off has its guard disarmed (1016h or 100Dh = 0), so that no fault remains when
#    we leave, and gets back its own torque limits. All of these are read back.
#
# From `begin` on no proof of our life is sent, neither heartbeat nor request of node guarding. The guard of a drive
# that confirms nothing therefore takes its torque away by itself, within the guard time counted from the last one, and
# the looks end only after that time.
#
# A slice and all other times here are those of the bus, not of the loop: the way to zero does not grow with the period.
#
# Reference: CiA 301 7.2.4.3 (SDO protocols), 7.2.8.3 (NMT); IEC 61800-7-201 (CiA 402-2), 6040h, 6041h.


SLICE = 0.002
"""[s] of one look; longer where SYNC and TPDOs take more than half of it."""
LOOKS_BEFORE_NMT = 2
"""Looks after which a drive that did not confirm is told to go pre-operational."""
PATIENCE_NS = 15_000_000
"""Time that a drive has for an SDO answer, before the next request is sent [ns]."""
GRACE = 0.03
"""Time from the end of the longest guard to the last look, for SDO answers about what the guard did [s]."""

Command = tuple[ObjectEntry, int | None]
"""An entry and the value to download to it; None: upload it."""
DISABLE: Command = (CONTROLWORD, DISABLE_VOLTAGE)
ASK: Command = (STATUSWORD, None)


class NodeRelease(release.DriveRelease[Command]):
    """One drive on its way to zero torque; a step sends at most one SDO request, and waits for nothing."""

    def __init__(self, setup: NodeSetup, wire: Wire, link: Link, image: bytearray, place: int) -> None:
        """Take the input image, and the place in it of the statusword received last."""
        super().__init__(setup.node.label, setup)
        self.node, self.link = setup.node, link
        self._wire, self._image, self._place = wire, image, place
        self._written = b""
        """Octets that the next entry must hold when it is read back."""
        self._sent: Command | None = None
        self._waiting_until_ns = 0

    def begin(self) -> None:
        """Forget an earlier release and what the drive said before, and take its SDO answers from now on."""
        super().begin()
        self.link.forget_answers()
        self._sent, self._waiting_until_ns = None, 0
        self._wire.listen(SDO_RESPONSE_COB_ID + self.node.id, self._answered)

    def step(self, now_ns: int) -> None:
        """Take over a fresh statusword; send the next request when none is waited for. Raises BusError."""
        if not self.free and self.link.fresh:
            self._judge(self._image[self._place] | self._image[self._place + 1] << 8)
        if not self.settled and now_ns >= self._waiting_until_ns:
            command = self._undoing[0] if self.free else ASK if self._sent == DISABLE else DISABLE
            self._sent, self._waiting_until_ns = command, now_ns + PATIENCE_NS
            self._wire.send(SDO_REQUEST_COB_ID + self.node.id, request(*command))

    def to_pre_operational(self) -> None:
        """Set the node pre-operational, where it serves SDO requests whatever was done to it; raises BusError."""
        self._sent, self._waiting_until_ns = None, 0  # a stopped node has lost the request
        self.node.command(NmtState.PRE_OPERATIONAL)

    def _answered(self, data: bytes | bytearray) -> None:
        """Take an SDO response; one to an earlier request, which names another entry, is passed over.

        A response without a value tells nothing about the motor: its guard may have to act.
        """
        if self._sent is None or len(data) != 8 or bytes(data[1:4]) != address(self._sent[0]):
            return
        specifier, command, value = data[0] >> 5, self._sent, uploaded_value(data)
        self._waiting_until_ns = 0
        if command == ASK and value is not None:
            self._judge(value[0] | value[1] << 8)
        elif command in self._undoing and specifier == DOWNLOAD_DONE:
            self._written = request(*command)[4:8]
            self._undoing[self._undoing.index(command)] = (command[0], None)  # to be read back
        elif command in self._undoing:
            self._undoing.remove(command)
            if specifier == ABORTED:
                self.refused.append(f"{command[0]} (it refused: {int.from_bytes(data[4:8], 'little'):08X}h)")
            elif value is None or value[: command[0].type.size] != self._written[: command[0].type.size]:
                self.refused.append(str(command[0]))

    def _judge(self, statusword: int) -> None:
        self.free = CIA402.state(statusword) not in ENERGISED


class Release(release.BusRelease[NodeRelease]):
    """The release of all drives of one CAN bus."""

    hint = "; with its watchdog armed it may report an error"

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[NodeRelease],
        outputs: Sequence[OutgoingPdo],
        sync: Callable[[int], None],
        traffic: CanTraffic,
    ) -> None:
        """Take the RPDOs, and a function that begins an exchange."""
        super().__init__(wire.clock, drives)
        self._wire = wire
        self._outputs = tuple(outputs)
        self._sync = sync
        self._slice_ns = round(max(SLICE, 2.0 * traffic.feedback_time) * 1e9)
        self._longest_ns = round((max(traffic.guard(member.axis) for member in traffic.members) + GRACE) * 1e9)
        self._looks = 0

    def begin(self) -> None:
        """Send everything that frees the drives and needs no answer."""
        now_ns = self._clock.now_ns()
        self._end_ns, self._looks, self._begun = now_ns + self._longest_ns, 0, True
        for drive in self._drives:
            drive.begin()
        self._send_set_points()
        self._step(now_ns)

    def _go_on(self) -> None:
        deadline_ns = self._clock.now_ns() + self._slice_ns
        if self._looks:
            self._send_set_points()
        if self._looks == LOOKS_BEFORE_NMT:
            for drive in self._drives:
                if not drive.free:
                    self._to_pre_operational(drive)
        self._looks += 1
        if not self._try("no answer from the drives", partial(self._listen, deadline_ns)):
            self._clock.sleep_until(deadline_ns)  # a bus that is gone waits for nothing by itself

    def leave(self) -> bool:
        """Set the nodes pre-operational; True when every drive reported its motor off, or nothing was begun."""
        for drive in self._drives:
            self._to_pre_operational(drive)
        return super().leave()

    def _send_set_points(self) -> None:
        """Send target torque 0 and controlword *disable voltage*."""
        for output in self._outputs:
            failure = f"set-point of zero torque {output.cob_id:03X}h was not sent"
            self._try(failure, partial(self._wire.send, output.cob_id, bytes(output.torque_free)))

    def _listen(self, deadline_ns: int) -> None:
        self._try("SYNC to the drives was not sent", partial(self._sync, deadline_ns))
        while not self._settled and self._clock.now_ns() < deadline_ns:
            self._step(self._clock.now_ns())
            self._wire.pump(deadline_ns)

    def _step(self, now_ns: int) -> None:
        for drive in self._drives:
            self._try(f"6040h = 0 by SDO was not sent to {drive.label}", partial(drive.step, now_ns))

    def _to_pre_operational(self, drive: NodeRelease) -> None:
        self._try(f"pre-operational was not sent to {drive.label}", drive.to_pre_operational)

    def _try(self, failure: str, action: Callable[[], object]) -> bool:
        """Do one thing whose failure must not stop the rest; False, and a warning, when it failed."""
        try:
            action()
        except Exception as error:  # of the bus, of a driver, of the log of the frames
            self._warn(f"{failure}: {error}")
            return False
        return True


LATEST = 2
"""Times the patience with an answer, after which it comes no more."""
LARGEST_PERIODS = 0xFFFF


class TargetReadback:
    """The target torque of a drive, asked by SDO beside the exchange, and never waited for.

    A drive that can map nothing into a TPDO which shows its target torque still lets 6071h be uploaded. One period
    sends the request after its set-point; the response is taken whenever it comes, and lies behind the TPDOs in the
    image of that period, with the number of periods since the request: the drive answered some time between the two.

    One request is on its way at a time. One that is not answered in time is sent again. Responses carry no number, so
    the answer after that may belong to either request: it counts from the first of the two, and nothing is asked until
    the other can come no more. A refusal is told once and counts as no answer; the cycle gives up when answers stay
    away.

    Reference: CiA 301 7.2.4.3.5, 7.2.4.3.6 (SDO upload).
    """

    def __init__(self, setup: NodeSetup, wire: Wire, image: bytearray, start: int, period: float) -> None:
        """Take the image and the place in it at which the TPDOs of the drive begin, and the period of the loop [s]."""
        self._node, self._wire, self._warn = setup.node, wire, setup.warn
        self._entry = entry = setup.member.profile.torque.target.entry
        # What is asked follows the TPDOs.
        self._image, self._offset = image, start + sum(pdo.image_size for pdo in setup.member.traffic.tpdos)
        self._now_ns = wire.clock.now_ns
        self._question = SDO_REQUEST_COB_ID + setup.node.id, request(entry, None)
        self._address = address(entry)
        self._patience_ns, self._every_ns = round(answer_time(period) * 1e9), round(ASK_EVERY * 1e9)
        self._writes = 0
        self._asked: int | None = None
        """Number of the write after which the oldest unanswered question was sent; None: none is unanswered."""
        self._asked_ns = -self._patience_ns
        self._repeated = self._refused = False

    def listen(self) -> None:
        """Take the answers from now on; other SDO responses still go to the node."""
        self._wire.listen(SDO_RESPONSE_COB_ID + self._node.id, self._answered)

    def begin(self) -> None:
        """Begin a period: there is no answer yet."""
        pack_into("<H", self._image, self._offset + self._entry.type.size, 0)

    def ask(self) -> None:
        """Ask, after the set-point of a period, unless an answer may still come; raises BusError."""
        self._writes += 1
        now_ns = self._now_ns()
        wait_ns = LATEST * self._patience_ns if self._repeated else self._every_ns
        if now_ns - self._asked_ns < (wait_ns if self._asked is None else self._patience_ns):
            return
        self._repeated = self._asked is not None
        if self._asked is None:
            self._asked = self._writes
        self._asked_ns = now_ns
        self._wire.offer(*self._question)

    def _answered(self, data: bytes | bytearray) -> None:
        if self._asked is None or len(data) != 8 or data[1:4] != self._address:
            self._node.on_response(data)
            return
        asked, self._asked = self._asked, None
        value = uploaded_value(data)
        if value is not None:
            end = self._offset + self._entry.type.size
            self._image[self._offset : end] = value[: self._entry.type.size]
            pack_into("<H", self._image, end, min(self._writes - asked + 1, LARGEST_PERIODS))
        elif not self._refused:
            self._refused = True
            code = int.from_bytes(data[4:8], "little") if data[0] >> 5 == ABORTED else 0
            self._warn(f"{self._node.label} refused to read {self._entry} (abort {code:08X}h)")


# Clearing of the fault into which a drive goes when it has lost its master (`buses.release`).
#
# Reference: CiA 301 7.2.7.1 (8130h, life guard or heartbeat error); IEC 61800-7-201 (CiA 402-2), 603Fh.

LOST_MASTER = 0x8130
ANSWER_TIMEOUT = 0.01
"""[s]; so long an answer is waited for in the middle of an exchange."""


def acknowledge(node: Node) -> None:
    """Clear the fault of a drive that lost its master; raises DriveFaultError for another fault, or BusError."""
    node.take_answers()
    if node.emergency == LOST_MASTER:
        node.emergency = 0
    if not _faulted(node):
        return
    try:
        code = node.read(ERROR_CODE)
    except BusConfigurationError:
        code = node.emergency or release.NO_CODE
    if code not in (LOST_MASTER, release.NO_CODE):
        raise release.other_fault(node.label, f"{code:04X}h ({emergency_meaning(code)})")
    for controlword in (DISABLE_VOLTAGE, release.FAULT_RESET, DISABLE_VOLTAGE):
        node.send(CONTROLWORD, controlword)
    release.check_cleared(node, lambda: not _faulted(node), " (6040h = 80h)")


def _faulted(node: Node) -> bool:
    return CIA402.state(node.read(STATUSWORD)) in release.FAULTS


SYNC_BITS = 48
"""Bits of the SYNC frame 080h without data, from start of frame to end of frame, with its four stuff bits."""
REFUSED_WRITES = 3
"""Periods in a row with refused set-points that make an exception; a single one only holds the torque longer."""


class CanopenBus(release.ReleasedBus[Release]):
    """A CANopen master on any python-can bus; with `owned`, `close` also shuts the python-can bus down.

    `port` is a way to the bus that is shorter than python-can's messages; None: there is none.
    """

    def __init__(
        self,
        can_bus: can.BusABC,
        clock: Clock,
        log: FrameLog | None = None,
        *,
        owned: bool = False,
        port: CanPort | None = None,
    ) -> None:
        super().__init__()
        self._can_bus = can_bus if owned else None
        self._clock = clock
        self._wire = Wire(can_bus, clock, can_bus.channel_info, log, port=port)
        self._setups: tuple[NodeSetup, ...] = ()
        self._links: list[Link] = []
        self._exchange = Exchange()
        self._image = bytearray()
        self._outputs: list[OutgoingPdo] = []
        self._askings: list[TargetReadback] = []
        self._synced = False
        self._held_proofs: tuple[Received, ...] = ()
        """Proofs of our life that wait for the next SYNC."""
        self.latch_ns = 0
        """Instant at which the drives latched the data of the last exchange [ns]: the nominal end of SYNC."""

    def inspect(self, plan: Plan, image: bytearray) -> None:
        """Listen for another master, then check all drives without writing to them, and fill `facts`.

        Exchanges fill the part of this bus in the input `image`. Raises ForeignMasterError before anything was sent,
        BusTimeoutError, BusConfigurationError or DriveFaultError, TypeError for a bus of another protocol.
        """
        # Frames from before must reach no handler: an old boot-up message would be taken for a restart.
        self._wire.mute()
        self._wire.unfocus()
        self._wire.drain(self._clock.now_ns() + plan.period_ns)
        traffic = traffic_of(plan, CanTraffic)
        guarded = [member.traffic.node for member in traffic.members if member.traffic.life_guarding]
        one = OneMaster([axis.node for axis in plan.axes], traffic.master_node, guarded)
        heard = listen(self._wire, traffic.listening, one, self._wire.name)
        heard.refuse(traffic.master_node)
        self._load = ForeignLoad(self._wire, heard, [axis.node for axis in plan.axes], traffic.bitrate)
        self._bind(plan, image)
        self._foreign = ForeignMaster(self._wire, one, self.warnings.append)
        self.facts = {each.axis.name: replace(each.inspect(), listened=heard.sentence()) for each in self._setups}

    def configure(self, plan: Plan) -> None:
        """Configure all inspected drives; raises BusError, ForeignMasterError on commands of another master."""
        # A person may have thought about the question for long: what came meanwhile is heard first.
        self._wire.drain(self._clock.now_ns() + plan.period_ns)
        self._foreign.refuse(self._wire.name, "Nothing was written")
        self._plan = plan  # from here on `stop` has something to undo
        self._exchange.begun, self._refused_writes = False, 0
        nodes = [setup.node for setup in self._setups]
        self._proofs = ProofsOfLife(traffic_of(plan, CanTraffic), nodes, plan.period_ns)
        for setup, link in zip(self._setups, self._links, strict=True):
            link.forget()
            setup.configure()
        for output in self._outputs:
            output.hold()

    def start(self) -> None:
        """Set all nodes operational, torque-free; raises BusError, ForeignMasterError as `configure` does."""
        self._foreign.refuse(self._wire.name, "Nothing was enabled")
        for setup in self._setups:
            setup.start()
        if self._plan is not None and not self._plan.simulated:
            for setup in self._setups:
                setup.check_answers(self._plan.period_ns)
        for asking in self._askings:
            asking.listen()
        self._wire.focus(1 + len(self._outputs) + 2 * len(self._setups))
        self._load.begin()

    def _bind(self, plan: Plan, image: bytearray) -> None:
        """Prepare nodes, links, frames and offsets, so that the loop looks nothing up."""
        traffic, self._image, self._exchange = traffic_of(plan, CanTraffic), image, Exchange()
        self._setups = tuple(self._setup_of(axis, traffic, plan) for axis in plan.axes)
        self._links, self._outputs, self._askings, drives = [], [], [], list[NodeRelease]()
        for setup, places in zip(self._setups, plan.image.axes, strict=True):
            own, start, silence = setup.member.traffic, places.inputs[0], traffic.silence_of(setup.axis.name)
            link = Link(setup.node, placed(own.tpdos, start), places.header, image, silence, plan.period)
            link.listen(self._wire, self._exchange)
            self._links.append(link)
            self._outputs += [OutgoingPdo(setup.node, *each) for each in placed(own.rpdos, places.outputs[0])]
            # The way to zero is prepared too, so that nothing can fail or take time when it is needed.
            statusword = offsets_of(setup.axis.traffic.incoming, start)[Signal.STATUSWORD]
            drives.append(NodeRelease(setup, self._wire, link, image, statusword))
            if own.asked:
                self._askings.append(TargetReadback(setup, self._wire, image, start, plan.period))
        self._release = Release(self._wire, drives, self._outputs, self._sync_once, traffic)
        self._proves_while_computing = traffic.proves_while_computing
        self._sync_ns = round(SYNC_BITS * 1e9 / traffic.bitrate)

    def _setup_of(self, axis: AxisPlan, traffic: CanTraffic, plan: Plan) -> NodeSetup:
        member = traffic.member(axis.name)
        node = Node(self._wire, axis.node, f"node {axis.node} (axis {axis.name})", guarded=member.traffic.life_guarding)
        # Where the target is a share of a rated value, the limits of the drive are shares of the same.
        shares = axis.profile.offers()[Signal.TARGET_TORQUE].unit in SHARES_OF_RATED
        permille, real = axis.effort_unit if shares else 1e-3 * axis.rated_effort, not plan.simulated
        limits = TorqueLimits(node, axis, self.warnings.append, real, TORQUE_LIMITS, permille, plan.place(axis))
        section, guard_ms = member.profile.link_loss, round(traffic.guard(axis.name) * 1e3)
        guard = Guard(node, section, guard_ms, traffic.master_node, traffic.node_heartbeat_ms)
        return NodeSetup(node, axis, traffic, member, guard, limits, self.warnings.append)

    def _sync_once(self, deadline_ns: int) -> None:
        self.prepare(deadline_ns)
        self.begin()

    def read(self, deadline_ns: int) -> bytearray:
        """Exchange feedback once and return the input image; raises BusError only when the bus itself is dead.

        As the parts of `InSteps.read`, with one look at the clock before SYNC: each is a system call in some kernels.
        """
        now_ns = self._prepared_at(deadline_ns)
        self._sync_at(now_ns)
        if self._synced and self._exchange.missing:
            self._wire.pump_for(max(0, deadline_ns - now_ns) * 1e-9)
        return self.collect(deadline_ns)

    def prepare(self, deadline_ns: int) -> None:
        """Process all frames since the last exchange, until the deadline [ns] at the latest, and begin a new one."""
        self._prepared_at(deadline_ns)

    def _prepared_at(self, deadline_ns: int) -> int:
        """Prepare an exchange, and return the time [ns]."""
        self._exchange.taking = False
        for asking in self._askings:
            asking.begin()
        now_ns = self._wire.drain(deadline_ns)
        if not self._exchange.begun:
            # From now on nodes are missed: the loop looks regularly, and asks those that answer only then.
            self._exchange.begun = True
            for setup in self._setups:
                setup.node.heartbeat_ns = now_ns
        self._exchange.missing = sum([link.begin() for link in self._links])
        return now_ns

    def begin(self) -> None:
        """Send SYNC; without room in the transmit queue there will be no feedback."""
        self._sync_at(self._clock.now_ns())

    def _sync_at(self, now_ns: int) -> None:
        self._exchange.taking = True
        self.latch_ns = self._exchange.latch_ns = now_ns + self._sync_ns
        self._synced = self._wire.offer(SYNC_COB_ID)
        for proof in self._held_proofs:
            self._wire.offer(*proof)
        self._held_proofs = ()

    def collect(self, deadline_ns: int) -> bytearray:
        """Receive until every TPDO is in or the deadline [ns] is reached, write the headers, return the input image."""
        wire, exchange, latch_ns = self._wire, self._exchange, self.latch_ns
        if self._synced:  # without SYNC no TPDO will come
            # What waits is taken without a look at the clock, but a flood of other frames ends with the deadline.
            others = 0
            while (missing := exchange.missing) and (wire.pump_for(0.0) or wire.pump(deadline_ns)):
                others += exchange.missing == missing
                if others > MOST_WAITING and self._clock.now_ns() >= deadline_ns:
                    break
        exchange.taking = False
        flags = BUS_OFF * wire.error_frames.bus_off | EXCEPTION * (self._refused_writes >= REFUSED_WRITES)
        now_ns = self._clock.now_ns()
        HEADER.pack_into(self._image, 0, latch_ns)
        for link in self._links:
            link.finish(latch_ns, now_ns, flags)
        if self._foreign.cob_id is not None or exchange.doubled is not None:
            for link in self._links:
                link.accuse(self._foreign.code, exchange.doubled)
        return self._image

    def write(self, image: bytes | bytearray) -> None:
        """Send the RPDOs, then the proofs of our life that are due; raises BusError only when the bus is dead."""
        accepted = True
        for output in self._outputs:
            accepted &= self._wire.offer(output.cob_id, output.payload(image))
        self._refused_writes = 0 if accepted else self._refused_writes + 1
        due = self._proofs.due(self.latch_ns)
        if self._proves_while_computing:
            self._held_proofs = due
        else:
            for proof in due:
                self._wire.offer(*proof)
        for asking in self._askings:
            asking.ask()

    def ask(self, axis: str) -> int | None:
        """Upload the statusword of an axis; None without an answer in some milliseconds.

        A node without an answer is told to go pre-operational: a stopped one, as a lost master may make it (1029h),
        serves no SDO requests. Raises BusError only when the bus itself is dead.
        """
        node = next(setup.node for setup in self._setups if setup.axis.name == axis)
        try:
            return node.read(STATUSWORD, ANSWER_TIMEOUT)
        except BusTimeoutError:
            node.command(NmtState.PRE_OPERATIONAL)
        except BusConfigurationError:
            pass  # refused, or garbled: no answer either
        return None

    def acknowledge(self) -> None:
        """Clear the faults of stopped drives that lost their master; raises DriveFaultError or BusError."""
        for setup in self._setups:
            acknowledge(setup.node)

    def release(self) -> None:
        """Free the drives by every way that needs no answer, once something was written; raises nothing."""
        self._held_proofs = ()
        if self._plan is not None and self._release is not None:
            self._release.begin()

    def _observed(self) -> Iterator[str]:
        yield from (REPEATED.format(setup.node) for setup in self._setups if setup.node.repeated)
        yield from self._wire.sentences

    @property
    def causes(self) -> dict[str, tuple[LinkFlag, int]]:
        """By axis, the event that explains other faults of the link, with its code."""
        off = (LinkFlag.BUS_OFF, 0) if self._wire.error_frames.bus_off else None
        found = {setup.axis.name: off or setup.node.cause for setup in self._setups}
        return {axis: cause for axis, cause in found.items() if cause is not None}

    @property
    def foreign_load(self) -> dict[str, float]:
        return dict.fromkeys([setup.axis.name for setup in self._setups], self._load.share)

    def close(self) -> None:
        """Stop unless already stopped, and shut down the python-can bus if it is owned; raises no BusError."""
        self.stop()
        if self._can_bus is not None:
            self._can_bus.shutdown()
            self._can_bus = None
