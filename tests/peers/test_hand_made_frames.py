"""python-can alone: every octet written out here, from CiA 301 and CiA 402-2, turns the shaft."""

import struct
import time
from collections.abc import Iterator

import can
import pytest

from tests.peers.conftest import LONG
from tests.peers.hosts import Reach

pytestmark = pytest.mark.xdist_group("peers")

NODE = 5
NMT, SYNC, EMERGENCY, TPDO1, RPDO1 = 0x000, 0x080, 0x080 + NODE, 0x180 + NODE, 0x200 + NODE
SDO_RESPONSE, SDO_REQUEST, HEARTBEAT = 0x580 + NODE, 0x600 + NODE, 0x700 + NODE

# Statusword, of the bits of 006Fh: switch on disabled, ready to switch on, switched on, operation enabled.
DISABLED, READY, SWITCHED_ON, ENABLED = 0x40, 0x21, 0x23, 0x27


@pytest.fixture
def bus(reach: Reach) -> Iterator[can.BusABC]:
    with can.Bus(**reach.options) as subject:
        _send(subject, NMT, bytes((129, NODE)))
        assert _next(subject, HEARTBEAT) == b"\0"
        yield subject


def _send(bus: can.BusABC, can_id: int, data: bytes) -> None:
    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def _next(bus: can.BusABC, can_id: int) -> bytes:
    deadline = time.monotonic() + LONG
    while time.monotonic() < deadline:
        message = bus.recv(0.5)
        if message is not None and message.arbitration_id == can_id:
            return bytes(message.data)
    raise AssertionError(f"no frame {can_id:03X}h")


def _sdo(bus: can.BusABC, request: str) -> bytes:
    _send(bus, SDO_REQUEST, bytes.fromhex(request))
    return _next(bus, SDO_RESPONSE)


def _state(bus: can.BusABC) -> tuple[int, int]:
    """Statusword (its state) and position after a SYNC."""
    _send(bus, SYNC, b"")
    statusword, position = struct.unpack("<Hi", _next(bus, TPDO1))
    return statusword & 0x6F, position


CONFIGURATION = (
    # TPDO1: off, at every SYNC, statusword (16 bit) and position actual value (32 bit), on
    "23 00 18 01 85 01 00 80", "2F 00 18 02 01 00 00 00", "2F 00 1A 00 00 00 00 00",
    "23 00 1A 01 10 00 41 60", "23 00 1A 02 20 00 64 60", "2F 00 1A 00 02 00 00 00", "23 00 18 01 85 01 00 40",
    # RPDO1: off, at once, controlword (16 bit) and target torque (16 bit), on
    "23 00 14 01 05 02 00 80", "2F 00 14 02 FF 00 00 00", "2F 00 16 00 00 00 00 00",
    "23 00 16 01 10 00 40 60", "23 00 16 02 10 00 71 60", "2F 00 16 00 02 00 00 00", "23 00 14 01 05 02 00 00",
    # modes of operation: cyclic synchronous torque
    "2F 60 60 00 0A 00 00 00",
)  # fmt: skip


def test_the_drive_is_brought_to_operation_enabled_and_turns(bus: can.BusABC) -> None:
    assert _sdo(bus, "40 00 10 00 00 00 00 00") == bytes.fromhex("43 00 10 00 92 01 02 00")
    for request in CONFIGURATION:
        assert _sdo(bus, request) == bytes((0x60, *bytes.fromhex(request)[1:4], 0, 0, 0, 0)), request
    _send(bus, NMT, bytes((1, NODE)))
    assert _state(bus)[0] in (DISABLED, DISABLED | 0x20)
    for controlword, state in ((0x06, READY), (0x07, SWITCHED_ON), (0x0F, ENABLED)):
        _send(bus, RPDO1, struct.pack("<Hh", controlword, 0))
        _until(bus, state)
    _, start = _state(bus)
    _send(bus, RPDO1, struct.pack("<Hh", 0x0F, -100))
    deadline = time.monotonic() + LONG
    while _state(bus)[1] > start - 4096:
        assert time.monotonic() < deadline
    _send(bus, RPDO1, struct.pack("<Hh", 0x00, 0))
    _until(bus, DISABLED)


def _until(bus: can.BusABC, state: int) -> None:
    deadline = time.monotonic() + LONG
    while _state(bus)[0] & 0x4F != state & 0x4F:
        assert time.monotonic() < deadline


@pytest.mark.thorough("waits in real time", quick=1)
def test_frames_of_the_wrong_length_are_answered_or_ignored_and_nothing_breaks(bus: can.BusABC) -> None:
    for can_id in (NMT, SYNC, SDO_REQUEST, RPDO1, EMERGENCY, 0x77F, 0x7E5, 0x100):
        for length in range(9):
            _send(bus, can_id, bytes(length))
    bus.send(can.Message(arbitration_id=0x18FF_0005, data=bytes(8), is_extended_id=True))
    bus.send(can.Message(arbitration_id=TPDO1, is_remote_frame=True, dlc=6, is_extended_id=False))
    _send(bus, NMT, bytes((129, NODE)))
    assert _next(bus, HEARTBEAT) == b"\0"
    deadline = time.monotonic() + LONG
    while _sdo(bus, "40 00 10 00 00 00 00 00")[:4] != bytes.fromhex("43 00 10 00"):  # refusals of the above come first
        assert time.monotonic() < deadline
