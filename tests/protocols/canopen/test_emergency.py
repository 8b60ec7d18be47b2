"""Emergency codes in words."""

import pytest
from canopen.emcy import EmcyError

from haptic_fieldbus.protocols.canopen.emergency import MEANINGS, emergency_meaning


def test_listed_codes_have_their_own_words() -> None:
    assert emergency_meaning(0x3210) == "DC link over-voltage"
    assert "heartbeat" in emergency_meaning(0x8130)


@pytest.mark.parametrize(("code", "words"), [(0x2222, "current"), (0x8FFF, "monitoring"), (0xFF01, "manual")])
def test_other_codes_have_the_words_of_their_class(code: int, words: str) -> None:
    assert words in emergency_meaning(code)


@pytest.mark.parametrize("code", range(0x0000, 0x10000, 0x80))
def test_classes_agree_with_canopen(code: int) -> None:
    theirs = EmcyError(code, 0, b"", 0.0).get_desc()
    if theirs and code not in MEANINGS:
        ours = emergency_meaning(code)
        words = {"Error Reset / No Error": "error reset", "Device Specific": "specific to this device"}
        assert words.get(theirs, theirs.lower()) in ours.lower()
