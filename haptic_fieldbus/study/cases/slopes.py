"""Case of contacts with a position-dependent slope: a body that stiffens with depth, and hilltops of detents."""

import math

from haptic_fieldbus import Stability, Verdict
from haptic_fieldbus.margins import Group, Member, Plant
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.study.case import CaseResult, share_used
from haptic_fieldbus.study.oracles import energies, events
from haptic_fieldbus.study.oracles.contact import growth_in_contact, limit_in_contact

PERIOD, DELAY, LAG = 1e-3, 0.3e-3, 0.16e-3
MASS, DAMPING, EFFORT = 0.1, 2.0, 20.0
"""Device [kg, N·s/m], and the largest force of its motor [N]."""
BODY = events.motor(MASS, DAMPING, LAG)
"""The same device."""
EXPONENT, DEPTH, FORCE, LOSS = 1.5, 0.01, 2.0, 1.0
"""Body k·dⁿ·(1 + p·ḋ): n, the force [N] at a depth [m] that gives k, and p [s/m]."""
STEEP = 300.0
"""Force [N] at that depth of a body that is stable at the effort limit and unstable at smaller forces."""
HEIGHT, PITCH = 0.4, 4e-3
"""Amplitude [N] and pitch [m] of detents."""
AGREEMENT, CUT = 1e-6, 5e-4
"""Permitted relative difference of limits and growths, and of energies: motions are cut into cells."""


def _judged(element: Element) -> Stability:
    plant = Plant(MASS, DAMPING, torque_lag=LAG)
    member = Member("handle", plant, DELAY, (element,), None, "backward-difference", effort=EFFORT)
    return Group((member,), (), PERIOD).stability


def _growth_by_hand(stiffness: float, damping: float) -> float:
    """Return the growth a period at a spring and damper by backward difference."""
    return growth_in_contact(BODY, PERIOD, DELAY, stiffness, damping)


def _steepest(stiffness: float) -> float:
    """Return the slope at the effort limit of a body of this stiffness at DEPTH [N/m]: n·F/d ∝ F^(1 − 1/n)."""
    force = stiffness * DEPTH / EXPONENT
    return stiffness * math.pow(EFFORT / force, 1.0 - 1.0 / EXPONENT)


def _worst_by_hand(force: float, loss: float) -> tuple[float, float]:
    """Return the largest growth a period over all depths up to the effort limit, and its depth [m]."""
    deepest = DEPTH * math.pow(EFFORT / force, 1.0 / EXPONENT)
    depths = [deepest * 10.0 ** (-number / 20) for number in range(80)]
    found = [
        (_growth_by_hand(EXPONENT * push / depth, loss * push), depth)
        for depth in depths
        for push in [force * math.pow(depth / DEPTH, EXPONENT)]
    ]
    return max(found)


def _hilltop_by_hand() -> tuple[float, float]:
    """Return the growth a period on a hilltop of detents, of the loop and of the ideal: m·s² + b·s − K = 0."""
    steep = 2.0 * math.pi * HEIGHT / PITCH
    fall = 2.0 * steep / (DAMPING + math.sqrt(DAMPING**2 + 4.0 * MASS * steep))
    return _growth_by_hand(-steep, 0.0), math.exp(fall * PERIOD)


def varying_slope(quick: bool) -> CaseResult:
    """Check that a body is judged by its slope wherever the motor can hold the handle, hilltops by ideal growth.

    Without loss the slope at the effort limit decides. With loss the worst depth is somewhere in between.
    """
    elastic = _judged(HuntCrossley("handle", FORCE, DEPTH, exponent=EXPONENT)).stiffness_limit
    stable, passive = (_steepest(limit or math.nan) for limit in (elastic.stable, elastic.passive))
    by_hand = limit_in_contact(BODY, PERIOD, DELAY)
    drives = [energies.LateDrive(DAMPING, DELAY, LAG)]
    share = energies.worst_share(lambda z: complex(-passive), drives, PERIOD, 24 if quick else 96)
    lossy = _judged(HuntCrossley("handle", STEEP, DEPTH, exponent=EXPONENT, loss=LOSS))
    crest, hilltop = _judged(Detents("handle", amplitude=HEIGHT, pitch=PITCH)).crest, _hilltop_by_hand()
    if lossy.place is None or lossy.place.position is None or crest is None or crest.ideal is None:
        raise ValueError("a body has a worst place, and detents have hilltops")
    place, deep, (growth, depth) = lossy.place, lossy.place.position, _worst_by_hand(STEEP, LOSS)
    push = STEEP * math.pow(deep / DEPTH, EXPONENT)
    pairs = (
        (stable, by_hand),
        (place.growth, _growth_by_hand(EXPONENT * push / deep, LOSS * push)),
        (crest.growth, hilltop[0]),
        (crest.ideal, hilltop[1]),
    )
    off = max(abs(one / other - 1.0) for one, other in pairs)
    missed = abs((place.growth - 1.0) / (growth - 1.0) - 1.0)
    return CaseResult(
        f"elastic: stable to a slope of {rounded(by_hand, 6)} N/m at the effort limit; where passivity ends, the worst "
        f"motion needs all of the damping; lossy: grows the most {rounded(1e3 * depth, 2)} mm deep, "
        f"×{rounded(growth, 5)} a period; hilltops ×{rounded(hilltop[0], 5)}, the ideal ×{rounded(hilltop[1], 5)}",
        f"stable to {rounded(stable, 6)}, passive to {rounded(passive, 4)} N/m, needed share off by "
        f"{rounded(abs(share - 1.0), 1)}; {lossy.verdict.value}, ×{rounded(place.growth, 5)} at "
        f"{rounded(1e3 * deep, 2)} mm; hilltops ×{rounded(crest.growth, 5)}, the ideal ×{rounded(crest.ideal, 5)}; off "
        f"by {rounded(off, 1)}",
        off <= AGREEMENT and abs(share - 1.0) <= CUT and missed <= 0.005 and lossy.verdict is Verdict.UNSTABLE,
        "slope and damping of k·dⁿ·(1 + p·ḋ) by hand at 80 depths, each from event to event; the worst of all motions "
        "in cells of constant speed; m·s² + b·s - K = 0",
        tolerance=f"{exactly(AGREEMENT)} of limit and growths, {exactly(CUT)} of the energy; 0.5 % of the worst excess "
        "over 1, as depths are tried in steps",
        used=share_used((off, AGREEMENT), (share - 1.0, CUT), (missed, 0.005)),
    )
