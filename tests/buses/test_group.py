"""Several buses as one: all begin before any is waited for, and none is left with torque because another failed."""

import errno
import struct

import can
import pytest

from haptic_fieldbus.buses.bus import BusGroup
from haptic_fieldbus.buses.canopen.master import SYNC_BITS, CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import BusConfigurationError, BusError, DriveFaultError
from haptic_fieldbus.planning.image import AXIS_HEADER, HEADER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import can_traffic, plan_of, scene_of
from tests.buses.canopen.benches import TORQUE_FREE
from tests.buses.canopen.fake_can import DELAY_NS, FakeCan, FakeDrive, epos4_objects
from tests.several_buses import rig_on

NODE, RPDO, HEARTBEAT = 1, 0x201, 0x77F
PERIOD_NS = 1_000_000
SCENE = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))
NETWORK_DOWN = can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)


def plan_on_two_buses(right_bitrate: int = 1_000_000) -> Plan:
    """Two axes with the same node-ID, each on a bus of its own."""
    rig = rig_on(SCENE, {"left": "can_left", "right": "can_right"}, {"can_right": right_bitrate}, node=NODE)
    return plan_of(SCENE, rig=rig)


class TwoBuses:
    """Two fake buses with one drive each, and the master of both."""

    def __init__(self, plan: Plan | None = None) -> None:
        self.plan = plan or plan_on_two_buses()
        self.clock = VirtualClock()
        self.left, self.right = self.cans = FakeCan(self.clock), FakeCan(self.clock)
        self.drives = [FakeDrive(bus, NODE, epos4_objects(NODE)) for bus in self.cans]
        names = [bus.name for bus in self.plan.buses]
        self.bus = BusGroup(
            {name: CanopenBus(bus, self.clock, owned=True) for name, bus in zip(names, self.cans, strict=True)}
        )

    def open(self) -> "TwoBuses":
        self.bus.open(self.plan)
        return self

    def read(self) -> bytearray:
        return self.bus.read(self.clock.now_ns() + PERIOD_NS)

    def header(self, image: bytearray, axis: int) -> tuple[int, LinkFlag]:
        age_ns, flags, _ = AXIS_HEADER.unpack_from(image, self.plan.image.axes[axis].header)
        return age_ns, LinkFlag(flags)

    def counts(self, image: bytearray, axis: int) -> int:
        return int(struct.unpack_from("<Hi", image, self.plan.image.axes[axis].inputs[0])[1])

    def enable(self) -> "TwoBuses":
        for controlword in (0x06, 0x07, 0x0F, 0x0F):
            self.read()
            self.bus.write(struct.pack("<HhHh", controlword, 100, controlword, -100))
        assert [drive.value(0x6041) for drive in self.drives] == [0x27, 0x27]
        return self


def test_sync_is_sent_on_all_buses_before_the_first_is_waited_for() -> None:
    bench = TwoBuses().open()
    sent_ns = bench.clock.now_ns()
    bench.read()
    assert [bus.sent[-1] for bus in bench.cans] == [(sent_ns, 0x080, b"")] * 2
    assert bench.clock.now_ns() == sent_ns + DELAY_NS, "both were waited for at the same time"


def test_each_bus_fills_its_part_of_the_one_image() -> None:
    bench = TwoBuses().open()
    bench.drives[0].counts_at, bench.drives[1].counts_at = lambda _: -11, lambda _: 22
    image = bench.read()
    assert len(image) == bench.plan.image.input_size
    assert [bench.counts(image, axis) for axis in (0, 1)] == [-11, 22]
    assert [bench.header(image, axis)[1] for axis in (0, 1)] == [LinkFlag(0), LinkFlag(0)]
    assert bench.read() is image


def test_the_image_has_the_instant_of_the_last_latch_and_each_axis_the_age_since_its_own() -> None:
    """At half the bit rate SYNC takes 48 µs more, whichever bus is named first."""
    bench = TwoBuses(plan_on_two_buses(right_bitrate=500_000)).open()
    sent_ns = bench.clock.now_ns()
    image = bench.read()
    assert HEADER.unpack_from(image)[0] == sent_ns + 2 * SYNC_BITS * 1000
    assert bench.header(image, 0)[0] == DELAY_NS - SYNC_BITS * 1000
    assert bench.header(image, 1)[0] == DELAY_NS - 2 * SYNC_BITS * 1000


