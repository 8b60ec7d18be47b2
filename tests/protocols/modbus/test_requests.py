"""Registers in blocks: what is needed, nothing else, in as few requests as pay."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.profile import DataType, Order
from haptic_fieldbus.errors import ImageTooLargeError
from haptic_fieldbus.protocols.modbus.profile import ModbusMotion, ModbusProfile, Register
from haptic_fieldbus.protocols.modbus.register_traffic import blocks
from haptic_fieldbus.signals import Signal
from tests.protocols.modbus.lines import GENERIC, with_line

READ = (Signal.STATUSWORD, Signal.TORQUE_DEMAND, Signal.POSITION)


def placed(statusword: int, demand: int, position: int, profile: ModbusProfile = GENERIC) -> ModbusProfile:
    """The profile with its registers at other addresses."""
    return replace(
        profile,
        power=replace(profile.power, status=Register(statusword, DataType.UINT16)),
        torque=replace(profile.torque, demand=Register(demand, DataType.INT16)),
        position=ModbusMotion(Register(position, DataType.INT32)),
    )


def test_adjacent_registers_share_a_request() -> None:
    (block,) = blocks(GENERIC, READ, 125, 0)
    assert (block.address, block.count, block.gaps) == (0x100, 4, 0)
    assert [mapped.signal for mapped in block.signals] == list(READ)
    assert list(block.places) == [(0, 2), (2, 4), (4, 8)]


def test_the_order_of_addresses_decides_and_not_the_order_of_asking() -> None:
    assert blocks(GENERIC, READ[::-1], 125, 0) == blocks(GENERIC, READ, 125, 0)


def test_a_gap_is_read_through_only_where_it_pays_and_its_registers_exist() -> None:
    apart = with_line(placed(0x100, 0x104, 0x110), readable=())
    assert len(blocks(apart, READ, 125, 100)) == 3, "nobody says that what is between them exists"
    known = with_line(apart, readable=((0x100, 0x111),))
    (block,) = blocks(known, READ, 125, 11)
    assert (block.count, block.gaps, list(block.places)) == (18, 14, [(0, 2), (8, 10), (32, 36)])
    assert [each.count for each in blocks(known, READ, 125, 10)] == [5, 2], "a gap of 11 is dearer than a request"
    partly = with_line(apart, readable=((0x101, 0x103), (0x105, 0x10E)))
    assert [each.count for each in blocks(partly, READ, 125, 100)] == [5, 2], "0x10F may not exist"


def test_a_request_holds_no_more_than_the_drive_takes() -> None:
    assert [each.count for each in blocks(GENERIC, READ, 2, 0)] == [2, 2]
    with pytest.raises(ImageTooLargeError, match="position needs 2 registers; a request may have 1"):
        blocks(GENERIC, READ, 1, 0)


@given(
    st.sets(st.sampled_from(READ), min_size=1),
    st.permutations([0x10, 0x11, 0x12]),
    st.integers(0, 40),
    st.integers(2, 125),
)
def test_every_signal_is_read_once_and_gaps_are_no_larger_than_allowed(
    asked: set[Signal], order: list[int], spread: int, longest: int
) -> None:
    at = [address + spread * address for address in order]
    profile = with_line(placed(at[0], at[1], at[2] + 200), readable=((0, 0xFFFF),))
    found = blocks(profile, tuple(asked), longest, 30)
    assert {mapped.signal for block in found for mapped in block.signals} == asked
    assert sum(len(block.signals) for block in found) == len(asked)
    for block in found:
        assert block.count <= longest
        ends = [end for _, end in block.places]
        assert all(0 <= begin - end <= 60 for (begin, _), end in zip(list(block.places)[1:], ends, strict=False))
        assert ends[-1] == 2 * block.count, "no register behind the last signal"


def test_a_register_is_named_by_its_address_and_its_object() -> None:
    assert str(GENERIC.torque.target) == "register 0201h target torque"
    assert GENERIC.watchdog is not None
    assert str(GENERIC.watchdog.time) == "register 0204h"


def test_the_word_order_of_the_profile_is_that_of_wide_registers_alone() -> None:
    low_first = with_line(word_order="low first").offers()
    assert low_first[Signal.POSITION].order is Order.BIG_LOW_WORD_FIRST
    assert low_first[Signal.STATUSWORD].order is Order.BIG
    assert {mapped.order for mapped in GENERIC.offers().values()} == {Order.BIG}
