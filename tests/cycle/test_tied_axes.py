"""Two axes that a coupling ties: what one of them misses, both must bear."""

import struct

import pytest

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.signals import LinkFlag
from tests.builders import plan_of, scene_of
from tests.cycle.test_cycle import ENABLED

PERIOD_NS, FADED_IN, FADING = 1_000_000, 600, 10
TURNED = 400
"""Encoder counts by which the left handle is turned against the right one."""


class Shaft:
    """A spring between two handles in a running cycle."""

    def __init__(self) -> None:
        self.cycle = Cycle(plan_of(scene_of(Coupling(("left", "right"), 400.0))))
        self.t_ns = 0
        for period in range(FADED_IN):
            self.torques(min(TURNED, 2 * period))

    def torques(self, counts: int, *, lost: bool = False) -> tuple[int, int]:
        """Target torques of a period; `lost`: without feedback of the right axis."""
        self.t_ns += PERIOD_NS
        axes = (0, 0, 0, 0, LinkFlag.STALE if lost else 0, 0, ENABLED, counts, 0, ENABLED, 0, 0)
        _, left, _, other = struct.unpack("<HhHh", self.cycle(struct.pack("<qIHHIHHHihHih", self.t_ns, *axes)))
        return left, other


@pytest.mark.parametrize("stale_periods", [2, 5, 30])
def test_axes_that_a_coupling_ties_fade_together(stale_periods: int) -> None:
    shaft = Shaft()
    before, _ = shaft.torques(TURNED)
    assert abs(before) > 20
    for missing in range(1, stale_periods + 1):
        left, right = shaft.torques(TURNED, lost=True)
        share = max(0.0, 1.0 - (missing - 1) / FADING)
        assert left == pytest.approx(before * share, abs=1)
        assert right == -left
    assert shaft.cycle.trip is None


def test_back_after_a_gap_neither_is_pushed_harder_than_before_it() -> None:
    shaft = Shaft()
    before, _ = shaft.torques(TURNED)
    for _ in range(FADING):
        shaft.torques(TURNED, lost=True)
    for more in range(100):
        left, right = shaft.torques(TURNED + 2 * more)
        assert abs(left) <= abs(before)
        assert abs(right) <= abs(before)
