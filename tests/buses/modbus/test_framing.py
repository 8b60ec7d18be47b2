"""Frames against the examples of the standard and a checksum of our own; octets that are none are never an answer."""

import logging
import random
from collections.abc import Iterator
from dataclasses import replace

import pytest

from haptic_fieldbus.buses.modbus.framing import Answer, DroppedOctets, Framing, Question
from tests.buses.modbus.servers import crc

EXAMPLES = {
    "read holding registers, 6.3": (
        Question(17, 3, 0x6B, 3), "03 006B 0003", "03 06 022B 0000 0064", (0x22B, 0, 0x64),
    ),
    "read input registers, 6.4": (Question(17, 4, 8, 1), "04 0008 0001", "04 02 000A", (10,)),
    "write single register, 6.6": (Question(17, 6, 1, 0, (3,)), "06 0001 0003", "06 0001 0003", ()),
    "write multiple registers, 6.12": (
        Question(17, 16, 1, 0, (0xA, 0x102)), "10 0001 0002 04 000A 0102", "10 0001 0002", (),
    ),
    "read/write multiple registers, 6.17": (
        Question(17, 23, 3, 6, (0xFF,) * 3, 0xE),
        "17 0003 0006 000E 0003 06 00FF 00FF 00FF",
        "17 0C 00FE 0ACD 0001 0003 000D 00FF",
        (0xFE, 0xACD, 1, 3, 0xD, 0xFF),
    ),
}  # fmt: skip
"""Name and clause of the standard → question, PDU of the request, PDU of the answer, registers."""
READ = Question(17, 3, 0x6B, 2)
GOOD = bytes.fromhex("03 04 0001 0002")


def rtu(pdu: bytes, unit: int = 17) -> bytes:
    return bytes((unit,)) + pdu + crc(bytes((unit,)) + pdu)


def tcp(pdu: bytes, transaction: int = 1, unit: int = 17, protocol: int = 0) -> bytes:
    head = (transaction, protocol, len(pdu) + 1)
    return b"".join(each.to_bytes(2, "big") for each in head) + bytes((unit,)) + pdu


def framed(pdu: bytes, *, serial: bool) -> bytes:
    return rtu(pdu) if serial else tcp(pdu)


def asked(framing: Framing, question: Question) -> bytes:
    """The frame of a question, whose answer is expected from now on."""
    return bytes(framing.fill(framing.form(question)))


def test_the_checksum_is_that_of_a_published_frame() -> None:
    # Modbus over serial line 1.02, 6.2.2: the CRC of 02 07 is 1241h, sent low octet first.
    assert crc(bytes((2, 7))) == bytes((0x41, 0x12))


@pytest.mark.parametrize("serial", [True, False], ids=["rtu", "tcp"])
@pytest.mark.parametrize("example", EXAMPLES)
def test_requests_and_answers_are_those_of_the_standard(example: str, serial: bool) -> None:
    question, request, answer, registers = EXAMPLES[example]
    framing = Framing(serial=serial)
    assert asked(framing, question) == framed(bytes.fromhex(request), serial=serial)
    octets = framed(bytes.fromhex(answer), serial=serial)
    for short in range(len(octets)):
        assert framing.take(octets[:short]) == (0, None)
    used, found = framing.take(octets)
    assert used == len(octets)
    assert isinstance(found, Answer)
    assert found.registers == registers


@pytest.mark.parametrize("serial", [True, False], ids=["rtu", "tcp"])
def test_an_exception_is_an_answer_with_its_code(serial: bool) -> None:
    framing = Framing(serial=serial)
    asked(framing, READ)
    assert framing.take(framed(bytes((0x83, 2)), serial=serial))[1] == Answer(exception=2)


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        (rtu(GOOD, unit=18), DroppedOctets.UNIT),
        (rtu(GOOD)[:-1] + b"\x00", DroppedOctets.GARBAGE),
        (rtu(bytes.fromhex("03 06 0001 0002 0003")), DroppedOctets.SIZE),
        (rtu(bytes.fromhex("03 02 0001")), DroppedOctets.SIZE),
        (rtu(bytes.fromhex("04 04 0001 0002")), DroppedOctets.EARLIER),
        (rtu(bytes.fromhex("10 006B 0002")), DroppedOctets.EARLIER),
        (rtu(bytes((0x84, 2))), DroppedOctets.EARLIER),
    ],
    ids=["unit", "checksum", "too long", "too short", "function", "write", "exception to another function"],
)
def test_on_rtu_another_frame_is_no_answer(octets: bytes, why: DroppedOctets) -> None:
    framing = Framing(serial=True)
    asked(framing, READ)
    assert framing.take(octets) == (len(octets), why)


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        (tcp(GOOD, transaction=2), DroppedOctets.EARLIER),
        (tcp(GOOD, unit=18), DroppedOctets.UNIT),
        (tcp(GOOD, protocol=1), DroppedOctets.GARBAGE),
        (tcp(GOOD)[:4] + b"\xff\xff" + tcp(GOOD)[6:], DroppedOctets.GARBAGE),
        (tcp(GOOD)[:4] + b"\x00\x00" + tcp(GOOD)[6:], DroppedOctets.GARBAGE),
        (tcp(bytes.fromhex("03 06 0001 0002")), DroppedOctets.GARBAGE),
        (tcp(bytes.fromhex("03 02 0001 0002")), DroppedOctets.SIZE),
        (tcp(bytes.fromhex("2B 0E")), DroppedOctets.GARBAGE),
    ],
    ids=["transaction", "unit", "protocol", "length", "no length", "short", "byte count", "function"],
)
def test_on_tcp_another_frame_is_no_answer(octets: bytes, why: DroppedOctets) -> None:
    framing = Framing(serial=False)
    asked(framing, READ)
    assert framing.take(octets) == (len(octets), why)


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (Question(17, 6, 1, 0, (3,)), "06 0001 0004"),
        (Question(17, 6, 1, 0, (3,)), "06 0002 0003"),
        (Question(17, 16, 1, 0, (3, 4)), "10 0001 0001"),
        (Question(17, 16, 1, 0, (3, 4)), "10 0002 0002"),
    ],
)
def test_a_write_is_answered_by_what_it_wrote(question: Question, answer: str) -> None:
    framing = Framing(serial=True)
    asked(framing, question)
    assert framing.take(rtu(bytes.fromhex(answer)))[1] is DroppedOctets.EARLIER


