"""Drives whose power is commanded by a mode register or an opcode, by the rows of their profiles."""

from dataclasses import replace

from haptic_fieldbus.drive.profile import DataType, PowerRow, PowerState
from haptic_fieldbus.protocols.modbus.profile import PowerSection, Register
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.modbus.registers import Refusal
from tests.sim.modbus.units import DEMAND, GENERIC, TARGET, Driven

MODE = Register(0x400, DataType.UINT16)
SHOWN, OPCODE = Register(0x401, DataType.UINT32), Register(0x404, DataType.UINT16)
OFF, TORQUE, BROKEN = 0, 40, 4
ENABLE, DISABLE = 0x9F, 0x9E
BY_MODE = PowerSection(
    MODE, MODE, "rows",
    (
        PowerRow(0xFFFF, OFF, PowerState.SWITCH_ON_DISABLED, TORQUE),
        PowerRow(0xFFFF, TORQUE, PowerState.OPERATION_ENABLED, TORQUE),
        PowerRow(0xFFFF, BROKEN, PowerState.FAULT, OFF),
    ),
    off=OFF,
)  # fmt: skip
"""One register is command and status, as in drives with modes alone."""
BY_OPCODE = PowerSection(
    SHOWN, OPCODE, "rows",
    (
        PowerRow(0x5, 0x4, PowerState.FAULT, DISABLE),
        PowerRow(0x5, 0x0, PowerState.SWITCHED_ON, ENABLE),
        PowerRow(0x5, 0x1, PowerState.OPERATION_ENABLED, ENABLE),
    ),
    off=DISABLE,
)  # fmt: skip
"""An opcode is written, and a word of two registers tells the state."""


def driven(power: PowerSection) -> Driven:
    return Driven(replace(GENERIC, power=power, mode=None, watchdog=None))


class TestModeRegister:
    def test_torque_mode_is_torque_and_off_is_a_free_shaft(self) -> None:
        drive = driven(BY_MODE)
        assert drive.value(MODE.address) == OFF
        drive.write(TARGET, 50)
        assert drive.value(DEMAND) == 0
        drive.write(MODE.address, TORQUE)
        assert (drive.value(MODE.address), drive.value(DEMAND)) == (TORQUE, 50)
        assert drive.state() is State.OPERATION_ENABLED
        drive.write(MODE.address, TORQUE)
        assert drive.value(MODE.address) == TORQUE
        drive.write(MODE.address, OFF)
        assert (drive.value(MODE.address), drive.value(DEMAND)) == (OFF, 0)

    def test_a_mode_of_which_nothing_is_known_is_refused(self) -> None:
        drive = driven(BY_MODE)
        assert drive.write(MODE.address, 20) is Refusal.VALUE

    def test_after_a_fault_nothing_enables_it_again(self) -> None:
        drive = driven(BY_MODE)
        drive.write(MODE.address, TORQUE)
        drive.unit.drive.fault(0x2310, drive.t_ns)
        assert drive.value(MODE.address) == BROKEN, "its table has no state in which it would slow down first"
        drive.write(MODE.address, TORQUE)
        assert drive.value(MODE.address) == BROKEN
        drive.write(MODE.address, OFF)
        assert drive.value(DEMAND) == 0

    def test_the_command_that_clears_a_fault_enables_nothing(self) -> None:
        drive = driven(replace(BY_MODE, reset=1))
        drive.write(MODE.address, TORQUE)
        drive.unit.drive.fault(0x2310, drive.t_ns)
        assert drive.write(MODE.address, 1) is None
        assert drive.value(MODE.address) == OFF
        assert driven(BY_MODE).write(MODE.address, 1) is Refusal.VALUE

    def test_a_restart_is_off(self) -> None:
        drive = driven(BY_MODE)
        drive.write(MODE.address, TORQUE)
        drive.unit.power_on(drive.t_ns)
        assert drive.value(MODE.address) == OFF


class TestOpcode:
    def test_it_enables_and_disables(self) -> None:
        drive = driven(BY_OPCODE)
        assert drive.read(SHOWN.address, 2) == [0, 0]
        drive.write(OPCODE.address, ENABLE)
        # The table has a state between: another command takes the drive on.
        drive.write(OPCODE.address, ENABLE)
        assert drive.read(SHOWN.address, 2) == [0, 1]
        drive.write(OPCODE.address, DISABLE)
        assert drive.read(SHOWN.address, 2) == [0, 0]

    def test_a_fault_shows_its_bits(self) -> None:
        drive = driven(BY_OPCODE)
        for _ in range(2):
            drive.write(OPCODE.address, ENABLE)
        drive.unit.drive.fault(0x2310, drive.t_ns)
        assert drive.read(SHOWN.address, 2) == [0, 4]
