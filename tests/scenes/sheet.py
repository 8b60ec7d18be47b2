"""Claims of a kind of element, so that one contract test can hold every kind to it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement
from haptic_fieldbus.signals import Signal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion sampled every `period` [s]: position and true velocity, shape (n,); of a coupling shape (n, 2)."""

    period: float
    position: Array
    velocity: Array

    @property
    def moves(self) -> Array:
        """Change of the position in each period, shape (n − 1,)."""
        return np.diff(self.position, axis=0)


def resting(*places: float, period: float = 1e-3) -> Motion:
    """At rest at one place after another."""
    return Motion(period, np.array(places), np.zeros(len(places)))


def passing(begin: float, end: float, speed: float, period: float = 1e-3) -> Motion:
    """At constant speed (above 0) from one place to another."""
    steps = max(2, round(abs(end - begin) / (speed * period)))
    position = np.linspace(begin, end, steps + 1)
    return Motion(period, position, np.full(steps + 1, (end - begin) / (steps * period)))


def forces(element: Any, motion: Motion) -> Array:
    """The force of every sample, the law fresh; shape (n,), of a coupling (n, 2)."""
    law = element.begin(motion.period) if isinstance(element, CouplingElement) else law_of(element, motion.period)
    position, velocity = motion.position.reshape(len(motion.position), -1), motion.velocity
    columns: list[Sequence[float]] = []
    for axis in range(position.shape[1]):
        place, speed = position[:, axis], velocity.reshape(len(velocity), -1)[:, axis]
        columns += [_signal(signal, motion, place, speed) for signal in element.needs]
    return np.array([law(*[column[k] for column in columns]) for k in range(len(position))])


def _signal(signal: Signal, motion: Motion, position: Array, velocity: Array) -> Sequence[float]:
    if signal is Signal.ELAPSED_NS:
        return [round(k * motion.period * 1e9) for k in range(len(position))]
    found: list[float] = {Signal.POSITION: position, Signal.VELOCITY: velocity}[signal].tolist()
    return found


def given_to_the_hand(motion: Motion, force: Array, *, held: bool) -> float:
    """∫F dx [J]: by the trapezoid, or with each force `held` until the next, as the loop does."""
    between = force[:-1] if held else 0.5 * (force[:-1] + force[1:])
    return float(np.sum(between * motion.moves))


def no_energy(element: Any, motion: Motion) -> float:
    return 0.0


def never(element: Any) -> list[Motion]:
    return []


def at_once(*places: float, speed: float = 0.0) -> Motion:
    """From place to place in no time to speak of, so that nothing relaxes; the last one is passed at `speed`."""
    return Motion(1e-9, np.array(places), np.array([0.0] * (len(places) - 1) + [speed]))


@dataclass(frozen=True)
class Sheet:
    """`examples` of a kind, and its claims; each claim takes one of them.

    silent     motions along which the force is exactly 0
    signs      (motion, sign of its last force)
    steepness  the force changes by at most (…·|Δx|, …·|Δv|, …·Δt) where it does not jump [N/m, N·s/m, N/s]
    stiffest   (motion that ends where it is linearised, way on which it is tried from there: 1 or −1)
    jump       the largest change of the force at one instant [N], at speeds up to the one given [m/s]
    continuous an upper bound of the energy given to the hand [J] along a motion, forces acting at once
    sampled    the same with each force held for one period
    reach      (middle, amplitude) of the motions that it is tried with
    remembers  whether its energy neither follows from where the handle is nor is bounded: it then states none
    """

    examples: tuple[AnyElement, ...]
    steepness: Callable[[Any], tuple[float, float, float]]
    continuous: Callable[[Any, Motion], float]
    sampled: Callable[[Any, Motion], float]
    silent: Callable[[Any], list[Motion]] = never
    signs: Callable[[Any], list[tuple[Motion, int]]] = lambda element: []
    stiffest: Callable[[Any], tuple[Motion, float]] = lambda element: (at_once(0.0), 1.0)
    jump: Callable[[Any, float], float] = lambda element, speed: 0.0
    reach: tuple[float, float] = (0.0, 0.03)
    remembers: bool = False


def spring_leak(stiffness: float, motion: Motion) -> float:
    """At most ½·K·Σ(Δx)²: what a force of slope up to K gives when it is held over each move."""
    return 0.5 * stiffness * float(np.sum(motion.moves**2))


def damper_leak(damping: float, motion: Motion) -> float:
    """−B·v_k·Δx summed: what a damper gives when its force is held over a move, true velocity."""
    return float(np.sum(np.maximum(0.0, -damping * motion.velocity[:-1] * motion.moves)))


def change_leak(element: Any, motion: Motion) -> float:
    """|ΔF·Δx| summed: a held force is never further than ΔF from one that runs from it to the next."""
    return float(np.sum(np.abs(np.diff(forces(element, motion)) * motion.moves)))
