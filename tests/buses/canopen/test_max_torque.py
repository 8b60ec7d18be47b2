"""Torque limits in the drive: those of the axis while a run lasts, the drive's own before and after it."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection
from tests.builders import WALL, plan_of, rig_of
from tests.buses.canopen.benches import Bench

MAX_TORQUE = (0x6072, 0)
READ_ONLY = 0x0601_0002
HALF = 500
"""The limit of the axis [‰ of rated torque]."""


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def half_plan(*, raised: bool = False, real: bool = False, wanted: float = 0.5) -> Plan:
    """A wall on an axis that may use half of the rated torque, or another share."""
    effort = wanted * plan_of().axes[0].rated_effort
    rig = rig_of(WALL, limits=Limits(effort=effort), raise_max_torque=raised)
    if real:
        rig = replace(rig, bus={"bus": CanSection("socketcan", "can0")})
    return plan_of(rig=rig)


def bench_of(
    held: int,
    *,
    raised: bool = False,
    real: bool = False,
    wanted: float = 0.5,
    entry: tuple[int, int] = MAX_TORQUE,
) -> Bench:
    """A bench whose drive holds a limit [‰ of rated torque]."""
    bench = Bench(half_plan(raised=raised, real=real, wanted=wanted))
    bench.drive.objects[entry] = held.to_bytes(2, "little")
    return bench


def notes(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "state").rglob("*.json"))


@pytest.mark.parametrize("index", [0x6072, 0x60E0, 0x60E1])
def test_a_higher_limit_is_lowered_for_the_time_of_the_run(index: int) -> None:
    bench = bench_of(3000, entry=(index, 0)).open()
    assert bench.drive.value(index) == HALF
    (told,) = bench.bus.facts["handle"].changes
    assert f"{index:04X}h" in told
    assert "is lowered from 300 % to 50 % of rated torque until the end" in told
    assert bench.bus.stop() is True
    assert (bench.drive.value(index), bench.bus.warnings) == (3000, [])


def test_a_limit_that_the_object_cannot_hold_is_refused_before_anything_is_written() -> None:
    plan = half_plan(raised=True)
    (axis,) = plan.axes
    limits = replace(axis.limits, effort=70.0 * axis.rated_effort)
    bench = Bench(replace(plan, axes=(replace(axis, limits=limits),)))
    bench.drive.objects[MAX_TORQUE] = (3000).to_bytes(2, "little")
    with pytest.raises(BusConfigurationError, match=r"6072h.* holds no more than 65535, and the limit .* is 70000 of"):
        bench.open()
    assert bench.written() == []


@pytest.mark.parametrize("held", [0, 100, HALF - 1])
def test_a_lower_limit_is_raised_only_where_the_rig_says_so(held: int) -> None:
    refused = bench_of(held)
    with pytest.raises(BusConfigurationError, match=rf"6072h.*is {held} ‰.*may ask for 500 ‰ \(25\.1 N\).*raise_max_t"):
        refused.open()
    assert refused.written() == []
    bench = bench_of(held, raised=True).open()
    assert bench.drive.value(*MAX_TORQUE) == HALF
    assert "is raised, as the rig says, from " in bench.bus.facts["handle"].changes[0]
    bench.bus.stop()
    assert bench.drive.value(*MAX_TORQUE) == held


def test_a_limit_that_fits_is_neither_written_nor_mentioned() -> None:
    bench = bench_of(HALF).open()
    bench.bus.stop()
    assert bench.bus.facts["handle"].changes == ()
    assert "6072h:00" not in dict(bench.written())


def test_a_limit_that_cannot_be_lowered_is_a_warning_and_one_that_cannot_be_raised_an_error() -> None:
    high, low = bench_of(3000), bench_of(100, raised=True)
    high.drive.aborts[MAX_TORQUE] = low.drive.aborts[MAX_TORQUE] = READ_ONLY
    high.open()
    assert "only the loop holds that of the axis" in high.bus.warnings[0]
    assert high.bus.stop() is True
    with pytest.raises(BusConfigurationError, match="6072h"):
        low.open()
    assert low.drive.value(*MAX_TORQUE) == 100


def test_a_limit_that_the_drive_sets_to_another_value_is_put_back_all_the_same() -> None:
    """It rounds what it is given, or has a floor."""
    bench = bench_of(3000)
    store = bench.drive._store

    def floored(key: tuple[int, int], data: bytes) -> None:
        store(key, (600).to_bytes(2, "little") if key == MAX_TORQUE and data != (3000).to_bytes(2, "little") else data)

    bench.drive._store = floored  # type: ignore[method-assign]
    bench.open()
    assert "only the loop holds that of the axis" in bench.bus.warnings[0]
    assert bench.drive.value(*MAX_TORQUE) == 600
    assert bench.bus.stop() is True
    assert bench.drive.value(*MAX_TORQUE) == 3000


def test_a_limit_that_the_drive_does_not_keep_is_found_by_reading_back() -> None:
    bench = bench_of(100, raised=True)
    bench.drive.forgets.add(MAX_TORQUE)
    with pytest.raises(BusConfigurationError, match="did not keep 6072h"):
        bench.open()


def test_a_limit_that_is_not_put_back_is_told_and_stays_noted(tmp_path: Path) -> None:
    bench = bench_of(3000, real=True).open()
    bench.drive.aborts[MAX_TORQUE] = READ_ONLY
    bench.bus.stop()
    assert "was left with 6072h:00 max torque (it refused: 06010002h)" in bench.bus.warnings[0]
    assert len(notes(tmp_path)) == 1


def test_an_end_before_the_loop_puts_it_back_too() -> None:
    bench = bench_of(3000)
    bench.drive.aborts[0x6060, 0] = READ_ONLY
    with pytest.raises(BusConfigurationError, match="6060h"):
        bench.open()
    assert (bench.drive.value(*MAX_TORQUE), bench.drive.value(0x1016, 1)) == (3000, 0)


class TestKilled:
    """A run that ended without any end of its own: here a master that is left alone after it was opened."""

    def test_the_next_run_tells_what_it_left_and_puts_it_back(self, tmp_path: Path) -> None:
        bench_of(3000, real=True).open()
        assert len(notes(tmp_path)) == 1
        after = bench_of(HALF, real=True).open()
        (told,) = after.bus.facts["handle"].changes
        assert told.endswith(
            "from 300 % to 50 % of rated torque until the end; a run that did not end in order left it at 50 %"
        )
        assert after.bus.stop() is True
        assert (after.drive.value(*MAX_TORQUE), notes(tmp_path)) == (3000, [])

    def test_a_raised_limit_that_was_left_is_still_raised_only_where_the_rig_says_so(self) -> None:
        bench_of(100, raised=True, real=True).open()
        with pytest.raises(BusConfigurationError, match="6072h:00 max torque is 100 ‰"):
            bench_of(HALF, real=True).open()

    def test_a_raised_limit_that_was_left_is_told_where_it_is_refused(self) -> None:
        bench_of(100, raised=True, real=True).open()
        with pytest.raises(BusConfigurationError, match=r"is 100 ‰.*a run that did not end in order left it at 500 ‰"):
            bench_of(HALF, real=True).open()

    def test_a_second_run_that_is_killed_before_it_writes_forgets_nothing(self, tmp_path: Path) -> None:
        """It wants another limit, has noted it, and the drive still holds what the first run left."""
        bench_of(3000, real=True).open()
        second = bench_of(HALF, real=True, wanted=0.4)
        second.drive.forgets.add(MAX_TORQUE)
        second.open()
        after = bench_of(HALF, real=True).open()
        after.bus.stop()
        assert (after.drive.value(*MAX_TORQUE), notes(tmp_path)) == (3000, [])

    def test_what_is_noted_of_a_value_that_is_there_no_more_is_dropped(self, tmp_path: Path) -> None:
        """Somebody sets the drive to what an earlier run had, after a run that found it at another value."""
        bench_of(3000, real=True).open()
        bench_of(3000, real=True, wanted=3.0).open().bus.stop()
        assert notes(tmp_path) == []

    def test_a_drive_that_was_switched_off_since_has_its_own_limit_again(self) -> None:
        bench_of(3000, real=True).open()
        after = bench_of(2000, real=True).open()
        assert "left" not in after.bus.facts["handle"].changes[0]
        after.bus.stop()
        assert after.drive.value(*MAX_TORQUE) == 2000

    def test_another_drive_of_the_same_model_is_not_taken_for_it(self) -> None:
        bench_of(3000, real=True).open()
        other = bench_of(HALF, real=True)
        other.drive.objects[0x1018, 4] = (0x4321).to_bytes(4, "little")
        assert other.open().bus.facts["handle"].changes == ()

    def test_of_a_drive_without_a_serial_number_nothing_is_noted_and_that_is_told(self, tmp_path: Path) -> None:
        """The next one with this node-ID may be another drive, whose limit would be raised by the note."""
        bench = bench_of(3000, real=True)
        del bench.drive.objects[0x1018, 4]
        bench.open()
        assert notes(tmp_path) == []
        assert "has no serial number: a run that is killed leaves its torque limit in it" in bench.bus.warnings[0]

    @pytest.mark.parametrize("content", ["", "{", "[]", "3", '{"6072h:00 max torque": 5}', '{"a": ["x", 1]}', "\udc80"])
    def test_notes_that_are_not_ours_are_passed_over(self, content: str, tmp_path: Path) -> None:
        bench_of(3000, real=True).open()
        notes(tmp_path)[0].write_text(content, errors="surrogateescape")
        assert bench_of(HALF, real=True).open().bus.facts["handle"].changes == ()

    def test_a_folder_that_cannot_be_made_is_a_warning(self, tmp_path: Path) -> None:
        (tmp_path / "state").write_text("a file")
        bench = bench_of(3000, real=True).open()
        assert "a run that is killed leaves its torque limit" in bench.bus.warnings[0]
        assert bench.bus.stop() is True

    def test_a_simulated_drive_leaves_no_notes(self, tmp_path: Path) -> None:
        bench_of(3000).open()
        assert notes(tmp_path) == []
