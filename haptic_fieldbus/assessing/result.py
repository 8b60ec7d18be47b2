"""Result of a run: figures for people and programs, and the traces of the plot.

A result may be partial. After a refused or tripped run it holds the figures known by then, and None for the others.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.loop_report import SAMPLES, LoopReport, Percentiles, PeriodTimes, Timing
from haptic_fieldbus.assessing.passivity import Passivity, cost_text, forgiven_text
from haptic_fieldbus.assessing.travel import Travel
from haptic_fieldbus.cycle import safety
from haptic_fieldbus.errors import UsageError, require
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.numerals import DIGITS, OutputRow, exactly, in_unit, object_of, percent, rounded
from haptic_fieldbus.planning.explain import milliseconds, summary_json
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.traffic import Json as Json
from haptic_fieldbus.recordings.provenance import Provenance
from haptic_fieldbus.signals import Workspace

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure


# What a run in real time asked of its computer, and what it got.


@dataclass(frozen=True)
class Right:
    """One right requested from the operating system, and its outcome in words."""

    name: str
    """`scheduling`, `memory`, `processor`, `timer_slack` or `idle_states`."""
    wished: str
    got: str
    granted: bool
    advice: str = ""
    """Instruction for getting a right that was refused; empty when it was granted."""

    def to_json(self) -> Json:
        return {**vars(self), "advice": self.advice or None}


def refused_texts(rights: Iterable[Right]) -> Iterator[str]:
    """Yield a line on the rights that this computer refused, and the advice."""
    refused = [right for right in rights if not right.granted]
    if refused:
        yield f"this computer refused {', '.join(f'{right.wished} (got {right.got})' for right in refused)}"
    yield from dict.fromkeys(right.advice for right in refused if right.advice)


# Proof of the guard of one drive, which was left alone at zero torque.


@dataclass(frozen=True)
class Proof:
    """Measured reaction of a drive whose master fell silent (watchdog proof); times in s."""

    axis: str
    guard: float
    """Time set in the drive watchdog."""
    earliest: float
    """Earliest time at which the watchdog can fire; a drive that is off sooner was switched off by something else."""
    allowed: float
    """Time within which the drive must be off."""
    enabled: float
    """Time from our last write to the last reading of *operation enabled*."""
    off: float | None
    """Time from our last write to the first reading of another state; None: none was read."""
    between: float
    """Longest time between two readings of the state, when this computer is not late."""

    @property
    def holds(self) -> bool:
        """True if the drive was off in time, and not before its watchdog can fire."""
        return self.off is not None and self.earliest <= self.off <= self.allowed

    @property
    def early(self) -> bool:
        """True if the drive was off before its watchdog can fire; this proves nothing about the watchdog."""
        return self.off is not None and self.off < self.earliest

    @property
    def missed(self) -> bool:
        """True if this computer was late and read no state at the decisive time."""
        off = self.off
        return off is not None and self.enabled <= self.allowed < off and off - self.enabled > self.between

    def __str__(self) -> str:
        """Return the outcome in words."""
        asked = f"set to {exactly(1e3 * self.guard)} ms"
        if self.off is None:
            seen = rounded(1e3 * self.enabled)
            return f"axis {self.axis}: drive watchdog did not fire within {seen} ms ({asked})"
        return f"axis {self.axis}: drive watchdog fired after {rounded(1e3 * self.off)} ms ({asked})"

    def to_json(self) -> Json:
        """Return the object of `run --json`; the time is None for a drive that never switched off."""
        measured = None if self.off is None else 1e3 * self.off
        return {"axis": self.axis, "guard_ms": 1e3 * self.guard, "measured_ms": measured}


Array = NDArray[np.float64]
FIGURES = (
    "scene", "drive", "bus", "rate", "clock", "cycles", "missed_cycles", "duration", "bus_load", "torque_error",
    "energy_generated", "travel", "verdict", "trips", "stopped", "changes", "warnings",
)  # fmt: skip
"""Fields in the `repr` of a `Result`; large ones, such as plan and traces, are left out."""
WIDEST = 120
"""Longest line of that text [characters]."""


@dataclass(frozen=True)
class TorqueError:
    """Motor torque through the mechanism minus the ideal torque, of the first axis whose error is known."""

    rms: float
    max: float
    unit: str
    by_source: Mapping[str, float]
    """Share of each source of error; the shares sum to 1."""
    contact: float | None = None
    """Largest rms(error) / rms(ideal) in moving contact of the axes that the hand holds; None without any."""
    contact_s: float = 0.0
    """Time of moving contact for `contact` [s]."""

    def to_json(self) -> Json:
        return {**vars(self), "by_source": dict(self.by_source)}


@dataclass(frozen=True)
class TripRecord:
    """Trip: the reason why the torque was switched off."""

    name: str
    time: float | None
    """Time of the trip [s from *operation enabled*]; None before operation enabled."""
    message: str

    def to_json(self) -> Json:
        return {"name": self.name, "time_s": self.time, "message": self.message}


@dataclass(frozen=True)
class Stopped:
    """The signal that ended a run before its time."""

    signal: str
    """Its name: SIGINT (Ctrl-C), SIGTERM or SIGHUP."""
    time: float | None
    """Time of the end [s from *operation enabled*]; None before operation enabled."""
    duration: float
    """Requested duration of the run [s]."""
    message: str

    def to_json(self) -> Json:
        times = {"time_s": self.time, "duration_s": self.duration}
        return {"signal": self.signal, **times, "message": self.message}


@dataclass(frozen=True)
class Changed:
    """New values by `element.parameter`, and the start of the ramp to them [s from *operation enabled*]."""

    time: float
    settings: Mapping[str, float | str | bool]

    def to_json(self) -> Json:
        return {"t_s": self.time, "settings": dict(self.settings)}


@dataclass(frozen=True, eq=False)
class Trace:
    """Motion and force of one axis in its workspace [s, m or rad, N or N·m], for plots; not part of the JSON object.

    If the error is known, `position` is the true position of the handle, `force` the force of the motor, and `ideal`
    the force of the scene in continuous time. Otherwise (real drives, short runs) `position` is decoded, `force` is
    commanded, and `ideal` is None. `times` and the arrays over it have the shape `(n_times,)`. A simulated run of more
    than 30000 periods is reduced to the extremes of bins, and one that is longer than its fade-in begins after it, as
    the error does. A run on real drives keeps the last 300000 periods.
    """

    axis: str
    workspace: Workspace | None
    """None: a recording without provenance does not tell."""
    times: Array
    position: Array
    force: Array
    ideal: Array | None = None
    sample_times: Array | None = None
    samples: Array | None = None
    """Decoded positions at `sample_times`, both `(n_periods,)`; None if `position` is the decoded position."""
    virtual: Mapping[str, Array] = field(default_factory=dict)
    """First virtual state of each dynamic element by the element's name: the position of a virtual mass."""
    sensor: str = "encoder"
    """Source of the samples: "encoder" or "tachometer"."""
    period: float | None = None
    """Period of the loop [s]; None: the usual distance of the samples."""


