"""Foreign Modbus masters read and write simulated drives, over TCP and over a pair of pseudo-terminals.

mbpoll is built on libmodbus; pyModbusTCP, modbus-tk and minimalmodbus have encoders of their own. Wireshark's dissector
reads what went over the wire. None of them knows the profile: addresses, functions and word order stand in the tests.
"""

import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import minimalmodbus
import pytest
from modbus_tk import defines, modbus_tcp
from modbus_tk.exceptions import ModbusError
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.constants import EXP_DATA_ADDRESS, EXP_DATA_VALUE

from haptic_fieldbus.sim import faults
from tests.sim.modbus.hosted import address_of, device_of, hosted
from tests.sim.modbus.test_line import tcp
from tests.sim.modbus.units import COMMAND, DEMAND, LIMIT, MODE, POSITION, RATED, STATUS, TARGET, WATCHDOG, signed

GENERIC = "generic_cia402_modbus"
UNIT = 5
COUNTS = -70_000
"""By which the encoder is made to jump: a position whose two registers both matter, and its sign too."""
JUMP = (faults.EncoderJump("encoder_jump", 0.0, COUNTS),)


def program(name: str, package: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed: apt-get install {package}")
    return found


@pytest.fixture
def client() -> Iterator[ModbusClient]:
    with hosted("modbus-tcp:127.0.0.1:0", f"{GENERIC}@{UNIT}", these=JUMP) as bus:
        host, port = address_of(bus)
        client = ModbusClient(host=host, port=port, unit_id=UNIT, timeout=5.0, auto_open=True)
        yield client
        client.close()


@pytest.fixture
def instrument() -> Iterator[minimalmodbus.Instrument]:
    with hosted("modbus-rtu:pty", f"{GENERIC}@{UNIT}", these=JUMP) as bus:
        instrument = minimalmodbus.Instrument(device_of(bus), UNIT)
        assert instrument.serial is not None
        instrument.serial.baudrate, instrument.serial.timeout = 115200, 0.5  # it waits so long after an exception
        yield instrument
        instrument.serial.close()


class TestPyModbusTcp:
    def enable(self, client: ModbusClient) -> None:
        assert client.write_single_register(MODE, 10)
        for word in (6, 7, 15):
            assert client.write_single_register(COMMAND, word)

    def test_it_enables_the_drive_and_reads_the_position_high_register_first(self, client: ModbusClient) -> None:
        assert client.read_holding_registers(STATUS) == [0x0270]
        self.enable(client)
        assert client.read_holding_registers(STATUS)[0] & 0x6F == 0x27
        words = client.read_holding_registers(POSITION, 2)
        assert abs(signed(words) - COUNTS) < 100
        assert client.read_holding_registers(RATED, 2) == [0, 400]
        assert client.read_input_registers(LIMIT) == [3000]

    def test_function_16_writes_command_and_target_and_23_writes_before_it_reads(self, client: ModbusClient) -> None:
        self.enable(client)
        assert client.write_multiple_registers(COMMAND, [15, 25])
        assert client.read_holding_registers(DEMAND) == [25]
        for value in (40, 65_536 - 40):
            assert client.write_read_multiple_registers(TARGET, [value], DEMAND, 1) == [value]
            assert client.read_holding_registers(TARGET) == [value]

    def test_it_understands_what_is_refused(self, client: ModbusClient) -> None:
        assert client.read_holding_registers(POSITION, 1) is None
        assert client.last_except == EXP_DATA_ADDRESS
        assert not client.write_single_register(STATUS, 1)
        assert client.last_except == EXP_DATA_ADDRESS
        assert not client.write_single_register(MODE, 99)
        assert client.last_except == EXP_DATA_VALUE


class TestModbusTk:
    @pytest.fixture
    def master(self, client: ModbusClient) -> Iterator[modbus_tcp.TcpMaster]:
        master = modbus_tcp.TcpMaster(client.host, client.port, timeout_in_sec=5.0)
        yield master
        master.close()

    def test_it_enables_the_drive_and_function_23_writes_before_it_reads(self, master: modbus_tcp.TcpMaster) -> None:
        for register, value in ((MODE, 10), (COMMAND, 6), (COMMAND, 7), (COMMAND, 15)):
            assert master.execute(UNIT, defines.WRITE_SINGLE_REGISTER, register, output_value=value) == (
                register,
                value,
            )
        (status, *_) = master.execute(UNIT, defines.READ_HOLDING_REGISTERS, STATUS, 1)
        assert status & 0x6F == 0x27
        words = master.execute(UNIT, defines.READ_HOLDING_REGISTERS, POSITION, 2)
        assert abs(signed(words) - COUNTS) < 100
        both = (defines.READ_WRITE_MULTIPLE_REGISTERS, DEMAND, 1)
        for value in (40, 30):
            assert master.execute(UNIT, *both, output_value=[value], write_starting_address_fc23=TARGET) == (value,)

    def test_it_understands_what_is_refused(self, master: modbus_tcp.TcpMaster) -> None:
        with pytest.raises(ModbusError) as refused:
            master.execute(UNIT, defines.READ_HOLDING_REGISTERS, POSITION, 1)
        assert refused.value.get_exception_code() == defines.ILLEGAL_DATA_ADDRESS


class TestMinimalModbus:
    def test_it_reads_and_writes_in_the_right_word_order(self, instrument: minimalmodbus.Instrument) -> None:
        instrument.write_register(MODE, 10, functioncode=6)
        for word in (6, 7, 15):
            instrument.write_register(COMMAND, word, functioncode=16)
        assert instrument.read_register(STATUS) & 0x6F == 0x27
        position = instrument.read_long(POSITION, signed=True, byteorder=minimalmodbus.BYTEORDER_BIG)
        assert abs(position - COUNTS) < 100
        assert instrument.read_long(RATED) == 400
        instrument.write_register(TARGET, -30, signed=True)
        assert instrument.read_register(DEMAND, signed=True) == -30

    def test_it_understands_what_is_refused(self, instrument: minimalmodbus.Instrument) -> None:
        with pytest.raises(minimalmodbus.IllegalRequestError, match="llegal data address"):
            instrument.read_register(POSITION)


class TestMbpoll:
    """libmodbus, on the command line."""

    @pytest.fixture
    def mbpoll(self) -> str:
        return program("mbpoll", "mbpoll")

    def polled(self, mbpoll: str, *words: str) -> str:
        done = subprocess.run(
            [mbpoll, "-0", "-1", "-q", *words], capture_output=True, text=True, check=False, timeout=30
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def test_it_reads_and_writes_on_tcp(self, mbpoll: str, client: ModbusClient) -> None:
        TestPyModbusTcp().enable(client)
        way = ("-m", "tcp", "-p", str(client.port), "-a", str(UNIT))
        written = self.polled(mbpoll, *way, "-r", str(WATCHDOG), client.host, "1234")
        assert "Written 1 references" in written
        assert "1234" in self.polled(mbpoll, *way, "-r", str(WATCHDOG), "-c", "1", client.host)
        # Its 32-bit values have the low register first, unless told otherwise by -B.
        told = self.polled(mbpoll, *way, "-t", "4:int", "-B", "-r", str(POSITION), "-c", "1", client.host)
        assert abs(int(told.split("]:")[1].split()[0]) - COUNTS) < 100

    def test_it_reads_on_rtu(self, mbpoll: str, instrument: minimalmodbus.Instrument) -> None:
        assert instrument.serial is not None
        device = str(instrument.serial.port)
        instrument.serial.close()
        way = ("-m", "rtu", "-b", "115200", "-P", "none", "-a", str(UNIT))
        assert "400" in self.polled(mbpoll, *way, "-t", "4:int", "-B", "-r", str(RATED), "-c", "1", device)


class TestTshark:
    """Wireshark's dissector finds in the traffic what was asked and answered, and nothing malformed."""

    FIELDS = (
        "tcp.srcport", "mbtcp.trans_id", "mbtcp.unit_id", "modbus.func_code", "modbus.exception_code",
        "modbus.regval_uint16", "_ws.malformed", "_ws.expert.message",
    )  # fmt: skip
    PDUS = (
        bytes.fromhex("0301000008"), bytes.fromhex("0403080002"), bytes.fromhex("060202000a"),
        bytes.fromhex("10020000020400060019"), bytes.fromhex("1701000008020000020400070020"),
        bytes.fromhex("0340000001"), bytes.fromhex("0602020063"), bytes.fromhex("2b0e0100"),
    )  # fmt: skip

    def recorded(self, folder: Path) -> Path:
        """Requests and answers as a hex dump with directions."""
        lines = []
        with (
            hosted("modbus-tcp:127.0.0.1:0", f"{GENERIC}@{UNIT}") as bus,
            socket.create_connection(address_of(bus)) as connection,
        ):
            connection.settimeout(5.0)
            for number, pdu in enumerate(self.PDUS, start=1):
                frame = tcp(UNIT, pdu, number)
                connection.sendall(frame)
                lines += [f"I 000000 {frame.hex(' ')}", f"O 000000 {connection.recv(300).hex(' ')}"]
        path = folder / "traffic.txt"
        path.write_text("\n".join(lines) + "\n", encoding="ascii")
        return path

    @pytest.mark.thorough("two programs")
    def test_nothing_is_malformed(self, tmp_path: Path) -> None:
        tshark, text2pcap = program("tshark", "tshark"), program("text2pcap", "tshark")
        path = tmp_path / "traffic.pcap"
        # Ports of what comes in, to the drive at that of the standard; for what goes out they are exchanged.
        made = [text2pcap, "-q", "-D", "-T", "50000,502", str(self.recorded(tmp_path)), str(path)]
        subprocess.run(made, check=True, capture_output=True)
        command = [tshark, "-r", str(path), "-T", "fields", "-E", "separator=/t", "-E", "occurrence=a"]
        for field in self.FIELDS:
            command += ["-e", field]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        rows = [dict(zip(self.FIELDS, line.split("\t"), strict=True)) for line in done.stdout.splitlines()]
        assert len(rows) == 2 * len(self.PDUS)
        assert not any(row["_ws.malformed"] for row in rows)
        functions = [row["modbus.func_code"] for row in rows]
        assert functions == [str(pdu[0]) for pdu in self.PDUS for _ in range(2)]
        assert {row["mbtcp.unit_id"] for row in rows} == {str(UNIT)}
        assert [row["modbus.exception_code"] for row in rows][-6:] == ["", "2", "", "3", "", "1"]
        assert [row["modbus.regval_uint16"] for row in rows][3] == "0,400"
