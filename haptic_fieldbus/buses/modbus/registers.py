"""Values as they stand in registers of 16 bits; one of 32 bits takes two, in the drive's order of words."""

from collections.abc import Sequence

from haptic_fieldbus.protocols.modbus.profile import Register, WordOrder


def to_words(register: Register, value: int, order: WordOrder) -> tuple[int, ...]:
    """Return the registers of a value, by rising address; raises struct.error when it is out of range."""
    low_first = register.type.pack(value)
    words = tuple(int.from_bytes(low_first[at : at + 2], "little") for at in range(0, len(low_first), 2))
    return words if order == "low first" else words[::-1]


def from_words(register: Register, words: Sequence[int], order: WordOrder) -> int:
    """Return the value in registers, given by rising address."""
    low_first = words if order == "low first" else words[::-1]
    return register.type.unpack(b"".join(word.to_bytes(2, "little") for word in low_first))
