"""An estimate from a signal in words, as lines of a key and a text."""

import numpy as np

from haptic_fieldbus.api.estimation import INTEGRATION, Array, Estimation
from haptic_fieldbus.numerals import in_unit, percent, rounded
from haptic_fieldbus.report.words import Line

UNEVEN = 0.01
"""Deviation of the times between two rows from which they are called uneven, as a share."""


def estimate_lines(found: Estimation, file: str) -> list[Line]:
    """Return lines on the signal, the estimate, and noise, delay and drift of the estimator."""
    signal, estimate = found.signal, found.estimate
    duration = float(signal.times[-1] - signal.times[0])
    sampled = f"{len(signal.times)} rows, {rounded(duration)} s at {rounded(1.0 / found.period, 6)} Hz"
    uneven = f", up to {percent(found.unevenness)} of a period early or late" if found.unevenness > UNEVEN else ""
    return [
        ("signal", f"{file}: {_range(signal.quantity, signal.values)}, in steps of {rounded(found.resolution)}"),
        ("", f"{sampled}{uneven}"),
        ("estimator", found.estimator),
        ("result", _range(estimate.quantity, estimate.values)),
        ("noise", _noise(found)),
        ("delay", _delay(found)),
        ("drift", _drift(found, duration)),
    ]


def _range(name: str, values: Array) -> str:
    return f"{name} {rounded(float(np.min(values)))} to {rounded(float(np.max(values)))}"


def _noise(found: Estimation) -> str:
    gain = found.estimate.noise_gain
    if gain is None:
        return "no figure: the estimator is not linear, and what it does to noise depends on the motion"
    amplified = f"white noise of 1 in {found.signal.quantity} is {rounded(gain)} in {found.estimate.quantity}"
    return f"gain {rounded(gain)}: {amplified}" + (" at the end" if found.estimator == INTEGRATION else "")


def _delay(found: Estimation) -> str:
    delay = found.estimate.delay
    if delay is None:
        return "no figure: it depends on the motion"
    if not delay:
        return "none of slow changes"
    return f"{in_unit(delay, 's')}, {rounded(delay / found.period)} periods: a slow change of velocity is seen so late"


def _drift(found: Estimation, duration: float) -> str:
    drift = found.estimate.drift
    if drift is None:
        return "none: what happened is forgotten"
    if not drift:
        return "none of readings without steps; an offset in velocity adds up all the same"
    wrong = f"of readings rounded to their step, each wrong by up to {rounded(0.5 * found.resolution)}"
    return (
        f"up to {rounded(drift)} in {rounded(duration)} s {wrong}; rounded down they fall short by so much on average"
    )
