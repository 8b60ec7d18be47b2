"""A simulated line in virtual time: its times to the nanosecond, its frames, and what it does not answer."""

import struct

import pytest

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.sim.faults import ConnectionReset
from haptic_fieldbus.sim.modbus.line import SimulatedLine
from tests.sim.modbus.units import NUMBER, POSITION, STATUS, TARGET, virtual_line

CHARACTER = 11 / 115200
SILENCE, ANSWER = 1.75e-3, 0.2e-3
HALF_TRIP = 0.125e-3
"""Half of the round trip that is assumed of a network."""


def crc(octets: bytes) -> bytes:
    """The checksum of Modbus over serial line 1.02, 6.2.2, bit by bit."""
    value = 0xFFFF
    for octet in octets:
        value ^= octet
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


def rtu(unit: int, pdu: bytes) -> bytes:
    body = bytes((unit,)) + pdu
    return body + crc(body)


def tcp(unit: int, pdu: bytes, transaction: int = 7) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


READ = struct.pack(">BHH", 3, STATUS, 4)


def asked(line: SimulatedLine, clock: VirtualClock, frame: bytes, wait: float = 0.1) -> tuple[bytes, float]:
    """The answer, and the time that it took [s]."""
    begin_ns = clock.now_ns()
    line.discard()
    line.send(frame)
    octets = line.receive(begin_ns + round(wait * 1e9))
    return octets, (clock.now_ns() - begin_ns) * 1e-9


class TestTimes:
    """Request, silence, answer time, answer: each term by itself in a closed form."""

    def test_on_rtu_characters_silence_and_answer_time_add_up(self) -> None:
        line, clock = virtual_line()
        octets, took = asked(line, clock, rtu(NUMBER, READ))
        assert octets[:3] == bytes((NUMBER, 3, 8))
        assert octets[-2:] == crc(octets[:-2])
        assert took == pytest.approx((8 + 13) * CHARACTER + SILENCE + ANSWER, abs=3e-9)

    def test_on_tcp_it_is_the_round_trip_and_the_answer_time(self) -> None:
        line, clock = virtual_line(serial=False)
        octets, took = asked(line, clock, tcp(NUMBER, READ))
        assert octets[:8] == bytes((0, 7, 0, 0, 0, 11, NUMBER, 3))
        assert took == pytest.approx(2 * HALF_TRIP + ANSWER, abs=3e-9)

    def test_registers_are_read_at_the_end_of_the_answer_time(self) -> None:
        """A shaft at constant speed tells by its position when it was looked at."""
        line, clock = virtual_line(serial=False)
        plant = line.unit(NUMBER).drive.plant
        asked(line, clock, tcp(NUMBER, READ))
        assert plant.t_ns == round((HALF_TRIP + ANSWER) * 1e9)

    def test_octets_arrive_one_after_another(self) -> None:
        line, _clock = virtual_line()
        line.send(rtu(NUMBER, READ))
        begins = 8 * CHARACTER + SILENCE + ANSWER
        assert line.receive(round((begins + 0.9 * CHARACTER) * 1e9)) == b""
        assert line.receive(round((begins + 3.5 * CHARACTER) * 1e9)) == bytes((NUMBER, 3, 8))
        assert len(line.receive(10**9)) == 10

    def test_a_request_without_silence_before_it_is_not_understood(self) -> None:
        line, clock = virtual_line()
        asked(line, clock, rtu(NUMBER, READ))
        assert asked(line, clock, rtu(NUMBER, READ))[0] == b""
        clock.sleep_until(clock.now_ns() + round(SILENCE * 1e9))
        assert asked(line, clock, rtu(NUMBER, READ))[0]

    def test_on_tcp_requests_may_follow_at_once(self) -> None:
        line, clock = virtual_line(serial=False)
        for _ in range(3):
            assert asked(line, clock, tcp(NUMBER, READ))[0]

    def test_the_clock_of_who_waits_in_vain_stands_at_the_deadline(self) -> None:
        line, clock = virtual_line()
        octets, took = asked(line, clock, rtu(9, READ), wait=0.02)
        assert octets == b""
        assert took == pytest.approx(0.02)

    def test_the_same_seed_gives_the_same_octets(self) -> None:
        told: list[tuple[int, bool, bytes]] = []
        for _ in range(2):
            line, clock = virtual_line(serial=False)
            line.tap(lambda t_ns, own, octets: told.append((t_ns, own, octets)))
            for address in (STATUS, POSITION, 0x306):
                asked(line, clock, tcp(NUMBER, struct.pack(">BHH", 3, address, 2)))
        assert told[:6] == told[6:]
        assert len(told) == 12


