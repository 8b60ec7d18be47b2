"""The CAN controller of this computer, as its error frames tell it.

The driver sends itself error frames about the state of its controller; nothing of them is on the bus. Bus-off takes the
torque away. The others do not, because the controller repeats a frame by itself, but they are told at the end of a run:
who loses feedback learns why.

Reference: linux/can/error.h (CAN_ERR_*), ISO 11898-1 12.1.4 (error passive, bus-off).
"""

from collections import Counter

BUS_OFF, RESTARTED, STATE, TRANSCEIVER, TX_TIMEOUT = 0x040, 0x100, 0x004, 0x010, 0x001
"""Classes of error frames, as bits of their identifier."""
TOLD = BUS_OFF | RESTARTED | STATE | TRANSCEIVER | TX_TIMEOUT
"""Classes that concern the controller; those of single bits on the wire may come thousands of times a second."""
CLASS_WORDS = {
    BUS_OFF: "bus-off",
    RESTARTED: "restarted after bus-off",
    TRANSCEIVER: "the transceiver reports a fault of the wires",
    TX_TIMEOUT: "a frame could not be sent in time",
}
STATE_WORDS = {
    0x01: "received frames were lost, its buffer was full",
    0x02: "its transmit buffer was full",
    0x04: "many receive errors",
    0x08: "many transmit errors",
    0x10: "error passive by receive errors",
    0x20: "error passive by transmit errors",
}
"""Bits of the second octet of a frame of the class `STATE`."""


class ErrorFrames:
    """The error frames that came."""

    def __init__(self) -> None:
        self.bus_off = False
        """True from the first bus-off on: a controller that restarted has lost frames, and nothing enables again."""
        self._heard: Counter[str] = Counter()

    def hear(self, can_id: int, data: bytes | bytearray) -> None:
        """Note an error frame."""
        self.bus_off = self.bus_off or bool(can_id & BUS_OFF)
        self._heard.update(words for bit, words in CLASS_WORDS.items() if can_id & bit)
        if can_id & STATE and len(data) > 1:
            self._heard.update(words for bit, words in STATE_WORDS.items() if data[1] & bit)

    def sentence(self, bus: str) -> str | None:
        """Return for people what the controller reported; None when it reported nothing."""
        if not self._heard:
            return None
        told = ", ".join(f"{words} {number}×" for words, number in self._heard.items())
        return f"{bus}: the CAN controller reported: {told}. Check wiring, terminators and bit rate"
