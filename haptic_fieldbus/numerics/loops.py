"""Parameters of many closed loops for `batch`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = float | Sequence[float] | Array | Flags


@dataclass(frozen=True, eq=False)
class Loops:
    """Parameters of N loops in SI; arrays (N,), the environment's a, b, c, d (N, k, k), (N, k), (N, k), (N,)."""

    mass: Array
    damping: Array
    period: Array
    delay: Array
    a: Array
    b: Array
    c: Array
    d: Array
    lag: Array
    coulomb: Array
    resolution: Array
    """One encoder count; 0 without an encoder."""
    phase: Array
    """Position of the encoder's zero within a count, as a share of a count."""
    unilateral: Flags
    """True for contact at positions above 0 only, without pulling."""
    saturation: Array
    """Largest force; ∞ without saturation."""
    push: Array
    """Constant force of the hand, in addition to the environment's."""
    position: Array
    velocity: Array

    def __len__(self) -> int:
        return len(self.mass)

    def part(self, rows: NDArray[np.int64]) -> "Loops":
        """Return the loops with these row numbers, (n,)."""
        return replace(self, **{field.name: getattr(self, field.name)[rows] for field in fields(self)})


def loops(
    *,
    mass: Numbers,
    damping: Numbers,
    period: Numbers,
    delay: Numbers = 0.0,
    stiffness: Numbers = 0.0,
    virtual_damping: Numbers = 0.0,
    lag: Numbers = 0.0,
    coulomb: Numbers = 0.0,
    resolution: Numbers = 0.0,
    phase: Numbers = 0.0,
    unilateral: Numbers = False,
    saturation: Numbers = math.inf,
    push: Numbers = 0.0,
    position: Numbers = 0.0,
    velocity: Numbers = 0.0,
    environments: list[StateSpace] | None = None,
) -> Loops:
    """Return loops from numbers or arrays, broadcast to N loops.

    `environments`, discrete systems of equal order, replace the spring and its damper. The damper acts on the backward
    difference. Raises UsageError for impossible numbers, naming the first loop that has them.
    """
    given = (mass, damping, period, delay, stiffness, virtual_damping, lag, coulomb, resolution, phase, saturation,
             push, position, velocity, unilateral)  # fmt: skip
    arrays = [np.asarray(each) for each in given] + ([] if environments is None else [np.zeros(len(environments))])
    rows = [np.ravel(row) for row in np.broadcast_arrays(*arrays)]
    m, b, span, late, k, virtual, slow, fc, step, shift, most, hand, x, v = (
        row.astype(np.float64) for row in rows[:14]
    )
    if environments is None:
        # A period that is not above 0 is refused below; until then it must not divide.
        a, by, c, d = _spring_damper(k, virtual, np.where(span > 0.0, span, 1.0))
    else:
        a, by, c, d = _stack(environments)
    made = Loops(m, b, span, late, a, by, c, d, slow, fc, step, shift, rows[14].astype(np.bool_), most, hand, x, v)
    _check(made)
    return made


def _spring_damper(k: Array, virtual: Array, period: Array) -> tuple[Array, Array, Array, Array]:
    """Return F_k = −K·x_k − B·(x_k − x_{k−1})/T as (a, b, c, d); without any damping it has no state."""
    order = 1 if virtual.any() else 0
    slope = virtual / period
    ones = np.ones((len(k), order))
    return np.zeros((len(k), order, order)), ones, slope[:, None] * ones, -k - slope


def _stack(environments: list[StateSpace]) -> tuple[Array, Array, Array, Array]:
    return (
        np.array([each.a for each in environments]),
        np.array([each.b[:, 0] for each in environments]),
        np.array([each.c[0] for each in environments]),
        np.array([each.d[0, 0] for each in environments]),
    )


def _check(made: Loops) -> None:
    expected = {
        "mass": ("a number above 0", (made.mass > 0.0) & np.isfinite(made.mass)),
        "period": ("a time above 0 s", (made.period > 0.0) & np.isfinite(made.period)),
        "d": ("a number as stiffness", np.isfinite(made.d)),
        **{
            name: ("a number from 0 up", (getattr(made, name) >= 0.0) & np.isfinite(getattr(made, name)))
            for name in ("damping", "delay", "lag", "coulomb", "resolution")
        },
        "saturation": ("a force above 0", made.saturation > 0.0),
        "coulomb": ("no torque loop's lag beside friction", (made.coulomb == 0.0) | (made.lag == 0.0)),
    }
    for name, (text, good) in expected.items():
        if not good.all():
            at = int(np.argmin(good))
            raise UsageError(f"loop {at}: {name} {exactly(getattr(made, name)[at])}: expected {text}")
