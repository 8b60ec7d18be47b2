"""Measurements of closed loops: with a hand, along a run, and with a virtual sprung mass."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache
from itertools import repeat

import numpy as np

from haptic_fieldbus.margins import ROUNDING
from haptic_fieldbus.numerics import estimators, integrators, sampled
from haptic_fieldbus.numerics.batch import Array
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS, OneStep
from haptic_fieldbus.numerics.linear import StateSpace, gain, zoh
from haptic_fieldbus.numerics.sampled import SampledPlant, environment
from haptic_fieldbus.study.measure.bench import Bench, device_in_hand, free, grounded
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, WAY, Problem, peak, sine, sprung_mass
from haptic_fieldbus.study.measure.timing import Cost, Timed, in_turn
from haptic_fieldbus.study.measure.work_precision import TIMED_STEPS, Point, Set, errors, reference, with_order

# Error along a run: the virtual mass swings freely behind a held puck, for up to ten million steps of the loop.
#
# The puck is held at 0 and the mass starts 10 mm away, so F(t) = k·A·cos(ωt) for ever, and the energy never changes.
# The phase n·T·ω is reduced with 50 decimal digits, so the reference is right to the last digit after ten million steps
# too. The step of the loop starts at rest; two samples of input bring it to the start, because two inputs can reach any
# two states. The true states at a sample follow from two successive forces, because two outputs determine two states.

PERIOD = 1e-3
"""Period of the loop [s]."""
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459")
DIGITS = 50
"""Decimal digits in which the phase is reduced."""
PER_DECADE = 12
"""Places per decade of steps."""
WINDOW = 160
"""Steps before each place over which the largest error is taken: half a turn of the mass, π/(ω·T) = 157."""


@dataclass(frozen=True)
class Growth:
    """Error and energy of one method along a run; all tuples have the same length."""

    method: str
    steps: tuple[int, ...]
    """Places: numbers of steps done."""
    error: tuple[float, ...]
    """Largest error of the force in the window before each place, as a share of its amplitude."""
    energy: tuple[float, ...]
    """Energy at each place over that at the start, minus 1."""
    diverged_at: int | None
    """First place at which a number is no longer finite; None when all are."""


def places(total: int) -> list[int]:
    """Return the places of a run, even on a logarithmic scale and at least a window apart."""
    count = max(2, round(PER_DECADE * math.log10(total / WINDOW)))
    found: list[int] = []
    for place in np.geomspace(WINDOW, total, count).round().astype(int).tolist():
        if not found or place - found[-1] >= WINDOW:
            found.append(place)
    return found


def exact_force(step: int, period: float = PERIOD) -> float:
    """Return k·A·cos(ω·step·T) [N], its phase reduced in `DIGITS` digits."""
    # Decimal(float) is exact: the period is that of the loop to the last bit, not the number it is written as.
    with localcontext(prec=DIGITS):
        phase = (Decimal(STIFFNESS) / Decimal(MASS)).sqrt() * Decimal(period) * step % (2 * PI)
    return STIFFNESS * WAY * math.cos(float(phase))


def start(one: OneStep, step: Callable[[float], float]) -> None:
    """Bring a fresh step from rest to a mass that rests 10 mm away, by three inputs; the first fixes the origin."""
    system = one.system
    wanted = one.stored(np.array([WAY, 0.0]), np.zeros(2))
    g = system.b[:, 0]
    first, second = np.linalg.solve(np.column_stack([system.a @ g, g]), wanted)
    for position in (0.0, float(first), float(second)):
        step(position)


def energy(one: OneStep, forces: tuple[float, float]) -> float:
    """Return the energy of the mass [J] at the sample of the second force; the puck is at 0."""
    system, (by_state, _) = one.system, one.state
    observed = np.vstack([system.c, system.c @ system.a])
    position, velocity = by_state @ (system.a @ np.linalg.solve(observed, np.array(forces)))
    with np.errstate(over="ignore"):  # forward Euler grows up to infinity
        return float(0.5 * STIFFNESS * position**2 + 0.5 * MASS * velocity**2)


def free_swing(method: str, total: int) -> Growth:
    """Run the step of the loop `total` times, and compare it with the exact force at the places of the run."""
    one = integrators.discretise(sprung_mass(), PERIOD, method)
    step = integrators.bind(sprung_mass(), PERIOD, method)
    start(one, step)
    begin, amplitude = 0.5 * STIFFNESS * WAY**2, STIFFNESS * WAY
    rows: list[tuple[int, float, float]] = []
    done, diverged_at = 0, None
    for place in places(total):
        # A deque without room drops the forces of the steps in between at the speed of C.
        deque(map(step, repeat(0.0, place - WINDOW - done)), maxlen=0)
        forces = list(map(step, repeat(0.0, WINDOW)))
        if not all(map(math.isfinite, forces)):
            diverged_at = place
            break
        errors = [abs(force - exact_force(place - WINDOW + index)) for index, force in enumerate(forces)]
        rows.append((place, max(errors) / amplitude, energy(one, (forces[-2], forces[-1])) / begin - 1.0))
        done = place
    seen, found, drift = zip(*rows, strict=True)
    return Growth(method, seen, found, drift, diverged_at)


# Growth rates of a virtual sprung mass: does it matter in the loop whether the integrator preserves stability?
#
# The handle is *clamped* (the held puck of the lecture: the method alone decides), *in the hand* (a spring and a damper
# to the ground) or *free* (the friction of the device alone). The rate is ln(ρ)/T with ρ the largest modulus of the
# eigenvalues of one period, so a motion grows by e^(rate) in a second. A free handle stays where it is left, which is
# an eigenvalue of exactly 1; it is left out.

SOFTEST, BEYOND, LOOKED_AT = 1e-6, 1e3, 120
"""Softest and stiffest spring tried, in units of m/T², and their number; if the stiffest is stable, all are."""
HANDLES = ("clamped", "in the hand", "free")


@dataclass(frozen=True, eq=False)
class LoopGrowth:
    """Growth rates and stable springs of one method; dictionaries are by the name of the handle."""

    method: str
    stiffness: Array
    """Stiffnesses [N/m], `(n,)`."""
    rate: dict[str, Array]
    """Growth rates [1/s], each `(n,)`."""
    limit: dict[str, float]
    """Stiffest stable spring [N/m]; 0 if none is stable, ∞ if all are."""
    softest: dict[str, float]
    """Softest stable spring below that limit [N/m]; 0 if all springs below it are stable."""
    at_scene: dict[str, float]
    """Growth rate with the stiffness of the scene [1/s]."""


def _virtual(stiffness: float, method: str, period: float) -> StateSpace:
    return environment(sprung_mass(stiffness), period=period, method=method, estimator=None)


def radius_of(handle: str, bench: Bench, method: str) -> Callable[[float], float]:
    """Return a function from stiffness [N/m] to the largest modulus of the loop's eigenvalues."""
    period = bench.period
    if handle == "clamped":
        return lambda k: sampled.spectral_radius(integrators.discrete(sprung_mass(k), period, method).a)
    if handle == "free":
        device = sampled.sample(*free(bench.plant), period, bench.delay)
        return lambda k: sampled.growth(device, _virtual(k, method, period))
    in_hand = sampled.sample(*grounded(bench.plant), period, bench.delay)
    return lambda k: sampled.spectral_radius(sampled.loop_matrix(in_hand, _virtual(k, method, period)))


