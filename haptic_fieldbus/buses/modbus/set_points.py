"""The set-point of one drive on its way out, and the command that takes its place when it changes.

Where command and target torque are not neighbours, each needs a request of its own. The target torque is zero until the
drive is in *operation enabled*, so the command may take its place in the period in which it changes. It is repeated
until the drive has answered it.
"""

from struct import Struct

from haptic_fieldbus.buses.modbus.framing import Question
from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, LineSection
from haptic_fieldbus.protocols.modbus.register_traffic import RegisterTraffic
from haptic_fieldbus.protocols.modbus.requests import Block


class SetPoint:
    """The blocks that are written to one unit; `start` is their offset in the output image."""

    def __init__(self, traffic: RegisterTraffic, section: LineSection, start: int) -> None:
        self.waiting = False
        """Whether a set-point was stored and has not been sent yet."""
        self.alone = section.writing(traffic.set_point.count)
        """Function that writes a set-point and reads nothing; None when the drive has none."""
        self._unit = traffic.unit
        self._blocks = [_Written(traffic.set_point, section, start)]
        if traffic.command is not None:
            self._blocks.append(_Written(traffic.command, section, self._blocks[0].end))
        self._end = self._blocks[-1].end
        self._start, self._octets = start, b""
        self._commanded = b""
        """Octets of the command that the drive has answered last."""
        self._sent = b""
        """Octets of the command that is under way; none while it is not."""

    def forget(self) -> None:
        """Take nothing for sent or answered: the drive is configured anew."""
        self.waiting, self._commanded, self._sent = False, b"", b""

    def store(self, image: bytes | bytearray) -> None:
        """Take over the part of this axis; an earlier one that was not sent is dropped."""
        self._octets = bytes(image[self._start : self._end])
        self.waiting = True

    def writing(self) -> Question:
        """Return the request that writes what is stored."""
        block, words = self._next()
        return Question(self._unit, block.function, block.address, 0, words)

    def writing_before(self, read: Block) -> Question:
        """Return the request that writes what is stored, and then reads a block."""
        block, words = self._next()
        return Question(self._unit, READ_WRITE, read.address, read.count, words, block.address)

    def answered(self) -> None:
        """Note that the drive has taken over what was sent last."""
        if self._sent:
            self._commanded, self._sent = self._sent, b""

    def _next(self) -> tuple["_Written", tuple[int, ...]]:
        self.waiting = False
        block, *separate = self._blocks
        for command in separate:
            octets = self._octets[command.start - self._start :]
            self._sent = octets if octets != self._commanded else b""
            block = command if self._sent else block
        words: tuple[int, ...] = block.words.unpack_from(self._octets, block.start - self._start)
        return block, words


class _Written:
    """A block that is written; `start` and `end` are its place in the output image."""

    def __init__(self, block: Block, section: LineSection, start: int) -> None:
        self.address = block.address
        # A drive that writes by function 23 alone has none for writing only, and is never asked for it.
        self.function = section.writing(block.count) or READ_WRITE
        self.start, self.end = start, start + 2 * block.count
        self.words = Struct(f">{block.count}H")
