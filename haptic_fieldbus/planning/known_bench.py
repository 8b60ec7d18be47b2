"""The bench on which a plan rests: the values that `identify` has measured, else those that the rig states.

Theory. `identify` tells each value with an interval of 95 %, 2.4 standard deviations to each side, which are themselves
known to about a fifth. The limit is the worst over a region that holds all values together with at least 99.7 %. Five
values stand in it: inertia, damping, friction, delay with lag, and lag. By the inequality of Bonferroni a box holds all
of them, whatever their correlations, if each end of it is passed with a probability of at most 0.003/10. In Student's
distribution with the 12.5 degrees of freedom of a spread that is known to a fifth, these are 4.55 standard deviations;
twice the interval of 95 % is 4.8. So no correlation has to be known.

Delay and lag are taken together, as they were measured: their sum decides, and one of them is long where the other is
short. What the plan expected at the measurement is kept beside them (`planned_delay`). The difference is the share of
drive and computer. At another rate it is added to what the plan then expects, if it is not negative. With another
adapter, or with another stated delay of it, it is not made shorter, and the longest delay of the profile counts too.
Without it a measured delay counts only where it is longer than the longest one of the profile.
A control tick that the profile does not call locked may have another place in the period after each start, so up to one
more control period is open; and the host may be late.

`identify` seals its table with a digest, and with it the name of the axis and whether the bus was simulated. A table
without a digest may be written by anybody, so its values count as stated: the region is then that of the interval and
that of a stated value together.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

from haptic_fieldbus.drive.profile import DriveProfile, Identity, digest_of
from haptic_fieldbus.drive.rig import MECHANICAL, BusSection, Contradicted, Identified, LinearMechanism, Rig, RigAxis
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.margins import Basis
from haptic_fieldbus.margins.plant import (
    ASSUMED_BANDWIDTH,
    COULOMB_SHARES,
    DAMPING_SHARES,
    EXACT,
    INERTIA_SHARES,
    SOURCED_BANDWIDTH,
    Range,
)
from haptic_fieldbus.numerals import exactly, in_unit, rounded, with_interval
from haptic_fieldbus.protocols.traffic import Delay
from haptic_fieldbus.signals import Signal

BANDWIDTH, TIMING = "timing.torque_bandwidth", "timing"
"""Keys of a profile whose source is the source of the bandwidth."""
WIDER = 2.0
"""Half width of the region of 99.7 %, in half widths of the intervals of 95 %."""
SMALLEST = 1e-3
"""Smallest damping that a run can show, as a share of that of the rig."""
SAME_PLAN = 1e-6
"""Largest difference of two planned delays that are the same [s]: a rig keeps six digits."""
STATED_SHARES = {"inertia": INERTIA_SHARES, "viscous_damping": DAMPING_SHARES, "coulomb_friction": COULOMB_SHARES}
SCALES = ("encoder_counts_per_revolution", "rated_torque", "torque_constant", "rated_current", "peak_current")
"""Keys of an axis on whose values every measured value rests; beside them the mechanism."""
TOLD = {"inertia": ("inertia", "kg·m²"), "viscous_damping": ("damping", "N·m·s/rad"),
        "coulomb_friction": ("friction", "N·m"), "delay_and_lag": ("delay", "s")}  # fmt: skip
"""Measured values that people are shown, with their words and units."""


@dataclass(frozen=True)
class KnownBench:
    """Values of one axis at the motor shaft, with the shares of each that are open; None: unknown."""

    inertia: float | None
    viscous_damping: float | None
    coulomb_friction: float | None
    shares: tuple[Range, Range, Range]
    """Shares of inertia, damping and friction."""
    basis: Basis
    measured: Identified | None = None
    """Measured values that count; None when none do."""
    is_moved: bool = False
    """True: the bus or its adapter is not that of the measurement, or that one is unknown."""
    fault: str = ""
    """Why measured values of the rig do not count; all values are then unknown. Empty if they count."""
    evidence: str = ""
    """Sentence about an earlier run that contradicts the rig, and on which the values rest; empty without one."""

    @property
    def unknown(self) -> str:
        """Reason why no limit is known; empty if all values are known."""
        missing = [key for key in MECHANICAL if getattr(self, key) is None]
        if not missing:
            return ""
        why = self.fault or f"the rig leaves out {' and '.join(missing)}"
        return f"no limit is known, because {why}"


def known_bench(rig: Rig, name: str, profile: DriveProfile) -> KnownBench:
    """Return the bench of an axis; a measured value takes the place of a stated one."""
    axis = rig.axis[name]
    measured, bus = axis.identified, rig.bus[axis.bus]
    described = measured.resonance is not None and axis.simulation.coupling is not None
    if measured == Identified() or described:
        values = (axis.inertia, axis.viscous_damping, axis.coulomb_friction)
        return KnownBench(*values, (INERTIA_SHARES, DAMPING_SHARES, COULOMB_SHARES), Basis.STATED)
    if fault := _fault(rig, name, profile):
        return KnownBench(None, None, None, (EXACT, EXACT, EXACT), Basis.STATED, fault=fault)
    (inertia, first), (damping, second), (coulomb, third) = (_known(axis, key) for key in MECHANICAL)
    is_stated = measured.viscous_damping is None or measured.digest is None
    basis = Basis.STATED if is_stated else Basis.IDENTIFIED
    is_moved = measured.bus != bus.route and not bus.stands_for_real
    return KnownBench(inertia, damping, coulomb, (first, second, third), basis, measured, is_moved)


def _known(axis: RigAxis, key: str) -> tuple[float | None, Range]:
    """Return a value and the shares of it that are open; the value may be measured, stated or unknown."""
    value = getattr(axis.identified, key)
    if value is None:
        return getattr(axis, key), STATED_SHARES[key]
    low, high = widened(value, getattr(axis.identified, f"{key}_interval"))
    shares = (low / value, high / value) if value else EXACT
    least, most = STATED_SHARES[key] if axis.identified.digest is None else shares
    return value, (min(shares[0], least), max(shares[1], most))


def widened(value: float, interval: Range) -> Range:
    """Return the side of the region of 99.7 % that belongs to an interval of 95 % of a value that is not negative."""
    half = WIDER * max(value - interval[0], interval[1] - value)
    return max(0.0, value - half), value + half


def only_simulated(bus: BusSection) -> bool:
    """Return whether the drives of a bus are simulated, and no real bus is meant."""
    return (bus.simulated or bus.rehearsed) and not bus.stands_for_real


def _fault(rig: Rig, name: str, profile: DriveProfile) -> str:
    """Return why the measured values of an axis do not count; empty if they do."""
    axis = rig.axis[name]
    measured, coupling = axis.identified, axis.simulation.coupling
    if measured.simulated and not only_simulated(rig.bus[rig.axis[name].bus]):
        return "the values of [identified] were measured on a simulated bus"
    if measured.axis not in (None, name):
        return f"the values of [identified] were measured on the axis {measured.axis}"
    # A table of an earlier version has no name: two that are the same were copied.
    others = [each for each, axis in rig.axis.items() if each != name and axis.identified.digest == measured.digest]
    if measured.axis is None and measured.digest is not None and others:
        return f"[identified] is that of the axis {others[0]} too"
    if measured.resonance is not None:
        found = f"identify found a resonance of {rounded(measured.resonance)} Hz"
        return f"{found}, and simulation.coupling states no elastic shaft"
    if measured.profile is not None and measured.profile != profile.name:
        return f"the values of [identified] were measured with the profile {measured.profile}"
    if measured.units is not None and measured.units != (now := scaling_of(profile)):
        return f"the profile {profile.name} had the units {measured.units} at the measurement, and has {now} now"
    if measured.digest is not None and measured.digest != digest_with(axis, measured):
        return "the axis or its [identified] was changed after the measurement"
    for key in (*MECHANICAL, "delay_and_lag", "torque_lag"):
        value, interval = getattr(measured, key), getattr(measured, f"{key}_interval")
        if value is not None and not (interval is not None and 0.0 <= interval[0] <= value <= interval[1] < math.inf):
            return f"{key} of [identified] has no interval around it"
    if measured.inertia is None or measured.inertia_interval is None:
        return ""
    if coupling is not None and measured.inertia <= coupling.load_inertia:
        return "the measured inertia is not above load_inertia of simulation.coupling"
    low, _ = widened(measured.inertia, measured.inertia_interval)
    return "" if low > 0.0 else "the inertia was measured too roughly for a limit"


def scaling_of(profile: DriveProfile) -> str:
    """Return the units of torque and position of a profile, with the full scale of its torque if it has one."""
    offered = profile.offers()
    motion = offered.get(Signal.POSITION) or offered[Signal.VELOCITY]
    full = "" if profile.full_scale is None else f" of {exactly(profile.full_scale)} N·m"
    return f"{offered[Signal.TARGET_TORQUE].unit}{full}, {motion.unit}"


def digest_with(axis: RigAxis, measured: Identified | Contradicted) -> str:
    """Return the digest of measured values and of the values of the axis on which they rest."""
    mechanism = axis.mechanism
    ratio = mechanism.metres_per_revolution if isinstance(mechanism, LinearMechanism) else mechanism.gear_ratio
    own = [getattr(measured, each.name) for each in fields(measured) if each.repr and each.name != "digest"]
    scales = [mechanism.kind, ratio, *(getattr(axis, key) for key in SCALES)]
    # Keys that an earlier version did not write are in the digest only where they are given.
    newer = [each.name for each in fields(measured) if not each.repr and each.name != "resonance"]
    later = [f"{key} {value}" for key in newer if (value := getattr(measured, key))]
    return digest_of(_text(each) for each in (*own, *scales, *later))


# What an ordinary run has shown against the values of the rig.


def evidence_digest(axis: RigAxis, note: Contradicted) -> str:
    """Return the digest of a note about an earlier run and of the values that it contradicts."""
    known = [_text(getattr(axis, key)) for key in MECHANICAL]
    return digest_of((digest_with(axis, note), str(axis.identified), *known))


def standing_note(axis: RigAxis) -> Contradicted | None:
    """Return the note of an earlier run about an axis; None without one, and when what it contradicts has changed."""
    note = axis.contradicted
    return note if note.digest is not None and note.digest == evidence_digest(axis, note) else None


def with_evidence(bench: KnownBench, axis: RigAxis, *, simulated: bool) -> KnownBench:
    """Return the bench with the note of an earlier run in its region, if it counts; it permits no more than before."""
    note = standing_note(axis)
    if note is None or note.simulated != simulated:
        return bench
    shares, told = list(bench.shares), []
    for place, key in enumerate(("inertia", "viscous_damping")):
        known, seen, interval = (getattr(each, name) for each, name in
                                 ((bench, key), (note, key), (note, f"{key}_interval")))  # fmt: skip
        if not known or seen is None or interval is None:
            continue
        low, high = (share * known for share in shares[place])
        value = min(known, max(seen, SMALLEST * known)) if key == "viscous_damping" else known
        shares[place] = min(low, interval[0]) / value, max(high, interval[1]) / value
        bench = replace(bench, **{key: value})
        unit = TOLD[key][1]
        told.append(f"{TOLD[key][0]} {in_unit(seen, unit)}, where the rig has {in_unit(known, unit)}")
    evidence = f"the run of {note.date} showed {' and '.join(told)}; change the rig or measure the bench"
    return replace(bench, shares=(shares[0], shares[1], shares[2]), evidence=evidence if told else "")


def _text(value: object) -> str:
    """Return a value as it is read from a file: 1 and 1.0 are the same."""
    if isinstance(value, list | tuple):
        return " ".join(_text(each) for each in value)
    return repr(float(value)) if isinstance(value, int | float) else str(value)


def check_measured_drive(name: str, bench: KnownBench, drive: Identity) -> None:
    """Raise PlanError when the values of an axis were measured with another drive than the connected one."""
    measured = bench.measured
    if measured is not None and measured.serial is not None and drive.serial not in (None, measured.serial):
        raise PlanError(
            f"axis {name}: [axis.{name}.identified] of the rig was measured with the drive of serial number "
            f"{measured.serial:#010x}, this drive has {drive.serial:#010x}. Run haptic-fieldbus identify anew, or "
            "remove the table"
        )


def as_stated(axis: RigAxis) -> RigAxis:
    """Return the axis with its measured values as stated ones, and without the table, so that one can be varied."""
    known = {key: value for key in MECHANICAL if (value := getattr(axis.identified, key)) is not None}
    return replace(axis, identified=Identified(), **known)


# Delay and lag.


@dataclass(frozen=True)
class MeasuredTimes:
    """Delay and lag of an axis, from a measurement and the plan [s]."""

    total: float
    """Delay with lag."""
    lag: float
    totals: Range
    lags: Range

    @property
    def delay(self) -> float:
        """Delay without lag."""
        return max(self.total - self.lag, 0.0)


def lags_of(profile: DriveProfile) -> Range:
    """Return the shortest and the longest time constant of the torque [s]; a torque slope of the drive is exact."""
    assumed = {BANDWIDTH, TIMING} & {*profile.assumed}
    lowest, highest = ASSUMED_BANDWIDTH if assumed else SOURCED_BANDWIDTH
    loop = profile.torque_lag - profile.ramp
    return profile.ramp + loop / highest, profile.ramp + loop / lowest


def measured_times(bench: KnownBench, profile: DriveProfile, delay: Delay, lags: Range) -> MeasuredTimes | None:
    """Return the times of an axis whose plan has this delay, or None; `lags` are those of the profile [s]."""
    measured = bench.measured
    if measured is None or measured.delay_and_lag is None or measured.delay_and_lag_interval is None:
        return None
    planned, (shortest, longest) = delay.transport + delay.torque_loop, map(sum, zip(delay.range, lags, strict=True))
    value = measured.delay_and_lag
    low, high = _, most = widened(value, measured.delay_and_lag_interval)
    if measured.planned_delay is None or measured.digest is None:  # nobody knows how much of it is the bus, or the rate
        if high <= longest:
            return None
        low = min(low, shortest)
    elif abs(further := planned - measured.planned_delay) > SAME_PLAN:
        value, low, high = max(value + further, planned), low + further, max(high + further, planned)
    if bench.is_moved:  # another adapter may be slower than its plan says
        low, high = min(low, shortest), max(high, most, longest)
    tick = 0.0 if profile.timing.control_tick == "sync" else profile.timing.control_period
    totals = max(low - tick, 0.0), high + tick + delay.lateness
    lag = profile.torque_lag
    if measured.torque_lag is not None and measured.torque_lag_interval is not None:
        lag, lags = measured.torque_lag, widened(measured.torque_lag, measured.torque_lag_interval)
    return MeasuredTimes(value, min(lag, value), totals, (min(lags[0], totals[1]), min(lags[1], totals[1])))


def measured_texts(bench: KnownBench) -> Iterator[str]:
    """Yield the measured values of a bench with their intervals of 95 %, and when they were measured."""
    measured = bench.measured
    if measured is None:
        return
    parts = []
    for key, (word, unit) in TOLD.items():
        value, interval = getattr(measured, key), getattr(measured, f"{key}_interval")
        if value is not None and interval is not None:
            parts.append(f"{word} {with_interval(value, interval[0], interval[1], unit)}")
    rate = "" if measured.rate is None else f" at {rounded(measured.rate)} Hz"
    seal = "" if measured.digest is not None else "; without digest, so judged like stated values"
    yield f"{', '.join(parts)}; {measured.date or 'date unknown'}{rate}{seal}"