def loop_growth(bench: Bench, method: str, points: int) -> LoopGrowth:
    """Measure one method over four decades of stiffness, up to values at which every sampled loop is unstable."""
    scale = bench.plant.mass / bench.period**2
    stiffness = np.geomspace(2e-5 * scale, 2e-1 * scale, points)
    radii = {handle: radius_of(handle, bench, method) for handle in HANDLES}
    ranges = {handle: stable_range(handle, method, bench, radius) for handle, radius in radii.items()}

    def rate(handle: str, k: float) -> float:
        return math.log(radii[handle](k)) / bench.period

    return LoopGrowth(
        method,
        stiffness,
        {handle: np.array([rate(handle, k) for k in stiffness.tolist()]) for handle in HANDLES},
        {handle: high for handle, (_, high) in ranges.items()},
        {handle: low for handle, (low, _) in ranges.items()},
        {handle: rate(handle, STIFFNESS) for handle in HANDLES},
    )


def stable_range(handle: str, method: str, bench: Bench, radius: Callable[[float], float]) -> tuple[float, float]:
    """Return the softest and the stiffest stable spring [N/m] of the first stable range; (0, 0) when there is none.

    A softest spring of 0 and a stiffest of ∞ stand for no limit. For the clamped handle the limit is m·(h/T)² with the
    method's own limit h, because a double root makes a search imprecise there.
    """
    scale = MASS / bench.period**2
    if handle == "clamped":
        return 0.0, scale * METHODS[method].oscillator_limit ** 2
    grid = np.geomspace(SOFTEST * scale, BEYOND * scale, LOOKED_AT).tolist()
    stable = [radius(k) <= 1.0 + ROUNDING for k in grid]
    if True not in stable:
        return 0.0, 0.0
    first = stable.index(True)
    end = stable.index(False, first) if False in stable[first:] else len(grid)
    low = 0.0 if first == 0 else _edge(radius, grid[first], grid[first - 1])
    return low, math.inf if end == len(grid) else _edge(radius, grid[end - 1], grid[end])


