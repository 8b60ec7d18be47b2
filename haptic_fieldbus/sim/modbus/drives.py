"""The units of a Modbus line, their timers, and their faults.

Requests come from a line, simulated or real. Everything random (serial number, position of the encoder's zero within a
count) is drawn from the seed.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from random import Random

from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.protocols.modbus.register_traffic import TCP_OCTETS
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import Action, DriveBench, Plan, TimedFault, inject_drive, until, with_faulty_hand
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.modbus.unit import Unit

# Faults of answers on their way to the master: what arrives, and when.

GARBAGE = (1, 40)
"""Least and greatest number of random octets in place of an answer."""


class AnswerDisturbances:
    """Faults that wait for the next answers of the drives; random octets are drawn from the seed."""

    def __init__(self, seed: int | str, *, serial: bool) -> None:
        self._random = Random(f"{seed}/answers")
        self._serial = serial
        self.waiting: list[tuple[int, faults.AnswerDisturbance]] = []
        """Faults with the units that they concern; the `count` of each is what is left of it."""
        self._held: list[bytes] = []
        """Answers held back until the next request."""

    def add(self, fault: faults.AnswerDisturbance, unit: int) -> None:
        """Disturb the next answers of a drive."""
        self.waiting.append((unit, fault))

    def take(self, unit: int) -> faults.AnswerDisturbance | None:
        """Return the fault of this answer, and count it; None when it has none."""
        for place, (number, fault) in enumerate(self.waiting):
            if number == unit:
                left = [(unit, replace(fault, count=fault.count - 1))] if fault.count > 1 else []
                self.waiting[place : place + 1] = left
                return fault
        return None

    def released(self) -> list[bytes]:
        """Return the answers that were held back until this request."""
        held, self._held = self._held, []
        return held

    def arriving(self, fault: faults.AnswerDisturbance, octets: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield the frames that arrive in place of an answer: additional delay [ns] and octets."""
        match fault:
            case faults.AnswerLost():
                return
            case faults.AnswerSwapped():
                self._held.append(octets)
                return
            case faults.AnswerDelayed(delay=delay):
                yield round(delay * 1e9), octets
            case faults.AnswerGarbage():
                yield 0, self._random.randbytes(self._random.randint(*GARBAGE))
            case faults.AnswerCorrupted():
                # One other bit; TCP protects its payload, so there it is one of the header.
                bit = self._random.randrange(8 * (len(octets) if self._serial else TCP_OCTETS))
                changed = bytearray(octets)
                changed[bit // 8] ^= 1 << bit % 8
                yield 0, bytes(changed)
            case faults.AnswerTruncated(length=length):
                yield 0, octets[:length]
            case _:
                yield 0, octets


_OF_CANOPEN = faults.Emergency | faults.MessageFault | faults.SdoRefusal | faults.LineFault
KINDS = faults.kinds_of(faults.Fault) - faults.kinds_of(_OF_CANOPEN)
"""Kinds of faults that a line and its drives may have."""


InjectLine = Callable[[faults.LineDisturbance | faults.HostFault, int, int], None]
"""Function that applies a fault of the line or of the host: the fault, the unit id of a drive, and the time [ns]."""


class SimulatedUnits(DriveBench):
    """The drives by unit id; all times are those of one clock [ns]."""

    of_line, kinds, protocol = faults.ConnectionReset | faults.HostFault, KINDS, "Modbus"

    def __init__(self, inject_line: InjectLine, seed: int | str = DEFAULT_SEED, longest: int | None = None) -> None:
        super().__init__(seed, longest)
        self.units: dict[int, Unit] = {}
        self.now_ns = 0
        """Time up to which timers and actions have been served."""
        self._inject_line = inject_line

    def add(self, slot: DriveOnBus, t_ns: int) -> Unit:
        """Power a drive on; raises UsageError (see `check`)."""
        self.check(slot)
        unit = Unit(with_faulty_hand(slot), self.drawn(slot), t_ns)
        self.units[slot.node] = unit
        self.follow(unit.drive, slot)
        unit.drive.on_enabled = partial(_enabled, unit, unit.drive.on_enabled)
        self.timed += unit.timers
        unit.power_on(t_ns)
        return unit

    def install(self, fault: faults.LastingFault, node: int) -> None:
        unit = self.units[node]
        match fault:
            case faults.MissingNode():
                unit.silent_until_ns = NEVER_NS
            case faults.DeadGuard(factor=factor):
                unit.watchdog.factor = factor
            case faults.WrongIdentity(product_code=code):
                for entry in unit.identity:
                    entry.start_with(code if code is not None else entry.value ^ 1)
            case _:
                raise ValueError(f"drives on Modbus do not support the fault {fault.kind}")

    def run(self, until_ns: int) -> None:
        """Serve all timers and actions up to and including this instant, each at its own."""
        while (due_ns := self.next_due_ns) <= until_ns:
            self.serve(due_ns)
        if until_ns > self.now_ns:
            self.now_ns = until_ns

    def serve(self, due_ns: int) -> None:
        """Serve the timers and actions of one instant, which `due_ns` has given."""
        self.now_ns = due_ns
        self.queue.run(due_ns)
        for unit in self.units.values():
            for timer in unit.timers:
                if timer.due_ns <= due_ns:
                    unit.timer(due_ns)
                    break

    def action(self, node: int, fault: TimedFault) -> Action:
        unit = self.units[node]
        if isinstance(fault, faults.ForeignSetPoints):
            return partial(self._meddle, fault, unit, 1)
        if isinstance(fault, faults.AnswerFault | faults.HostFault):
            return partial(self._inject_line, fault, node)
        if not isinstance(fault, faults.DriveFaultKind):
            raise ValueError(f"drives on Modbus do not support the fault {fault.kind}")
        return partial(inject_unit, fault, unit, self.queue.plan)

    def _meddle(self, fault: faults.ForeignSetPoints, unit: Unit, number: int, t_ns: int) -> None:
        """Let another master write one of its set-points, and plan the next write."""
        unit.write_as_stranger(fault.share, t_ns)
        if fault.count is None or number < fault.count:
            self.queue.plan(t_ns + round(fault.interval * 1e9), partial(self._meddle, fault, unit, number + 1))


def _enabled(unit: Unit, begin: Action, t_ns: int) -> None:
    """Count the time of the watch, and that of the faults, from *operation enabled*."""
    unit.watchdog.restart(t_ns)
    begin(t_ns)


def inject_unit(fault: faults.DriveFaultKind, unit: Unit, plan: Plan, t_ns: int) -> None:
    """Apply a fault of a drive that happens at `t_ns`."""
    match fault:
        case faults.DriveFault(code=code, duration=duration):
            unit.drive.measure(t_ns)
            unit.drive.fault(code, t_ns)
            if duration != 0.0:
                unit.causes.add(fault)
                plan(until(t_ns, duration), lambda _t_ns: unit.causes.discard(fault))
        case faults.NodeReset(duration=duration):
            unit.drive.measure(t_ns)
            unit.power_on(t_ns, round(duration * 1e9))
        case faults.Silence(duration=duration):
            unit.silent_until_ns = max(unit.silent_until_ns, until(t_ns, duration))
        case _:
            inject_drive(fault, unit.drive, plan, t_ns)
