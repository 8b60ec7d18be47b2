"""Drives behind a real server: octets in, octets out, whatever the octets; and shafts that move by the clock."""

import os
import random
import select
import socket
import struct
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import suppress

import pytest
import serial

from haptic_fieldbus.errors import BusError, PlanError
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.host_request import HostRequest, host_on, resolve
from tests.sim.modbus.hosted import address_of, device_of, hosted
from tests.sim.modbus.test_line import READ, crc, rtu, tcp
from tests.sim.modbus.units import COMMAND, DEMAND, MODE, STATUS, TARGET, WATCHDOG

TCP, RTU = "modbus-tcp:127.0.0.1:0", "modbus-rtu:pty"
ANSWERED = 5.0
"""[s] within which an answer comes, on a busy machine."""


@pytest.fixture
def connection() -> Iterator[socket.socket]:
    with hosted(TCP, "generic_cia402_modbus@3") as bus, socket.create_connection(address_of(bus)) as connected:
        connected.settimeout(ANSWERED)
        yield connected


def asked(connection: socket.socket, pdu: bytes, unit: int = 3) -> bytes:
    """The PDU of the answer."""
    connection.sendall(tcp(unit, pdu))
    header = connection.recv(7)
    return connection.recv(int.from_bytes(header[4:6], "big") - 1)


def read(connection: socket.socket, address: int) -> int:
    """The value of a register."""
    return int.from_bytes(asked(connection, struct.pack(">BHH", 3, address, 1))[2:], "big")


def write(connection: socket.socket, address: int, value: int) -> None:
    pdu = struct.pack(">BHH", 6, address, value)
    assert asked(connection, pdu) == pdu


class TestTcp:
    def test_a_drive_is_enabled_and_its_shaft_moves_as_long_as_the_clock_says(self, connection: socket.socket) -> None:
        write(connection, MODE, 10)
        for word in (6, 7, 15):
            write(connection, COMMAND, word)
        begin = time.monotonic()
        write(connection, TARGET, 20)
        assert read(connection, DEMAND) == 20
        before = 0.0
        while before < 0.05:
            before = time.monotonic() - begin
            answer = asked(connection, struct.pack(">BHH", 3, STATUS, 4))
            passed = time.monotonic() - begin
        counts = struct.unpack(">i", answer[6:10])[0]
        # 20 ‰ of 0.4 N·m less 2 mN·m of friction turn 4e-5 kg·m² with at most 150 rad/s².
        assert 0 < counts <= 0.5 * 150.0 * (passed + 0.01) ** 2 * 4096 / 6.28

    def test_the_watchdog_acts_by_the_clock(self, connection: socket.socket) -> None:
        write(connection, MODE, 10)
        write(connection, WATCHDOG, 20)
        for word in (6, 7):
            write(connection, COMMAND, word)
        begin = time.monotonic()
        write(connection, COMMAND, 15)
        while read(connection, STATUS) & 0x6F == 0x27 and time.monotonic() < begin + ANSWERED:
            pass
        assert read(connection, STATUS) & 0x4F == 0x08
        assert time.monotonic() - begin >= 0.02

    def test_requests_may_come_in_pieces_and_several_at_once(self, connection: socket.socket) -> None:
        frame = tcp(3, READ)
        for octet in frame:
            connection.sendall(bytes((octet,)))
        assert len(connection.recv(100)) == 17
        connection.sendall(frame * 3 + frame[:5])
        connection.sendall(frame[5:])
        answers = b""
        while len(answers) < 4 * 17:
            answers += connection.recv(1000)
        assert answers == answers[:17] * 4

    def test_what_is_no_header_ends_the_connection_and_no_other(self, connection: socket.socket) -> None:
        with socket.create_connection(connection.getpeername()) as other:
            other.settimeout(ANSWERED)
            other.sendall(bytes.fromhex("000112340006030300000001"))
            with suppress(ConnectionResetError):
                assert other.recv(100) == b""
        assert asked(connection, READ)

    def test_a_unit_that_is_not_there_answers_nothing(self, connection: socket.socket) -> None:
        connection.sendall(tcp(9, READ) + tcp(3, READ, 8))
        assert connection.recv(100)[:2] == b"\0\x08"

    @pytest.mark.thorough("many frames", quick=1)
    @pytest.mark.parametrize("seed", range(20))
    def test_random_requests_are_answered_or_not_but_the_drives_live(
        self, seed: int, connection: socket.socket
    ) -> None:
        draw = random.Random(seed)
        for _ in range(500):
            pdu = bytes((draw.choice((1, 3, 4, 6, 16, 23, 43, draw.randrange(256))),))
            connection.sendall(tcp(draw.choice((0, 3, 9)), pdu + draw.randbytes(draw.randrange(20))))
        connection.sendall(tcp(3, READ, 0xABCD))
        octets = b""
        while b"\xab\xcd\0\0\0\x0b\x03\x03" not in octets[-17:]:
            octets += connection.recv(10_000)

    def test_a_port_in_use_is_told(self, connection: socket.socket) -> None:
        host, port = connection.getpeername()
        with pytest.raises(BusError, match="in use"), hosted(f"modbus-tcp:{host}:{port}", "generic_cia402_modbus"):
            pass


