"""Numbers and other values as EDS files write them.

Theory (CiA 306-1, 4.3): decimal, hexadecimal with 0x, octal with a leading 0; the word $NODEID stands for the device's
node-ID and may be added to. Negative numbers are written with a sign or as two's complement of the type's size. Found
in files beside that: `$NodeID + 0x200` with blanks, $NODEID alone, a sign before 0x, REAL32 as the octets of its
IEEE 754 form. Everything that is understood raises nothing; ValueError says in words what is not.
"""

import struct

from haptic_fieldbus.eds.model import EdsValue, NodeOffset
from haptic_fieldbus.eds.types import OCTETS, REALS, TEXTS, EdsType

NODE_ID = "$nodeid"


def whole_number(text: str) -> int:
    """A number in decimal, hexadecimal or octal; ValueError in words."""
    digits = text.strip().lower()
    sign = -1 if digits.startswith("-") else 1
    digits = digits.lstrip("+-").strip()
    try:
        if digits.startswith("0x"):
            return sign * int(digits[2:], 16)
        if digits.startswith("0") and digits.isdecimal() and not set(digits) & {"8", "9"}:
            return sign * int(digits, 8)
        return sign * int(digits, 10)
    except ValueError:
        raise ValueError(f'"{text}" is no number') from None


def formula(text: str) -> int | NodeOffset:
    """A number, or a sum with $NODEID in it; ValueError in words."""
    if NODE_ID not in text.lower():
        return whole_number(text)
    terms = [term.strip() for term in text.split("+")]
    numbers = [term for term in terms if term.lower() != NODE_ID]
    if len(terms) - len(numbers) != 1:
        raise ValueError(f'"{text}" is no sum of $NODEID and a number')
    return NodeOffset(sum(whole_number(term) for term in numbers if term))


def value_of(text: str, type: EdsType | None) -> EdsValue:
    """A default, configured value or limit of this type; ValueError in words."""
    if type in TEXTS:
        return text
    if type in OCTETS:
        return _octets(text)
    if type in REALS:
        return _real(text, type)
    number = formula(text)
    if isinstance(number, NodeOffset) or type is None:
        return number
    return _fitted(number, type, text)


def text_of(value: EdsValue, type: EdsType | None) -> str:
    """How a value is written so that `value_of` reads it back."""
    if isinstance(value, NodeOffset):
        return f"$NODEID+0x{value.offset:X}" if value.offset else "$NODEID"
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, int):
        unsigned = type is not None and not type.signed and type.is_integer
        return f"0x{value:0{2 * (type.size or 0)}X}" if unsigned and type is not None else str(value)
    return str(value)


def _fitted(number: int, type: EdsType, text: str) -> int:
    """The number in the type's range: two's complement of its size, or of a larger one, is taken as negative."""
    low, high = type.limits or (number, number)
    if type.signed and number > high:
        for bits in (8 * (type.size or 0), 32, 64):
            if 1 << bits - 1 <= number < 1 << bits:
                number -= 1 << bits
                break
    if not low <= number <= high:
        raise ValueError(f'"{text}" does not fit into {type.name}')
    return number


def _real(text: str, type: EdsType) -> float:
    if text.strip().lower().startswith("0x"):
        number, size = whole_number(text), type.size or 0
        if number >= 1 << 8 * size:
            raise ValueError(f'"{text}" does not fit into {type.name}')
        value: float = struct.unpack(">f" if size == 4 else ">d", number.to_bytes(size, "big"))[0]
        return value
    try:
        return float(text)
    except ValueError:
        raise ValueError(f'"{text}" is no number') from None


def _octets(text: str) -> bytes:
    try:
        return bytes.fromhex(text.strip().lower().removeprefix("0x"))
    except ValueError:
        raise ValueError(f'"{text}" is no row of octets') from None
