"""The drive with its power stage on: the mode of operation, changes of mode, halt and every other stop.

Theory (CiA 402-2, 6060h, 6061h, controlword bit 8). The active mode is that of 6061h. It follows 6060h after the
drive's mode-change time, in every state of the automaton, halted or not; the old mode stays active until then. A mode
that the drive lacks is not taken over. A halt slows down as 605Dh requires and stays in *operation enabled*. The
control ticks are made here, and only while a mode or a stop needs them: cyclic synchronous torque does not.
"""

from collections.abc import Callable

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.drive.brake import Brake, Way, way_of
from haptic_fieldbus.sim.drive.modes.mode import INTERNAL_LIMIT, Mode
from haptic_fieldbus.sim.drive.objects import NO_MODE, Objects
from haptic_fieldbus.sim.drive.stage import Stage

HALT = 0x0100


class Operation:
    """Owner of the active mode, or of the stop that replaces it; times [ns]."""

    def __init__(
        self,
        stage: Stage,
        objects: Objects,
        modes: dict[int, Mode],
        tick_ns: int,
        mode_change_ns: int,
        show: Callable[[], None],
    ) -> None:
        """Start in mode 0; `show` is called when `status` has changed."""
        self.due_ns = NEVER_NS
        """Time of the next tick or mode change; NEVER_NS when there is none."""
        self.status = 0
        """Bits of the statusword that belong to the mode or the stop."""
        self._stage = stage
        self._modes = modes
        self._requested, self._display = objects.mode, objects.mode_display
        self._halt_option = objects.row(0x605D)
        self._ramps = {Way.SLOW_DOWN_RAMP: objects.row(0x6084), Way.QUICK_STOP_RAMP: objects.row(0x6085)}
        self._period_ns, self._change_time_ns = tick_ns, mode_change_ns
        self._show = show
        self._mode = modes[NO_MODE]
        self._enabled = False
        self._halted = False
        self._brake: Brake | None = None
        self._done: Callable[[int], None] | None = None
        self._tick_ns = self._change_ns = NEVER_NS
        self._change_to = NO_MODE

    # Commands of the automaton.

    def enable(self, t_ns: int) -> None:
        """Start the mode from the present motion: on entering *operation enabled*, or when a stop is cancelled."""
        self._enabled, self._halted, self._brake = True, False, None
        self._mode.start(t_ns)
        self._follow(t_ns)

    def stop(self, way: Way, t_ns: int, done: Callable[[int], None] | None) -> None:
        """Slow down; `done` is called at rest, None: the motor is held there."""
        self._brake = Brake(self._stage, self._ramps.get(way), t_ns)
        self._done = done
        self._follow(t_ns)

    def disable(self, t_ns: int) -> None:
        """End the torque at once."""
        if self._enabled:
            self._mode.leave()
        self._enabled = self._halted = False
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
        if self._tick_ns <= t_ns:
            self._tick(t_ns)

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

    def _tick(self, t_ns: int) -> None:
        self._tick_ns = NEVER_NS
        self._stage.servo.advance(t_ns)
        brake = self._brake
        if brake is None:
            self._mode.tick(t_ns)
        elif self._done is not None and brake.finished(t_ns):
            self._done(t_ns)
        else:
            brake.tick(t_ns)
        # The next tick is later than this one, also when this one is on the grid.
        self._follow(t_ns + 1)

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
