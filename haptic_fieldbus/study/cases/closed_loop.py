"""Cases of the loop around a puck and a wall: a virtual mass with a held, free or light puck, and a start in a wall."""

import math

import numpy as np

from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.margins import Plant, stiffness_limit
from haptic_fieldbus.margins.plant import sample
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import integrators, sampled
from haptic_fieldbus.numerics.integrators import METHODS, trajectory
from haptic_fieldbus.planning.selection import select
from haptic_fieldbus.planning.task import Task
from haptic_fieldbus.study.case import CaseResult, share_used
from haptic_fieldbus.study.cases.drive_bench import PERIOD_NS, Feeder, feed
from haptic_fieldbus.study.measure.in_the_loop import flicked
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, spring, sprung_mass, two_masses
from haptic_fieldbus.study.oracles.held import moved_by_force
from haptic_fieldbus.study.oracles.polynomials import jury_limit
from haptic_fieldbus.study.oracles.textbook import RULES

PERIOD = 1e-3


def stiff_held_puck(quick: bool) -> CaseResult:
    """Check that with T·√(k/m) = 1000 only four methods stay bounded, and the exact ones give F = −k·cos(ωt)."""
    steps, h = (1000 if quick else 100_000), 1000.0
    k = MASS * (h / PERIOD) ** 2
    exact = -k * np.cos(h * np.arange(steps))
    runs = {}
    with np.errstate(over="ignore", invalid="ignore"):
        for name in METHODS:
            one = integrators.discretise(sprung_mass(k), PERIOD, name)
            inputs = np.zeros((steps, one.increments.b.shape[1]))
            inputs[:, 0] = 1.0
            runs[name] = trajectory.follow(one, inputs, [0.0, 0.0])
    bounded = [name for name, run in runs.items() if not run.diverged and np.abs(run.outputs).max() <= 1.001 * k]
    worst = max(float(np.abs(runs[name].outputs[:, 0] - exact).max()) / k for name in ("exact-zoh", "exact-foh"))
    allowed = 2e-14 * h * steps
    expected = ["backward-euler", "trapezoidal", "exact-zoh", "exact-foh"]
    return CaseResult(
        f"bounded only: {', '.join(expected)}; exact ones on −k·cos(ωt) for {steps} steps",
        f"bounded: {', '.join(bounded)}; exact ones off by {rounded(worst, 2)} of k ({rounded(allowed, 1)} allowed)",
        sorted(bounded) == sorted(expected) and worst <= allowed,
        "closed form −k·cos(ωt); stability at h = 1000 by hand",
        tolerance=f"{rounded(allowed, 1)} of k",
        used=share_used((worst, allowed)),
    )


def _two_masses(puck: float, duration: float, steps: int, method: str) -> float:
    """Return the largest error of the position of a puck pushed with 1 N, relative to its largest position."""
    total, reduced = puck + MASS, puck * MASS / (puck + MASS)
    one = integrators.discretise(two_masses(puck, MASS, STIFFNESS), duration / steps, method)
    found = trajectory.follow(one, np.tile([1.0, 0.0], (steps, 1)), [0.0] * 4).states[:, 0]
    time = np.arange(steps) * (duration / steps)
    stretch = reduced / (puck * STIFFNESS) * (1.0 - np.cos(math.sqrt(STIFFNESS / reduced) * time))
    exact = time**2 / (2.0 * total) + MASS / total * stretch
    if len(found) < steps:
        return math.inf
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def free_puck(quick: bool) -> CaseResult:
    """Check a free puck with a mass on a spring, pushed by 1 N: four states, a double root at 0, and an oscillation."""
    steps = 2000 if quick else 20_000
    errors = {name: _two_masses(0.2, steps * PERIOD, steps, name) for name in ("exact-zoh", "exact-foh")}
    worst = max(errors.values())
    coarse, fine = (_two_masses(0.2, 1.0, count, "rk4") for count in (100, 200))
    return CaseResult(
        f"exact steps on the closed form for {exactly(steps * PERIOD)} s; rk4's error 16 times less at half the step",
        f"off by {rounded(worst, 2)} of the way (1e-9 allowed); rk4 {coarse / fine:.2f} times less (14 to 18 allowed)",
        worst <= 1e-9 and 14.0 <= coarse / fine <= 18.0,
        "closed form: uniform acceleration of both masses, and their oscillation",
        tolerance="1e-9 of the way; the ratio of 16 within 14 to 18",
        used=share_used((worst, 1e-9), (coarse / fine - 16.0, 2.0)),
    )


