"""Numbers and other values as EDS files write them.

Theory (CiA 306-1, 4.3): a number is decimal, hexadecimal with 0x, or octal with a leading 0. The word $NODEID stands
for the node-ID of the device, and a number may be added to it. Negative numbers have a sign, or are the two's
complement in the size of their type. Files have other forms too, which are understood as well: `$NodeID + 0x200` with
blanks, $NODEID alone, a sign before 0x, REAL32 as the octets of its IEEE 754 form. A text that is not understood raises
ValueError with a message for the user.
"""

import math
import struct

from haptic_fieldbus.eds.model import EdsValue, NodeOffset
from haptic_fieldbus.eds.types import OCTETS, REALS, TEXTS, EdsType

NODE_ID = "$nodeid"
NODES = range(1, 128)
"""Node-IDs of CiA 301."""
WIDEST = range(-(1 << 63), 1 << 64)
"""Whole numbers of the widest types of CiA 301, INTEGER64 and UNSIGNED64."""
_SHOWN_LENGTH = 60


def whole_number(text: str) -> int:
    """Return the number of a decimal, hexadecimal or octal text; raises ValueError for another, or above 64 bits."""
    shown = text if len(text) <= _SHOWN_LENGTH else text[:_SHOWN_LENGTH] + "…"
    try:
        number = _number(text.strip().lower())
    except ValueError:
        raise ValueError(f'"{shown}" is no number') from None
    if number not in WIDEST:
        raise ValueError(f'"{shown}" is more than 64 bits hold')
    return number


def _number(digits: str) -> int:
    sign = -1 if digits.startswith("-") else 1
    digits = digits.lstrip("+-").strip()
    if digits.startswith("0x"):
        return sign * int(digits[2:], 16)
    # With an 8 or a 9 a number cannot be octal: its zero is taken as padding.
    if digits.startswith("0") and digits.isdecimal() and not set(digits) & {"8", "9"}:
        return sign * int(digits, 8)
    return sign * int(digits, 10)


def formula(text: str) -> int | NodeOffset:
    """Return a number, or the offset of a sum with $NODEID; raises ValueError when the text is neither."""
    if NODE_ID not in text.lower():
        return whole_number(text)
    terms = [term.strip() for term in text.split("+")]
    numbers = [term for term in terms if term.lower() != NODE_ID]
    if len(terms) - len(numbers) != 1:
        raise ValueError(f'"{text}" is no sum of $NODEID and a number')
    return NodeOffset(sum(whole_number(term) for term in numbers if term))


def value_of(text: str, type: EdsType | None) -> EdsValue:
    """Return a default, configured value or limit of this type; raises ValueError when the text is none."""
    if type in TEXTS:
        return text
    if type in OCTETS:
        return _octets(text)
    if type in REALS:
        return _real(text, type)
    number = formula(text)
    # Without a node-ID or a type there is no range to check.
    if isinstance(number, NodeOffset) or type is None:
        return number
    return _fitted(number, type, text)


def text_of(value: EdsValue, type: EdsType | None) -> str:
    """Return the text of a value from which `value_of` reads it back; raises ValueError for one that is out of range.

    Reals are written as the octets of their IEEE 754 form, which is the only form that all readers take.
    """
    if isinstance(value, NodeOffset):
        return f"$NODEID+{'-' * (value.offset < 0)}0x{abs(value.offset):X}" if value.offset else "$NODEID"
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, str):
        return value
    if type in REALS:
        return f"0x{_packed(value, type).hex().upper()}"
    if isinstance(value, int):
        unsigned = type is not None and not type.signed and type.is_integer
        return f"0x{value:0{2 * (type.size or 0)}X}" if unsigned and type is not None else str(value)
    return str(value)


def fits(value: EdsValue, type: EdsType) -> bool:
    """Return whether a type can hold a value, with any node-ID."""
    if type in TEXTS:
        return isinstance(value, str)
    if type in OCTETS:
        return isinstance(value, bytes)
    if type in REALS:
        return isinstance(value, int | float) and _is_real(value, type)
    low, high = type.limits or (0, 0)
    return isinstance(value, int | NodeOffset) and low <= value_range(value)[0] and value_range(value)[1] <= high


def value_range(value: EdsValue) -> tuple[float, float]:
    """Return the least and the greatest number that a value is, with any node-ID; infinite for one that is none."""
    if isinstance(value, NodeOffset):
        return value.at(NODES[0]), value.at(NODES[-1])
    return (value, value) if isinstance(value, int | float) else (-math.inf, math.inf)


def _packed(value: float, type: EdsType) -> bytes:
    """Return the octets of a real, the most significant first; raises ValueError when the type cannot hold it."""
    try:
        return struct.pack(">f" if type is EdsType.REAL32 else ">d", value)
    except OverflowError:
        raise ValueError(f"{value} does not fit into {type.name}") from None


def _is_real(value: float, type: EdsType) -> bool:
    try:
        return math.isfinite(value) and bool(_packed(value, type))
    except (ValueError, OverflowError):  # OverflowError: a whole number that no double holds
        return False


def _fitted(number: int, type: EdsType, text: str) -> int:
    """Return the number in the range of its type; raises ValueError when it does not fit.

    The two's complement of a negative number may have the size of the type, 32 or 64 bits.
    """
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
    """Return a REAL32 or REAL64; raises ValueError when the text is none."""
    if text.strip().lower().startswith("0x"):
        number, size = whole_number(text), type.size or 0
        if not 0 <= number < 1 << 8 * size:
            raise ValueError(f'"{text}" does not fit into {type.name}')
        # The digits begin with the most significant octet.
        value: float = struct.unpack(">f" if size == 4 else ">d", number.to_bytes(size, "big"))[0]
        return value
    try:
        real = float(text)
    except ValueError:
        raise ValueError(f'"{text}" is no number') from None
    if not _is_real(real, type):
        raise ValueError(f'"{text}" does not fit into {type.name}')
    return real


def _octets(text: str) -> bytes:
    """Return octets from pairs of hexadecimal digits; raises ValueError when the text is none."""
    try:
        return bytes.fromhex(text.strip().lower().removeprefix("0x"))
    except ValueError:
        raise ValueError(f'"{text}" is no row of octets') from None
