"""One sentence on how a run felt, judged by what a hand can tell.

A hand does not tell forces apart that differ by less than about 8 % (Jones, "Matching forces: constant errors and
differential thresholds", Perception 18, 1989, doi:10.1068/p180681).
"""

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerals import percent

JUST_NOTICEABLE = 0.08
"""Share of a force."""
AVERAGED = 0.05
"""[s]; what is slower than this is motion, what is faster is ripple."""
LAST = 0.5
"""[s] of the run in which chatter is looked for."""

Array = NDArray[np.float64]


def ripple(force: Array, rate: float) -> float | None:
    """Rms of the fast part of the force over its mean, at the end of the run; None when there was no contact then.

    Not asked of a scene whose force moves by itself, a wave: what is fast there is meant.
    """
    last = force[-round(LAST * rate) :]
    window = max(1, round(AVERAGED * rate))
    if len(last) <= window or not last.all():
        return None
    slow = np.convolve(last, np.full(window, 1.0 / window), mode="valid")
    middle = last[window // 2 : window // 2 + len(slow)]
    return float(np.sqrt(np.mean((middle - slow) ** 2)) / np.abs(slow).mean())


def run_verdict(
    *, scene: str, effort: str, stable: bool, contact: float | None, ripple: float | None, missed: int
) -> str:
    """The sentence; `contact` is rms(error) / rms(ideal) in contact, None without contact; `effort` force or torque."""
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
    share = f"error {percent(contact)} of the {effort}"
    limit = f"the {percent(JUST_NOTICEABLE)} a hand can tell"
    if contact < JUST_NOTICEABLE:
        return f"Feels like the ideal {scene}: {share}, below {limit}"
    return f"Feels different from the ideal {scene}: {share}, above {limit}"
