"""Bits on the wire and arbitration, against an encoder that works bit by bit."""

import math

from hypothesis import example, given
from hypothesis import strategies as st

from haptic_fieldbus.sim.canopen.link import INTERMISSION_BITS, Frame, arbitration_key, wire_bits
from tests.sim.canopen.link.can_bits import arbitration_bits, encoded


def _frame(draw_id: int, data: bytes, extended: bool, remote: bool) -> Frame:
    return Frame(draw_id if extended else draw_id & 0x7FF, data, extended, remote)


frames = st.builds(
    _frame, st.integers(0, (1 << 29) - 1), st.binary(max_size=8), extended=st.booleans(), remote=st.booleans()
)
monotonous = st.builds(
    lambda can_id, octet, length: Frame(can_id, bytes([octet]) * length),
    st.sampled_from([0x000, 0x7FF, 0x010, 0x7E0, 0x41F]),
    st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0x07, 0xE0, 0x1F, 0x3C]),
    st.integers(0, 8),
)


class TestBits:
    """ISO 11898-1: bit stuffing from start of frame to the end of the CRC sequence."""

    @given(frames | monotonous)
    @example(Frame(0x080, b""))
    @example(Frame(0x000, bytes(8)))
    def test_the_tables_count_what_a_bit_by_bit_encoder_sends(self, frame: Frame) -> None:
        assert wire_bits(frame) == len(encoded(frame.can_id, frame.data, frame.extended, frame.remote))

    @given(frames | monotonous)
    def test_no_standard_data_frame_is_longer_than_the_worst_case_formula(self, frame: Frame) -> None:
        if not frame.extended and not frame.remote:
            n = len(frame.data)
            assert wire_bits(frame) + INTERMISSION_BITS <= 8 * n + 47 + math.floor((33 + 8 * n) / 4)

    def test_the_worst_case_formula_is_reached_up_to_one_stuff_bit(self) -> None:
        longest = max(
            wire_bits(Frame(can_id, bytes([octet]) * 8)) for can_id in (0, 0x7FF, 0x20, 0x78) for octet in range(256)
        )
        assert 135 - 5 <= longest + INTERMISSION_BITS <= 135

    def test_a_remote_frame_carries_its_length_and_no_octets(self) -> None:
        assert wire_bits(Frame(0x555, bytes(8), remote=True)) < wire_bits(Frame(0x555, bytes(1)))


class TestArbitration:
    """ISO 11898-1: the first recessive bit against a dominant one loses."""

    @given(frames, frames)
    def test_the_lower_key_is_the_one_that_keeps_the_bus_bit_by_bit(self, one: Frame, other: Frame) -> None:
        bits = [arbitration_bits(frame.can_id, frame.extended, frame.remote) for frame in (one, other)]
        # A shorter arbitration field that is a prefix of the longer one cannot be: IDE differs.
        assert (arbitration_key(one) < arbitration_key(other)) == (bits[0] < bits[1])

    def test_standard_wins_against_extended_with_the_same_base_and_data_against_remote(self) -> None:
        ranking = [
            Frame(0x123, b""),
            Frame(0x123, b"", remote=True),
            Frame(0x123 << 18, b"", extended=True),
            Frame(0x123 << 18, b"", extended=True, remote=True),
            Frame(0x124, b""),
        ]
        keys = [arbitration_key(frame) for frame in ranking]
        assert keys == sorted(keys)
        assert len(set(keys)) == len(keys)
