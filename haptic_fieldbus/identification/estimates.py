"""Values with their intervals of 95 %, and the reason where a value cannot be separated from the others."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from haptic_fieldbus.numerals import exactly, in_unit, rounded

UNITS = {"inertia": "kg·m²", "viscous_damping": "N·m·s/rad", "coulomb_friction": "N·m", "delay_and_lag": "s",
         "delay": "s", "torque_lag": "s", "load": "N·m"}  # fmt: skip
SEPARATED = {"inertia": 0.1, "viscous_damping": 0.5, "coulomb_friction": 0.5, "delay": 0.5, "torque_lag": 0.5}
"""Half width of an interval, of its value, from which on the value is called not separated."""
DELAY_KNOWN, DELAY_SHARE = 1e-4, 0.1
"""The delay plus lag is known to this time [s], or to this share of it."""


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