@dataclass(frozen=True, eq=False)
class Result:
    """Results of a run at `rate` [Hz]; None or () marks a result that does not apply or is unknown."""

    scene: str
    drive: str
    bus: str
    rate: float
    clock: str | None = None
    cycles: int | None = None
    """Number of periods in *operation enabled*."""
    missed_cycles: int | None = None
    """Number of periods skipped because the loop woke up too late for them."""
    duration: float | None = None
    """Time from *operation enabled* to the end of the last period [s]."""
    bus_load: float | None = None
    """Load of the fullest bus as a share of its capacity: our frames and those of other devices, worst case."""
    plan: Plan | None = None
    timing: Timing | None = None
    torque_error: TorqueError | None = None
    """Torque error; None on real drives, and when the run was shorter than the fade-in."""
    energy_generated: float | None = None
    """Integral of force minus ideal force over the path, summed over the axes [J]; None when the error is unknown."""
    travel: tuple[Travel, ...] = ()
    """Travel and depth of contact of each axis; also present after a trip."""
    stability: Stability | None = None
    trips: tuple[TripRecord, ...] = ()
    stopped: Stopped | None = None
    """Signal that ended the run; None if no signal ended it."""
    changes: tuple[Changed, ...] = ()
    passivity: tuple[Passivity, ...] = ()
    """Results of the energy accounts, one for each axis or each group of coupled axes."""
    verdict: str | None = None
    traces: tuple[Trace, ...] = ()
    warnings: tuple[str, ...] = ()
    """Problems that did not stop the run; for people, not part of the JSON object."""
    recording_fault: str | None = None
    """Reason why the recording ended before the run; None if it is complete or was not requested."""
    proofs: tuple[Proof, ...] = ()
    """Drive watchdogs that were proved before the run."""
    host: tuple[Right, ...] = ()
    """Rights that a run in real time requested from this computer, with the outcome; () in virtual time."""
    periods: PeriodTimes | None = None
    """Lateness and age of each period, for plots; None in virtual time. Not part of the JSON object."""
    elapsed: float | None = None
    """Wall-clock time of the loop [s]; for people, not part of the JSON object."""
    provenance: Provenance | None = None
    """Texts, conditions and versions of the run; `repeat` makes it again."""
    drawing: str = field(default="", repr=False)
    """Module and function that draw the picture; empty for a result that no run has returned."""

    def __repr__(self) -> str:
        """Return the key figures that are known, one a line; a line longer than `WIDEST` is cut."""
        known = [(name, getattr(self, name)) for name in FIGURES if getattr(self, name) not in (None, ())]
        lines = [f"    {name}={value!r}," for name, value in known]
        cut = [line if len(line) <= WIDEST else f"{line[: WIDEST - 1]}…" for line in lines]
        return "\n".join(["Result(", *cut, ")"])

    def plot(self) -> "Figure":
        """Return the picture of the run, which may be changed, shown and saved; raises UsageError without matplotlib.

        `figure.savefig(path, metadata=...)` is the caller's; `run --plot` writes the provenance into the file too.
        """
        require("matplotlib", "plot")
        if not self.drawing or not self.traces:
            raise UsageError("there is nothing to draw: the run has no traces")
        module, _, name = self.drawing.partition(":")
        figure: Figure = getattr(import_module(module), name)(self)
        return figure

    def to_arrow(self, axis: str | None = None) -> "pyarrow.Table":
        """Return the trace of an axis as a table of Arrow: time, position, force, ideal and virtual positions.

        The unit of a column is in the metadata of its field, the provenance in that of the table. `axis` may be left
        out where there is one. Raises UsageError without pyarrow, for a run without traces, and for an unknown axis.
        """
        from haptic_fieldbus.recordings.tables import arrow_table

        names = [trace.axis for trace in self.traces]
        if len(names) != 1 if axis is None else axis not in names:
            known = f"expected one of {', '.join(names)}" if names else "the run has no traces"
            raise UsageError(f"axis {axis}: {known}")
        trace = self.traces[0 if axis is None else names.index(axis)]
        space = trace.workspace
        length, effort = ("", "") if space is None else (space.length_unit, space.effort_unit)
        columns = {"time": trace.times, "position": trace.position, "force": trace.force, "ideal": trace.ideal}
        columns |= {f"{name}.position": position for name, position in trace.virtual.items()}
        units = dict.fromkeys(columns, length) | {"time": "s", "force": effort, "ideal": effort}
        given = {name: values for name, values in columns.items() if values is not None}
        return arrow_table(given, units, self.provenance)

    def to_frame(self, axis: str | None = None) -> "pandas.DataFrame":
        """Return the trace of an axis as a frame of pandas, as `to_arrow`; raises UsageError without pandas."""
        require("pandas", "data")
        return self.to_arrow(axis).to_pandas()

    def _repr_html_(self) -> str:
        """Return figures and picture for a notebook; without matplotlib or traces, the figures alone."""
        from html import escape
        from importlib.util import find_spec

        text = f"<pre>{escape(repr(self))}</pre>"
        if not self.drawing or not self.traces or find_spec("matplotlib") is None:
            return text
        from base64 import b64encode
        from io import BytesIO

        picture = BytesIO()
        self.plot().savefig(picture, format="png")
        encoded = b64encode(picture.getvalue()).decode()
        return f'{text}<img src="data:image/png;base64,{encoded}" alt="picture of the run">'

    def to_json(self) -> dict[str, Json]:
        """Return the object that `run --json` prints; SI units, None for figures that do not apply."""
        return finite(cast(dict[str, Json], object_of(result_rows(self), ORDER)))


