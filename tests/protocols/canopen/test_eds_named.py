"""Values that a profile names and a file shows otherwise: units, guards by requests, and the period of a drive."""

from dataclasses import replace

import pytest

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.eds import EdsType
from haptic_fieldbus.protocols.canopen.eds_check import left_out, named_objects, shown_findings
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile, profile_from_eds
from haptic_fieldbus.protocols.canopen.profile import CommissioningSection, ShownObject
from haptic_fieldbus.protocols.catalogue import load_profile
from tests.builders import VELOCITY_ONLY, canopen
from tests.eds.sheets import changed, generic, own, without

COUNTS, PER_MINUTE = 0x00B5_0000, 0x00B4_4700


def found(eds: object, profile: object) -> dict[str, str]:
    return {each.key: each.fault for each in named_objects(profile, eds) if each.fault}  # type: ignore[arg-type]


def test_units_of_position_and_velocity_are_those_of_60a8h_and_60a9h() -> None:
    eds = changed(changed(generic(), 0x60A8, default=COUNTS), 0x60A9, default=PER_MINUTE)
    assert "position.actual.unit" not in found(eds, canopen("generic_cia402"))
    assert "position.actual.unit" in found(changed(eds, 0x60A8, default=0xFD41_0000), canopen("generic_cia402"))
    velocity = replace(VELOCITY_ONLY.velocity, actual=replace(VELOCITY_ONLY.velocity.actual, unit="counts/s"))  # type: ignore[union-attr, type-var]
    assert "velocity.actual.unit" in found(eds, replace(canopen("generic_cia402"), velocity=velocity))


def test_a_guard_by_requests_needs_its_two_objects() -> None:
    profile = canopen("generic_cia402")
    guarded = replace(profile, link_loss=replace(profile.link_loss, heartbeat_consumer=None, life_guarding=True))
    assert "link_loss.life_guarding" not in found(generic(), guarded)
    assert "link_loss.life_guarding" in found(without(generic(), 0x100D), guarded)


def test_a_target_that_is_asked_for_must_be_readable() -> None:
    profile = canopen("generic_cia402")
    asked = replace(profile, torque=replace(profile.torque, echo="asked"))
    assert "torque.echo" not in found(generic(), asked)
    assert "torque.echo" in found(changed(generic(), 0x6071, access="wo"), asked)


@pytest.mark.parametrize(("power", "fault"), [(-3, ""), (-4, "without -4, the value of 60C2h:02 after power-on")])
def test_the_power_of_the_period_is_that_of_power_on(power: int, fault: str) -> None:
    profile = canopen("maxon_epos4")
    eds = changed(own(profile), 0x60C2, 2, default=power)
    assert found(eds, profile).get("sync.powers", "") == fault


def test_a_drive_that_takes_a_current_and_shows_no_torque_is_asked_for_its_current() -> None:
    profile = canopen("generic_cia402")
    target = replace(profile.torque.target, unit="mA")
    blind = replace(profile, torque=replace(profile.torque, target=target, actual=None))
    for eds, shown in ((generic(), "6077h"), (without(generic(), 0x6077), "6078h")):
        faults = {each.key: each.fault for each in left_out(blind, eds)}
        assert shown in faults["torque.actual"]
    assert "torque.actual" not in {each.key for each in left_out(blind, without(generic(), 0x6077, 0x6078))}


def test_a_shown_value_whose_name_no_file_tells_is_only_looked_up() -> None:
    profile = canopen("generic_cia402")
    gain, twice = ShownObject("gain", 0x2000, DataType.UINT16), ShownObject("load", 0x2001, DataType.UINT16)
    shown = replace(profile, commissioning=CommissioningSection("tool", (gain, twice, twice)))
    eds = changed(generic(), 0x2001, name="load", type=EdsType.UNSIGNED16)
    assert [(each.key, each.fault) for each in shown_findings(shown, eds) if each.fault] == [
        ("commissioning.shown", "2000h:00 is not in the file"),
        *[("commissioning.shown", "2001h:00 appears twice; expected once")] * 2,
    ]


def test_a_profile_of_a_file_tells_its_faults_and_what_keeps_it_from_force() -> None:
    profile = profile_from_eds(without(generic(), 0x6071))
    assert isinstance(profile, EdsProfile)
    assert [str(fault) for fault in profile.faults()] == ["not usable for force: there is no 6071h target torque"]
    assert load_profile("generic_cia402").name == "generic_cia402"
