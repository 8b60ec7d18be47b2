"""Simulated Modbus drives behind a real server, in a thread of this process."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Queue
from threading import Event, Thread

from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.host_request import HostRequest, host_on, resolve

LONGEST = 30.0
"""[s] until the server listens, on a busy machine."""


@contextmanager
def hosted(
    bus: str,
    *drives: str,
    hand: str = "none",
    these: tuple[faults.Fault, ...] = (),
    tell: Callable[[str], None] = lambda _sentence: None,
) -> Iterator[BusName]:
    """Host drives, and yield the bus that masters join; all of them are ready then."""
    name, slots = resolve(HostRequest(drives, bus, 1, hand, these))
    told: Queue[BusName | Exception] = Queue()
    stop, ready = Event(), Queue[DriveOnBus]()

    def serve() -> None:
        try:
            host_on(name)(name, slots, 1, ready.put, stop.is_set, tell, told.put)
        except Exception as error:
            told.put(error)

    thread = Thread(target=serve)
    thread.start()
    try:
        found = told.get(timeout=LONGEST)
        if isinstance(found, Exception):
            raise found
        assert [ready.get(timeout=LONGEST).node for _ in slots] == [slot.node for slot in slots]
        yield found
    finally:
        stop.set()
        thread.join()


def address_of(bus: BusName) -> tuple[str, int]:
    """Host and port of a TCP bus."""
    host, _, port = bus.text.removeprefix("modbus-tcp:").rpartition(":")
    return host, int(port)


def device_of(bus: BusName) -> str:
    """Device of a serial bus."""
    return bus.text.removeprefix("modbus-rtu:").partition("@")[0]
