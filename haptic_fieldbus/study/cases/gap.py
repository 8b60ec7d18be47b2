"""Cases of gaps in the feedback: how the force fades and comes back, and how many gaps a loop bears."""

from collections.abc import Sequence

from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.cases.drive_bench import COUNT, FADED_IN, PERIOD_NS, UNIT, Feeder, feed, plan_of
from haptic_fieldbus.study.oracles import events
from haptic_fieldbus.study.oracles.contact import growth_of_turn

WAY, FADE = 20, 10
"""Counts that the hand moves in a period, and periods of a whole fade."""
STIFFNESS, EFFORT = 10.0 * UNIT / (WAY * COUNT), 400.0 * UNIT
"""Wall [N/m] and effort limit [N], of whole steps of torque, so that none is rounded."""
SLEW = EFFORT / 5.0
"""Largest change of the force in a period [N]: from 0 to the limit in 5 ms."""
SOON = 15
"""Longest gap [periods] after which the wall goes on from where it was; after a longer one its force has a cap."""
PRESSED, DEEPER = 30, 10
"""Periods of pressing before the gap, and after it."""
EXACT = 1e-9
"""Permitted difference of forces and works, relative to the effort limit and to the energy of the wall."""


def _forces(gap: int) -> tuple[list[float], list[float]]:
    """Return what the loop commands and what is expected [N], with a gap of so many periods in the feedback.

    The hand presses on during the gap, and after it for a while. Then it goes out of the wall, and in again. After a
    trip the command is 0.
    """
    cycle = Feeder(plan_of(Wall("handle", STIFFNESS), limits=Limits(effort=EFFORT)))
    turn = PRESSED + gap + DEEPER
    places = [WAY * number for number in range(1, turn + 1)]
    places += [*places[-2::-1], 0, -WAY, *(WAY * number for number in range(PRESSED))]
    lost = range(PRESSED, PRESSED + gap)
    found, seen = [], (0, 0)
    for number in range(FADED_IN + len(places)):
        at = number - FADED_IN
        is_lost = at in lost
        if not is_lost:
            seen = places[at] if at >= 0 else 0, number * PERIOD_NS
        feed(cycle, seen[0], LinkFlag.STALE if is_lost else 0, seen[1])
        if at >= 0:
            found.append(cycle.value("command"))
    return found, _expected(places, gap)


def _expected(places: Sequence[int], gap: int) -> list[float]:
    """Return the force by hand [N], segment after segment."""
    asked = [-STIFFNESS * COUNT * max(place, 0) for place in places]
    kept = asked[PRESSED - 1]
    faded = [kept * max(0.0, 1.0 - max(0, missing - 1) / FADE) for missing in range(1, gap + 1)]
    left = next(number for number in range(PRESSED + gap, len(places)) if not asked[number])
    # Back in contact it rises as fast as it may. After a short gap the wall waits until the force is that of before
    # within a step of the drive, and goes on from there. After a long one the force stays there until less is asked
    # for. A gap of one period is none: every force is held for a period.
    cap, pauses = kept if gap > SOON else -EFFORT, 1 < gap <= SOON
    risen = [faded[-1] - SLEW * number for number in range(1, left - PRESSED - gap + 1)]
    waits = next(number for number, force in enumerate(risen) if force <= kept + UNIT) if pauses else 0
    beside = places[PRESSED + gap + waits] - places[PRESSED - 1] if pauses else 0
    wanted = [kept] * waits
    wanted += [-STIFFNESS * COUNT * max(place - beside, 0) for place in places[PRESSED + gap + waits : left]]
    back = [max(cap, *each) for each in zip(risen, wanted, strict=True)]
    return [*asked[:PRESSED], *faded, *back, *asked[left:]]


def _given(forces: Sequence[float], gap: int) -> float:
    """Return the work of the force on the hand from the first contact until contact is left [J]."""
    inwards = PRESSED + gap + DEEPER - 1
    ways = [WAY * COUNT] * inwards + [-WAY * COUNT] * (inwards + 1)
    return sum(force * way for force, way in zip(forces, ways, strict=False))


