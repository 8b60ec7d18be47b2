"""How sharp verdicts are, by kind of element: refused loops that stay quiet, and the limit told over the true one.

    python -m benchmarks.verdict_sharpness [LOOPS_OF_A_KIND]

Loops are drawn as in `tests/margins`, with one element of the kind, and simulated from event to event without the
package. A refused loop is quiet when small knocks die at all places tried. The true limit is the least share of the
told one at which a knock grows; shares are tried in steps, so that the largest told/true is 0.98 where none is above 1.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from haptic_fieldbus.margins import Verdict
from tests.margins.drawn import NAMES, TRAVEL, Drawn, drawn, element
from tests.margins.own_drawn import KINDS, OwnTrial, own
from tests.margins.test_claims import GROWN, PUSHED_ON, WINDOWS, Trial, grown

SHARES = (0.9, 0.98, 1.02, 1.05, 1.1, 1.2, 1.4, 1.7, 2.0, 3.0)
"""Shares of the told limit at which a loop is tried."""
PLACES, PERIODS = 3, 5600
SEED = 7100


@dataclass(frozen=True)
class Sharpness:
    """Findings about a kind of element."""

    kind: str
    loops: int
    refused: int
    quiet: int
    """Refused loops of which no knock grew."""
    ratios: tuple[float, ...]
    """Limit told over the least share that grows, where one does; 1 is exact."""
    none: int
    """Loops that grow at none of the shares."""

    def text(self) -> str:
        found = f"{np.median(self.ratios):6.2f} {min(self.ratios):6.2f} {max(self.ratios):6.2f}" if self.ratios else ""
        return f"{self.kind:24} {self.loops:6} {self.refused:8} {self.quiet:6} {found:>20} {self.none:8}"


def grows(trial: Trial, random: np.random.Generator) -> np.typing.NDArray[np.bool_]:
    """Return which loops of a trial grow at one of their places after a small knock on a free handle."""
    x = trial.places(random)
    push, slope = -trial.law.at_rest(x), trial.slope(x)
    bench = trial.bench(push)
    knock = np.full(len(x), 1e-6)
    reach, _ = bench.run(trial.law, x, knock, PERIODS, WINDOWS)
    rests = (np.abs(push) <= 0.99 * bench.effort) & (np.abs(x) <= TRAVEL) & (slope > 10.0 * bench.mass)
    moved = knock * np.sqrt(bench.mass / np.maximum(slope, 1e-3))
    found = rests & ((grown(reach) > GROWN) | (reach[-1] > PUSHED_ON * moved))
    return np.asarray(found.reshape(PLACES, -1).any(axis=0))


def sharpness(
    kind: str, of: type[Trial], draw: Callable[[np.random.Generator], Drawn], count: int, seed: int
) -> Sharpness:
    """Return the figures of a kind of element."""
    random = np.random.default_rng(seed)
    loops = [draw(random) for _ in range(count)]
    refused = np.array([loop.verdict is Verdict.UNSTABLE for loop in loops])
    quiet = refused & ~grows(of(loops, PLACES), random)
    limited = [(loop, limit) for loop in loops if 0.0 < (limit := loop.group.rough_limit()) < 1e6]
    scaled = [scale(loop, share * limit) for share in SHARES for loop, limit in limited]
    grown_at = grows(of(scaled, PLACES), random).reshape(len(SHARES), -1) if limited else np.zeros((len(SHARES), 0))
    first = [float(SHARES[int(column.argmax())]) for column in grown_at.T if column.any()]
    return Sharpness(
        kind,
        count,
        int(refused.sum()),
        int(quiet.sum()),
        tuple(1.0 / share for share in first),
        len(limited) - len(first),
    )


def scale(loop: Drawn, stiffness: float) -> Drawn:
    """Return the loop with this stiffness of its element."""
    (member,) = loop.group.with_stiffness(loop.elements[0], stiffness).members
    return replace(loop, elements=member.elements)


def with_element(kind: str) -> Callable[[np.random.Generator], Drawn]:
    """Return a function that draws a loop with an element of the package."""

    def draw(random: np.random.Generator) -> Drawn:
        loop, limit = device(random)
        return replace(loop, elements=(element(kind, limit * 10.0 ** random.uniform(-0.5, 0.5), loop.effort, random),))

    return draw


def with_own(kind: str) -> Callable[[np.random.Generator], Drawn]:
    """Return a function that draws a loop with an element without bounds of its own."""

    def draw(random: np.random.Generator) -> Drawn:
        loop, limit = device(random)
        return replace(loop, elements=(own(kind, is_bounded=False, limit=limit, random=random),))

    return draw


def device(random: np.random.Generator) -> tuple[Drawn, float]:
    """Return a drawn loop, and about the limit of a plain spring on its device [N/m]."""
    loop = drawn(random)
    return loop, loop.plant.damping / (0.5e-3 + loop.delay + loop.plant.torque_lag)


def main(arguments: Sequence[str]) -> None:
    count = int(arguments[0]) if arguments else 40
    print(
        f"{'kind of element':24} {'loops':>6} {'refused':>8} {'quiet':>6} "
        f"{'told/true: median':>17} min  max  {'none':>6}"
    )
    for number, kind in enumerate(NAMES):
        print(sharpness(kind, Trial, with_element(kind), count, SEED + number).text(), flush=True)
    for number, kind in enumerate(KINDS):
        print(sharpness(f"own {kind}", OwnTrial, with_own(kind), count, SEED + 50 + number).text(), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
