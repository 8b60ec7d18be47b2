"""CiA 301, 7.2.8 and 7.3.2: NMT states, boot-up, heartbeats, emergencies, error behaviour."""

import pytest

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.services.nmt import DRIVE
from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.sim.bench import MS, NODE, DriveBench, Refusal, profile

HEARTBEAT, EMERGENCY, MASTER = 0x705, 0x85, 0x77F
START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
RESET_NS = DriveSettings().reset_ns
LOST = bytes.fromhex("30 81 11 00 00 00 00 00")


def _state(bench: DriveBench) -> int:
    """The NMT state by the drive's own heartbeat."""
    bench.sent.clear()
    bench.run(10 * MS)
    (state,) = {data[0] for data in bench.take(HEARTBEAT)}
    return state


def _bench() -> DriveBench:
    bench = DriveBench()
    assert bench.write(0x1017, 0, 10, "H") is None
    return bench


class TestBoot:
    """The boot-up message is the heartbeat of *initialising*."""

    def test_power_on_ends_with_a_boot_up_message_after_its_delay(self) -> None:
        bench = DriveBench(booted=False, settings=DriveSettings(start_delay_ns=7000))
        bench.run(6999)
        assert bench.sent == []
        bench.give(0x600 + NODE, bytes.fromhex("40 00 10 00 00 00 00 00"))
        bench.run(1)
        assert [(t_ns, frame.can_id, frame.data) for t_ns, frame in bench.sent] == [(7000, HEARTBEAT, b"\0")]

    def test_a_drive_that_was_on_before_says_nothing_and_is_pre_operational(self) -> None:
        bench = DriveBench(booted=True)
        bench.run(1000 * MS)
        assert bench.sent == []
        assert bench.status() == 0x0270

    @pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
    def test_a_reset_ends_with_a_boot_up_message_and_nothing_is_answered_before(self, command: int) -> None:
        bench = _bench()
        bench.nmt(command)
        bench.run(RESET_NS - 1)
        bench.give(0x600 + NODE, bytes.fromhex("40 00 10 00 00 00 00 00"))
        assert bench.sent == []
        bench.run(1)
        assert bench.take(HEARTBEAT) == [b"\0"]

    def test_reset_communication_restores_communication_objects_only(self) -> None:
        bench = _bench()
        bench.operational()
        bench.write(0x6071, 0, 12, "h")
        bench.nmt(RESET_COMMUNICATION)
        bench.run(RESET_NS)
        assert bench.read(0x1017) == 0
        assert bench.read(0x1A00) == 1
        assert (bench.read(0x6060), bench.read(0x6071)) == (10, 12)

    def test_reset_node_restores_everything_and_switches_off(self) -> None:
        bench = DriveBench()
        bench.enable()
        bench.nmt(RESET_NODE)
        bench.run(RESET_NS)
        assert (bench.read(0x6060), bench.read(0x6061), bench.read(0x6040)) == (0, 0, 0)
        assert bench.status() == 0x0270


