"""The period of the loop as each kind of drive is told it, and the periods that are refused."""

from dataclasses import replace

import pytest

from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.canopen.profile import SyncSection
from haptic_fieldbus.protocols.canopen.watch_traffic import period_objects
from tests.builders import PROFILE, plan_of


def told(rate: float, **keys: object) -> list[tuple[int, int, int]]:
    """Index, sub-index and value of each object that tells a drive of this section the period."""
    profile = replace(PROFILE, sync=SyncSection(**keys))  # type: ignore[arg-type]
    return [(entry.object, entry.subindex, value) for entry, value in period_objects(profile, rate)]


@pytest.mark.parametrize(
    ("rate", "powers", "value", "power"),
    [
        (1000.0, (-3,), 1, -3),
        (100.0, (-3,), 10, -3),
        (2000.0, (-3, -4), 5, -4),
        (4000.0, (-3, -4, -5, -6), 25, -5),
        (8000.0, (-3, -4, -5, -6), 125, -6),
        (1000.0, (-4, -3), 10, -4),
    ],
)
def test_60c2h_is_value_times_power_of_ten(rate: float, powers: tuple[int, ...], value: int, power: int) -> None:
    """The power first: a drive may refuse a value for the power that it has."""
    assert told(rate, interpolation_time=0x60C2, powers=powers) == [(0x60C2, 2, power), (0x60C2, 1, value)]
    assert value * 10.0**power == pytest.approx(1 / rate, rel=1e-12)


def test_1006h_is_in_microseconds() -> None:
    assert told(1000.0, cycle_period=0x1006) == [(0x1006, 0, 1000)]
    assert told(1e6 / 768, cycle_period=0x1006) == [(0x1006, 0, 768)]


def test_a_drive_without_either_is_told_nothing() -> None:
    assert told(1234.5) == []


@pytest.mark.parametrize(
    ("rate", "keys", "words"),
    [
        (2000.0, {"interpolation_time": 0x60C2}, "0.5 ms: 60C2h accepts 1 to 255 times 1 ms"),
        (800.0, {"interpolation_time": 0x60C2}, "1.25 ms: 60C2h accepts 1 to 255 times 1 ms"),
        (3.0, {"interpolation_time": 0x60C2}, "60C2h accepts"),
        (20.0, {"interpolation_time": 0x60C2, "values": (1, 20)}, "50 ms: 60C2h accepts 1 to 20 times 1 ms"),
        (3000.0, {"cycle_period": 0x1006}, "1006h accepts whole microseconds"),
        (2000.0, {"shortest_period": 0.001}, "its shortest period is 1 ms"),
    ],
)
def test_a_period_that_the_drive_cannot_take_is_refused_when_the_loop_is_planned(
    rate: float, keys: dict[str, object], words: str
) -> None:
    profile = replace(PROFILE, sync=SyncSection(**keys))  # type: ignore[arg-type]
    with pytest.raises(PlanError, match=rf"does not support a period of .*{words}.* Use another --rate"):
        plan_of(rate=rate, profile=profile)
