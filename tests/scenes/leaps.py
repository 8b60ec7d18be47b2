"""Motions as wild as they come: any moves, and any velocity said beside them."""

from itertools import pairwise

import numpy as np
from hypothesis import strategies as st

from tests.scenes.sheet import Motion


@st.composite
def leaps(draw: st.DrawFn, largest: float, fastest: float = 10.0) -> Motion:
    """Up to 60 moves of up to `largest` [m] at 1 kHz; velocities [m/s] that need not have to do with them."""
    moves = draw(st.lists(st.floats(-largest, largest), min_size=1, max_size=60))
    speeds = draw(st.lists(st.floats(-fastest, fastest), min_size=len(moves) + 1, max_size=len(moves) + 1))
    return Motion(1e-3, np.concatenate([[0.0], np.cumsum(moves)]), np.array(speeds))


def along(places: list[float], samples: int) -> Motion:
    """From place to place in straight lines of so many samples each, quasi-statically."""
    lines = [np.linspace(a, b, samples, endpoint=False) for a, b in pairwise(places)]
    position = np.concatenate([*lines, [places[-1]]])
    return Motion(1e-3, position, np.zeros(len(position)))
