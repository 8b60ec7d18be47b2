"""A simulated drive of a profile has what the profile's [simulation.objects] says, and behaves as before."""

from dataclasses import replace

import pytest

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.profile import SimulatedObject, SimulationSection
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.model import entries_of
from haptic_fieldbus.sim.drive.dictionary import AbortCode
from tests.sim.bench import NODE, DriveBench, Refusal, profile

NO_OBJECT, NO_SUBINDEX = Refusal(AbortCode.NO_OBJECT.value), Refusal(AbortCode.NO_SUBINDEX.value)


def bench_of(objects: dict[str, SimulatedObject]) -> DriveBench:
    return DriveBench(replace(profile(), simulation=SimulationSection(objects=objects)))


@pytest.mark.parametrize(
    ("key", "entries"),
    [
        ("6007", [(0x6007, 0)]),
        ("60C2:01", [(0x60C2, 1)]),
        ("1400-1401:05", [(0x1400, 5), (0x1401, 5)]),
        ("60E3:09-0B", [(0x60E3, 9), (0x60E3, 10), (0x60E3, 11)]),
        ("1A00-1A01:01-02", [(0x1A00, 1), (0x1A00, 2), (0x1A01, 1), (0x1A01, 2)]),
    ],
)
def test_a_key_names_one_entry_or_a_range(key: str, entries: list[tuple[int, int]]) -> None:
    assert list(entries_of(key)) == entries


def test_an_implemented_object_takes_value_access_and_limits_and_keeps_what_it_does() -> None:
    bench = bench_of({"6072": SimulatedObject(value=100, high=2000), "605A": SimulatedObject(access="ro", value=6)})
    assert bench.read(0x6072) == 100
    assert bench.write(0x6072, 0, 2001, "H") == Refusal(AbortCode.VALUE_TOO_HIGH.value)
    assert bench.write(0x605A, 0, 2, "h") == Refusal(AbortCode.READ_ONLY.value)
    bench.enable()
    bench.control(0x0F, 500)
    assert bench.read(0x6074) == 100


def test_an_object_that_is_not_implemented_stores_its_value() -> None:
    bench = bench_of({"3001:01": SimulatedObject(type=DataType.UINT32, access="rww", value=5000, high=6000)})
    assert bench.read(0x3001, 1) == 5000
    assert bench.write(0x3001, 1, 5500, "I") is None
    assert bench.read(0x3001, 1) == 5500
    assert bench.write(0x3001, 1, 6001, "I") == Refusal(AbortCode.VALUE_TOO_HIGH.value)


def test_what_is_absent_is_absent_object_or_entry() -> None:
    bench = bench_of({"1400-1403:05": SimulatedObject(absent=True)})
    assert bench.read(0x1400, 5) == NO_SUBINDEX
    assert bench.read(0x1403, 5) == NO_SUBINDEX
    whole = DriveBench(replace(profile(), simulation=SimulationSection(absent=(0x6072,))))
    assert whole.read(0x6072) == NO_OBJECT


def test_a_value_with_the_node_id_has_that_of_the_drive() -> None:
    bench = bench_of({"1401:01": SimulatedObject(value="$NODEID+0x80000300")})
    assert bench.read(0x1401, 1) == 0x8000_0300 + NODE


def test_a_value_of_the_bench_stays_within_the_limits_of_the_drive() -> None:
    bench = bench_of({"6085": SimulatedObject(high=1000)})
    assert bench.read(0x6085) == 1000


def test_the_modes_are_those_of_the_profile_and_6502h_shows_them() -> None:
    bench = DriveBench(replace(profile(), simulation=SimulationSection(modes=(3, 10))))
    assert bench.read(0x6502) == 1 << 2 | 1 << 9
    assert bench.write(0x6060, 0, 1, "b") == Refusal(AbortCode.INVALID_VALUE.value)
    assert bench.write(0x6060, 0, 3, "b") is None


def test_a_pdo_that_maps_what_is_not_there_is_told_in_words() -> None:
    with pytest.raises(UsageError, match="1601h:01 maps 20120020h, which the drive lacks"):
        bench_of({"1601:01": SimulatedObject(value=0x2012_0020)})


def test_a_number_of_mapped_objects_that_no_pdo_has_does_not_stop_the_drive() -> None:
    """A vendor's file may have any default there, such as 7FFFFFFFh in 32 bits."""
    bench = bench_of({"1603": SimulatedObject(type=DataType.INT32, access="rw", value=0x7FFF_FFFF)})
    assert bench.read(0x1603) == 0x7FFF_FFFF


