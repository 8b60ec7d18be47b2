"""Work of a held force in a motion into a spring and out again, in sums over samples.

The handle moves by one way a period, `deep` ways in and as many out. The force at a sample is one unit for each way of
depth; energies are in ways times units of force.
"""

import math

import numpy as np


def triangle(deep: int) -> list[int]:
    """Return the depth at each sample, from 1 up to `deep` and down to 0."""
    return [*range(1, deep + 1), *range(deep - 1, -1, -1)]


def held_work(deep: int, delay: float, most: int | None = None) -> float:
    """Return the work of the force on the handle, each force acting `delay` periods after its sample, for a period.

    A delay of −1 pairs each force with the way before its sample. `most` is the depth at which the force is cut.
    """
    rest = [0] * (2 + math.ceil(abs(delay)))
    places = np.array([*rest, *triangle(deep), *rest], dtype=np.float64)
    forces = -np.minimum(places, deep if most is None else most)
    ways = np.append(np.diff(places), 0.0)  # the way of the period that begins at the sample
    whole = math.floor(delay)
    share = delay - whole
    return float((1.0 - share) * _paired(forces, ways, whole) + share * _paired(forces, ways, whole + 1))


def _paired(forces: np.typing.NDArray[np.float64], ways: np.typing.NDArray[np.float64], later: int) -> float:
    """Return the sum of each force times the way that begins so many samples later."""
    if later < 0:
        return float(forces[-later:] @ ways[:later])
    return float(forces[: len(forces) - later] @ ways[later:])
