"""A simulated drive on CAN: the drive together with its CANopen node.

Pure: it takes frames and times [ns] and sends frames through `send`.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.model.options import node_options
from haptic_fieldbus.sim.canopen.model.quirks import install_quirks, with_quirks
from haptic_fieldbus.sim.canopen.node import SDO_REQUEST_ID, Node
from haptic_fieldbus.sim.canopen.services.emergency import DRIVE
from haptic_fieldbus.sim.canopen.services.heartbeat import HEARTBEAT_ID
from haptic_fieldbus.sim.canopen.services.lss import REQUEST_ID
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.settings import DriveSettings
from haptic_fieldbus.sim.hand import Hand


class Slave:
    """A drive joined to its node; it is the `DriveLink` of the drive."""

    def __init__(
        self,
        number: int,
        profile: DriveProfile,
        axis: RigAxis,
        send: Callable[[Frame], None],
        hand: Hand | None = None,
        settings: DriveSettings | None = None,
        t_ns: int = 0,
    ) -> None:
        """Build the slave at `t_ns`, without voltage yet."""
        model, settings = with_quirks(canopen_profile(profile), settings or DriveSettings())
        self.silent_until_ns = 0
        """Until this time no frame is sent or received."""
        self._frames = send
        self.drive = Drive(model, axis, self, hand, settings, t_ns)
        dictionary = self.drive.dictionary
        self.node = Node(number, dictionary, self.drive, self._send, node_options(number, model, settings))
        self.not_taken_over = install_quirks(dictionary, model, number)
        self.drive.units.follow()
        """Notes on the parts of a vendor's file that this drive cannot take over."""

    def duplicate(self) -> None:
        """Let a second node with the same node-ID join: whatever is sent from now on is sent twice."""
        send = self._frames

        def twice(frame: Frame) -> None:
            send(frame)
            send(frame)

        self._frames = twice

    # Called by the rack.

    @property
    def due_ns(self) -> int:
        """Return the time of the next timer; NEVER_NS when there is none."""
        return min(self.node.due_ns, self.drive.due_ns)

    @property
    def concerns(self) -> frozenset[tuple[int, bool]]:
        """Identifiers of the frames that concern the node in any state, each with True for a remote frame.

        It follows from the parameters, and changes only when the handlers of the node are rebuilt.
        """
        node = self.node
        data = {0, REQUEST_ID, SDO_REQUEST_ID + node.number, *node.process.received, *node.consumers.route()}
        remote = {HEARTBEAT_ID + node.number, *node.process.requests()}
        time = set[int]() if node.time.can_id is None else {node.time.can_id}
        return frozenset([*((each, False) for each in data | time), *((each, True) for each in remote)])

    def power_on(self, t_ns: int, *, booted: bool = False) -> None:
        """Switch the voltage on; the boot-up message follows, or was sent long ago when `booted`."""
        self.node.power_on(t_ns, None if booted else self.drive.settings.start_delay_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Handle a frame of another node that has ended, unless the slave is silent."""
        if t_ns >= self.silent_until_ns:
            self.node.receive(frame, t_ns)
            # An NMT command begins or ends an exchange: the hand that leads begins anew, with a rest.
            if not frame.can_id and self.drive.plant.led:
                self.drive.servo.advance(t_ns)
                self.drive.plant.rest_hand()

    def timer(self, t_ns: int) -> None:
        """Serve the timers that are due."""
        # The drive first: the node may send values that the drive computes at the same instant.
        if self.drive.due_ns <= t_ns:
            self.drive.timer(t_ns)
        if self.node.due_ns <= t_ns:
            self.node.timer(t_ns)

    # Called by the drive.

    def error(self, code: int, t_ns: int) -> None:
        """Send an emergency message."""
        self.node.now_ns = t_ns
        self.node.emergencies.raise_error(code, DRIVE)

    def persists(self) -> bool:
        """Return whether the cause of an error of the drive is present."""
        return self.node.emergencies.persists(DRIVE)

    def clear_errors(self, t_ns: int) -> None:
        """Send *error reset* after a fault reset, unless another error remains."""
        self.node.now_ns = t_ns
        self.node.emergencies.clear_all(DRIVE)

    def _send(self, frame: Frame) -> None:
        if self.node.now_ns >= self.silent_until_ns:
            self._frames(frame)
