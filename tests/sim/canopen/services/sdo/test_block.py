"""CiA 301, 7.2.4.3.9 to 7.2.4.3.16: block transfers, whole whatever is lost on the way."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.canopen.services.communication import add_user_data_memory
from haptic_fieldbus.sim.canopen.services.sdo import SdoServer, crc
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry

INDEX = 0x5FF0
HEAD = INDEX.to_bytes(2, "little") + b"\1"
Lost = Callable[[], bool]


def _server() -> SdoServer:
    dictionary = Dictionary([Entry(0x2000, 0, DataType.UINT32, 5, Access.RW)])
    add_user_data_memory(dictionary)
    return SdoServer(dictionary)


def _code(responses: list[bytes]) -> int:
    (response,) = responses
    assert response[0] == 0x80
    return int.from_bytes(response[4:], "little")


def _bitwise(octets: bytes) -> int:
    """CRC of CiA 301, 7.2.4.3.16, from its polynomial, a bit at a time."""
    register = 0
    for octet in octets:
        register ^= octet << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return register


@given(st.binary(max_size=200))
def test_the_crc_is_that_of_its_polynomial(octets: bytes) -> None:
    assert crc(octets) == _bitwise(octets)


def test_the_crc_of_the_standards_example() -> None:
    assert crc(b"123456789") == 0x31C3


def _download(server: SdoServer, content: bytes, lost: Lost, head: bytes = HEAD) -> list[bytes]:
    """A client that sends what is not confirmed again; returns the response to its end."""
    (begun,) = server.request(b"\xc6" + head + len(content).to_bytes(4, "little"))
    assert begun[:4] == b"\xa4" + head
    parts = [content[start : start + 7] for start in range(0, max(len(content), 1), 7)]
    block = begun[4]
    while parts:
        confirmation: list[bytes] = []
        sent = parts[:block]
        for number, part in enumerate(sent, start=1):
            last = number == len(parts)
            # The last of a block must arrive, or the client waits for ever.
            if number < len(sent) and lost():
                continue
            confirmation += server.request(bytes((number | (0x80 if last else 0),)) + part.ljust(7, b"\xff"))
        ((command, confirmed, block, *_),) = confirmation
        assert command == 0xA2
        del parts[:confirmed]
    unused = (-len(content)) % 7 if content else 7
    return server.request(bytes((0xC1 | unused << 2,)) + _bitwise(content).to_bytes(2, "little") + bytes(5))


def _upload(server: SdoServer, lost: Lost, block: int = 127) -> bytes:
    """A client that confirms what came in order."""
    (begun,) = server.request(b"\xa4" + HEAD + bytes((block, 0, 0, 0)))
    assert begun[:4] == b"\xc6" + HEAD
    content = b""
    segments = server.request(b"\xa3" + bytes(7))
    while segments[0][0] & 0x7F == 1 and segments[0][0] != 0xC1:
        confirmed = 0
        for number, segment in enumerate(segments, start=1):
            if number != confirmed + 1 or (number > 1 and lost()):
                continue
            assert segment[0] & 0x7F == number
            assert (segment[0] & 0x80 != 0) <= (number == len(segments))
            content += segment[1:]
            confirmed = number
        segments = server.request(bytes((0xA2, confirmed, block, 0, 0, 0, 0, 0)))
    (end,) = segments
    content = content[: len(content) - (end[0] >> 2 & 7)]
    assert end[0] & 0xE3 == 0xC1
    assert int.from_bytes(end[1:3], "little") == _bitwise(content)
    assert len(content) == int.from_bytes(begun[4:], "little")
    assert server.request(b"\xa1" + bytes(7)) == []
    assert not server.busy
    return content


@given(st.binary(max_size=3000), st.randoms(use_true_random=False), st.integers(1, 127), st.integers(0, 40))
def test_what_is_sent_comes_back_whatever_is_lost(content: bytes, random: object, block: int, percent: int) -> None:
    draw: Callable[[int], int] = random.randrange  # type: ignore[attr-defined]
    server = _server()
    server.block_size = block

    def lost() -> bool:
        return draw(100) < percent

    assert _download(server, content, lost) == [b"\xa1" + bytes(7)]
    assert _upload(server, lost, block) == content


def test_a_value_travels_in_a_block_too() -> None:
    server = _server()
    assert _download(server, b"\1\2\3\4", lambda: False, b"\0\x20\0") == [b"\xa1" + bytes(7)]
    assert server.request(b"\x40\0\x20\0" + bytes(4)) == [b"\x43\0\x20\0\1\2\3\4"]


def test_more_than_the_entry_takes_is_refused_at_once() -> None:
    server = _server()
    assert _code(server.request(b"\xc2\0\x20\0\5\0\0\0")) == 0x0607_0012
    server.request(b"\xc0\0\x20\0" + bytes(4))
    assert server.request(b"\1" + bytes(7)) == []
    assert _code(server.request(b"\2" + bytes(7))) == 0x0607_0012


def test_another_length_than_announced_is_refused() -> None:
    server = _server()
    server.request(b"\xc2" + HEAD + b"\x08\0\0\0")
    server.request(b"\x81" + bytes(7))
    assert _code(server.request(b"\xc1" + bytes(7))) == 0x0607_0010


@pytest.mark.parametrize("command", [0xC0, 0xC3])
def test_the_end_of_a_download_must_be_one(command: int) -> None:
    server = _server()
    server.request(b"\xc2" + HEAD + b"\x07\0\0\0")
    server.request(b"\x81" + bytes(7))
    (response,) = server.request(bytes((command,)) + b"\xf1\x5f\1" + bytes(4))
    assert response[:4] == b"\x80" + HEAD
    assert response[4:] == b"\1\0\4\5"


@pytest.mark.parametrize("command", [0xA1, 0xA2])
def test_an_upload_begins_with_its_start(command: int) -> None:
    server = _server()
    server.request(b"\xa4" + HEAD + b"\x10\0\0\0")
    assert _code(server.request(bytes((command,)) + bytes(7))) == 0x0504_0001


def test_a_segment_beyond_the_block_is_out_of_sequence() -> None:
    server = _server()
    server.block_size = 4
    server.request(b"\xc2" + HEAD + b"\x40\0\0\0")
    assert _code(server.request(b"\5" + bytes(7))) == 0x0504_0003


def test_the_next_block_may_not_be_empty() -> None:
    server = _server()
    _download(server, bytes(100), lambda: False)
    server.request(b"\xa4" + HEAD + b"\2\0\0\0")
    assert len(server.request(b"\xa3" + bytes(7))) == 2
    assert _code(server.request(b"\xa2\2\0" + bytes(5))) == 0x0504_0002


class TestMemory:
    """5FF0h and 5FF2h, the drive's memory for its user's data."""

    def test_both_blocks_share_48_kib(self) -> None:
        server = _server()
        second = HEAD[:2] + b"\2"
        assert _download(server, bytes(32 * 1024), lambda: False) == [b"\xa1" + bytes(7)]
        assert _code(_download(server, bytes(16 * 1024 + 1), lambda: False, second)) == 0x0504_0005
        assert _download(server, bytes(16 * 1024), lambda: False, second) == [b"\xa1" + bytes(7)]

    def test_a_word_empties_them(self) -> None:
        server = _server()
        _download(server, bytes(100), lambda: False)
        assert _code(server.request(b"\x23\xf2\x5f\0oops")) == 0x0609_0030
        server.request(b"\x23\xf2\x5f\0eras")
        assert _upload(server, lambda: False) == b""


def test_time_out_without_a_transfer_says_nothing() -> None:
    assert _server().expire() == []
