"""Processor time of a period on real sockets, beside a loop by hand and python-can with canopen's PDO objects.

A period is SYNC, a TPDO of each drive (statusword, position, torque) and an RPDO to each (controlword, target torque).
On SocketCAN (a virtual interface of a guest kernel where this computer has none) and on UDP multicast. Each SYNC is
answered at once, by another socket of the same process; what that takes is measured alone and taken off. What is left
is the processor time of a period, that of the kernel for its system calls included, and no time of waiting.

- *By hand*: a socket and `struct`. It drops what came before SYNC, waits with a time-out, takes the values out of the
  frame, compares its CAN-ID, and notes how old they are. It has no heartbeat, flag or image.
- *canopen*: a `Network` with its receiving thread, a `RemoteNode` with two mapped PDOs, a callback that wakes the loop.

In a guest kernel a system call takes about 20 µs, and a look at the clock is one.
`python benchmarks/wire_period.py udp_multicast 5` prints five rounds, `python benchmarks/wire_period.py udp_multicast
rates` the periods missed in real time at each of some rates.
"""

import json
import os
import select
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, perf_counter, process_time

import can
import canopen
from can.interfaces.udp_multicast.utils import pack_message
from canopen.objectdictionary import datatypes
from rows import Figure, NotHereError, Pair, machine, put_on_page

import haptic_fieldbus as h
from haptic_fieldbus.buses.bus import traffic_of
from haptic_fieldbus.buses.canopen.guard import ProofsOfLife
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import NmtState
from haptic_fieldbus.buses.canopen.other_master import ForeignMaster, OneMaster
from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.running import rights

SIX = 6
CHANNEL, GROUP, PORT = "vcan0", "239.74.163.9", 43119
WAIT = 2.0
"""[s]; so long an answer is waited for."""
FRAME = struct.Struct("=IB3x8s")
TPDO, RPDO = struct.Struct("<Hih"), struct.Struct("<Hh")
SYNC = 0x80
SYNC_FRAME, SYNC_FIELD = SYNC.to_bytes(4, sys.byteorder), b"arbitration_id\xcc\x80"
OUR_SYNC_FIELD = b"arbitration_id\xce\0\0\0\x80"
"""Begin of SYNC on SocketCAN, and a part of it as a datagram of python-can, and as one of ours."""
FIRST = 5
"""Node-ID of the first drive."""
ANSWER = 0x180 + FIRST
Call = Callable[[], object]


# The drives: each SYNC that leaves one of these sockets is answered at once, by another socket of this process.


class Answered(socket.socket):
    """An open socket whose class this becomes; it has no state of its own, so that the class can be set."""

    __slots__ = ()

    def send(self, octets: bytes, *flags: int) -> int:  # type: ignore[override]
        sent = super().send(octets, *flags)
        if octets.startswith(SYNC_FRAME):
            drives()
        return sent

    def sendto(self, octets: bytes | bytearray, to: tuple[str, int]) -> int:  # type: ignore[override]
        sent = super().sendto(octets, to)
        if SYNC_FIELD in octets or OUR_SYNC_FIELD in octets:
            drives()
        return sent


def drives() -> None:
    """Send the TPDOs of all drives; `answering` says how."""
    for octets in TPDOS:
        SENDER[0](octets)


TPDOS: list[bytes] = []
SENDER: list[Callable[[bytes], object]] = []


def open_wire(kind: str) -> can.BusABC:
    if kind == "socketcan":
        bus = can.Bus(interface="socketcan", channel=CHANNEL)
        bus.socket.__class__ = Answered  # type: ignore[attr-defined]
    else:
        bus = can.Bus(interface="udp_multicast", channel=GROUP, port=PORT, fd=False)
        opened = bus._multicast._socket  # type: ignore[attr-defined]
        opened.__class__ = Answered
        loop_back(opened)
    return bus


