"""Frames of all kinds in the log."""

import can

from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.clock import VirtualClock
from tests.buses.canopen.fake_can import FakeCan


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
