"""Looking at drives without touching them: their registers are read, and nothing is written.

Reading feeds no watchdog, but it takes the line: as soon as octets come on a serial line that nobody here asked for,
somebody else uses it, and nothing more is asked. On TCP another master is not disturbed.
"""

from collections.abc import Mapping

from haptic_fieldbus.buses.found import Glimpse
from haptic_fieldbus.buses.modbus.foreign import LISTENING, listen
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.set_up import ADVICE, FAULTS
from haptic_fieldbus.buses.modbus.unit import RefusedError, UnitClient
from haptic_fieldbus.drive.power import PowerTable
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, ForeignMasterError
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile
from haptic_fieldbus.signals import Signal

SHOWN = (Signal.STATUSWORD, Signal.POSITION, Signal.VELOCITY, Signal.TORQUE_ACTUAL)
"""Signals that are read where the drive offers them."""
ANSWER_TIMEOUT = 0.1
"""Time for which an answer is waited for [s]: a drive that is gone must not hold up the look at another."""


Drive = tuple[int, ModbusProfile, PowerTable]
"""Unit id, profile, and the table of its power states."""


class UnitLook:
    """A look at the drives of one line; it listens before it sends anything. Raises BusError."""

    def __init__(self, requester: Requester, drives: Mapping[str, Drive], seconds: float = LISTENING) -> None:
        self.masters = ""
        self._requester = requester
        self._drives = {
            axis: (UnitClient(requester, unit, f"unit {unit} (axis {axis})", profile.line), profile, power)
            for axis, (unit, profile, power) in drives.items()
        }
        try:
            self.listened = listen(requester, seconds)
        except ForeignMasterError as error:
            self.listened = self.masters = str(error)

    def look(self) -> dict[str, Glimpse]:
        """Return what each drive says now; raises BusError when the line is dead."""
        return {axis: self._look_at(*drive) for axis, drive in self._drives.items()}

    def _look_at(self, unit: UnitClient, profile: ModbusProfile, power: PowerTable) -> Glimpse:
        requester = self._requester
        if requester.transport.serial and requester.unasked and not self.masters:
            self.masters = f"somebody else uses {requester.name}: octets came that nobody here asked for"
        now_ns = requester.clock.now_ns
        if self.masters:
            return Glimpse(now_ns(), note="not asked")
        began_ns = t_ns = now_ns()
        values: dict[Signal, int] = {}
        notes: list[str] = []
        for signal, register in profile.registers().items():
            if signal not in SHOWN:
                continue
            try:
                values[signal] = unit.read(register, ANSWER_TIMEOUT, 1)
            except BusTimeoutError as error:
                advice = "" if values else f"; {ADVICE[requester.transport.serial]}"
                age = (now_ns() - began_ns) * 1e-9 if values else None
                return Glimpse(t_ns, values, age, note=f"{error}{advice}")
            except BusConfigurationError as error:
                notes.append(str(error))
            if signal is Signal.POSITION:
                t_ns = requester.arrived_ns
        code = _error_code(unit, profile, power, values)
        return Glimpse(t_ns, values, (now_ns() - began_ns) * 1e-9, error_code=code, note="; ".join(notes))


def _error_code(
    unit: UnitClient, profile: ModbusProfile, power: PowerTable, values: Mapping[Signal, int]
) -> int | None:
    """Return the code of the fault that a drive is in; None where it has no register for it."""
    if power.state(values.get(Signal.STATUSWORD, 0)) not in FAULTS or profile.power.error is None:
        return None
    try:
        return unit.read(profile.power.error, ANSWER_TIMEOUT, 1)
    except (RefusedError, BusTimeoutError):
        return None