LOOPBACK = socket.inet_aton("127.0.0.1")


def loop_back(opened: socket.socket) -> None:
    """Send to this computer alone, and hear that: a network card takes more for a datagram at times."""
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, LOOPBACK)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + LOOPBACK)


@contextmanager
def answering(kind: str, axes: int) -> Iterator[None]:
    """Let so many drives answer SYNC inside of the block."""
    payload, cob_ids = TPDO.pack(0x0637, 1234, 5), range(ANSWER, ANSWER + axes)
    with ExitStack() as stack:
        if kind == "socketcan":
            sender = stack.enter_context(socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW))
            sender.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
            sender.bind((CHANNEL,))
            TPDOS[:] = [FRAME.pack(cob_id, TPDO.size, payload) for cob_id in cob_ids]
        else:
            sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            loop_back(sender)
            sender.connect((GROUP, PORT))
            TPDOS[:] = [packed_frame(cob_id, payload) for cob_id in cob_ids]
        SENDER[:] = [sender.send]
        yield


def packed_frame(can_id: int, data: bytes) -> bytes:
    return pack_message(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


# Those who are compared: each call is a period.


def by_master(kind: str, stack: ExitStack, axes: int) -> Call:
    """A period of our master, `read` and `write`, and the codecs of its images."""
    bus = stack.enter_context(open_wire(kind))
    plan = plan_of(axes)
    clock = MonotonicClock()
    master = CanopenBus(bus, clock)
    image, output = bytearray(plan.image.input_size), bytearray(plan.image.output_size)
    master._bind(plan, image)
    master._refused_writes = 0
    master._foreign = ForeignMaster(master._wire, OneMaster([axis.node for axis in plan.axes], 127, []), print)
    master._proofs = ProofsOfLife(
        traffic_of(plan, CanTraffic), [setup.node for setup in master._setups], plan.period_ns
    )
    for setup in master._setups:
        setup.node.state = NmtState.OPERATIONAL
    master._wire.focus(1 + len(master._outputs) + 2 * len(master._setups))
    codecs = [(each.input.unpack_from, each.output.pack_into, each.outputs[0]) for each in plan.image.axes]

    master.latch_ns = clock.now_ns()

    def call() -> None:
        read = master.read(master.latch_ns + round(WAIT * 1e9))
        for unpack, pack, place in codecs:
            unpack(read)
            pack(output, place, 0x0F, 7)
        master.write(output)

    return call


@cache
def plan_of(axes: int) -> Plan:
    """Return the plan of a wall on each axis; at 500 Hz for six, which do not fit into 1 ms at 1 Mbit/s."""
    walls = "".join(
        f'[axis.{name}]\nworkspace = "linear"\n[[element]]\nkind = "wall"\nname = "wall_{name}"\naxis = "{name}"\n'
        "position = 0.02\nstiffness = 300.0\n"
        for name in "abcdef"[:axes]
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "walls.toml"
        path.write_text(f'description = "Walls"\n{walls}', encoding="utf-8")
        return h.plan(path, bus="sim", node=FIRST, rate=1000.0 if axes == 1 else 500.0)


def by_hand(kind: str, stack: ExitStack) -> Call:
    """One drive by a socket and `struct`, with nothing else than the frames of a period."""
    return socketcan_by_hand(stack) if kind == "socketcan" else multicast_by_hand(stack)


def socketcan_by_hand(stack: ExitStack) -> Call:
    wire = stack.enter_context(Answered(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW))
    wire.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", ANSWER, 0x7FF))
    wire.bind((CHANNEL,))
    sync, ages = FRAME.pack(SYNC, 0, b""), [0.0]

    def call() -> None:
        drop(wire)
        latch = monotonic()
        wire.send(sync)
        if not select.select((wire,), (), (), WAIT)[0]:
            raise SystemExit("no answer")
        can_id, size, data = FRAME.unpack(wire.recv(16))
        if (can_id, size) != (ANSWER, 8):
            raise SystemExit("another answer")
        TPDO.unpack(data)
        ages[0] = monotonic() - latch
        wire.send(FRAME.pack(0x200 + FIRST, RPDO.size, RPDO.pack(0x0F, 7)))

    return call


def drop(wire: socket.socket) -> None:
    """Take what came before."""
    try:
        while wire.recv(4096, socket.MSG_DONTWAIT):
            pass
    except BlockingIOError:
        pass


def multicast_by_hand(stack: ExitStack) -> Call:
    """The layout of python-can's datagrams is written down once, with the places of what changes.

    What is sent comes back, as group members on one computer hear each other: it is told by its CAN-ID.
    """
    opened = stack.enter_context(open_wire("udp_multicast"))
    wire = stack.enter_context(Answered(fileno=os.dup(opened.fileno())))
    sync, command, to = packed_frame(SYNC, b""), bytearray(packed_frame(0x200 + FIRST, bytes(4))), (GROUP, PORT)
    answer = packed_frame(ANSWER, bytes(8))
    ages = [0.0]
    values = command.index(bytes(4), 60)
    id_at, data_at = answer.index(b"arbitration_id") + 15, answer.index(bytes(8), 60)
    take = struct.Struct(f">{id_at}xH{data_at - id_at - 2}x8s")

    def call() -> None:
        drop(wire)
        latch = monotonic()
        wire.sendto(sync, to)
        while True:
            if not select.select((wire,), (), (), WAIT)[0]:
                raise SystemExit("no answer")
            octets = wire.recv(4096)
            if len(octets) < take.size:
                continue
            can_id, data = take.unpack_from(octets)
            if can_id == ANSWER:
                break
        TPDO.unpack(data)
        ages[0] = monotonic() - latch
        RPDO.pack_into(command, values, 0x0F, 7)
        wire.sendto(command, to)

    return call


def by_canopen(kind: str, stack: ExitStack) -> Call:
    """One drive by canopen: its receiving thread copies the TPDO, and a callback wakes the loop."""
    network = stack.enter_context(canopen.Network())
    network.bus = stack.enter_context(open_wire(kind))
    network.notifier = can.Notifier(network.bus, network.listeners, network.NOTIFIER_CYCLE)
    stack.callback(network.notifier.stop)
    dictionary = canopen.ObjectDictionary()  # type: ignore[no-untyped-call]
    for index, name, type_ in (
        (0x6040, "Controlword", datatypes.UNSIGNED16),
        (0x6041, "Statusword", datatypes.UNSIGNED16),
        (0x6064, "Position actual value", datatypes.INTEGER32),
        (0x6071, "Target torque", datatypes.INTEGER16),
        (0x6077, "Torque actual value", datatypes.INTEGER16),
    ):
        variable = canopen.objectdictionary.ODVariable(name, index)
        variable.data_type = type_
        dictionary.add_object(variable)
    for index in (0x1400, 0x1600, 0x1800, 0x1A00):
        dictionary.add_object(canopen.objectdictionary.ODRecord(f"PDO {index:04X}h", index))
    node = network.add_node(canopen.RemoteNode(FIRST, dictionary))
    tpdo, rpdo, came = node.tpdo[1], node.rpdo[1], threading.Event()
    inputs = [tpdo.add_variable(index) for index in (0x6041, 0x6064, 0x6077)]
    outputs = [rpdo.add_variable(index) for index in (0x6040, 0x6071)]
    tpdo.cob_id, rpdo.cob_id, tpdo.enabled, rpdo.enabled = ANSWER, 0x200 + FIRST, True, True
    tpdo.subscribe()
    tpdo.add_callback(lambda _: came.set())

    def call() -> None:
        came.clear()
        network.sync.transmit()
        if not came.wait(WAIT):
            raise SystemExit("no answer")
        for each in inputs:
            each.raw  # noqa: B018
        for each, value in zip(outputs, (0x0F, 7), strict=True):
            each.raw = value
        rpdo.transmit()

    return call


# Measuring: the processor time of the fastest of many short samples, because other programs only make one slower.

SAMPLES, PERIODS = 60, 8
PASSES = 4
"""So often all of them are measured in turn: a computer that is busy for a while disturbs none of them whole."""


def fastest(call: Call, kind: str, after: Call = float) -> float:
    """Return the processor time of a call [s]; `after` is called after each sample, and not counted.

    A guest kernel counts processor time in steps of 10 ms; its only processor does nothing else, so the time of day
    counts there.
    """
    clock, times = perf_counter if kind == "socketcan" else process_time, []
    for _ in range(SAMPLES):
        began = clock()
        for _ in range(PERIODS):
            call()
        times.append(clock() - began)
        after()
    return min(times) / PERIODS


MASTER, MASTER_OF_SIX, BY_HAND, CANOPEN = "our master", "our master, six axes", "by hand", "canopen"
MAKERS: dict[str, tuple[Callable[[str, ExitStack], Call], int]] = {
    MASTER: (partial(by_master, axes=1), 1),
    BY_HAND: (by_hand, 1),
    CANOPEN: (by_canopen, 1),
    MASTER_OF_SIX: (partial(by_master, axes=SIX), SIX),
}


def measured(kind: str) -> dict[str, float]:
    """Return the processor time of a period, by whose it is [s]; that of the drives is taken off."""
    passes = [{name: times(kind, *MAKERS[name]) for name in MAKERS} for _ in range(PASSES)]
    return {name: min(each[name][0] for each in passes) - min(each[name][1] for each in passes) for name in MAKERS}


def times(kind: str, make: Callable[[str, ExitStack], Call], axes: int) -> tuple[float, float]:
    """Return the processor time of a period, and that of the drives in it [s]."""
    with ExitStack() as stack:
        stack.enter_context(answering(kind, axes))
        call = make(kind, stack)
        call()
        whole = fastest(call, kind)
        return whole, drives_alone(kind, axes)


def drives_alone(kind: str, axes: int) -> float:
    """Return the time that the drives take to answer, with one socket that receives [s]."""
    with ExitStack() as stack:
        bus = stack.enter_context(open_wire(kind))
        receiver = stack.enter_context(socket.socket(fileno=os.dup(bus.fileno())))
        return fastest(drives, kind, lambda: drop(receiver))


# As figures: those of one kind of bus share their rounds; all rounds on SocketCAN are measured by one guest kernel.

GUEST_ROUNDS = 50
"""More than are ever asked for."""


@dataclass
class Rounds:
    """Rounds of one kind of bus; the figure that asks for one first measures it."""

    kind: str
    found: list[dict[str, float]] = field(default_factory=list)
    source: Iterator[dict[str, float]] | None = None

    def opened(self, stack: ExitStack) -> Iterator[dict[str, float]]:
        """Return the source of rounds, until the stack ends; raises NotHereError where this bus cannot be had."""
        if self.source is None:
            stack.callback(self.forget)
            host = (measured(self.kind) for _ in count())
            self.source = host if self.kind == "udp_multicast" else guest(stack)
            try:
                self.found.append(next(self.source))
            except (StopIteration, OSError, can.CanError) as error:
                raise NotHereError(f"{self.kind} cannot be had on this computer") from error
        return self.source

    def forget(self) -> None:
        self.source = None
        self.found.clear()


def guest(stack: ExitStack) -> Iterator[dict[str, float]]:
    """Yield the rounds of SocketCAN; none on a computer that has neither vcan nor a guest kernel."""
    words = [sys.executable, "-m", "haptic_fieldbus", "vcan", "--interface", CHANNEL, "--"]
    command = [*words, sys.executable, "-B", __file__, "socketcan", str(GUEST_ROUNDS), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    stack.enter_context(process)
    stack.callback(process.terminate)
    assert process.stdout is not None
    return map(json.loads, process.stdout)


ROUNDS = {kind: Rounds(kind) for kind in ("socketcan", "udp_multicast")}


def pair(kind: str, ours: str, reference: str, stack: ExitStack) -> Pair:
    rounds, numbers = ROUNDS[kind], count()
    source = rounds.opened(stack)

    def call() -> tuple[float, float]:
        number = next(numbers)
        if number == len(rounds.found):
            rounds.found.append(next(source))
        found = rounds.found[number]
        return found[ours], found[reference]

    return call


def figures(kind: str, name: str, by_hand: float, canopen: float) -> Iterator[Figure]:
    """Yield the figures of one kind of bus, with their bounds beside the loop by hand and beside canopen."""
    yield Figure(f"period on {name}", "a socket by hand", by_hand, partial(pair, kind, MASTER, BY_HAND))
    yield Figure(
        f"one period on {name}", "python-can and canopen's PDOs", canopen, partial(pair, kind, MASTER, CANOPEN)
    )
    yield Figure(f"six axes on {name}", "one axis", 4.0, partial(pair, kind, MASTER_OF_SIX, MASTER))


FIGURES = (*figures("socketcan", "SocketCAN", 1.3, 0.35), *figures("udp_multicast", "UDP multicast", 1.3, 1 / 3))


# The periods missed at each rate, in real time, beside those of a bare timer: what it misses too is the computer's.

RATES = (500, 1000, 2000, 4000, 8000, 16_000)
TRIES, TRY = 3, 0.5
"""How often each rate is tried, and for how long [s]."""


def misses(call: Call, rate: float) -> int:
    """Return how many periods are skipped, because one before took longer: the least of some tries."""
    clock, period_ns = MonotonicClock(), round(1e9 / rate)

    def tried() -> int:
        deadline_ns, missed = clock.now_ns(), 0
        for _ in range(round(TRY * rate)):
            late_ns = clock.sleep_until(deadline_ns)
            missed += late_ns // period_ns
            deadline_ns += (1 + late_ns // period_ns) * period_ns
            call()
        return missed

    return min(tried() for _ in range(TRIES))


def missed_at(kind: str) -> Iterator[tuple[str, list[int]]]:
    """Yield whose periods they are, and those missed in a try at each of `RATES`; SCHED_FIFO where it is granted."""
    for name, make, axes in (("a bare timer", lambda *_: float, 1), *((name, *each) for name, each in MAKERS.items())):
        with ExitStack() as stack:
            stack.enter_context(answering(kind, axes))
            call = make(kind, stack)
            stack.enter_context(rights.requested(rights._timer_slack, rights._fifo))
            yield name, [misses(call, rate) for rate in RATES]


def rates_text(kind: str) -> str:
    """Return the missed periods as a table."""
    heads = ["periods missed at", *(f"{rate} Hz" for rate in RATES)]
    found = [[name, *map(str, each)] for name, each in missed_at(kind)]
    lines = ("| " + " | ".join(each) + " |\n" for each in (heads, ["---"] * len(heads), *found))
    return f"Measured on {machine()}.\n\n" + "".join(lines)


def main() -> None:
    """Measure a kind of bus some times and print each round, as a line or as a JSON object; `rates`: missed periods."""
    kind, rounds, *words = sys.argv[1:]
    if rounds == "rates":
        text = rates_text(kind)
        print(text)
        if "--write" in words:
            put_on_page(f"wire_period.py {kind} rates --write", text)
        return
    if not words:
        print(machine())
    for _ in range(int(rounds)):
        found = measured(kind)
        told = ", ".join(f"{name} {1e6 * each:.1f} µs" for name, each in found.items())
        print(json.dumps(found) if words else told, flush=True)


if __name__ == "__main__":
    main()
