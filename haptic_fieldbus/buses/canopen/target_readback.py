"""The target torque of a drive, asked by SDO beside the exchange, and never waited for.

A drive that can map nothing into a TPDO which shows its target torque still lets 6071h be uploaded. One period sends
the request after its set-point; the response is taken whenever it comes, and lies in the input image of that period,
with the number of periods since the request: the drive answered some time between the two.

One request is on its way at a time. One that is not answered in time is sent again. Responses carry no number, so the
answer after that may belong to either request: it counts from the first of the two, and nothing is asked until the
other can come no more. A refusal is told once and counts as no answer; the cycle gives up when answers stay away.

Reference: CiA 301 7.2.4.3.5, 7.2.4.3.6 (SDO upload).
"""

from struct import pack_into

from haptic_fieldbus.buses.canopen.node import ABORTED, EXPEDITED, UPLOAD_DONE, address, request
from haptic_fieldbus.buses.canopen.setup import NodeSetup
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.protocols.canopen.bus import SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID
from haptic_fieldbus.protocols.canopen.watch_traffic import ASK_EVERY
from haptic_fieldbus.protocols.traffic import answer_time

LATEST = 2
"""Times the patience with an answer, after which it comes no more."""
LARGEST_PERIODS = 0xFFFF


class TargetReadback:
    """The questions to one drive; the answer lies behind the TPDOs in the image, then the periods that it took."""

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
        if now_ns - self._asked_ns < self._wait_ns():
            return
        self._repeated = self._asked is not None
        if self._asked is None:
            self._asked = self._writes
        self._asked_ns = now_ns
        self._wire.offer(*self._question)

    def _wait_ns(self) -> int:
        """Return how long after the last question the next one may be sent [ns]."""
        if self._asked is not None:
            return self._patience_ns
        return LATEST * self._patience_ns if self._repeated else self._every_ns

    def _answered(self, data: bytes | bytearray) -> None:
        if self._asked is None or len(data) != 8 or data[1:4] != self._address:
            self._node.on_response(data)
            return
        asked, self._asked = self._asked, None
        if data[0] >> 5 == UPLOAD_DONE and data[0] & EXPEDITED:
            end = self._offset + self._entry.type.size
            self._image[self._offset : end] = data[4 : 4 + self._entry.type.size]
            pack_into("<H", self._image, end, min(self._writes - asked + 1, LARGEST_PERIODS))
        elif not self._refused:
            self._refused = True
            code = int.from_bytes(data[4:8], "little") if data[0] >> 5 == ABORTED else 0
            self._warn(f"{self._node.label} refused to read {self._entry} (abort {code:08X}h)")
