"""Split an EDS into sections and keys, each with its line; any other line becomes a fault.

Keys and section names do not depend on case (CiA 306-1, 4.2). The text is UTF-8, UTF-16 with a byte order mark, or
Windows-1252, which some vendors' editors write. Windows-1252 comes last, as it gives a meaning to almost any octet.
"""

import math
import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from haptic_fieldbus.eds.model import EdsValue, NodeOffset
from haptic_fieldbus.eds.names import OCTETS, REALS, TEXTS, EdsType
from haptic_fieldbus.errors import Fault

# Numbers and other values as EDS files write them.
#
# Theory (CiA 306-1, 4.3): a number is decimal, hexadecimal with 0x, or octal with a leading 0. The word $NODEID stands
# for the node-ID of the device, and a number may be added to it. Negative numbers have a sign, or are the two's
# complement in the size of their type. Files have other forms too, which are understood as well: `$NodeID + 0x200` with
# blanks, $NODEID alone, a sign before 0x, REAL32 as the octets of its IEEE 754 form. A text that is not understood
# raises ValueError with a message for the user.

Value = TypeVar("Value")
NODE_ID = "$nodeid"
NODES = range(1, 128)
"""Node-IDs of CiA 301."""
WIDEST = range(-(1 << 63), 1 << 64)
"""Whole numbers of the widest types of CiA 301, INTEGER64 and UNSIGNED64."""
_SHOWN_LENGTH = 60


def whole_number(text: str) -> int:
    """Return the number of a decimal, hexadecimal or octal text; raises ValueError for another, or above 64 bits."""
    shown = text if len(text) <= _SHOWN_LENGTH else text[:_SHOWN_LENGTH] + "…"
    signed = text.strip().lower()
    digits = signed.lstrip("+-").strip()
    # With an 8 or a 9 a number cannot be octal: its zero is taken as padding.
    is_octal = digits.startswith("0") and digits.isdecimal() and not set(digits) & {"8", "9"}
    try:
        number = int(digits[2:], 16) if digits.startswith("0x") else int(digits, 8 if is_octal else 10)
    except ValueError:
        raise ValueError(f'"{shown}" is not a number') from None
    number = -number if signed.startswith("-") else number
    if number not in WIDEST:
        raise ValueError(f'"{shown}" needs more than 64 bits')
    return number


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
        try:
            return bytes.fromhex(text.strip().lower().removeprefix("0x"))
        except ValueError:
            raise ValueError(f'"{text}" is no row of octets') from None
    if type in REALS:
        return _real(text, type)
    number = formula(text)
    # Without a node-ID or a type there is no range to check.
    if isinstance(number, NodeOffset) or type is None:
        return number
    return _fitted(number, type, text)


def text_of(value: EdsValue, type: EdsType | None) -> str:
    """Return the text of a value that fits into its type, from which `value_of` reads it back.

    Reals are written as the octets of their IEEE 754 form, which is the only form that all readers take.
    """
    if isinstance(value, NodeOffset):
        return f"$NODEID+{'-' * (value.offset < 0)}0x{abs(value.offset):X}" if value.offset else "$NODEID"
    if isinstance(value, bytes):
        return value.hex()
    if type in REALS and not isinstance(value, str):
        return f"0x{_packed(value, type).hex().upper()}"
    if isinstance(value, int) and type is not None and type.is_integer and not type.signed:
        return f"0x{value:0{2 * (type.size or 0)}X}"
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
    """Return the octets of a real, the most significant first; raises OverflowError when the type cannot hold it."""
    return struct.pack(">f" if type is EdsType.REAL32 else ">d", value)


def _is_real(value: float, type: EdsType) -> bool:
    try:
        return math.isfinite(value) and bool(_packed(value, type))
    except OverflowError:  # also of a whole number that no double holds
        return False


def _fitted(number: int, type: EdsType, text: str) -> int:
    """Return the number in the range of its type; raises ValueError when it does not fit.

    The two's complement of a negative number may have the size of the type, 32 or 64 bits.
    """
    low, high = type.limits or (number, number)
    sizes = (8 * (type.size or 0), 32, 64) if type.signed and number > high else ()
    number -= next((1 << bits for bits in sizes if 1 << bits - 1 <= number < 1 << bits), 0)
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
        raise ValueError(f'"{text}" is not a number') from None
    if not _is_real(real, type):
        raise ValueError(f'"{text}" does not fit into {type.name}')
    return real


