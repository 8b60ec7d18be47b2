"""The values that only a vendor's tool sets, beside the file: each is shown under a name, which the file has too."""

import re
import unicodedata
from collections.abc import Iterator

from haptic_fieldbus.eds import Eds, EdsEntry
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, ShownObject
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.protocols.canopen.vendor.named import Use, finding_of

KEY = "commissioning.shown"
_SMALL_WORDS = {"of", "the", "a", "an", "in", "for"}
_EXPLANATION = re.compile(r"\([^)]*\)")


def shown_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield what the file has of each value; an object that stands twice is a slip of copying."""
    shown = profile.commissioning.shown
    places = [(each.object, each.subindex) for each in shown]
    for each, place in zip(shown, places, strict=True):
        yield finding_of(KEY, each.entry, Use.READ, eds)
        found = eds.find(*place)
        if found is not None and found.name:
            yield _named(each, found)
        if places.count(place) > 1:
            yield Finding(KEY, "", fault=f"{each.object:04X}h:{each.subindex:02X} stands twice; expected it once")


def _named(shown: ShownObject, found: EdsEntry) -> Finding:
    """Return a fault where the name of the profile has a word that the file's name of the object does not have."""
    said = f'{shown.object:04X}h:{shown.subindex:02X} is "{found.name}"'
    other = _words(_EXPLANATION.sub(" ", shown.name)) - _words(found.name)
    fault = f'"{shown.name}"; {said}. What the file does not say stands in parentheses' if other else ""
    return Finding(f"{KEY}.name", said, found.line, fault, shown.object, shown.subindex)


def _words(text: str) -> set[str]:
    """Return the words of a name, each in its singular and without regard to case and superscripts."""
    plain = unicodedata.normalize("NFKC", text).casefold()
    return {word.removesuffix("s") for word in re.findall(r"[a-z0-9]+", plain)} - _SMALL_WORDS
