"""An assumption about a drive stands beside every result that rests on it."""

from dataclasses import replace

from haptic_fieldbus.api import plan
from haptic_fieldbus.api.stability_limits import Device, judge_scene
from haptic_fieldbus.planning.plan import assumed_words
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from tests.builders import PROFILE
from tests.cases import every

TIMES = "torque loop 1000 Hz, control period 0.5 ms"
OF_PROFILE = ("torque loop 1000 Hz", "control period 0.4 ms")


def test_the_times_come_first_with_their_values() -> None:
    sources = {
        "torque.rated": "ASSUMED",
        "timing.control_period": "ASSUMED",
        "timing.torque_bandwidth": "ASSUMED: usual",
    }
    profile = replace(PROFILE, sources={**PROFILE.sources, **sources})
    assert assumed_words(profile)[:3] == (*OF_PROFILE, "unit of rated torque")


def test_the_source_of_a_section_covers_its_keys() -> None:
    assert assumed_words(replace(PROFILE, sources={"timing": "ASSUMED: usual figures"}))[:2] == OF_PROFILE


def test_nothing_is_told_of_a_drive_that_was_measured() -> None:
    measured = replace(PROFILE, sources=dict.fromkeys(PROFILE.sources, "measured"))
    assert assumed_words(measured) == ()


@every("name", profile_names())
def test_every_shipped_profile_assumes_its_torque_loop(name: str) -> None:
    assert assumed_words(load_profile(name))[0] == "torque loop 1000 Hz"


def test_two_drives_are_told_apart() -> None:
    lines = plan("virtual_shaft").assumed
    assert len(lines) == 1, "two of one profile share a line"


def test_a_judgement_carries_it_and_one_of_a_device_given_by_numbers_has_none() -> None:
    assert judge_scene(Task("wall", drive="generic_cia402")).assumed == (TIMES,)
    assert judge_scene(Task("wall"), Device(mass=0.6, damping=1.6, delay=8e-4)).assumed == ()