_HEAD = re.compile(r"\[([^\]]*)\]\s*(;.*)?$")
_LINE_END = re.compile(r"\r\n?|\n")
# A semicolon without a blank in front may belong to the value. A row of blanks is tried from its first one alone, else
# a long one would take the square of its length.
_COMMENT = re.compile(r"(?<!\s)\s++;.*$")
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


MOST_FAULTS = 1000
"""Most faults that are noted; a file with more is none that somebody corrects by such a list."""

LONGEST_TEXT = 300
"""Most letters of a fault that are told; a message quotes the line of a file, which may have millions."""


class Faults(list[Fault]):
    """Faults of a file in the order in which they were found, the first ones alone."""

    def append(self, fault: Fault) -> None:
        """Note a fault, unless there are too many already."""
        if len(self) < MOST_FAULTS:
            super().append(Fault(_shortened(fault.key), _shortened(fault.message), fault.line))
        elif len(self) == MOST_FAULTS:
            super().append(Fault("", f"more than {MOST_FAULTS} errors: the others are omitted", fault.line))


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + "…"


@dataclass(frozen=True)
class Item:
    """One `key=value` with its line; `key` is spelt as in the file."""

    key: str
    value: str
    line: int


@dataclass
class FileSection:
    """One section `[name]`; the items are found by their keys in lower case, and `faults` are those of the file."""

    name: str
    line: int
    faults: list[Fault]
    items: dict[str, Item] = field(default_factory=dict)

    def text(self, key: str) -> str:
        """Return the value of a key; empty when the key is missing or has no value."""
        item = self.items.get(key.lower())
        return item.value if item is not None else ""

    def number(self, key: str) -> int | None:
        """Return the number of a key; None when it is missing, empty or not understood, which is noted."""
        return self._understood(key, whole_number)

    def value(self, key: str, type: EdsType | None) -> EdsValue | None:
        """Return the value of a key with this type; None when it is missing, empty or not understood."""
        return self._understood(key, partial(value_of, type=type))

    def _understood(self, key: str, meaning: Callable[[str], Value]) -> Value | None:
        try:
            return meaning(self.text(key)) if self.text(key) else None
        except ValueError as error:
            self.note(key, str(error))
            return None

    def note(self, key: str, message: str) -> None:
        """Note a fault at a key, in the line of the section when the key is missing."""
        item = self.items.get(key.lower())
        line = item.line if item is not None else self.line
        self.faults.append(Fault(f"[{self.name}] {key}".rstrip(), message, line))


def text_of_octets(data: bytes, faults: list[Fault]) -> str:
    """Return the text of a file; notes a fault when it has to be read as Windows-1252."""
    if data.startswith(_UTF16_MARKS):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, octet = data[: error.start].count(b"\n") + 1, data[error.start]
        faults.append(Fault("", f"octet {octet:02X}h is no UTF-8: the file is read as Windows-1252", line))
        return data.decode("cp1252", errors="replace")


def sections_of(text: str, faults: list[Fault]) -> Mapping[str, FileSection]:
    """Return all sections by their names in lower case, those of one name merged into the first."""
    sections: dict[str, FileSection] = {}
    present: FileSection | None = None
    for number, raw in enumerate(_LINE_END.split(text), start=1):
        line = raw.strip()
        if not line or line.startswith((";", "#")):
            continue
        head = _HEAD.match(line)
        if head is not None:
            name = head[1].strip()
            present = sections.setdefault(name.lower(), FileSection(name, number, faults))
            if present.line != number:
                faults.append(Fault(f"[{name}]", f"already in line {present.line}: both are merged", number))
        elif present is None:
            faults.append(Fault("", f'"{line}" is before the first section', number))
        else:
            _add(present, line, number)
    return sections


def _add(section: FileSection, line: str, number: int) -> None:
    """Add the item of a line to the section. A key that stands twice has its last value."""
    faults = section.faults
    key, equals, value = (part.strip() for part in line.partition("="))
    if not equals or not key:
        faults.append(Fault(f"[{section.name}]", f'"{line}" is no key with a value', number))
        return
    bare, place = _COMMENT.sub("", value), f"[{section.name}] {key}"
    if bare != value:
        faults.append(Fault(place, "a comment after a value; expected it on a separate line", number))
    before = section.items.get(key.lower())
    if before is not None:
        faults.append(Fault(place, f"already in line {before.line}", number))
    section.items[key.lower()] = Item(key, bare, number)
