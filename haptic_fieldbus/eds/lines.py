"""Split an EDS into sections and keys, each with its line; any other line becomes a fault.

Keys and section names do not depend on case (CiA 306-1, 4.2). The text is UTF-8, UTF-16 with a byte order mark, or
Windows-1252, which some vendors' editors write. Windows-1252 comes last, as it gives a meaning to almost any octet.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from haptic_fieldbus.errors import Fault

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
            super().append(Fault("", f"there are more than {MOST_FAULTS} faults: the others are left out", fault.line))


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
    """One section `[name]`; the items are found by their keys in lower case."""

    name: str
    line: int
    items: dict[str, Item] = field(default_factory=dict)

    def text(self, key: str) -> str:
        """Return the value of a key; empty when the key is missing or has no value."""
        item = self.items.get(key.lower())
        return item.value if item is not None else ""

    def line_of(self, key: str) -> int:
        """Return the line of a key, or of the section when the key is missing."""
        item = self.items.get(key.lower())
        return item.line if item is not None else self.line

    def __contains__(self, key: str) -> bool:
        return key.lower() in self.items


def text_of_octets(data: bytes, faults: list[Fault]) -> str:
    """Return the text of a file; notes a fault when it has to be read as Windows-1252."""
    if data.startswith(_UTF16_MARKS):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        octet = data[error.start]
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
            present = _opened(head[1].strip(), number, sections, faults)
        elif present is None:
            faults.append(Fault("", f'"{line}" stands before the first section', number))
        else:
            _add(present, line, number, faults)
    return sections


def _opened(name: str, number: int, sections: dict[str, FileSection], faults: list[Fault]) -> FileSection:
    """Return the section of this name, a new one or the one that is already there; notes the second case."""
    found = sections.get(name.lower())
    if found is None:
        return sections.setdefault(name.lower(), FileSection(name, number))
    faults.append(Fault(f"[{name}]", f"stands in line {found.line} already: both are taken together", number))
    return found


def _add(section: FileSection, line: str, number: int, faults: list[Fault]) -> None:
    """Add the item of a line to the section. A key that stands twice has its last value."""
    key, equals, value = (part.strip() for part in line.partition("="))
    if not equals or not key:
        faults.append(Fault(f"[{section.name}]", f'"{line}" is no key with a value', number))
        return
    bare = _COMMENT.sub("", value)
    if bare != value:
        faults.append(Fault(f"[{section.name}] {key}", "a comment behind a value; expected a line of its own", number))
    before = section.items.get(key.lower())
    if before is not None:
        faults.append(Fault(f"[{section.name}] {key}", f"stands in line {before.line} already", number))
    section.items[key.lower()] = Item(key, bare, number)
