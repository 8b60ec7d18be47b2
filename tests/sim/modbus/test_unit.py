"""A simulated drive behind its registers: reading, writing, what it refuses, and its watch on the master."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.profile import modbus_profile
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.modbus.registers import Refusal
from tests.sim.modbus.units import (
    ACTUAL,
    COMMAND,
    DEMAND,
    ERROR,
    GENERIC,
    LIMIT,
    MODE,
    MODE_SHOWN,
    POSITION,
    RATED,
    SERIAL,
    STATUS,
    TARGET,
    VELOCITY,
    WATCHDOG,
    Driven,
    changed,
    signed,
    slot,
)

OPERATION_ENABLED = 0x27


class TestRequests:
    """Modbus application protocol 1.1b3: a request is carried out as a whole, or refused by an exception code."""

    def test_the_whole_block_is_one_request(self) -> None:
        words = Driven().read(STATUS, 8)
        assert isinstance(words, list)
        assert len(words) == 8

    @pytest.mark.parametrize(
        ("address", "count", "refusal"),
        [
            (STATUS, 0, Refusal.VALUE), (STATUS, 126, Refusal.VALUE),
            (STATUS - 1, 2, Refusal.ADDRESS), (VELOCITY, 3, Refusal.ADDRESS), (0x4000, 1, Refusal.ADDRESS),
            (POSITION, 1, Refusal.ADDRESS), (POSITION + 1, 1, Refusal.ADDRESS), (DEMAND, 2, Refusal.ADDRESS),
        ],
        ids=str,
    )  # fmt: skip
    def test_what_is_not_there_or_half_a_value_is_refused(self, address: int, count: int, refusal: Refusal) -> None:
        assert Driven().read(address, count) is refusal

    def test_functions_that_the_drive_lacks_are_refused(self) -> None:
        drive = Driven(changed(functions=(4, 16)))
        assert drive.read(STATUS) is Refusal.FUNCTION
        assert isinstance(drive.read(STATUS, function=4), list)
        assert set(drive.unit.functions) == {4, 16}

    @pytest.mark.parametrize("address", [STATUS, DEMAND, ACTUAL, ERROR, MODE_SHOWN])
    def test_what_is_measured_cannot_be_written(self, address: int) -> None:
        assert Driven().write(address, 1) is Refusal.ADDRESS

    def test_a_refused_value_keeps_all_others_of_its_request_from_being_written(self) -> None:
        drive = Driven()
        assert drive.write(COMMAND, 6, 5, 99) is Refusal.VALUE  # 99 is no mode of operation
        assert drive.read(COMMAND, 3) == [0, 0, 0]

    def test_too_many_values_are_refused(self) -> None:
        assert Driven().write(COMMAND, *([0] * 124)) is Refusal.VALUE

    def test_registers_that_are_readable_but_nobody_s_read_as_zero_and_cannot_be_written(self) -> None:
        drive = Driven(changed(readable=((0x0200, 0x0207),)))
        assert drive.read(COMMAND, 8) == [0, 0, 0, 3000, 0, 0, 0, 0]
        assert drive.write(WATCHDOG, 1, 1) is Refusal.ADDRESS

    def test_rated_torque_and_serial_number_are_those_of_the_bench(self) -> None:
        drive = Driven()
        words, serial = drive.read(RATED, 2), drive.read(SERIAL, 2)
        assert isinstance(words, list)
        assert isinstance(serial, list)
        assert signed(words) == 400  # mN·m
        assert serial[0] << 16 | serial[1] == drive.unit.drive.settings.serial


class TestWordOrder:
    """A value of two registers has its high one first, or its low one, as the profile says."""

    def test_positions_in_both_orders_are_one_position(self) -> None:
        drives = Driven(hand="push"), Driven(changed(word_order="low first"), hand="push")
        for drive in drives:
            drive.enable()
            drive.wait(700)
        high, low = (drive.read(POSITION, 2) for drive in drives)
        assert isinstance(high, list)
        assert isinstance(low, list)
        assert high == low[::-1]
        # The hand pushes to the positive side, and the counts follow the true angle.
        angle = drives[0].unit.drive.plant.state[0]
        assert signed(high) == pytest.approx(4096 * angle / (2 * math.pi), abs=1.0)
        assert signed(high) > 0

    def test_negative_values_are_signed(self) -> None:
        drive = Driven()
        drive.enable()
        drive.write(TARGET, 0x10000 - 20)
        assert drive.value(DEMAND) == 0x10000 - 20
        drive.wait(20)
        words = drive.read(POSITION, 2)
        assert isinstance(words, list)
        assert signed(words) < 0


class TestPower:
    def test_it_is_enabled_by_the_controlwords_of_the_standard(self) -> None:
        drive = Driven()
        drive.write(MODE, 10)
        seen = []
        for word in (6, 7, 15, 0):
            drive.write(COMMAND, word)
            seen.append(drive.value(STATUS) & 0x6F)
        assert seen == [0x21, 0x23, OPERATION_ENABLED, 0x60]
        assert drive.value(MODE_SHOWN) == 10

    def test_torque_acts_only_when_it_is_enabled(self) -> None:
        drive = Driven()
        drive.write(MODE, 10)
        drive.write(TARGET, 100)
        assert drive.value(DEMAND) == 0
        drive.enable()
        assert drive.value(DEMAND) == 100
        drive.wait(10)
        assert drive.value(ACTUAL) == pytest.approx(100, abs=1)
        drive.write(COMMAND, 0)
        assert drive.unit.drive.plant.recorder is not None
        assert drive.value(DEMAND) == 0

    def test_the_limit_of_the_drive_is_in_the_unit_of_its_target(self) -> None:
        drive = Driven()
        drive.enable()
        drive.write(LIMIT, 50)
        drive.write(TARGET, 100)
        assert drive.value(DEMAND) == 50

    def test_command_and_target_of_one_request_act_together(self) -> None:
        drive = Driven()
        drive.enable()
        drive.write(COMMAND, 0)
        for word in (6, 7):
            drive.write(COMMAND, word)
        drive.write(COMMAND, 15, 30)
        assert drive.read(STATUS, 2) == [drive.value(STATUS), 30]


class TestWatchdog:
    """No target written for its time: a fault, as 6007h would have it, and no torque."""

    def watched(self, *these: faults.Fault) -> Driven:
        drive = Driven(GENERIC, *these)
        drive.write(WATCHDOG, 50)
        drive.enable()
        return drive

    def test_torque_ends_at_its_time_exactly(self) -> None:
        drive = self.watched()
        drive.write(TARGET, 100)
        drive.wait(49.999)
        assert drive.value(DEMAND) == 100
        drive.wait(0.001)
        assert (drive.value(DEMAND), drive.state()) == (0, State.FAULT)
        assert drive.value(ERROR) == 0x8130

    def test_writing_the_target_keeps_it_alive_and_reading_does_not(self) -> None:
        drive = self.watched()
        for _ in range(10):
            drive.write(TARGET, 5)
            drive.wait(40)
        assert drive.state() is State.OPERATION_ENABLED
        for _ in range(2):
            drive.read(STATUS, 8)
            drive.wait(40)
        assert drive.state() is State.FAULT

    def test_it_counts_from_operation_enabled_when_no_target_was_ever_written(self) -> None:
        drive = self.watched()
        drive.wait(51)
        assert drive.state() is State.FAULT

    def test_it_does_nothing_while_no_torque_can_be_made_and_nothing_at_a_time_of_zero(self) -> None:
        drive = Driven()
        drive.write(WATCHDOG, 50)
        drive.wait(1000)
        assert drive.state() is State.SWITCH_ON_DISABLED
        drive.write(WATCHDOG, 0)
        drive.enable()
        drive.wait(1000)
        assert drive.state() is State.OPERATION_ENABLED

    def test_the_fault_is_reset_by_an_edge_and_nothing_enables_by_itself(self) -> None:
        drive = self.watched()
        drive.wait(60)
        drive.write(TARGET, 100)
        assert drive.value(DEMAND) == 0
        drive.write(COMMAND, 0x80)
        assert (drive.state(), drive.value(ERROR)) == (State.SWITCH_ON_DISABLED, 0)

    @pytest.mark.parametrize(("factor", "acts_at"), [(3.0, 150.0), (None, math.inf)])
    def test_a_dead_one_acts_late_or_never(self, factor: float | None, acts_at: float) -> None:
        drive = self.watched(faults.DeadGuard("dead_guard", factor))
        drive.wait(149)
        assert drive.state() is State.OPERATION_ENABLED
        drive.wait(2)
        assert (drive.state() is State.FAULT) is math.isfinite(acts_at)


class TestFaults:
    def test_a_drive_whose_table_has_no_fault_reaction_is_off_when_it_shows_a_fault(self) -> None:
        simplex = modbus_profile(load_profile("simplex_motion"))
        drive = Driven(simplex, faults.DriveFault("drive_fault", 0.01, 0x2310))
        assert drive.write(399, 40) is None
        drive.write(449, 0, 300)
        drive.wait(9)
        assert drive.state() is State.OPERATION_ENABLED
        drive.wait(1.5)
        assert drive.value(399) == 4
        assert drive.state() is State.FAULT, "it does not brake meanwhile"

    def test_a_drive_fault_ends_the_torque_and_stays_as_long_as_its_cause(self) -> None:
        drive = Driven(GENERIC, faults.DriveFault("drive_fault", 0.01, 0x2310, duration=0.05))
        drive.enable()
        drive.write(TARGET, 100)
        drive.wait(11)
        assert (drive.value(DEMAND), drive.value(ERROR)) == (0, 0x2310)
        drive.write(COMMAND, 0x80)
        assert drive.state() is State.FAULT
        drive.wait(60)
        drive.write(COMMAND, 0)
        drive.write(COMMAND, 0x80)
        assert drive.state() is State.SWITCH_ON_DISABLED

    def test_safe_torque_off_ends_the_torque_at_once(self) -> None:
        drive = Driven(GENERIC, faults.SafeTorqueOff("safe_torque_off", 0.01))
        drive.enable()
        drive.wait(11)
        assert drive.state() is State.SWITCH_ON_DISABLED
        drive.write(COMMAND, 0)
        drive.write(COMMAND, 6)
        assert drive.state() is State.SWITCH_ON_DISABLED

    def test_a_reset_loses_what_was_written_and_answers_only_later(self) -> None:
        drive = Driven(GENERIC, faults.NodeReset("node_reset", 0.01, duration=0.02))
        drive.write(WATCHDOG, 500)
        drive.enable()
        drive.wait(11)
        assert not drive.unit.hears(drive.t_ns)
        drive.wait(20)
        assert drive.unit.hears(drive.t_ns)
        assert drive.read(COMMAND, 5) == [0, 0, 0, 3000, 0]

    def test_a_silent_drive_hears_nothing_for_its_time_and_a_missing_one_never(self) -> None:
        drive = Driven(GENERIC, faults.Silence("silence", 0.01, duration=0.02))
        drive.enable()
        drive.wait(11)
        assert not drive.unit.hears(drive.t_ns)
        drive.wait(20)
        assert drive.unit.hears(drive.t_ns)
        assert not Driven(GENERIC, faults.MissingNode("missing_node")).unit.hears(10**15)

    def test_another_identity_is_another_value(self) -> None:
        usual = Driven().read(0x300, 2)
        other = Driven(GENERIC, faults.WrongIdentity("wrong_identity")).read(0x300, 2)
        given = Driven(GENERIC, faults.WrongIdentity("wrong_identity", product_code=77)).read(0x302, 2)
        assert usual != other
        assert given == [0, 77]

    def test_an_encoder_that_jumps_shows_it_in_its_register(self) -> None:
        drive = Driven(GENERIC, faults.EncoderJump("encoder_jump", 0.01, 70000))
        drive.enable()
        drive.wait(11)
        words = drive.read(POSITION, 2)
        assert isinstance(words, list)
        assert signed(words) == 70000

    def test_faults_of_the_line_and_the_host_are_passed_on(self) -> None:
        these = faults.AnswerLost("answer_lost", 0.01), faults.HostLate("host_late", 0.01, 0.001)
        drive = Driven(GENERIC, *these)
        drive.enable()
        drive.wait(11)
        assert drive.line.happened == list(these)

    def test_faults_of_another_protocol_are_refused(self) -> None:
        with pytest.raises(ValueError, match="drives on Modbus do not support the fault sdo_abort"):
            Driven(GENERIC, faults.SdoRefusal("sdo_abort", 0x6060))
        drives = Driven().drives
        with pytest.raises(ValueError, match="drives on Modbus do not support the fault bus_off"):
            drives.add(replace(slot(GENERIC, faults.BusOff("bus_off", 0.0)), node=4), 0)
        assert drives.add(replace(slot(), node=4), 0).number == 4  # a refused drive takes no number

    def test_a_fault_planned_by_a_test_counts_from_now(self) -> None:
        drive = Driven()
        drive.drives.let_happen(faults.DriveFault("drive_fault", 0.01), drive.unit.number, drive.t_ns)
        drive.enable()
        drive.wait(11)
        assert drive.state() is State.FAULT

    def test_two_drives_of_one_unit_id_are_refused(self) -> None:
        drive = Driven()
        with pytest.raises(ValueError, match="node 3 is on this bus already"):
            drive.drives.add(slot(), 0)
