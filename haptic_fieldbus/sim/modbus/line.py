"""A Modbus line with its drives in virtual time, as the transport of a master.

Theory. A request is under way for its characters (none on TCP) and half of the round trip. On RTU the silence after a
request marks its end. The drive works for its answer time, and writes and reads its registers at the end of this time.
Then the answer is transmitted in the same way. On RTU, without the silence between them, the drives read other octets
and a following request as one frame, and do not understand it.

Time passes while the master waits, for an answer or for anything else. Each access to the line runs the due events of
the drives, each at its own instant. Everything random is drawn from the seed, so the same seed gives the same octets.
"""

import errno
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.buses.modbus.transport import translate
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.protocols.modbus.bus import line_of, modbus_section
from haptic_fieldbus.protocols.modbus.profile import Parity, modbus_profile
from haptic_fieldbus.protocols.modbus.register_traffic import LineTimes
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import DrivenBus, until
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.modbus.drives import KINDS
from haptic_fieldbus.sim.modbus.station import RequestServer, ServerRequest
from haptic_fieldbus.sim.modbus.unit import Unit
from haptic_fieldbus.sim.simulation import HostClock, Simulation, truth_of

_TOLERANCE_NS = 1_000
"""Permitted shortfall of a silence, for rounding."""

Tap = Callable[[int, bool, bytes], None]
"""Callback for a frame: begin [ns], True if the master sent it, and the octets that arrive."""


class _Arrival(NamedTuple):
    """Octets on their way to the master: arrival of the first and of the last one [ns]."""

    first_ns: int
    last_ns: int
    octets: bytes


