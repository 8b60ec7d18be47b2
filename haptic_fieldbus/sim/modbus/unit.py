"""A simulated drive on a Modbus line: the drive together with its registers.

Pure: it is read and written with times [ns]. An object of CiA 402 without a register in the profile keeps its power-on
value. A register of the profile's set-up without an object in the simulated drive stores its value without effect.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from haptic_fieldbus.drive import cia402
from haptic_fieldbus.drive.profile import DataType, PowerRow, PowerState
from haptic_fieldbus.drive.rig import COUNTS, RigAxis
from haptic_fieldbus.protocols.modbus.profile import (
    ModbusProfile,
    PowerSection,
    Register,
    WrittenRegister,
    modbus_profile,
)
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.drive.core import Drive, Operation
from haptic_fieldbus.sim.drive.dictionary import Access, Entry, one_of
from haptic_fieldbus.sim.drive.objects import CYCLIC_TORQUE, DISABLE
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.drive.settings import DriveSettings, steps_of_position
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.modbus.registers import Refusal, Registers

# The drive inside: a drive with the objects of CiA 402 that stands behind the registers of a Modbus profile.

POSITION, VELOCITY, TARGET, ACTUAL, DEMAND, RATED = 0x6064, 0x606C, 0x6071, 0x6077, 0x6074, 0x6076
ABORT_OPTION, REACTION_OPTION = 0x6007, 0x605E


@dataclass(frozen=True, kw_only=True)
class InnerProfile(cia402.Cia402Profile):
    """CiA 402 profile of the drive inside, with the watchdog of its Modbus profile."""

    watched: bool

    @property
    def guarded(self) -> bool:
        return self.watched


def inner_profile(profile: ModbusProfile) -> InnerProfile:
    """Return the drive inside."""
    torque, position, velocity = profile.torque, profile.position, profile.velocity
    mode = profile.mode.value if profile.mode is not None and profile.power.table == "cia402" else CYCLIC_TORQUE
    return InnerProfile(
        schema=1,
        drive=profile.drive,
        timing=profile.timing,
        name=profile.name,
        source=profile.source,
        torque=cia402.TorqueSection(
            mode,
            _object(TARGET, torque.target),
            _object(ACTUAL, torque.actual) if torque.actual is not None else None,
            _object(RATED, torque.rated) if torque.rated is not None else None,
            _object(DEMAND, torque.demand) if torque.demand is not None else None,
        ),
        position=None if position is None else cia402.PositionSection(_object(POSITION, position.actual)),
        velocity=None if velocity is None else cia402.VelocitySection(_object(VELOCITY, velocity.actual)),
        link_loss=cia402.LinkLoss(
            abort_connection_option=_option(profile, ABORT_OPTION),
            fault_reaction_option=_option(profile, REACTION_OPTION),
        ),
        watched=profile.guarded,
    )


def written_registers(profile: ModbusProfile) -> tuple[WrittenRegister, ...]:
    """Return the registers that get a value of the profile: by its set-up and by its choice of the reaction."""
    return (*profile.setup, *(profile.watchdog.writes if profile.watchdog is not None else ()))


def _object(index: int, register: Register) -> cia402.MappedObject:
    return cia402.MappedObject(index, register.type, unit=register.unit)


def _option(profile: ModbusProfile, index: int) -> cia402.OptionCode | None:
    found = (register for register in written_registers(profile) if register.object == index)
    return next((cia402.OptionCode(index, register.value) for register in found), None)


# The drive's watch on its master: a time within which a target torque must be written.
#
# Theory: the time counts from each request that writes the target, from *operation enabled*, and from the writing of
# the time itself. A time of 0 switches the watch off. When it is over the drive reacts once, as to a lost link (CiA
# 402-2, 6007h), and waits for the next of these.

UNITS = {"ms": 1_000_000, "s": 1_000_000_000}
"""Units of the time → ns."""


class Watchdog:
    """One watch; times [ns]."""

    def __init__(self, time: Entry, unit: str) -> None:
        self.time = time
        self.due_ns = NEVER_NS
        self.factor: float | None = 1.0
        """Reaction time of the watchdog as a multiple of its set time; None: never."""
        self._unit_ns = UNITS[unit]

    def restart(self, t_ns: int) -> None:
        """Count from this instant on."""
        on = self.time.value and self.factor is not None
        self.due_ns = t_ns + round(self.time.value * self._unit_ns * (self.factor or 0.0)) if on else NEVER_NS


# Command and status of a drive that has no controlword: a mode register or an opcode, by the rows of its profile.
#
# Theory: the rows of the profile are the automaton of such a drive as a table. In each of its states the drive shows
# the bits of the row, and the command of that row takes it to the next state of the table on the way to *operation
# enabled*. The profile's `off` frees the shaft in every state, and its `reset` clears a fault. Every other command is
# refused. Inside is the drive of CiA 402, which gets the controlwords of the way that the command stands for.

_WAY = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED)
_WORDS = (0x00, 0x06, 0x07, 0x0F)
"""Controlwords for the states from off to enabled, one after the other."""
_FAULT_RESET = 0x80
"""Controlword that clears a fault."""
_BEHIND = {State.FAULT_REACTION_ACTIVE: State.FAULT, State.QUICK_STOP_ACTIVE: State.OPERATION_ENABLED}
"""States that a table may lack, and the states shown instead."""


class PowerRegisters:
    """The entries of command and status, in the place of controlword and statusword."""

    def __init__(self, power: PowerSection, state: Callable[[], State], obey: Callable[[int], None]) -> None:
        """`state` returns the state of the drive inside, `obey` gives it a controlword."""
        self._state, self._obey, self._off, self._reset = state, obey, power.off, power.reset
        self._rows = {State(row.state.value): row for row in power.rows}
        self.status = Entry(0, 0, power.status.type)
        self.status.fetch = lambda: self._row().bits
        commands = [power.off, *(row.controlword for row in power.rows)]
        commands += [] if power.reset is None else [power.reset]
        self.command = Entry(0, 0, power.command.type, power.off, Access.RW, accept=one_of(commands))
        self.command.changed = self._commanded

    def _row(self) -> PowerRow:
        """Return the row that the drive shows: the row of its state, otherwise of the last state that it passed."""
        state = self._state()
        state = state if state in self._rows else _BEHIND.get(state, state)
        if state in self._rows:
            return self._rows[state]
        passed = reversed(_WAY[: _WAY.index(state)] if state in _WAY else ())
        return next(self._rows[each] for each in (*passed, *_WAY) if each in self._rows)

    def _commanded(self) -> None:
        command, row = self.command.value, self._row()
        if command == self._off:
            self._obey(_WORDS[0])
        elif command == self._reset:
            self._obey(_FAULT_RESET)
        elif command == row.controlword and self._state() in _WAY:
            # Go to the next state of the table on the way.
            place = _WAY.index(self._state()) + 1
            for state, word in zip(_WAY[place:], _WORDS[place:], strict=True):
                self._obey(word)
                if state in self._rows:
                    return


LOST_MASTER = 0x8130
"""Error code of a drive that has lost its master, if its profile names no code: life guard error (CiA 402-2)."""
_OBJECTS = (0x1000, 0xFFFF)


class Unit:
    """One drive under a unit id; it is the `DriveLink` of the drive."""

    def __init__(self, slot: DriveOnBus, settings: DriveSettings | None = None, t_ns: int = 0) -> None:
        """Build the drive at `t_ns`, without voltage yet; `power_on` follows."""
        self.number = slot.node
        self.profile: ModbusProfile = modbus_profile(slot.profile)
        self.functions = self.profile.line.functions
        """Functions that the drive understands."""
        self.answer_ns = round(self.profile.line.answer_time * 1e9)
        """Time that the drive works for an answer."""
        self.silent_until_ns = 0
        """Until this time the drive neither receives nor answers."""
        self.causes: set[object] = set()
        """Causes of faults that last."""
        settings = replace(settings or DriveSettings(), full_scale=self.profile.torque.full_scale)
        self.drive = Drive(inner_profile(self.profile), slot, self, settings, t_ns)
        self.registers = Registers(self.profile.line)
        self.identity: list[Entry] = []
        self._kept: list[Entry] = []
        """Entries without an object."""
        self._now_ns = t_ns
        self._lost_master = 0
        self._scale_position(slot.axis)
        self._power_registers = self._add_power()
        self.watchdog = self._add_watchdog()
        self.timers: tuple[Operation | Watchdog, ...] = (self.drive.operation, self.watchdog)
        """The timers of the drive, each with a `due_ns` of its own."""
        self._add_signals()
        self._add_others()

    # Called by `SimulatedUnits`.

    def timer(self, t_ns: int) -> None:
        """Serve the timers that are due."""
        self._now_ns = t_ns
        if self.drive.operation.due_ns <= t_ns:
            self.drive.operation.timer(t_ns)
        if self.watchdog.due_ns <= t_ns:
            self.watchdog.due_ns = NEVER_NS
            self.drive.link_lost(self._lost_master, t_ns)

    def power_on(self, t_ns: int, duration_ns: int = 0) -> None:
        """Switch the voltage on; the drive answers `duration_ns` later."""
        self._now_ns = t_ns
        self.silent_until_ns = max(self.silent_until_ns, t_ns + duration_ns)
        self.drive.dictionary.restore(*_OBJECTS)
        for entry in self._kept:
            entry.reset()
        self.drive.restart(t_ns)
        if self._power_registers is not None:
            self._power_registers.command.reset()
        self.watchdog.restart(t_ns)

    # Called by the station.

    def hears(self, t_ns: int) -> bool:
        """Return whether the drive takes part on the line at all."""
        return t_ns >= self.silent_until_ns

    def read(self, function: int, address: int, count: int, t_ns: int) -> bytes | Refusal:
        """Return the octets of registers at this time, or the reason of the refusal."""
        if isinstance(reader := self.registers.reader(function, address, count), Refusal):
            return reader
        self._now_ns = t_ns
        self.drive.measure(t_ns)
        return reader()

    def write(self, address: int, octets: bytes, t_ns: int) -> Refusal | None:
        """Write all these registers at this time, or return the reason of the refusal."""
        if not 1 <= len(octets) // 2 <= self.profile.line.longest_write:
            return Refusal.VALUE
        self._now_ns = t_ns
        # Nothing that is measured is read here, so only the shaft is brought up to date.
        self.drive.servo.advance(t_ns)
        if isinstance(outcome := self.registers.write(address, octets), Refusal):
            return outcome
        self._watch(outcome, t_ns)
        return None

    def write_as_stranger(self, share: float, t_ns: int) -> None:
        """Take a target torque of another master, as a share of rated torque; it restarts the watchdog like ours."""
        objects, (low, high) = self.drive.objects, self.profile.torque.target.type.limits
        if self.hears(t_ns):
            self._now_ns = t_ns
            self.drive.measure(t_ns)
            objects.target_torque.value = min(max(round(share * objects.rated_torque / objects.torque_unit), low), high)
            self.drive.act(t_ns)
            self._watch((objects.target_torque,), t_ns)

    # Called by the drive.

    def error(self, code: int, t_ns: int) -> None:
        """Do nothing: a drive on Modbus reports nothing unasked."""

    def persists(self) -> bool:
        """Return whether the cause of a fault is present."""
        return bool(self.causes)

    def clear_errors(self, t_ns: int) -> None:
        """Do nothing: a drive on Modbus reports nothing unasked."""

    # Inside.

    def _watch(self, entries: Sequence[Entry], t_ns: int) -> None:
        if self.drive.objects.target_torque in entries or self.watchdog.time in entries:
            self.watchdog.restart(t_ns)

    def _scale_position(self, axis: RigAxis) -> None:
        """Scale the position: a motor revolution has the number of steps of the profile's unit."""
        position, table = self.profile.position, self.drive.objects.table
        if position is None or position.actual.unit in ("", COUNTS):
            return
        steps = Fraction(steps_of_position(position.actual.unit, axis)).limit_denominator(1_000_000)
        for subindex, value in ((1, steps.numerator), (2, steps.denominator)):
            table[0x6092, subindex].start_with(value)
        self.drive.units.update()

    def _add_power(self) -> PowerRegisters | None:
        power, objects, drive = self.profile.power, self.drive.objects, self.drive
        if power.error is not None:
            self.registers.add(power.error, objects.error_code)
        if power.table == "cia402":
            self.registers.add(power.status, objects.statusword)
            self.registers.add(power.command, objects.controlword)
            return None
        power_registers = PowerRegisters(power, lambda: drive.power.state, self._obey)
        self.registers.add(power.status, power_registers.status)
        self.registers.add(power.command, power_registers.command)
        # No register tells this drive its mode of operation in the words of CiA 402.
        objects.mode.value = objects.mode.default = CYCLIC_TORQUE
        if all(row.state is not PowerState.FAULT_REACTION_ACTIVE for row in power.rows):
            # A drive that braked in *fault* would not be off, though it says so.
            objects.fault_reaction_option.value = DISABLE
        return power_registers

    def _obey(self, controlword: int) -> None:
        self.drive.objects.controlword.value = controlword
        self.drive.act(self._now_ns)

    def _add_watchdog(self) -> Watchdog:
        """Add the registers of the watch; without any its time is 0 for ever."""
        if (section := self.profile.watchdog) is None:
            return Watchdog(Entry(0, 0, DataType.UINT16), "ms")
        self._lost_master = LOST_MASTER if section.fault is None else section.fault
        watchdog = Watchdog(self._keep(section.time), section.time.unit)
        self.registers.add(section.time, watchdog.time)
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
                self.registers.add(register, entry)
        if torque.limit is not None:
            self._add_limit(torque.limit)

    def _add_limit(self, register: Register) -> None:
        """Connect the drive's torque limit register to 6072h, with its unit."""
        objects, most = self.drive.objects, self.drive.objects.row(0x6072)
        scale = objects.step(register.unit) / (1e-3 * objects.rated_torque)
        start = min(register.type.limits[1], round(most.default / scale))
        entry = Entry(0, 0, register.type, start, Access.RW, limits=(0, register.type.limits[1]))

        def changed() -> None:
            most.value = min(most.high, round(entry.value * scale))
            self.drive.act(self._now_ns)

        entry.changed = changed
        self._kept.append(entry)
        self.registers.add(register, entry)

    def _add_others(self) -> None:
        profile, mode = self.profile, self.profile.mode
        for identity in profile.identity:
            value = identity.values[0] if identity.values else 0
            self.identity.append(Entry(0, 0, identity.type, value, Access.CONST))
            self.registers.add(identity, self.identity[-1])
        if profile.serial is not None:
            number = self.drive.settings.serial % (profile.serial.type.limits[1] + 1)
            self.registers.add(profile.serial, Entry(0, 0, profile.serial.type, number, Access.CONST))
        others: list[Register] = list(written_registers(profile))
        if mode is not None and profile.power.table != "cia402":
            others.append(mode.write)
        for register in others:
            if register.address not in self.registers:
                # The object of a register, otherwise an entry that stores the written value.
                known = register.object is not None and register.object in self.drive.dictionary
                entry = self.drive.dictionary.find(register.object or 0) if known else self._keep(register)
                self.registers.add(register, entry)

    def _keep(self, register: Register) -> Entry:
        entry = Entry(0, 0, register.type, access=Access.RW)
        self._kept.append(entry)
        return entry
