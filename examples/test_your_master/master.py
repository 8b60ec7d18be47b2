"""A small master for one servo drive (CiA 402, cyclic synchronous torque), written with canopen alone.

    network = canopen.Network()
    network.connect(interface="socketcan", channel="can0")
    with Master(network, node_id=5) as master:
        master.enable()
        master.torque = 0.05   # N·m
        ...
        master.stop()

Every 10 ms the master sends a SYNC. The drive sends its statusword and position. The master then sends the controlword
and the target torque.
"""

import struct
import time
from types import TracebackType

import canopen
from canopen.emcy import EmcyError

MASTER_ID = 0x7F
SYNC_PERIOD = 0.01  # s
HEARTBEAT_PERIOD = 0.02  # s
HEARTBEAT_LIMIT = 250  # ms; the drive switches itself off after this time without a heartbeat
SILENCE = 0.25  # s; the drive counts as silent after this time without an answer
PATIENCE = 2.0  # s; longest time of a change of state

NOT_VALID = 1 << 31
DISABLE_VOLTAGE, FAULT_RESET = 0x00, 0x80
TORQUE_MODE = 10

STATES = {
    0x40: "switch on disabled",
    0x21: "ready to switch on",
    0x23: "switched on",
    0x27: "operation enabled",
    0x07: "quick stop active",
    0x0F: "fault reaction active",
    0x08: "fault",
}
WAY = (
    (0x06, "ready to switch on"),
    (0x07, "switched on"),
    (0x0F, "operation enabled"),
)


class MasterError(Exception):
    """The drive did not follow a command."""


class Master:
    """Control one drive. The drive is stopped at the end of the `with` block."""

    def __init__(self, network: canopen.Network, node_id: int) -> None:
        self.network = network
        self.node_id = node_id
        self.node = network.add_node(node_id, canopen.ObjectDictionary())
        self.position = 0  # encoder counts
        self.errors: list[int] = []  # codes of the emergency messages
        self._statusword = 0
        self._heard = 0.0
        self._controlword = DISABLE_VOLTAGE
        self._target = 0  # ‰ of rated torque

    def __enter__(self) -> "Master":
        self.node.emcy.add_callback(self._on_emergency)
        self.network.subscribe(0x180 + self.node_id, self._on_status)
        self._heartbeat = self.network.send_periodic(0x700 + MASTER_ID, b"\x05", HEARTBEAT_PERIOD)
        self._configure()
        self.node.nmt.state = "OPERATIONAL"
        self.network.sync.start(SYNC_PERIOD)
        self._wait_for("switch on disabled")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._target, self._controlword = 0, DISABLE_VOLTAGE
        time.sleep(2 * SYNC_PERIOD)
        self.network.sync.stop()
        self._heartbeat.stop()

    @property
    def state(self) -> str:
        """The state of the drive; "silent" if it does not answer."""
        if time.monotonic() - self._heard > SILENCE:
            return "silent"
        word = self._statusword
        return STATES.get(word & 0x6F) or STATES.get(word & 0x4F, "not ready to switch on")

    def enable(self) -> None:
        """Bring the drive to *operation enabled* with zero torque."""
        self._target = 0
        for controlword, state in WAY:
            self._controlword = controlword
            self._wait_for(state)

    @property
    def torque(self) -> float:
        """The target torque of the drive [N·m]."""
        return self._target * self._rated_torque / 1000

    @torque.setter
    def torque(self, torque: float) -> None:
        self._target = round(1000 * torque / self._rated_torque)

    def stop(self) -> None:
        """Switch the torque off; the shaft is free then."""
        self._target, self._controlword = 0, DISABLE_VOLTAGE
        self._wait_for("switch on disabled")

    def reset(self) -> None:
        """Acknowledge a fault. This does not enable the drive."""
        self._controlword = FAULT_RESET
        self._wait_for("switch on disabled")
        self._controlword = DISABLE_VOLTAGE

    def _configure(self) -> None:
        self._write("<I", MASTER_ID << 16 | HEARTBEAT_LIMIT, 0x1016, 1)
        self._write("<h", 2, 0x6007)  # reaction to a lost master: disable voltage
        self._map(0x1800, 0x4000_0180, 1, [0x6041_0010, 0x6064_0020])  # statusword, position; at every SYNC
        self._map(0x1400, 0x200, 255, [0x6040_0010, 0x6071_0010])  # controlword, target torque; at once
        self._write("<b", TORQUE_MODE, 0x6060)
        self._rated_torque = self._read("<I", 0x6076) / 1000  # the object is in mN·m

    def _map(self, record: int, cob_id: int, transmission: int, entries: list[int]) -> None:
        """Map one PDO. It may be changed only while it is not valid (CiA 301, 7.5.2.36)."""
        cob_id += self.node_id
        self._write("<I", cob_id | NOT_VALID, record, 1)
        self._write("<B", transmission, record, 2)
        self._write("<B", 0, record + 0x200, 0)
        for number, entry in enumerate(entries, start=1):
            self._write("<I", entry, record + 0x200, number)
        self._write("<B", len(entries), record + 0x200, 0)
        self._write("<I", cob_id, record, 1)

    def _write(self, layout: str, value: int, index: int, subindex: int = 0) -> None:
        self.node.sdo.download(index, subindex, struct.pack(layout, value))

    def _read(self, layout: str, index: int, subindex: int = 0) -> int:
        return int(struct.unpack(layout, self.node.sdo.upload(index, subindex))[0])

    def _wait_for(self, state: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while self.state != state:
            if time.monotonic() > deadline:
                raise MasterError(f"the drive is {self.state}, and should be {state}")
            time.sleep(0.001)

    # Called by canopen's thread.

    def _on_status(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        self._statusword, self.position = struct.unpack("<Hi", data)
        self._heard = time.monotonic()
        if self.state in ("fault reaction active", "fault"):
            self._target = 0
            if self._controlword != FAULT_RESET:
                self._controlword = DISABLE_VOLTAGE
        self.network.send_message(0x200 + self.node_id, struct.pack("<Hh", self._controlword, self._target))

    def _on_emergency(self, error: EmcyError) -> None:
        self.errors.append(error.code)