def fade_return(quick: bool) -> CaseResult:
    """Check that a force fades in a gap and comes back at its slew, and that the wall goes on, or is capped.

    The hand presses on in the gap, after it for a while, and goes out. What it gets back beyond what it gave is the
    leak of held forces and what faded; a force that returned in full would give it more.
    """
    gaps = (1, 4, 15, 20) if quick else range(1, 21)
    off, works, by_hand = 0.0, [], []
    for gap in gaps:
        found, wanted = _forces(gap)
        off = max(off, *(abs(one - other) for one, other in zip(found, wanted, strict=True)))
        works.append(_given(found, gap))
        by_hand.append(_given(wanted, gap))
    apart = max(abs(one - other) for one, other in zip(works, by_hand, strict=True))
    stored = 0.5 * STIFFNESS * (WAY * COUNT * PRESSED) ** 2
    return CaseResult(
        f"pressing to {rounded(STIFFNESS * WAY * COUNT * PRESSED, 4)} N, gaps of {', '.join(map(str, gaps))} periods: "
        f"held, fading over {FADE}, back by at most {rounded(SLEW, 3)} N a period to that force; after {SOON} at most "
        "the wall goes on from there, after more it stays there; the hand gets "
        f"{values_text([1e3 * each for each in by_hand], 3)} mJ",
        f"off by at most {rounded(off, 1)} N; the hand gets "
        f"{values_text([1e3 * each for each in works], 3)} mJ, off by {rounded(1e3 * apart, 1)} mJ",
        off <= EXACT * EFFORT and apart <= EXACT * stored,
        "the force by hand, segment after segment, and its work",
        tolerance=f"{exactly(EXACT)} of {rounded(EFFORT, 3)} N and of {rounded(1e3 * stored, 3)} mJ",
        used=share_used((off, EXACT * EFFORT), (apart, EXACT * stored)),
    )


LENGTH, EACH = 10, 51
"""Periods from sample to sample in a gap, and periods from gap to gap: less than a fifth of the samples is missing."""
SPANS = (1.5, 40.0)
"""Limits of stiffness over the stiffness of two walls."""


def _given_up(stiffness: float) -> str | None:
    """Return the kind of the trip of a loop with such gaps while the handle rests in the wall; None without a trip."""
    cycle = Feeder(plan_of(Wall("handle", stiffness)))
    for number in range(FADED_IN + 1200):
        at = max(number - FADED_IN, 0)
        within = at % EACH
        lost = 0 < within < LENGTH
        feed(cycle, WAY, LinkFlag.STALE if lost else 0, (number - (within if lost else 0)) * PERIOD_NS)
        if cycle.tripped is not None:
            return cycle.tripped.value
    return None


def gaps_given_up(quick: bool) -> CaseResult:
    """Check that a loop is given up whose gaps make it grow, though few samples are missing, and another is not.

    A gap counts by the square of its length, since its force is that much older.
    """
    axis = plan_of(Wall("handle", STIFFNESS)).axes[0]
    if axis.plant is None or axis.stability is None:
        raise ValueError("the bench of the cases is known")
    limit = axis.stability.stiffness_limit.stable or 0.0
    body = events.motor(axis.plant.mass, axis.plant.damping, axis.plant.torque_lag)
    period = PERIOD_NS * 1e-9
    shots = [
        events.Shot(number * period, (number * period + axis.delay.transport,), not 0 < number < LENGTH)
        for number in range(EACH)
    ]
    grown = [growth_of_turn(body, EACH * period, shots, limit / span, 0.0, period) for span in SPANS]
    found = [_given_up(limit / span) for span in SPANS]
    stretch = (LENGTH**2 + EACH - LENGTH) / EACH
    is_right = grown[0] > 1.0 > grown[1] and found[0] is not None and found[1] is None
    return CaseResult(
        f"{LENGTH - 1} of {EACH} samples lost, stretch {rounded(stretch, 3)}: at 1/{exactly(SPANS[0])} of the limit a "
        f"knock is multiplied by {rounded(grown[0], 4)} from gap to gap, and the loop is given up; at "
        f"1/{exactly(SPANS[1])} by {rounded(grown[1], 4)}",
        f"{found[0] or 'no trip'}; {found[1] or 'no trip'}",
        is_right,
        "device and torque loop from event to event, over a gap and the samples up to the next one",
        tolerance="exact",
    )
