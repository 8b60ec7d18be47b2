"""A leg: one stretch of motion under one law, on which the nonlinear torques are polynomials in time.

Theory: the polynomial p of degree 9 of each nonlinear torque passes through its values at the ten
Legendre–Gauss–Lobatto nodes of the leg. With p the motion is linear, so a `Flow` follows it exactly; its last states
are the coefficients of p about the instant half a leg ahead, x_i' = (i + 1)·x_{i+1}·2/h, p = Σ x_i·(−1)^i. The motion
in turn determines the torques at the nodes. This fixed point is iterated to rounding (exponential collocation;
Hochbruck & Ostermann 2010, doi:10.1017/S0962492910000048). Then p is compared with the torques between the nodes. A leg
is too long when the iteration does not converge, or when p is off by more than `TOLERANCE` of the largest torque.

Times are in nanoseconds, everything else is SI.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from haptic_fieldbus.numerics.exact import expm
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.mechanics.flow import Flow
from haptic_fieldbus.sim.mechanics.load import ORDER, TWIST, Torques
from haptic_fieldbus.sim.mechanics.motion import ANGLE, SPEED

TOLERANCE = 1e-11
"""Largest error of p between the nodes, relative to the largest torque."""
TERMS = 10
"""Coefficients of each polynomial."""
_CONTRACTION = 0.25
"""Largest permitted ratio of the changes of two successive iterations."""
# The iteration ends when the torques change by less than this share of the largest torque.
_SETTLED = 1e-13
_ROUNDING = 4e-16

NODES = np.concatenate([[-1.0], np.sort(legendre.Legendre.basis(TERMS - 1).deriv().roots().real), [1.0]])
"""Nodes of a leg from −1 to 1: its ends and the extrema of the Legendre polynomial of degree 9."""
# Points between the nodes at which p is compared with the torques.
_BETWEEN = np.array([0.5 * (NODES[at] + NODES[at + 1]) for at in (1, 4, 7)])
_FIT = np.linalg.inv(np.vander(NODES, increasing=True))
_CHECK = np.vander(_BETWEEN, TERMS, increasing=True)
# Value of p at the present, from its coefficients about the instant half a leg ahead.
_OUTPUT = (-1.0) ** np.arange(TERMS)


@dataclass(frozen=True)
class LegWatch:
    """A watched form, sign·(form·z) + offset, that must not become negative; `row` is the index of the form."""

    row: int
    sign: float
    offset: float


class Leg:
    """All legs of one length and one law; `system` (12, 12) in 1/s, `rows` (r, 12) are the forms that are watched."""

    def __init__(self, system: Matrix, torques: Torques, rows: Matrix, on_motor: int, length_ns: float) -> None:
        """Prepare the leg; `on_motor` is the form to which the nonlinear torque on the motor is added."""
        self.length_ns = length_ns
        self.torques = torques
        order = ORDER + TERMS * len(torques.rows)
        a = np.zeros((order, order))
        a[:ORDER, :ORDER] = system
        self._rows = np.zeros((len(rows), order))
        self._rows[:, :ORDER] = rows
        per_second = 2e9 / length_ns
        # The coefficients of one polynomial form a chain: the derivative of each is a multiple of the next one.
        for channel, (row, inertia) in enumerate(zip(torques.rows, torques.inertias, strict=True)):
            at = ORDER + TERMS * channel
            a[at : at + TERMS - 1, at + 1 : at + TERMS] = np.diag(np.arange(1, TERMS) * per_second)
            if row != SPEED or system[ANGLE, SPEED]:  # a shaft that sticks is not moved
                a[row, at : at + TERMS] = _OUTPUT / inertia
            if row == SPEED:
                self._rows[on_motor, at : at + TERMS] = _OUTPUT
        self.flow = Flow(a, rate=TERMS * per_second)
        self._prepare(a * 1e-9)

    def _prepare(self, a: Matrix) -> None:
        """Compute the motion at and between the nodes, from the state at the start and the torques at the nodes."""
        moments = (np.concatenate([NODES, _BETWEEN]) + 1) * (self.length_ns / 2)
        transitions = expm(a * moments[:, np.newaxis, np.newaxis])
        self._node_ns = moments[:TERMS]
        watched = np.stack([self._rows, self._rows @ a])
        self._watched = np.einsum("fro,mon->frmn", watched, transitions[:TERMS])
        self._to_node = transitions[:TERMS]
        seen = transitions[:, [ANGLE, SPEED, TWIST]].transpose(1, 0, 2)
        self._free = seen[..., :ORDER]
        channels = len(self.torques.rows)
        poly = seen[..., ORDER:].reshape(*seen.shape[:2], channels, TERMS) @ _FIT
        self._forced = poly.reshape(*seen.shape[:2], channels * TERMS)

    def start(self, state: Sequence[float], direction: int) -> tuple[Matrix, float]:
        """Return (state with the coefficients of the polynomials, error relative to the permitted one).

        `state` has shape (12,). The leg is short enough when the error is at most 1; it is inf when the iteration does
        not converge.
        """
        z = np.array(state)
        if not self.torques.rows:
            return z, 0.0
        free = self._free @ z
        moved = free
        values = np.zeros((len(self.torques.rows), TERMS))
        # At a large angle, the rounding of the angle itself limits the accuracy of the torques.
        allowed = self.torques.scale * max(1.0, _ROUNDING / _SETTLED * self.torques.fineness * abs(state[ANGLE]))
        change = np.inf
        while change > _SETTLED * allowed:
            before = change
            angle, speed, twist = moved
            torques = self.torques.at(angle, speed, angle - twist, direction)
            change = float(np.abs(torques[:, :TERMS] - values).max())
            # Slow convergence means that the leg is too long.
            if change > _CONTRACTION * before:
                return z, np.inf
            values = torques[:, :TERMS]
            moved = free + self._forced @ values.ravel()
        coefficients = values @ _FIT.T
        off = float(np.abs(coefficients @ _CHECK.T - torques[:, TERMS:]).max())
        return np.concatenate([z, coefficients.ravel()]), off / (TOLERANCE * allowed)

    def first(self, z: Matrix, watches: Sequence[LegWatch]) -> tuple[float, LegWatch] | None:
        """Return (time [ns], watch) of the first form that becomes negative; None when none does on this leg.

        `z` is the state of `start`.
        """
        values, rates = self._watched @ z
        found: tuple[float, LegWatch] | None = None
        for watch in watches:
            level = watch.sign * values[watch.row] + watch.offset
            rate = watch.sign * rates[watch.row]
            # Between two nodes: negative at the second one, or a minimum by the signs of the rate.
            suspicious = (level[1:] < 0.0) | ((rate[:-1] < 0.0) & (rate[1:] > 0.0))
            if suspicious.any():
                found = self._earlier(z, watch, np.flatnonzero(suspicious), found)
        return found

    def _earlier(
        self, z: Matrix, watch: LegWatch, nodes: NDArray[np.intp], found: tuple[float, LegWatch] | None
    ) -> tuple[float, LegWatch] | None:
        """Return the time at which this form becomes negative after one of these nodes, if it is before `found`."""
        form = watch.sign * self._rows[watch.row]
        for node in nodes:
            begin_ns, end_ns = self._node_ns[node], self._node_ns[node + 1]
            if found is not None and begin_ns >= found[0]:
                break
            after_ns = self.flow.first_negative(self._to_node[node] @ z, end_ns - begin_ns, form, watch.offset)
            if after_ns is not None:
                return (begin_ns + after_ns, watch) if found is None or begin_ns + after_ns < found[0] else found
        return found
