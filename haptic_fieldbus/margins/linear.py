"""Stability by eigenvalues: the largest stiffness, and patterns of missing frames."""

import math
from bisect import bisect
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import pairwise

import numpy as np

from haptic_fieldbus.margins.plant import Plant, sample
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix, StateSpace
from haptic_fieldbus.numerics.sampled import SampledPlant

# Largest stable stiffness of a sampled loop, by the eigenvalues of one exact period: a scan, then a root.

EnvironmentOf = Callable[[float], StateSpace]
"""Function from a stiffness to the discrete environment x_k → F_k."""

SMALLEST, LARGEST = 1e-9, 1e4
"""Range of the search, as multiples of m/T² + b/T.

A stiffness of m/T² + b/T moves the handle by about its own deflection in a period. A loop that is stable at ten
thousand times this stiffness is stable at any: its force no longer depends on the stiffness, as with a virtual mass by
backward Euler. For larger stiffnesses the eigenvalues would show rounding only.
"""
SCAN_FACTOR = math.sqrt(2.0)
"""Ratio of neighbouring stiffnesses of the search."""
MOST_STATES = 20
"""Largest number of states for which `crossings` are exact enough: each period of delay is a state."""
ROUNDING = 1e-11
"""Excess of a spectral radius over 1 that may be rounding."""


def limit_of(
    growth: Callable[[float], float],
    scale: float,
    *,
    factor: float = SCAN_FACTOR,
    precision: float = 1e-10,
    expected: Sequence[float] | None = None,
) -> float:
    """Return the stiffness at which `growth`, the largest modulus of a loop's eigenvalues, first exceeds 1.

    0 when the smallest stiffness is not stable, ∞ when every stiffness is. The search goes from `SMALLEST` to `LARGEST`
    times `scale`, an m/T² + b/T, in steps of `factor`, and ends at a relative `precision`. With `expected`, all
    stiffnesses at which an eigenvalue has the modulus 1 (`crossings`), only the steps beside them are tried.
    """

    @cache
    def excess(stiffness: float) -> float:
        return growth(stiffness) - 1.0

    steps = [SMALLEST * scale]
    while steps[-1] <= LARGEST * scale:
        steps.append(steps[-1] * factor)
    tried: Iterable[int] = range(len(steps) - 1)
    if expected is not None:
        # An expected stiffness that is equal to a step may lie on either side of it.
        beside = {bisect(steps, stiffness) + more for stiffness in expected for more in (0, 1)}
        tried = sorted({0, *beside, len(steps) - 2} & {*tried})
    for step in tried:
        if excess(steps[step]) > ROUNDING:
            if step and expected is not None and excess(steps[step - 1]) > ROUNDING:
                return limit_of(growth, scale, factor=factor, precision=precision)  # a crossing was not expected
            return crossing(excess, steps[step - 1], steps[step], precision) if step else 0.0
    return math.inf


def crossings(matrices: Sequence[Matrix], step: float) -> list[float] | None:
    """Return all k for which an eigenvalue of M(k) has the modulus 1; None without a closed form.

    `matrices` are M at `step`, 2·`step` and 3·`step`, a k of the usual size. The closed form needs an M that is linear
    in k, with a single force of the stiffness k. Then det(z − M(k)) = D(z) + k·N(z). An eigenvalue z = e^(jθ) needs
    Im(D·N*) = 0, which is sin θ times a polynomial in y = 1 − cos θ, and has k = −Re(D·N*)/|N|². These are the bounds
    of Jury's criterion.
    """
    one, two, three = matrices
    if not one.shape == two.shape == three.shape or len(one) > MOST_STATES:
        return None
    if np.abs(three - two - (two - one)).max() > 1e-9 * np.abs(two - one).max():
        return None
    poles, moved, twice = (np.poly(each) for each in (2.0 * one - two, one, two))
    change, order = moved - poles, len(one)
    if np.abs(twice - moved - change).max() > 1e-9 * np.abs(change).max():
        return None
    # Im(D·N*) = Σ s_m·sin mθ, and sin mθ = sin θ·U_(m−1)(cos θ) with Chebyshev's polynomials U.
    products = np.convolve(poles, change[::-1])
    total, before, chebyshev = np.zeros(1), np.zeros(1), np.ones(1)
    for sine in products[order - 1 :: -1] - products[order + 1 :]:
        total = np.polyadd(total, sine * chebyshev)
        before, chebyshev = chebyshev, np.polysub(np.polymul([-2.0, 2.0], chebyshev), before)
    # The small y decide; they are the large roots of the polynomial in 1/y, which are exact to all digits.
    inverse = np.roots(total[::-1])
    inverse = inverse[(inverse.real > 0.5) & (np.abs(inverse.imag) <= 1e-6 * np.abs(inverse))].real
    z = np.exp(1j * np.array([0.0, math.pi, *(2.0 * np.arcsin(np.sqrt(0.5 / inverse)))]))
    moving = np.polyval(change, z)
    found = -(np.polyval(poles, z) * moving.conj()).real / np.where(moving == 0.0, math.nan, np.abs(moving) ** 2)
    return list((step * found[np.isfinite(found)]).tolist())


