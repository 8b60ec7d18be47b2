"""All places of an axis: what its elements without memory feel like together, at places and between them.

A single stiffness does not describe a contact that stiffens with depth, a magnet, or stops beside detents. `survey`
asks every element for its bounds (`scenes.local`) at a set of places, and on the intervals between neighbouring ones.
The places show where the handle may rest, for the eigenvalues. The intervals cover the whole travel, the rest of an
unlimited one included, and bound slope and damping for the proof of passivity (`margins.increments`).

A place counts where the force at rest is at most the effort limit: beyond it the motor gives a constant force, and the
slope that is felt is 0.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.scenes.element import Varying
from haptic_fieldbus.scenes.local import Interval, Local

Array = NDArray[np.float64]
EVERYWHERE: Interval = (-math.inf, math.inf)
"""Travel without limits."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Bounds on each of n intervals, or at n places; a row for each element, shape (elements, n)."""

    least_force: Array
    most_force: Array
    least_stiffness: Array
    most_stiffness: Array
    damping: Array
    loss: Array

    def scaled(self, row: int, factor: float) -> "Survey":
        """Return the same with `factor` times the force of one element."""
        by = np.ones((len(self.loss), 1))
        by[row] = factor
        forces = {"least_force": by * self.least_force, "most_force": by * self.most_force}
        slopes = {"least_stiffness": by * self.least_stiffness, "most_stiffness": by * self.most_stiffness}
        return replace(self, **forces, **slopes)

    @cached_property
    def smallest_force(self) -> Array:
        """Smallest magnitude of the force of all elements together, (n,)."""
        low, high = self.least_force.sum(axis=0), self.most_force.sum(axis=0)
        return np.asarray(np.maximum(np.maximum(low, -high), 0.0), dtype=np.float64)

    @cached_property
    def one_sided(self) -> NDArray[np.bool_]:
        """Where all elements push in the same direction, (n,)."""
        same = (self.least_force >= 0.0).all(axis=0) | (self.most_force <= 0.0).all(axis=0)
        return np.asarray(same, dtype=np.bool_)

    @cached_property
    def largest_forces(self) -> Array:
        """Largest magnitude of the force of each element, (elements, n)."""
        return np.maximum(np.abs(self.least_force), np.abs(self.most_force))

    def lossy_damping(self, effort: float) -> Array:
        """Return the damping of all elements when the motor gives at most `effort` [N or N·m], (n,)."""
        forces = np.where(
            self.one_sided & np.isfinite(effort), np.minimum(self.largest_forces, effort), self.largest_forces
        )
        with np.errstate(invalid="ignore"):
            return np.asarray((self.damping + np.where(self.loss > 0.0, self.loss * forces, 0.0)).sum(axis=0))

    def damping_at(self, stiffness: Array, effort: float) -> Array:
        """Return the damping of the elements that have a `stiffness`, (elements, n), there: (n,).

        At the surface of a contact it is that of the side with this stiffness.
        """
        acts = stiffness != 0.0
        return replace(self, damping=acts * self.damping, loss=acts * self.loss).lossy_damping(effort)

    def slope(self, effort: float) -> Array:
        """Return the largest slope of either sign when the motor gives at most `effort` [N or N·m], (n,)."""
        steepest = np.maximum(np.abs(self.least_stiffness.sum(axis=0)), np.abs(self.most_stiffness.sum(axis=0)))
        # Where an interval begins at the effort limit, rounding may put its force just below.
        return np.where(self.smallest_force >= (1.0 - 1e-9) * effort, 0.0, steepest)


def survey(elements: Sequence[Varying], intervals: Sequence[Interval]) -> Survey:
    """Return the bounds of each element on each interval; the interval of a place is (place, place)."""
    found = [[each.local(*interval) for interval in intervals] for each in elements]

    def table(value: str, part: int | None = None) -> Array:
        def of(local: Local) -> float:
            read = getattr(local, value)
            return float(read if part is None else read[part])

        return np.array([[of(local) for local in row] for row in found], dtype=float).reshape(len(elements), -1)

    return Survey(
        table("force", 0),
        table("force", 1),
        table("stiffness", 0),
        table("stiffness", 1),
        table("damping"),
        table("loss"),
    )


@dataclass(frozen=True, eq=False)
class Terrain:
    """The places of an axis and the intervals between them."""

    position: Array
    """Places [m or rad], (n,)."""
    places: Survey
    between: Survey
    """On the n + 1 intervals before, between and after the places, as far as the travel goes."""

    def scaled(self, row: int, factor: float) -> "Terrain":
        """Return the same with `factor` times the force of one element."""
        return Terrain(self.position, self.places.scaled(row, factor), self.between.scaled(row, factor))


def terrain(elements: Sequence[Varying], travel: Interval, effort: float) -> Terrain:
    """Return the terrain of these elements within `travel`, for a motor that gives at most `effort` [N or N·m]."""
    lower, upper = travel
    marks = {place for each in elements for place in each.places(lower, upper, effort)}
    grid = sorted(place for place in {*marks, *travel} if lower <= place <= upper and math.isfinite(place))
    edges = [lower, *grid, upper]
    return Terrain(
        np.array(grid),
        survey(elements, [(place, place) for place in grid]),
        survey(elements, list(_neighbours(edges))),
    )


def _neighbours(edges: Sequence[float]) -> Iterable[Interval]:
    return ((low, high) for low, high in pairwise(edges) if low < high)
