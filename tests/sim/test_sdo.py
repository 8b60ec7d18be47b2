"""CiA 301, 7.2.4.3: the SDO server, octet by octet."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.dictionary import Access, Dictionary, Entry
from haptic_fieldbus.sim.sdo import SdoServer

TEXT = b"maxon EPOS4 seen from afar"


def _server(text: bytes = TEXT) -> SdoServer:
    return SdoServer(
        Dictionary(
            [
                Entry(0x2000, 0, DataType.UINT32, 0x04030201, Access.RW),
                Entry(0x2001, 2, DataType.UINT16, 0xBEEF, Access.RW),
                Entry(0x2002, 0, DataType.INT8, -1, Access.RW),
                Entry(0x1008, 0, None, text=text),
            ]
        )
    )


def _abort(index: int, subindex: int, code: int) -> bytes:
    return bytes((0x80, *index.to_bytes(2, "little"), subindex)) + code.to_bytes(4, "little")


@pytest.mark.parametrize(
    ("request_", "response"),
    [
        ("40 00 20 00 00 00 00 00", "43 00 20 00 01 02 03 04"),
        ("40 01 20 02 00 00 00 00", "4b 01 20 02 ef be 00 00"),
        ("40 02 20 00 00 00 00 00", "4f 02 20 00 ff 00 00 00"),
        ("23 00 20 00 0a 0b 0c 0d", "60 00 20 00 00 00 00 00"),
        ("2b 01 20 02 34 12 00 00", "60 01 20 02 00 00 00 00"),
        ("2f 02 20 00 05 00 00 00", "60 02 20 00 00 00 00 00"),
        ("22 01 20 02 34 12 00 00", "60 01 20 02 00 00 00 00"),
        ("40 03 20 00 00 00 00 00", "80 03 20 00 00 00 02 06"),
        ("40 01 20 03 00 00 00 00", "80 01 20 03 11 00 09 06"),
        ("2f 00 20 00 05 00 00 00", "80 00 20 00 13 00 07 06"),
        ("23 01 20 02 05 00 00 00", "80 01 20 02 12 00 07 06"),
        ("22 08 10 00 05 00 00 00", "80 08 10 00 02 00 01 06"),
        ("a0 08 10 00 7f 00 00 00", "80 08 10 00 01 00 04 05"),
        ("c6 08 10 00 0a 00 00 00", "80 08 10 00 01 00 04 05"),
        ("e0 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
        ("60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
        ("00 11 22 33 44 55 66 77", "80 11 22 33 01 00 04 05"),
    ],
)
def test_each_request_has_its_response(request_: str, response: str) -> None:
    answer = _server().request(bytes.fromhex(request_))
    assert answer is not None
    assert answer.hex(" ") == response


def test_a_written_value_is_read_back() -> None:
    server = _server()
    server.request(bytes.fromhex("2b 01 20 02 34 12 00 00"))
    assert server.request(bytes.fromhex("40 01 20 02 00 00 00 00")) == bytes.fromhex("4b 01 20 02 34 12 00 00")


def test_an_abort_and_a_frame_that_is_not_eight_octets_long_are_not_answered() -> None:
    server = _server()
    assert server.request(_abort(0x2000, 0, 0x0504_0000)) is None
    assert server.request(b"\x40\x00\x20\x00") is None


def _upload(server: SdoServer) -> bytes:
    """What a client does that knows segments."""
    response = server.request(bytes.fromhex("40 08 10 00 00 00 00 00"))
    assert response is not None
    if response[0] & 0x02:
        return response[4 : 8 - (response[0] >> 2 & 3)]
    size, data, toggle = int.from_bytes(response[4:], "little"), b"", 0
    while True:
        response = server.request(bytes((0x60 | toggle << 4,)).ljust(8, b"\0"))
        assert response is not None
        assert response[0] >> 4 == toggle
        data += response[1 : 8 - (response[0] >> 1 & 7)]
        toggle ^= 1
        if response[0] & 1:
            assert len(data) == size
            return data


@given(st.binary(max_size=40))
def test_text_of_any_length_is_uploaded_whole(text: bytes) -> None:
    assert _upload(_server(text)) == text


class TestSegments:
    """Segmented transfers that go wrong."""

    def _begun(self) -> SdoServer:
        server = _server()
        server.request(bytes.fromhex("40 08 10 00 00 00 00 00"))
        return server

    def test_a_wrong_toggle_bit_ends_the_transfer(self) -> None:
        server = self._begun()
        assert server.request(bytes.fromhex("70 00 00 00 00 00 00 00")) == _abort(0x1008, 0, 0x0503_0000)
        answer = server.request(bytes.fromhex("60 00 00 00 00 00 00 00"))
        assert answer is not None
        assert answer[0] == 0x80

    def test_a_download_segment_inside_an_upload_is_refused(self) -> None:
        assert self._begun().request(bytes(8)) == _abort(0x1008, 0, 0x0504_0001)

    def test_the_client_may_give_up(self) -> None:
        server = self._begun()
        server.request(_abort(0x1008, 0, 0x0800_0000))
        answer = server.request(bytes.fromhex("60 00 00 00 00 00 00 00"))
        assert answer is not None
        assert answer[0] == 0x80

    def test_a_reset_of_the_node_forgets_the_transfer(self) -> None:
        server = self._begun()
        server.reset()
        answer = server.request(bytes.fromhex("60 00 00 00 00 00 00 00"))
        assert answer is not None
        assert answer[0] == 0x80

    @pytest.mark.parametrize(("head", "size"), [("21", 4), ("20", 0)])
    def test_a_value_may_be_downloaded_in_segments(self, head: str, size: int) -> None:
        server = _server()
        begin = server.request(bytes.fromhex(f"{head} 00 20 00") + size.to_bytes(4, "little"))
        assert begin == bytes.fromhex("60 00 20 00 00 00 00 00")
        assert server.request(bytes.fromhex("0a 11 22 00 00 00 00 00")) == bytes.fromhex("20 00 00 00 00 00 00 00")
        assert server.request(bytes.fromhex("1b 33 44 00 00 00 00 00")) == bytes.fromhex("30 00 00 00 00 00 00 00")
        assert server.request(bytes.fromhex("40 00 20 00 00 00 00 00")) == bytes.fromhex("43 00 20 00 11 22 33 44")

    def test_a_download_of_another_length_than_announced_is_refused(self) -> None:
        server = _server()
        server.request(bytes.fromhex("21 00 20 00 05 00 00 00"))
        assert server.request(bytes.fromhex("07 11 22 33 44 00 00 00")) == _abort(0x2000, 0, 0x0607_0010)

    def test_a_download_in_segments_too_long_for_its_entry_is_refused(self) -> None:
        server = _server()
        server.request(bytes.fromhex("20 00 20 00 00 00 00 00"))
        assert server.request(bytes.fromhex("05 11 22 33 44 55 00 00")) == _abort(0x2000, 0, 0x0607_0012)


def test_an_access_can_be_made_to_fail() -> None:
    server = _server()
    server.refuse[0x2000, 0] = 0x0800_0021
    assert server.request(bytes.fromhex("40 00 20 00 00 00 00 00")) == _abort(0x2000, 0, 0x0800_0021)
    assert server.request(bytes.fromhex("23 00 20 00 00 00 00 00")) == _abort(0x2000, 0, 0x0800_0021)