class TestShippedDrives:
    """Traps of single drives, as their simulated drives have them."""

    def test_an_everest_takes_its_limit_downwards_as_the_lowest_torque(self) -> None:
        """Its 60E1h is an INTEGER16 of −1000; +300 would push with that from the moment it is enabled."""
        bench = DriveBench(profile("ingenia_everest"))
        assert bench.read(0x60E1) == 0x10000 - 1000
        bench.enable()
        assert bench.read(0x6074) == 0
        assert bench.write(0x60E1, 0, 300, "h") is None
        bench.control(0x0F, 0)
        assert bench.read(0x6074) == 300

    def test_an_epos4_lacks_what_the_real_one_lacks_and_holds_what_it_holds(self) -> None:
        bench = DriveBench(profile("maxon_epos4"))
        for index in (0x1006, 0x1019, 0x6072, 0x608F):
            assert bench.read(index, 1 if index == 0x608F else 0) == NO_OBJECT
        assert bench.read(0x1400, 5) == NO_SUBINDEX
        assert (bench.read(0x6007), bench.read(0x605A), bench.read(0x605E)) == (3, 6, 2)
        assert bench.read(0x1018, 2) == 0x6450_0000
        assert bench.write(0x1005, 0, 0x80, "I") == Refusal(AbortCode.READ_ONLY.value)

    def test_an_ipos_gives_no_torque_before_bit_4_of_the_controlword(self) -> None:
        bench = DriveBench(profile("technosoft_ipos"))
        assert bench.write(0x6060, 0, -5, "b") is None
        assert bench.write(0x201C, 0, 100 << 16, "i") is None
        for word in (0x06, 0x07, 0x0F):
            assert bench.write(0x6040, 0, word, "H") is None
        bench.run(10_000_000)
        assert bench.read(0x6077) == 0
        assert bench.write(0x6040, 0, 0x1F, "H") is None
        bench.run(10_000_000)
        assert bench.read(0x6077) == 100

    def test_an_epos2_takes_milliamperes_and_shows_them(self) -> None:
        bench = DriveBench(profile("maxon_epos2"))
        assert bench.write(0x6060, 0, -3, "b") is None
        for word in (0x06, 0x07, 0x0F):
            assert bench.write(0x6040, 0, word, "H") is None
        assert bench.write(0x2030, 0, -2500, "h") is None
        bench.run(10_000_000)
        assert (bench.read(0x2031), bench.read(0x6078)) == (0x1_0000 - 2500,) * 2
        # 2.5 A times 0.05 N·m/A of the shipped bench.
        assert bench.drive.plant.torque == pytest.approx(-0.125, rel=1e-6)

    def test_a_blvd_takes_the_time_of_its_slope(self) -> None:
        bench = DriveBench(profile("oriental_blvd_krd"))
        assert bench.write(0x6060, 0, 4, "b") is None
        assert bench.write(0x6087, 0, 10_000, "I") is None
        for word in (0x06, 0x07, 0x0F):
            assert bench.write(0x6040, 0, word, "H") is None
        assert bench.write(0x6071, 0, 1000, "h") is None
        bench.run(50_000_000)
        halfway = bench.read(0x6074)
        assert isinstance(halfway, int)
        assert halfway == pytest.approx(500, abs=10)
        bench.run(60_000_000)
        assert bench.read(0x6074) == 1000

    @pytest.mark.parametrize("name", ["nanotec_c5_e", "ingenia_everest", "technosoft_ipos"])
    def test_without_1016h_life_guarding_takes_the_torque_away(self, name: str) -> None:
        bench = DriveBench(profile(name))
        assert bench.read(0x1016, 1) == NO_OBJECT
        own = profile(name)
        for option in (own.link_loss.abort_connection_option, own.link_loss.fault_reaction_option):
            if option is not None:
                assert bench.write(option.object, 0, option.value, "h") is None
        assert bench.write(0x6060, 0, own.torque.mode_of_operation, "b") is None
        assert bench.write(0x100C, 0, 10, "H") is None
        assert bench.write(0x100D, 0, 5, "B") is None
        bench.slave.receive(Frame(0x700 + NODE, b"", remote=True), bench.t_ns)
        for word in (0x06, 0x07, 0x0F):
            assert bench.write(0x6040, 0, word, "H") is None
        bench.run(49_000_000)
        assert bench.drive.power.state.value == "operation enabled"
        bench.run(10_000_000)
        assert bench.drive.power.state.value != "operation enabled"
        assert bench.drive.plant.torque == pytest.approx(0.0, abs=1e-9)