class TestFrames:
    @pytest.mark.parametrize(
        ("pdu", "answer"),
        [
            ("2b 0e 01 00", "ab 01"), ("02 0100 0001", "82 01"),  # functions that it lacks, known to pymodbus or not
            ("03 4000 0001", "83 02"), ("03 0100 0000", "83 03"), ("03 0100 007e", "83 03"),
            ("06 0100 0001", "86 02"), ("06 0202 0063", "86 03"),
            ("10 0201 0002 02 0001", "90 03"), ("17 0100 0001 0201 0002 02 0001", "97 03"),
            ("17 4000 0001 0201 0001 02 0009", "97 02"), ("17 0100 0001 4000 0001 02 0009", "97 02"),
            ("06 0201 0007", "06 0201 0007"), ("10 0201 0001 02 0009", "10 0201 0001"),
            ("04 0203 0001", "04 02 0bb8"),
        ],
    )  # fmt: skip
    def test_answers_and_exceptions(self, pdu: str, answer: str) -> None:
        line, clock = virtual_line(serial=False)
        octets, _ = asked(line, clock, tcp(NUMBER, bytes.fromhex(pdu)))
        assert octets[7:].hex() == bytes.fromhex(answer).hex()

    def test_function_23_writes_before_it_reads(self) -> None:
        line, clock = virtual_line(serial=False)
        for value in (5, 9):
            octets, _ = asked(line, clock, tcp(NUMBER, struct.pack(">BHHHHBH", 23, TARGET, 1, TARGET, 1, 2, value)))
            assert octets[7:] == struct.pack(">BBH", 23, 2, value)

    def test_a_read_that_is_refused_keeps_function_23_from_writing(self) -> None:
        line, clock = virtual_line(serial=False)
        asked(line, clock, tcp(NUMBER, struct.pack(">BHHHHBH", 23, 0x4000, 1, TARGET, 1, 2, 9)))
        octets, _ = asked(line, clock, tcp(NUMBER, struct.pack(">BHH", 3, TARGET, 1)))
        assert octets[7:] == bytes((3, 2, 0, 0))

    def test_everybody_carries_out_a_request_to_all_and_nobody_answers(self) -> None:
        line, clock = virtual_line(numbers=(3, 4))
        octets, _ = asked(line, clock, rtu(0, struct.pack(">BHH", 6, TARGET, 77)), wait=0.01)
        assert octets == b""
        for number in (3, 4):
            assert line.unit(number).drive.objects.target_torque.value == 77
            assert line.unit(number).read(3, TARGET, 1, clock.now_ns()) == b"\0\x4d"

    def test_drives_of_one_line_answer_under_their_own_numbers(self) -> None:
        line, clock = virtual_line(numbers=(3, 4))
        for number in (4, 3):
            clock.sleep_until(clock.now_ns() + 2_000_000)
            assert asked(line, clock, rtu(number, READ))[0][0] == number

    @pytest.mark.parametrize("spoilt", [0, 1, 5, 7])
    def test_a_wrong_checksum_is_answered_by_nobody(self, spoilt: int) -> None:
        line, clock = virtual_line()
        frame = bytearray(rtu(NUMBER, READ))
        frame[spoilt] ^= 0x10
        assert asked(line, clock, bytes(frame), wait=0.02)[0] == b""

    def test_an_adapter_may_give_back_what_one_sends(self) -> None:
        line, clock = virtual_line(echo=True)
        frame = rtu(NUMBER, READ)
        octets, took = asked(line, clock, frame)
        assert octets == frame
        assert took == pytest.approx(8 * CHARACTER, abs=3e-9)
        assert line.receive(10**9)[0] == NUMBER


def test_a_line_that_is_dead_says_so_until_it_is_opened_anew() -> None:
    line, clock = virtual_line(serial=False)
    line.let_happen(NUMBER, ConnectionReset("connection_reset", 0.0, duration=0.01))
    with pytest.raises(BusError, match="line: the drive reset the connection"):
        line.send(tcp(NUMBER, READ))
    with pytest.raises(BusError, match="line: no server at this address"):
        line.reopen()
    clock.sleep_until(20_000_000)
    with pytest.raises(BusError, match="reset"):
        line.receive(10**9)
    line.reopen()
    assert asked(line, clock, tcp(NUMBER, READ))[0]
