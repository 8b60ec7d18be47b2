"""Listening before anything is sent: what is refused, what is told, and that nothing is sent meanwhile."""

from collections.abc import Callable
from dataclasses import replace

import can
import pytest

from haptic_fieldbus.buses.canopen.frames import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, frame_bits
from haptic_fieldbus.cli.failures import outcome_of
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import ForeignMasterError, PlanError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection
from tests.builders import WALL, can_traffic, plan_of, rig_of
from tests.buses.canopen.benches import LISTENING_NS, NODE, Bench
from tests.buses.canopen.test_other_master import COMMANDS, HARMLESS, QUESTIONS

REFUSED = {**COMMANDS, **{name: (can_id, data) for name, (can_id, data, _) in QUESTIONS.items()}}


def _rig(**changes: object) -> Rig:
    rig = rig_of(WALL)
    section = rig.bus["bus"]
    assert isinstance(section, CanSection)
    return replace(rig, bus={"bus": replace(section, **changes)})  # type: ignore[arg-type]


def _plan(**changes: object) -> Plan:
    return plan_of(rig=_rig(**changes))


@pytest.mark.parametrize("at_ns", [0, LISTENING_NS - 1_000_000], ids=["at first", "at last"])
@pytest.mark.parametrize("name", REFUSED)
def test_a_bus_with_a_master_is_refused_and_nothing_is_sent(name: str, at_ns: int) -> None:
    bench = Bench()
    can_id, data = REFUSED[name]
    # The frames that waited before we came say nothing about the present, so this one comes a little later.
    bench.can.reply(can_id, data, at_ns + 2_000)
    with pytest.raises(ForeignMasterError, match=rf"another master on fake0.*{can_id:03X}h.*one rig.*Nothing was sent"):
        bench.open()
    assert bench.can.sent == []
    assert outcome_of(ForeignMasterError).status == 4


def test_a_heartbeat_of_our_node_id_alone_may_be_a_device_and_another_id_for_us_is_proposed() -> None:
    bench = Bench()
    bench.can.reply(0x77F, b"\x05", 100_000_000)
    with pytest.raises(ForeignMasterError, match=r"heartbeat of node 127 \(77Fh\) 1×.*another master_node for the bus"):
        bench.open()
    other = Bench(_plan(master_node=126))
    other.can.reply(0x77F, b"\x05", 100_000_000)
    other.open()
    assert other.drive.value(0x1016, 1) >> 16 == 126
    other.bus.write(bytes(4))
    assert other.can.of(0x77E) == [b"\x05"]


class TestForeignLoad:
    """Frames of other devices count as load: by Davis et al. 2007 one of 8 octets takes 135 bits at worst."""

    def test_of_what_comes_before_anything_is_sent_our_own_drives_count_as_none(self) -> None:
        bench = Bench()
        for at_ms in range(100):
            bench.can.reply(0x2A7, bytes(8), 1_000_000 * (at_ms + 1))
        bench.can.reply(0x700 + NODE, b"\x05", 500_000_000)
        bench.open()
        assert bench.bus.foreign_load == {"handle": pytest.approx(100 * 135 / 1e6)}

    def test_in_the_loop_too_where_the_interface_lets_us_hear_them(self) -> None:
        bench = Bench().open()
        assert bench.bus.foreign_load == {"handle": 0.0}
        began_ns = bench.clock.now_ns()
        for at_us in range(1, 11):
            message = can.Message(arbitration_id=0x2A7, data=bytes(8), is_extended_id=at_us % 2 == 1)
            bench.can.later(100_000 * at_us, message)
        bench.bus.read(began_ns + 2_000_000)
        bench.clock.sleep_until(began_ns + 2_000_000)
        bench.bus.prepare(began_ns + 3_000_000)
        lasted = (bench.clock.now_ns() - began_ns) * 1e-9
        assert bench.bus.foreign_load["handle"] == pytest.approx((5 * 135 + 5 * 160) / (lasted * 1e6), rel=1e-3)

    @pytest.mark.parametrize(("can_id", "data", "bits"), [
        (0x2A7, bytes(8), 135), (0x2A7 | EXTENDED_FLAG, bytes(8), 160), (0x701 | REMOTE_FLAG, bytes(1), 55),
        (ERROR_FLAG | 0x40, bytes(8), 0),
    ])  # fmt: skip
    def test_each_kind_of_frame_has_its_length(self, can_id: int, data: bytes, bits: int) -> None:
        """29 bits of identifier: 54 + 64 bits that may be stuffed, 13 that are not, 29 stuff bits."""
        assert frame_bits(can_id, data) == bits

    def test_a_bus_that_was_not_listened_to_has_none(self) -> None:
        assert Bench(_plan(listen=0.0)).open().bus.foreign_load == {"handle": 0.0}


