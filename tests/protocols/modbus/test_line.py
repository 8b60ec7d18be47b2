"""Octets and times of requests, against numbers counted in the standard and frames that pymodbus builds.

Modbus application protocol 1.1b3: 6.3, 6.4, 6.6, 6.12, 6.17; Modbus over serial line 1.02: 2.5.1.1.
"""

from typing import Any

import pytest
from pymodbus.framer.rtu import FramerRTU
from pymodbus.framer.socket import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu import register_message as pdus

from haptic_fieldbus.protocols.modbus.register_traffic import (
    Block,
    LineTimes,
    RegisterRequest,
    answer_octets,
    request_octets,
    serial_line,
    tcp_line,
)

FOUR, TWO, ONE = Block(0x100, 4, (), ()), Block(0x200, 2, (), ()), Block(0x200, 1, (), ())
# Function, number of registers and octets of the PDU: address 2, quantity 2, count of octets 1, value 2 a register.
COUNTED = [
    (RegisterRequest(3, read=FOUR), 5, 10),
    (RegisterRequest(4, read=FOUR), 5, 10),
    (RegisterRequest(6, write=ONE), 5, 5),
    (RegisterRequest(16, write=TWO), 10, 5),
    (RegisterRequest(23, read=FOUR, write=TWO), 14, 10),
]


def built(request: RegisterRequest) -> tuple[ModbusPDU, ModbusPDU]:
    """The request and its answer as pymodbus has them."""
    read, write = [7] * (request.read.count if request.read else 0), [7] * (request.write.count if request.write else 0)
    pairs: dict[int, tuple[Any, Any]] = {
        3: (pdus.ReadHoldingRegistersRequest(address=1, count=len(read)), pdus.ReadHoldingRegistersResponse),
        4: (pdus.ReadInputRegistersRequest(address=1, count=len(read)), pdus.ReadInputRegistersResponse),
        6: (pdus.WriteSingleRegisterRequest(address=1, registers=write), pdus.WriteSingleRegisterResponse),
        16: (pdus.WriteMultipleRegistersRequest(address=1, registers=write), pdus.WriteMultipleRegistersResponse),
        23: (
            pdus.ReadWriteMultipleRegistersRequest(read_address=1, read_count=len(read), write_registers=write),
            pdus.ReadWriteMultipleRegistersResponse,
        ),
    }
    asked, answer = pairs[request.function]
    return asked, answer(address=1, count=len(write), registers=read or write)


@pytest.mark.parametrize(("request_", "asked", "answered"), COUNTED, ids=lambda each: str(each)[:20])
def test_octets_are_those_of_the_standard_and_of_pymodbus(request_: RegisterRequest, asked: int, answered: int) -> None:
    assert (request_octets(request_), answer_octets(request_)) == (asked, answered)
    pair = built(request_)
    for framer, around in ((FramerRTU(DecodePDU(True)), 3), (FramerSocket(DecodePDU(True)), 7)):
        assert [len(framer.buildFrame(each)) for each in pair] == [asked + around, answered + around]
    assert serial_line(19200, 11, None).octets(request_) == asked + answered + 6
    assert tcp_line(None).octets(request_) == asked + answered + 14


@pytest.mark.parametrize(
    ("baud", "bits", "silence"),
    [(9600, 11, 3.5 * 11 / 9600), (19200, 10, 3.5 * 10 / 19200), (19201, 11, 1.75e-3), (1_000_000, 11, 1.75e-3)],
)
def test_silence_is_three_and_a_half_characters_and_fixed_above_19200(baud: int, bits: int, silence: float) -> None:
    assert serial_line(baud, bits, None).silence == pytest.approx(silence)
    assert serial_line(baud, bits, 2e-4).silence == 2e-4, "a drive that needs less"


def test_on_rtu_the_drive_works_when_silence_has_told_it_the_end() -> None:
    line, request = serial_line(115200, 11, None), COUNTED[4][0]
    character = 11 / 115200
    assert line.executed(request, 1e-3) == pytest.approx(17 * character + 1.75e-3 + 1e-3)
    assert line.answer_duration(request) == pytest.approx(13 * character)
    assert line.exchange(request, 1e-3) == pytest.approx(30 * character + 1.75e-3 + 1e-3)


def test_on_tcp_half_of_the_round_trip_lies_on_each_way() -> None:
    line: LineTimes = tcp_line(0.4e-3)
    for request, _, _ in COUNTED:
        assert line.executed(request, 1e-4) == pytest.approx(0.3e-3)
        assert line.exchange(request, 1e-4) == pytest.approx(0.5e-3)
    assert tcp_line(None).round_trip == pytest.approx(0.25e-3), "that which is assumed"


def test_an_adapter_of_a_serial_line_takes_its_time_too() -> None:
    slow, fast = serial_line(115200, 11, None, 1e-3), serial_line(115200, 11, None)
    request = COUNTED[0][0]
    assert slow.exchange(request, 0.0) - fast.exchange(request, 0.0) == pytest.approx(1e-3)
