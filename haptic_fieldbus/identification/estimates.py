"""Values with their intervals of 95 %, and the reason where a value cannot be separated from the others.

An added mass checks torque constant, gear and counts in absolute terms.

Theory. With the torque S times as large as it is believed to be, positions that count C times the motion, and a handle
that moves R times as far per radian as the rig says, the fit finds the inertia J/(S·C). A mass m at the handle adds
m·r² to J with the believed ratio r, so it is found q = R²/(S·C) times as large as it is. Only this product is known: it
is 1 if all of them are right, and a usual slip is named by its factor. No motion without a known mass shows any of it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from haptic_fieldbus.numerals import exactly, in_unit, percent, rounded

UNITS = {"inertia": "kg·m²", "viscous_damping": "N·m·s/rad", "coulomb_friction": "N·m", "delay_and_lag": "s",
         "delay": "s", "torque_lag": "s", "load": "N·m"}  # fmt: skip
SEPARATED = {"inertia": 0.1, "viscous_damping": 0.5, "coulomb_friction": 0.5, "delay": 0.5, "torque_lag": 0.5}
"""Half width of an interval, of its value, from which on the value is called not separated."""
DELAY_KNOWN, DELAY_SHARE = 1e-4, 0.1
"""The delay plus lag is known to this time [s], or to this share of it."""
LARGEST_SHARE = 0.3
"""Half width of the interval of the ratio, of its value, up to which it says something."""
SMALLEST_GEAR, LARGEST_GEAR = 2.0, 500.0
"""Ratios of a gear that a rig may leave out; a smaller one is rather a torque that is wrong."""
TOLERANCE = 0.1
"""Share by which a ratio may miss the factor of a slip: masses are weighed, and seldom sit at the very handle."""


@dataclass(frozen=True)
class Estimate:
    """One value with its interval of 95 %."""

    value: float
    low: float
    high: float
    unit: str
    reason: str = ""
    """Why the value cannot be separated; empty if it can."""

    @property
    def half_width(self) -> float:
        """Return half of the width of the interval."""
        return 0.5 * (self.high - self.low)

    def to_json(self) -> dict[str, object]:
        """Return the value with its interval; the reason is null where it can be separated."""
        return {**vars(self), "reason": self.reason or None}


def estimate_of(name: str, value: float, half: float) -> Estimate:
    """Return a value with its interval of this half width, which goes below 0 for a load alone."""
    lowest = -math.inf if name == "load" else 0.0
    return Estimate(value, max(value - half, lowest), value + half, UNITS.get(name, ""))


def with_reasons(estimates: Mapping[str, Estimate], top: float) -> dict[str, Estimate]:
    """Return values with the reasons of those that cannot be separated; `top` is the top speed [rad/s]."""
    return {name: replace(each, reason=reason_of(name, estimates, top)) for name, each in estimates.items()}


def reason_of(name: str, estimates: Mapping[str, Estimate], top: float) -> str:
    """Return why a value cannot be separated from the others; empty if it can. `top` is the top speed [rad/s]."""
    width, value = estimates[name].half_width, estimates[name].value
    if name == "delay_and_lag":
        known = max(DELAY_KNOWN, DELAY_SHARE * value)
        return "" if width <= known else "the fast part of the motion was too small beside one count of the encoder"
    if name not in SEPARATED or width <= SEPARATED[name] * value:
        return ""
    if name == "viscous_damping":
        friction, at_top = estimates["coulomb_friction"].value, f"at the top speed of {in_unit(top, 'rad/s')}"
        if value * top < friction:
            share = rounded(100.0 * value * top / friction)
            return f"friction hides it: {at_top} it is {share} % of the Coulomb friction"
        return f"its torque {at_top} is too small beside the torque that the inertia takes"
    if name in ("delay", "torque_lag"):
        both = exactly(round(1e3 * estimates["delay_and_lag"].value, 3))
        return f"delay and lag act alike at the frequencies of the motion; together they are {both} ms"
    if name == "coulomb_friction":
        return "it is small beside the torques of the experiment"
    return "the motion was too small beside one count of the encoder"


# The check by an added mass.


@dataclass(frozen=True)
class ScaleCheck:
    """How many times as large as it is an added inertia was measured."""

    ratio: Estimate
    gear: float | None
    """Gear ratio of the rig; None for a linear mechanism."""

    @property
    def is_known(self) -> bool:
        """Return whether the added inertia was measured well enough."""
        return 0.0 < self.ratio.half_width <= LARGEST_SHARE * self.ratio.value

    @property
    def is_right(self) -> bool:
        """Return whether torque, gear and counts agree with the added mass."""
        return self.is_known and self._is(1.0)

    def _is(self, factor: float) -> bool:
        ratio = self.ratio
        return ratio.low <= factor <= ratio.high or abs(ratio.value / factor - 1.0) <= TOLERANCE

    def _slips(self) -> Iterator[tuple[float, str]]:
        """Yield factors of the ratio, each with the slip that makes it."""
        yield 0.25, "encoder_counts_per_revolution states lines; it is four times as many counts"
        yield 4.0, "encoder_counts_per_revolution is four times too large; it may be lines that were multiplied twice"
        yield (
            1e-3,
            (
                "rated_torque or torque_constant is a thousand times too small, as mN·m divided twice, or the mass was "
                "given in g or g·m²"
            ),
        )
        yield 1e3, "rated_torque or torque_constant states mN·m for N·m; it is a thousandth"
        if self.gear is not None and not math.isclose(self.gear, 1.0):
            yield self.gear**4, f"mechanism.gear_ratio is the wrong way round; it is {exactly(1.0 / self.gear)}"
            yield self.gear**2, "mechanism.gear_ratio states a gear that is not between motor and handle; it is 1"

    def _others(self) -> Iterator[str]:
        """Yield what any ratio can be."""
        torque = 1.0 / self.ratio.value
        yield f"if gear and counts are right, the motor gives {rounded(torque, 2)} times the stated torque"
        gear = math.sqrt(torque)
        if self.gear == 1.0 and SMALLEST_GEAR <= gear <= LARGEST_GEAR:
            yield f"mechanism.gear_ratio leaves out a gear; it is {rounded(gear, 2)}"

    def text(self) -> str:
        """Return the result in one sentence."""
        if self.ratio.low <= 0.0 < self.ratio.half_width <= LARGEST_SHARE:
            return "the added mass was not seen; check that it is fixed to the handle"
        if not self.is_known:
            return "the added mass was too small beside the inertia of the bench to tell anything; add a larger one"
        spread = percent(self.ratio.half_width / self.ratio.value)
        found = f"the added mass was measured {rounded(self.ratio.value)} times as large as it is (± {spread})"
        if self.is_right:
            return f"{found}: torque, gear and counts of the rig agree with it"
        named = [slip for factor, slip in self._slips() if self._is(factor)] or self._others()
        return f"{found}: {'; or '.join(named)}"

    def to_json(self) -> dict[str, object]:
        """Return the ratio with its interval, and what it says; the ratio is null where it is not known."""
        each = self.ratio
        value, low, high = (each.value, each.low, each.high) if self.is_known else (None, None, None)
        return {"ratio": value, "low": low, "high": high, "right": self.is_right, "text": self.text()}


def scale_check(without: Estimate, with_mass: Estimate, known: float, gear: float | None) -> ScaleCheck:
    """Return the check from the inertia without and with the added one; all at the motor shaft [kg·m²]."""
    ratio = (with_mass.value - without.value) / known
    half = math.hypot(without.half_width, with_mass.half_width) / known
    return ScaleCheck(Estimate(ratio, ratio - half, ratio + half, ""), gear)
