"""Simulated drives on a Modbus line, for one test: a TCP port of this computer, or a pseudo-terminal.

The drives are served in a thread of their own, in real time. What a test asks of them is done in that thread, between
two requests of a master, so nothing is seen half done.
"""

import asyncio
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from struct import unpack
from threading import Event, Thread

from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_MODBUS_DRIVE, DEFAULT_SEED
from haptic_fieldbus.errors import UsageError, raise_all
from haptic_fieldbus.protocols.modbus.bus import line_of, modbus_section, parse_bus
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.protocols.modbus.protocol import PROTOCOL
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import checked_faults, of_no_drive
from haptic_fieldbus.sim.host_request import collecting
from haptic_fieldbus.sim.modbus.drives import KINDS
from haptic_fieldbus.sim.modbus.hosting import Server, device, listen
from haptic_fieldbus.sim.modbus.registers import Refusal
from haptic_fieldbus.sim.modbus.unit import Unit
from haptic_fieldbus.testing.bench import POLL, Answer, DriveInside, DriveRequest, FaultPlan, waited_for

FREE_PORT = "modbus-tcp:127.0.0.1:0"
_LONGEST = 100_000
"""Least number of latest motion segments that are kept."""
_PATIENCE = 30.0
"""Time within which a thread that works must answer, on a busy machine [s]."""


class VirtualModbusLine:
    """Drives on a line; masters open it in a `with` block by its `name`, or by its host and port or its device."""

    def __init__(
        self,
        drives: Iterable[DriveRequest] = (),
        faults: FaultPlan | None = None,
        *,
        bus: str = FREE_PORT,
        seed: int = DEFAULT_SEED,
    ) -> None:
        """Take what is to be on the line; `bus` is written as for `haptic-fieldbus simulate`, a free port by default.

        Raises UsageError for an unknown profile or hand or a fault that no Modbus line has, ProfileError for a bad
        profile file, PlanError for a drive that is not made for such a line.
        """
        self.faults, self.seed = faults or FaultPlan(), seed
        if wrong := [fault.kind for fault in self.faults.faults if fault.kind not in KINDS]:
            raise UsageError(f'a Modbus line does not support the fault "{wrong[0]}"; remove it')
        self._section = modbus_section(parse_bus(bus).section)
        requests = tuple(drives) or (DriveRequest(),)
        self._slots: list[DriveOnBus] = []
        for each in requests:
            with collecting(wrong):
                self._slots.append(slot := each.slot(DEFAULT_MODBUS_DRIVE, "line", self.faults.faults))
                if wanted := PROTOCOL.wanted_node(slot.node, self._section.interface):
                    raise UsageError(f"node {slot.node!r}: expected {wanted}")
        raise_all(wrong or of_no_drive(self.faults.faults, [slot.node for slot in self._slots]))
        line_of(self._section, [modbus_profile(slot.profile) for slot in self._slots])
        self.name = bus
        """The bus as the command line of haptic-fieldbus names it."""
        self.channel = self._section.channel
        """`HOST:PORT` on TCP, the device on a serial line."""
        self.drives: dict[int, SimulatedUnit] = {}
        """The drives by unit id."""
        self._loop = asyncio.new_event_loop()
        self._opened: Future[BusName] = Future()
        self._stopped = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def __enter__(self) -> "VirtualModbusLine":
        self._thread.start()
        opened = self._opened.result(_PATIENCE)
        self.name, self.channel = opened.text, modbus_section(opened.section).channel
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join(_PATIENCE)

    def __str__(self) -> str:
        drives = "\n".join(f"unit {slot.node}: {slot.profile.title}" for slot in self._slots)
        return f"{drives}\n{self._section.interface}, seed {self.seed}\n{self.faults.text}"

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of a TCP line; raises UsageError for a serial one."""
        host, _, port = self.channel.rpartition(":")
        if self._section.serial:
            raise UsageError(f"{self._section.interface}:{self.channel} has no address; its channel is the device")
        return host, int(port)

    def wait_until(self, condition: Callable[[], bool], longest: float = 1.0) -> bool:
        """Wait until the condition holds; False when it does not within `longest` s."""
        return waited_for(condition, longest, MonotonicClock(), time.sleep)

    def between_requests(self, action: Callable[[], Answer]) -> Answer:
        """Do something in the thread of the drives, and return what came of it."""

        async def done() -> Answer:
            return action()

        return asyncio.run_coroutine_threadsafe(done(), self._loop).result(_PATIENCE)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:  # told to whoever waits for the line
            if not self._opened.done():
                self._opened.set_exception(error)
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        clock, section = MonotonicClock(), self._section
        server = Server(clock, self.seed, serial=section.serial, longest=_LONGEST)
        for slot in self._slots:
            unit = server.requests.drives.add(slot, clock.now_ns())
            self.drives[slot.node] = SimulatedUnit(self, server, unit, clock)
        with device(section) as (own, theirs):
            try:
                self._opened.set_result(PROTOCOL.bus_name(await listen(server, own, theirs, self._slots, self.name)))
                while not self._stopped.is_set():
                    await asyncio.sleep(POLL)  # until the next look at the timers
                    server.requests.drives.run(clock.now_ns())
            finally:
                await server.close()


class SimulatedUnit(DriveInside):
    """One drive of a `VirtualModbusLine`."""

    number_word = "unit"

    def __init__(self, line: VirtualModbusLine, server: Server, unit: Unit, clock: MonotonicClock) -> None:
        self._line, self._server, self._unit, self._clock = line, server, unit, clock
        self.profile: ModbusProfile = unit.profile

    @property
    def node(self) -> int:
        """Return the unit id."""
        return self._unit.number

    def registers(self, address: int, count: int = 1) -> list[int]:
        """Return the values of registers, as a request would read them; raises LookupError when it would be refused."""
        function = self.profile.line.reading or self.profile.line.functions[0]
        found = self._now(lambda: self._unit.read(function, address, count, self._clock.now_ns()))
        if isinstance(found, Refusal):
            raise LookupError(f"the simulated {self.profile.title} has no {count} registers at {address:04X}h")
        return list(unpack(f">{count}H", found))

    def happen(self, fault: faults.DriveFaultKind | faults.AnswerFault) -> None:
        """Let a fault of this drive or of its answers happen; its `at` counts from now."""
        checked_faults((fault,))
        if fault.kind not in KINDS or not isinstance(fault, faults.DriveFaultKind | faults.AnswerFault):
            raise ValueError(f'fault "{fault.kind}" cannot begin while the line runs')
        self._now(lambda: self._server.requests.drives.let_happen(fault, self.node, self._clock.now_ns()))

    def _ask(self, read: Callable[[Drive], Answer], *, moved: bool = False) -> Answer:
        return self._now(lambda: read(self._unit.drive))

    def _now(self, action: Callable[[], Answer]) -> Answer:
        def at_present() -> Answer:
            now_ns = self._clock.now_ns()
            self._server.requests.drives.run(now_ns)
            self._unit.drive.servo.advance(now_ns)
            return action()

        return self._line.between_requests(at_present)
