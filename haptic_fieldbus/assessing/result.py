"""What a run gives back: figures for people and programs, and the traces that a plot shows.

A result may be partial: of a refused or tripped run it holds what is known by then, and `None` for the rest.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_fieldbus.cycle import safety
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import Selection
from haptic_fieldbus.protocols.registry import TRAFFIC_KEYS
from haptic_fieldbus.protocols.traffic import Json as Json
from haptic_fieldbus.signals import Workspace

if TYPE_CHECKING:  # a plan without a run does without it
    from haptic_fieldbus.assessing.loop_report import LoopReport

Array = NDArray[np.float64]
FIGURES = (
    "scene", "drive", "bus", "rate", "clock", "cycles", "missed_cycles", "duration", "bus_load", "torque_error",
    "energy_generated", "verdict", "trips", "changes", "warnings",
)  # fmt: skip
"""The fields of a `Result` that it shows of itself."""
WIDEST = 120


@dataclass(frozen=True)
class Percentiles:
    """How a time is distributed [µs]."""

    p50: float
    p99: float
    p999: float
    max: float

    @classmethod
    def of(cls, values_ns: ArrayLike) -> "Percentiles | None":
        """Of durations [ns], shape (n,); None when there are none."""
        values = np.asarray(values_ns, dtype=float)
        if values.size == 0:
            return None
        p50, p99, p999, largest = np.percentile(values, [50, 99, 99.9, 100]) / 1e3
        return cls(float(p50), float(p99), float(p999), float(largest))

    def to_json(self) -> Json:
        return {"p50": self.p50, "p99": self.p99, "p999": self.p999, "max": self.max}


@dataclass(frozen=True)
class Timing:
    """Period as run, age of the feedback when it was used, and the host's computing time, which never acts [µs]."""

    period_us: Percentiles | None
    age_us: Percentiles | None
    compute_us: Percentiles | None

    def to_json(self) -> Json:
        return {
            "period_us": self.period_us.to_json() if self.period_us else None,
            "age_us": self.age_us.to_json() if self.age_us else None,
            "compute_us": self.compute_us.to_json() if self.compute_us else None,
        }


@dataclass(frozen=True)
class TorqueError:
    """Motor torque through the mechanism minus the ideal; `by_source` are shares that sum to 1.

    `contact` is rms(error in contact) / rms(ideal in contact), what the verdict goes by; None without contact.
    """

    rms: float
    max: float
    unit: str
    by_source: Mapping[str, float]
    contact: float | None = None

    def to_json(self) -> Json:
        return {"rms": self.rms, "max": self.max, "unit": self.unit, "by_source": dict(self.by_source)}


@dataclass(frozen=True)
class TripRecord:
    """Why and when [s since *operation enabled*] torque was taken away."""

    name: str
    time: float | None
    message: str

    def to_json(self) -> Json:
        return {"name": self.name, "time_s": self.time, "message": self.message}


@dataclass(frozen=True)
class Changed:
    """New values of the scene, and when the ramp to them began [s since *operation enabled*]."""

    time: float
    settings: Mapping[str, float | str | bool]

    def to_json(self) -> Json:
        return {"t_s": self.time, "settings": dict(self.settings)}


@dataclass(frozen=True, eq=False)
class Trace:
    """One axis of a run in its workspace [s, m or rad, N or N·m], for plots; not part of the JSON object.

    Shapes: times, position, force, ideal and each of `virtual` (n,); sample_times and samples (m,).
    Simulated: `position` is the true handle, `force` the motor's, `ideal` the scene in continuous time.
    Real hardware: `position` is what the encoder says, `force` what was asked of the drive, `ideal` unknown.
    """

    axis: str
    workspace: Workspace
    times: Array
    position: Array
    force: Array
    ideal: Array | None = None
    sample_times: Array | None = None
    samples: Array | None = None
    """The sensor's value at each period, held until the next."""
    virtual: Mapping[str, Array] = field(default_factory=dict)
    """Positions of virtual masses by the name of their element."""
    sensor: str = "encoder"


