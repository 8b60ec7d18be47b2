"""Energy that sampled forces give to hands, by brute force over the possible motions of hands.

A motion of the angle θ a period, v(t + T) = e^{jθ}·v(t), is cut into cells of constant speed. Its positions at the
samples are sums of these speeds, the commands follow from the positions, each motor's force from its commands, cell by
cell. The work of all forces is then a quadratic form of the speeds. Its largest eigenvalue, relative to the energy
b·∫v² that the devices absorb, is the share of their damping that the worst motion of this angle needs. The largest
share over all angles decides. Cells have equal lengths, except for a border at the instants at which commands change.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Work of a held force in a motion into a spring and out again, in sums over samples.
#
# The handle moves by one way a period, `deep` ways in and as many out. The force at a sample is one unit for each way
# of depth; energies are in ways times units of force.


def triangle(deep: int) -> list[int]:
    """Return the depth at each sample, from 1 up to `deep` and down to 0."""
    return [*range(1, deep + 1), *range(deep - 1, -1, -1)]


def held_work(deep: int, delay: float, most: int | None = None) -> float:
    """Return the work of the force on the handle; each force acts for one period, `delay` periods after its sample.

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


Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
CELLS = 24
"""Cells of a period."""
ANGLES = np.concatenate([[1e-3, 0.02, 0.05], np.linspace(0.1, math.pi, 32)])
FINER = 9
"""Angles around the worst one, in each of two refinements."""


@dataclass(frozen=True)
class LateDrive:
    """Device of a damping [N·s/m], whose commands act after a delay [s] through a motor with a lag [s]."""

    damping: float
    delay: float
    lag: float = 0.0


def worst_share(
    forces: Callable[[complex], Complex | complex], drives: Sequence[LateDrive], period: float, cells: int = CELLS
) -> float:
    """Return the share of the drives' dampings that the worst motion needs.

    `forces` is H(z) of the commands F = H·x, a number or (n, n).
    """

    def needed(angles: Array) -> Array:
        return np.array([_largest(forces(complex(z)), z, drives, period, cells) for z in np.exp(1j * angles)])

    angles = ANGLES
    for _ in range(3):
        found = needed(angles)
        at = int(found.argmax())
        angles = np.linspace(angles[max(at - 1, 0)], angles[min(at + 1, len(angles) - 1)], FINER)
    return float(found.max())


def _largest(force: Complex | complex, z: complex, drives: Sequence[LateDrive], period: float, cells: int) -> float:
    """Return the largest eigenvalue of work against dissipation over the motions of one angle."""
    matrix = np.atleast_2d(np.asarray(force, dtype=np.complex128))
    grids = [_borders(drive, period, cells) for drive in drives]
    widths = [np.diff(grid) for grid in grids]
    given = [_given(drive, grid, z, period) for drive, grid in zip(drives, grids, strict=True)]
    roots = [np.sqrt(drive.damping * width) for drive, width in zip(drives, widths, strict=True)]
    rows = []
    for i, work in enumerate(given):
        # A speed of 1 in a cell of drive j moves its samples by width/(z − 1), and so the command of drive i.
        blocks = [
            np.outer(work / roots[i], matrix[i, j] * widths[j] / (z - 1.0) / roots[j]) for j in range(len(drives))
        ]
        rows.append(np.hstack(blocks))
    form = np.vstack(rows)
    return float(np.linalg.eigvalsh(0.5 * (form + form.conj().T))[-1])


def _borders(drive: LateDrive, period: float, cells: int) -> Array:
    """Return the borders of the cells of a period [s]; a command changes at one of them."""
    change = drive.delay % period
    return np.unique(np.round(np.append(np.linspace(0.0, period, cells + 1), change), 15))


def _given(drive: LateDrive, grid: Array, z: complex, period: float) -> Complex:
    """Return ∫f over each cell for a command of 1 at the sample at 0, of zᵏ at sample k."""
    change = round(drive.delay % period, 15)
    late = z ** -math.floor((drive.delay + 1e-12) / period)
    widths = np.diff(grid)
    commands: Complex = np.where(grid[:-1] < change - 1e-15, late / z, late).astype(np.complex128)
    if not drive.lag:
        return np.asarray(commands * widths, dtype=np.complex128)
    fades = np.exp(-widths / drive.lag)
    # After a period the force must be z times what it was: found from a period that starts with 0.
    end = 0.0 + 0.0j
    for command, fade in zip(commands, fades, strict=True):
        end = command + (end - command) * fade
    start = end / (z - math.exp(-period / drive.lag))
    found = np.empty(len(widths), dtype=np.complex128)
    for cell, (command, fade, width) in enumerate(zip(commands, fades, widths, strict=True)):
        found[cell] = command * width + (start - command) * drive.lag * (1.0 - fade)
        start = command + (start - command) * fade
    return found
