"""Lines and curves through the last positions: least squares, and windows that adapt (FOAW).

- least-squares: the slope, at the newest position, of the polynomial of order p through the last N positions. For a
  line the noise gain is √(12/(N·(N² − 1)))/T and the delay (N − 1)·T/2. From p = 2 on slow motions have no delay, but
  more noise.
- foaw-end-fit, foaw-best-fit: first-order adaptive windowing (Janabi-Sharifi, Hayward, Chen, IEEE Trans. Control
  Systems Technology 8(6), 2000, 1003, doi:10.1109/87.880606). The window grows while its line through the newest sample
  passes within ±`band` of all its samples. It ends before the first length that fails, although a longer one may fit
  again. The slope of the line is the chord over the window, or the least-squares slope. Slow motions get long windows
  and little noise, fast motions short windows and little delay. A constant speed needs a band of one encoder count.

The line through the newest sample is within the band of sample j if and only if its slope lies between
(x_n − x_{n−j} ∓ band)/(j·T). One pass over the window is therefore enough: the interval of allowed slopes only shrinks,
and the first window whose slope leaves it ends the search.

FOAW is not linear, but each of its windows is, from the backward difference (window 1) to the longest. Stability is
judged with the longest window, which has the most delay.
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.estimators.differences import shift_register
from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter
from haptic_fieldbus.numerics.linear import Matrix

ROUNDING = 1e-12
"""Share of the position that is added to the band, so that rounding does not split a straight line at a band of 0."""


def slope_weights(length: int, order: int, period: float) -> Matrix:
    """Return the weights of x_n, x_{n−1}, … in the slope at n of the polynomial through the positions, (length,)."""
    # Times from −1 to 0 keep the powers well conditioned; the last line scales the slope back.
    times = -np.arange(length, dtype=np.float64) / max(1, length - 1)
    powers = np.vander(times, order + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers)[1] / (max(1, length - 1) * period))


def _weights(setup: EstimatorSetup) -> Matrix:
    return slope_weights(setup.whole("window"), setup.whole("order"), setup.period)


def _start_least_squares(setup: EstimatorSetup) -> Estimate:
    """Return a step that weights the last positions."""
    # The weights sum to zero, so differences from the newest position keep all digits far from zero.
    weights: list[float] = _weights(setup).tolist()
    window: list[float] = []

    def step(position: float) -> float:
        nonlocal window
        window = [position, *window[:-1]] if window else [position] * len(weights)
        return sum([weight * (x - position) for weight, x in zip(weights, window, strict=True)])

    return step


def _check_order(setup: EstimatorSetup) -> None:
    if setup.whole("window") <= setup.whole("order"):
        raise UsageError(
            f"least-squares: window={setup.whole('window')} is too short for order={setup.whole('order')}; "
            f"expected at least {setup.whole('order') + 1} positions"
        )


def _line_noise_gain(setup: EstimatorSetup) -> float:
    """Return √Σ weights²; for a line the sum is 12/(N·(N² − 1)·T²)."""
    length = setup.whole("window")
    if setup.whole("order") > 1:
        return float(np.linalg.norm(_weights(setup)))
    return math.sqrt(12.0 / (length * (length * length - 1.0))) / setup.period


Slope = Callable[[int], tuple[float, float, float]]
"""Weights, from i, that give the move per period of a line over i periods.

With w_j the move over the last j periods, they are those of (w_i, Σ w_j, Σ j·w_j), with the sums from j = 1 to i.
"""


def _best(i: int) -> tuple[float, float, float]:
    """Return the weights of least squares over x_n … x_{n−i}: Σ (j − i/2)·w_j divided by Σ (j − i/2)²."""
    share = 12.0 / (i * (i + 1.0) * (i + 2.0))
    return (0.0, -0.5 * i * share, share)


def _start_adaptive(setup: EstimatorSetup, slope_of: Slope) -> Estimate:
    length, period, band = setup.whole("window"), setup.period, setup.number("band")
    table = [(float(i), *slope_of(i)) for i in range(1, length + 1)]
    window: list[float] = []

    def step(position: float) -> float:
        nonlocal window
        if not window:
            window = [position] * length
        tolerance = band + ROUNDING * abs(position)
        slope, lowest, highest, total, moment = position - window[0], -math.inf, math.inf, 0.0, 0.0
        for before, (i, by_way, by_total, by_moment) in zip(window, table, strict=True):
            way = position - before
            total += way
            moment += i * way
            least, most = (way - tolerance) / i, (way + tolerance) / i
            lowest = least if least > lowest else lowest
            highest = most if most < highest else highest
            longer = by_way * way + by_total * total + by_moment * moment
            if not lowest <= longer <= highest:
                break
            slope = longer
        window = [position, *window[:-1]]
        return slope / period

    return step


WINDOW = Parameter("window", 16.0, "longest window, in periods", lowest=1.0, highest=128.0, is_whole=True)
BAND = Parameter("band", None, "largest distance of a sample from the line", "m or rad")
LEAST_SQUARES = Estimator(
    "least-squares",
    "slope of a polynomial through the last positions",
    start=_start_least_squares,
    system=lambda setup: shift_register(_weights(setup)),
    noise_gain=_line_noise_gain,
    delay=lambda setup: 0.0 if setup.whole("order") > 1 else 0.5 * (setup.whole("window") - 1) * setup.period,
    parameters=(
        Parameter("window", 8.0, "positions", lowest=2.0, highest=256.0, is_whole=True),
        Parameter("order", 1.0, "of the polynomial", lowest=1.0, highest=4.0, is_whole=True),
    ),
    check=_check_order,
)
FOAW_END_FIT = Estimator(
    "foaw-end-fit",
    "chord over a window that grows while it is straight within one count",
    start=lambda setup: _start_adaptive(setup, lambda i: (1.0 / i, 0.0, 0.0)),
    stand_in=lambda setup: f"moving-average:window={setup.whole('window')}",
    parameters=(WINDOW, BAND),
)
FOAW_BEST_FIT = Estimator(
    "foaw-best-fit",
    "least-squares slope over a window that grows while it is straight within one count",
    start=lambda setup: _start_adaptive(setup, _best),
    stand_in=lambda setup: f"least-squares:window={setup.whole('window') + 1}",
    parameters=(WINDOW, BAND),
)
ESTIMATORS = (LEAST_SQUARES, FOAW_END_FIT, FOAW_BEST_FIT)
