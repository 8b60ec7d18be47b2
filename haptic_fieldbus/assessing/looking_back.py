"""Look back on an ordinary run: what its record shows of the bench on which its plan rests.

Theory. A second difference of positions over ±w is the mean acceleration under a triangle. Under the same triangle the
means of torque, speed and direction satisfy J·a = u − b·v − c·s + g, whatever the scene is. A least-squares fit over a
window gives J, b, c and a constant g, if torque varies in it, as in a bounce, a decay in a contact, or a start from a
spring. A window counts only if it leaves no more than the noise of the encoder: a hand that pulls or pushes in it
leaves much more.

A hand that only holds the handle adds inertia and damping, and no window shows it. Therefore a value that is larger
than the known one says nothing, and a smaller one contradicts it. The delay is the longest one that is open, or that
was measured: a longer delay makes the damping that is seen larger. `WINDOWS` windows must contradict with three
standard deviations.

A smooth hand leaves no more than noise either. In a spring, u = −K·x, a hand that makes it swing with ω shows an
inertia of K/ω² and any damping. Three rules keep it out. One of the windows must be faster than `SLOWEST`, which a hand
that plays with a spring is not. A damping counts only where it is above 0, since a hand that keeps up a swing shows 0;
wholly below 0 the window tells nothing at all. And it counts only where the same window shows the known inertia.

What contradicts is noted in the rig (`drive.rig.Contradicted`), and the next plan rests on it (`planning.known_bench`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.loop_report import Record
from haptic_fieldbus.documents.edits import table_values, write_table
from haptic_fieldbus.drive.rig import Contradicted
from haptic_fieldbus.identification.estimates import Estimate
from haptic_fieldbus.identification.shaft import ShaftRecord
from haptic_fieldbus.numerals import in_unit
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.known_bench import evidence_digest, lags_of, measured_times, standing_note
from haptic_fieldbus.planning.plan import Plan

WINDOW, HOP, HALF = 0.3, 0.025, 0.012
"""Length of a window, distance of their beginnings, and half width of a triangle [s]."""
FEWEST = 3
"""Fewest periods in half a triangle; and counts of motion in it."""
NOISE, NOISE_SHARE = 1.5, 0.02
"""Largest residual of a window: in standard deviations of the encoder's noise, or as a share of the accelerations."""
EXCITED = 0.05
"""Largest relative standard deviation of the inertia of a window that counts."""
SPREADS, WINDOWS = 3.0, 2
"""Standard deviations of an interval, and windows that must contradict."""
SLOWEST = 2.0 * np.pi * 3.0
"""Slowest swing that counts [rad/s]."""
Array = NDArray[Any]
WORDS = {"inertia": "an inertia", "viscous_damping": "a damping"}


def shaft_record_of(
    times_ns: Array, positions: Array, efforts: Array, *, period: float, resolution: float, ratio: float
) -> tuple[ShaftRecord, Array]:
    """Return samples of a handle as the record of its shaft, and for each instant of it the last sample up to there.

    The handle moves `ratio` times as far as the shaft. Missing samples are drawn as straight lines.
    """
    places = np.rint((times_ns - times_ns[0]) / (1e9 * period)).astype(int)
    grid = np.arange(places[-1] + 1)
    held = np.searchsorted(places, grid, side="right") - 1
    shaft, torques = np.interp(grid, places, positions) / ratio, efforts[held] * ratio
    return ShaftRecord(period, tuple(shaft.tolist()), tuple(torques.tolist()), resolution / ratio), held


def shaft_record(axis: AxisPlan, period: float, rows: Record, begin_ns: int) -> ShaftRecord:
    """Return the record of an axis at its motor shaft since `begin_ns`; missing samples are drawn as straight lines."""
    since = rows.column("t_ns") >= begin_ns
    if not since.any():
        return ShaftRecord(period, (), (), axis.resolution / axis.rig.mechanism.ratio)
    times_ns, position, command = (
        rows.column(name)[since] for name in ("t_ns", f"{axis.name}.position", f"{axis.name}.command")
    )
    ratio = axis.rig.mechanism.ratio
    found, _ = shaft_record_of(times_ns, position, command, period=period, resolution=axis.resolution, ratio=ratio)
    return found


@dataclass(frozen=True)
class SeenWindow:
    """Values that a window shows, with intervals of three standard deviations."""

    swing: float
    """Acceleration over speed, without its mean [rad/s]; the angular frequency of a harmonic motion."""
    inertia: Estimate
    viscous_damping: Estimate


def seen_values(record: ShaftRecord, delay: float) -> Iterator[SeenWindow]:
    """Yield the values of each window that counts.

    `delay` [s] is that of the set-points, with lag.
    """
    period, resolution = record.period, record.resolution
    y, w = np.array(record.positions), max(FEWEST, round(HALF / period))
    length, hop = round(WINDOW / period), max(1, round(HOP / period))
    if len(y) < length + 2 * w:
        return
    way = np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]))]) * period
    after, before = y[2 * w :] - y[w:-w], y[w:-w] - y[: -2 * w]
    bend = (after - before) / (w * period) ** 2
    speed = (way[2 * w :] - 2.0 * way[w:-w] + way[: -2 * w]) / (w * period) ** 2
    torque = record.torques_under(w, delay / period)[: len(bend)]
    rows = np.column_stack([torque, speed, np.sign(speed), np.ones(len(bend))])
    moving = (after * before > 0.0) & (np.minimum(abs(after), abs(before)) > FEWEST * resolution)
    noise = resolution * np.sqrt(0.5) / (w * period) ** 2
    for first in range(0, len(bend) - length + 1, hop):
        here = np.arange(first, first + length)[moving[first : first + length]]
        if 2 * len(here) >= length:
            yield from _fitted(rows[here], bend[here], float(noise), 0.5 * w)


