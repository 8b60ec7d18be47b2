"""Helpers that let a canopen client run without a thread of its own."""

from queue import Empty

import canopen

from haptic_fieldbus.sim.canopen.bus import SimulatedBus


class Responses:
    """Queue on which a canopen client waits: `get` receives from the bus, in virtual time, until a response."""

    def __init__(self, network: canopen.Network, bus: SimulatedBus) -> None:
        self._network = network
        self._bus = bus
        self._waiting: list[bytes] = []

    def put(self, response: bytes) -> None:
        self._waiting.append(bytes(response))

    def empty(self) -> bool:
        return not self._waiting

    def get(self, block: bool = True, timeout: float = 0.0) -> bytes:
        while not self._waiting:
            message = self._bus.recv(timeout)
            if message is None:
                raise Empty
            self._network.notify(message.arbitration_id, message.data, message.timestamp)
        return self._waiting.pop(0)