def result_rows(result: Result) -> Iterator[OutputRow]:
    """Yield all rows on a run, in the order of its text; unknown figures have no text."""
    plan, timing, error, stability = result.plan, result.timing, result.torque_error, result.stability
    proofs = filter(None, ["; ".join(map(str, result.proofs))])
    yield OutputRow("watchdog", proofs, "guards", [proof.to_json() for proof in result.proofs], cut=True)
    names = ("scene", "drive", "bus", "clock", "cycles")
    yield from (OutputRow(key=name, value=getattr(result, name)) for name in names)
    yield OutputRow(key="rate_hz", value=result.rate)
    yield OutputRow(key="missed_cycles", value=result.missed_cycles)
    yield OutputRow(key="duration_s", value=result.duration)
    yield OutputRow(key="bus_load", value=result.bus_load)
    told = result_text(result)
    yield OutputRow("result", [told] if told else [], cut=True)
    ways = [each.to_json() for each in result.travel]
    yield OutputRow("result", map(travel_text, result.travel), "travel", ways, detail=True)
    yield OutputRow("result", _periods_texts(result), "timing", timing.to_json() if timing else None, detail=True)
    seconds = f"; {error.contact_s:.2g} s of moving contact" if error and error.contact_s else ""
    sizes = [f"{error_sizes(error)}{_sources_text(error)}{seconds}"] if error else []
    yield OutputRow("result", sizes, "torque_error", error.to_json() if error else None, detail=True)
    energy = filter(None, [energy_text(result.energy_generated)])
    yield OutputRow("result", energy, "energy_generated_j", result.energy_generated, detail=True)
    costs = filter(None, map(cost_text, result.passivity))
    yield OutputRow("passivity", costs, "passivity", [each.to_json() for each in result.passivity], detail=True)
    begun = (change_text(change.time, change.settings) for change in result.changes)
    yield OutputRow("changed", begun, "changes", [change.to_json() for change in result.changes], detail=True)
    granted = (right.got for right in result.host if right.granted)
    host = [right.to_json() for right in result.host] or None
    yield OutputRow("host", filter(None, [", ".join(granted)]), "host", host, detail=True)
    yield OutputRow("warning", filter(None, map(forgiven_text, result.passivity)))
    yield OutputRow("warning", refused_texts(result.host))
    yield OutputRow("warning", result.warnings)
    yield OutputRow("verdict", [] if result.verdict is None else [result.verdict], "verdict", result.verdict)
    yield OutputRow(key="plan", value=summary_json(plan) if plan else None)
    judged = stability.to_json() if stability else None
    yield OutputRow(key="limit", value=judged["limit"] if judged else None)
    yield OutputRow(key="stability", value=judged)
    yield OutputRow(key="trips", value=[trip.to_json() for trip in result.trips])
    yield OutputRow(key="stopped", value=result.stopped.to_json() if result.stopped else None)
    yield OutputRow(key="provenance", value=result.provenance.to_json() if result.provenance else None)
    yield OutputRow(key="deadlines", value=[each.to_json() for each in plan.deadlines] if plan else None)


