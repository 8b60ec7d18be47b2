"""Writes that a profile requires beyond mode and PDOs: in order, read back, refused where it cannot be."""

from dataclasses import replace
from typing import Any

import pytest

from haptic_fieldbus.drive.cia402 import MappedObject, PositionSection, WrittenObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.profile import (
    CanopenProfile,
    CommissioningSection,
    SetupSection,
    ShownObject,
    SyncSection,
)
from tests.builders import PROFILE, WALL, plan_of, rig_of
from tests.buses.canopen.benches import Bench

READ_ONLY = 0x0601_0002
SLOPE = WrittenObject(0x6087, DataType.UINT32, 1_000_000)
FIRST = WrittenObject(0x201D, DataType.UINT16, 1)
SECOND = WrittenObject(0x2070, DataType.UINT8, 7, subindex=2)


def bench_of(objects: dict[tuple[int, int], int], *, sizes: dict[tuple[int, int], int], **sections: Any) -> Bench:
    """A bench whose profile has these sections, and whose drive holds these values in objects of so many octets."""
    bench = Bench(plan_of(profile=replace(PROFILE, **sections)))
    for key, value in objects.items():
        bench.drive.objects[key] = value.to_bytes(sizes.get(key, 2), "little")
    return bench


def order(bench: Bench, *names: str) -> list[str]:
    return [name for name, _ in bench.written() if name in names]


def torque(**changes: Any) -> dict[str, Any]:
    return {"torque": replace(PROFILE.torque, **changes)}


def test_objects_of_the_setup_are_written_in_their_order_before_the_mode() -> None:
    sizes = {(0x2070, 2): 1}
    bench = bench_of({(0x201D, 0): 0, (0x2070, 2): 0}, sizes=sizes, setup=SetupSection((SECOND, FIRST))).open()
    assert order(bench, "201Dh:00", "2070h:02", "6060h:00") == ["2070h:02", "201Dh:00", "6060h:00"]
    assert (bench.drive.value(0x201D), bench.drive.value(0x2070, 2)) == (1, 7)


def test_a_constant_that_is_right_is_not_written() -> None:
    bench = bench_of({(0x201D, 0): 1}, sizes={}, setup=SetupSection((FIRST,)))
    bench.drive.aborts[0x201D, 0] = READ_ONLY
    bench.open()
    assert order(bench, "201Dh:00") == []


def test_a_constant_that_is_wrong_is_refused_before_torque() -> None:
    bench = bench_of({(0x201D, 0): 0}, sizes={}, setup=SetupSection((FIRST,)))
    bench.drive.aborts[0x201D, 0] = READ_ONLY
    with pytest.raises(BusConfigurationError, match=r"writing 1 .*201Dh:00.*06010002h"):
        bench.open()
    assert bench.drive.value(0x6041) == 0x40


@pytest.mark.parametrize(
    ("objects", "sections", "key"),
    [
        ({(0x201D, 0): 0}, {"setup": SetupSection((FIRST,))}, (0x201D, 0)),
        ({(0x6087, 0): 100}, torque(slope=SLOPE), (0x6087, 0)),
        ({(0x60C2, 1): 0, (0x60C2, 2): 0xFD}, {"sync": SyncSection(interpolation_time=0x60C2)}, (0x60C2, 1)),
        ({(0x1006, 0): 0}, {"sync": SyncSection(cycle_period=0x1006)}, (0x1006, 0)),
    ],
    ids=["setup", "slope", "60C2h", "1006h"],
)
def test_a_value_that_the_drive_takes_and_forgets_is_refused(
    objects: dict[tuple[int, int], int], sections: dict[str, Any], key: tuple[int, int]
) -> None:
    sizes = {(0x6087, 0): 4, (0x1006, 0): 4, (0x60C2, 1): 1, (0x60C2, 2): 1}
    bench = bench_of(objects, sizes=sizes, **sections)
    bench.drive.forgets.add(key)
    with pytest.raises(BusConfigurationError, match=rf"did not keep {key[0]:04X}h:{key[1]:02X}"):
        bench.open()


