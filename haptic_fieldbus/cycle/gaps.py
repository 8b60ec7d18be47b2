"""How much of the feedback comes too late or not at all, and whether the loop can stand it.

Force is held between two samples, so a gap of s periods counts more than s single ones. For a spring with light damping
the loop is stable up to K < 2·b·ΣT_i/ΣT_i² (`margins.patterns`), against K < 2·b/T without gaps: the gaps of a second
divide the stiffness limit by

    stretch = Σs²/Σs   (s: periods between two samples)

The loop is given up when the stretch exceeds its stability margin, or when more than a fifth of the samples is missing.
One or two gaps are no pattern: after them the handle comes to rest again.
"""

from collections import deque

from haptic_fieldbus.planning.limits import LARGEST_MISSING_SHARE

WINDOW = 1.0
"""[s]; gaps longer ago are forgotten."""
FEWEST_PERIODS = 20
FEWEST_GAPS = 3
"""So many gaps of a window are a pattern."""


class Gaps:
    """The gaps of the last second; `margin` is stiffness limit over stiffness, infinity where there is none."""

    def __init__(self, period: float, margin: float) -> None:
        self._periods = max(FEWEST_PERIODS, round(WINDOW / period))
        self._window_ns = round(self._periods * period * 1e9)
        self._margin = margin
        self._gaps: deque[tuple[int, int]] = deque()
        self._missing = 0
        self._surplus = 0
        """Σs² − Σs over the gaps."""

    def note(self, t_ns: int, steps: int) -> None:
        """Count a sample that came `steps` periods after the one before; `steps` is 2 or more."""
        gaps = self._gaps
        gaps.append((t_ns, steps))
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
        """Factor by which the gaps divide the stiffness limit."""
        return 1.0 + self._surplus / self._periods

    @property
    def too_many(self) -> bool:
        """Whether the loop is to be given up."""
        if self.share > LARGEST_MISSING_SHARE:
            return True
        return len(self._gaps) >= FEWEST_GAPS and self.stretch > self._margin
