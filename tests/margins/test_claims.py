"""Claims of a verdict, held against drawn loops that are simulated from event to event.

Each loop has a device, a delay, a motor limit and one or two elements, some of them soft or stiff at other places than
in the middle (`drawn`). "Stable" claims that a small knock dies at every place where the handle may rest, so knocks of
1 µm/s are given there, for 7000 periods, without friction and counts that would hide a growth of 1.001. "Passive"
claims that no passive hand gets energy from it for ever, so hands without any loss, a mass and a spring, are tuned to
the loop, and small and large knocks are given; with friction and counts large knocks and slow traverses follow.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.margins import Verdict
from tests.margins.drawn import PERIOD, TRAVEL, Drawn, drawn, law_of, place_in, softness
from tests.margins.events import Bench
from tests.margins.laws import Array, Law
from tests.telling import TOLD

WINDOWS = 7
GROWN = 1.05
"""A knock that is so many times larger in the end than after 1000 periods has grown, by 1e-5 a period."""
PUSHED_ON = 30.0
"""A knock that moves a free handle so many times further than its spring alone would let it has grown as well."""


@dataclass(frozen=True)
class Trial:
    """A batch of drawn loops, each in several columns of one simulation."""

    loops: list[Drawn]
    copies: int

    @cached_property
    def columns(self) -> list[Drawn]:
        return self.loops * self.copies

    @cached_property
    def law(self) -> Law:
        return law_of(self.columns)

    @cached_property
    def verdicts(self) -> NDArray[np.object_]:
        return np.array([loop.verdict for loop in self.loops], dtype=object)

    def each(self, *names: str) -> list[Array]:
        """Return these values of the devices, one for each column."""
        return [np.array([getattr(loop.plant, name) for loop in self.columns]) for name in names]

    def bench(self, push: Array) -> Bench:
        none = np.zeros(len(push))
        mass, damping, lag, coulomb, resolution = self.each("mass", "damping", "torque_lag", "coulomb", "resolution")
        delay, effort = np.array([(loop.delay, loop.effort) for loop in self.columns]).T
        return Bench(mass, damping, PERIOD, delay, lag, effort, coulomb, resolution, none, none, push)

    def places(self, random: np.random.Generator) -> Array:
        """Return a place in each column; for the first copy the one that is told as the worst.

        A place at an edge is moved by 10 µm towards the stiffer side.
        """
        drawn_places = self.drawn_places(random)
        told = [np.nan if loop.worst is None else loop.worst for loop in self.loops]
        worst = np.tile(np.array(told, dtype=float), self.copies)
        near = np.where(np.isnan(worst), drawn_places, worst) + np.array([[-1e-5], [0.0], [1e-5]])
        stiffer = np.take_along_axis(near, np.array([self.slope(x) for x in near]).argmax(axis=0)[None], axis=0)[0]
        is_first = np.arange(len(drawn_places)) < len(self.loops)
        return np.where(is_first & ~np.isnan(worst), stiffer, drawn_places)

    def drawn_places(self, random: np.random.Generator) -> Array:
        return np.array([place_in(loop, random) for loop in self.columns])

    def slope(self, x: Array, step: float = 1e-7) -> Array:
        """Return −dF/dx where frictions and grips hold; of a tissue that relaxes that of what stays."""
        soon = self.law.after(x, x - step) - self.law.after(x, x + step)
        late = self.law.at_rest(x - step) - self.law.at_rest(x + step)
        soft = np.tile(softness(self.loops), self.copies)
        return np.asarray(np.where(soft > 0.0, late, soon) / (2.0 * step))

    def potential_range(self, effort: Array, low: Array, high: Array) -> Array:
        """Return the largest difference of the potential of the cut force between two positions."""
        share = np.linspace(0.0, 1.0, 400)
        force = np.array([np.clip(self.law.at_rest(low + part * (high - low)), -effort, effort) for part in share])
        work = np.cumsum(0.5 * (force[1:] + force[:-1]) * (high - low) / (len(share) - 1), axis=0)
        return np.asarray(np.maximum(work.max(axis=0), 0.0) - np.minimum(work.min(axis=0), 0.0))

    def bound(self, bench: Bench, x: Array, knock: Array, reach: Array) -> Array:
        """Return the energy that the knock, the law's potential and the push can have given."""
        far = reach.max(axis=0)
        stored = 0.5 * (bench.mass + bench.hand_mass) * knock**2
        return np.asarray(stored + self.potential_range(bench.effort, x - far, x + far) + np.abs(bench.push) * far)

    def called(self, *verdicts: Verdict) -> NDArray[np.bool_]:
        return np.tile([each in verdicts for each in self.verdicts], self.copies)

    def assert_none(self, false: NDArray[np.bool_], **values: NDArray[Any]) -> None:
        at = np.flatnonzero(false)[:3]
        assert not len(at), "\n".join(
            f"{self.columns[n]} {self.columns[n].verdict} { {key: each[n] for key, each in values.items()} }"
            for n in at
        )


def grown(windows: Array, least: float = 1e-12) -> Array:
    return np.asarray((windows[-3:].max(axis=0) + least) / (windows[1:4].max(axis=0) + least))


BATCHES = pytest.mark.parametrize(
    ("batch", "size", "periods"),
    [
        pytest.param(0, 24, 2100, id="few"),
        *(pytest.param(each, 500, 7000, id=f"batch-{each}") for each in range(1, 7)),
    ],
)


@pytest.mark.thorough("simulates 3000 drawn loops", quick=("few",))
@BATCHES
def test_no_loop_is_called_better_than_it_is(batch: int, size: int, periods: int, record_property: Any) -> None:
    random = np.random.default_rng(1600 + batch)
    trial = Trial([drawn(random) for _ in range(size)], 9)
    grows = assert_no_false_verdict(trial, random, periods)
    free = np.arange(9) % 3 == 0
    record_property(TOLD, told(batch, trial, grows.reshape(9, size), free))


