"""The period of the loop as a drive is told it: interpolation time period, communication cycle period.

A drive that counts in whole milliseconds cannot be told of 0.5 ms, and would interpolate, warn or trip. Such a period
is refused when the loop is planned.

Reference: CiA 402-2, 60C2h; CiA 301 4.2, 7.5.2.6 (1006h).
"""

from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, SyncSection

_NS_PER_US = 1_000


def period_objects(profile: CanopenProfile, rate: float) -> tuple[tuple[ObjectEntry, int], ...]:
    """Return the objects that tell the drive the period of a loop at `rate` [Hz], each with its value.

    They are empty for a drive that is not told. Raises PlanError for a period that the drive cannot take.
    """
    sync, period_ns = profile.sync, round(1e9 / rate)
    if period_ns < round(sync.shortest_period * 1e9):
        raise _refusal(profile, period_ns, f"its shortest period is {exactly(1e3 * sync.shortest_period)} ms")
    written: list[tuple[ObjectEntry, int]] = []
    if sync.interpolation_time is not None:
        value, power = _interpolation(profile, sync, period_ns)
        written.append((ObjectEntry(sync.interpolation_time, DataType.INT8, 2), power))
        written.append((ObjectEntry(sync.interpolation_time, DataType.UINT8, 1), value))
    if sync.cycle_period is not None:
        if period_ns % _NS_PER_US:
            raise _refusal(profile, period_ns, f"{sync.cycle_period:04X}h takes whole microseconds")
        written.append((ObjectEntry(sync.cycle_period, DataType.UINT32), period_ns // _NS_PER_US))
    return tuple(written)


def _interpolation(profile: CanopenProfile, sync: SyncSection, period_ns: int) -> tuple[int, int]:
    """Return value and power of ten of the interpolation time period."""
    low, high = sync.values
    for power in sync.powers:
        step_ns = 10 ** (9 + power)
        value, rest = divmod(period_ns, step_ns)
        if not rest and low <= value <= high:
            return value, power
    steps = " or ".join(f"{exactly(10.0 ** (3 + power))} ms" for power in sync.powers)
    raise _refusal(profile, period_ns, f"{sync.interpolation_time:04X}h takes {low} to {high} times {steps}")


def _refusal(profile: CanopenProfile, period_ns: int, why: str) -> PlanError:
    return PlanError(
        f"{profile.title} cannot take a period of {exactly(period_ns * 1e-6)} ms: {why}. Give another --rate"
    )
