"""The power table of CiA 402 as the master uses it; the simulated drive has an automaton of its own.

Reference: IEC 61800-7-201 (CiA 402-2), table of statusword states and of controlword commands.
"""

from dataclasses import replace

from haptic_fieldbus.drive.profile import PowerRow, PowerState, PowerTable

DISABLE_VOLTAGE = 0x0000
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE_OPERATION = 0x000F

# Some states do not depend on bit 5 (quick stop) of the statusword, so their mask is 4Fh instead of 6Fh.
CIA402 = PowerTable(
    (
        PowerRow(0x4F, 0x00, PowerState.NOT_READY, DISABLE_VOLTAGE),
        PowerRow(0x4F, 0x40, PowerState.SWITCH_ON_DISABLED, SHUTDOWN, 2),
        PowerRow(0x6F, 0x21, PowerState.READY, SWITCH_ON, 3),
        PowerRow(0x6F, 0x23, PowerState.SWITCHED_ON, ENABLE_OPERATION, 4),
        PowerRow(0x6F, 0x27, PowerState.OPERATION_ENABLED, ENABLE_OPERATION),
        PowerRow(0x6F, 0x07, PowerState.QUICK_STOP_ACTIVE, DISABLE_VOLTAGE, 12),
        PowerRow(0x4F, 0x0F, PowerState.FAULT_REACTION_ACTIVE, DISABLE_VOLTAGE),
        PowerRow(0x4F, 0x08, PowerState.FAULT, DISABLE_VOLTAGE),
    ),
    off=DISABLE_VOLTAGE,
)


def with_mode_bits(bits: int) -> PowerTable:
    """Return the table whose controlwords that command *operation enabled* carry these bits of the mode too."""
    rows = [
        replace(row, controlword=row.controlword | bits) if row.state is PowerState.OPERATION_ENABLED else row
        for row in CIA402.rows
    ]
    return replace(CIA402, rows=tuple(rows))
