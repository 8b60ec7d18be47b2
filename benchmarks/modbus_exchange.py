"""Cost of an exchange over Modbus TCP beside a socket loop written by hand and pymodbus's own client.

All three exchange the same registers with one server on loopback, interleaved in one run: function 23 writes command
and target torque and reads status, torque demand and position. The server, in a process of its own, answers every
request with the same octets, so that what is measured is the master. The exchange takes at most 1.3 × the loop by
hand, also with the process image, its header and the checks of a period; the client, which has none of these, takes
longer.
"""

import selectors
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from time import perf_counter

from pymodbus.client import ModbusTcpClient
from rows import Figure, Pair, machine

import haptic_fieldbus as h
from haptic_fieldbus.buses.modbus.access import open_line
from haptic_fieldbus.buses.modbus.framing import Question
from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic

ROUNDS, NUMBER = 40, 250
READ, WRITTEN = (0x0100, 4), (0x0200, 2)
"""First address and number of registers."""
LARGEST = 1.3
"""Exchange beside the loop by hand."""
BY_HAND, EXCHANGE, MASTER, CLIENT = "by hand", "our exchange", "our master's period", "pymodbus's client"
Call = Callable[[], object]


def serve() -> None:
    """Answer every request on each connection as a drive at rest; print the port before.

    One process serves all who are compared, so that all of them have the same processor on the other side. It ends with
    its standard input, however the process ends that started it.
    """
    with socket.create_server(("127.0.0.1", 0)) as listener, selectors.EpollSelector() as ready:
        print(listener.getsockname()[1], flush=True)
        ready.register(listener, selectors.EVENT_READ)
        ready.register(sys.stdin, selectors.EVENT_READ)
        while True:
            for key, _ in ready.select():
                if key.fileobj is sys.stdin:
                    return
                if key.fileobj is listener:
                    connection, _ = listener.accept()
                    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    ready.register(connection, selectors.EVENT_READ, connection)
                elif request := key.data.recv(4096):
                    key.data.send(answer(request))
                else:
                    ready.unregister(key.data)


def answer(request: bytes) -> bytes:
    """An answer with as many registers as are read, all 0 but the rated torque; a write is confirmed."""
    function = request[7]
    if function in (6, 16):
        return request[:4] + bytes((0, 6)) + request[6:12]
    count = int.from_bytes(request[10:12], "big")
    return request[:4] + (3 + 2 * count).to_bytes(2, "big") + request[6:8] + bytes((2 * count,)) + bytes(2 * count)


@contextmanager
def server() -> Iterator[int]:
    process = subprocess.Popen(
        [sys.executable, __file__, "serve"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # Ctrl-C reaches it too
    )
    try:
        assert process.stdout is not None
        yield int(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()


def by_hand(port: int, stack: ExitStack) -> Call:
    """The same frames by a socket with a time-out; the answer is taken apart, and compared with its request."""
    connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=1.0))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    request, response = struct.Struct(">HHHBBHHHHBHh"), struct.Struct(">HHHBBB4H")
    number = 0

    def call() -> None:
        nonlocal number
        number = number % 0xFFFF + 1
        connection.sendall(request.pack(number, 0, 15, 1, 23, *READ, *WRITTEN, 4, 0, 0))
        transaction, protocol, _, unit, function, size, *_ = response.unpack(connection.recv(4096))
        if (transaction, protocol, unit, function, size) != (number, 0, 1, 23, 8):
            raise SystemExit("another answer")

    return call


def by_client(port: int, stack: ExitStack) -> Call:
    client = ModbusTcpClient("127.0.0.1", port=port, timeout=1.0, retries=0)
    client.connect()  # type: ignore[no-untyped-call]
    stack.callback(client.close)

    def call() -> None:
        client.readwrite_registers(
            read_address=READ[0], read_count=READ[1], write_address=WRITTEN[0], values=[0, 0], device_id=1
        )

    return call


