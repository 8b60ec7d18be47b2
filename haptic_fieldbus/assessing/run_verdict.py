"""Verdict on a run in one sentence: does the error stay below the threshold of perception?

People cannot tell two forces apart that differ by less than about 8 % (Jones, "Matching forces: constant errors and
differential thresholds", Perception 18, 1989, doi:10.1068/p180681).
"""

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerals import percent

JUST_NOTICEABLE = 0.08
"""Smallest difference of forces that a hand can tell, as a share of the force."""
AVERAGED = 0.05
"""Length of the moving average that separates motion (slower) from ripple (faster) [s]."""
LAST = 0.5
"""Length of the end of the run in which ripple is measured [s]."""

Array = NDArray[np.float64]


def ripple(force: Array, rate: float) -> float | None:
    """Return the rms of the fast part of the force over its mean, in the last `LAST` seconds of the run.

    `force` has the shape `(n_periods,)`, `rate` is in Hz. None when the run is too short, or without contact in some
    period of that time. It has no meaning for a scene whose force moves by itself, such as a wave.
    """
    last = force[-round(LAST * rate) :]
    window = max(1, round(AVERAGED * rate))
    if len(last) <= window or not last.all():
        return None
    slow = np.convolve(last, np.full(window, 1.0 / window), mode="valid")
    # "valid" keeps full windows only: value i of `slow` belongs to the centre of its window, `window // 2` later.
    middle = last[window // 2 : window // 2 + len(slow)]
    return float(np.sqrt(np.mean((middle - slow) ** 2)) / np.abs(slow).mean())


def run_verdict(
    *, scene: str, effort: str, stable: bool, contact: float | None, ripple: float | None, missed: int
) -> str:
    """Return the verdict on a simulated run as one sentence.

    `effort` is "force" or "torque"; `contact` is rms(error) / rms(ideal) in contact, None without contact; `ripple` is
    None when not measured; `missed` counts the periods skipped.
    """
    if not stable:
        return f"Unstable: a {scene} beyond this bench's limit, which a hand may hold down but not the drive alone."
    if contact is None:
        return "The handle met nothing: no contact in this run."
    parts = [_felt(scene, effort, contact)]
    if ripple is not None:
        parts.append("no chatter" if ripple < JUST_NOTICEABLE else f"it chatters: {percent(ripple)} ripple")
    if missed:
        parts.append(f"{missed} periods missed")
    return "; ".join(parts) + "."


def _felt(scene: str, effort: str, contact: float) -> str:
    # Two digits; from 100 % on whole percents, since ".2g" would turn to an exponent.
    share = f"error {percent(contact)} of the {effort}"
    limit = f"the {percent(JUST_NOTICEABLE)} a hand can tell"
    if contact < JUST_NOTICEABLE:
        return f"Feels like the ideal {scene}: {share}, below {limit}"
    return f"Feels different from the ideal {scene}: {share}, above {limit}"
