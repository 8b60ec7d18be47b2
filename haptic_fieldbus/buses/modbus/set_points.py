"""The set-point of one drive on its way out, and the command that takes its place when it changes.

Where command and target torque are not neighbours, each needs a request of its own. The target torque is zero until the
drive is in *operation enabled*, so the command may take its place in the period in which it changes. It is repeated
until the drive has answered it.
"""

from haptic_fieldbus.buses.modbus.framing import Question
from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, LineSection
from haptic_fieldbus.protocols.modbus.register_traffic import RegisterTraffic
from haptic_fieldbus.protocols.modbus.requests import Block


class StoredSetPoint:
    """The blocks that are written to one unit; `start` is their offset in the output image."""

    def __init__(self, traffic: RegisterTraffic, section: LineSection, start: int) -> None:
        self.waiting = False
        """Whether a set-point was stored and has not been sent yet."""
        self.blocks = (traffic.set_point,) if traffic.command is None else (traffic.set_point, traffic.command)
        """The set-point, and the command where it has a block of its own."""
        self.function = section.writing(traffic.set_point.count)
        """Function that writes a set-point and reads nothing; None when the drive has none."""
        self._section = section
        self._unit = traffic.unit
        self._start, self._middle = start, start + 2 * traffic.set_point.count
        self._end = start + 2 * sum(block.count for block in self.blocks)
        self._octets = self._command = b""
        self._commanded = b""
        """Octets of the command that the drive has answered last."""
        self._sent = b""
        """Octets of the command that is under way; none while it is not."""

    def forget(self) -> None:
        """Take nothing for sent or answered: the drive is configured anew."""
        self.waiting, self._commanded, self._sent = False, b"", b""

    def store(self, image: bytes | bytearray) -> None:
        """Take over the part of this axis; an earlier one that was not sent is dropped."""
        self._octets = bytes(image[self._start : self._middle])
        self._command = bytes(image[self._middle : self._end])
        self.waiting = True

    def writing(self, block: Block) -> Question:
        """Return the request that writes a block, all zeros, and reads nothing."""
        # A drive that writes by function 23 alone is never asked for it.
        function = self._section.writing(block.count) or READ_WRITE
        return Question(self._unit, function, block.address, 0, (0,) * block.count)

    def writing_before(self, block: Block, read: Block) -> Question:
        """Return the request that writes a block, all zeros, and then reads one."""
        return Question(self._unit, READ_WRITE, read.address, read.count, (0,) * block.count, block.address)

    def take(self) -> tuple[int, bytes]:
        """Return which block is to be written now, and its octets."""
        self.waiting = False
        if self._command and self._command != self._commanded:
            self._sent = self._command
            return 1, self._command
        self._sent = b""
        return 0, self._octets

    def answered(self) -> None:
        """Note that the drive has taken over what was sent last."""
        if self._sent:
            self._commanded, self._sent = self._sent, b""