def assert_no_false_verdict(trial: Trial, random: np.random.Generator, periods: int) -> NDArray[np.bool_]:
    """Knock each loop at three places, and return which of the nine columns of each grow.

    At each place a free handle, and one in a hand without loss, is knocked gently and hard.
    """
    kind = np.repeat(np.arange(9) % 3, len(trial.loops))
    x = trial.places(random)
    push, slope = -trial.law.at_rest(x), trial.slope(x)
    bench = trial.bench(push)
    rests = (np.abs(push) <= 0.99 * bench.effort) & (np.abs(x) <= TRAVEL) & (slope > 1e-3)
    tuned = np.array([loop.elements[0].stiffness for loop in trial.columns]) * 10.0 ** random.uniform(-2.0, 1.0, len(x))
    bench.hand_mass = np.where(kind > 0, bench.mass * 10.0 ** random.uniform(-1.0, 0.5, len(x)), 0.0)
    bench.hand_stiffness = np.where(kind > 0, tuned, 0.0)
    knock = np.where(kind == 2, 10.0 ** random.uniform(-4.0, 0.0, len(x)), 1e-6)
    reach, energy = bench.run(trial.law, x, knock, periods, WINDOWS)
    # A motion slower than 2 s a turn is not seen to grow or to die in windows of 3 s.
    rests &= slope + bench.hand_stiffness > 10.0 * (bench.mass + bench.hand_mass)
    # One that grows fast is at its limit before the second window: it is then far beyond what the knock alone moves.
    moved = knock * np.sqrt(bench.mass / np.maximum(slope, 1e-3))
    grows = rests & (kind < 2) & ((grown(reach) > GROWN) | ((kind == 0) & (reach[-1] > PUSHED_ON * moved)))
    claims = np.where(kind == 0, trial.called(Verdict.STABLE, Verdict.PASSIVE), trial.called(Verdict.PASSIVE))
    trial.assert_none(grows & claims, x=x, push=push, slope=slope, end=reach[-1], start=reach[1], hand=kind)
    bound = trial.bound(bench, x, knock, reach)
    gives = (kind == 2) & (energy > 2.0 * bound) & trial.called(Verdict.PASSIVE)
    trial.assert_none(gives, x=x, push=push, knock=knock, last=energy, bound=bound)
    return np.asarray(grows)


def told(batch: int, trial: Trial, grows: NDArray[np.bool_], free: NDArray[np.bool_]) -> str:
    """Return how many loops have each verdict, and how many of them were perhaps judged too low."""
    size = len(trial.loops)
    count = {each: trial.called(each)[:size] for each in Verdict}
    died = count[Verdict.UNSTABLE] & ~grows[free].any(axis=0)
    quiet = count[Verdict.STABLE] & ~grows.any(axis=0)
    verdicts = ", ".join(f"{each.sum()} {verdict.value}" for verdict, each in count.items())
    low, lower = (
        each.sum() / max(count[verdict].sum(), 1)
        for each, verdict in ((died, Verdict.UNSTABLE), (quiet, Verdict.STABLE))
    )
    return (
        f"drawn loops {batch}: {verdicts}; {low:.0%} of the unstable ones died at all places tried, {lower:.0%} of the"
        " stable ones in every hand tried"
    )


@pytest.mark.thorough("simulates 3000 drawn loops with friction and counts")
@BATCHES
def test_hard_knocks_and_slow_traverses_with_friction_and_counts_give_no_energy(
    batch: int, size: int, periods: int
) -> None:
    random = np.random.default_rng(2600 + batch)
    trial = Trial([rough(drawn(random), random) for _ in range(size)], 2)
    x = trial.places(random)
    bench = trial.bench(-trial.law.at_rest(x))
    bench.hand_mass = bench.mass * 10.0 ** random.uniform(-1.0, 1.0, len(x))
    traverse = np.repeat([False, True], size)
    bench.push += np.where(traverse, bench.coulomb * random.choice([-1.5, 1.5], len(x)), 0.0)
    knock = np.where(traverse, 0.0, 10.0 ** random.uniform(-3.0, 0.0, len(x)))
    reach, energy = bench.run(trial.law, x, knock, periods, WINDOWS)
    bound = trial.bound(bench, x, knock, reach)
    false = (energy > 2.0 * bound + 1e-9) & trial.called(Verdict.PASSIVE)
    trial.assert_none(false, x=x, push=bench.push, knock=knock, last=energy, bound=bound)


COARSEST = 0.05 / 24
"""24 counts a turn of 50 mm [m]."""


def rough(loop: Drawn, random: np.random.Generator) -> Drawn:
    """Return the loop with friction and counts, fine ones or as coarse as 24 a turn, and with ideal torque.

    The friction is any, or about what bridges the rounding of the stiffest place.
    """
    coulomb, step = loop.effort * 10.0 ** random.uniform(-3.0, -1.5), 10.0 ** random.uniform(-6.0, -4.5)
    if random.random() < 0.4:
        step = COARSEST * 10.0 ** random.uniform(-1.5, 0.0)
        increments = loop.environment.increments
        asked = (0.5 * increments.slope + increments.damping / PERIOD) * step
        if np.isfinite(asked):
            coulomb = asked * random.uniform(0.8, 1.5)
    return replace(loop, plant=replace(loop.plant, coulomb=coulomb, resolution=step, torque_lag=0.0))


def test_two_thousand_loops_are_drawn_for_7000_periods() -> None:
    assert sum(size for _, size, periods in (each.values for each in BATCHES.args[1]) if periods >= 7000) >= 2000
