"""A drive that is asked until it has reached a state: how often, and until when."""

from haptic_fieldbus.buses.release import reached_within
from haptic_fieldbus.clock import VirtualClock


class Asked:
    """A drive whose time passes by waiting alone."""

    label = "drive"

    def __init__(self) -> None:
        self.clock = VirtualClock()

    def now_ns(self) -> int:
        return self.clock.now_ns()

    def wait(self, duration_ns: int) -> None:
        self.clock.sleep_until(self.now_ns() + duration_ns)


def test_a_drive_that_needs_12_ms_is_waited_for_no_longer_than_5_ms_more() -> None:
    drive = Asked()
    assert reached_within(drive, 1.0, lambda: drive.now_ns() >= 12_000_000)
    assert drive.now_ns() <= 17_000_000


def test_a_drive_that_never_gets_there_is_given_up_within_5_ms_of_its_time() -> None:
    drive = Asked()
    assert not reached_within(drive, 0.1, lambda: False)
    assert 100_000_000 <= drive.now_ns() <= 105_000_000