class TestStates:
    """Services that work in each state."""

    @pytest.mark.parametrize(
        ("commands", "state"),
        [
            ([], 127),
            ([START], 5),
            ([STOP], 4),
            ([START, STOP], 4),
            ([START, PRE_OPERATIONAL], 127),
            ([STOP, PRE_OPERATIONAL], 127),
            ([START, START], 5),
            ([7], 127),
        ],
    )
    def test_commands_lead_to_the_state_that_the_heartbeat_names(self, commands: list[int], state: int) -> None:
        bench = _bench()
        for command in commands:
            bench.nmt(command)
        assert _state(bench) == state

    def test_a_command_to_all_is_obeyed_and_one_to_another_node_is_not(self) -> None:
        bench = _bench()
        bench.nmt(START, node=NODE + 1)
        assert _state(bench) == 127
        bench.give(0, b"\1")
        assert _state(bench) == 127
        bench.nmt(START, node=0)
        assert _state(bench) == 5

    def test_sdo_is_not_answered_when_stopped(self) -> None:
        bench = _bench()
        bench.nmt(STOP)
        bench.give(0x600 + NODE, bytes.fromhex("40 00 10 00 00 00 00 00"))
        assert bench.take(0x580 + NODE) == []

    def test_an_sdo_abort_of_the_client_is_not_answered(self) -> None:
        bench = _bench()
        bench.give(0x600 + NODE, bytes.fromhex("80 00 10 00 00 00 04 05"))
        assert bench.take(0x580 + NODE) == []

    def test_sync_is_only_seen_when_operational(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.nmt(PRE_OPERATIONAL)
        bench.sync()
        assert bench.take(0x185) == []

    def test_emergencies_are_not_sent_when_stopped(self) -> None:
        bench = _bench()
        bench.nmt(STOP)
        bench.drive.fault(0x2310, bench.t_ns)
        assert bench.take(EMERGENCY) == []

    def test_frames_that_are_not_standard_data_frames_concern_nobody(self) -> None:
        bench = _bench()
        bench.slave.receive(Frame(0, bytes((START, 0)), extended=True), 0)
        bench.slave.receive(Frame(0, bytes(2), remote=True), 0)
        assert _state(bench) == 127


class TestSync:
    """1005h: identifier of SYNC."""

    def test_sync_may_have_another_identifier(self) -> None:
        bench = DriveBench()
        assert bench.write(0x1005, 0, 0x81, "I") is None
        bench.operational()
        bench.sync()
        assert bench.take(0x185) == []
        bench.give(0x81)
        assert len(bench.take(0x185)) == 1

    @pytest.mark.parametrize("value", [0x4000_0080, 0x2000_0080, 0])
    def test_producing_sync_and_extended_identifiers_are_refused(self, value: int) -> None:
        assert DriveBench().write(0x1005, 0, value, "I") == Refusal(0x0609_0030)


class TestProducer:
    """1017h."""

    def test_heartbeats_come_at_their_period_from_the_writing_on(self) -> None:
        bench = DriveBench()
        bench.run(3 * MS)
        bench.write(0x1017, 0, 25, "H")
        bench.sent.clear()
        bench.run(100 * MS)
        assert [t_ns for t_ns, _ in bench.sent] == [28 * MS, 53 * MS, 78 * MS, 103 * MS]

    def test_zero_stops_them(self) -> None:
        bench = _bench()
        bench.write(0x1017, 0, 0, "H")
        bench.sent.clear()
        bench.run(100 * MS)
        assert bench.sent == []
        assert bench.slave.due_ns == NEVER_NS

    def test_a_heartbeat_can_be_lost_alone(self) -> None:
        bench = _bench()
        bench.node.heartbeat_enabled = False
        bench.sent.clear()
        bench.run(100 * MS)
        assert bench.sent == []


class TestConsumer:
    """1016h: monitoring of the master begins with its first heartbeat."""

    def _bench(self, action: int = 0, *, enabled: bool = False) -> DriveBench:
        bench = DriveBench()
        if enabled:
            bench.enable()
        assert bench.write(0x6007, 0, action, "h") is None
        assert bench.write(0x1016, 1, 127 << 16 | 50, "I") is None
        bench.sent.clear()
        return bench

    def test_nothing_is_monitored_before_the_first_heartbeat(self) -> None:
        bench = self._bench()
        bench.run(1000 * MS)
        assert bench.sent == []

    def test_a_boot_up_message_does_not_begin_it(self) -> None:
        bench = self._bench()
        bench.give(MASTER, b"\0")
        bench.give(MASTER, b"")
        bench.run(1000 * MS)
        assert bench.sent == []

    def test_a_heartbeat_in_time_keeps_it_quiet(self) -> None:
        bench = self._bench()
        for _ in range(20):
            bench.give(MASTER, b"\5")
            bench.run(49 * MS)
        assert bench.sent == []

    def test_a_loss_is_told_once_at_the_deadline_and_its_end_too(self) -> None:
        bench = self._bench()
        bench.give(MASTER, b"\5")
        bench.run(500 * MS)
        assert [(t_ns, frame.data) for t_ns, frame in bench.sent] == [(50 * MS, LOST)]
        bench.sent.clear()
        assert bench.read(0x1001) == 0x11
        bench.give(MASTER, b"\5")
        assert bench.take(EMERGENCY) == [bytes(8)]
        bench.give(MASTER, b"\5")
        assert bench.take(EMERGENCY) == []
        bench.run(51 * MS)
        assert bench.take(EMERGENCY) == [LOST]

    def test_writing_1016h_ends_the_monitoring_until_the_next_heartbeat(self) -> None:
        bench = self._bench()
        bench.give(MASTER, b"\5")
        bench.write(0x1016, 1, 127 << 16 | 100, "I")
        bench.sent.clear()
        bench.run(200 * MS)
        assert bench.sent == []
        bench.give(MASTER, b"\5")
        bench.run(99 * MS)
        assert bench.sent == []
        bench.run(1 * MS)
        assert len(bench.take(EMERGENCY)) == 1

    def test_another_node_is_not_listened_to(self) -> None:
        bench = self._bench()
        bench.give(0x701, b"\5")
        bench.run(100 * MS)
        assert bench.sent == []

    @pytest.mark.parametrize("value", [0, 127 << 16, 50])
    def test_without_node_or_time_nothing_is_watched(self, value: int) -> None:
        bench = self._bench()
        assert bench.write(0x1016, 1, value, "I") is None
        bench.sent.clear()
        bench.give(MASTER, b"\5")
        bench.run(100 * MS)
        assert bench.sent == []

    def test_a_node_that_cannot_be_is_not_watched(self) -> None:
        bench = self._bench()
        assert bench.write(0x1016, 1, 200 << 16 | 50, "I") is None
        assert 0x7C8 not in bench.node.handlers

    def test_writing_1016h_while_the_master_is_lost_ends_the_error(self) -> None:
        bench = self._bench()
        bench.give(MASTER, b"\5")
        bench.run(51 * MS)
        bench.sent.clear()
        assert bench.write(0x1016, 1, 0, "I") is None
        assert bench.read(0x1001) == 0

    def test_a_drive_without_it_has_no_1016h(self) -> None:
        from dataclasses import replace

        bare = profile()
        bench = DriveBench(replace(bare, link_loss=replace(bare.link_loss, heartbeat_consumer=None)))
        assert bench.read(0x1016, 1) == Refusal(0x0602_0000)
        bench.give(MASTER, b"\5")
        bench.run(1000 * MS)
        assert bench.sent == []

    @pytest.mark.parametrize(
        ("action", "status"), [(0, 0x27), (1, 0x08), (2, 0x40)], ids=["none", "fault", "disable voltage"]
    )
    def test_6007h_says_what_a_loss_does_to_the_motor(self, action: int, status: int) -> None:
        bench = self._bench(action, enabled=True)
        assert bench.write(0x605E, 0, 0, "h") is None
        bench.give(MASTER, b"\5")
        bench.run(51 * MS)
        mask = 0x6F if status == 0x27 else 0x4F
        assert bench.status() & mask == status
        assert bench.read(0x603F) == (0x8130 if action == 1 else 0)

    @pytest.mark.parametrize(("factor", "at_ms"), [(1.0, 50), (10.0, 500), (None, None)])
    def test_a_dead_or_slow_watch_acts_never_or_so_much_later(self, factor: float | None, at_ms: int | None) -> None:
        bench = self._bench(2, enabled=True)
        bench.slave.node.slow_guards(factor)
        bench.give(MASTER, b"\5")
        bench.run((at_ms or 5000) * MS - 1)
        assert bench.status() & 0x6F == 0x27
        bench.run(2)
        assert (bench.status() & 0x6F == 0x27) is (at_ms is None)

    def test_a_quick_stop_on_loss_begins_at_the_deadline(self) -> None:
        bench = self._bench(3, enabled=True)
        assert bench.write(0x605A, 0, 6, "h") is None
        bench.give(MASTER, b"\5")
        bench.run(50 * MS)
        assert bench.status() & 0x6F == 0x07


class TestErrorBehaviour:
    """1029h:01: what a loss does to the NMT state."""

    @pytest.mark.parametrize(("behaviour", "state"), [(0, 127), (1, 5), (2, 4)])
    def test_operational_is_left_as_the_object_says(self, behaviour: int, state: int) -> None:
        bench = _bench()
        bench.write(0x1016, 1, 127 << 16 | 50, "I")
        assert bench.write(0x1029, 1, behaviour, "B") is None
        bench.nmt(START)
        bench.give(MASTER, b"\5")
        bench.run(60 * MS)
        assert _state(bench) == state

    def test_pre_operational_is_kept_unless_stopping_is_asked_for(self) -> None:
        for behaviour, state in ((0, 127), (2, 4)):
            bench = _bench()
            bench.write(0x1016, 1, 127 << 16 | 50, "I")
            bench.write(0x1029, 1, behaviour, "B")
            bench.give(MASTER, b"\5")
            bench.run(60 * MS)
            assert _state(bench) == state

    def test_other_values_are_refused(self) -> None:
        assert DriveBench().write(0x1029, 1, 3, "B") == Refusal(0x0609_0030)


class TestEmergencies:
    """1001h, 1003h, 1014h."""

    def test_the_history_holds_the_newest_first_and_can_only_be_cleared(self) -> None:
        bench = DriveBench()
        assert bench.read(0x1003, 1) == Refusal(0x0800_0024)
        for code in range(0x3001, 0x300B):
            bench.node.emergencies.raise_error(code)
        assert bench.read(0x1003) == 8
        assert [bench.read(0x1003, number) for number in (1, 2, 8)] == [0x300A, 0x3009, 0x3003]
        assert bench.write(0x1003, 0, 1, "B") == Refusal(0x0609_0030)
        assert bench.write(0x1003, 0, 0, "B") is None
        assert bench.read(0x1003) == 0

    @pytest.mark.parametrize(
        ("code", "register"),
        [(0x1000, 0x01), (0x2310, 0x03), (0x3210, 0x05), (0x4210, 0x09), (0x8130, 0x11), (0xFF01, 0x81)],
    )
    def test_the_error_register_names_the_class_of_the_error(self, code: int, register: int) -> None:
        bench = DriveBench()
        bench.node.emergencies.raise_error(code)
        (message,) = bench.take(EMERGENCY)
        assert message == code.to_bytes(2, "little") + bytes((register, 0, 0, 0, 0, 0))
        assert bench.read(0x1001) == register

    def test_an_error_that_is_active_is_not_told_again_and_an_unknown_one_not_cleared(self) -> None:
        bench = DriveBench()
        for _ in range(2):
            bench.node.emergencies.raise_error(0x3210)
        bench.node.emergencies.clear(0x2310)
        assert len(bench.take(EMERGENCY)) == 1

    def test_the_register_keeps_what_is_still_wrong(self) -> None:
        bench = DriveBench()
        bench.node.emergencies.raise_error(0x3210)
        bench.node.emergencies.raise_error(0x4210)
        bench.node.emergencies.clear(0x3210)
        assert bench.take(EMERGENCY)[-1] == bytes((0, 0, 0x09, 0, 0, 0, 0, 0))

    def test_bit_31_of_1014h_silences_them_and_the_identifier_is_fixed(self) -> None:
        bench = DriveBench()
        assert bench.read(0x1014) == 0x85
        assert bench.write(0x1014, 0, 0x86, "I") == Refusal(0x0609_0030)
        assert bench.write(0x1014, 0, 0x8000_0085, "I") is None
        bench.node.emergencies.raise_error(0x3210)
        assert bench.take(EMERGENCY) == []


def test_identity_and_name_are_those_of_the_profile() -> None:
    bench = DriveBench(settings=DriveSettings(serial=0x1234))
    assert bench.read(0x1000) == 0x0002_0192
    assert bench.read(0x1018) == 4
    assert bench.read(0x1018, 4) == 0x1234
    elmo = DriveBench(profile("elmo_gold"))
    assert (elmo.read(0x1018, 1), elmo.read(0x1018, 2)) == (0x9A, 0)
    joint = DriveBench(profile("zeroerr_erob"))
    assert (joint.read(0x1018, 1), joint.read(0x1018, 2)) == (0x5A65_726F, 0x2648_3052)
    assert (bench.read(0x1200, 1), bench.read(0x1200, 2)) == (0x605, 0x585)


class TestErrorsThatOutlive:
    """Whose errors a reset, a fault reset or a written parameter ends."""

    def test_a_fault_of_the_device_outlives_a_reset_of_communication_that_of_communication_does_not(self) -> None:
        bench = _bench()
        for code in (0x3210, 0x8130):
            bench.node.emergencies.raise_error(code)
        bench.nmt(RESET_COMMUNICATION)
        bench.run(RESET_NS)
        assert bench.read(0x1001) == 0x05
        bench.nmt(RESET_NODE)
        bench.run(RESET_NS)
        assert bench.read(0x1001) == 0

    def test_a_fault_reset_leaves_errors_of_communication_alone(self) -> None:
        bench = DriveBench()
        for code in (0x3210, 0x8130):
            bench.node.emergencies.raise_error(code)
        bench.node.emergencies.clear_all(DRIVE)
        assert bench.take(EMERGENCY)[-1] == bytes.fromhex("00 00 11 00 00 00 00 00")
        bench.node.emergencies.clear_all(DRIVE)
        assert bench.take(EMERGENCY) == []

    def test_writing_the_life_time_while_the_master_is_lost_ends_the_error(self) -> None:
        bench = DriveBench()
        bench.write(0x100C, 0, 10, "H")
        bench.write(0x100D, 0, 2, "B")
        bench.slave.receive(Frame(HEARTBEAT, b"", remote=True), bench.t_ns)
        bench.run(20 * MS)
        assert bench.read(0x1001) == 0x11
        bench.write(0x100D, 0, 0, "B")
        assert bench.read(0x1001) == 0

    def test_of_two_rpdos_that_are_wrong_each_must_be_right_again(self) -> None:
        bench = DriveBench()
        for number in (1, 2):
            bench.map(number, 255, [0x6040_0010], tpdo=False)
        bench.nmt(START)
        bench.give(0x205, b"\0")
        bench.give(0x305, b"\0")
        assert len(bench.take(EMERGENCY)) == 1
        bench.give(0x205, bytes(2))
        assert bench.take(EMERGENCY) == []
        bench.give(0x305, bytes(2))
        assert bench.take(EMERGENCY) == [bytes(8)]


def test_the_lss_address_has_zeros_for_what_1018h_does_not_say() -> None:
    bench = DriveBench(settings=DriveSettings(serial=7))
    bench.drive.dictionary.remove(0x1018, 3)
    bench.give(0x7E5, bytes((4, 1)) + bytes(6))
    for specifier, part in ((0x5C, 0), (0x5D, 7)):
        bench.sent.clear()
        bench.give(0x7E5, bytes((specifier,)) + bytes(7))
        assert bench.take(0x7E4) == [bytes((specifier, part)) + bytes(6)]


def test_a_node_is_set_to_the_bit_rate_of_its_bus() -> None:
    bench = DriveBench()
    bench.node.commission(500_000)
    for request in (bytes((4, 1)), bytes((0x13, 0, 2)), bytes((0x15, 10))):
        bench.give(0x7E5, request.ljust(8, b"\0"))
    bench.run(20 * MS)
    assert bench.read(0x1000) == 0x0002_0192