def test_an_answer_that_comes_twice_counts_once() -> None:
    framing = Framing(serial=False)
    asked(framing, READ)
    assert framing.take(tcp(GOOD)) == (len(tcp(GOOD)), Answer(GOOD[2:]))
    assert framing.take(tcp(GOOD))[1] is DroppedOctets.EARLIER


@pytest.mark.parametrize("serial", [True, False], ids=["rtu", "tcp"])
@pytest.mark.parametrize(
    "question", [Question(17, 6, 1, 0, (3,)), Question(17, 16, 1, 0, (3, 4)), Question(17, 23, 5, 2, (3, 4), 1)]
)
def test_a_form_that_is_filled_is_the_frame_that_is_encoded_anew(question: Question, serial: bool) -> None:
    framing, other = Framing(serial=serial), Framing(serial=serial)
    form = framing.form(question)
    for value in (0, 7, 0xFFFF):
        values = tuple(value - at & 0xFFFF for at in range(len(question.values)))
        octets = b"".join(each.to_bytes(2, "big") for each in values)
        assert bytes(framing.fill(form, octets)) == asked(other, replace(question, values=values))


@pytest.mark.thorough("goes through all 65535 of them")
def test_transaction_ids_go_round_without_zero() -> None:
    framing = Framing(serial=False)
    ids = {int.from_bytes(asked(framing, READ)[:2], "big") for _ in range(0x10000)}
    assert ids == set(range(1, 0x10000))


def noise(draw: random.Random, serial: bool) -> Iterator[bytes]:
    """Octets of a bad line: at random, or a good answer that was twisted."""
    good = framed(GOOD, serial=serial)
    yield draw.randbytes(draw.randrange(1, 40))
    twisted = bytearray(good)
    twisted[draw.randrange(len(twisted))] ^= 1 << draw.randrange(8)
    yield bytes(twisted)
    yield good[: draw.randrange(len(good))] + draw.randbytes(draw.randrange(8))
    yield bytes((17, draw.choice((3, 4, 6, 16, 23, 0x2B, 0x83)))) + draw.randbytes(draw.randrange(30))


@pytest.mark.thorough("looks at 1e5 frames of noise", quick=("rtu-1000", "tcp-1000"))
@pytest.mark.parametrize("frames", [1000, 100_000])
@pytest.mark.parametrize("serial", [True, False], ids=["rtu", "tcp"])
def test_noise_never_raises_and_is_an_answer_only_by_the_chance_of_a_checksum(frames: int, serial: bool) -> None:
    framing, draw, taken, good = Framing(serial=serial), random.Random(5), 0, framed(GOOD, serial=serial)
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    for _ in range(frames // 4):
        for octets in noise(draw, serial):
            framing._transaction = 0  # the next is that of the twisted answers
            asked(framing, READ)
            used, found = framing.take(octets)
            assert 0 <= used <= len(octets)
            if isinstance(found, Answer):
                assert len(found.registers) == (2 if found.exception is None else 0)
                taken += not octets.startswith(good)
    # A checksum of 16 bits holds by chance, and no twist of one bit escapes it. A frame on TCP has none of its own.
    assert taken <= 3 + frames * 2**-15 or not serial


@pytest.mark.parametrize("tail", [b"\x00", b"\xff", b"\x11\x03"], ids=["zero", "ones", "begin of another"])
@pytest.mark.parametrize("example", EXAMPLES)
def test_octets_behind_the_answer_spoil_it_neither_of_a_read_nor_of_a_write(example: str, tail: bytes) -> None:
    """A glitch of the line that turns round comes in the same piece."""
    question, _, answer, registers = EXAMPLES[example]
    framing = Framing(serial=True)
    asked(framing, question)
    used, found = framing.take(rtu(bytes.fromhex(answer)) + tail)
    assert used >= len(rtu(bytes.fromhex(answer)))
    assert isinstance(found, Answer)
    assert found.registers == registers


@pytest.mark.parametrize("serial", [True, False], ids=["rtu", "tcp"])
def test_the_answer_to_another_write_is_none(serial: bool) -> None:
    for question, other in (
        (Question(17, 6, 1, 0, (3,)), "06 0001 0004"),
        (Question(17, 16, 1, 0, (0xA, 0x102)), "10 0002 0002"),
        (Question(17, 16, 1, 0, (0xA, 0x102)), "10 0001 0003"),
    ):
        framing = Framing(serial=serial)
        asked(framing, question)
        assert framing.take(framed(bytes.fromhex(other), serial=serial))[1] is DroppedOctets.EARLIER
