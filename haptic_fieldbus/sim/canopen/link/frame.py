"""A CAN frame and the exact number of bits that it takes on the wire.

Theory (ISO 11898-1, CAN 2.0): from start of frame to the end of the CRC sequence, a complementary bit is inserted after
five equal bits. Inserted bits count towards the next run, and a bit is also inserted after the very last one. The tail
(CRC delimiter, acknowledge slot and delimiter, seven bits end of frame) is not stuffed. A computation bit by bit would
cost more than the whole simulated drive, so tables advance both CRC and stuffing a byte at a time. The stuffing state
is the last bit and the length of its run, 1 to 4. The result for the header is cached for each (identifier, length,
kind).
"""

from functools import lru_cache
from typing import NamedTuple

TAIL_BITS = 10
"""CRC delimiter, acknowledge slot, acknowledge delimiter and end of frame."""
INTERMISSION_BITS = 3
"""Bits after the end of frame before the bus is free again."""

# x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1 without its highest term (ISO 11898-1).
_CRC_POLYNOMIAL = 0x4599
_CRC_MASK = 0x7FFF
# Two values of the last bit times four lengths of its run; a run of five is stuffed at once and never kept.
_RUN_STATES = 8


class Frame(NamedTuple):
    """One CAN frame. A remote frame carries its length as that many empty octets."""

    can_id: int
    data: bytes
    extended: bool = False
    remote: bool = False


def arbitration_key(frame: Frame) -> int:
    """Return the bits of the arbitration field as a number: the lower one wins, because 0 is dominant.

    Standard: 11 bits, RTR, IDE 0; extended: 11 bits, SRR 1, IDE 1, 18 bits, RTR.
    """
    remote = int(frame.remote)
    if not frame.extended:
        return frame.can_id << 21 | remote << 20
    return (frame.can_id >> 18) << 21 | 0b11 << 19 | (frame.can_id & 0x3FFFF) << 1 | remote


def wire_bits(frame: Frame) -> int:
    """Return the bits from start of frame to end of frame, stuff bits included, intermission excluded."""
    crc, state, bits = _header(frame.can_id, len(frame.data), frame.extended, frame.remote)
    if not frame.remote:
        for octet in frame.data:
            crc = (crc << 8 & _CRC_MASK) ^ _CRC_TABLE[crc >> 7 ^ octet]
            step = _STUFF_8[state << 8 | octet]
            state = step & 7
            bits += step >> 3
    # The 15 bits of the CRC sequence are stuffed as well: the upper eight, then the lower seven.
    step = _STUFF_8[state << 8 | crc >> 7]
    return bits + (step >> 3) + (_STUFF_7[(step & 7) << 7 | crc & 0x7F] >> 3) + TAIL_BITS


def _stuff(state: int, value: int, width: int) -> int:
    """Send `width` bits from a stuffing state; return the new state in the low three bits, the bits sent above them."""
    last, run = state >> 2, (state & 3) + 1
    sent = 0
    for position in reversed(range(width)):
        bit = value >> position & 1
        run = run + 1 if bit == last else 1
        last = bit
        sent += 1
        # The stuff bit is sent after five equal bits and starts a run of its own.
        if run == 5:
            last, run, sent = 1 - last, 1, sent + 1
    return sent << 3 | last << 2 | run - 1


def _crc(crc: int, value: int, width: int) -> int:
    """Return the CRC-15 register after `width` more bits."""
    for position in reversed(range(width)):
        feedback = (value >> position & 1) ^ crc >> 14
        crc = (crc << 1 & _CRC_MASK) ^ (_CRC_POLYNOMIAL if feedback else 0)
    return crc


_CRC_TABLE = [_crc(0, octet, 8) for octet in range(256)]
_STUFF_8 = [_stuff(state, octet, 8) for state in range(_RUN_STATES) for octet in range(256)]
_STUFF_7 = [_stuff(state, value, 7) for state in range(_RUN_STATES) for value in range(128)]


@lru_cache(maxsize=4096)
def _header(can_id: int, length: int, extended: bool, remote: bool) -> tuple[int, int, int]:
    """Return CRC register, stuffing state and bits sent after the control field."""
    # Identifier (its upper 11 bits, SRR 1, IDE 1, its lower 18 bits), RTR, two reserved bits, four bits of length.
    if extended:
        value = (can_id >> 18) << 27 | 0b11 << 25 | (can_id & 0x3FFFF) << 7 | remote << 6 | length
        width = 38
    else:
        # 11 bits of identifier, RTR, IDE 0, one reserved bit, four bits of length.
        value = can_id << 7 | remote << 6 | length
        width = 18
    # The start of frame is dominant after an idle bus: a run of one zero.
    step = _stuff(0, value, width)
    return _crc(_crc(0, 0, 1), value, width), step & 7, 1 + (step >> 3)