def test_the_period_is_told_with_its_power_of_ten_first() -> None:
    sizes = {(0x60C2, 1): 1, (0x60C2, 2): 1, (0x1006, 0): 4}
    sync = SyncSection(interpolation_time=0x60C2, powers=(-4,), cycle_period=0x1006)
    bench = bench_of({(0x60C2, 1): 1, (0x60C2, 2): 0xFD, (0x1006, 0): 0}, sizes=sizes, sync=sync).open()
    assert order(bench, "60C2h:01", "60C2h:02", "1006h:00") == ["60C2h:02", "60C2h:01", "1006h:00"]
    assert bench.drive.value(0x60C2, 1) * 10.0 ** (bench.drive.value(0x60C2, 2) - 256) == pytest.approx(1e-3)
    assert bench.drive.value(0x1006) == 1000


def test_the_slope_is_written_and_counts_as_lag() -> None:
    bench = bench_of({(0x6087, 0): 100}, sizes={(0x6087, 0): 4}, **torque(slope=SLOPE)).open()
    assert bench.drive.value(0x6087) == 1_000_000
    slow = replace(SLOPE, value=100)
    plans = {slope: plan_of(profile=replace(PROFILE, **torque(slope=slope))) for slope in (None, SLOPE, slow)}
    lags = {slope: plan.delay.torque_loop for slope, plan in plans.items()}
    assert lags[SLOPE] - lags[None] == pytest.approx(1e-3)
    assert lags[slow] - lags[None] == pytest.approx(10.0), "100 ‰/s: ten seconds to rated torque"
    limits = [plan.stability.stiffness_limit.stable for plan in plans.values() if plan.stability is not None]
    assert limits[0] is not None
    assert limits[1] is not None
    assert limits[0] > limits[1]


def test_an_inhibit_time_is_cleared_also_where_the_standard_needs_it_not() -> None:
    """A synchronous TPDO knows none (CiA 301), but not every drive is known to keep to it."""
    bench = bench_of({}, sizes={}, pdo=replace(PROFILE.pdo, inhibit_time_default=0.001)).open()
    assert bench.drive.value(0x1800, 3) == 0
    names = [name for name, _ in bench.written() if name.startswith("1800h")]
    assert names == ["1800h:01", "1800h:02", "1800h:03", "1800h:01"], "while the PDO is switched off"