def light_puck(quick: bool) -> CaseResult:
    """Check a puck of 1 mg, which oscillates by 14 rad in a period, and the limit 2b/T of a wall for light handles."""
    steps = 1000 if quick else 10_000
    error = _two_masses(1e-6, steps * PERIOD, steps, "exact-foh")
    euler = _two_masses(1e-6, steps * PERIOD, steps, "forward-euler")
    damping, masses = 0.5, (1e-4, 1e-5, 1e-6, 1e-9)
    *limits, massless = (stiffness_limit(Plant(mass, damping), PERIOD, 0.0, spring) for mass in (*masses, 0.0))
    exact = [jury_limit(Plant(mass, damping), PERIOD) for mass in masses]
    worst = max(abs(limit / by_hand - 1.0) for limit, by_hand in zip(limits, exact, strict=True))
    return CaseResult(
        "exact step on the closed form, forward Euler diverges; massless handle: limit "
        f"{exactly(2 * damping / PERIOD)} N/m",
        f"off by {rounded(error, 2)} (1e-8 allowed), Euler {rounded(euler, 1)}; limit {massless:.6f} N/m, masses from "
        f"1e-4 to 1e-9 kg off Jury's by {rounded(worst, 1)} (1e-8 allowed)",
        max(error, worst, abs(massless * PERIOD / (2.0 * damping) - 1.0)) <= 1e-8 and euler > 1e6,
        "closed form of two masses; Jury's conditions by hand, 2b/T without mass",
        tolerance="1e-8 of the way and of the limit",
        used=share_used((max(error, worst, abs(massless * PERIOD / (2.0 * damping) - 1.0)), 1e-8)),
    )


def _textbook_forces(device: Plant, method: str, steps: int) -> list[float]:
    """Return the forces on a free handle flicked with 0.1 m/s [N], by textbook rules in plain floats."""
    rule, omega = RULES[method], math.sqrt(STIFFNESS / MASS)
    x, v, q, speed = 0.0, 0.1, 0.0, 0.0
    forces = []
    for _ in range(steps):
        force = STIFFNESS * (q - x)
        forces.append(force)
        before = x
        x, v = moved_by_force(device, x, v, force, PERIOD)
        q, speed = rule(q, speed, before, x, omega, PERIOD)
    return forces


def sampled_free_puck(quick: bool) -> CaseResult:
    """Check the virtual mass in the loop with a free handle: forces by every method, and which methods grow."""
    device, steps = Plant(0.3, 0.2), (8000 if quick else 40_000)
    plant = sample(device, PERIOD, 0.0)
    worst, growing, wrong = 0.0, [], []
    for method in METHODS:
        virtual = sampled.environment(sprung_mass(), period=PERIOD, method=method, estimator=None)
        forces, radius = flicked(plant, virtual, steps).tolist(), sampled.growth(plant, virtual)
        brute = _textbook_forces(device, method, steps)
        tenth, peak = steps // 10, max(map(abs, brute))
        worst = max(worst, max(abs(x - y) for x, y in zip(forces, brute, strict=True)) / peak)
        grew = max(map(abs, brute[-tenth:])) > max(map(abs, brute[:tenth]))
        if grew:
            growing.append(method)
        if grew != (radius > 1.0):
            wrong.append(method)
    return CaseResult(
        f"forces of textbook loops for {steps} periods; in them grow: {', '.join(growing) or 'none'}",
        f"off by {rounded(worst, 2)} of the peak (1e-9 allowed); spectral radius disagrees for: "
        f"{', '.join(wrong) or 'none'}",
        worst <= 1e-9 and not wrong and sorted(RULES) == sorted(METHODS),
        "every method as textbooks write it, around a device in closed form, in plain floats",
        tolerance="1e-9 of the largest force; the set of methods exact",
        used=share_used((worst, 1e-9)),
    )


def start_inside_the_wall(quick: bool) -> CaseResult:
    """The limit fades in over 0.5 s, so a run that starts 10 mm inside a wall of 600 N/m begins without a kick.

    A run that would start with more than a quarter of the limit is refused, without any torque.
    """
    cycle = Feeder(select(Task("wall", settings={"wall.position": -0.01})).plan)
    unit = cycle.plan.axes[0].effort_unit
    forces = []
    for number in range(1000 if quick else 10_000):
        feed(cycle, t_ns=number * PERIOD_NS)
        forces.append(cycle.value("command"))
    ramp = [-min(6.0, 1000 * unit * (number + 1) / 500.0) for number in range(len(forces))]
    worst = max(abs(force - ideal) for force, ideal in zip(forces, ramp, strict=True))
    deeper = Feeder(select(Task("wall", settings={"wall.position": -0.1})).plan)
    octets = feed(deeper)
    refused = deeper.tripped is TripKind.START_FORCE and not any(octets)
    return CaseResult(
        "10 mm deep: -6 N on the line of the limit, 50.3 N in 0.5 s; 100 mm deep: refused without torque",
        f"off the line by {worst:.4f} N (0.51 of a step of torque, {unit:.4f} N, allowed); "
        f"{'refused without torque' if refused else 'not refused'}",
        worst <= 0.51 * unit and refused,
        "the line by hand: rated torque · t/0.5 s until 600 N/m · 10 mm, rounded to the drive's step",
        tolerance="0.51 of a step of torque",
        used=share_used((worst, 0.51 * unit)),
    )
