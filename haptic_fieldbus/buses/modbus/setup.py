"""Configuration of one drive, register by register: inspect, then write and read back, then start.

Inspection writes nothing, so a wrong drive, or one that another master commands, is refused untouched. What is written
is read back, and nothing is stored for good.
"""

from dataclasses import dataclass

from haptic_fieldbus.buses.bus import DriveFacts
from haptic_fieldbus.buses.modbus.exchange import refuse_unrest
from haptic_fieldbus.buses.modbus.unit import DriveWatch, UnitClient
from haptic_fieldbus.buses.release import FAULTS, poll, standing_fault
from haptic_fieldbus.buses.torque_limits import TorqueLimits, checked_rated_torque
from haptic_fieldbus.drive.profile import Identity, known_number
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, Register

ADVICE = {
    True: "check power, unit id, bit rate and parity of the drive, and that A and B are not swapped",
    False: "check the power of the drive, and its unit id (often 1 or 255 at an IP address of its own)",
}
"""Whether the line is a serial one → what to do about a unit that does not answer."""
UNGUARDED = "on link loss the motor keeps its torque until its power is cut"


@dataclass(frozen=True)
class UnitSetup:
    """Set-up of one axis of the plan on its unit."""

    unit: UnitClient
    axis: AxisPlan
    profile: ModbusProfile
    watchdog: DriveWatch | None
    """None: the drive has none."""
    torque_limits: TorqueLimits[Register]

    def inspect(self, listened: str) -> DriveFacts:
        """Check that the unit is the drive of the profile, healthy, at rest and rated as in the rig; write nothing.

        Raises BusTimeoutError, BusConfigurationError, DriveFaultError or ForeignMasterError.
        """
        self._check_fault()
        known = self._check_identity()
        refuse_unrest(self.unit, self.profile, self.axis.power)
        # Modbus itself defines no identity: what there is comes from the registers that the profile names.
        register = self.profile.serial
        serial = None if register is None else known_number(self.unit.optional(register), register.type)
        identity = Identity(known.get("vendor"), known.get("product code"), known.get("revision"), serial)
        self.torque_limits.inspect(identity, self.unit.optional)
        title, lost = self.profile.title, UNGUARDED if self.watchdog is None else self.watchdog.words
        rating = checked_rated_torque(self.unit, title, self.axis, self.profile.torque.rated)
        changes = tuple(self.torque_limits.sentences)
        return DriveFacts(self.axis.name, self.unit.id, title, identity, rating, lost, changes, listened)

    def configure(self) -> None:
        """Write all registers and read each back; the drive stays off. Raises BusError or ForeignMasterError."""
        if self.watchdog is None and self.axis.rig.emergency_stop != "power":
            raise BusConfigurationError(
                f"{self.profile.title} has no watchdog (profile: watchdog). It could hold the last torque when the "
                "cable breaks; refused"
            )
        refuse_unrest(self.unit, self.profile, self.axis.power)
        self.unit.write(self.profile.torque.target, 0)
        for each in self.profile.setup:
            self.unit.ensure(each, each.value)
        if self.watchdog is not None:
            self.watchdog.prepare()
        self.torque_limits.configure()
        self._set_mode()

    def start(self) -> None:
        """Arm the watchdog; raises BusError."""
        if self.watchdog is not None:
            self.watchdog.arm()

    def final_writes(self) -> tuple[tuple[Register, int], ...]:
        """Return the entries to write at the end: they switch the watchdog off and restore the former limits."""
        return (*(() if self.watchdog is None else self.watchdog.disarming), *self.torque_limits.before.items())

    def _check_fault(self) -> None:
        """Raise DriveFaultError for a drive in fault; the first question, so it also finds a unit that is not there."""
        try:
            state = self.axis.power.state(self.unit.read(self.profile.power.status))
        except BusTimeoutError as error:
            raise BusTimeoutError(f"{error}: {ADVICE[self.unit.requester.transport.serial]}") from error
        register = self.profile.power.error
        if state in FAULTS:
            code = None if register is None else self.unit.optional(register)
            raise standing_fault(self.unit.label, state, code, register, "use its own tool")

    def _check_identity(self) -> dict[str, int | None]:
        """Return the numbers by which the drive tells its model; raises BusConfigurationError for another model."""
        known: dict[str, int | None] = {}
        for each in self.profile.identity:
            value = self.unit.read(each)
            known[each.name] = known_number(value, each.type)
            if each.values and value not in each.values:
                wanted = " or ".join(f"{code:08X}h" for code in each.values)
                raise BusConfigurationError(
                    f"{self.unit.label} is another drive: {each.name} ({each}) is {value:08X}h; the profile "
                    f"{self.profile.name or self.profile.title} expects {wanted}. Nothing was written"
                )
        return known

    def _set_mode(self) -> None:
        mode, unit, timeout = self.profile.mode, self.unit, self.profile.timing.mode_change_timeout
        if mode is not None:
            unit.ensure(mode.write, mode.value)
        if mode is not None and (display := mode.display) is not None:
            wrong = f"did not accept mode {mode.value}: {display} is"
            poll(unit, timeout, lambda: unit.read(display) == mode.value, lambda: f"{wrong} {unit.read(display)}")
