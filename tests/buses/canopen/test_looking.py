"""Looking at simulated drives in virtual time: what is seen of them in any state, and that nothing is done to them."""

from collections.abc import Iterator

import pytest

from haptic_fieldbus.buses.canopen.access import BusObserver
from haptic_fieldbus.drive.profile import DataType, PowerState
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.drive.dictionary import Access, Entry
from tests.buses.canopen.two_programs import TwoPrograms, assert_uploads_alone

GENERIC = canopen_profile(load_profile("generic_cia402"))
OTHERS = pytest.mark.parametrize(
    "frame",
    [(0x080, b""), (0x77F, b"\x05"), (0x600 + 99, b"\x40" + bytes(7))],
    ids=("SYNC", "heartbeat", "upload"),
)
AXES = {"handle": (99, GENERIC), "gone": (33, GENERIC)}


@pytest.fixture
def two() -> Iterator[TwoPrograms]:
    made = TwoPrograms()
    yield made
    made.close()


def looking(two: TwoPrograms, listening: float = 0.1) -> BusObserver:
    return BusObserver(two.wire, AXES, listening, 127)


def state_of(look: BusObserver) -> PowerState:
    return CIA402.state(look.look()["handle"].values[Signal.STATUSWORD])


def test_what_a_drive_offers_is_read_and_nothing_is_written(two: TwoPrograms) -> None:
    seen = [look.look() for look in [looking(two)] for _ in range(5)]
    assert set(seen[-1]["handle"].values) == {Signal.STATUSWORD, Signal.POSITION, Signal.TORQUE_ACTUAL}
    assert 0.0 < (seen[-1]["handle"].age or 0.0) < 0.05
    assert_uploads_alone(two.sent())


def test_a_drive_that_is_not_there_is_told_and_hides_no_other(two: TwoPrograms) -> None:
    look, began_ns = looking(two), two.clock.now_ns()
    glimpse = look.look()
    assert two.clock.now_ns() - began_ns == pytest.approx(0.1e9, abs=0.02e9), "an answer may take 0.1 s, and no longer"
    assert glimpse["gone"].values == {}
    assert glimpse["gone"].age is None
    assert "no answer" in glimpse["gone"].note
    assert "terminators" in glimpse["gone"].note
    assert glimpse["handle"].note == ""


def test_a_node_with_several_axes_in_sub_indices_is_told_with_what_to_write() -> None:
    two = TwoPrograms("generic_cia402@99")
    dictionary = two.bus.world.slave(99).drive.dictionary
    dictionary.remove(0x6064)
    dictionary.add_record([Entry(0x6064, number, DataType.INT32, access=Access.RO) for number in (1, 2)])
    dictionary.remove(0x6077)
    look = looking(two)
    look.look()
    two.sent()
    note = look.look()["handle"].note
    asked = two.sent()
    two.close()
    assert "several axes share this node, each in its own sub-index (6064h:01 and :02): write one profile" in note
    assert "6077h:01" not in note
    assert [frame for frame in asked if frame.arbitration_id == 0x663 and frame.data[3]] == [], "asked once"


def test_a_drive_that_somebody_left_enabled_stays_so(two: TwoPrograms) -> None:
    two.put(99, 0x6060, 0, 10, 1)
    two.send(0, bytes((1, 99)))
    for controlword in (0x06, 0x07, 0x0F):
        two.put(99, 0x6040, 0, controlword, 2)
    two.forget()
    look = looking(two)
    assert [state_of(look) for _ in range(20)] == [PowerState.OPERATION_ENABLED] * 20


def test_a_drive_in_fault_is_shown_with_its_code(two: TwoPrograms) -> None:
    two.enable(99)
    two.spend(0.3)
    two.forget()
    look = looking(two)
    glimpse = look.look()["handle"]
    assert CIA402.state(glimpse.values[Signal.STATUSWORD]) is PowerState.FAULT
    assert glimpse.error_code == 0x8130


def test_the_heartbeat_of_a_drive_is_dated(two: TwoPrograms) -> None:
    two.put(99, 0x1017, 0, 40, 2)
    two.forget()
    look = looking(two)
    look.look()
    glimpse = look.look()["handle"]
    assert glimpse.nmt_state == "pre-operational"
    # A look at the node that is gone takes 0.1 s; within it a heartbeat came, at an instant that is not known better.
    assert 0.0 <= (glimpse.life_age or 1.0) <= 0.15


@pytest.mark.parametrize(
    "frame", [(0x080, b""), (0x77F, b"\x05"), (0x600 + 99, b"\x40" + bytes(7))], ids=("SYNC", "heartbeat", "upload")
)
def test_with_another_master_it_only_listens_from_the_beginning(two: TwoPrograms, frame: tuple[int, bytes]) -> None:
    two.send(*frame)
    look = looking(two)
    assert "another master on" in look.masters
    assert look.look()["handle"].values == {}
    two.spend(0.0)
    assert_nothing_sent(two, look)


@pytest.mark.parametrize(
    "frame", [(0x080, b""), (0x77F, b"\x05"), (0x600 + 99, b"\x40" + bytes(7))], ids=("SYNC", "heartbeat", "upload")
)
def test_with_another_master_it_only_listens_from_then_on(two: TwoPrograms, frame: tuple[int, bytes]) -> None:
    look = looking(two)
    assert look.look()["handle"].values
    assert look.masters == ""
    two.send(*frame)
    two.spend(0.01)
    look.look()
    assert look.masters
    assert_nothing_sent(two, look)


def assert_nothing_sent(two: TwoPrograms, look: BusObserver) -> None:
    two.sent()
    for _ in range(5):
        assert look.look()["handle"].values == {}
    assert two.sent() == []
