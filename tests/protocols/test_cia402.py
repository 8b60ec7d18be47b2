"""Statusword → state → controlword, against the tables of CiA 402 typed in again here."""

import pytest

from haptic_fieldbus.drive.profile import PowerRow, PowerState
from haptic_fieldbus.protocols.cia402 import CIA402

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


@pytest.mark.thorough("65,536 statuswords")
def test_every_statusword_of_16_bits_gets_the_state_of_the_standard() -> None:
    expected = {word: name for pattern, name in STATE_CODING for word in coded(pattern)}
    for word in range(0x1_0000):
        assert CIA402.state(word).value == expected.get(word, "unknown"), hex(word)


def test_bits_outside_the_mask_never_change_the_state() -> None:
    """Assumption of the loop: it looks again only when one of these bits has changed."""
    assert CIA402.mask == 0x6F
    for word in range(0x1_0000):
        assert CIA402.state(word & CIA402.mask) is CIA402.state(word)


# CiA 402-2, table "command coding": bits 7, 3, 2, 1, 0; transitions that each command triggers.
COMMAND_OF_TRANSITION = {2: "0x110", 3: "00111", 4: "01111", 12: "0xx0x"}


@pytest.mark.parametrize("row", CIA402.rows, ids=lambda row: row.state.value)
def test_each_answer_is_the_command_of_its_transition(row: PowerRow) -> None:
    assert CIA402.answer(row.state) == row.controlword
    if row.transition is None:
        assert row.controlword == (0x000F if row.state is PowerState.OPERATION_ENABLED else 0)
        return
    pattern = COMMAND_OF_TRANSITION[row.transition]
    bits = [row.controlword >> position & 1 for position in (7, 3, 2, 1, 0)]
    assert all(want == "x" or int(want) == bit for want, bit in zip(pattern, bits, strict=True))


def test_every_state_of_the_standard_has_its_row_and_what_is_none_is_answered_with_no_voltage() -> None:
    assert {row.state for row in CIA402.rows} == set(PowerState) - {PowerState.UNKNOWN}
    assert CIA402.answer(PowerState.UNKNOWN) == CIA402.off == 0


def test_no_answer_resets_a_fault() -> None:
    """Fault reset is the rising edge of bit 7: a person has to ask for it."""
    assert not any(row.controlword & 0x80 for row in CIA402.rows)


def test_the_way_up_takes_transitions_2_3_4() -> None:
    way = [PowerState.SWITCH_ON_DISABLED, PowerState.READY, PowerState.SWITCHED_ON]
    transitions = {row.state: row.transition for row in CIA402.rows}
    assert [transitions[state] for state in way] == [2, 3, 4]
