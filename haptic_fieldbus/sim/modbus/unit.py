"""A simulated drive on a Modbus line: the drive together with its registers.

Pure: it is read and written with times [ns]. An object of CiA 402 that the profile gives no register has none, and the
drive works with its power-on value. A register of the profile's set-up that stands for no object of the simulated drive
keeps what is written to it, and does nothing.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.drive.units import COUNTS
from haptic_fieldbus.protocols.modbus.profile import (
    READ_HOLDING,
    READ_INPUT,
    READ_WRITE,
    ModbusProfile,
    Register,
    modbus_profile,
)
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.dictionary import Access, Entry
from haptic_fieldbus.sim.drive.objects import DISABLE
from haptic_fieldbus.sim.drive.settings import DriveSettings, steps_of_position
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.modbus.front import Front
from haptic_fieldbus.sim.modbus.model import CYCLIC_TORQUE, inner_profile, written_registers
from haptic_fieldbus.sim.modbus.registers import Refusal, Registers
from haptic_fieldbus.sim.modbus.watchdog import Watchdog

LOST_MASTER = 0x8130
"""Error code of a drive that has lost its master, when its profile names none: life guard error (CiA 402-2)."""
_READING = (READ_HOLDING, READ_INPUT, READ_WRITE)
_OBJECTS = (0x1000, 0xFFFF)


class Unit:
    """One drive under a unit id; it is the `DriveLink` of the drive."""

    def __init__(
        self,
        number: int,
        profile: DriveProfile,
        axis: RigAxis,
        hand: Hand | None = None,
        settings: DriveSettings | None = None,
        t_ns: int = 0,
    ) -> None:
        """Build the drive at `t_ns`, without voltage yet; `power_on` follows."""
        self.number = number
        self.profile: ModbusProfile = modbus_profile(profile)
        self.silent_until_ns = 0
        """Until this time the drive neither hears nor answers."""
        self.causes: set[object] = set()
        """Causes of faults that last."""
        settings = replace(settings or DriveSettings(), full_scale=self.profile.torque.full_scale)
        self.drive = Drive(inner_profile(self.profile), axis, self, hand, settings, t_ns)
        self.registers = Registers(self.profile.line)
        self.identity: list[Entry] = []
        self._kept: list[Entry] = []
        """Entries that stand for no object."""
        self._now_ns = t_ns
        self._lost_master = 0
        self._scale_position(axis)
        self._front = self._add_power()
        self.watchdog = self._add_watchdog()
        self._add_signals()
        self._add_others()

    # Called by the rack.

    @property
    def due_ns(self) -> int:
        """Return the time of the next timer; NEVER_NS when there is none."""
        return min(self.drive.due_ns, self.watchdog.due_ns if self.watchdog is not None else NEVER_NS)

    def timer(self, t_ns: int) -> None:
        """Serve the timers that are due."""
        self._now_ns = t_ns
        if self.drive.due_ns <= t_ns:
            self.drive.timer(t_ns)
        if self.watchdog is not None and self.watchdog.expired(t_ns):
            self.drive.link_lost(self._lost_master, t_ns)

    def power_on(self, t_ns: int, duration_ns: int = 0) -> None:
        """Switch the voltage on; the drive answers `duration_ns` later."""
        self._now_ns = t_ns
        self.silent_until_ns = max(self.silent_until_ns, t_ns + duration_ns)
        self.drive.dictionary.restore(*_OBJECTS)
        for entry in self._kept:
            entry.reset()
        self.drive.restart(t_ns)
        if self._front is not None:
            self._front.command.reset()
        if self.watchdog is not None:
            self.watchdog.restart(t_ns)

    def enabled(self, t_ns: int) -> None:
        """Count the time of the watch from *operation enabled* too."""
        if self.watchdog is not None:
            self.watchdog.restart(t_ns)

    # Called by the station.

    def hears(self, t_ns: int) -> bool:
        """Return whether the drive takes part on the line at all."""
        return t_ns >= self.silent_until_ns

    def cannot_read(self, function: int, address: int, count: int) -> Refusal | None:
        """Return why registers cannot be read by this function; None when they can."""
        line = self.profile.line
        if function not in line.functions or function not in _READING:
            return Refusal.FUNCTION
        if not 1 <= count <= line.longest_read:
            return Refusal.VALUE
        return None if self.registers.has(address, count) else Refusal.ADDRESS

    def read(self, function: int, address: int, count: int, t_ns: int) -> list[int] | Refusal:
        """Return the values of registers at this time, or why not."""
        refusal = self.cannot_read(function, address, count)
        if refusal is not None:
            return refusal
        self._now_ns = t_ns
        self.drive.measure(t_ns)
        return self.registers.read(address, count)

    def write(self, address: int, values: Sequence[int], t_ns: int) -> Refusal | None:
        """Write registers at this time, all of them; else return why not."""
        if not 1 <= len(values) <= self.profile.line.longest_write:
            return Refusal.VALUE
        self._now_ns = t_ns
        self.drive.measure(t_ns)
        outcome = self.registers.write(address, values)
        if isinstance(outcome, Refusal):
            return outcome
        self._watch(outcome, t_ns)
        return None

    def write_as_stranger(self, share: float, t_ns: int) -> None:
        """Take a target torque of another master, as a share of rated torque; it feeds the watch as ours does."""
        objects, (low, high) = self.drive.objects, self.profile.torque.target.type.limits
        if self.hears(t_ns):
            self._now_ns = t_ns
            self.drive.measure(t_ns)
            objects.target_torque.value = min(max(round(share * objects.rated_torque / objects.torque_unit), low), high)
            self.drive.act(t_ns)
            self._watch((objects.target_torque,), t_ns)

    def has(self, function: int) -> bool:
        """Return whether the drive understands a function."""
        return function in self.profile.line.functions

    # Called by the drive.

    def error(self, code: int, t_ns: int) -> None:
        """A drive on Modbus reports nothing unasked."""

    def persists(self) -> bool:
        """Return whether the cause of a fault is present."""
        return bool(self.causes)

    def clear_errors(self, t_ns: int) -> None:
        """Nobody is to be told."""

    # Inside.

    def _watch(self, entries: Sequence[Entry], t_ns: int) -> None:
        if self.watchdog is None:
            return
        target = self.drive.objects.target_torque
        if any(entry is target or entry is self.watchdog.time for entry in entries):
            self.watchdog.restart(t_ns)

    def _scale_position(self, axis: RigAxis) -> None:
        """Let a revolution of the motor have the steps of the profile's unit."""
        position, table = self.profile.position, self.drive.objects.table
        if position is None or position.actual.unit in ("", COUNTS):
            return
        steps = Fraction(steps_of_position(position.actual.unit, axis)).limit_denominator(1_000_000)
        for subindex, value in ((1, steps.numerator), (2, steps.denominator)):
            entry = table[0x6092, subindex]
            entry.value = entry.default = value
        self.drive.units.update()

    def _add_power(self) -> Front | None:
        power, objects, drive = self.profile.power, self.drive.objects, self.drive
        if power.error is not None:
            self.registers.both(power.error, objects.error_code)
        if power.table == "cia402":
            self.registers.both(power.status, objects.statusword)
            self.registers.both(power.command, objects.controlword)
            return None
        front = Front(power, lambda: drive.power.state, self._obey)
        self.registers.add(power.status, front.status)
        self.registers.add(power.command, front.command, front.command)
        # No register tells this drive its mode of operation in the words of CiA 402.
        objects.mode.value = objects.mode.default = CYCLIC_TORQUE
        if all(row.state is not PowerState.FAULT_REACTION_ACTIVE for row in power.rows):
            # A drive that braked in *fault* would not be off, though it says so.
            objects.fault_reaction_option.value = DISABLE
        return front

    def _obey(self, controlword: int) -> None:
        self.drive.objects.controlword.value = controlword
        self.drive.act(self._now_ns)

    def _add_watchdog(self) -> Watchdog | None:
        section = self.profile.watchdog
        if section is None:
            return None
        self._lost_master = LOST_MASTER if section.fault is None else section.fault
        watchdog = Watchdog(self._keep(section.time), section.time.unit)
        self.registers.both(section.time, watchdog.time)
        return watchdog

    def _add_signals(self) -> None:
        profile, objects = self.profile, self.drive.objects
        torque, mode = profile.torque, profile.mode
        pairs = [
            (torque.target, objects.target_torque),
            (torque.actual, objects.actual_torque),
            (torque.demand, objects.row(0x6074)),
            (torque.rated, self.drive.dictionary.find(0x6076) if torque.rated is not None else None),
            (profile.position.actual if profile.position is not None else None, objects.position),
            (profile.velocity.actual if profile.velocity is not None else None, objects.velocity),
        ]
        if mode is not None and profile.power.table == "cia402":
            pairs += [(mode.write, objects.mode), (mode.display, objects.mode_display)]
        for register, entry in pairs:
            if register is not None and entry is not None:
                self.registers.both(register, entry)
        if torque.limit is not None:
            self._add_limit(torque.limit)

    def _add_limit(self, register: Register) -> None:
        """Let the drive's own limit be that of 6072h, in whatever unit."""
        objects, most = self.drive.objects, self.drive.objects.row(0x6072)
        scale = objects.step(register.unit) / (1e-3 * objects.rated_torque)
        start = min(register.type.limits[1], round(most.default / scale))
        entry = Entry(0, 0, register.type, start, Access.RW, limits=(0, register.type.limits[1]))

        def changed() -> None:
            most.value = min(most.high, round(entry.value * scale))
            self.drive.act(self._now_ns)

        entry.changed = changed
        self._kept.append(entry)
        self.registers.both(register, entry)

    def _add_others(self) -> None:
        profile, mode = self.profile, self.profile.mode
        for identity in profile.identity:
            value = identity.values[0] if identity.values else 0
            self.identity.append(Entry(0, 0, identity.type, value, Access.CONST))
            self.registers.both(identity, self.identity[-1])
        if profile.serial is not None:
            number = self.drive.settings.serial % (profile.serial.type.limits[1] + 1)
            self.registers.both(profile.serial, Entry(0, 0, profile.serial.type, number, Access.CONST))
        others: list[Register] = list(written_registers(profile))
        if mode is not None and profile.power.table != "cia402":
            others.append(mode.write)
        for register in others:
            if register.address not in self.registers:
                self.registers.both(register, self._entry_of(register))

    def _entry_of(self, register: Register) -> Entry:
        """Return the object that a register stands for, else an entry that keeps what is written."""
        if register.object is not None and register.object in self.drive.dictionary:
            return self.drive.dictionary.find(register.object)
        return self._keep(register)

    def _keep(self, register: Register) -> Entry:
        entry = Entry(0, 0, register.type, access=Access.RW)
        self._kept.append(entry)
        return entry
