"""What may happen when a drive is enabled for the first time after power-on."""

from collections.abc import Iterable, Iterator

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.axis_plan import AxisPlan


def first_enabling(profile: DriveProfile) -> str:
    """Return the warning of a drive that looks for its commutation; empty for any other."""
    if not profile.drive.commutation_search:
        return ""
    timing = profile.timing
    longest = exactly(timing.enabling_timeout + timing.mode_change_timeout)
    return (
        "the first enabling after power-on may turn the shaft, while the drive looks for its commutation: hands off, "
        f"and room to move, for up to {longest} s"
    )


def enabling_lines(axes: Iterable[AxisPlan]) -> Iterator[str]:
    """Yield the warning of each axis that has one."""
    for axis in axes:
        warning = first_enabling(axis.profile)
        if warning:
            yield f"{axis.name}: {warning}"
