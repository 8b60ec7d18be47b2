"""Torque limits in the drive: those of the axis while a run lasts, the drive's own before and after it."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.buses.torque_limits import RestoreFile
from haptic_fieldbus.drive.cia402 import IdentitySection
from haptic_fieldbus.drive.rig import MILLIAMPERE, PERMILLE_OF_CURRENT
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from tests.builders import PROFILE, WALL, plan_of, rig_of
from tests.buses.canopen.benches import Bench
from tests.buses.canopen.limited import HALF, MAX_TORQUE, RUNS, SERIAL, Shelf, bench_of, half_plan

NAME = "6072h:00 max torque"
READ_ONLY = 0x0601_0002


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def notes(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "state").rglob("*.json"))


def test_a_drive_that_is_found_enabled_is_told_and_switched_off() -> None:
    bench = bench_of(HALF)
    bench.drive.objects[0x6041, 0] = (0x0637).to_bytes(2, "little")
    told = bench.open().bus.facts["handle"].changes
    assert told == (
        "It was found in operation enabled, and is switched off first. A master that died may have left it so, or "
        "another one commands it",
    )
    assert bench.drive.value(0x6041) & 0x6F != 0x27


def test_nothing_is_stored_in_the_drive() -> None:
    """1010h writes the parameters of a drive to its flash (CiA 301, 7.5.2.13)."""
    bench = bench_of(3000).open()
    assert bench.bus.stop() is True
    assert ("6072h:00", HALF) in bench.written()
    assert not [name for name, _ in bench.written() if name.startswith(("1010h", "1011h"))]


@pytest.mark.parametrize("index", [0x6072, 0x60E0, 0x60E1])
def test_a_higher_limit_is_lowered_for_the_time_of_the_run(index: int) -> None:
    bench = bench_of(3000, entry=(index, 0)).open()
    assert bench.drive.value(index) == HALF
    (told,) = bench.bus.facts["handle"].changes
    assert f"{index:04X}h" in told
    assert "is lowered from 300 % to 50 % of rated torque until the end" in told
    assert bench.bus.stop() is True
    assert (bench.drive.value(index), bench.bus.warnings) == (3000, [])


@pytest.mark.parametrize(("other", "lowered"), [(3000, 0x10000 - HALF), (0x10000 - 3000, HALF)])
def test_a_limit_downwards_that_the_drive_counts_below_zero_keeps_its_sign(other: int, lowered: int) -> None:
    """60E1h as INTEGER16 of −3000 (so Ingenia Everest XCR): +500 ‰ there would be a lowest torque, and push.

    In a drive with the same number in 60E0h it is one without a sign (so Elmo Gold: 50000).
    """
    bench = bench_of(0x10000 - 3000, entry=(0x60E1, 0))
    bench.drive.objects[0x60E0, 0] = other.to_bytes(2, "little")
    bench.open()
    assert (bench.drive.value(0x60E0), bench.drive.value(0x60E1)) == (HALF, lowered)
    assert bench.bus.stop() is True
    assert (bench.drive.value(0x60E0), bench.drive.value(0x60E1)) == (other, 0x10000 - 3000)
    assert bench.bus.warnings == []


def test_a_limit_below_zero_is_raised_only_where_the_rig_says_so() -> None:
    with pytest.raises(BusConfigurationError, match=r"60E1h.*is -100 ‰.*may use -500 ‰"):
        bench_of(0x10000 - 100, entry=(0x60E1, 0)).open()
    bench = bench_of(0x10000 - 100, entry=(0x60E1, 0), raised=True).open()
    assert bench.drive.value(0x60E1) == 0x10000 - HALF


@pytest.mark.parametrize("code", [0x0601_0000, 0x0800_0000, 0x0604_0043])
def test_a_limit_that_the_drive_refuses_to_show_is_told_and_left_alone(code: int) -> None:
    """Drives name an object that they lack by many codes."""
    bench = bench_of(3000)
    bench.drive.refusals[0x60E0, 0] = code
    bench.open()
    assert bench.drive.value(*MAX_TORQUE) == HALF
    (told,) = bench.bus.warnings
    assert "reading 60E0h:00 positive torque limit value" in told
    assert told.endswith("Only the loop applies the limit of the axis there")


@pytest.mark.parametrize(("unit", "wanted"), [(PERMILLE_OF_CURRENT, 200), (MILLIAMPERE, 1000)])
def test_limits_are_shares_of_what_the_target_torque_is_a_share_of(unit: str, wanted: int) -> None:
    """Rated torque is 0.1 N·m, that at rated current 0.5 N·m: the axis has 0.1 N·m, a fifth of the latter."""
    rig = rig_of(WALL, rated_torque=0.1, rated_current=5.0, torque_constant=0.1)
    target = replace(PROFILE.torque.target, unit=unit)
    profile = replace(PROFILE, torque=replace(PROFILE.torque, target=target, actual=None, rated=None, demand=None))
    bench = Bench(plan_of(rig=rig, profile=replace(profile, torque=replace(profile.torque, echo="asked"))))
    bench.drive.objects[MAX_TORQUE] = (3000).to_bytes(2, "little")
    bench.open()
    assert bench.drive.value(*MAX_TORQUE) == wanted


def test_a_limit_that_the_object_cannot_hold_is_refused_before_anything_is_written() -> None:
    plan = half_plan(raised=True)
    (axis,) = plan.axes
    limits = replace(axis.limits, effort=70.0 * axis.rated_effort)
    bench = Bench(replace(plan, axes=(replace(axis, limits=limits),)))
    bench.drive.objects[MAX_TORQUE] = (3000).to_bytes(2, "little")
    with pytest.raises(BusConfigurationError, match=r"6072h.* cannot exceed 65535, but the limit .* is 70000 steps"):
        bench.open()
    assert bench.written() == []


@pytest.mark.parametrize("held", [0, 100, HALF - 1])
def test_a_lower_limit_is_raised_only_where_the_rig_says_so(held: int) -> None:
    refused = bench_of(held)
    with pytest.raises(BusConfigurationError, match=rf"6072h.*is {held} ‰.*may use 500 ‰ \(25\.1 N\).*raise_max_t"):
        refused.open()
    assert refused.written() == []
    bench = bench_of(held, raised=True).open()
    assert bench.drive.value(*MAX_TORQUE) == HALF
    assert "is raised, as the rig permits, from " in bench.bus.facts["handle"].changes[0]
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
    assert "only the loop applies the limit of the axis" in high.bus.warnings[0]
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
    assert "only the loop applies the limit of the axis" in bench.bus.warnings[0]
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
    assert "keeps 6072h:00 max torque (it refused: 06010002h)" in bench.bus.warnings[0]
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
            "from 300 % to 50 % of rated torque until the end; a run that did not end properly left it at 50 %"
        )
        assert after.bus.stop() is True
        assert (after.drive.value(*MAX_TORQUE), notes(tmp_path)) == (3000, [])

    def test_a_raised_limit_that_was_left_is_still_raised_only_where_the_rig_says_so(self) -> None:
        bench_of(100, raised=True, real=True).open()
        with pytest.raises(BusConfigurationError, match="6072h:00 max torque is 100 ‰"):
            bench_of(HALF, real=True).open()

    def test_a_raised_limit_that_was_left_is_told_where_it_is_refused(self) -> None:
        bench_of(100, raised=True, real=True).open()
        with pytest.raises(BusConfigurationError, match=r"is 100 ‰.*a run that did not end properly left it at 500 ‰"):
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
        assert "has no serial number: if a run is killed, its torque limit stays in the drive" in bench.bus.warnings[0]

    def test_another_drive_without_a_serial_number_keeps_the_limit_that_a_person_has_set(self, tmp_path: Path) -> None:
        """A run on A is killed; B tells the same 0, and a person has set it to what the run on A had."""
        for serial in (0, 0xFFFF_FFFF):
            first = bench_of(3000, real=True)
            second = bench_of(HALF, real=True)
            for bench in (first, second):
                bench.drive.objects[SERIAL] = serial.to_bytes(4, "little")
                bench.open()
            assert notes(tmp_path) == []
            assert second.bus.facts["handle"].changes == ()
            assert second.bus.stop() is True
            assert second.drive.value(*MAX_TORQUE) == HALF

    def test_two_runs_at_once_on_two_drives_without_serial_numbers_put_back_what_each_had(self, tmp_path: Path) -> None:
        first, second = bench_of(3000, real=True), bench_of(2000, real=True, wanted=0.4)
        for bench in (first, second):
            bench.drive.objects[SERIAL] = bytes(4)
        first.open()
        second.open()
        assert notes(tmp_path) == [], "neither finds a note of the other one"
        assert first.bus.stop() is True
        assert second.bus.stop() is True
        assert (first.drive.value(*MAX_TORQUE), second.drive.value(*MAX_TORQUE)) == (3000, 2000)
        assert notes(tmp_path) == []

    def test_of_an_unknown_model_a_note_holds_at_one_bus_and_node_alone(self) -> None:
        """Vendor 0 is unknown, and another maker may give the same serial number."""

        def of_no_vendor(held: int, channel: str) -> Bench:
            rig = half_plan(real=True).rig
            rig = replace(rig, bus={"bus": CanSection("socketcan", channel)})
            bench = Bench(plan_of(rig=rig, profile=replace(PROFILE, identity=IdentitySection())))
            bench.drive.objects |= {MAX_TORQUE: held.to_bytes(2, "little"), (0x1018, 1): bytes(4)}
            return bench.open()

        of_no_vendor(3000, "can0")
        assert of_no_vendor(HALF, "can1").bus.facts["handle"].changes == ()
        assert "left it at 50 %" in of_no_vendor(HALF, "can0").bus.facts["handle"].changes[0]

    @pytest.mark.parametrize(
        "content", ["", "{", "[]", "3", '{"6072h:00 max torque": [[500], 3000]}', "\udc80", "[" * 9999]
    )
    def test_a_note_that_is_damaged_or_of_an_earlier_version_is_told_and_nothing_is_restored(
        self, content: str, tmp_path: Path
    ) -> None:
        bench_of(3000, real=True).open()
        (path,) = notes(tmp_path)
        path.write_text(content, errors="surrogateescape")
        after = bench_of(HALF, real=True).open()
        assert after.bus.facts["handle"].changes == ()
        (told,) = after.bus.warnings
        assert told.startswith(f"{path} is not used (it is damaged, was edited, or is from an earlier version)")
        assert after.bus.stop() is True
        assert (after.drive.value(*MAX_TORQUE), notes(tmp_path)) == (HALF, []), "told once"

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("3000", "65535"),
            ("3000", "-3000"),
            ("3000", "1e9"),
            ("3000", "true"),
            ("[500, 500]", "[0, 500]"),
            ("6072h", "60E0h"),
        ],
    )
    def test_a_note_that_was_changed_by_hand_is_told_and_nothing_is_restored(
        self, old: str, new: str, tmp_path: Path
    ) -> None:
        bench_of(3000, real=True).open()
        (path,) = notes(tmp_path)
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
        after = bench_of(HALF, real=True).open()
        assert "was edited" in after.bus.warnings[0]
        assert after.bus.stop() is True
        assert after.drive.value(*MAX_TORQUE) == HALF

    @pytest.mark.parametrize(
        "changes", [{NAME: [[HALF], 70_000]}, {NAME: [[HALF], -1]}, {NAME: [[HALF], "x"]}, {NAME: 5}]
    )
    def test_a_note_with_values_that_the_object_cannot_hold_is_told_whoever_wrote_it(
        self, changes: dict[str, Any], tmp_path: Path
    ) -> None:
        bench_of(3000, real=True).open()
        (path,) = notes(tmp_path)
        RestoreFile(path.stem).write(changes)
        after = bench_of(HALF, real=True).open()
        assert " is not used (" in after.bus.warnings[0]
        assert after.bus.facts["handle"].changes == ()

    def test_the_note_of_one_drive_is_none_of_another(self, tmp_path: Path) -> None:
        bench_of(3000, real=True).open()
        (path,) = notes(tmp_path)
        path.rename(path.with_name(path.name.replace("1234", "4321")))
        other = bench_of(HALF, real=True)
        other.drive.objects[SERIAL] = (0x4321).to_bytes(4, "little")
        assert other.open().bus.facts["handle"].changes == ()
        assert " is not used (" in other.bus.warnings[0]

    def test_a_note_that_cannot_be_removed_is_told(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        bench = bench_of(3000, real=True).open()

        def refused(*_: object, **__: object) -> None:
            raise PermissionError(errno.EACCES, "Permission denied")

        monkeypatch.setattr(Path, "unlink", refused)
        assert bench.bus.stop() is True
        assert bench.drive.value(*MAX_TORQUE) == 3000
        assert "cannot be removed (Permission denied)" in bench.bus.warnings[0]

    def test_a_full_disk_is_told_before_the_limit_is_changed_and_leaves_the_note_of_before(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench_of(3000, real=True).open()
        (path,) = notes(tmp_path)
        before = path.read_bytes()

        def full(_descriptor: int) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(os, "fsync", full)
        bench = bench_of(HALF, real=True, wanted=0.4).open()
        assert "cannot be written (No space left on device): if a run is killed" in bench.bus.warnings[0]
        assert (path.read_bytes(), notes(tmp_path), os.listdir(path.parent)) == (before, [path], [path.name])

    @pytest.mark.parametrize("call", ["replace", "fsync"])
    def test_a_run_that_is_killed_while_it_notes_has_changed_nothing_in_the_drive(
        self, call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """An exception stands for the kill; that a killed process leaves a whole file is tested where it is written."""

        class Killed(BaseException):
            pass

        def kill(*_: object) -> None:
            raise Killed

        bench_of(3000, real=True).open()
        (path,) = notes(tmp_path)
        before, second = path.read_bytes(), bench_of(HALF, real=True, wanted=0.4)
        second.bus.inspect(second.plan, bytearray(second.plan.image.input_size))
        monkeypatch.setattr(os, call, kill)
        with pytest.raises(Killed):
            second.bus.configure(second.plan)
        assert second.drive.value(*MAX_TORQUE) == HALF
        assert path.read_bytes() == before

    def test_a_note_has_reached_the_disk_as_a_whole_before_the_limit_is_changed(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """So that a power cut leaves the old note or the new one, and never a change without a note."""
        events: list[str] = []
        bench, fsync, rename = bench_of(3000, real=True), os.fsync, os.replace
        store = bench.drive._store

        def synced(descriptor: int) -> None:
            fsync(descriptor)
            events.append("synced" if Path(f"/proc/self/fd/{descriptor}").is_file() else "folder synced")

        def replaced(name: str, target: Path) -> None:
            events.append("renamed")
            rename(name, target)

        def stored(key: tuple[int, int], data: bytes) -> None:
            if key == MAX_TORQUE:
                events.append("changed")
            store(key, data)

        monkeypatch.setattr(os, "fsync", synced)
        monkeypatch.setattr(os, "replace", replaced)
        bench.drive._store = stored  # type: ignore[method-assign]
        bench.open()
        assert events == ["synced", "renamed", "folder synced", "changed"]

    def test_a_folder_that_cannot_be_made_is_a_warning(self, tmp_path: Path) -> None:
        (tmp_path / "state").write_text("a file")
        bench = bench_of(3000, real=True).open()
        assert "if a run is killed, its torque limit stays in the drive" in bench.bus.warnings[0]
        assert bench.bus.stop() is True

    def test_a_simulated_drive_leaves_no_notes(self, tmp_path: Path) -> None:
        bench_of(3000).open()
        assert notes(tmp_path) == []


@pytest.mark.thorough("forty shelves", quick=2)
@pytest.mark.parametrize("seed", range(40))
def test_whatever_runs_were_killed_a_drive_never_gets_the_limit_of_another_one(seed: int) -> None:
    shelf = Shelf(seed)
    assert [sentence for _ in range(RUNS) for sentence in shelf.wrong_with_a_run()] == []
