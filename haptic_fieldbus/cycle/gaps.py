"""How much of the feedback comes too late or not at all, and whether the loop can stand it.

Force is held between two samples, and a held force grows old. A spring K gives more energy in a gap of s periods than
in s single periods, by ½·K·T²·(s² − s)·v² at the speed v. Gaps may fall where the handle is fastest, once in each half
turn of its motion, and then each of them finds twice the mean of v². So gaps divide the limit of the stiffness by

    stretch = 1 + Σ(s² − s)/Σs/a   (s: periods between two samples, a: mean age of the force, ½ + td/T + λ/T)

at most, whatever their timing; the proof is in `margins.patterns`. Without delay a is ½, and gaps that come at any time
cost half of it, Σs²/Σs.

The loop is given up when the stretch is above `AxisPlan.largest_stretch`, or when more than a fifth of the samples is
missing. The stretch is that of the last second. Of rare gaps it is that from the third last one to the last one: one or
two gaps are no pattern, because after them the handle comes to rest again.
"""

from collections import deque

from haptic_fieldbus.planning.limits import LARGEST_MISSING_SHARE

WINDOW = 1.0
"""[s]; the share of missing samples is that of a window."""
FEWEST_PERIODS = 20
FEWEST_GAPS = 3
"""So many gaps are a pattern."""


class Gaps:
    """The gaps of the last second; `age` is the mean age of the force in periods, `largest` the largest stretch."""

    def __init__(self, period: float, age: float, largest: float) -> None:
        self._periods = max(FEWEST_PERIODS, round(WINDOW / period))
        self._period_ns = period * 1e9
        self._window_ns = round(self._periods * self._period_ns)
        self._age, self._largest = age, largest
        self._gaps: deque[tuple[int, int]] = deque()
        self._last: deque[tuple[int, int]] = deque(maxlen=FEWEST_GAPS)
        """The last gaps, however long ago: time and s² − s."""
        self._missing = 0
        self._surplus = 0
        """Σ(s² − s) over the gaps."""

    def note(self, t_ns: int, steps: int) -> None:
        """Count a sample that came `steps` periods after the one before; `steps` is 2 or more."""
        gaps = self._gaps
        gaps.append((t_ns, steps))
        self._last.append((t_ns, steps * (steps - 1)))
        self._missing += steps - 1
        self._surplus += steps * (steps - 1)
        while gaps[0][0] < t_ns - self._window_ns:
            _, old = gaps.popleft()
            self._missing -= old - 1
            self._surplus -= old * (old - 1)

    @property
    def share(self) -> float:
        """Share of the window's samples that are missing."""
        return self._missing / self._periods

    @property
    def stretch(self) -> float:
        """Factor by which the gaps divide the stiffness limit at the worst timing."""
        surplus, periods = self._surplus, float(self._periods)
        if len(self._gaps) < FEWEST_GAPS == len(self._last):  # from the end of the first of them on
            (first_ns, _), (_, second), (last_ns, third) = self._last
            surplus, periods = second + third, (last_ns - first_ns) / self._period_ns
        return 1.0 + surplus / (periods * self._age)

    @property
    def too_many(self) -> bool:
        """Whether the loop is to be given up."""
        if self.share > LARGEST_MISSING_SHARE:
            return True
        return len(self._last) >= FEWEST_GAPS and self.stretch > self._largest
