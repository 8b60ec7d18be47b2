"""Verdict on a run in one sentence: does the error stay below the threshold of perception?

People cannot tell two forces apart that differ by less than about 8 % (Jones, "Matching forces: constant errors and
differential thresholds", Perception 18, 1989, doi:10.1068/p180681).

Delay is an error like any other while the handle is in contact: a spring that comes late is felt as another stiffness,
softer within the spring and harder across its surface (Pressman et al., "Perception of delayed stiffness", Int. J.
Robotics Research 26, 2007; Nisky, Mussa-Ivaldi & Karniel, "A regression and boundary-crossing-based model for the
perception of delayed stiffness", IEEE Trans. Haptics 1, 2008). It also gives the hand energy, which the sentence tells.
Where force comes from an event alone, as from a crossing, people notice a delay from about 5.5 ms on ("Vibration
feedback latency affects material perception during rod tapping interactions", IEEE Trans. Haptics 10(2), 2017, 288,
doi:10.1109/TOH.2016.2628900): until then the error counts that is left beside the delay.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.planning.limits import FELT_SHARE

EVENT_DELAY = 0.0055
"""Delay of an event from which a hand notices it [s]."""
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


@dataclass(frozen=True)
class FeltError:
    """Felt error of one axis: shares of the rms of the ideal force, over the time in moving contact."""

    contact: float | None
    """Of the error; None when the handle rested all the time that it was in contact."""
    shape: float
    """Of what is left of the error when the ideal is delayed as the loop is."""
    late: float
    """That delay [s]."""
    seconds: float
    """Time in moving contact [s]."""
    added: float = 0.0
    """Energy that the motor gave the hand beyond the ideal [J]."""
    by_event: bool = False
    """Whether all of the force comes from events (`scenes.element.Abilities.by_event`)."""


def run_verdict(
    *,
    scene: str,
    effort: str,
    hand: str,
    stable: bool,
    inside: bool,
    felt: FeltError | None,
    ripple: float | None,
    missed: int,
) -> str:
    """Return the verdict on a simulated run as one sentence.

    `effort` is "force" or "torque"; `hand` is the name of the simulated hand, empty when there is none; `inside` says
    that the scene is inside its limit; `felt` is that of the worst axis, None without contact; `ripple` is None when
    not measured; `missed` counts the periods skipped.
    """
    if not stable:
        return f"Unstable: the {scene} exceeds the limit of this bench. A hand may damp it; the drive alone cannot."
    if felt is None:
        return f"No contact in this run: the handle touched nothing{_with(hand)}."
    if felt.contact is None:
        parts = [f"Not judged: the handle did not move while the {scene} acted{_with(hand)}"]
    else:
        parts = [_felt(effort, hand, felt, felt.contact)]
    if ripple is not None:
        parts.append("no chatter" if ripple < FELT_SHARE else f"the {scene} chatters: {percent(ripple)} ripple")
    if missed:
        parts.append(f"{missed} periods missed")
    if not inside:
        parts.append(f"the {scene} exceeds the limit of this bench")
    return "; ".join(parts) + "."


def real_verdict(*, effort: str, in_time: float, cut: float, behind: float | None, rehearsed: bool = False) -> str:
    """Return the verdict on a run on real drives, of which only what the loop and the drives tell is known.

    `in_time` is the share of the periods that began in time; `cut` that in which the force of the scene was cut, by
    limit or cap, of the worst axis; `behind` is rms(torque actual − target) / rms(target) of the worst axis whose drive
    tells its torque, None when none does. `rehearsed` says that the drives are simulated, in real time.
    """
    real = f"Rendered on a real drive: the true {effort} error is unknown"
    parts = [
        f"{'Rehearsed on a simulated drive' if rehearsed else real}; {percent(in_time)} of the periods started on time",
        f"the {effort} was " + (f"limited in {percent(cut)} of the periods" if cut else "never limited"),
    ]
    if behind is not None:
        parts.append(f"the torque in the drive differs from its target by {percent(behind)}")
    return "; ".join(parts) + "."


def _felt(effort: str, hand: str, felt: FeltError, contact: float) -> str:
    share, limit = f"{effort} error {percent(contact)}", f"(people notice from {percent(FELT_SHARE)})"
    moved = f"{felt.seconds:.2g} s of moving contact"
    where = f', hand "{hand}", {moved}' if hand else f", {moved}"
    if contact < FELT_SHARE:
        return f"Feels right: {share} {limit}{where}"
    late = f"{rounded(1e3 * felt.late)} ms"
    added = f"the loop {'added' if felt.added >= 0.0 else 'absorbed'} {rounded(1e3 * abs(felt.added))} mJ"
    if felt.shape >= FELT_SHARE:
        return f"Feels different: {share} {limit}{where}; {added}"
    if felt.by_event and felt.late <= EVENT_DELAY:
        noticed = f"{late} late (people notice from {rounded(1e3 * EVENT_DELAY)} ms)"
        return f"Feels right, {noticed}: {share}, {percent(felt.shape)} without the delay {limit}{where}; {added}"
    return f"Feels different: {share}, {percent(felt.shape)} without the delay of {late} {limit}{where}; {added}"


def _with(hand: str) -> str:
    return f' (hand "{hand}")' if hand else ""