class SimulatedLine(DrivenBus):
    """A line with its drives; the times are those of `clock`, the host's."""

    def __init__(
        self,
        name: str,
        wire: LineTimes,
        clock: Clock,
        seed: int | str = DEFAULT_SEED,
        *,
        serial: bool,
        echo: bool = False,
    ) -> None:
        """With `echo` the master receives its own frames, as with some adapters."""
        self.name, self.serial = name, serial
        self._wire, self._host, self._clock, self._echo = wire, clock, truth_of(clock), echo
        self._requests = RequestServer(self.inject_line, seed, serial=serial)
        self._drives = self._requests.drives
        super().__init__(self._drives)
        self._coming: list[_Arrival] = []
        self._next_ns = NEVER_NS
        """Arrival of the last octet of the frame that comes first."""
        self._octet_ns = wire.octet * 1e9
        self._way_ns, self._silence_ns = round(0.5 * wire.round_trip * 1e9), round(wire.silence * 1e9)
        self._traffic: deque[tuple[int, int]] = deque()
        """Begin and end [ns] of recent and coming frames on the line."""
        self._dead_since_ns = self._dead_until_ns = 0
        self._broken = False
        self._taps: list[Tap] = []

    # Setting up.

    def add(self, slot: DriveOnBus) -> Unit:
        """Put a drive on the line; raises UsageError (see `check`)."""
        return self._drives.add(slot, self._clock.now_ns())

    def unit(self, number: int) -> Unit:
        return self._drives.units[number]

    def tap(self, callback: Tap) -> None:
        """Call `callback` with every frame."""
        self._taps.append(callback)

    # The transport.

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        """Do nothing: the plan sets the speed of a simulated line."""

    def discard(self) -> bytes:
        """Drop all octets that wait, and return them; raises BusError when the line is dead."""
        return self._taken(self._check_alive())

    def send(self, frame: bytes | bytearray) -> None:
        """Send a frame; raises BusError when the line is dead."""
        begin_ns, frame = self._check_alive(), bytes(frame)  # a master fills the same octets again
        for tap in self._taps:
            tap(begin_ns, True, frame)
        end_ns, glued = begin_ns + round(self._octet_ns * len(frame)), False
        if self.serial:
            glued = self._is_glued(begin_ns)
            self._traffic.append((begin_ns, end_ns))
        if self._echo:
            self._comes(begin_ns, frame)
        for octets in self._requests.disturbances.released():
            self._comes(begin_ns + self._way_ns, octets)
        _, asked = self._requests.next(frame)
        if asked is not None and not glued:
            heard_ns = end_ns + self._way_ns + self._silence_ns
            self._drives.queue.plan(heard_ns + self._answer_ns(asked), partial(self._execute, asked))

    def receive(self, deadline_ns: int) -> bytes:
        """Return the octets that have arrived; the clock advances to the end of an answer, or to the deadline [ns]."""
        clock, drives, now_ns = self._clock, self._drives, self._check_alive()
        if octets := self._taken(now_ns):
            return octets
        limit_ns = now_ns + max(0, deadline_ns - self._host.now_ns())
        while (due_ns := drives.next_due_ns) <= (end_ns := min(limit_ns, self._next_ns)):
            drives.serve(due_ns)
            if self._broken:
                clock.sleep_until(min(limit_ns, self._dead_since_ns))
                self._check_alive()
        clock.sleep_until(end_ns)
        now_ns = clock.now_ns()
        if now_ns >= due_ns:  # a real clock has gone on
            drives.run(now_ns)
        drives.now_ns = now_ns
        return self._taken(now_ns)

    def reopen(self) -> None:
        """Reopen a dead line; raises BusError while that is not possible."""
        if self._clock.now_ns() < self._dead_until_ns:
            raise self._error(errno.ENOENT if self.serial else errno.ECONNREFUSED)
        self._broken = False
        self._lose()

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def run(self) -> None:
        """Run all events up to the present of the clock."""
        self._drives.run(self._clock.now_ns())

    @property
    def reached_ns(self) -> int:
        return self._drives.now_ns

    # Faults.

    def inject_line(self, fault: faults.LineDisturbance | faults.HostFault, number: int, t_ns: int) -> None:
        """Disturb the next answers of a drive, or break the line, or let a fault of the master's computer happen.

        Raises ValueError for the last one when the clock of the host is not simulated.
        """
        if isinstance(fault, faults.HostFault):
            if not isinstance(self._host, HostClock):
                raise ValueError(f'fault "{fault.kind}" needs a simulated clock of the host')
            self._host.happen(fault)
        elif isinstance(fault, faults.ConnectionReset):
            self._broken, self._dead_since_ns, self._dead_until_ns = True, t_ns, until(t_ns, fault.duration)
            self._lose()
        else:
            self._requests.disturbances.add(fault, number)

    # Inside.

    def _answer_ns(self, asked: ServerRequest) -> int:
        unit = self._drives.units.get(asked.unit)
        return 0 if unit is None else unit.answer_ns

    def _execute(self, asked: ServerRequest, t_ns: int) -> None:
        """Execute a request, and send its answer."""
        for later_ns, octets in self._requests.answer(asked, t_ns):
            for tap in self._taps:
                tap(t_ns + later_ns, False, octets)
            self._comes(t_ns + later_ns + self._way_ns, octets)

    def _comes(self, begin_ns: int, octets: bytes) -> None:
        """Let octets arrive; the first one arrives one character after `begin_ns`."""
        if octets:
            self._coming.append(self._arriving(begin_ns + round(self._octet_ns), octets))
            self._next_ns = min(self._next_ns, self._coming[-1].last_ns)
            if self.serial:
                self._traffic.append((begin_ns, begin_ns + round(self._octet_ns * len(octets))))

    def _arriving(self, first_ns: int, octets: bytes) -> _Arrival:
        return _Arrival(first_ns, first_ns + round(self._octet_ns * (len(octets) - 1)), octets)

    def _is_glued(self, t_ns: int) -> bool:
        """Return whether a frame is on the serial line at this time, or ended less than the silence before."""
        since_ns = t_ns - self._silence_ns + _TOLERANCE_NS
        self._traffic = deque(each for each in self._traffic if each[1] > since_ns)
        return any(begin_ns <= t_ns for begin_ns, _ in self._traffic)

    def _taken(self, now_ns: int) -> bytes:
        """Take the octets that have arrived by now."""
        coming, taken = self._coming, b""
        if not coming:
            return taken
        self._coming, self._next_ns = [], NEVER_NS
        for each in coming:
            if now_ns >= each.last_ns:
                taken += each.octets
                continue
            if now_ns >= each.first_ns:
                count = 1 + int((now_ns - each.first_ns) / self._octet_ns)
                taken += each.octets[:count]
                each = self._arriving(each.first_ns + round(self._octet_ns * count), each.octets[count:])
            self._coming.append(each)
            self._next_ns = min(self._next_ns, each.last_ns)
        return taken

    def _lose(self) -> None:
        """Lose all octets that are on their way to the master."""
        self._coming, self._next_ns = [], NEVER_NS

    def _check_alive(self) -> int:
        """Run all events up to the present [ns], and return it; raises BusError when the line is dead."""
        now_ns = self._clock.now_ns()
        self._drives.run(now_ns)
        if self._broken:
            raise self._error(errno.EIO if self.serial else errno.ECONNRESET)
        return now_ns

    def _error(self, number: int) -> Exception:
        return translate(OSError(number, ""), self.name)


# Creation of a simulated Modbus line with a master on it.


class ModbusSimulation(Simulation):
    """The simulation of Modbus lines."""

    kinds = KINDS

    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[DriveOnBus], clock: Clock, seed: int | str, log: Any
    ) -> tuple[ModbusBus, SimulatedLine | None]:
        own = modbus_section(section)
        wire = line_of(own, [modbus_profile(slot.profile) for slot in slots])
        line = SimulatedLine(channel or own.interface, wire, clock, seed, serial=own.serial, echo=own.echo)
        # A clock that steps is no clock of the true motion: what the shaft did at its instants is not known.
        apart = any(isinstance(fault, faults.ClockStep) for slot in slots for fault in slot.faults)
        for slot in slots:
            line.add(slot)
        return ModbusBus(line, clock, own), (None if apart else line)


SIMULATION = ModbusSimulation()
