"""Blocks of registers against a table of words that is kept by hand, for both orders of the words."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.protocols.modbus.profile import LineSection, Register
from haptic_fieldbus.sim.drive.dictionary import Access, Entry
from haptic_fieldbus.sim.modbus.registers import Refusal, Registers
from tests.sim.modbus.units import changed

FIRST = 0x40
TYPES = st.lists(
    st.sampled_from((DataType.INT16, DataType.UINT16, DataType.INT32, DataType.UINT32)), min_size=1, max_size=6
)
ORDERS = pytest.mark.parametrize("order", ["high first", "low first"])


def line_with(order: str) -> LineSection:
    return changed(word_order=order).line


def table(order: str, types: Sequence[DataType]) -> tuple[Registers, list[Entry]]:
    """Registers of these types one after another from `FIRST` on, and their entries."""
    registers, entries, address = Registers(line_with(order)), [], FIRST
    for type_ in types:
        entries.append(Entry(0, 0, type_, access=Access.RW))
        registers.add(Register(address, type_), entries[-1])
        address += registers_of(type_)
    return registers, entries


def registers_of(type_: DataType) -> int:
    return type_.size // 2


def octets_of(value: int, type_: DataType, order: str) -> bytes:
    """The octets of a value: its words in an order, and in each word the high octet first."""
    words = [value >> 16 * place & 0xFFFF for place in range(registers_of(type_))]
    return b"".join(word.to_bytes(2, "big") for word in (words if order == "low first" else words[::-1]))


@ORDERS
@given(TYPES, st.data())
def test_what_is_written_is_stored_and_read_back(order: str, types: Sequence[DataType], data: st.DataObject) -> None:
    registers, entries = table(order, types)
    values = [data.draw(st.integers(*type_.limits)) for type_ in types]
    octets = b"".join(octets_of(value, type_, order) for value, type_ in zip(values, types, strict=True))
    assert registers.write(FIRST, octets) == tuple(entries)
    assert [entry.value for entry in entries] == values
    reader = registers.reader(3, FIRST, len(octets) // 2)
    assert not isinstance(reader, Refusal)
    assert reader() == octets
    entries[0].value = 5
    assert reader() == octets_of(5, types[0], order) + octets[2 * registers_of(types[0]) :]


@ORDERS
def test_an_entry_with_more_bits_than_its_register_is_cut_off_and_one_with_fewer_is_filled_up(order: str) -> None:
    registers = Registers(line_with(order))
    registers.add(Register(FIRST, DataType.INT16), Entry(0, 0, DataType.INT32, -70000))
    registers.add(Register(FIRST + 1, DataType.INT32), Entry(0, 0, DataType.INT8, -2))
    reader = registers.reader(3, FIRST, 3)
    assert not isinstance(reader, Refusal)
    wide = b"\xff\xff\xff\xfe" if order == "high first" else b"\xff\xfe\xff\xff"
    assert reader() == (-70000 & 0xFFFF).to_bytes(2, "big") + wide


def test_a_value_that_its_entry_refuses_keeps_the_others_from_being_written_and_nobody_is_told() -> None:
    registers, (first, second) = table("high first", (DataType.UINT16, DataType.INT16))
    told: list[int] = []
    first.changed = second.changed = lambda: told.append(first.value)
    second.low, second.high = -5, 5
    assert registers.write(FIRST, b"\0\7\0\6") is Refusal.VALUE
    assert (first.value, told) == (0, [])
    assert registers.write(FIRST, b"\0\7\xff\xfb") == (first, second)
    assert (first.value, second.value, told) == (7, -5, [7])
