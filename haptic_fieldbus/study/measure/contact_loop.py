"""Closed loops with a hand: a wall and a sprung mass on the shipped device, pushed by a sine of 4 N.

The device and the hand move in continuous time, solved exactly. The environment's force is held from sample to sample,
without delay. The reference is the same loop with an environment in continuous time. The difference is the error of
sampling, hold and velocity estimate (or integrator). It is of first order in the period for every method, because the
hold is late by T/2.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.exact import zoh
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, gain
from haptic_fieldbus.numerics.loops import Array
from haptic_fieldbus.study.measure.bench import Bench, device_in_hand
from haptic_fieldbus.study.measure.motions import KnownMotion, sine
from haptic_fieldbus.study.measure.problems import Problem, peak, sprung_mass
from haptic_fieldbus.study.measure.timing import Cost, Timed, in_turn
from haptic_fieldbus.study.measure.work_precision import Point, Set, errors, reference, with_order

PositionLaw = Callable[[float], float]
HORIZON, STIFFNESS, DAMPING = 1.0, 600.0, 2.0
"""Length of a run [s], and the walls of the scene library [N/m], [N·s/m]."""
HAND_FORCE = sine(4.0, 1.0)
TIMED_STEPS = 200
"""Steps in one timed pass."""
DIVERGED = 1e12
"""Force from which a run counts as diverged [N]; far above any real one, and far below overflow."""
FIXED_TIMES = ("filtered-derivative",)
"""Estimators with a time constant that does not shrink with the period: their error has a limit above 0."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Environment in sustained contact, and the force law of the loop for each of its methods."""

    name: str
    title: str
    space: StateSpace
    methods: tuple[str, ...]
    law: Callable[[str, float, float], PositionLaw]
    """Function of method, period [s] and encoder step [m]: returns a law from position [m] to force [N]."""


def _wall(method: str, period: float, resolution: float) -> PositionLaw:
    if method == "none":
        return lambda x: -STIFFNESS * x
    estimate = estimators.bind(method, period, resolution)
    return lambda x: -STIFFNESS * x - DAMPING * estimate(x)


def _dragged(method: str, period: float, resolution: float) -> PositionLaw:
    return integrators.bind(sprung_mass(), period, method)


def contacts() -> dict[str, Contact]:
    """Return all contacts by name."""
    spring, damped = gain([[-STIFFNESS, 0.0]]), gain([[-STIFFNESS, -DAMPING]])
    by_estimator = "wall of 600 N/m and 2 N·s/m, a hand leaning on it; methods are velocity estimators"
    dragged = "sprung mass, dragged by a hand: device, hand and mass in one loop"
    every = (
        Contact("wall-in-hand", "wall of 600 N/m, a hand leaning on it", spring, ("none",), _wall),
        Contact("damped-wall-in-hand", by_estimator, damped, tuple(ESTIMATORS), _wall),
        Contact("sprung-mass-in-hand", dragged, sprung_mass(), tuple(METHODS), _dragged),
    )
    return {contact.name: contact for contact in every}


@lru_cache(maxsize=8)
def closed(contact: Contact, bench: Bench) -> Problem:
    """Return device, hand and environment in continuous time as one problem, with the hand's force as input."""
    (a, motor, hand), space = device_in_hand(bench.plant), contact.space
    size, inner = len(a), space.order
    feel = np.eye(2, size)  # (position, velocity) of the handle
    # Feedback u = feel·x of the environment (A_e, B_e, C_e, D_e) closes the loop: F = C_e z + D_e u drives the motor.
    system = np.block([[a + motor @ space.d @ feel, motor @ space.c], [space.b @ feel, space.a]])
    drive = np.block([[hand, np.zeros((size, 1))], [np.zeros((inner, 2))]])
    force = np.hstack([space.d @ feel, space.c])
    return Problem(contact.name, contact.title, StateSpace(system, drive, force, np.zeros((1, 2))), HAND_FORCE)


def loop_force(law: PositionLaw, bench: Bench, period: float, steps: int) -> Array:
    """Return the force of the sampled loop at its samples [N], `(steps + 1,)`; fewer values when it diverged."""
    transition, drive = _moved(bench, HAND_FORCE, period)
    state = np.concatenate([np.zeros(4), HAND_FORCE.start])
    forces = np.empty(steps + 1)
    for sample in range(steps + 1):
        force = law(float(state[0]))
        if not abs(force) < DIVERGED:  # in this form true for NaN too
            return forces[:sample]
        forces[sample] = force
        state = transition @ state + drive * force
    return forces


def _moved(bench: Bench, motion: KnownMotion, period: float) -> tuple[Matrix, Array]:
    """Return the transition of device, hand and its force over one period, and the effect of a held motor force."""
    a, motor, hand = device_in_hand(bench.plant)
    outer = len(motion.start)
    system = np.block([[a, hand @ motion.output[:1]], [np.zeros((outer, len(a))), motion.system]])
    transition, drive = zoh(system, np.vstack([motor, np.zeros((outer, 1))]), period)
    return transition, drive[:, 0]


def measure(contact: Contact, method: str, bench: Bench, steps: Sequence[int], cost: Cost | None = None) -> Set:
    """Return the points of one method, one for each number of steps; without a cost it is timed by itself."""
    cost = cost or law_costs(contact, [method], bench)[method]
    largest = peak(closed(contact, bench))
    points = [_point(contact, method, bench, count, cost) for count in steps]
    claimed = None if method in FIXED_TIMES else 1.0  # the held force permits no higher order
    return Set(contact.name, method, with_order(points, largest), claimed, largest, cost)


def law_costs(contact: Contact, methods: Iterable[str], bench: Bench) -> dict[str, Cost]:
    """Return the costs of the laws of these methods at the bench's period; the methods take turns."""
    positions = (0.01 * np.sin(np.linspace(0.0, 6.0, TIMED_STEPS))).tolist()
    laws = {method: contact.law(method, bench.period, bench.plant.resolution) for method in methods}
    return in_turn({method: Timed(law, lambda: (positions,)) for method, law in laws.items()})


def _point(contact: Contact, method: str, bench: Bench, steps: int, cost: Cost) -> Point:
    period = HORIZON / steps
    law = contact.law(method, period, bench.plant.resolution)
    exact = reference(closed(contact, bench), steps)
    found = loop_force(law, bench, period, steps)
    figures = errors(found, exact)
    largest = float(np.abs(exact).max())
    # The eigenvalues of a loop with an encoder and an estimator are not at hand: instability is read off the run.
    grew = figures[2] is None or not math.isfinite(figures[2]) or figures[2] > 10.0 * largest
    return Point(contact.name, method, period, *figures, cost.ns, cost.quartiles, order=None, stable=not grew)
