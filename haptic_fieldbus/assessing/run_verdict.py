"""Verdict on a run in one sentence: does the error stay below the threshold of perception?

People cannot tell two forces apart that differ by less than about 8 % (Jones, "Matching forces: constant errors and
differential thresholds", Perception 18, 1989, doi:10.1068/p180681).

Delay is an error like any other while the handle is in contact: a delayed spring is felt as another stiffness, softer
within the spring and harder across its surface (Pressman et al., "Perception of delayed stiffness", Int. J. Robotics
Research 26, 2007; Nisky, Mussa-Ivaldi & Karniel, "A regression and boundary-crossing-based model for the perception of
delayed stiffness", IEEE Trans. Haptics 1, 2008). The sentence tells the energy that it adds. If force comes
from an event alone, such as a crossing, people notice a delay from about 5.5 ms on ("Vibration feedback latency affects
material perception during rod tapping interactions", IEEE Trans. Haptics 10(2), 2017, 288,
doi:10.1109/TOH.2016.2628900): below this delay, only the error without the delay counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerals import KEY_WIDTH, LINE_WIDTH, percent, rounded
from haptic_fieldbus.planning.limits import FELT_SHARE

LONGEST = LINE_WIDTH - KEY_WIDTH
"""Longest verdict [characters]: it is one line of a run."""
EVENT_DELAY = 0.0055
"""Smallest perceptible delay of an event [s]."""
AVERAGED = 0.05
"""Length of the moving average that separates motion (slower) from ripple (faster) [s]."""
LAST = 0.5
"""Length of the end of the run in which ripple is measured [s]."""
RARE = 1e-3
"""Share of periods below which a limit of the force counts as rare; a rare limit is reported without a figure."""

Array = NDArray[np.float64]


def ripple(force: Array, rate: float) -> float | None:
    """Return the rms of the fast part of the force over its mean, in the last `LAST` seconds of the run.

    `force` has the shape `(n_periods,)`, `rate` is in Hz. None when the run is too short, or without contact in some
    period of that time. It has no meaning for a scene with a force that changes by itself, such as a wave.
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
    """Share of the error; None if the handle was at rest during all contact."""
    shape: float
    """Share of the remaining error when the ideal has the delay of the loop."""
    late: float
    """Delay of the loop in `shape` [s]."""
    seconds: float
    """Time in moving contact [s]."""
    energy: float = 0.0
    """Work of the error on the hand [J]."""
    by_event: bool = False
    """Whether all of the force comes from events (`scenes.element.Abilities.by_event`)."""


ADDED = ", which added"
"""Begin of the clause about the energy of a delay, which gives way where all of it is too long."""


def run_verdict(
    *, scene: str, effort: str, hand: str, stable: bool, inside: bool, felt: FeltError | None, ripple: float | None,
    known: bool = True,
) -> str:  # fmt: skip
    """Return the verdict on a simulated run as one sentence of at most `LONGEST` characters.

    `effort` is "force" or "torque"; `hand` is the name of the simulated hand, empty when there is none; `inside` says
    that the scene is inside its limit; `felt` is that of the worst axis, None without contact; `ripple` is None when
    not measured; an ideal force is not `known` of a scene that uses the torque of the drive.
    """
    if not stable:
        return "Unstable: above the limit of this bench. A hand may damp it; the drive alone cannot."
    above = "" if inside else "; above the limit"
    if felt is None and not known:
        return f"Not judged: the scene uses the torque of the drive, so its ideal is unknown{above}"
    if felt is None:
        return f"No contact in this run: the handle touched nothing{_with(hand)}{above}"
    if felt.contact is None:
        head, noticed, by = "Not judged: the handle did not move during contact", "", _with(hand)
    else:
        head, noticed = _felt(effort, felt, felt.contact)
        by = f', hand "{hand}"' if hand else ""
    chatter = ""
    if ripple is not None and ripple >= FELT_SHARE:
        chatter = f"; the {scene} chatters: {percent(ripple)} ripple"
    # What matters least goes first, when all of it is too long for a line; a warning tells of the limit too.
    rests = (f"{noticed}{by}{chatter}{above}", f"{noticed}{chatter}{above}", f"{chatter}{above}", chatter)
    shortest = f"{head.partition(ADDED)[0]}; chatters"
    return next((f"{head}{rest}" for rest in rests if len(head) + len(rest) <= LONGEST), shortest)


def real_verdict(
    *, effort: str, cut: float, behind: float | None, confirmed: bool = True, rehearsed: bool = False
) -> str:
    """Return the verdict on a run on real drives, from the values of loop and drives alone.

    `cut` is the share of the periods in which the force of the scene was cut, by limit or cap, of the worst axis;
    `behind` is rms(torque actual − target) / rms(target) of the worst axis, among drives that send their torque; None
    without such a drive. `confirmed`: the motor directions were confirmed; until then force is limited in all periods.
    `rehearsed`: the drives are simulated, in real time.
    """
    head = "Rehearsed on a simulated drive" if rehearsed else "Real drive, error unknown"
    limited = f"limited in {percent(cut)} of periods" if cut >= RARE else "rarely limited"
    limited = limited if cut else "never limited"
    parts = [f"{effort} {limited if confirmed else 'limited, because the motor direction is not confirmed'}"]
    if behind is not None and confirmed:  # the torque of pulses says nothing about a force
        parts.append(f"motor torque {percent(behind)} off target")
    return f"{head}: {'; '.join(parts)}"


def _felt(effort: str, felt: FeltError, contact: float) -> tuple[str, str]:
    """Return the error of a run with contact, and the threshold of perception."""
    share, noticed = f"{effort} error {percent(contact)}", f" (people notice from {percent(FELT_SHARE)})"
    if contact < FELT_SHARE:
        return f"Feels right: {share}", noticed
    if felt.shape >= FELT_SHARE:
        return f"Feels different: {share}", noticed
    late = f"{rounded(1e3 * felt.late)} ms"
    if felt.by_event and felt.late <= EVENT_DELAY:
        noticed = f" (people notice from {rounded(1e3 * EVENT_DELAY)} ms and {percent(FELT_SHARE)})"
        return f"Feels right, {late} late: {effort} error {percent(felt.shape)} without the delay", noticed
    millijoules = round(1e3 * felt.energy, 6)
    added = f"{ADDED} {rounded(millijoules)} mJ" if millijoules > 0.0 else ""
    return f"Feels different: {share}, {percent(felt.shape)} without the delay of {late}{added}", noticed


def _with(hand: str) -> str:
    return f' (hand "{hand}")' if hand else ""
