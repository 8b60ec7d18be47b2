"""Properties of a drive profile of any protocol."""

from collections.abc import Mapping
from dataclasses import dataclass

from haptic_fieldbus.drive.profile import DriveProfile, DriveSection, MappedSignal, TimingSection
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True, kw_only=True)
class Bare(DriveProfile):
    def offers(self) -> Mapping[Signal, MappedSignal]:
        return {}


def test_a_profile_has_no_proof_of_set_points_unless_it_says_so() -> None:
    drive = DriveSection("some", "drive", "toy", "standard")
    profile = Bare(schema=1, drive=drive, timing=TimingSection(torque_bandwidth=1000.0, control_period=0.0))
    assert profile.echo is None
    assert profile.title == "some drive"
    assert not profile.brakes
