"""A simulated Modbus line with its drives as the plugin's fixtures give them: foreign masters see it on real wires."""

import struct
from collections.abc import Iterator

import pytest
from pymodbus.client import ModbusTcpClient

from haptic_fieldbus.errors import HapticFieldbusError, PlanError, UsageError
from haptic_fieldbus.sim.faults import AnswerException, BusOff, MissingNode, Silence
from haptic_fieldbus.testing import DriveRequest, FaultPlan, plan_faults
from haptic_fieldbus.testing.modbus import SimulatedUnit, VirtualModbusLine
from tests.sim.modbus.units import COMMAND, ERROR, MODE, POSITION, STATUS, TARGET

UNIT = 5
pytestmark = [pytest.mark.simulated_drive("generic_cia402_modbus", node=UNIT), pytest.mark.virtual_modbus_line]


@pytest.fixture
def client(virtual_modbus_line: VirtualModbusLine) -> Iterator[ModbusTcpClient]:
    host, port = virtual_modbus_line.address
    with ModbusTcpClient(host, port=port, timeout=5.0, retries=0) as made:
        yield made


def enable(client: ModbusTcpClient, permille: int) -> None:
    client.write_register(MODE, 10, device_id=UNIT)
    for word in (6, 7, 15):
        client.write_register(COMMAND, word, device_id=UNIT)
    client.write_register(TARGET, permille, device_id=UNIT)


def test_a_foreign_master_drives_the_motor(
    virtual_modbus_line: VirtualModbusLine, simulated_drive: SimulatedUnit, client: ModbusTcpClient
) -> None:
    assert simulated_drive.state == "switch on disabled"
    enable(client, 50)
    assert simulated_drive.state == "operation enabled"
    # The torque loop of the drive comes up to the set-point, and never quite there.
    asked = pytest.approx(0.05 * simulated_drive.rated_torque)
    assert virtual_modbus_line.wait_until(lambda: simulated_drive.torque == asked)
    assert virtual_modbus_line.wait_until(lambda: simulated_drive.position > 0.01)
    assert simulated_drive.velocity > 0.0
    high, low = simulated_drive.registers(POSITION, 2)
    counts = struct.unpack(">i", struct.pack(">HH", high, low))[0]
    assert 0.01 * 4096 / 6.2832 < counts <= simulated_drive.position * 4096 / 6.2832 + 1


def test_what_a_test_lets_happen_happens(
    virtual_modbus_line: VirtualModbusLine, simulated_drive: SimulatedUnit, client: ModbusTcpClient
) -> None:
    enable(client, 0)
    simulated_drive.happen(AnswerException("answer_exception", 0.0, 4))
    simulated_drive.state  # noqa: B018  # served before the next request
    assert client.read_holding_registers(STATUS, device_id=UNIT).isError()
    assert not client.read_holding_registers(STATUS, device_id=UNIT).isError()
    simulated_drive.fail(0x4310)
    assert virtual_modbus_line.wait_until(lambda: simulated_drive.error_code == 0x4310)
    assert client.read_holding_registers(ERROR, device_id=UNIT).registers == [0x4310]
    with pytest.raises(ValueError, match="missing_node"):
        simulated_drive.happen(MissingNode("missing_node"))  # type: ignore[arg-type]
    with pytest.raises(LookupError, match="no 1 registers at 0050h"):
        simulated_drive.registers(0x50)


@pytest.mark.fault_plan([Silence("silence", 0.0)])
def test_a_plan_happens_from_operation_enabled_on(
    virtual_modbus_line: VirtualModbusLine, simulated_drive: SimulatedUnit, client: ModbusTcpClient
) -> None:
    client.write_register(MODE, 10, device_id=UNIT)
    for word in (6, 7):
        client.write_register(COMMAND, word, device_id=UNIT)
    assert simulated_drive.state == "switched on"
    assert "silence" in str(virtual_modbus_line)


@pytest.mark.virtual_modbus_line(bus="modbus-rtu:pty")
def test_a_line_may_be_a_pseudo_terminal(
    virtual_modbus_line: VirtualModbusLine, simulated_drive: SimulatedUnit
) -> None:
    assert virtual_modbus_line.channel.startswith("/dev/pts/")
    assert virtual_modbus_line.name.startswith("modbus-rtu:/dev/pts/")
    with pytest.raises(UsageError, match=r"modbus-rtu:/dev/pts/.* has no address; its channel is the device"):
        _ = virtual_modbus_line.address
    assert repr(simulated_drive) == f"<simulated {simulated_drive.profile.title}, unit {UNIT}: switch on disabled>"


@pytest.mark.parametrize(
    ("bus", "units", "said"),
    [
        ("modbus-rtu:/dev/no-such-device", (1,), "modbus-rtu:/dev/no-such-device: no such device"),
        ("modbus-tcp:127.0.0.1:0", (5, 5), "node 5 is on this bus already"),
    ],
)
def test_a_line_that_cannot_be_opened_is_told_in_a_sentence(bus: str, units: tuple[int, ...], said: str) -> None:
    line = VirtualModbusLine([DriveRequest(node=unit) for unit in units], bus=bus)
    with pytest.raises(HapticFieldbusError, match=said), line:
        pass


def test_what_cannot_be_there_is_refused() -> None:
    with pytest.raises(UsageError) as refused:
        VirtualModbusLine([DriveRequest("maxon_epos5"), DriveRequest(node=300)])
    assert [line.split()[0] for line in str(refused.value).splitlines()] == ["no", "node"]
    with pytest.raises(UsageError, match='fault "silence" is of node 9; the drives have: 1'):
        VirtualModbusLine(faults=FaultPlan((Silence("silence", 0.1, node=9),)))
    with pytest.raises(UsageError, match='a Modbus line does not support the fault "bus_off"'):
        VirtualModbusLine(faults=FaultPlan((BusOff("bus_off", 0.1),)))
    with pytest.raises(PlanError, match="supports Modbus RTU"):
        VirtualModbusLine([DriveRequest("simplex_motion")])
    with pytest.raises(UsageError, match=r"kinds of faults bus_off: expected some of .*answer_lost"):
        plan_faults("random@1", kinds=["bus_off"], possible=("answer_lost", "silence"))
    assert {fault.kind for fault in plan_faults("random@1", possible=("answer_lost",)).faults} == {"answer_lost"}