ORDER = (
    "scene", "drive", "bus", "rate_hz", "clock", "cycles", "missed_cycles", "duration_s", "bus_load", "plan", "timing",
    "torque_error", "energy_generated_j", "travel", "stability", "trips", "stopped", "changes", "passivity", "verdict",
    "guards", "host", "deadlines", "limit", "provenance",
)  # fmt: skip
"""Order of the keys of the object, other than the order of the text; new keys come last."""


# A result in words.

WORTH_NAMING = 0.01
"""Smallest share with which a source of error, or of load, is named."""


def result_text(result: Result) -> str:
    """Return periods, end and depth of contact in one line; empty without any period."""
    if not result.cycles:
        return ""
    # Only a run that went to its end has a verdict, so nothing tripped.
    parts = [periods_text(result), *([] if result.verdict is None else ["no trip"])]
    for travel in result.travel:
        deep = ", ".join(_depths(travel))
        parts.append(f"{travel.axis} {deep}" if deep else travel_text(travel))
    return "; ".join(parts)


def _periods_texts(result: Result) -> Iterator[str]:
    """Yield load of the bus, speed of the simulation, and lateness of the periods; nothing without periods."""
    if not result.cycles:
        return
    told = [load_text(result)]
    if result.clock == "virtual" and result.elapsed and result.duration:
        told.append(f"{rounded(result.duration)} s simulated in {rounded(result.elapsed)} s")
    yield from filter(None, ["; ".join(filter(None, told))])
    if result.clock != "virtual" and result.periods is not None and result.timing is not None:
        named = (("late by", result.timing.lateness_us), ("feedback age", result.timing.age_us))
        texts = [f"{name} {_percentiles_text(times)}" for name, times in named if times is not None]
        if texts:
            yield "; ".join(texts)


