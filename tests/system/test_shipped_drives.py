"""Every shipped drive: its wall is felt on its simulated drive, and nothing is stored in it."""

from pathlib import Path

import can
import pytest

import haptic_fieldbus
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.canopen.simulated_eds import dictionary_of
from tests.builders import canopen, shipped

SHIPPED = [name for name in shipped() if load_profile(name).drive.usable]
KINDS = {
    "maxon_epos4": 10, "elmo_gold": 10, "nanotec_pd4_c": 10, "nanotec_c5_e": 10, "ingenia_everest": 10,
    "zeroerr_erob": 10, "technosoft_ipos": -5, "maxon_epos2": -3, "delta_asda_a2": 4, "oriental_blvd_krd": 4,
    "generic_cia402": 10,
}  # fmt: skip
"""Mode of operation of drives, as their vendors or users name it: ten drives and the standard. Others may be added."""
NODE = 5


def test_ten_drives_are_shipped_each_with_its_mode() -> None:
    assert set(KINDS) <= set(SHIPPED)
    assert {name: canopen(name).torque.mode_of_operation for name in KINDS} == KINDS


def test_a_drive_without_a_torque_set_point_is_shipped_and_refused_for_force_with_the_reason() -> None:
    with pytest.raises(haptic_fieldbus.PlanError, match="is not usable for force: there is no 6071h target torque"):
        haptic_fieldbus.run("wall", drive="faulhaber_mclm", force=True)


def test_the_simulated_drive_without_a_torque_set_point_serves_a_master_that_positions_it() -> None:
    dictionary = {(entry.index, entry.subindex) for entry in dictionary_of(canopen("faulhaber_mclm"), NODE)}
    assert {(0x607A, 0), (0x6081, 0), (0x60FF, 0), (0x6064, 0)} <= dictionary
    assert not {(0x6071, 0), (0x6077, 0)} & dictionary


def downloads(path: Path) -> list[tuple[int, int, bytes]]:
    """Index, sub-index and octets of every expedited SDO download in a log."""
    requests = [message for message in can.LogReader(path) if message.arbitration_id == 0x600 + NODE]
    return [
        (int.from_bytes(message.data[1:3], "little"), message.data[3], bytes(message.data[4:8]))
        for message in requests
        if message.data[0] >> 5 == 1
    ]


@pytest.mark.thorough("a run on every shipped drive", quick=("technosoft_ipos",))
@pytest.mark.parametrize("name", SHIPPED)
def test_a_wall_is_felt_and_nothing_is_stored(name: str, tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    result = haptic_fieldbus.run("wall", drive=name, node=NODE, duration=1.5, seed=1, record=log)
    assert result.trips == ()
    assert result.verdict is not None
    assert result.verdict.startswith("Feels right: ")
    written = downloads(log)
    assert written, "the drive was configured"
    assert {index for index, _, _ in written}.isdisjoint({0x1010, 0x1011}), "nothing is stored or restored"
    profile = canopen(name)
    order = [(index, subindex) for index, subindex, _ in written]
    mode = order.index((0x6060, 0))
    for each in profile.setup.writes:
        assert (each.object, each.subindex) not in order[mode:]
    assert written[mode][2][:1] == profile.torque.mode_of_operation.to_bytes(1, "little", signed=True)


@pytest.mark.thorough("a plan and a refusal on every drive that counts in milliseconds", quick=1)
@pytest.mark.parametrize("name", [name for name in SHIPPED if canopen(name).sync.powers == (-3,)])
def test_a_period_between_milliseconds_is_refused_by_a_drive_that_counts_them(name: str) -> None:
    if canopen(name).sync.interpolation_time is None:
        assert haptic_fieldbus.plan("wall", drive=name, rate=800.0).rate == 800.0
        return
    with pytest.raises(haptic_fieldbus.PlanError, match=r"does not support a period of 1\.25 ms"):
        haptic_fieldbus.plan("wall", drive=name, rate=800.0)


@pytest.mark.thorough("a start of the master")
def test_a_drive_whose_motor_is_unknown_is_refused_and_the_person_sent_to_the_tool(tmp_path: Path) -> None:
    """As the EPOS4 comes out of its box: 3001h:05 is 0 in the vendor's file."""
    text = Path(load_profile("maxon_epos4").source).read_text(encoding="utf-8")
    path = tmp_path / "new.toml"
    path.write_text(text.replace("value = 50000, low = 0, high = 10000000", "value = 0"), encoding="utf-8")
    with pytest.raises(BusConfigurationError, match=r"torque constant .*Commission it with EPOS Studio first"):
        haptic_fieldbus.run("wall", drive=str(path), duration=0.1)
