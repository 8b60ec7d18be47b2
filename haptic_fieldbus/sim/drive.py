"""A simulated CiA 402 drive: the automaton, the modes, and what the CANopen half and the servo do for each other.

Theory (CiA 402-2): torque is made in *operation enabled* and in the torque mode only; while a quick stop or a fault
reaction with a ramp is acting the drive brakes by itself. In every other state the target is zero at once. What happens
when the link is lost is 6007h's to say, what a quick stop does 605Ah's, what a fault does 605Eh's.
Pure: frames and times [ns] in, frames out through `send`.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.sim.brake import Brake
from haptic_fieldbus.sim.dictionary import Dictionary
from haptic_fieldbus.sim.emergency import HEARTBEAT_LOST
from haptic_fieldbus.sim.frame import Frame
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.node import Node
from haptic_fieldbus.sim.objects import NO_MODE, add_objects
from haptic_fieldbus.sim.power import STATUS_BITS, Cause, PowerAutomaton, State
from haptic_fieldbus.sim.servo import Servo
from haptic_fieldbus.sim.settings import DriveSettings, build_plant, known, node_options
from haptic_fieldbus.sim.wire import NEVER_NS

_VOLTAGE_ENABLED, _REMOTE = 0x0010, 0x0200
_LIMIT_ACTIVE, _FOLLOWS_COMMAND = 0x0800, 0x1000
_SLOWEST_TICK_NS = 1_000_000
_LAST_ENDING_QUICK_STOP = 4
"""605Ah: codes up to this one leave *quick stop active* by themselves, those above stay there."""
_DISABLE = 0
"""605Ah, 605Eh: disable the drive function, the shaft is free."""
_ENERGISED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)

# CiA 402-2, 6007h: what a lost link does.
_LINK_LOSS = {1: Cause.FAULT, 2: Cause.DISABLE_VOLTAGE, 3: Cause.QUICK_STOP}


class Drive:
    """One drive with its motor, load and hand."""

    def __init__(
        self,
        number: int,
        profile: DriveProfile,
        axis: RigAxis,
        send: Callable[[Frame], None],
        hand: Hand | None = None,
        settings: DriveSettings | None = None,
        t_ns: int = 0,
    ) -> None:
        """Without voltage yet, at `t_ns`."""
        self.settings = settings or DriveSettings()
        self.silent_until_ns = 0
        """Until then nothing is sent or received."""
        self.on_enabled: Callable[[int], None] = _ignore
        """Called once, with the time of the first *operation enabled*."""
        self.power = PowerAutomaton()
        self.dictionary = Dictionary()
        self.objects = add_objects(self.dictionary, profile, known(axis)[2], self.settings.serial)
        period_ns = round(profile.timing.control_period * 1e9)
        self.event_period_ns = period_ns or _SLOWEST_TICK_NS
        self.plant = build_plant(profile, axis, hand, self.settings, t_ns)
        self.servo = Servo(
            self.plant,
            counts_per_revolution=axis.encoder_counts_per_revolution,
            control_period_ns=period_ns,
            phase=self.settings.encoder_phase,
        )
        self._frames = send
        self.node = Node(number, self.dictionary, self, self._send, node_options(number, profile, self.settings))
        self._inertia = known(axis)[0]
        self._limit = self.settings.max_torque_permille * 1e-3 * self.objects.rated_torque
        self._enabled_once = False
        self._state = self.power.state
        self._limited = False
        self._brake: Brake | None = None
        self._brake_ns = NEVER_NS
        for entry in (self.objects.controlword, self.objects.mode, self.objects.target_torque):
            entry.changed = self._written

    # Called by the world.

    @property
    def due_ns(self) -> int:
        """When something is to be done without a frame."""
        return min(self.node.due_ns, self._brake_ns)

    def power_on(self, t_ns: int, *, booted: bool = False) -> None:
        """Voltage comes now and the boot-up message follows, or (`booted`) came long ago."""
        self.node.power_on(t_ns, None if booted else self.settings.start_delay_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """A frame of another node ended."""
        if t_ns >= self.silent_until_ns:
            self.node.receive(frame, t_ns)

    def timer(self, t_ns: int) -> None:
        """Do what is due."""
        if self._brake is not None and self._brake_ns <= t_ns:
            self.node.now_ns = t_ns
            self._brake_tick(self._brake, t_ns)
        self.node.timer(t_ns)

    def fault(self, code: int, t_ns: int) -> None:
        """The drive detects a fault: emergency, fault reaction, fault."""
        self.node.now_ns = t_ns
        self.node.emergencies.raise_error(code)
        self._fail(code, t_ns)

    # Called by the CANopen half (its `Application`).

    def sync(self, t_ns: int) -> None:
        """Latch the measured entries; the control ticks are counted from here."""
        self.servo.sync(t_ns)
        self._latch()

    def measure(self, t_ns: int) -> None:
        """Bring the measured entries up to date."""
        self.servo.advance(t_ns)
        self._latch()

    def act(self, t_ns: int) -> None:
        """Controlword, mode or target may have been written."""
        objects = self.objects
        if objects.mode.value != objects.mode_display.value and objects.mode.value in (NO_MODE, objects.torque_mode):
            objects.mode_display.value = objects.mode.value
            self._show_status()
        self.power.stays_in_quick_stop = objects.quick_stop_option.value > _LAST_ENDING_QUICK_STOP
        self.power.controlword(objects.controlword.value)
        if self.power.state is not self._state:
            self._enter(t_ns)
        if self._state is State.OPERATION_ENABLED:
            self._command(t_ns)

    def link_lost(self, t_ns: int) -> None:
        """6007h decides."""
        option = self.objects.abort_connection_option
        cause = _LINK_LOSS.get(option.value) if option is not None else None
        if cause is Cause.FAULT:
            self._fail(HEARTBEAT_LOST, t_ns)
        elif cause is not None:
            self.power.event(cause)
            if self.power.state is not self._state:
                self._enter(t_ns)

    def restart(self, t_ns: int) -> None:
        """Power-on state."""
        self.power.start()
        self._enter(t_ns)

    # Inside.

    def _written(self) -> None:
        self.act(self.node.now_ns)

    def _send(self, frame: Frame) -> None:
        if self.node.now_ns >= self.silent_until_ns:
            self._frames(frame)

    def _latch(self) -> None:
        objects, servo = self.objects, self.servo
        objects.position.value = servo.counts()
        objects.velocity.value = servo.counts_per_second()
        if objects.actual_torque is not None:
            low, high = objects.actual_torque.low, objects.actual_torque.high
            objects.actual_torque.value = max(low, min(high, round(self.plant.torque / objects.torque_unit)))

    def _command(self, t_ns: int) -> None:
        """Hand the target to the servo, limited; none in another mode."""
        objects = self.objects
        wanted = objects.target_torque.value * objects.torque_unit if objects.mode_display.value else 0.0
        torque = max(-self._limit, min(self._limit, wanted))
        if (torque != wanted) is not self._limited:
            self._limited = torque != wanted
            self._show_status()
        self.servo.command(torque, t_ns)

    def _fail(self, code: int, t_ns: int) -> None:
        if self.power.event(Cause.FAULT):
            self.objects.error_code.value = code
            self._enter(t_ns)

    def _enter(self, t_ns: int) -> None:
        """The automaton has a new state: make the power stage follow it."""
        before, self._state = self._state, self.power.state
        state = self._state
        self._brake, self._brake_ns, self._limited = None, NEVER_NS, False
        if state is State.OPERATION_ENABLED:
            self._first_enabled(t_ns)
        elif state is State.QUICK_STOP_ACTIVE:
            self._slow_down(self.objects.quick_stop_option.value, t_ns)
        elif state is State.FAULT_REACTION_ACTIVE:
            option = self.objects.fault_reaction_option
            ramp = option is None or option.value != _DISABLE
            self._slow_down(int(ramp and before in _ENERGISED), t_ns)
        else:
            self.servo.cut(t_ns)
            if before is State.FAULT:
                self.objects.error_code.value = 0
                self.node.emergencies.clear_all()
        self._show_status()

    def _first_enabled(self, t_ns: int) -> None:
        self.servo.advance(t_ns)
        if not self._enabled_once:
            self._enabled_once = True
            self.plant.start_hand()
            self.on_enabled(t_ns)

    def _slow_down(self, option: int, t_ns: int) -> None:
        """Brake at the control ticks, or free the shaft and be done."""
        if option == _DISABLE:
            self.servo.cut(t_ns)
            self._slowed_down(t_ns)
            return
        self._brake = Brake(t_ns, self._inertia, self._limit, self.event_period_ns * 1e-9)
        self._brake_ns = self.servo.tick(t_ns)

    def _brake_tick(self, brake: Brake, t_ns: int) -> None:
        self.servo.advance(t_ns)
        if self._brake_ends and brake.finished(self.plant.velocity, t_ns):
            self._slowed_down(t_ns)
            return
        self.servo.command(brake.torque(self.plant.velocity), t_ns)
        self._brake_ns = t_ns + self.event_period_ns

    @property
    def _brake_ends(self) -> bool:
        """Whether the state is left by itself at standstill."""
        stays = self.objects.quick_stop_option.value > _LAST_ENDING_QUICK_STOP
        return self._state is State.FAULT_REACTION_ACTIVE or not stays

    def _slowed_down(self, t_ns: int) -> None:
        """Quick stop or fault reaction complete."""
        cause = Cause.STOPPED if self._state is State.QUICK_STOP_ACTIVE else Cause.REACTION_COMPLETE
        self.power.event(cause)
        self._enter(t_ns)

    def _show_status(self) -> None:
        status = STATUS_BITS[self._state] | _VOLTAGE_ENABLED | _REMOTE
        if self._state is State.OPERATION_ENABLED and self.objects.mode_display.value:
            status |= _FOLLOWS_COMMAND | (_LIMIT_ACTIVE if self._limited else 0)
        self.objects.statusword.value = status


def _ignore(_t_ns: int) -> None:
    """Nobody wants to know."""
