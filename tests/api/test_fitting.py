"""Profiles of no particular drive are fitted before a plan is made, each to its own drive."""

from dataclasses import replace

from haptic_fieldbus.api.site import fit_profiles
from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.signals import Workspace


def test_two_drives_of_one_profile_get_one_each_and_a_drive_with_a_profile_of_its_own_keeps_it() -> None:
    bench = default_axis(Workspace.LINEAR, bus="can", node=5, profile="generic_cia402")
    axes = {
        "left": bench,
        "right": replace(bench, node=6),
        "known": replace(bench, node=7, profile="maxon_epos4"),
    }
    drives = "maxon_epos4@5,generic_cia402@6,maxon_epos4@7"
    rig, profiles = fit_profiles(Rig({"can": CanSection("haptic_sim", drives, listen=0.01)}, axes))
    assert rig.axis["known"] is axes["known"]
    found = {name: canopen_profile(profiles[rig.axis[name].profile]) for name in ("left", "right")}
    assert {name: profile.torque.echo for name, profile in found.items()} == {"left": "actual", "right": "demand"}
    assert len(profiles) == 2