def _edge(radius: Callable[[float], float], stable: float, growing: float) -> float:
    """Return the edge between a stable and a growing stiffness [N/m] by bisection, on its stable side."""
    while abs(growing - stable) > 1e-9 * stable:
        middle = 0.5 * (stable + growing)
        stable, growing = (middle, growing) if radius(middle) <= 1.0 + ROUNDING else (stable, middle)
    return stable


def flicked_free(bench: Bench, method: str, duration: float, stiffness: float = STIFFNESS) -> tuple[Array, Array]:
    """Return times [s] and force on the free handle [N], each `(n,)`, after a flick of 0.1 m/s."""
    period = bench.period
    device = sampled.sample(*free(bench.plant), period, bench.delay)
    force = flicked(device, _virtual(stiffness, method, period), round(duration / period))
    times: Array = np.arange(len(force), dtype=np.float64) * period
    return times, force


def flicked(device: SampledPlant, virtual: StateSpace, steps: int) -> Array:
    """Return the force of the environment on a handle that starts with 0.1 m/s [N], `(steps,)`."""
    matrix, order = sampled.loop_matrix(device, virtual), len(device.transition)
    output, state = np.zeros((2, len(matrix)))
    # Row of the loop's output: force = D·position + C·virtual states, which follow the device's states.
    output[0], output[order : order + virtual.order] = virtual.d[0, 0], virtual.c[0]
    state[1] = 0.1
    forces: Array = np.empty(steps)
    for step in range(steps):
        forces[step] = output @ state
        state = matrix @ state
    return forces


# Closed loops with a hand: a wall and a sprung mass on the shipped device, pushed by a sine of 4 N.
#
# The device and the hand move in continuous time, solved exactly. The environment's force is held from sample to
# sample, without delay. The reference is the same loop with an environment in continuous time. The difference is the
# error of sampling, hold and velocity estimate (or integrator). It is of first order in the period for every method,
# because the hold is late by T/2.

PositionLaw = Callable[[float], float]
HORIZON, CONTACT_STIFFNESS, DAMPING = 1.0, 600.0, 2.0
"""Length of a run [s], and the walls of the scene library [N/m], [N·s/m]."""
HAND_FORCE = sine(4.0, 1.0)
DIVERGED = 1e12
"""Force from which a run counts as diverged [N]; far above any real force, and far below overflow."""
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
        return lambda x: -CONTACT_STIFFNESS * x
    estimate = estimators.bind(method, period, resolution)
    return lambda x: -CONTACT_STIFFNESS * x - DAMPING * estimate(x)


def contacts() -> dict[str, Contact]:
    """Return all contacts by name."""
    spring, damped = gain([[-CONTACT_STIFFNESS, 0.0]]), gain([[-CONTACT_STIFFNESS, -DAMPING]])
    by_estimator = "wall of 600 N/m and 2 N·s/m, a hand leaning on it; methods are velocity estimators"
    every = (
        Contact("wall-in-hand", "wall of 600 N/m, a hand leaning on it", spring, ("none",), _wall),
        Contact("damped-wall-in-hand", by_estimator, damped, tuple(ESTIMATORS), _wall),
        Contact(
            "sprung-mass-in-hand",
            "sprung mass, dragged by a hand: device, hand and mass in one loop",
            sprung_mass(),
            tuple(METHODS),
            lambda method, period, resolution: integrators.bind(sprung_mass(), period, method),
        ),
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
    a, motor, hand = device_in_hand(bench.plant)
    outer = len(HAND_FORCE.start)
    # The transition of device, hand and its force over one period, and the effect of a held motor force.
    system = np.block([[a, hand @ HAND_FORCE.output[:1]], [np.zeros((outer, len(a))), HAND_FORCE.system]])
    transition, drive = zoh(system, np.vstack([motor, np.zeros((outer, 1))]), period)
    state = np.concatenate([np.zeros(4), HAND_FORCE.start])
    forces = np.empty(steps + 1)
    for sample in range(steps + 1):
        force = law(float(state[0]))
        if not abs(force) < DIVERGED:  # in this form true for NaN too
            return forces[:sample]
        forces[sample] = force
        state = transition @ state + drive[:, 0] * force
    return forces


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
    figures = errors(loop_force(law, bench, period, steps), exact)
    # The eigenvalues of a loop with an encoder and an estimator are not at hand: instability is read off the run.
    grew = figures[2] is None or not math.isfinite(figures[2]) or figures[2] > 10.0 * float(np.abs(exact).max())
    return Point(contact.name, method, period, *figures, cost.ns, cost.quartiles, order=None, stable=not grew)
