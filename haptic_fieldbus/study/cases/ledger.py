"""Cases of the energy ledger: what it sees of the leak of a held force, by timing, delay and saturation.

A handle is moved into a spring and out again at w a period. The spring states what it stores but no stiffness, so the
ledger grants it no leak, and the whole leak shows as energy that the loop gave. The force of each sample acts for a
period; paired with the way in it, the ledger sees K·w²·M in a contact M ways deep, and more the later the force acts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.cases.drive_bench import COUNT, FADED_IN, PERIOD_NS, UNIT, Feeder, feed, plan_of
from haptic_fieldbus.study.oracles.leaks import held_work, triangle

WAY, DEEP = 4, 400
"""Counts that the handle moves in a period, and periods of the way in."""
STIFFNESS = UNIT / (WAY * COUNT)
"""One step of torque in each period [N/m], so that no torque is rounded."""
UNITS = UNIT * WAY * COUNT
"""Energy of one way under one step of torque [J]."""
FASTEST = 1e-9
"""Lag of the torque loop [s], which is never 0."""
UNSEEN = 1
"""Units of energy that the ledger does not see of a force that acts at once: its account opens after the first way
under force, at a depth of two ways. The 2 units stored there are not given by the loop, and 1 was taken until then."""
EXACT, CLOSE = 1e-5, 5e-3
"""Permitted relative difference of the leak without a delay, and with one: then accounts open some samples later."""


@dataclass(frozen=True)
class Unstated:
    """A spring that states what it stores, and no stiffness."""

    axis: str
    stiffness: float
    name: str = "unstated"
    needs: ClassVar = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -self.stiffness * max(position, 0.0)

    def stored(self, position: float) -> float:
        return 0.5 * self.stiffness * max(position, 0.0) ** 2

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


def _seen(delay: float, contacts: int, most: float | None = None) -> float:
    """Return what the ledger of a running cycle says was given in the worst contact [J].

    `delay` is in periods, `most` is the effort limit [N].
    """
    plan = plan_of(Unstated("handle", STIFFNESS), limits=Limits(effort=most))
    (axis,) = plan.axes
    transport = max(delay * PERIOD_NS * 1e-9 - FASTEST, 0.0)
    late = replace(axis.delay, bus=transport, compute=0.0, drive=0.0, torque_loop=FASTEST)
    cycle = Feeder(replace(plan, axes=(replace(axis, delay=late),)))
    places = [0] * FADED_IN + (triangle(DEEP) + [0] * 10) * contacts
    for number, place in enumerate(places):
        feed(cycle, WAY * place, t_ns=number * PERIOD_NS)
    (ledger,) = cycle.ledgers
    return ledger.tally.largest


def _apart(found: Sequence[float], expected: Sequence[float]) -> float:
    return max(abs(one / other - 1.0) for one, other in zip(found, expected, strict=True))


def passivity_observer_timing(quick: bool) -> CaseResult:
    """Check that the ledger shows the leak of a force that acts at once, which it pairs with the way that follows.

    Paired with the way before it, the same force would show the leak with the opposite sign, and by the mean of both
    ways none.
    """
    found = _seen(0.0, 1 if quick else 10)
    pairings = [held_work(DEEP, delay) * UNITS for delay in (0.0, -1.0, -0.5)]
    off = _apart([found], [(DEEP - UNSEEN) * UNITS])
    return CaseResult(
        f"K·w²·(M - {UNSEEN}) = {rounded(1e3 * (DEEP - UNSEEN) * UNITS, 6)} mJ (the whole contact, with the way after, "
        f"before, and their mean: {values_text([1e3 * each for each in pairings], 4)} mJ)",
        f"{rounded(1e3 * found, 6)} mJ, off by {rounded(off, 1)}",
        off <= EXACT and _apart(pairings[:2], [DEEP * UNITS, -DEEP * UNITS]) <= 1e-12 and abs(pairings[2]) <= 1e-12,
        "closed form of a spring that is held from sample to sample, and sums over the samples by hand",
        tolerance=f"{exactly(EXACT)} of the leak",
        used=share_used(
            (off, EXACT), (_apart(pairings[:2], [DEEP * UNITS, -DEEP * UNITS]), 1e-12), (pairings[2], 1e-12)
        ),
    )


def passivity_observer_delay(quick: bool) -> CaseResult:
    """Check that the ledger sees the whole leak of a force that acts later, by parts of a period and by several."""
    delays = (0.0, 0.3, 1.0, 1.7)
    found = [_seen(delay, 1 if quick else 10) for delay in delays]
    expected = [held_work(DEEP, delay) * UNITS for delay in delays]
    off = _apart(found, expected)
    told = [(1.0 + 2.0 * delay) * DEEP * UNITS for delay in delays]
    near = _apart(expected, told)
    return CaseResult(
        f"at td = 0, 0.3, 1, 1.7 T {values_text([1e3 * each for each in expected], 5)} mJ, about 1 + 2·td/T times the "
        f"first (to {rounded(near, 1)})",
        f"{values_text([1e3 * each for each in found], 5)} mJ, off by {rounded(off, 1)}",
        off <= CLOSE and near <= 2.0 * CLOSE,
        "sums over the samples by hand, and K·(T/2 + td)·v² for each time",
        tolerance=f"{exactly(CLOSE)} of each leak",
        used=share_used((off, CLOSE), (near, 2.0 * CLOSE)),
    )


def saturation_ledger(quick: bool) -> CaseResult:
    """Check that the ledger counts the force that was sent, cut at the effort limit, and not the one that was asked.

    Where the force is constant nothing leaks, so half of the way leaks half.
    """
    share = 2
    found = _seen(0.0, 1 if quick else 10, most=UNIT * DEEP / share)
    expected, asked = ((held_work(DEEP, 0.0, most) - UNSEEN) * UNITS for most in (DEEP // share, DEEP))
    off = _apart([found], [expected])
    return CaseResult(
        f"cut at {rounded(UNIT * DEEP / share, 4)} of {rounded(UNIT * DEEP, 4)} N: {rounded(1e3 * expected, 6)} mJ; as "
        f"asked it would be {rounded(1e3 * asked, 6)} mJ",
        f"{rounded(1e3 * found, 6)} mJ, off by {rounded(off, 1)}",
        off <= EXACT and abs(asked / expected - share) <= 0.01,
        "sums over the samples by hand, the force cut at half of the way",
        tolerance=f"{exactly(EXACT)} of the leak",
        used=share_used((off, EXACT), (asked / expected - share, 0.01)),
    )