def test_a_master_node_that_a_drive_has_is_refused() -> None:
    with pytest.raises(PlanError, match="master_node 1 of the bus is the node-ID of one of its drives"):
        _plan(master_node=NODE)


@pytest.mark.parametrize("name", HARMLESS)
def test_others_are_told_and_nothing_was_sent_before_the_time_was_over(name: str) -> None:
    bench = Bench()
    for number in range(3):
        bench.can.reply(*HARMLESS[name], 1_000_000 * (1 + number))
    bench.open()
    assert bench.can.sent[0][0] == LISTENING_NS
    told = bench.bus.facts["handle"].listened
    assert told.startswith("fake0: listened for 1 s without sending; received ")
    assert f"({HARMLESS[name][0]:03X}h) 3×." in told
    assert "Not detectable: a master that sends nothing" in told


def test_a_quiet_bus_is_told_so() -> None:
    assert "; received nothing. Not detectable" in Bench().open().bus.facts["handle"].listened


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (can.Message(arbitration_id=0x18DA, is_extended_id=True), "extended frame (000018DAh) 1×"),
        (can.Message(arbitration_id=0x181, is_extended_id=False, is_remote_frame=True), "remote frame (181h) 1×"),
        (can.Message(arbitration_id=0x4, is_extended_id=False, is_error_frame=True, data=bytes(8)), "error frame 1×"),
        (can.Message(arbitration_id=0x7E5, is_extended_id=False, data=bytes(8)), "LSS request (7E5h) 1×"),
        (can.Message(arbitration_id=0x701, is_extended_id=False, data=b"\x7f"), "heartbeat of node 1 (701h) 1×"),
        (can.Message(arbitration_id=0x120, is_extended_id=False), "frame (120h) 1×"),
    ],
)
def test_every_kind_of_frame_is_named(message: can.Message, words: str) -> None:
    bench = Bench()
    bench.can.later(2_000, message)
    assert words in bench.open().bus.facts["handle"].listened


def test_many_kinds_are_counted() -> None:
    bench = Bench()
    for node in range(10, 20):
        bench.can.reply(0x700 + node, b"\x05", 2_000)
    assert "heartbeat of node 13 (70Dh) 1× and 6 others" in bench.open().bus.facts["handle"].listened


def test_node_guarding_of_our_drive_is_refused() -> None:
    bench = Bench()
    bench.can.later(2_000, can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True))
    with pytest.raises(ForeignMasterError, match=r"node guarding request to node 1 \(701h\) 1×"):
        bench.open()


@pytest.mark.parametrize("seconds", [0.0, 0.25, 3.0])
def test_the_time_can_be_chosen_in_the_rig(seconds: float) -> None:
    bench = Bench(_plan(listen=seconds))
    bench.open()
    assert bench.can.sent[0][0] == round(seconds * 1e9)
    told = bench.bus.facts["handle"].listened
    assert ("not checked" in told) is (seconds == 0.0)
    assert can_traffic(bench.plan).listening == seconds


def test_a_flood_ends_with_the_time_too() -> None:
    bench = Bench(_plan(listen=0.01))

    def babble() -> None:
        bench.can.reply(0x100, bytes(6), 0)
        bench.clock.compute(100_000)
        if bench.clock.now_ns() < LISTENING_NS:
            bench.can.later(0, again)

    again: Callable[[], None] = babble
    bench.can.later(2_000, babble)
    bench.bus._wire.mute()
    bench.open()
    assert bench.can.sent[0][0] < 20_000_000
