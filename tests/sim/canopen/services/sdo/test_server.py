"""CiA 301, 7.2.4.3: the SDO server, octet by octet."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.canopen.services.sdo import SdoServer
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry

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


def _ask(server: SdoServer, request: bytes) -> bytes:
    """One request that has one response."""
    (response,) = server.request(request)
    return response


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
        ("a0 08 10 00 7f 00 00 00", "c2 08 10 00 1a 00 00 00"),
        ("a0 08 10 00 80 00 00 00", "80 08 10 00 02 00 04 05"),
        ("c6 08 10 00 0a 00 00 00", "80 08 10 00 02 00 01 06"),
        ("c6 00 20 00 05 00 00 00", "80 00 20 00 12 00 07 06"),
        ("c1 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
        ("a2 05 7f 00 00 00 00 00", "80 05 7f 00 01 00 04 05"),
        ("21 00 20 00 03 00 00 00", "80 00 20 00 13 00 07 06"),
        ("e0 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
        ("60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
        ("00 11 22 33 44 55 66 77", "80 11 22 33 01 00 04 05"),
    ],
)
def test_each_request_has_its_response(request_: str, response: str) -> None:
    assert _ask(_server(), bytes.fromhex(request_)).hex(" ") == response


def test_a_written_value_is_read_back() -> None:
    server = _server()
    server.request(bytes.fromhex("2b 01 20 02 34 12 00 00"))
    assert _ask(server, bytes.fromhex("40 01 20 02 00 00 00 00")) == bytes.fromhex("4b 01 20 02 34 12 00 00")


def test_an_abort_and_a_frame_that_is_not_eight_octets_long_are_not_answered() -> None:
    server = _server()
    assert server.request(_abort(0x2000, 0, 0x0504_0000)) == []
    assert server.request(b"\x40\x00\x20\x00") == []


def _upload(server: SdoServer) -> bytes:
    """Transfers of a client that knows segments."""
    response = _ask(server, bytes.fromhex("40 08 10 00 00 00 00 00"))
    if response[0] & 0x02:
        return response[4 : 8 - (response[0] >> 2 & 3)]
    size, data, toggle = int.from_bytes(response[4:], "little"), b"", 0
    while True:
        response = _ask(server, bytes((0x60 | toggle << 4,)).ljust(8, b"\0"))
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
        assert _ask(server, bytes.fromhex("70 00 00 00 00 00 00 00")) == _abort(0x1008, 0, 0x0503_0000)
        assert _ask(server, bytes.fromhex("60 00 00 00 00 00 00 00"))[0] == 0x80

    def test_a_download_segment_inside_an_upload_is_refused(self) -> None:
        assert _ask(self._begun(), bytes(8)) == _abort(0x1008, 0, 0x0504_0001)

    def test_the_client_may_give_up(self) -> None:
        server = self._begun()
        server.request(_abort(0x1008, 0, 0x0800_0000))
        assert _ask(server, bytes.fromhex("60 00 00 00 00 00 00 00"))[0] == 0x80

    def test_a_reset_of_the_node_forgets_the_transfer(self) -> None:
        server = self._begun()
        server.reset()
        assert _ask(server, bytes.fromhex("60 00 00 00 00 00 00 00"))[0] == 0x80

    @pytest.mark.parametrize(("head", "size"), [("21", 4), ("20", 0)])
    def test_a_value_may_be_downloaded_in_segments(self, head: str, size: int) -> None:
        server = _server()
        begin = _ask(server, bytes.fromhex(f"{head} 00 20 00") + size.to_bytes(4, "little"))
        assert begin == bytes.fromhex("60 00 20 00 00 00 00 00")
        assert _ask(server, bytes.fromhex("0a 11 22 00 00 00 00 00")) == bytes.fromhex("20 00 00 00 00 00 00 00")
        assert _ask(server, bytes.fromhex("1b 33 44 00 00 00 00 00")) == bytes.fromhex("30 00 00 00 00 00 00 00")
        assert _ask(server, bytes.fromhex("40 00 20 00 00 00 00 00")) == bytes.fromhex("43 00 20 00 11 22 33 44")

    def test_a_download_of_another_length_than_announced_is_refused(self) -> None:
        server = _server()
        server.request(bytes.fromhex("21 00 20 00 04 00 00 00"))
        assert _ask(server, bytes.fromhex("09 11 22 33 00 00 00 00")) == _abort(0x2000, 0, 0x0607_0010)

    def test_a_wrong_length_is_refused_where_it_is_announced(self) -> None:
        begun = _ask(_server(), bytes.fromhex("21 00 20 00 05 00 00 00"))
        assert begun == _abort(0x2000, 0, 0x0607_0012)

    def test_a_download_in_segments_too_long_for_its_entry_is_refused(self) -> None:
        server = _server()
        server.request(bytes.fromhex("20 00 20 00 00 00 00 00"))
        assert _ask(server, bytes.fromhex("05 11 22 33 44 55 00 00")) == _abort(0x2000, 0, 0x0607_0012)


def test_an_access_can_be_made_to_fail() -> None:
    server = _server()
    server.refuse[0x2000, 0] = 0x0800_0021
    assert _ask(server, bytes.fromhex("40 00 20 00 00 00 00 00")) == _abort(0x2000, 0, 0x0800_0021)
    assert _ask(server, bytes.fromhex("23 00 20 00 00 00 00 00")) == _abort(0x2000, 0, 0x0800_0021)