def crossing(excess: Callable[[float], float], low: float, high: float, precision: float) -> float:
    """Return the largest argument found without excess; `low` has no excess, `high` has one.

    Interpolates by the ITP method with κ₁ = 0.2/(high − low), κ₂ = 2 and n₀ = 1, which needs at most one evaluation
    more than bisection (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2021, doi:10.1145/3423597). Ends at a
    relative `precision`.
    """
    below, above = min(excess(low), 0.0), excess(high)
    width, tolerance = high - low, 0.5 * precision * high
    most = math.ceil(math.log2(width / (2.0 * tolerance))) + 1
    for step in range(most + 1):
        if high - low <= precision * high:
            break
        middle = 0.5 * (low + high)
        straight = low - below * (high - low) / (above - below)
        towards = math.copysign(1.0, middle - straight)
        shift = min(0.2 * (high - low) ** 2 / width, abs(middle - straight))
        truncated = straight + towards * shift
        reach = tolerance * 2.0 ** (most - step) - 0.5 * (high - low)
        tried = truncated if abs(truncated - middle) <= reach else middle - towards * reach
        if (found := excess(tried)) <= 0.0:
            low, below = tried, found
        else:
            high, above = tried, found
    return low


# Stability when frames are missing in a pattern that repeats.
#
# When a frame is missing, the last force is held and the states of the environment keep their values. A pattern of N
# periods is one linear map, the product of the maps of its periods. Its eigenvalue of the largest modulus decides
# (Floquet). A force gets older while it is held, so the gaps count by their squares. With the times T_i between
# samples, light damping and no delay,
#
#     K < 2·b·ΣT_i/ΣT_i²
#
# if the gaps are spread evenly over all phases of the oscillation. Gaps that come once in each half cycle are not. For
# the worst timing there is a bound. A spring K, whose force has the mean age A = T/2 + td + λ, reduces the damping of
# the device to b' = b − K·A. Let V = ½·m·v² + ½·K·x² + ½·b'·x·v. For light damping V' = −b'/m·V at every phase, while
# no sample is missing. A force that is held for s periods is older by (s − 1)·T/2 on average, whatever td and λ. It
# therefore gives ½·K·T²·(s² − s)·v² more than in s single periods. v² is at most 2·V/m, so the gap multiplies V by
# exp(K·T²·(s² − s)/m) at most. V falls while the sum of these exponents is below b'/m times the elapsed time T·Σs:
#
#     K·(A + T·q) < b,  q = Σ(s² − s)/Σs,  that is  K < K₀/(1 + q·T/A)
#
# with K₀ = b/A, the limit without gaps. If gaps are rare, half of q counts on average: without delay this is the bound
# above. Tests draw devices, delays, dampers and patterns. No permitted pattern has an eigenvalue above 1; the first
# patterns that grow have 1.1 times the permitted q.

Pattern = Sequence[bool]
"""One entry for each period, True when its frame arrives; repeats for ever. The first entry must be True."""


def gaps(lengths: Sequence[int]) -> tuple[bool, ...]:
    """Return the pattern whose forces are held for these numbers of periods: (1, 1, 3) loses two frames of five."""
    return tuple(place == 0 for length in lengths for place in range(length))


def pattern_matrix(device: SampledPlant, environment: StateSpace, pattern: Pattern) -> Matrix:
    """Return the square matrix of a whole pattern on the states of `sampled.loop_matrix`."""
    periods = {
        # The force of the period before must be a state, to be held when a frame is missing.
        received: sampled.loop_matrix(device, environment, received=received, least_memory=1)
        for received in set(pattern)
    }
    matrix = np.eye(len(periods[True]))
    for received in pattern:
        matrix = periods[received] @ matrix
    return matrix


def pattern_growth(device: SampledPlant, environment: StateSpace, pattern: Pattern) -> float:
    """Return the mean growth of the loop in a period of the pattern, free shifts left out; below 1 is stable."""
    matrix = sampled.without_shift(pattern_matrix(device, environment, pattern), device, environment)
    return float(sampled.spectral_radius(matrix) ** (1.0 / len(pattern)))


def pattern_limit(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf, pattern: Pattern) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which the loop with these missing frames is stable.

    0 and ∞ have the meaning of `linear.limit_of`. Raises UsageError for impossible times [s].
    """
    device, scale = sample(plant, period, delay), plant.mass / period**2 + plant.damping / period
    return limit_of(lambda stiffness: pattern_growth(device, environment_of(stiffness), pattern), scale)


def pattern_bound(damping: float, period: float, pattern: Pattern) -> float:
    """Return K = 2·b·ΣT_i/ΣT_i² [N/m or N·m/rad], which the limit approaches for light damping without delay."""
    starts = [place for place, received in enumerate(pattern) if received] + [len(pattern)]
    times = [period * (after - before) for before, after in pairwise(starts)]
    return 2.0 * damping * sum(times) / sum(time**2 for time in times)