class TestCommissioning:
    SHOWN = (
        ShownObject("rated current", 0x3001, DataType.UINT32, 1, "mA", needed=True),
        ShownObject("thermal time constant", 0x3001, DataType.UINT16, 4),
        ShownObject("not of this model", 0x3999, DataType.UINT16),
    )

    def bench(self, current: int) -> Bench:
        sizes = {(0x3001, 1): 4, (0x3001, 4): 2}
        section = CommissioningSection("the tool", self.SHOWN)
        return bench_of({(0x3001, 1): current, (0x3001, 4): 40}, sizes=sizes, commissioning=section)

    def test_what_the_tool_has_set_is_shown_and_not_written(self) -> None:
        bench = self.bench(5000).open()
        assert "Set by the tool: rated current 5000 mA, thermal time constant 40" in bench.bus.facts["handle"].changes
        assert order(bench, "3001h:01", "3001h:04") == []

    def test_a_drive_that_was_never_commissioned_is_refused_untouched_and_the_person_sent_to_the_tool(self) -> None:
        bench = self.bench(0)
        words = r"rated current \(3001h:01\) is not set.*Commission it with the tool first"
        with pytest.raises(BusConfigurationError, match=words):
            bench.open()
        assert bench.written() == []

    @pytest.mark.parametrize(
        ("speed", "unit", "told"), [(1000, "r/min", True), (2500, "r/min", False), (1000, "mrev/s", False)]
    )
    def test_a_drive_that_is_slower_than_the_rig_allows_is_told(self, speed: int, unit: str, told: bool) -> None:
        """2 m/s of a bench with 50 mm a turn are 2400 r/min."""
        shown = ShownObject("max motor speed", 0x6080, DataType.UINT32, unit=unit)
        section = CommissioningSection("the tool", (shown,))
        bench = bench_of({(0x6080, 0): speed}, sizes={(0x6080, 0): 4}, commissioning=section).open()
        words = "max motor speed of 1000 r/min (6080h) is 0.833 m/s at the handle, below the trip limit of 2 m/s"
        assert any(words in each for each in bench.bus.facts["handle"].changes) is told

    def test_another_rated_current_than_the_rigs_is_refused(self) -> None:
        profile = replace(PROFILE, **torque(rated=None, rated_current=MappedObject(0x6075, DataType.UINT32, unit="mA")))
        bench = Bench(plan_of(profile=profile))
        bench.drive.objects[0x6075, 0] = (6000).to_bytes(4, "little")
        with pytest.raises(BusConfigurationError, match=r"its rated current is 6 A .*the rig has 8 A"):
            bench.open()
        assert bench.written() == []

    @pytest.mark.parametrize(
        ("told", "words"),
        [
            ((4096, 1), None),
            ((8192, 2), None),
            ((0, 1), None),
            ((16384, 0), None),
            ((12289, 3), None),  # a third of a count is the rounding of the rig
            ((16384, 1), "16384 counts per revolution (608Fh), the rig 4096"),
            (
                (16384, 1),
                "wrong by a factor of 4, unless the drive scales its position. Are the counts in the rig lines?",
            ),
            ((1024, 1), "wrong by a factor of 0.25, unless the drive scales its position"),
        ],
    )
    def test_another_encoder_than_the_rigs_is_told(self, told: tuple[int, int], words: str | None) -> None:
        objects = {(0x608F, subindex): value for subindex, value in enumerate(told, 1)}
        bench = bench_of(objects, sizes=dict.fromkeys(objects, 4)).open()
        changes = " ".join(bench.bus.facts["handle"].changes)
        assert ("608Fh" in changes) is (words is not None)
        assert (words or "") in changes

    def test_a_drive_that_tells_no_encoder_or_no_counts_is_not_compared(self) -> None:
        other = {(0x608F, 1): 2000, (0x608F, 2): 1}
        tenths = PositionSection(MappedObject(0x6064, DataType.INT32, unit="0.1 deg"))
        for bench in (bench_of({}, sizes={}), bench_of(other, sizes=dict.fromkeys(other, 4), position=tenths)):
            assert "608Fh" not in " ".join(bench.open().bus.facts["handle"].changes)

    @pytest.mark.parametrize(("held_ma", "asked"), [(8, True), (9, False)])
    def test_a_value_in_the_rig_that_is_a_thousand_times_too_large_is_asked_for_its_unit(
        self, held_ma: int, asked: bool
    ) -> None:
        profile = replace(PROFILE, **torque(rated=None, rated_current=MappedObject(0x6075, DataType.UINT32, unit="mA")))
        bench = Bench(plan_of(profile=profile))
        bench.drive.objects[0x6075, 0] = held_ma.to_bytes(4, "little")
        with pytest.raises(BusConfigurationError) as raised:
            bench.open()
        assert str(raised.value).endswith("Is the value in the rig in mA?") is asked

    def test_a_commutation_search_is_told_before_the_question_and_has_its_time(self) -> None:
        drive = replace(PROFILE.drive, commutation_search=True)
        timing = replace(PROFILE.timing, enabling_timeout=10.0)
        bench = Bench(plan_of(profile=replace(PROFILE, drive=drive, timing=timing))).open()
        told = bench.bus.facts["handle"].changes[-1]
        assert told.startswith("the first enabling after power-on may turn the shaft")
        assert told.endswith("for up to 11 s")


def test_the_bits_of_a_mode_come_with_enable_operation_alone() -> None:
    profile: CanopenProfile = replace(PROFILE, **torque(controlword=0x10))
    rows = {row.state.value: row.controlword for row in plan_of(rig=rig_of(WALL), profile=profile).axes[0].power.rows}
    assert rows.pop("operation enabled") == 0x1F
    assert all(word & 0x10 == 0 for word in rows.values())
