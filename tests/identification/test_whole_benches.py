"""Benches drawn over decades, with all their parts, measured through their buses; `make soak` measures 300 of them."""

from pathlib import Path

import pytest

from haptic_fieldbus.api.identification import BenchTask, bounds_of
from tests.identification.drawn import table
from tests.identification.whole_benches import accurate, drawn_whole_bench, judged, measured_whole, wrong_with


@pytest.mark.thorough("measures 11 drawn benches through their buses")
@pytest.mark.parametrize("seed", [3, 5, 7, 8, 10, 14, 15, 16, 17, 24, 25])
def test_a_drawn_bench_stays_within_what_was_announced(tmp_path: Path, seed: int) -> None:
    measured = measured_whole(drawn_whole_bench(seed), tmp_path)
    assert measured.failure == ""
    assert wrong_with(measured) == []
    assert accurate(measured)["inertia"]


@pytest.mark.thorough("measures a bench")
def test_a_rigid_bench_is_known_well_and_a_bound_that_was_left_is_found(tmp_path: Path) -> None:
    measured = measured_whole(drawn_whole_bench(2), tmp_path)
    assert measured.failure == ""
    assert wrong_with(measured) == []
    assert all(accurate(measured).values())
    told = judged(measured)
    assert len(told) == 5
    assert sum(told.values()) >= 4
    measured.noted.angle = 100.0
    assert "travel of 25, announced were" in wrong_with(measured)[0]


@pytest.mark.thorough("measures 4 damped benches")
@pytest.mark.parametrize("seed", [49, 97, 184, 272])
def test_a_damped_bench_is_moved_through_its_travel_and_known_well(tmp_path: Path, seed: int) -> None:
    """Before, they moved over 11 to 18 % of their travel, and the delay of none was near."""
    measured = measured_whole(drawn_whole_bench(seed), tmp_path)
    assert measured.found is not None
    assert wrong_with(measured) == []
    assert all(accurate(measured).values())
    low, high = measured.found.announced.low, measured.found.announced.high
    places = [each * measured.bench.ratio for each in measured.found.records[1].positions]
    assert max(places) - min(places) > 0.5 * (high - low)


@pytest.mark.thorough("measures 2 benches that stick")
@pytest.mark.parametrize("seed", [274, 283])
def test_a_bench_that_sticks_in_the_motion_tells_no_values(tmp_path: Path, seed: int) -> None:
    """Their friction at rest is by half larger than in motion; before, an inertia 13 % off was told."""
    measured = measured_whole(drawn_whole_bench(seed), tmp_path)
    assert measured.found is None
    assert "the handle stuck in the slow motion: it moved by 0 counts of its encoder" in measured.failure
    assert "identified" not in (tmp_path / "rig.toml").read_text(encoding="utf-8")


def test_sums_of_a_draw_are_told_by_value() -> None:
    one = {"covered": {"inertia True": 1}, "near": {"inertia False": 1}, "refused": []}
    two = {"covered": {"inertia False": 1}, "near": {}, "refused": ["3: no motion"]}
    assert table([one, two]) == [
        "1 of 2 benches refused",
        "intervals that cover: inertia 1 of 2",
        "values that are near enough: inertia 0 of 1",
    ]


@pytest.mark.thorough("measures a bench")
def test_pulses_that_throw_the_handle_out_of_its_travel_end_it_as_announced(tmp_path: Path) -> None:
    """A handle that sticks breaks loose at a pulse that is much stronger than its friction."""
    bench = drawn_whole_bench(99)
    told = " ".join(bounds_of(BenchTask(bench.write(tmp_path), rate=bench.rate)).lines())
    assert "how far is not known beforehand; beyond the travel the motor is switched off" in told
    measured = measured_whole(bench, tmp_path)
    assert "beyond the limit of 0.004848 m; torque is off" in measured.failure
    assert measured.noted.angle == 0.0, "no experiment began"
