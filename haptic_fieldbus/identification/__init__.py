"""Measurement of a bench: two experiments, and the fit of a shaft to a record."""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace

from haptic_fieldbus.identification.estimates import Estimate, ScaleCheck
from haptic_fieldbus.identification.fit import ShaftFit
from haptic_fieldbus.identification.shaft import ShaftRecord
from haptic_fieldbus.numerals import in_unit, percent, rounded, with_interval
from haptic_fieldbus.signals import Workspace

NOTICED = 0.01
"""Further torques are told from this share of friction and damping at top speed on: rounding to counts looks like
less."""
GUARDED = 0.9
"""Share of the announced speed at which a run trips, and that an experiment plans with: a speed is seen late."""
NOT_CHECKED = (
    "not checked: a wrong torque constant, gear or number of counts makes the values wrong, and no motion shows it; "
    "fix a known mass to the handle and repeat with --with-mass or --with-inertia"
)
"""Told without an added mass."""


@dataclass(frozen=True)
class Announcement:
    """Largest motion and effort of both experiments, in the workspace of the axis."""

    axis: str
    low: float
    high: float
    """Travel [m or rad]."""
    speed: float
    """Largest speed of the handle [m/s or rad/s]; a run trips below it."""
    effort: float
    torque: float
    """The effort at the motor shaft [N·m]."""
    workspace: Workspace
    share: float
    """Effort as a share of rated effort."""
    pulses: float
    """Largest effort of the pulses that test the motor direction before each run; 0: it is known."""
    from_start: bool
    """True: the travel is counted from the position of the handle at enabling."""
    skipped: Collection[str] = ()
    """Names of `experiment.PARTS` that are left out."""

    @property
    def guarded_speed(self) -> float:
        """Speed at which a run trips [m/s or rad/s]."""
        return GUARDED * self.speed

    def lines(self) -> Iterator[str]:
        """Yield what will move, how far, how fast and how strongly."""
        length, effort = self.workspace.length_unit, self.workspace.effort_unit
        low, high, back = (in_unit(each, length) for each in (self.low, self.high, -self.low))
        place = f"from where it is; put it where it can go {back} back and {high} ahead"
        begin = place if self.from_start else "by the rig's zero"
        yield f"axis {self.axis}: the handle moves by itself, from {low} to {high} {begin}; keep hands off"
        most = f"{in_unit(self.effort, effort)} ({percent(self.share)} of rated torque)"
        yield f"at most {most} and {in_unit(self.guarded_speed, f'{length}/s')}; beyond these the motor is switched off"
        if self.pulses:
            yield (
                f"before that, pulses of up to {in_unit(self.pulses, effort)} test the motor direction, as in every "
                "run; they grow until the handle moves, and how fast and how far is not known beforehand; beyond the "
                "travel the motor is switched off"
            )
        parts = {"rest": "rest", "friction": "slow pushes until it moves", "dynamics": "short pulses"}
        yield f"first run: {', '.join(told for part, told in parts.items() if part not in self.skipped)}"
        if "dynamics" not in self.skipped:
            yield "second run: slow motion with small oscillations"


@dataclass(frozen=True)
class IdentifiedBench:
    """The measured values of an axis, and what they rest on."""

    announced: Announcement
    rate: float
    """[Hz]"""
    stated: Mapping[str, float | None]
    """Values of the rig."""
    records: tuple[ShaftRecord, ...] = field(default=(), repr=False)
    """Records of probe and motion, and the part of the motion that was not used in the fit."""
    breakaway: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Bounds of the torque at which the handle began to move, by its direction [N·m]; empty where it was skipped."""
    warnings: tuple[str, ...] = ()
    fit: ShaftFit | None = None
    """None where dynamics were skipped."""
    check: float | None = None
    """Prediction error of the part of the record that the fit did not use [counts, rms]."""
    scale: ScaleCheck | None = None
    """Check by an added mass; None without one."""
    limit: tuple[float, str, str] | None = None
    """Largest stable stiffness of a wall on the measured bench, its unit and its basis; None where none is known."""
    written: str = ""
    """File of the rig into which the values were written; empty if they were not."""

    def with_warnings(self, *told: str) -> "IdentifiedBench":
        """Return the result with further warnings."""
        return replace(self, warnings=(*self.warnings, *told))

    def to_json(self) -> dict[str, object]:
        """Return the object of `identify --json`."""
        told, fit, model = self.announced, self.fit, self.fit and self.fit.model
        estimates = dict(fit.values) if fit else {}
        for way, (low, high) in self.breakaway.items():
            estimates[f"breakaway_{way}"] = Estimate(0.5 * (low + high), low, high, "N·m")
        if fit and fit.resonance:
            estimates["resonance"] = fit.resonance
        waves = noticed_waves(fit) if fit else ()
        return {
            "axis": told.axis,
            "values": {name: each.to_json() | {"stated": self.stated.get(name)} for name, each in estimates.items()},
            "stribeck": {"torque": model.stribeck, "speed": model.stribeck_speed} if model and model.stribeck else None,
            "waves": [{"order": order, "cosine": cosine, "sine": sine} for order, cosine, sine in waves],
            "rate_hz": self.rate, "travel": [told.low, told.high], "speed": told.speed, "effort": told.effort,
            "torque": told.torque,
            "limit": None if self.limit is None else dict(zip(("value", "unit", "basis"), self.limit, strict=True)),
            "residual": {"fit": fit.residual, "check": self.check, "unit": "counts"} if fit else None,
            "samples": fit.samples if fit else 0,
            "scale": None if self.scale is None else self.scale.to_json(),
            "warnings": list(self.warnings), "written": self.written or None,
        }  # fmt: skip


def _noticed(fit: ShaftFit) -> float:
    """Return the least torque beside friction and damping that people are told [N·m]."""
    return NOTICED * (fit.model.coulomb + fit.model.damping * fit.top_speed)


def noticed_waves(fit: ShaftFit) -> list[tuple[float, float, float]]:
    """Return the torques that repeat with the angle and that people are told."""
    return [each for each in fit.model.waves if math.hypot(*each[1:]) > _noticed(fit)]


def further_texts(fit: ShaftFit) -> Iterator[str]:
    """Yield what acts on the shaft beside Coulomb friction and damping, in words."""
    model, waves, load, least = fit.model, noticed_waves(fit), fit.values["load"], _noticed(fit)
    if is_falling := model.stribeck > least:
        speed = in_unit(model.stribeck_speed, "rad/s")
        yield f"{in_unit(model.stribeck, 'N·m')} more friction at rest (Stribeck), which fades at {speed}"
    for order, cosine, sine in waves:
        yield f"{in_unit(math.hypot(cosine, sine), 'N·m')} of cogging or weight, {rounded(order)} times a turn"
    if is_loaded := max(load.low, -load.high) > least:
        side = "positive" if load.value > 0.0 else "negative"
        yield f"{in_unit(abs(load.value), 'N·m')} of constant load, such as a weight, towards {side} positions"
    if not (is_falling or waves or is_loaded):
        yield f"nothing else seen above the {rounded(fit.residual)} counts that the fit leaves"


def interval_text(each: Estimate) -> str:
    """Return a value with its interval of 95 %."""
    return with_interval(each.value, each.low, each.high, each.unit)