def by_requester(port: int, stack: ExitStack) -> Call:
    """Our exchange: values filled into a frame, sent, and the answer compared with its request."""
    _, section = planned(port)
    clock = MonotonicClock()
    requester = Requester(open_line(section, clock), clock)
    stack.callback(requester.transport.close)
    form = requester.form(Question(1, 23, *READ, (0, 0), WRITTEN[0]))

    def call() -> None:
        requester.send(form, bytes(4))
        if requester.answer(clock.now_ns() + 1_000_000_000) is None:
            raise SystemExit("no answer")

    return call


def by_master(port: int, stack: ExitStack) -> Call:
    """A period of our master: read and write of a bus, with image, header, age and flags."""
    plan, section = planned(port)
    clock = MonotonicClock()
    bus = ModbusBus(open_line(section, clock), clock, section)
    image, output = bytearray(plan.image.input_size), bytes(plan.image.output_size)
    bus._bind(plan, traffic_in(plan), image)
    stack.callback(bus._transport.close)

    def call() -> None:
        bus.read(requester.sent_ns + 1_000_000_000)
        bus.write(output)

    requester = bus._requester
    bus.read(clock.now_ns() + 1_000_000_000)
    bus.write(output)
    return call


def planned(port: int) -> tuple[Plan, ModbusSection]:
    """The plan of a wall, whose set-points are written by function 23."""
    section = ModbusSection("modbus-tcp", f"127.0.0.1:{port}")
    plan = h.plan("wall", bus="sim-modbus-tcp", settings={"wall.stiffness": 100.0})
    (bus,) = plan.buses
    traffic = replace(traffic_in(plan), way=Transaction.READ_WRITE)
    return replace(plan, buses=(replace(bus, traffic=traffic),)), section


def traffic_in(plan: Plan) -> ModbusTraffic:
    (bus,) = plan.buses
    assert isinstance(bus.traffic, ModbusTraffic)
    return bus.traffic


def seconds(call: Call) -> float:
    """Of one call, in a row of many."""
    began = perf_counter()
    for _ in range(NUMBER):
        call()
    return (perf_counter() - began) / NUMBER


def measured() -> dict[str, float]:
    """Shortest of many interleaved rounds [s], by what exchanged."""
    with ExitStack() as stack:
        makers = {BY_HAND: by_hand, EXCHANGE: by_requester, MASTER: by_master, CLIENT: by_client}
        port = stack.enter_context(server())
        calls = {name: make(port, stack) for name, make in makers.items()}
        found: dict[str, list[float]] = {name: [] for name in calls}
        for _ in range(ROUNDS):
            for name, call in calls.items():
                found[name].append(seconds(call))
        return {name: min(times) for name, times in found.items()}


def exchange_pair(stack: ExitStack) -> Pair:
    port = stack.enter_context(server())
    ours, reference = by_requester(port, stack), by_hand(port, stack)
    return lambda: (min(seconds(ours) for _ in range(5)), min(seconds(reference) for _ in range(5)))


def period_pair(stack: ExitStack) -> Pair:
    port = stack.enter_context(server())
    ours, reference = by_master(port, stack), by_hand(port, stack)
    return lambda: fastest_of(ours, reference)


def fastest_of(ours: Call, reference: Call) -> tuple[float, float]:
    """Return the times of the fastest of many short samples that take turns [s]."""
    pairs = [(sample(ours), sample(reference)) for _ in range(SAMPLES)]
    return min(each for each, _ in pairs), min(each for _, each in pairs)


SAMPLES, PERIODS = 200, 10


def sample(call: Call) -> float:
    began = perf_counter()
    for _ in range(PERIODS):
        call()
    return (perf_counter() - began) / PERIODS


FIGURES = (
    Figure("exchange over Modbus TCP", "a socket loop by hand", LARGEST, exchange_pair),
    Figure("period of the Modbus TCP master", "a socket loop by hand", 1.3, period_pair),
)


if __name__ == "__main__":
    if sys.argv[1:] == ["serve"]:
        serve()
        sys.exit()
    times = measured()
    print(machine())
    for name, each in times.items():
        print(f"{name:20} {1e6 * each:8.1f} µs   {each / times[BY_HAND]:6.2f} ×")
    if times[EXCHANGE] > LARGEST * times[BY_HAND] or times[MASTER] > times[CLIENT]:
        raise SystemExit(f"at most {LARGEST} × the loop by hand, and with all of a period less than the client")
