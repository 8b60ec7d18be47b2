"""Linear loops from event to event: at each instant a position is measured or a force begins to act.

Between two events a device moves under a constant command, by the exponential of its matrix. The state is carried as
rows, each a linear function of the state at the beginning. So one run of a turn (a period, or a pattern of several
periods) gives its matrix, and the eigenvalues show whether motions grow (Floquet).

Instants are whole picoseconds, so that equal instants compare equal.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Free motion of a linear system ẋ = A x at equally spaced instants, with the digits of `numpy.longdouble`.
#
# The exponential is the series of a small part of A·T, squared again and again. The motion is doubled: the states from
# n to 2n are those from 0 to n, moved by n·T. A motion of N steps therefore takes log₂ N products, and rounds as often.

Array = NDArray[np.float64]
Long = NDArray[np.longdouble]
TERMS, SMALL = 24, 0.25
"""Terms of the series, and the largest norm for which it is taken: the first term left out is below 1e-38."""


def states_of(system: Array, start: Array, period: float, steps: int) -> Array:
    """Return the states at 0, T, … steps·T for A (n, n) and a start (n,), shape (steps + 1, n)."""
    power = exponential(np.asarray(system, dtype=np.longdouble) * np.longdouble(period))
    states: Long = np.asarray(start, dtype=np.longdouble)[None]
    while len(states) <= steps:
        states = np.concatenate([states, states @ power.T])
        power = power @ power
    return states[: steps + 1].astype(np.float64)


def exponential(matrix: Long) -> Long:
    """Return e^M of a square matrix."""
    norm = float(np.abs(matrix).sum(axis=1).max(initial=0.0))
    halvings = max(0, math.ceil(math.log2(norm / SMALL))) if norm else 0
    part = matrix / np.longdouble(2) ** halvings
    total = term = np.eye(len(matrix), dtype=np.longdouble)
    for order in range(1, TERMS):
        term = term @ part / np.longdouble(order)
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


Law = Callable[[Sequence[Array], Sequence[Array]], tuple[Sequence[Array], Sequence[Array]]]
"""Function from positions and memory to forces and memory; a force and a position for each device."""
PICOSECOND = 1e-12
TURNS = range(-25, 26)
"""Number of turns before and after the computed one whose measurements or forces may fall into it."""


@dataclass(frozen=True, eq=False)
class LinearBody:
    """Device ξ̇ = A ξ + B u with a command u; its first state is the measured position."""

    a: Array
    b: Array

    @lru_cache(maxsize=256)  # noqa: B019  # a handful of bodies, each as long as its case
    def over(self, span: int) -> tuple[Array, Array]:
        """Return the effect of the states, and that of the command, after a span [ps]."""
        order = len(self.a)
        system = np.zeros((order + 1, order + 1))
        system[:order, :order], system[:order, order] = self.a, self.b
        moved = exponential(np.asarray(system * (span * PICOSECOND), dtype=np.longdouble)).astype(np.float64)
        return moved[:order, :order], moved[:order, order]


def motor(mass: float, damping: float, lag: float = 0.0) -> LinearBody:
    """Return a mass with damping, moved by a motor whose force follows its command with a lag [s]."""
    if not lag:
        return LinearBody(np.array([[0.0, 1.0], [0.0, -damping / mass]]), np.array([0.0, 1.0 / mass]))
    rows = [[0.0, 1.0, 0.0], [0.0, -damping / mass, 1.0 / mass], [0.0, 0.0, -1.0 / lag]]
    return LinearBody(np.array(rows), np.array([0.0, 0.0, 1.0 / lag]))


def motor_with_load(motor: LinearBody, mass: float, load: float, stiffness: float, damping: float) -> LinearBody:
    """Return a motor of a mass with a load on a spring and damper; the states of the load follow those of the motor."""
    order = len(motor.a)
    a = np.zeros((order + 2, order + 2))
    a[:order, :order] = motor.a
    # The pull on the motor for its position and speed, and the load's.
    pull = np.zeros(order + 2)
    pull[[0, 1, order, order + 1]] = -stiffness, -damping, stiffness, damping
    a[1] += pull / mass
    a[order, order + 1], a[order + 1] = 1.0, -pull / load
    return LinearBody(a, np.append(motor.b, [0.0, 0.0]))


@dataclass(frozen=True)
class Shot:
    """One sample of a turn: the instants of its measurement and of its forces [s]; both may lie in other turns."""

    measured: float
    acts: tuple[float, ...]
    """One instant for each device."""
    received: bool = True
    """False: the sample is lost, and the forces of the previous sample are sent again."""


@dataclass(frozen=True)
class _Instant:
    at: int
    order: int
    device: int
    """-1 for a measurement."""
    received: bool = True


def map_of_turn(bodies: Sequence[LinearBody], turn: float, shots: Sequence[Shot], law: Law, memory: int = 0) -> Array:
    """Return the matrix of a turn [s] on (states of all devices, memory, last forces, acting and waiting commands)."""
    whole = _whole(turn)
    waiting = [_waiting(whole, shots, device) for device in range(len(bodies))]
    sizes = [*(len(body.a) for body in bodies), memory, len(bodies), *(1 + count for count in waiting)]
    rows = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
    states, kept, last, queues = rows[: len(bodies)], [*rows[-2 - len(bodies)]], [*rows[-1 - len(bodies)]], [
        [*part] for part in rows[-len(bodies) :]
    ]  # fmt: skip
    now = 0
    for event in [*_events(whole, shots), _Instant(whole, 0, -1, received=False)]:
        for place, body in enumerate(bodies):
            if event.at > now:
                moved, by_force = body.over(event.at - now)
                states[place] = moved @ states[place] + np.outer(by_force, queues[place][0])
        now = event.at
        if event.at == whole:
            break
        if event.device >= 0:
            queues[event.device].pop(0)
            continue
        if event.received:
            forces, memories = law([state[0] for state in states], kept)
            last, kept = [*forces], [*memories]
        for queue, force in zip(queues, last, strict=True):
            queue.append(force)
    return np.vstack([*states, *kept, *last, *(row for queue in queues for row in queue)])


def growth(matrix: Array, freely: int = 0) -> float:
    """Return the largest modulus of the eigenvalues, without `freely` ones closest to 1 (handles without rest)."""
    modes = np.linalg.eigvals(matrix)
    modes = modes[np.argsort(np.abs(modes - 1.0))][freely:]
    return float(np.abs(modes).max())


def _whole(time: float) -> int:
    return round(time / PICOSECOND)


def _events(whole: int, shots: Sequence[Shot]) -> list[_Instant]:
    """Return all events of the turn from 0 on, in order; a sample comes before the forces computed from it."""
    found = []
    for turn in TURNS:
        for shot in shots:
            found.append(_Instant(_whole(shot.measured) + turn * whole, 0, -1, shot.received))
            found += [_Instant(_whole(at) + turn * whole, 1, device) for device, at in enumerate(shot.acts)]
    return sorted((each for each in found if 0 <= each.at < whole), key=lambda each: (each.at, each.order))


def _waiting(whole: int, shots: Sequence[Shot], device: int) -> int:
    """Return the number of forces with a measurement before 0 that act at 0 or later."""
    ways = [(_whole(shot.measured), _whole(shot.acts[device])) for shot in shots]
    return sum(measured + turn * whole < 0 <= acts + turn * whole for turn in TURNS for measured, acts in ways)


def spring_damper_law(stiffness: float, damping: float, period: float) -> Law:
    """Return the law −K·x − B·(x − x before)/T of one device; its memory is the last position."""

    def law(positions: Sequence[Array], memory: Sequence[Array]) -> tuple[Sequence[Array], Sequence[Array]]:
        (x,), (before,) = positions, memory
        return [-stiffness * x - damping / period * (x - before)], [x]

    return law


def shaft(stiffness: float, damping: float, ratio: float, period: float) -> Law:
    """Return the forces of a spring and damper between x₁ and n·x₂; their work is that of one force on x₁ − n·x₂."""

    def law(positions: Sequence[Array], memory: Sequence[Array]) -> tuple[Sequence[Array], Sequence[Array]]:
        twist = positions[0] - ratio * positions[1]
        force = -stiffness * twist - damping / period * (twist - memory[0])
        return [force, -ratio * force], [twist]

    return law
