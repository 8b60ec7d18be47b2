"""Our master on a server that is not ours: pyModbusTCP's, whose registers are those of a drive."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from pyModbusTCP.server import DataBank, ModbusServer

from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from tests.buses.modbus.benches import Bench, plan_of
from tests.buses.modbus.servers import DEMAND, ENABLED, STATUS, TARGET, Drive


class Registers(DataBank):  # type: ignore[misc]
    """The registers of a drive as the foreign server reads and writes them."""

    def __init__(self, drive: Drive) -> None:
        super().__init__(virtual_mode=True)
        self.drive = drive
        self.order: list[str] = []

    def get_holding_registers(self, address: int, number: int = 1, srv_info: Any = None) -> list[int] | None:
        self.order.append("read")
        try:
            return [self.drive.value(address + offset) for offset in range(number)]
        except KeyError:
            return None

    def set_holding_registers(self, address: int, word_list: list[int], srv_info: Any = None) -> bool | None:
        self.order.append("write")
        for offset, value in enumerate(word_list):
            self.drive.write(address + offset, value)
        return True


@contextmanager
def foreign_server() -> Iterator[tuple[Registers, str]]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    registers = Registers(Drive())
    server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=registers)
    server.start()
    try:
        yield registers, f"modbus-tcp:127.0.0.1:{port}"
    finally:
        server.stop()


@pytest.mark.parametrize("way", Transaction)
def test_a_drive_behind_a_foreign_server_is_set_up_driven_and_freed(way: Transaction) -> None:
    with foreign_server() as (registers, name), Bench(plan_of(name, way=way)) as bench:
        bench.open().enable()
        assert registers.drive.value(STATUS) == ENABLED
        registers.drive.move_to(-5_000_123 & 0xFFFF_FFFF)
        for torque in (40, -50, 60):
            registers.order.clear()
            bench.write((0x0F, torque))
            _, _, flags, _, _, position, *_, demand = bench.read()
            assert (flags, position, demand) == (0, -5_000_123, torque)
            assert registers.order == ["write", "read"]
        assert bench.bus.stop() is True
        assert (registers.drive.value(STATUS), registers.drive.value(TARGET)) == (0x40, 0)
        assert registers.drive.value(DEMAND) == 0
        # On a slow computer an answer may come after its request was given up.
        assert [each for each in bench.bus.warnings if "answered an earlier request" not in each] == []


def test_registers_that_the_server_does_not_have_are_refused_in_words() -> None:
    with foreign_server() as (registers, name), Bench(plan_of(name)) as bench:
        del registers.drive.registers[STATUS]
        with pytest.raises(Exception, match=r"refused to read register 0100h statusword with exception 2 \(illegal"):
            bench.open()
