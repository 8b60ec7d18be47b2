"""Drafts of profiles: they load, they are the profile of the file, and they say what no file can know."""

import tomllib
from dataclasses import fields, replace
from pathlib import Path

import pytest

from haptic_fieldbus.eds import DeviceInfo, Eds, EdsType
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile, draft_of, profile_from_eds
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.catalogue import load_profile
from tests.eds.peculiar import DRIVES
from tests.eds.sheets import changed, generic, without, without_member
from tests.eds.vendor_files import FILES, both, eds_of

LOADED = ("name", "source", "sources", "eds", "lacks")
"""Fields that a file of its own has otherwise."""


def loaded(profile: EdsProfile, folder: Path) -> CanopenProfile:
    path = folder / "drafted.toml"
    path.write_text(draft_of(profile, "x.eds").text, encoding="utf-8")
    found = load_profile(path)
    assert isinstance(found, CanopenProfile)
    return found


def check(profile: EdsProfile, folder: Path) -> None:
    found = loaded(profile, folder)
    for field in fields(CanopenProfile):
        if field.name not in LOADED:
            assert getattr(found, field.name) == getattr(profile, field.name), field.name
    assert found.sources.items() <= profile.sources.items()
    assert found.assumed == tuple(key for key, text in found.sources.items() if "ASSUMED" in text)


@pytest.mark.parametrize(
    "eds",
    [
        generic(),
        without(generic(), 0x6064),
        without(generic(), 0x6071, 0x1016, 0x6007),
        without_member(without(generic(), 0x1801), 0x1601, 8),
        without(generic(), *range(0x1400, 0x1C00)),
        changed(generic(), 0x6502, default=0x008),
        changed(generic(), 0x60A8, type=EdsType.UNSIGNED32, access="rw", default=0xFF41_0000),
        replace(generic(), device=DeviceInfo(vendor_name='"A\\B"\x7f\t#', product_name="né = [x]")),
    ],
)
def test_a_draft_loads_as_the_profile_that_the_file_makes(eds: Eds, tmp_path: Path) -> None:
    check(profile_from_eds(eds), tmp_path)


def test_every_value_has_its_source_and_what_is_assumed_stands_at_the_top() -> None:
    profile = profile_from_eds(replace(generic(), source="push1.eds"))
    draft = draft_of(profile, "push1.eds")
    told = tomllib.loads(draft.text)["sources"]
    assert told["torque.target.object"] == "push1.eds, [6071]"
    assert told["link_loss.heartbeat_consumer"] == "push1.eds, [1016sub1]"
    head = draft.text.partition("schema = 1")[0]
    keys = [each.key for each in draft.assumed]
    assert {"torque.target.unit", "torque.rated.unit", "timing.torque_bandwidth", "timing.control_period"} <= set(keys)
    assert [line.removeprefix("# - ").partition(" = ")[0] for line in head.splitlines() if " = " in line] == keys
    assert draft.known + len(draft.assumed) <= len(told)


def test_the_code_of_a_unit_is_written_as_in_manuals() -> None:
    eds = changed(generic(), 0x60A8, type=EdsType.UNSIGNED32, access="rw", default=0xFF41_0000)
    text = draft_of(profile_from_eds(eds), "x.eds").text
    assert '[setup]\nwrites = [{ object = 0x60A8, type = "uint32", value = 0xFF410000 }]\n' in text


def test_the_draft_of_a_drive_without_torque_says_so_first() -> None:
    text = draft_of(profile_from_eds(without(generic(), 0x6071)), "x.eds").text
    assert "# Not usable for force: there is no 6071h target torque." in text
    assert tomllib.loads(text)["drive"]["usable"] is False


@pytest.mark.parametrize("name", both(DRIVES, sorted({*FILES} - {"roboteq_v60.eds"})))
def test_a_draft_of_every_vendors_file_loads(name: str, tmp_path: Path) -> None:
    check(profile_from_eds(eds_of(name)), tmp_path)
