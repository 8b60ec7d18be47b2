"""The TOML of a profile that is made from an EDS: a beginning, which says of each value where it comes from."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum

from haptic_fieldbus.documents.edits import quoted, value_text
from haptic_fieldbus.drive.profile import ASSUMED
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.eds_values import USABLE, value_at
from haptic_fieldbus.protocols.canopen.from_eds import LEFT_OUT, EdsProfile

SECTIONS = ("drive", "identity", "torque", "position", "velocity", "pdo", "sync", "link_loss", "timing")
HEXADECIMAL = ("object", "heartbeat_consumer", "interpolation_time", "cycle_period", "vendor_id", "product_codes",
               "maps")  # fmt: skip
"""Keys whose numbers are written as in vendors' manuals."""


@dataclass(frozen=True)
class Assumption:
    """A value that no EDS can know, as it is written, and the reason for it."""

    key: str
    value: str
    why: str


@dataclass(frozen=True)
class Draft:
    """The text of a profile, and what has to be found out before it moves a motor."""

    text: str
    assumed: tuple[Assumption, ...]
    known: int
    """Number of values with a source other than an assumption."""


def draft_of(profile: EdsProfile, file: str) -> Draft:
    """Return the draft of a profile; `file` is the name of the vendor's file."""
    written = {section: _section(profile, section) for section in SECTIONS}
    values = {f"{section}.{key}": text for section, items in written.items() for key, text in items.items()}
    # The source of a value belongs into the file, and the reason for one that is not there.
    sources = {
        key: text
        for key, text in profile.sources.items()
        if text.startswith(LEFT_OUT) or key == USABLE or ".".join(key.split(".")[:2]) in values
    }
    assumed = tuple(
        Assumption(key, _toml(key.rpartition(".")[2], value_at(profile, key)), text)
        for key, text in sources.items()
        if ASSUMED in text
    )
    lines = [
        *_head(profile, file, assumed),
        "schema = 1",
        "",
    ]
    for section, items in (*written.items(), ("sources", {quoted(key): quoted(text) for key, text in sources.items()})):
        if items or section == "sources":
            lines += [f"[{section}]", *(f"{key} = {text}" for key, text in items.items()), ""]
    left_out = sum(text.startswith(LEFT_OUT) for text in sources.values())
    return Draft("\n".join(lines), assumed, len(sources) - len(assumed) - left_out)


def _section(profile: EdsProfile, section: str) -> dict[str, str]:
    """Return the values of a section as TOML, by key: those with a source, and those other than the usual."""
    table = getattr(profile, section)
    found: dict[str, str] = {}
    for field in fields(table) if table is not None else ():
        value, key = getattr(table, field.name), f"{section}.{field.name}"
        told = any(name == key or name.startswith(f"{key}.") for name in profile.sources)
        if value not in (None, ()) and (told or value != field.default):
            found[field.name] = _toml(field.name, value)
    return found


def _toml(key: str, value: object) -> str:
    """Return a value as TOML."""
    return value_text(_plain(value), _number, key)


def _plain(value: object) -> object:
    """Return a value without dataclasses; sub-index 0 and an empty unit are left out, as most objects have no other."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    if not is_dataclass(value):
        return value.value if isinstance(value, Enum) else value
    items = {name: _plain(each) for name, each in vars(value).items() if each not in ("", None)}
    return {name: each for name, each in items.items() if (name, each) != ("subindex", 0)}


def _number(key: str, number: int | float) -> str:
    if isinstance(number, float):
        return exactly(number)
    return f"0x{number:04X}" if key in HEXADECIMAL else str(number)


def _head(profile: EdsProfile, file: str, assumed: tuple[Assumption, ...]) -> Iterator[str]:
    """Yield the comment at the top: what the drive is, and what is still to be found out."""
    yield _comment(f"{profile.title} on CANopen, drafted from {file}. Not tested on hardware.")
    yield "#"
    if not profile.drive.usable:
        yield _comment(f"Not usable for force: {profile.sources[USABLE]}.")
        yield "#"
    yield _comment("An EDS does not contain the following; see the vendor's manual, or measure on the bench:")
    yield from (_comment(f"- {each.key} = {each.value}") for each in assumed)


def _comment(text: str) -> str:
    return "# " + re.sub(r"[\x00-\x1f\x7f]", " ", text)
