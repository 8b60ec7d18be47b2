"""Emergency codes in words."""

import pytest
from canopen.emcy import EmcyError

from haptic_fieldbus.protocols.canopen.emergency import MEANINGS, emergency_meaning

OUR_WORDS = {"Error Reset / No Error": "error reset", "Device Specific": "specific to this device"}
"""Where canopen's words for a class are not within ours."""


def test_listed_codes_have_their_own_words() -> None:
    assert emergency_meaning(0x3210) == "DC link over-voltage"
    assert "heartbeat" in emergency_meaning(0x8130)


@pytest.mark.parametrize(("code", "words"), [(0x2222, "current"), (0x8FFF, "monitoring"), (0xFF01, "manual")])
def test_other_codes_have_the_words_of_their_class(code: int, words: str) -> None:
    assert words in emergency_meaning(code)


@pytest.mark.parametrize(
    ("first", "mask", "theirs"), EmcyError.DESCRIPTIONS, ids=[name for *_, name in EmcyError.DESCRIPTIONS]
)
def test_every_code_of_a_class_has_the_words_of_canopen(first: int, mask: int, theirs: str) -> None:
    words = OUR_WORDS.get(theirs, theirs.lower())
    codes = [code for code in range(0x10000) if code & mask == first and code not in MEANINGS]
    assert [f"{code:04X}h" for code in codes if words not in emergency_meaning(code).lower()] == []
