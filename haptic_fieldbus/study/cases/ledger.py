"""Cases of the energy ledger: what it sees of the leak of a held force, what it grants, and what it takes back.

A handle is moved into a spring and out again at w a period. The spring states what it stores but no stiffness, so the
ledger grants it no leak, and the whole leak shows as energy that the loop gave. The force of each sample acts for a
period; paired with the way in it, the ledger sees K·w²·M in a contact M ways deep, and more the later the force acts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from haptic_fieldbus import Limits, Plan, Signal
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.magnet import Magnet
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.texture import Texture
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.cases.drive import COUNT, FADED_IN, PERIOD_NS, UNIT, Feeder, feed, plan_of
from haptic_fieldbus.study.oracles.energies import held_work, triangle

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


@dataclass(frozen=True)
class Pushing:
    """A spring that states its stiffness and what it stores, and pushes out with `push` [N] more than it takes in."""

    axis: str
    stiffness: float
    push: float
    name: str = "pushing"
    needs: ClassVar = (Signal.POSITION,)
    reserve: ClassVar = 0.0

    def begin(self, period: float) -> Callable[[float], float]:
        before = 0.0

        def law(position: float) -> float:
            nonlocal before
            out, before = position < before, position
            return -self.stiffness * max(position, 0.0) - (self.push if out and position > 0.0 else 0.0)

        return law

    def stored(self, position: float) -> float:
        return 0.5 * self.stiffness * max(position, 0.0) ** 2

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


def _cycle(plan: Plan, delay: float) -> Feeder:
    """Return a cycle of this plan whose forces act so many periods after their samples."""
    (axis,) = plan.axes
    transport = max(delay * PERIOD_NS * 1e-9 - FASTEST, 0.0)
    late = replace(axis.delay, bus=transport, compute=0.0, drive=0.0, torque_loop=FASTEST)
    return Feeder(replace(plan, axes=(replace(axis, delay=late),)))


def _seen(delay: float, contacts: int, most: float | None = None, element: Element | None = None) -> float:
    """Return what the ledger of a running cycle says was given in the worst contact [J].

    `delay` is in periods, `most` is the effort limit [N].
    """
    cycle = _cycle(plan_of(element or Unstated("handle", STIFFNESS), limits=Limits(effort=most)), delay)
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


GRANTED = 0.03
"""Permitted relative difference of what is given beyond the leak: the account opens and turns some samples later."""


def leak_allowance(quick: bool) -> CaseResult:
    """Check that the leak of a stated stiffness is granted, K·(T/2 + td)·v², and nothing that is given beyond it.

    A spring pushes out by one step of torque more than in. Granted twice, the leak would hide that; without T/2, it
    would be told as given.
    """
    delays = (0.0, 1.0) if quick else (0.0, 0.3, 1.0, 1.7)
    found = [_seen(delay, 1, element=Pushing("handle", STIFFNESS, UNIT)) for delay in delays]
    beyond, leaks = DEEP * UNITS, [(1.0 + 2.0 * delay) * DEEP * UNITS for delay in delays]
    off = _apart(found, [beyond] * len(delays))
    return CaseResult(
        f"at td = {values_text(delays, 2)} T {rounded(1e3 * beyond, 4)} mJ, the push times the way out; the leaks, "
        f"{values_text([1e3 * each for each in leaks], 4)} mJ, are granted",
        f"{values_text([1e3 * each for each in found], 4)} mJ, off by {rounded(off, 1)}",
        off <= GRANTED,
        "the push times the way, and K·(T/2 + td)·v² for each time",
        tolerance=f"{exactly(GRANTED)} of the push's work",
        used=share_used((off, GRANTED)),
    )


STEPS, PUSH, WITHIN = 10, 60, 25
"""Steps of torque of the spring for each way, those of the push, and ways of a shallow contact."""


def controller_damping(quick: bool) -> CaseResult:
    """Check the largest damping of the passivity controller, twice what takes the leak: 2·K·(T/2 + td).

    The push gives far more in a period than the damping takes, so the force is damped by all of it.
    """
    stiffness, found, by_hand = STEPS * UNIT / (WAY * COUNT), [], []
    for delay in (0.0, 1.0):
        plan = plan_of(Pushing("handle", stiffness, PUSH * UNIT), limits=Limits(effort=1000 * UNIT))
        cycle = _cycle(replace(plan, scene=replace(plan.scene, passivity="controller")), delay)
        places = [0] * FADED_IN + triangle(WITHIN)[:-5]
        for number, place in enumerate(places):
            feed(cycle, WAY * place, t_ns=number * PERIOD_NS)
        law = -STEPS * places[-1] - PUSH
        found.append(cycle.value("command") / UNIT - law)
        by_hand.append(2.0 * STEPS * (0.5 + delay))
    off = max(abs(one - other) for one, other in zip(found, by_hand, strict=True))
    return CaseResult(
        f"on the way out, at td = 0 and T, {values_text(by_hand, 4)} steps of torque less",
        f"{values_text(found, 4)} steps, off by {rounded(off, 1)}",
        off <= 0.01,
        "2·K·(T/2 + td)·v",
        tolerance="0.01 steps of torque",
        used=share_used((off, 0.01)),
    )


STORING: tuple[Element, ...] = (
    Magnet("handle", 1.2, 0.02, 0.001),
    Detents("handle", 0.4, 0.006),
    HuntCrossley("handle", 3.0, 0.004, position=-0.003),
    Spring("handle", 300.0, dead_band=0.004, positive_saturation=1.5),
    Texture("handle", 0.4, 0.006),
    Wall("handle", 600.0, 0.01),
)
FAR = 0.03
"""Places between which the force is integrated [m]: ±FAR."""


def stored_energy(quick: bool) -> CaseResult:
    """Check that what an element says it stores is the work that its force takes, from one end of the travel on."""
    cells = 30_000 if quick else 300_000
    edges = np.linspace(-FAR, FAR, cells + 1)
    middles, width = 0.5 * (edges[1:] + edges[:-1]), 2.0 * FAR / cells
    off, largest = 0.0, []
    for element in STORING:
        law, stored = getattr(element, "force"), getattr(element, "stored")  # noqa: B009 - a protocol has one of both
        rest = [0.0] * (len(element.needs) - 1)
        taken = -np.cumsum([law(float(x), *rest) for x in middles]) * width
        told = np.array([stored(float(x)) for x in edges[1:]]) - stored(-FAR)
        largest.append(float(np.ptp(taken)))
        off = max(off, float(np.abs(told - taken).max()) / largest[-1])
    return CaseResult(
        f"magnet, detents, Hunt-Crossley, spring, texture, wall: {values_text([1e3 * each for each in largest], 4)} mJ",
        f"off by at most {rounded(off, 1)} of each",
        off <= 1e-5,
        "the force summed over the way, cell by cell",
        tolerance="1e-5 of the energy of each element",
        used=share_used((off, 1e-5)),
    )