def test_each_bus_gets_the_set_points_of_its_axes_and_heartbeats_of_ours() -> None:
    bench = TwoBuses().open()
    before = [len(bus.sent) for bus in bench.cans]
    for value in range(can_traffic(bench.plan).heartbeat_every + 1):
        bench.bus.write(bytes((value, 0, 1, 0, value, 0, 2, 0)))
    for bus, start, torque in zip(bench.cans, before, (1, 2), strict=True):
        frames = [(can_id, data) for _, can_id, data in bus.sent[start:]]
        assert frames[:2] == [(RPDO, bytes((0, 0, torque, 0))), (HEARTBEAT, b"\x05")]
        assert bus.of(RPDO)[-1] == bytes((can_traffic(bench.plan).heartbeat_every, 0, torque, 0))
        assert bus.of(HEARTBEAT) == [b"\x05"] * 2


def test_a_bus_that_is_silent_until_the_deadline_does_not_make_the_other_stale() -> None:
    bench = TwoBuses().open()
    bench.drives[0].mute_tpdos = True
    bench.drives[1].counts_at = lambda _: 5
    started_ns = bench.clock.now_ns()
    image = bench.read()
    assert bench.clock.now_ns() == started_ns + PERIOD_NS
    assert [bench.header(image, axis)[1] for axis in (0, 1)] == [LinkFlag.STALE, LinkFlag(0)]
    assert bench.counts(image, 1) == 5


def test_facts_warnings_and_restarts_are_those_of_all_buses() -> None:
    bench = TwoBuses().open()
    assert {axis: facts.node for axis, facts in bench.bus.facts.items()} == {"left": NODE, "right": NODE}
    assert bench.bus.causes == {}
    for drive in bench.drives:
        drive.restart()
        drive.aborts[0x1016, 1] = 0x0800_0022
    bench.read()
    assert bench.bus.causes == dict.fromkeys(("left", "right"), (LinkFlag.BOOT_UP, 0))
    bench.bus.stop()
    assert len([sentence for sentence in bench.bus.warnings if "watchdog armed" in sentence]) == 2


def test_a_wrong_drive_on_the_second_bus_leaves_the_first_untouched() -> None:
    bench = TwoBuses()
    bench.drives[1].objects[0x1018, 1] = (0x9A).to_bytes(4, "little")
    with pytest.raises(BusConfigurationError, match=r"axis right.*0000009Ah"):
        bench.open()
    bench.bus.close()
    assert all(data[0] == 0x40 for _, _, data in bench.left.sent), "only uploads"
    assert all(bus.is_shut_down for bus in bench.cans)


def test_a_second_bus_that_cannot_be_configured_leaves_the_first_untouched_by_torque() -> None:
    bench = TwoBuses()
    bench.drives[1].aborts[0x6060, 0] = 0x0601_0002
    with pytest.raises(BusConfigurationError, match="axis right"):
        bench.open()
    bench.bus.close()
    for bus, drive in zip(bench.cans, bench.drives, strict=True):
        assert bus.of(0x000)[-1] == bytes((0x80, NODE))
        assert set(bus.of(RPDO)) <= {TORQUE_FREE}
        assert (drive.state, bus.is_shut_down) == (0x7F, True)


def test_a_second_bus_that_does_not_start_stops_the_first_torque_free() -> None:
    bench = TwoBuses()
    bench.drives[1].stays_in = 0x7F
    with pytest.raises(BusError, match=r"axis right.*operational"):
        bench.open()
    bench.bus.close()
    assert bench.left.of(RPDO)[0] == TORQUE_FREE
    assert bench.left.of(0x000)[-1] == bytes((0x80, NODE))
    assert bench.drives[0].value(0x1016, 1) == 0, "it no longer waits for us"
    assert all(bus.is_shut_down for bus in bench.cans)


@pytest.mark.parametrize("failure", [NETWORK_DOWN, RuntimeError("the driver fell over")], ids=["foreseen", "not"])
@pytest.mark.parametrize("dead", [0, 1])
def test_stopping_puts_torque_free_set_points_on_every_bus_even_when_one_raises(dead: int, failure: Exception) -> None:
    bench = TwoBuses().open().enable()
    other = 1 - dead
    enabled = len(bench.cans[other].sent)
    bench.cans[dead].broken = failure
    assert bench.bus.stop() is False
    assert any("was not sent" in sentence for sentence in bench.bus.warnings)
    assert bench.cans[other].sent[enabled][1:] == (RPDO, TORQUE_FREE)
    assert bench.drives[other].value(0x6041) == 0x40
    assert bench.drives[other].value(0x6071) == 0


