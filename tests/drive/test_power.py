"""Statusword → state → controlword, against the tables of CiA 402 typed in again here."""

import pytest

from haptic_fieldbus.drive.power import (
    RELEVANT_BITS,
    STATE_OF_BITS,
    TOWARDS_OPERATION_ENABLED,
    PowerState,
    power_state,
)

# CiA 402-2, table "state coding": bit 6, 5, 3, 2, 1, 0; x does not matter.
STATE_CODING = [
    ("0x0000", "not ready to switch on"),
    ("1x0000", "switch on disabled"),
    ("010001", "ready to switch on"),
    ("010011", "switched on"),
    ("010111", "operation enabled"),
    ("000111", "quick stop active"),
    ("0x1111", "fault reaction active"),
    ("0x1000", "fault"),
]
BIT_POSITIONS = (6, 5, 3, 2, 1, 0)


def coded(pattern: str) -> set[int]:
    """All statuswords of 16 bits that match a pattern, by brute force."""
    return {
        word
        for word in range(0x1_0000)
        if all(
            bit == "x" or word >> position & 1 == int(bit) for bit, position in zip(pattern, BIT_POSITIONS, strict=True)
        )
    }


def test_every_statusword_of_16_bits_gets_the_state_of_the_standard() -> None:
    expected = {word: name for pattern, name in STATE_CODING for word in coded(pattern)}
    for word in range(0x1_0000):
        assert power_state(word).value == expected.get(word, "unknown"), hex(word)


def test_the_look_up_table_equals_the_patterns() -> None:
    for word in range(0x1_0000):
        assert STATE_OF_BITS[word & RELEVANT_BITS] is power_state(word)


# CiA 402-2, table "command coding": bits 7, 3, 2, 1, 0; transitions that each command triggers.
COMMAND_OF_TRANSITION = {2: "0x110", 3: "00111", 4: "01111", 12: "0xx0x"}


@pytest.mark.parametrize("state", list(PowerState))
def test_each_answer_is_the_command_of_its_transition(state: PowerState) -> None:
    answer = TOWARDS_OPERATION_ENABLED[state]
    if answer.transition is None:
        assert answer.controlword == (0x000F if state is PowerState.OPERATION_ENABLED else 0)
        return
    pattern = COMMAND_OF_TRANSITION[answer.transition]
    bits = [answer.controlword >> position & 1 for position in (7, 3, 2, 1, 0)]
    assert all(want == "x" or int(want) == bit for want, bit in zip(pattern, bits, strict=True))


def test_no_answer_resets_a_fault() -> None:
    """Fault reset is the rising edge of bit 7: a person has to ask for it."""
    assert not any(answer.controlword & 0x80 for answer in TOWARDS_OPERATION_ENABLED.values())


def test_the_way_up_takes_transitions_2_3_4() -> None:
    way = [PowerState.SWITCH_ON_DISABLED, PowerState.READY, PowerState.SWITCHED_ON]
    assert [TOWARDS_OPERATION_ENABLED[state].transition for state in way] == [2, 3, 4]