def _fitted(rows: Matrix, bend: Matrix, noise: float, alike: float) -> Iterator[SeenWindow]:
    """Yield the values of a window, if it counts; `alike` neighbouring rows count as one."""
    turned, swing = np.ptp(rows[:, 2]) > 0.0, float(np.sqrt(np.mean(bend**2)) / np.std(rows[:, 1]))
    rows = rows if turned else rows[:, [0, 1, 3]]
    scales = np.maximum(np.abs(rows).max(axis=0), 1e-300)
    found = np.linalg.lstsq(rows / scales, bend, rcond=None)[0] / scales
    left = float(np.sqrt(np.mean((bend - rows @ found) ** 2)))
    if left > max(NOISE * noise, NOISE_SHARE * float(np.sqrt(np.mean(bend**2)))):
        return
    inverse = np.linalg.pinv((rows / scales).T @ (rows / scales))
    spread = max(left, noise) * np.sqrt(alike * np.diag(inverse)) / scales
    if not 0.0 < spread[0] < EXCITED * found[0]:
        return
    inertia = 1.0 / found[0]
    wide = SPREADS * inertia * np.array([inertia * spread[0], spread[1]])
    damping = -inertia * found[1]
    if damping + wide[1] >= 0.0:  # below it something moves the handle
        yield SeenWindow(swing, _estimate(inertia, wide[0], "kg·m²"), _estimate(damping, wide[1], "N·m·s/rad"))


def _estimate(value: float, half: float, unit: str) -> Estimate:
    low, middle, high = (max(float(f"{each:.6g}"), 0.0) for each in (value - half, value, value + half))
    return Estimate(middle, low, high, unit)


@dataclass(frozen=True)
class Contradiction:
    """A value of a bench that a run contradicts."""

    axis: str
    key: str
    known: float
    basis: str
    seen: Estimate

    def text(self) -> str:
        """Return the sentence with both values."""
        unit = self.seen.unit
        low, high, known = (in_unit(each, unit) for each in (self.seen.low, self.seen.high, self.known))
        return (
            f"axis {self.axis}: this run shows {WORDS[self.key]} of {low} to {high}, the rig has {known} "
            f"({self.basis}). Until the rig or the measurement changes, the limit rests on what was seen; measure the "
            "bench with haptic-fieldbus identify"
        )


def contradictions(plan: Plan, rows: Record, begin_ns: int) -> Iterator[Contradiction]:
    """Yield each value of a bench that the record contradicts: at least `WINDOWS` windows lie below its region."""
    for axis in plan.axes:
        if axis.integrates or axis.plant is None:
            continue
        lags = lags_of(axis.profile)
        times = measured_times(axis.bench, axis.profile, axis.delay, lags)
        delay = axis.delay.range[1] + lags[1] if times is None else times.totals[1]
        # While the force fades in, a hand that takes hold rises with it.
        since_ns = begin_ns + round(1e9 * (axis.limits.fade_in + WINDOW))
        windows = list(seen_values(shaft_record(axis, plan.period, rows, since_ns), delay))
        least, most = (share * (axis.bench.inertia or 0.0) for share in axis.bench.shares[0])
        free = [each for each in windows if each.inertia.high >= least and each.inertia.low <= most]
        decays = [each for each in free if each.viscous_damping.low > 0.0]
        for (place, key), counting in zip(enumerate(WORDS), (windows, decays), strict=True):
            known = getattr(axis.bench, key)
            below = [each for each in counting if getattr(each, key).high < axis.bench.shares[place][0] * known]
            quick = [getattr(each, key) for each in below if each.swing >= SLOWEST]
            if len(below) >= WINDOWS and quick:
                best = min(quick, key=lambda each: each.high - each.low)
                yield Contradiction(axis.name, key, known, axis.bench.basis.value, best)


def noted(plan: Plan, found: Iterator[Contradiction]) -> Iterator[str]:
    """Write contradictions into the rig file, and yield a sentence for each and for what could not be written."""
    notes: dict[str, Contradicted] = {}
    for each in found:
        yield each.text()
        present = standing_note(plan.axis(each.axis).rig)
        if plan.simulated and present and not present.simulated:
            continue  # what a real bench has shown stays, and its limit holds here too
        kept = present if present and present.simulated == plan.simulated else Contradicted(simulated=plan.simulated)
        shown: dict[str, Any] = {each.key: each.seen.value, f"{each.key}_interval": (each.seen.low, each.seen.high)}
        notes[each.axis] = replace(notes.get(each.axis, kept), **shown)
    for name, note in notes.items():
        note = replace(note, date=datetime.now().astimezone().isoformat(timespec="seconds"))
        note = replace(note, digest=evidence_digest(plan.axis(name).rig, note))
        if why := write_table(plan.rig.source, ("axis", name, "contradicted"), table_values(note)):
            yield f"this was not noted in {plan.rig.source}: {why}"
