"""A drive behind a server of a Python library.

Usage: `python -m tests.peers.python_drive modbus-tk|pyModbusTCP nagle|nodelay`.
It prints its port on loopback, and serves until it is ended. The handle is led to and fro by a hand that holds it by a
spring, and one answer comes late, as in `libmodbus_drive.c`.
"""

import math
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from modbus_tk import hooks, modbus_tcp
from modbus_tk.defines import HOLDING_REGISTERS
from pyModbusTCP.server import DataBank, ModbusServer

from tests.buses.modbus.servers import ACTUAL, DEMAND, DISPLAY, ENABLED, STATUS, Drive

RATED_TORQUE, INERTIA, FRICTION = 0.4, 4e-5, 1e-4
"""[N·m, kg·m², N·m·s/rad]"""
GRIP, GRIP_DAMPING, REACH = 0.019, 2.5e-4, 1.2
"""[N·m/rad, N·m·s/rad, rad]"""
STEP, COUNTS = 200e-6, 4096 / (2.0 * math.pi)
"""[s], and counts in a radian."""
LATE_ANSWER, LATE = 50, 0.02
"""Number of the answer, and [s]: the master asks again before it comes, and feedback of that age ends no run."""
UNIT, HOST = 1, "127.0.0.1"


@dataclass
class Handled(Drive):
    """A drive whose motor is coupled to a handle, which moves while time passes."""

    now: Callable[[], float] = time.monotonic
    angle: float = 0.0
    speed: float = 0.0
    advanced: float = 0.0
    enabled: float = 0.0
    answers: int = 0

    def advance(self) -> None:
        """Move the handle up to now."""
        self.watch()
        until = self.now()
        self.advanced = max(self.advanced, until - 1.0)  # nobody asked for long
        demand, rendering = self.registers[DEMAND], self.registers[STATUS] == ENABLED
        torque = 1e-3 * RATED_TORQUE * (demand - (demand >> 15 << 16))
        while self.advanced < until:
            lead = 0.5 * REACH * (1.0 - math.cos(2.0 * math.pi * (self.advanced - self.enabled))) if rendering else 0.0
            hand = GRIP * (lead - self.angle) - GRIP_DAMPING * self.speed
            self.speed += STEP * (torque + hand - FRICTION * self.speed) / INERTIA
            self.angle += STEP * self.speed
            self.advanced += STEP
        self.move_to(round(self.angle * COUNTS))
        self.registers[ACTUAL] = demand

    def write(self, address: int, value: int) -> None:
        self.advance()  # up to now the torque of before has acted
        before = self.registers[STATUS]
        super().write(address, value)
        self.written.clear()
        if before != ENABLED == self.registers[STATUS]:
            self.enabled = self.now()

    def values(self, address: int, count: int) -> list[int]:
        """Registers as they are now."""
        self.advance()
        if self.registers[DEMAND]:
            self.answers += 1
            if self.answers == LATE_ANSWER:
                time.sleep(LATE)
        return [self.registers.get(address + offset, 0) for offset in range(count)]


class Block:
    """All holding registers, as modbus-tk reads and writes a block of its own."""

    starting_address, size = STATUS, DISPLAY + 1 - STATUS

    def __init__(self, drive: Handled) -> None:
        self.drive = drive

    def __getitem__(self, place: slice) -> list[int]:
        return self.drive.values(STATUS + place.start, place.stop - place.start)

    def __setitem__(self, place: int, value: int) -> None:
        self.drive.write(STATUS + place, value)


class Bank(DataBank):  # type: ignore[misc]
    """The same for pyModbusTCP."""

    def __init__(self, drive: Handled) -> None:
        super().__init__(virtual_mode=True)
        self.drive = drive

    def get_holding_registers(self, address: int, number: int = 1, srv_info: Any = None) -> list[int]:
        return self.drive.values(address, number)

    def set_holding_registers(self, address: int, word_list: Sequence[int], srv_info: Any = None) -> bool:
        for offset, value in enumerate(word_list):
            self.drive.write(address + offset, value)
        return True


def serve_by_modbus_tk(port: int, *, nodelay: bool) -> None:
    """modbus-tk leaves Nagle's algorithm on."""
    if nodelay:
        hooks.install_hook(
            "modbus_tcp.TcpServer.on_connect",
            lambda event: event[1].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
        )
    server = modbus_tcp.TcpServer(port=port, address=HOST)
    server.add_slave(UNIT, memory={HOLDING_REGISTERS: [Block(Handled())]})
    server.start()


def serve_by_py_modbus_tcp(port: int, *, nodelay: bool) -> None:
    """pyModbusTCP turns Nagle's algorithm off, whatever is asked for."""
    ModbusServer(HOST, port, no_block=True, data_bank=Bank(Handled())).start()


SERVERS = {"modbus-tk": serve_by_modbus_tk, "pyModbusTCP": serve_by_py_modbus_tcp}

if __name__ == "__main__":
    library, nagle = sys.argv[1:]
    with socket.create_server((HOST, 0)) as free:
        own = free.getsockname()[1]
    SERVERS[library](own, nodelay=nagle == "nodelay")
    print(own, flush=True)
    while True:
        time.sleep(3600.0)
