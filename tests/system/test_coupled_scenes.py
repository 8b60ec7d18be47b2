"""The shipped scenes that couple two axes, on both shipped profiles."""

import pytest

from haptic_fieldbus.api import run
from tests.builders import endless_rig


@pytest.mark.thorough("six runs", quick=1)
@pytest.mark.parametrize("name", ["virtual_shaft", "teleoperation"])
@pytest.mark.parametrize(
    ("drive", "hand"), [("maxon_epos4", "push"), ("maxon_epos4", "tap"), ("generic_cia402", "sine")]
)
def test_the_shipped_scenes_run_on_both_shipped_benches(name: str, drive: str, hand: str) -> None:
    result = run(name, endless_rig(name, drive), hand=hand, duration=2.0)
    assert (result.missed_cycles, result.trips) == (0, ())
    assert result.stability is not None
    assert result.stability.margin is not None
    assert result.stability.nominal_margin is not None
    assert result.stability.nominal_margin > 1.8
