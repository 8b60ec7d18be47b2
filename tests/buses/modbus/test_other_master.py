"""Requests of somebody else among octets on a serial line: those that write to our units are told, and nothing else."""

import logging
import random
from types import SimpleNamespace
from typing import Any

import pytest

from haptic_fieldbus.buses.modbus.exchange import foreign_write, listen
from haptic_fieldbus.clock import VirtualClock
from tests.buses.modbus.servers import crc

OURS = {1, 2}


def frame(octets: str) -> bytes:
    body = bytes.fromhex(octets)
    return body + crc(body)


@pytest.mark.parametrize(
    ("octets", "address"),
    [
        (frame("01 10 0201 0001 02 0032"), 0x0201),
        (frame("02 17 0100 0002 0200 0001 02 000F"), 0x0200),
        (frame("00 10 0201 0001 02 0032"), 0x0201),
        (b"\xff\x00" + frame("01 10 0201 0001 02 0032"), 0x0201),
        (frame("03 10 0201 0001 02 0032"), None),
        (frame("01 03 0100 0004"), None),
        (frame("01 06 0201 0032"), None),
        (frame("01 10 0201 0001"), None),
        (frame("01 10 0201 0001 02 0032")[:-1] + b"\x00", None),
        (b"", None),
    ],
    ids=[
        "write", "write and read", "to everybody", "after noise", "another unit", "a question", "as an answer to FC6",
        "an answer", "bad checksum", "nothing",
    ],
)  # fmt: skip
def test_a_write_to_one_of_our_units_is_told_by_its_address(octets: bytes, address: int | None) -> None:
    assert foreign_write(octets, OURS) == address


def test_a_serial_line_is_listened_to_for_as_long_as_is_told() -> None:
    deadlines, clock = list[int](), VirtualClock()

    def nothing(deadline_ns: int) -> bytes:
        deadlines.append(deadline_ns - clock.now_ns())
        return b""

    transport = SimpleNamespace(serial=True)
    line: Any = SimpleNamespace(transport=transport, name="the line", clock=clock, listen=nothing)
    assert listen(line) == "the line: listened for 0.5 s without sending; received nothing"
    assert deadlines == [500_000_000]


def test_noise_of_any_function_never_raises() -> None:
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    draw = random.Random(3)
    for function in range(256):
        for _ in range(10):
            assert foreign_write(bytes((1, function)) + draw.randbytes(draw.randrange(20)), OURS) is None
