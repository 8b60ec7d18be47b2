"""CiA 301, 7.2.4.3.17 and 7.4.7: who may do what with an entry, and with what abort code it is refused."""

import pytest

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Dictionary, Entry, one_of


def _refusal(entry: Entry, data: bytes) -> int:
    with pytest.raises(AccessRefused) as caught:
        entry.write(data)
    return caught.value.code


@pytest.mark.parametrize("access", [Access.RO, Access.CONST])
def test_what_is_only_to_be_read_refuses_a_write(access: Access) -> None:
    assert _refusal(Entry(0x2000, 0, DataType.UINT8, access=access), b"\1") == AbortCode.READ_ONLY.value


def test_what_is_only_to_be_written_refuses_a_read() -> None:
    with pytest.raises(AccessRefused, match="06010001h"):
        Entry(0x2000, 0, DataType.UINT8, access=Access.WO).read()


@pytest.mark.parametrize(
    ("data", "code"), [(b"\1", AbortCode.TOO_SHORT), (b"\1\0\0", AbortCode.TOO_LONG), (b"", AbortCode.TOO_SHORT)]
)
def test_the_length_must_be_that_of_the_type(data: bytes, code: AbortCode) -> None:
    assert _refusal(Entry(0x2000, 0, DataType.UINT16, access=Access.RW), data) == code.value


@pytest.mark.parametrize(("value", "code"), [(11, AbortCode.VALUE_TOO_HIGH), (-6, AbortCode.VALUE_TOO_LOW)])
def test_a_value_outside_its_limits_is_refused_and_the_old_one_stays(value: int, code: AbortCode) -> None:
    entry = Entry(0x2000, 0, DataType.INT8, 3, Access.RW, limits=(-5, 10))
    assert _refusal(entry, DataType.INT8.pack(value)) == code.value
    assert entry.value == 3


def test_a_value_that_is_not_one_of_the_codes_is_refused() -> None:
    entry = Entry(0x2000, 0, DataType.UINT8, 1, Access.RW, accept=one_of((1, 4)))
    assert _refusal(entry, b"\2") == AbortCode.INVALID_VALUE.value
    entry.write(b"\4")
    assert entry.value == 4


def test_a_write_is_told_to_the_drive_after_it_was_made() -> None:
    entry = Entry(0x2000, 0, DataType.INT16, 0, Access.RW)
    seen: list[int] = []
    entry.changed = lambda: seen.append(entry.value)
    entry.write(b"\xfe\xff")
    assert seen == [-2]
    assert entry.read() == b"\xfe\xff"


def test_a_live_value_is_fetched_at_each_read() -> None:
    entry = Entry(0x2000, 0, DataType.UINT16)
    entry.fetch = iter((1, 2)).__next__
    assert [entry.read(), entry.read()] == [b"\1\0", b"\2\0"]


def test_a_string_is_read_whole_and_never_written() -> None:
    entry = Entry(0x1008, 0, None, access=Access.RW, text=b"drive")
    assert entry.read() == b"drive"
    assert entry.bits == 40
    assert _refusal(entry, b"x") == AbortCode.READ_ONLY.value


def test_a_missing_object_and_a_missing_subindex_are_told_apart() -> None:
    dictionary = Dictionary([Entry(0x2000, 1, DataType.UINT8)])
    assert 0x2000 in dictionary
    with pytest.raises(AccessRefused, match="06020000h"):
        dictionary.find(0x2001)
    with pytest.raises(AccessRefused, match="06090011h"):
        dictionary.find(0x2000, 2)


def test_a_record_says_its_highest_subindex() -> None:
    dictionary = Dictionary()
    dictionary.add_record([Entry(0x2000, 1, DataType.UINT8), Entry(0x2000, 4, DataType.UINT8)])
    assert dictionary.value(0x2000) == 4
    assert dictionary.find(0x2000).access is Access.CONST


def test_power_on_values_come_back_in_the_range_asked_for_only() -> None:
    dictionary = Dictionary([Entry(0x1017, 0, DataType.UINT16, 7, Access.RW), Entry(0x6060, 0, DataType.INT8)])
    for entry in dictionary:
        entry.value = 1
    dictionary.restore(0x1000, 0x1FFF)
    assert (dictionary.value(0x1017), dictionary.value(0x6060)) == (7, 1)


def test_what_a_model_does_not_have_is_removed() -> None:
    dictionary = Dictionary([Entry(0x2000, 1, DataType.UINT8), Entry(0x2000, 2, DataType.UINT8)])
    dictionary.remove(0x2000, 2)
    dictionary.remove(0x2001)
    dictionary.remove(0x2001, 1)
    assert [entry.subindex for entry in dictionary] == [1]
    dictionary.remove(0x2000)
    assert 0x2000 not in dictionary


def test_power_on_values_with_the_node_id_follow_it() -> None:
    dictionary = Dictionary()
    follows = dictionary.add(Entry(0x1014, 0, DataType.UINT32, 0x85, numbered=True))
    stays = dictionary.add(Entry(0x1005, 0, DataType.UINT32, 0x80))
    dictionary.renumber(3)
    assert (follows.value, follows.default, stays.default) == (0x85, 0x88, 0x80)


def test_octets_are_written_up_to_their_capacity() -> None:
    entry = Entry(0x2000, 0, None, access=Access.RW, text=b"old", limits=(0, 5))
    assert _refusal(entry, b"123456") == AbortCode.TOO_LONG.value
    entry.write(b"12345")
    assert entry.read() == b"12345"
    entry.write(b"")
    assert entry.read() == b""
    entry.reset()
    assert entry.read() == b"old"


def test_a_value_of_one_length_is_refused_before_its_octets_arrive() -> None:
    entry = Entry(0x2000, 0, DataType.UINT16, access=Access.RW)
    entry.begin_write(None)
    entry.begin_write(2)
    for size, code in ((1, AbortCode.TOO_SHORT), (3, AbortCode.TOO_LONG)):
        with pytest.raises(AccessRefused, match=f"{code.value:08X}h"):
            entry.begin_write(size)
