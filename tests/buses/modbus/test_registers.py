"""Values in registers of 16 bits, in both orders of words, against struct."""

import struct

import pytest

from haptic_fieldbus.buses.modbus.unit import from_words, to_words
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.protocols.modbus.profile import Register, WordOrder

CODES = {DataType.INT16: "h", DataType.UINT16: "H", DataType.INT32: "i", DataType.UINT32: "I"}


@pytest.mark.parametrize("order", ["high first", "low first"])
@pytest.mark.parametrize("kind", CODES)
def test_registers_hold_a_value_in_the_order_of_the_drive(kind: DataType, order: WordOrder) -> None:
    register = Register(7, kind)
    for value in (*kind.limits, 0, 1, 0x1234, kind.limits[1] // 3):
        octets = struct.pack(f">{CODES[kind]}", value)
        high_first = struct.unpack(f">{register.count}H", octets)
        words = to_words(register, value, order)
        assert words == (high_first if order == "high first" else high_first[::-1])
        assert from_words(register, words, order) == value


def test_a_value_that_does_not_fit_is_refused() -> None:
    with pytest.raises(struct.error):
        to_words(Register(7, DataType.UINT16), 0x1_0000, "high first")