class Terminal:
    """A master on a pseudo-terminal."""

    def __init__(self, bus: BusName) -> None:
        self._file = os.open(device_of(bus), os.O_RDWR | os.O_NOCTTY)

    def asked(self, octets: bytes, count: int) -> bytes:
        os.write(self._file, octets)
        heard = b""
        while len(heard) < count and select.select([self._file], [], [], ANSWERED)[0]:
            heard += os.read(self._file, 1000)
        return heard

    def is_answered_after(self, octets: bytes) -> bool:
        """Whether these are not answered, and a request after a silence is; a busy host may need a longer silence."""
        for silence in (0.05, 0.5, 5.0):
            os.write(self._file, octets)
            assert not select.select([self._file], [], [], silence)[0]
            if len(self.asked(rtu(3, READ), 13)) == 13:
                return True
        return False

    def __enter__(self) -> "Terminal":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)


class TestRtu:
    def test_masters_come_and_go_and_a_wrong_checksum_is_not_answered(self) -> None:
        with hosted(RTU, "generic_cia402_modbus@3", "generic_cia402_modbus@4") as bus:
            for number in (3, 4):
                with Terminal(bus) as terminal:
                    answer = terminal.asked(rtu(number, READ), 13)
                    assert answer[:3] == bytes((number, 3, 8))
                    assert answer[-2:] == crc(answer[:-2])
            with Terminal(bus) as terminal:
                assert terminal.is_answered_after(rtu(3, READ)[:-1] + b"\0")

    def test_a_pseudo_terminal_takes_no_parity_and_the_host_says_so(self) -> None:
        told: list[str] = []
        with hosted(RTU, "generic_cia402_modbus@3", tell=told.append) as bus:
            device = device_of(bus)
            # The first opening changes other attributes too, and is then no failure to the system.
            with suppress(termios.error):
                serial.Serial(device, parity=serial.PARITY_EVEN).close()
            with pytest.raises(termios.error, match="Invalid argument") as refused:
                serial.Serial(device, parity=serial.PARITY_EVEN)
            assert refused.value.args[0] == 22
            serial.Serial(device, parity=serial.PARITY_NONE).close()
        (sentence,) = told
        assert sentence.startswith(f"{device} is a pseudo-terminal without parity: open it with parity N (none).")
        assert "termios error 22" in sentence

    def test_a_port_of_tcp_has_nothing_to_say_of_parity(self) -> None:
        told: list[str] = []
        with hosted(TCP, "generic_cia402_modbus@3", tell=told.append):
            pass
        assert told == []

    def test_octets_before_a_silence_belong_to_no_later_frame(self) -> None:
        with hosted(RTU, "generic_cia402_modbus@3") as bus, Terminal(bus) as terminal:
            assert terminal.is_answered_after(rtu(3, READ)[:4])

    def test_a_device_is_joined_by_the_baud_rate_of_its_name(self) -> None:
        own, theirs = os.openpty()
        tty.setraw(theirs)
        device = os.ttyname(theirs)
        with hosted(f"modbus-rtu:{device}@57600", "generic_cia402_modbus@3") as bus:
            assert bus.text == f"modbus-rtu:{device}@57600"
            os.write(own, rtu(3, READ))
            heard = b""
            while len(heard) < 13 and select.select([own], [], [], ANSWERED)[0]:
                heard += os.read(own, 100)
            assert heard[:3] == bytes((3, 3, 8))
        os.close(own)
        os.close(theirs)

    def test_a_drive_without_such_a_line_is_refused(self) -> None:
        with (
            pytest.raises(PlanError, match="ORCA supports Modbus RTU, but modbus-tcp is TCP"),
            hosted(TCP, "iris_orca"),
        ):
            pass

    def test_a_device_that_goes_away_ends_the_hosting(self) -> None:
        adapter, line = os.openpty()
        tty.setraw(line)
        bus, slots = resolve(HostRequest([], f"modbus-rtu:{os.ttyname(line)}"))
        turns = iter(range(50))

        def unplugged() -> bool:
            if next(turns) == 2:
                os.close(adapter)
            return False

        try:
            with pytest.raises(BusError, match=r"the device has gone; plug it in"):
                host_on(bus)(bus, slots, 1, lambda _slot: None, unplugged)
        finally:
            os.close(line)

    @pytest.mark.parametrize(
        ("device", "words"), [("nothing", "no such device"), ("null", "no serial device"), ("", "no serial device")]
    )
    def test_a_device_that_is_not_there_or_no_line_is_told(self, device: str, words: str) -> None:
        with pytest.raises(BusError, match=words), hosted(f"modbus-rtu:/dev/{device}", "generic_cia402_modbus"):
            pass


class TestFaults:
    """Faults of answers count from operation enabled, and reach a real master."""

    def enabled(self, connection: socket.socket) -> None:
        write(connection, MODE, 10)
        for word in (6, 7):
            write(connection, COMMAND, word)
        connection.sendall(tcp(3, struct.pack(">BHH", 6, COMMAND, 15)))

    def test_an_answer_is_lost_and_the_next_one_comes(self) -> None:
        fault = faults.AnswerLost("answer_lost", 0.0, 1)
        with (
            hosted(TCP, "generic_cia402_modbus@3", these=(fault,)) as bus,
            socket.create_connection(address_of(bus)) as connection,
        ):
            connection.settimeout(ANSWERED)
            self.enabled(connection)
            assert connection.recv(12)  # the fault begins behind this one
            connection.sendall(tcp(3, READ, 1) + tcp(3, READ, 2))
            assert connection.recv(100)[:2] == b"\0\2"

    def test_a_connection_is_reset(self) -> None:
        fault = faults.ConnectionReset("connection_reset", 0.0, 0.2)
        with (
            hosted(TCP, "generic_cia402_modbus@3", these=(fault,)) as bus,
            socket.create_connection(address_of(bus)) as connection,
        ):
            connection.settimeout(ANSWERED)
            self.enabled(connection)
            with suppress(ConnectionError):
                connection.recv(12)
                assert connection.recv(1) == b""
