"""Ranges in which the values of an axis may lie; the cautious limit is told over all of them (`margins.ranges`)."""

from dataclasses import replace

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.margins.ranges import ASSUMED_BANDWIDTH, COUPLING_SHARES, SOURCED_BANDWIDTH, Range, Ranges
from haptic_fieldbus.protocols.traffic import Delay

BANDWIDTH, TIMING = "timing.torque_bandwidth", "timing"
"""Keys of a profile whose source tells where the bandwidth comes from."""


def ranges_of(profile: DriveProfile, delay: Delay, *, compliant: bool) -> Ranges:
    """Return the ranges of an axis with this drive and delay, and a compliant coupling or none."""
    ranges = Ranges(torque_lag=_lags(profile), delay=delay.range)
    return replace(ranges, coupling=COUPLING_SHARES) if compliant else ranges


def _lags(profile: DriveProfile) -> Range:
    """Return the shortest and the longest time constant of the torque [s]; a slope of the drive's own is exact."""
    assumed = {BANDWIDTH, TIMING} & {*profile.assumed}
    lowest, highest = ASSUMED_BANDWIDTH if assumed else SOURCED_BANDWIDTH
    loop = profile.torque_lag - profile.ramp
    return profile.ramp + loop / highest, profile.ramp + loop / lowest
