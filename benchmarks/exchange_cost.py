"""A frame out and one in by each port, beside python-can itself, interleaved, on vcan.

On a machine without CAN: `haptic-fieldbus vcan -- python benchmarks/exchange_cost.py`.
"""

from collections.abc import Callable
from contextlib import ExitStack

import can
from can.interfaces.socketcan.socketcan import SocketcanBus
from rows import Row, cost, show

from haptic_fieldbus.buses.canopen.wire import PythonCanPort, SocketCanPort
from haptic_fieldbus.clock import MonotonicClock

CHANNEL = "vcan0"
ROUNDS, NUMBER = 20, 200
DATA = bytes(8)
OURS, FOREIGN = 0x185, 0x2A7
FLOOD = 20
"""Frames of others for each of ours."""


def rows(stack: ExitStack) -> list[Row]:
    direct, plain, other = (stack.enter_context(SocketcanBus(CHANNEL)) for _ in range(3))
    ours, slow = SocketCanPort(direct.socket, MonotonicClock()), PythonCanPort(plain)
    ours.focus(frozenset({OURS}), 1000)

    def exchange(port: SocketCanPort | PythonCanPort) -> Callable[[], object]:
        def call() -> None:
            port.send(0x205, DATA)
            other.socket.recv(100)
            other.socket.send(frame(OURS))
            while port.receive(1.0) is None:
                """Until it is there."""

        return call

    def flooded(port: SocketCanPort | PythonCanPort) -> Callable[[], object]:
        def call() -> None:
            for _ in range(FLOOD):
                other.socket.send(frame(FOREIGN))
            other.socket.send(frame(OURS))
            while port.receive(0.0) is not None:
                """Frames that are there."""

        return call

    found = []
    for name, kind in (("a frame out and one in", exchange), (f"one in among {FLOOD} of others", flooded)):
        pairs = [_both(kind(ours), kind(slow), (ours, slow)) for _ in range(ROUNDS)]
        found.append(Row(name, min(pair[0] for pair in pairs), min(pair[1] for pair in pairs)))
    return found


def _both(
    ours: Callable[[], object], slow: Callable[[], object], ports: tuple[SocketCanPort, PythonCanPort]
) -> tuple[float, float]:
    """One after the other, each with nothing left over from the other."""
    costs = []
    for call in (ours, slow):
        for port in ports:
            while port.receive(0.0) is not None:
                """Left over."""
        costs.append(cost(call, NUMBER, repeat=1))
    return costs[0], costs[1]


def frame(can_id: int) -> bytes:
    return can_id.to_bytes(4, "little") + bytes((8, 0, 0, 0)) + DATA


if __name__ == "__main__":
    try:
        with ExitStack() as stack:
            show(rows(stack))
    except (OSError, can.CanError) as error:
        raise SystemExit(
            f"{CHANNEL} is not there ({error}): haptic-fieldbus vcan -- python benchmarks/exchange_cost.py"
        ) from error