def travel_text(travel: Travel) -> str:
    """Return the travel of a handle, rounded to perceptible steps, and its depth in each element."""
    most = max(abs(travel.lowest), abs(travel.highest))
    decimals = DIGITS - 1 - math.floor(math.log10(most)) if most else 0
    lowest, highest = (length(round(end, decimals), travel.workspace) for end in (travel.lowest, travel.highest))
    way = f"stayed at {highest}" if lowest == highest else f"from {lowest.partition(' ')[0]} to {highest}"
    return ", ".join([f"{travel.axis} {way}", *_depths(travel)])


def _depths(travel: Travel) -> list[str]:
    """Return the depth of a handle in each element that it touched."""
    deep = {name: length(float(rounded(depth)), travel.workspace) for name, depth in travel.depth.items() if depth}
    return [f"{depth} deep in {name}" for name, depth in deep.items()]


def change_text(time: float, settings: Mapping[str, object]) -> str:
    """Return the time of a change [s from operation enabled] and its new values."""
    texts = {key: exactly(value) if isinstance(value, float) else value for key, value in settings.items()}
    values = [f"{key}={text}" for key, text in texts.items()]
    return f"at {exactly(time)} s {', '.join(values)}"


def periods_text(result: Result) -> str:
    """Return the number of periods, and the numbers of missed and late ones."""
    timing = result.timing
    words = "1 period" if result.cycles == 1 else f"{result.cycles or 0} periods"
    if result.missed_cycles is not None:
        words += f", {result.missed_cycles or 'none'} missed"
    if timing is None or timing.lateness_us is None or not timing.late:
        return words
    return f"{words}, {timing.late} late (max {milliseconds(1e-6 * timing.lateness_us.max)})"


