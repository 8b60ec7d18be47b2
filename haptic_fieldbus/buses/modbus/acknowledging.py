"""Clearing of the fault into which a drive goes when it has lost its master, after its guard was proved.

Nothing else clears a fault, and this one only by the code that the profile names for it: a fault that came for another
reason in the same time stays, and is told.

Reference: IEC 61800-7-201 (CiA 402-2), 6040h bit 7.
"""

from haptic_fieldbus.buses.modbus.set_up import FAULTS, POLL_NS
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.drive.power import PowerTable
from haptic_fieldbus.errors import DriveFaultError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile

NO_CODE = 0
FAULT_RESET = 0x80
"""Controlword of CiA 402; its bit 7 acts when it rises."""
CLEARED_WITHIN = 0.5
"""Time that a drive has to leave *fault* [s]."""


def acknowledge(unit: UnitClient, profile: ModbusProfile, power: PowerTable) -> None:
    """Clear the fault of a drive that lost its master; raises DriveFaultError for another fault, or BusError."""
    status, command = profile.power.status, profile.power.command
    if power.state(unit.read(status)) not in FAULTS:
        return
    code = NO_CODE if profile.power.error is None else unit.optional(profile.power.error) or NO_CODE
    expected = None if profile.watchdog is None else profile.watchdog.fault
    if expected is not None and code not in (expected, NO_CODE):
        raise DriveFaultError(
            f"{unit.label} went to fault while it was left alone, and not because it lost its master: error code "
            f"{code:04X}h. Nothing was cleared"
        )
    reset = FAULT_RESET if profile.power.table == "cia402" else profile.power.reset
    if reset is None:
        raise DriveFaultError(
            f"{unit.label} is in fault since it lost its master, and {profile.title} names no command that clears one "
            "(power.reset of its profile): switch it off and on"
        )
    for each in (power.off, reset, power.off):
        unit.send(command, each)
    deadline_ns = unit.requester.clock.now_ns() + round(CLEARED_WITHIN * 1e9)
    while power.state(unit.read(status)) in FAULTS:
        if unit.requester.clock.now_ns() >= deadline_ns:
            raise DriveFaultError(
                f"{unit.label} stays in fault {exactly(CLEARED_WITHIN)} s after its lost master was acknowledged: "
                "switch it off and on, and check its link"
            )
        unit.requester.quiet(POLL_NS)
