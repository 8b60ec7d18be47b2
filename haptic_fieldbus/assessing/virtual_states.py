"""Ideal response of elements with virtual states; imported only for scenes that contain such an element.

Responses of linear systems to whole motions at once are the reference for the steps of the loop. The exact response
replaces the motion between two instants by the cubic with the right position and velocity at both (Hermite) and solves
the system exactly for it. Its error is that of the cubic: fourth order in the time between them.
"""

import math
from collections.abc import Mapping

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.integrators import rest
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, polynomial_step, polynomial_system
from haptic_fieldbus.scenes.element import DynamicElement
from haptic_fieldbus.signals import Signal

TERMS_OF_A_PIECE = 20
"""Terms of the Taylor series over a piece, which is at most a radian of the fastest mode long."""


def recursion(transition: Matrix, drive: Matrix, start: Array) -> Matrix:
    """Return the sequence z_0 = start, z_{i+1} = Φ z_i + drive_i, shape (N + 1, n).

    `transition` Φ is (n, n), `drive` (N, n), `start` (n,).
    """
    # A Python loop over N steps would be slow. About √N blocks of √N steps each start from zero and run together; a
    # second loop over the blocks finds their true starts, whose free motion is added.
    steps, order = drive.shape
    length = max(1, math.isqrt(steps))
    blocks = -(-steps // length)
    padded = np.zeros((blocks * length, order))
    padded[:steps] = drive
    padded = padded.reshape(blocks, length, order)
    own = np.zeros((blocks, length + 1, order))
    powers = np.empty((length + 1, order, order))
    powers[0] = np.eye(order)
    for step in range(length):
        own[:, step + 1] = own[:, step] @ transition.T + padded[:, step]
        powers[step + 1] = transition @ powers[step]
    starts = np.empty((blocks + 1, order))
    starts[0] = start
    for block in range(blocks):
        starts[block + 1] = powers[length] @ starts[block] + own[block, length]
    states = own[:, :length] + np.einsum("lij,bj->bli", powers[:length], starts[:-1])
    return np.asarray(np.vstack([states.reshape(-1, order), starts[-1:]])[: steps + 1])


class SequenceResponse:
    """Output of a discrete (position, velocity) system, for inputs that come in parts.

    The start is that of `integrators.bind`: at rest at the first position, with the force `stiffness` times position.
    """

    def __init__(self, system: StateSpace, stiffness: float) -> None:
        self._system, self._stiffness = system, stiffness
        self._start: float | None = None
        self._state = np.zeros(system.order)

    def __call__(self, inputs: Matrix) -> Array:
        """Return the output (N,) for the next `inputs` (N, 2), N at least 1, one row for each period."""
        system = self._system
        if self._start is None:
            self._start = float(inputs[0, 0])
        moved = inputs - np.array([self._start, 0.0])
        states = recursion(system.a, moved @ system.b.T, self._state)
        self._state = states[-1]
        return np.asarray(self._stiffness * self._start + states[:-1] @ system.c[0] + moved @ system.d[0])


class ExactResponse:
    """Virtual states of a continuous (position, velocity) system along a motion, from `start` at its first instant.

    `nodes_ns` (N,) are rising instants, equally spaced except for the first interval. `position` [m or rad] and
    `velocity` [m/s or rad/s], both (N,), describe the motion at these nodes. `start` (order,) are the states at the
    first of them; None: at rest there.
    """

    def __init__(
        self, space: StateSpace, nodes_ns: Times, position: Array, velocity: Array, start: Array | None = None
    ) -> None:
        self._space, self._nodes_ns = space, nodes_ns
        self._position, self._velocity = position, velocity
        if start is None:
            start = rest(space)[0] * position[0]
        self.states: Matrix = start[None]
        """Virtual states at the nodes, (N, order)."""
        # The first interval may have another length, so it is stepped by itself.
        first = self._advance(np.array([0]), (nodes_ns[1:2] - nodes_ns[0]) * 1e-9, position[1:2], velocity[1:2])[0]
        span = float(nodes_ns[-1] - nodes_ns[-2]) * 1e-9
        increment, gammas = polynomial_step(space.a, space.b, span, 3)
        x = _cubic(position[1:-1], velocity[1:-1], position[2:], velocity[2:], span)
        drive: Matrix = np.zeros((len(nodes_ns) - 2, space.order))
        for power, (derivative, gamma) in enumerate(zip(x, gammas, strict=True)):
            drive = drive + derivative * span**power @ gamma.T
        self.states = np.vstack([start, recursion(increment + np.eye(space.order), drive, first)])

    @property
    def force(self) -> Array:
        """Force at the nodes [N or N·m], (N,)."""
        return self._output(self.states, self._position, self._velocity)

    def force_at(self, times_ns: Times, position: Array, velocity: Array) -> Array:
        """Return the force [N or N·m], (M,), at times between the nodes or up to one interval after the last.

        `position` and `velocity`, (M,) each, describe the motion at these times.
        """
        node = np.searchsorted(self._nodes_ns, times_ns, side="right") - 1
        span: Array = (times_ns - self._nodes_ns[node]).astype(np.float64) * 1e-9
        states = self._advance(node, span, position, velocity)
        return self._output(states, position, velocity)

    def _advance(self, node: Times, span: Array, position: Array, velocity: Array) -> Matrix:
        """Return the states (M, order) a `span` [s] after each node, where the motion has this position and velocity.

        All arguments are (M,). The spans differ, so a Taylor series of the autonomous system of states and input takes
        the place of a matrix exponential. It is used in pieces that are short enough for it to converge at once.
        """
        system = polynomial_system(self._space.a, self._space.b, 3)
        inputs = _cubic(self._position[node], self._velocity[node], position, velocity, span)
        known = np.hstack([self.states[node], *inputs])
        pieces = 1 + int(np.abs(np.linalg.eigvals(self._space.a)).max(initial=0.0) * span.max(initial=0.0))
        for _ in range(pieces):
            term = known
            for power in range(1, TERMS_OF_A_PIECE):
                term = term @ system.T * (span / (pieces * power))[:, None]
                known = known + term
        return np.asarray(known[:, : self._space.order])

    def _output(self, states: Matrix, position: Array, velocity: Array) -> Array:
        to_position, to_velocity = self._space.d[0]
        return np.asarray(states @ self._space.c[0] + to_position * position + to_velocity * velocity)


def _cubic(x: Array, v: Array, x_end: Array, v_end: Array, span: Array | float) -> list[Matrix]:
    """Return (position, velocity) and its first three derivatives by time at the start of a cubic, (n, 2) each."""
    # At a span of 0 both differences are 0, and any divisor serves.
    safe = np.where(np.asarray(span) > 0.0, span, 1.0)
    way, gain = (x_end - x) / safe - v, v_end - v
    second, third = (6.0 * way - 2.0 * gain) / safe, (6.0 * gain - 12.0 * way) / safe**2
    rows = [x, v, second, third, np.zeros_like(x)]
    return [np.stack([rows[power], rows[power + 1]], axis=-1) for power in range(4)]


class ResponseToError:
    """Force that a linear element adds for the error of its inputs, part by part.

    The error is a straight line between samples (first-order hold) and begins at rest; `period` in s.
    """

    def __init__(self, element: DynamicElement, period: float) -> None:
        space = element.dynamics
        self._response = SequenceResponse(integrators.discrete(space, period, "exact-foh"), rest(space)[1])

    def __call__(self, real: Mapping[Signal, Array], true: Mapping[Signal, Array]) -> Array:
        """Return the forces in the next periods, `(n_periods,)`, from their real and true inputs."""
        error = np.stack([real[signal] - true[signal] for signal in (Signal.POSITION, Signal.VELOCITY)], axis=-1)
        return self._response(error)