def _percentiles_text(times: Percentiles) -> str:
    """Return the median, two percentiles and the maximum of a time."""
    shares = ((times.p50, "median"), (times.p99, "p99"), (times.p999, "p99.9"), (times.max, "max"))
    return ", ".join(f"{milliseconds(1e-6 * value)} ({share})" for value, share in shares)


def load_text(result: Result) -> str:
    """Return the load of the bus, and a considerable share of other devices; empty if unknown."""
    if result.bus_load is None:
        return ""
    others = result.bus_load - (result.plan.bus_load if result.plan is not None else result.bus_load)
    of_it = f", {percent(others)} by other devices" if others >= WORTH_NAMING else ""
    return f"bus load {percent(result.bus_load)}{of_it}"


def error_sizes(error: TorqueError) -> str:
    """Return rms and largest error with their unit."""
    name = "force" if error.unit == "N" else "torque"
    return f"{name} error {in_unit(error.rms, error.unit)} rms, {in_unit(error.max, error.unit)} max"


def _sources_text(error: TorqueError) -> str:
    """Return the sources with a considerable share in brackets, the largest first; empty when there is none."""
    by_size = sorted(error.by_source.items(), key=lambda item: -abs(item[1]))
    named = [f"{name} {percent(share)}" for name, share in by_size if abs(share) >= WORTH_NAMING]
    return f" ({', '.join(named)})" if named else ""


def energy_text(energy: float | None) -> str:
    """Return the work of the error on the hand [J], added or removed; empty if unknown or 0."""
    if not energy:
        return ""
    return f"the loop {'added' if energy > 0.0 else 'absorbed'} {in_unit(abs(energy), 'J')}"


def length(value: float, workspace: Workspace) -> str:
    """Return a position in the workspace [m or rad], metres shown in millimetres."""
    return f"{exactly(1e3 * value)} mm" if workspace is Workspace.LINEAR else f"{exactly(value)} rad"


def finite(value: dict[str, Json]) -> dict[str, Json]:
    """Return a copy with None in place of infinities and NaN, which JSON does not have."""
    return {key: _finite(member) for key, member in value.items()}


def _finite(value: Json) -> Json:
    if isinstance(value, dict):
        return finite(value)
    if isinstance(value, list):
        return [_finite(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def known_before(
    plan: Plan, bus: str, report: LoopReport | None = None, trip: safety.Trip | None = None, message: str = ""
) -> Result:
    """Return the known figures of a run that has not begun (no report), or ended early by a trip or an error.

    `bus` is the name of the bus, or those of all buses.
    """
    result = Result(plan.scene.name, plan.axes[0].profile.name, bus, plan.rate, bus_load=plan.bus_load, plan=plan)
    result = replace(result, stability=plan.stability)
    if report is None:
        return result
    period, age, compute, lateness = (Percentiles.of(report.sample(name)) for name in SAMPLES)
    foreign = report.foreign_load
    loads = [bus.traffic.load + max(foreign.get(axis, 0.0) for axis in bus.axes) for bus in plan.buses]
    return replace(
        result,
        bus_load=max(loads),
        trips=tuple(_trips(report, trip, message)),
        changes=tuple(Changed(applied.time, applied.change.settings) for applied in report.changes),
        timing=Timing(period, age, compute, lateness, report.late),
        cycles=report.cycles,
        missed_cycles=report.missed,
        duration=report.duration,
        periods=None if plan.simulated else PeriodTimes.of(report),
    )


def _trips(report: LoopReport, trip: safety.Trip | None, message: str) -> Iterator[TripRecord]:
    """Yield the record of a safety trip, or of an error that ended the run in operation enabled; nothing otherwise."""
    begin_ns = report.enabled_at_ns
    if trip is not None:
        yield TripRecord(trip.kind.value, None if begin_ns is None else (trip.t_ns - begin_ns) * 1e-9, message)
    elif message and begin_ns is not None:
        yield TripRecord("bus failed", report.duration, message)
