"""A simulated CiA 402 drive: its automaton, and the actions of its power stage.

Theory (CiA 402-2): in *operation enabled* the mode of operation determines the motion (see `operation`), in *quick stop
active* and *fault reaction active* the slowing down. 6007h determines the reaction to a lost link (a fault only if
torque was possible), 605Ah to a quick stop, 605Eh to a fault. 605Bh and 605Ch determine whether *shutdown* and *disable
operation* slow down first. If they do, the state stays *operation enabled* until the motor stands still. Commands are
not followed meanwhile, and *enable operation* cancels the stop. Every other state frees the shaft at once. A fault
cannot be reset while its cause is present.

Safe torque off is not an event of the standard's automaton. Here torque ends at once, as by *disable voltage*; *switch
on disabled* is not left until safe torque off is closed; bit 3 of 60FDh (*interlock*) shows it. With `sto_error` in the
settings it is a fault while torque is made, as in some drives.

The drive is independent of its bus: a link writes and reads the dictionary, calls the drive at times [ns], and is
informed of errors (`DriveLink`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Protocol

from haptic_fieldbus.drive.cia402 import Cia402Profile
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.drive.dictionary import Dictionary, Entry
from haptic_fieldbus.sim.drive.modes import build_modes
from haptic_fieldbus.sim.drive.modes.mode import INTERNAL_LIMIT, Mode, to_velocity
from haptic_fieldbus.sim.drive.objects import NO_MODE, Objects, add_objects
from haptic_fieldbus.sim.drive.power import STATUS_BITS, Cause, PowerAutomaton, State
from haptic_fieldbus.sim.drive.servo import Servo
from haptic_fieldbus.sim.drive.settings import (
    DriveSettings,
    as_built,
    build_gains,
    build_plant,
    build_timing,
    build_units,
    object_defaults,
)
from haptic_fieldbus.sim.drive.stage import NO_RAMP, Stage
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus

# Slowing down by the motor, for quick stop, halt, fault reaction, *shutdown* and *disable operation*.
#
# Theory (CiA 402-2, 605Ah to 605Eh). In every mode, the demand of the speed loop goes to zero by the slow down ramp
# 6084h or the quick stop ramp 6085h, or at once: then torque goes to its limit, *slow down on the current limit*. The
# model has no voltage limit; a stop on it is one on the current limit. The shaft counts as at rest when it is slower
# than `REST` after the ramp. A hand that keeps pushing cannot prevent the end of a stop that ends: it ends at the
# latest `LONGEST_NS` after the ramp. Until another command takes over, the motor is held at rest.

REST = 0.2
"""Greatest speed of a shaft at rest [rad/s]."""
LONGEST_NS = 1_000_000_000
"""Longest time from the end of the ramp to the end of a stop."""


class SlowDown(Enum):
    """How to slow down; the value is the option code of 605Ah to 605Eh."""

    SLOW_DOWN_RAMP = 1
    QUICK_STOP_RAMP = 2
    CURRENT_LIMIT = 3
    VOLTAGE_LIMIT = 4


def way_of(code: int) -> SlowDown:
    """Return the way of an option code from 1 to 8; codes from 5 on mean the same and stay in *quick stop active*."""
    return SlowDown((code - 1) % len(SlowDown) + 1)


class Brake:
    """A stop that begins at `begin_ns` with this ramp; None: at once."""

    def __init__(self, stage: Stage, ramp: Entry | None, begin_ns: int) -> None:
        self._stage = stage
        self._begin_ns = begin_ns
        rate = stage.ramp(ramp) if ramp is not None else NO_RAMP
        self._motion = to_velocity(stage.servo.plant.velocity, 0.0, rate, rate)
        self._end_ns = begin_ns + round(self._motion.end * 1e9)

    def tick(self, t_ns: int) -> None:
        """Run the speed loop for one control tick."""
        _, velocity, acceleration = self._motion.at((t_ns - self._begin_ns) * 1e-9)
        self._stage.speed(velocity, acceleration, t_ns)

    def at_rest(self, t_ns: int) -> bool:
        """Return whether the ramp is over and the shaft at rest."""
        return t_ns >= self._end_ns and abs(self._stage.servo.plant.velocity) < REST

    def finished(self, t_ns: int) -> bool:
        """Return whether the shaft is at rest, or `LONGEST_NS` have passed since the ramp."""
        return self.at_rest(t_ns) or t_ns >= self._end_ns + LONGEST_NS


# The drive with its power stage on: the mode of operation, changes of mode, halt and every other stop.
#
# Theory (CiA 402-2, 6060h, 6061h, controlword bit 8). The active mode is that of 6061h. It follows 6060h after the
# drive's mode-change time, in every state of the automaton, halted or not; the old mode stays active until then. A mode
# that the drive lacks is not taken over. A halt slows down as 605Dh requires and stays in *operation enabled*. The
# control ticks are made here, and only while a mode or a stop needs them: cyclic synchronous torque does not.

HALT = 0x0100


@dataclass(eq=False)
class Operation:
    """Owner of the active mode, or of the stop that replaces it; times [ns]. It starts in mode 0."""

    _stage: Stage
    _objects: Objects
    _modes: dict[int, Mode]
    _period_ns: int
    _change_time_ns: int
    _show: Callable[[], None]
    """Called when `status` has changed."""
    due_ns: int = NEVER_NS
    """Time of the next tick or mode change; NEVER_NS when there is none."""
    status: int = 0
    """Bits of the statusword that belong to the mode or the stop."""
    _enabled: bool = False
    _halted: bool = False
    _brake: Brake | None = None
    _done: Callable[[int], None] | None = None
    _tick_ns: int = NEVER_NS
    _change_ns: int = NEVER_NS
    _change_to: int = NO_MODE

    def __post_init__(self) -> None:
        self._mode = self._modes[NO_MODE]
        self._requested, self._display, row = self._objects.mode, self._objects.mode_display, self._objects.row
        self._halt_option = row(0x605D)
        self._ramps = {SlowDown.SLOW_DOWN_RAMP: row(0x6084), SlowDown.QUICK_STOP_RAMP: row(0x6085)}

    # Commands of the automaton.

    def enable(self, t_ns: int) -> None:
        """Start the mode from the present motion: on entering *operation enabled*, or when a stop is cancelled."""
        self._enabled, self._halted, self._brake = True, False, None
        self._mode.start(t_ns)
        self._follow(t_ns)

    def stop(self, way: SlowDown, t_ns: int, done: Callable[[int], None] | None) -> None:
        """Slow down; `done` is called at rest, None: the motor is held there."""
        self._brake = Brake(self._stage, self._ramps.get(way), t_ns)
        self._done = done
        self._follow(t_ns)

    def disable(self, t_ns: int) -> None:
        """End the torque at once."""
        self.leave()
        self._brake = None
        self._stage.cut(t_ns)
        self._follow(t_ns)

    def leave(self) -> None:
        """Leave *operation enabled* with the power stage on."""
        if self._enabled:
            self._mode.leave()
        self._enabled = self._halted = False

    def restart(self) -> None:
        """Return to the power-on state; the entry 6061h has its power-on value already."""
        self._change_ns = NEVER_NS
        self._mode = self._modes[NO_MODE]
        self._plan()

    # Received objects, SYNC and time.

    def act(self, t_ns: int) -> None:
        """Act on received objects."""
        if self._requested.value != self._display.value or self._change_ns != NEVER_NS:
            self._request(t_ns)
        if self._enabled:
            if self._brake is None:
                self._mode.act(t_ns)
                if self._mode.status != self.status or self._mode.ticking:
                    self._follow(t_ns)
        else:
            self._mode.act_disabled(t_ns)

    def halt(self, controlword: int, t_ns: int) -> None:
        """Handle bit 8 of a controlword in *operation enabled*, while no other stop is under way."""
        wanted = bool(controlword & HALT) and self._mode.halts
        if wanted and not self._halted:
            self._halted = True
            self.stop(way_of(self._halt_option.value), t_ns, None)
        elif not wanted and self._halted:
            self.enable(t_ns)

    def sync(self, t_ns: int) -> None:
        """Count the ticks from this SYNC on."""
        # Ticks that are not needed are not started by a SYNC.
        if self._tick_ns != NEVER_NS:
            self._tick_ns = t_ns
            self._plan()

    def timer(self, t_ns: int) -> None:
        """Serve the mode change and the tick that are due."""
        if self._change_ns <= t_ns:
            self._change(t_ns)
        if self._tick_ns > t_ns:
            return
        self._tick_ns = NEVER_NS
        self._stage.servo.advance(t_ns)
        if (brake := self._brake) is None:
            self._mode.tick(t_ns)
        elif self._done is not None and brake.finished(t_ns):
            self._done(t_ns)
        else:
            brake.tick(t_ns)
        # The next tick is later than this one, also when this one is on the grid.
        self._follow(t_ns + 1)

    # Inside.

    def _request(self, t_ns: int) -> None:
        # Requesting another mode while a change is pending restarts its time; requesting the active mode cancels it.
        wanted = self._requested.value
        if wanted == self._display.value or wanted not in self._modes:
            self._change_ns = NEVER_NS
        elif self._change_ns == NEVER_NS or wanted != self._change_to:
            self._change_to, self._change_ns = wanted, t_ns + self._change_time_ns
        if self._change_ns <= t_ns:
            self._change(t_ns)
        self._plan()

    def _change(self, t_ns: int) -> None:
        self._change_ns = NEVER_NS
        self._mode.leave()
        self._display.value = self._change_to
        self._mode = self._modes[self._change_to]
        # A stop goes on through the change, except a halt when the new mode cannot halt.
        if self._enabled and (self._brake is None or (self._halted and not self._mode.halts)):
            self._stage.servo.advance(t_ns)
            self.enable(t_ns)
        else:
            self._follow(t_ns)

    def _follow(self, t_ns: int) -> None:
        """Find the next tick, not before `t_ns`, and update the bits of the statusword."""
        if self._brake is None and not (self._enabled and self._mode.ticking):
            self._tick_ns = NEVER_NS
        elif self._tick_ns == NEVER_NS:
            self._tick_ns = self._stage.servo.next_tick(t_ns, self._period_ns)
        self._plan()
        status = self._bits(t_ns)
        if status != self.status:
            self.status = status
            self._show()

    def _plan(self) -> None:
        self.due_ns = min(self._tick_ns, self._change_ns)

    def _bits(self, t_ns: int) -> int:
        if self._brake is None:
            return self._mode.status if self._enabled else 0
        status = INTERNAL_LIMIT if self._stage.limited else 0
        if self._halted:
            # A halted mode keeps its own bits, but the brake determines standstill and internal limit.
            status |= self._mode.status & ~(self._mode.standing | INTERNAL_LIMIT)
            if self._brake.at_rest(t_ns):
                status |= self._mode.standing
        return status


_VOLTAGE_ENABLED, _REMOTE = 0x0010, 0x0200
# Period of the loops and of the event-driven TPDOs of a drive whose profile has no control period.
_SLOWEST_TICK_NS = 1_000_000
_LAST_ENDING_QUICK_STOP = 4
"""605Ah: codes up to this one end *quick stop active* by themselves, those above stay in it."""
_DISABLE = 0
"""605Ah, 605Eh: disable the drive function at once; the shaft is free."""
_SLOW_DOWN = 1
"""605Bh, 605Ch: slow down before the transition is made."""
# Numbers of the transitions that 605Ch and 605Bh may defer.
_DISABLE_OPERATION, _SHUTDOWN = 5, 8
_ENERGISED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
_UNDER_POWER = (*_ENERGISED, State.FAULT_REACTION_ACTIVE)
_INTERLOCK = 1 << 3
"""Bit 3 of 60FDh."""
FOLLOWING_ERROR = 0x8611
"""Error code in 603Fh."""

# CiA 402-2, 6007h: reaction to a lost link by option code; 0 is no action.
_LINK_LOSS = {1: Cause.FAULT, 2: Cause.DISABLE_VOLTAGE, 3: Cause.QUICK_STOP}


class DriveLink(Protocol):
    """The link of a drive, which passes on its errors."""

    def error(self, code: int, t_ns: int) -> None:
        """Report an error that the drive has detected."""

    def persists(self) -> bool:
        """Return whether the external cause of the *fault* is still there."""

    def clear_errors(self, t_ns: int) -> None:
        """Report that a fault was reset."""


class Drive:
    """One drive with its motor, load and hand."""

    def __init__(
        self, profile: Cia402Profile, slot: DriveOnBus, link: DriveLink, settings: DriveSettings, t_ns: int
    ) -> None:
        """Build the drive at `t_ns`, without voltage yet; `restart` is its power-on, `profile` that of its objects."""
        axis = slot.axis
        self.settings = settings
        self.on_enabled: Callable[[int], None] = lambda _t_ns: None
        """Called with the time of each *operation enabled*."""
        self.on_freed: Callable[[int], None] = lambda _t_ns: None
        """Called with the time at which torque ends because the power stage is switched off."""
        # The order below is that of dependence: objects need the dictionary, units the objects, the stage all of them.
        self.power = PowerAutomaton()
        self.dictionary = Dictionary()
        self.objects = add_objects(self.dictionary, profile, object_defaults(profile, axis, settings))
        times = build_timing(profile, settings)
        self.event_period_ns = times.control_period_ns or _SLOWEST_TICK_NS
        self.plant = build_plant(profile, axis, slot.hand, settings, t_ns)
        self.servo = Servo(
            self.plant, counts_per_revolution=as_built(axis).encoder_counts_per_revolution,
            timing=times, phase=settings.encoder_phase,
            stated_counts=axis.encoder_counts_per_revolution, torque_scale=axis.simulation.torque_scale,
        )  # fmt: skip
        self.units = build_units(profile, axis, self.objects, self.dictionary)
        self.stage = Stage(
            self.servo, self.objects, self.units, build_gains(profile, axis, self.event_period_ns * 1e-9)
        )
        is_fault = settings.following_error_faults
        failed = partial(self.fault, FOLLOWING_ERROR) if is_fault else lambda _t_ns: None
        modes = build_modes(self.stage, self.objects, failed)
        self.operation = Operation(
            self.stage, self.objects, modes, self.event_period_ns, settings.mode_change_ns, self._show_status
        )
        self._link = link
        self._sto_fault = False
        """Whether the last opening of safe torque off was a fault."""
        self.power.has_fault = lambda: (self._sto_fault and self.power.locked) or link.persists()
        self._state = self.power.state
        row, self._controlword = self.objects.row, self.objects.controlword
        self._quick_stop_option = row(0x605A)
        self._deferring = (_SHUTDOWN, row(0x605B)), (_DISABLE_OPERATION, row(0x605C))
        """The transitions that an option code may defer, with its object."""
        self._word = -1
        """Last controlword that was handled; -1 when the next one must be handled even if it is equal."""
        self._leaving = False
        self._inputs = 0
        self.objects.on_written(self._written, self.units.update)

    # Faults, safe torque off and inputs.

    def fault(self, code: int, t_ns: int) -> None:
        """Detect a fault: report it to the link, then go through fault reaction to *fault*."""
        self._link.error(code, t_ns)
        if self.power.event(Cause.FAULT):
            self.objects.error_code.value = code
            self._enter(t_ns)

    def sto(self, open_: bool, t_ns: int) -> None:
        """Open or close safe torque off."""
        self.power.locked = open_
        self.inputs(self._inputs & ~_INTERLOCK | (_INTERLOCK if open_ else 0))
        if not open_:
            return
        # Before *disable voltage*, after which the state no longer shows that torque was made.
        self._sto_fault = self.settings.sto_error != 0 and self._state in _ENERGISED
        if self._sto_fault:
            self.fault(self.settings.sto_error, t_ns)
        reacts = self._state is State.FAULT_REACTION_ACTIVE
        self.power.event(Cause.REACTION_COMPLETE if reacts else Cause.DISABLE_VOLTAGE)
        self._follow(t_ns)

    def inputs(self, bits: int) -> None:
        """Set the digital inputs 60FDh; they do not affect the drive."""
        self._inputs = self.objects.row(0x60FD).value = bits & 0xFFFF_FFFF

    # Called by the link, which serves the timers of `operation` too.

    def sync(self, t_ns: int) -> None:
        """Latch the measured entries at a SYNC; control ticks are counted from here."""
        self.servo.sync(t_ns)
        self.operation.sync(t_ns)
        self.stage.show()

    def measure(self, t_ns: int) -> None:
        """Bring the measured entries up to date, before entries are read or written at this time."""
        self.servo.advance(t_ns)
        self.stage.show()

    def act(self, t_ns: int) -> None:
        """Act on a controlword, mode or target that may have been received."""
        word = self._controlword.value
        if word != self._word:
            self._command(word, t_ns)
        self.operation.act(t_ns)

    def link_lost(self, code: int, t_ns: int) -> None:
        """React to a lost link as 6007h requires; `code` is its error code, if it is a fault."""
        cause = _LINK_LOSS.get(self.objects.abort_connection_option.value)
        if cause is Cause.FAULT:
            # A link that ends while no torque can be made is no fault: nothing was aborted.
            if self._state in _ENERGISED:
                self.fault(code, t_ns)
        elif cause is not None:
            self.power.event(cause)
            self._follow(t_ns)

    def restart(self, t_ns: int) -> None:
        """Return to the power-on state."""
        self.units.update()
        # Inputs come from outside and keep their state, while the entry was reset to 0.
        self.inputs(self._inputs)
        self.power.start()
        self.operation.restart()
        self._enter(t_ns)

    # Inside.

    def _written(self) -> None:
        self._word = -1
        self.act(self.plant.t_ns)

    def _command(self, word: int, t_ns: int) -> None:
        """Handle a new controlword, or handle it again because state or options have changed."""
        self._word, power = word, self.power
        power.stays_in_quick_stop = self._quick_stop_option.value > _LAST_ENDING_QUICK_STOP
        power.deferred = [number for number, option in self._deferring if option.value == _SLOW_DOWN]
        power.controlword(word)
        self._follow(t_ns)
        if self._state is State.OPERATION_ENABLED:
            self._stop_or_go(word, t_ns)

    def _stop_or_go(self, word: int, t_ns: int) -> None:
        """Slow down before *operation enabled* is left, or halt, or do neither."""
        if self.power.held is not None:
            if not self._leaving:
                self._leaving = True
                self.operation.stop(SlowDown.SLOW_DOWN_RAMP, t_ns, self._left)
            return
        if self._leaving:
            self._leaving = False
            self.operation.enable(t_ns)
        self.operation.halt(word, t_ns)

    def _left(self, t_ns: int) -> None:
        self.power.complete()
        self._enter(t_ns)

    def _follow(self, t_ns: int) -> None:
        if self.power.state is not self._state:
            self._enter(t_ns)

    def _enter(self, t_ns: int) -> None:
        """Make the power stage follow a new state of the automaton."""
        before, self._state = self._state, self.power.state
        state = self._state
        # The same controlword may have another meaning in the new state.
        self._word, self._leaving = -1, False
        if state is State.OPERATION_ENABLED:
            # Bring the plant to this instant, at which the modes start from its speed and angle.
            self.servo.advance(t_ns)
            # The times that count from *operation enabled* go on after a quick stop that was only interrupted.
            if before is not State.QUICK_STOP_ACTIVE:
                self.plant.start_hand()
                self.on_enabled(t_ns)
            self.operation.enable(t_ns)
        elif state is State.QUICK_STOP_ACTIVE:
            self._slow_down(self._quick_stop_option.value, t_ns)
        elif state is State.FAULT_REACTION_ACTIVE:
            # A shaft that was free before the fault, or whose power stage is locked, cannot be slowed down.
            can_brake = before in _ENERGISED and not self.power.locked
            self._slow_down(self.objects.fault_reaction_option.value if can_brake else _DISABLE, t_ns)
        else:
            self.operation.disable(t_ns)
            if before in _UNDER_POWER:
                self.plant.rest_hand()
                self.on_freed(t_ns)
            if before is State.FAULT:
                self.objects.error_code.value = 0
                self._link.clear_errors(t_ns)
        self._show_status()

    def _slow_down(self, code: int, t_ns: int) -> None:
        """Brake at the control ticks, or free the shaft at once for code 0."""
        if code == _DISABLE:
            self.operation.disable(t_ns)
            self._slowed_down(t_ns)
            return
        stays = self._state is State.QUICK_STOP_ACTIVE and code > _LAST_ENDING_QUICK_STOP
        self.operation.leave()
        self.operation.stop(way_of(code), t_ns, None if stays else self._slowed_down)

    def _slowed_down(self, t_ns: int) -> None:
        """Complete a quick stop or a fault reaction."""
        self.power.event(Cause.STOPPED if self._state is State.QUICK_STOP_ACTIVE else Cause.REACTION_COMPLETE)
        self._enter(t_ns)

    def _show_status(self) -> None:
        self.objects.statusword.value = STATUS_BITS[self._state] | _VOLTAGE_ENABLED | _REMOTE | self.operation.status