@pytest.mark.parametrize("dead", [0, 1])
def test_a_dead_bus_raises_in_the_exchange(dead: int) -> None:
    bench = TwoBuses().open().enable()
    bench.cans[dead].broken = NETWORK_DOWN
    with pytest.raises(BusError, match="down or gone"):
        bench.read()
    with pytest.raises(BusError, match="down or gone"):
        bench.bus.write(bytes(8))


def test_set_points_go_out_on_all_buses_before_any_is_waited_for() -> None:
    bench = TwoBuses().open().enable()
    stopped_ns = bench.clock.now_ns()
    assert bench.bus.stop() is True
    for bus in bench.cans:
        first = next(t_ns for t_ns, can_id, data in bus.sent if (can_id, data) == (RPDO, TORQUE_FREE))
        assert first == stopped_ns


@pytest.mark.parametrize("silent", [0, 1])
def test_a_silent_bus_does_not_keep_the_drives_of_the_other_waiting(silent: int) -> None:
    bench = TwoBuses().open().enable()
    bench.drives[silent].silent = True
    bench.read()
    stopped_ns = bench.clock.now_ns()
    assert bench.bus.stop() is False
    healthy = bench.cans[1 - silent]
    assert bench.drives[1 - silent].value(0x1016, 1) == 0
    asked = [t_ns for t_ns, can_id, _ in healthy.sent if can_id == 0x600 + NODE]
    assert max(asked) < stopped_ns + 10 * PERIOD_NS, "its guard was disarmed at once"
    assert bench.clock.now_ns() > stopped_ns + 50 * PERIOD_NS, "the silent one has its guard's time"


class Raising(CanopenBus):
    """A bus that breaks the contract of every part of `stop`."""

    def release(self) -> None:
        raise RuntimeError("the driver fell over")

    def settle(self) -> bool:
        raise RuntimeError("the driver fell over")

    def leave(self) -> bool:
        raise RuntimeError("the driver fell over")


@pytest.mark.parametrize("first", [True, False])
def test_a_bus_that_raises_although_it_must_not_keeps_no_other_from_being_freed(first: bool) -> None:
    bench = TwoBuses().open().enable()
    good = CanopenBus(bench.right, bench.clock)
    good.open(bench.plan.on(bench.plan.buses[1]))
    bad = Raising(bench.left, bench.clock)
    group = BusGroup({"bad": bad, "good": good} if first else {"good": good, "bad": bad})
    assert group.stop() is False
    assert bench.drives[1].value(0x6041) == 0x40
    assert bench.drives[1].value(0x1016, 1) == 0
    assert any("fell over" in sentence for sentence in group.warnings)


def test_stopping_and_closing_twice_is_the_same_as_once() -> None:
    bench = TwoBuses().open().enable()
    assert bench.bus.stop() is True
    sent = [len(bus.sent) for bus in bench.cans]
    assert bench.bus.stop() is True
    bench.bus.close()
    bench.bus.close()
    assert [len(bus.sent) for bus in bench.cans] == sent
    assert all(bus.is_shut_down for bus in bench.cans)


def test_closing_lets_go_of_every_bus_even_when_one_raises() -> None:
    bench = TwoBuses().open().enable()
    bench.left.broken = RuntimeError("the driver fell over")
    bench.bus.close()
    assert bench.left.is_shut_down
    assert bench.right.is_shut_down
    assert bench.right.of(RPDO)[-1] == TORQUE_FREE


def test_buses_that_were_never_opened_may_be_stopped_and_closed() -> None:
    bench = TwoBuses()
    assert bench.bus.stop() is True
    bench.bus.close()
    assert [bus.sent for bus in bench.cans] == [[], []]


def test_each_drive_is_asked_on_its_own_bus_and_all_faults_are_acknowledged() -> None:
    buses = TwoBuses().open()
    for word, drive in zip((0x27, 0x08), buses.drives, strict=True):
        drive.objects[0x6041, 0] = word.to_bytes(2, "little")
    assert [buses.bus.ask(axis.name) for axis in buses.plan.axes] == [0x27, 0x08]
    buses.bus.stop()
    for drive in buses.drives:
        drive.power_stays = 0x08
        drive.objects[0x6041, 0], drive.objects[0x603F, 0] = b"\x08\x00", b"\x10\x23"
    with pytest.raises(DriveFaultError, match="2310h"):
        buses.bus.acknowledge()