@dataclass(frozen=True, eq=False)
class Result:
    """What a run was and how well it went: rate in Hz, duration in s from *operation enabled*, energy in J."""

    scene: str
    drive: str
    bus: str
    rate: float
    clock: str | None = None
    cycles: int | None = None
    missed_cycles: int | None = None
    duration: float | None = None
    bus_load: float | None = None
    plan: Plan | None = None
    timing: Timing | None = None
    torque_error: TorqueError | None = None
    energy_generated: float | None = None
    stability: Stability | None = None
    trips: tuple[TripRecord, ...] = ()
    changes: tuple[Changed, ...] = ()
    verdict: str | None = None
    traces: tuple[Trace, ...] = ()
    warnings: tuple[str, ...] = ()
    """What went wrong without stopping anything; for people, not part of the JSON object."""
    elapsed: float | None = None
    """Wall-clock time that the loop took [s]; for people, not part of the JSON object."""

    def __repr__(self) -> str:
        """The key figures that are known, one a line; a long line is cut."""
        known = [(name, getattr(self, name)) for name in FIGURES if getattr(self, name) not in (None, ())]
        lines = [f"    {name}={value!r}," for name, value in known]
        cut = [line if len(line) <= WIDEST else f"{line[: WIDEST - 1]}…" for line in lines]
        return "\n".join(["Result(", *cut, ")"])

    def to_json(self) -> dict[str, Json]:
        """The object that `run --json` prints: keys as documented, SI units, None for what does not apply."""
        return finite(
            {
                "scene": self.scene,
                "drive": self.drive,
                "bus": self.bus,
                "rate_hz": self.rate,
                "clock": self.clock,
                "cycles": self.cycles,
                "missed_cycles": self.missed_cycles,
                "duration_s": self.duration,
                "bus_load": self.bus_load,
                "plan": _summary_json(self.plan) if self.plan else None,
                "timing": self.timing.to_json() if self.timing else None,
                "torque_error": self.torque_error.to_json() if self.torque_error else None,
                "energy_generated_j": self.energy_generated,
                "stability": cast(Json, self.stability.to_json()) if self.stability else None,
                "trips": [trip.to_json() for trip in self.trips],
                "changes": [change.to_json() for change in self.changes],
                "verdict": self.verdict,
            }
        )


def plan_json(plan: Plan) -> dict[str, Json]:
    """The object that `plan --json` prints; delays in s."""
    delay = plan.delay
    return {
        **_summary_json(plan),
        **_traffic_json(plan),
        "bus_load": plan.bus_load,
        "delay_s": {
            "bus": delay.bus,
            "compute": delay.compute,
            "drive": delay.drive,
            "torque_loop": delay.torque_loop,
            "total": delay.total,
        },
        "couplings": [
            {"name": each.name, "age_s": {on: dict(ages) for on, ages in each.ages.items()}}
            for each in plan.coupling_ages
        ],
        "modules": list(plan.modules),
    }


def _summary_json(plan: Plan) -> dict[str, Json]:
    return {
        "mapped": list(plan.mapped),
        "left_out": [{"what": left_out.what, "why": left_out.why} for left_out in plan.left_out],
    }


def _traffic_json(plan: Plan) -> dict[str, Json]:
    """What is exchanged, by the keys of the protocols; null where no axis speaks one of ours."""
    found: dict[str, Json] = dict.fromkeys(TRAFFIC_KEYS.values())
    for axis in plan.axes:
        for key, rows in axis.traffic.to_json(axis.rig.bus).items():
            before = found.get(key)
            found[key] = [*(before if isinstance(before, list) else ()), *rows]
    return found


def finite(value: dict[str, Json]) -> dict[str, Json]:
    """The same with None where a number is infinite or not a number: JSON has neither."""
    return {key: _finite(member) for key, member in value.items()}


def _finite(value: Json) -> Json:
    if isinstance(value, dict):
        return finite(value)
    if isinstance(value, list):
        return [_finite(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def known_before(
    selection: Selection, report: "LoopReport | None" = None, trip: safety.Trip | None = None, message: str = ""
) -> Result:
    """The result of a run that has not begun, or that ended early."""
    plan = selection.plan
    result = Result(
        scene=plan.scene.name,
        drive=plan.axes[0].profile.name,
        bus=selection.bus.text,
        rate=plan.rate,
        bus_load=plan.bus_load,
        plan=plan,
        stability=plan.stability,
    )
    if report is None:
        return result
    return replace(
        result,
        trips=tuple(_trips(report, trip, message)),
        changes=tuple(Changed(applied.time, applied.change.settings) for applied in report.changes),
        timing=_timing(report),
        cycles=report.cycles,
        missed_cycles=report.missed,
        duration=report.duration,
    )


def _trips(report: "LoopReport", trip: safety.Trip | None, message: str) -> Iterator[TripRecord]:
    """A trip of ours, or a bus that died while torque was on."""
    begin_ns = report.enabled_at_ns
    if trip is not None:
        yield TripRecord(trip.kind.value, None if begin_ns is None else (trip.t_ns - begin_ns) * 1e-9, message)
    elif message and begin_ns is not None:
        yield TripRecord("bus failed", report.duration, message)


def _timing(report: "LoopReport") -> Timing:
    return Timing(
        period_us=Percentiles.of(report.sample("period_ns")),
        age_us=Percentiles.of(report.sample("age_ns")),
        compute_us=Percentiles.of(report.sample("compute_ns")),
    )
