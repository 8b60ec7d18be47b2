"""The way to zero torque on one CAN bus: one design for a trip, an ordinary end and an exception.

1. `begin` sends, to every drive and without waiting for anything, the torque-free set-point with controlword 0 (RPDO)
   and the controlword 0 once more as an expedited SDO download of 6040h. Each acts where the other does not: an RPDO
   only in a node that is operational and has it enabled, the download in a pre-operational node too.
2. `look` asks for a statusword, by SYNC and TPDO or by an SDO upload of 6041h, and listens for one slice of time. A
   drive that is still silent after the first looks is told to go pre-operational, since a node that somebody stopped
   takes no SDO requests, and the download is repeated.
3. A drive that says that its motor is off has its guard disarmed (1016h or 100Dh = 0), so that no fault remains when we
   leave, and gets back its own torque limits. All of these are read back.

From `begin` on no proof of our life is sent, neither heartbeat nor request of node guarding. The guard of a drive that
confirms nothing therefore takes its torque away by itself, within the guard time counted from the last one, and the
looks end only after that time.

A slice and all other times here are those of the bus, not of the loop: the way to zero does not grow with the period.

Reference: CiA 301 7.2.4.3 (SDO protocols), 7.2.8.3 (NMT); IEC 61800-7-201 (CiA 402-2), 6040h, 6041h.
"""

from collections.abc import Callable, Sequence
from functools import partial

from haptic_fieldbus.buses.canopen.link import Link, OutgoingPdo
from haptic_fieldbus.buses.canopen.node import ABORTED, DOWNLOAD_DONE, NmtState, address, request, uploaded_value
from haptic_fieldbus.buses.canopen.setup import CONTROLWORD, STATUSWORD, NodeSetup
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.release import BusRelease, DriveRelease
from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.drive.power import ENERGISED
from haptic_fieldbus.protocols.canopen.bus import SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.protocols.cia402 import CIA402, DISABLE_VOLTAGE

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


class NodeRelease(DriveRelease[Command]):
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


class Release(BusRelease[NodeRelease]):
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
