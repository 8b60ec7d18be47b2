"""Quirks of real drives, key by key of [simulation]: each shows, and our master copes or refuses with a sentence."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import pytest

import haptic_fieldbus
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, SimulationSection
from haptic_fieldbus.protocols.catalogue import profile_folder
from haptic_fieldbus.sim.drive.dictionary import AbortCode
from tests.sim.bench import MS, NODE, DriveBench, Refusal, profile

INVALID = 1 << 31
NO_RTR = 1 << 30
NO_OBJECT = Refusal(AbortCode.NO_OBJECT.value)
README = (profile_folder() / "README.md").read_text(encoding="utf-8")
Run = Callable[..., Result]
RIG = """\
[bus.sim]
interface = "haptic_sim"
channel = "sim"
[axis.handle]
bus = "sim"
node = 1
profile = "quirky.toml"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
limits = { speed = 10.0 }
mechanism = { kind = "linear", metres_per_revolution = 0.05 }
"""
"""A bench like the shipped one, which does not let a run raise the drive's own limits."""


def quirky(**keys: object) -> CanopenProfile:
    return replace(profile("generic_cia402"), simulation=SimulationSection(**keys))  # type: ignore[arg-type]


def bench_of(**keys: object) -> DriveBench:
    return DriveBench(quirky(**keys))


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A short wall with the generic profile and these lines in its [simulation]."""

    def with_lines(lines: str, *, raised: bool = True) -> Result:
        text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
        path = tmp_path / "quirky.toml"
        path.write_text(f"{text}simulation = 'a test'\n\n[simulation]\n{lines}\n", encoding="utf-8")
        if raised:
            return haptic_fieldbus.run("wall", drive=str(path), duration=1.5, seed=1)
        rig = tmp_path / "rig.toml"
        rig.write_text(RIG, encoding="utf-8")
        return haptic_fieldbus.run("wall", rig=str(rig), duration=1.5, seed=1)

    return with_lines


def test_every_key_of_the_section_stands_in_the_readme_with_its_effect_and_a_drive_that_has_it() -> None:
    rows = [line.strip("| ").split(" | ") for line in README.splitlines() if line.startswith("| `simulation.")]
    assert [row[0] for row in rows] == [f"`simulation.{field.name}`" for field in fields(SimulationSection)]
    assert all(effect and seen for *_, effect, seen in rows)


def feels_right(result: Result) -> bool:
    """Nothing missed, nothing tripped, and the wall was there."""
    assert result.verdict is not None
    return result.missed_cycles == 0 and not result.trips and result.verdict.startswith("Feels right: ")


@pytest.mark.thorough("renders a wall twice")
def test_an_empty_section_changes_nothing(run: Run) -> None:
    assert feels_right(run(""))


class TestPdosDisabled:
    def test_no_pdo_is_valid_after_power_on(self) -> None:
        bench = bench_of(pdos_disabled=True)
        for communication in (*range(0x1400, 0x1404), *range(0x1800, 0x1804)):
            value = bench.read(communication, 1)
            assert isinstance(value, int)
            assert value & INVALID
            assert value & 0x7FF
        bench.nmt(1)
        bench.run(10 * MS)
        assert bench.take(0x180 + NODE) == []

    def test_the_master_copes(self, run: Run) -> None:
        assert feels_right(run("pdos_disabled = true"))


class TestCobIdsMissing:
    def test_the_cob_ids_hold_no_identifier(self) -> None:
        bench = bench_of(cob_ids_missing=True)
        assert {bench.read(base + number, 1) for base in (0x1400, 0x1800) for number in range(4)} == {INVALID}

    @pytest.mark.thorough("renders a wall")
    def test_the_master_copes(self, run: Run) -> None:
        assert feels_right(run("cob_ids_missing = true"))


class TestAbsent:
    def test_an_absent_object_is_not_there(self) -> None:
        bench = bench_of(absent=(0x1016, 0x6007, 0x605E, 0x6072, 0x6076, 0x6077, 0x6502))
        assert bench.read(0x1016, 1) == NO_OBJECT
        for index in (0x6007, 0x605E, 0x6072, 0x6076, 0x6077, 0x6502):
            assert bench.read(index) == NO_OBJECT
        bench.enable()

    def test_without_1016h_a_silent_master_is_not_noticed(self) -> None:
        bench = bench_of(absent=(0x1016,))
        bench.enable()
        bench.run(1000 * MS)
        assert bench.status() & 0x6F == 0x27

    @pytest.mark.parametrize(
        ("index", "name"),
        [(0x1016, "1016h:01 consumer heartbeat time"), (0x6007, "6007h:00 abort connection option code")],
    )
    def test_the_master_refuses_a_drive_without_its_guard(self, run: Run, index: int, name: str) -> None:
        with pytest.raises(BusConfigurationError, match=rf"{name}.*does not exist"):
            run(f"absent = [{index}]")

    def test_the_master_refuses_a_drive_without_the_rated_torque_of_its_profile(self, run: Run) -> None:
        with pytest.raises(BusConfigurationError, match=r"reading 6076h:00 motor rated torque.*does not exist"):
            run("absent = [0x6076]")

    @pytest.mark.thorough("a run of the master")
    def test_the_master_does_not_need_6502h(self, run: Run) -> None:
        assert feels_right(run("absent = [0x6502]"))


class TestSyncNotHonoured:
    @pytest.mark.parametrize(("honoured", "demand"), [(True, 0), (False, 300)])
    def test_a_synchronous_rpdo_acts_at_once(self, honoured: bool, demand: int) -> None:
        bench = bench_of(sync_honoured=honoured)
        bench.operational(rpdo_type=1)
        for controlword in (0x06, 0x07, 0x0F):
            bench.control(controlword)
            bench.sync()
        assert bench.read(0x1400, 2) == 1
        bench.control(0x0F, 300)
        assert bench.read(0x6074) == demand
        bench.sync()
        assert bench.read(0x6074) == 300

    @pytest.mark.thorough("a run of the master")
    def test_the_master_copes(self, run: Run) -> None:
        assert feels_right(run("sync_honoured = false"))


class TestMaxTorque:
    @pytest.mark.parametrize("permille", [0, 100])
    def test_torque_is_limited_until_it_is_raised(self, permille: int) -> None:
        bench = bench_of(max_torque=permille)
        bench.enable()
        bench.control(0x0F, 500)
        assert bench.read(0x6074) == permille
        assert bench.write(0x6072, 0, 3000, "H") is None
        bench.control(0x0F, 501)
        assert bench.read(0x6074) == 501

    @pytest.mark.parametrize("permille", [0, 100])
    def test_the_master_refuses_with_the_forces_in_question(self, run: Run, permille: int) -> None:
        words = rf"6072h:00 max torque is {permille} ‰ of rated torque .* may use 1000 ‰ \(50\.3 N\)"
        with pytest.raises(BusConfigurationError, match=words):
            run(f"max_torque = {permille}", raised=False)

    @pytest.mark.thorough("a run of the master")
    def test_the_master_copes_with_a_limit_far_above(self, run: Run) -> None:
        assert feels_right(run("max_torque = 50000"))


class TestSupportedModes:
    def test_6502h_says_something_else_than_the_modes_are(self) -> None:
        bench = bench_of(supported_modes=0x0000_0065)
        assert bench.read(0x6502) == 0x65
        assert bench.write(0x6060, 0, 10, "b") is None

    @pytest.mark.thorough("a run of the master")
    def test_the_master_goes_by_6061h(self, run: Run) -> None:
        assert feels_right(run("supported_modes = 0x65"))


class TestModeChangeTime:
    def test_the_display_follows_after_the_time(self) -> None:
        bench = bench_of(mode_change_time=0.5)
        assert bench.write(0x6060, 0, 10, "b") is None
        bench.run(499 * MS)
        assert bench.read(0x6061) == 0
        bench.run(2 * MS)
        assert bench.read(0x6061) == 10

    @pytest.mark.thorough("a run of the master")
    def test_the_master_waits_as_long_as_the_profile_says(self, run: Run) -> None:
        assert feels_right(run("mode_change_time = 0.9"))

    def test_the_master_refuses_after_that(self, run: Run) -> None:
        with pytest.raises(BusConfigurationError, match=r"did not accept mode of operation 10.*is 0"):
            run("mode_change_time = 4.0")


class TestBootTime:
    def test_the_boot_up_message_comes_late_and_nothing_before(self) -> None:
        bench = DriveBench(quirky(boot_time=2.0), booted=False)
        bench.give(0x600 + NODE, bytes((0x40, 0, 0x10, 0, 0, 0, 0, 0)))
        bench.run(1999 * MS)
        assert bench.sent == []
        bench.run(2 * MS)
        assert bench.take(0x700 + NODE) == [b"\0"]
        assert bench.read(0x1000) == 0x0002_0192

    def test_a_reset_takes_as_long(self) -> None:
        bench = bench_of(boot_time=2.0)
        bench.nmt(129)
        bench.run(1990 * MS)
        assert bench.take(0x700 + NODE) == []
        bench.run(100 * MS)
        assert bench.take(0x700 + NODE) == [b"\0"]

    @pytest.mark.thorough("a run of the master")
    def test_the_master_copes_with_a_drive_that_has_booted(self, run: Run) -> None:
        assert feels_right(run("boot_time = 5.0"))


class TestInhibitTime:
    """`pdo.inhibit_time_default`: 30 ms (Technosoft iPOS) to 100 ms (Ingenia Everest XCR)."""

    @pytest.mark.parametrize("seconds", [0.03, 0.1])
    def test_an_event_driven_tpdo_waits_for_it(self, seconds: float) -> None:
        generic = profile("generic_cia402")
        bench = DriveBench(replace(generic, pdo=replace(generic.pdo, inhibit_time_default=seconds)))
        assert bench.read(0x1800, 3) == round(seconds * 1e4)
        bench.nmt(1)
        bench.run(round(seconds * 1e9) // 2)
        bench.sent.clear()
        bench.control(0x06)
        bench.run(round(seconds * 1e9) // 4)
        assert bench.take(0x180 + NODE) == []
        bench.run(round(seconds * 1e9))
        assert len(bench.take(0x180 + NODE)) == 1
