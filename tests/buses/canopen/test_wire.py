"""Opening python-can interfaces, and frames of all kinds in the log."""

import can
import pytest

from haptic_fieldbus.buses.canopen.wire import Wire, open_can
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from tests.buses.canopen.fake_can import FakeCan


def test_any_python_can_interface_can_be_opened() -> None:
    with open_can(CanSection("virtual", "wire-test")) as bus:
        assert isinstance(bus, can.BusABC)


def test_an_interface_that_does_not_exist_is_named() -> None:
    with pytest.raises(BusError, match="cannot open no_such_interface:can0"):
        open_can(CanSection("no_such_interface", "can0"))


def test_a_channel_that_does_not_exist_is_named() -> None:
    with pytest.raises((BusError, UsageError), match="cannot open socketcan:no_such_channel"):
        open_can(CanSection("socketcan", "no_such_channel"))


def test_the_log_tells_extended_remote_and_error_frames_apart_as_socketcan_does() -> None:
    clock = VirtualClock()
    bus = FakeCan(clock)
    logged: list[int] = []
    wire = Wire(bus, clock, "fake0", lambda t_ns, can_id, data: logged.append(can_id))
    for extended, remote, error in (
        (False, False, False),
        (True, False, False),
        (False, True, False),
        (False, False, True),
    ):
        message = can.Message(
            arbitration_id=0x20, is_extended_id=extended, is_remote_frame=remote, is_error_frame=error
        )
        bus.later(0, message)
    wire.drain(1)
    bus.shutdown()
    assert logged == [0x20, 0x8000_0020, 0x4000_0020, 0x2000_0020]


def test_a_flood_of_frames_ends_at_the_deadline() -> None:
    clock = VirtualClock()
    bus = FakeCan(clock)

    def babble() -> None:
        bus.reply(0x001, b"", 0)
        clock.compute(1000)
        bus.later(0, babble)

    babble()
    Wire(bus, clock, "fake0").drain(50_000)
    bus.shutdown()
    assert clock.now_ns() <= 60_000
