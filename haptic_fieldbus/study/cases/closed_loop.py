"""Cases of the loop around a puck and a wall: a virtual mass with a held, free or light puck, and a start in a wall."""

import math

import numpy as np

from haptic_fieldbus import Verdict, plan
from haptic_fieldbus.cycle import TripKind
from haptic_fieldbus.margins import Group, HungBody, Member, Plant, alone, judge, passive_limit, sample, stiffness_limit
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import batch, integrators, sampled
from haptic_fieldbus.numerics.batch import loops
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.integrators.method import follow
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.case import CaseResult, greatest, largest_error, relative_error, result_of, values_text
from haptic_fieldbus.study.cases.drive import PERIOD_NS, Feeder, feed
from haptic_fieldbus.study.measure.loops import flicked
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, spring, sprung_mass, two_masses
from haptic_fieldbus.study.oracles import contact, energies, events
from haptic_fieldbus.study.oracles.textbook import RULES

# Cases of a wall in the sampled loop: at its limit, beyond it, late, slow, and without friction.

PERIOD = 1e-3
BENCH = Plant(0.1, 50.0)
"""Device with strong friction for its mass, so that growth near the limit shows within 1e5 steps."""


def _limit(device: Plant, period: float = PERIOD, delay: float = 0.0) -> float:
    """Return the stiffness limit that the package computes [N/m]; `delay` in periods."""
    return stiffness_limit(device, period, delay * period, spring)


def _grown(device: Plant, stiffness: float, steps: int, period: float = PERIOD, delay: float = 0.0) -> float:
    """Return ln of the growth of a loop of plain floats; `delay` in periods."""
    return contact.growth_of(contact.sampled_positions(device, period, lambda x: -stiffness * x, steps, delay=delay))


def at_boundary(factor: float, quick: bool) -> CaseResult:
    """Check that at `factor` times its limit the motion at a wall decays or grows as slowly as theory predicts.

    The logarithm of the growth over N periods is compared with N·ln ρ, where ρ² = e + K·c0 for complex roots.
    """
    steps = 100_000 if quick else 1_000_000
    limit, exact = _limit(BENCH), contact.jury_limit(BENCH, PERIOD)
    e, _, c0 = contact.plain_terms(BENCH, PERIOD)
    # `growth_of` compares the first with the last tenth of the run, which are 0.9 of it apart.
    expected = 0.9 * steps * 0.5 * math.log(e + factor * exact * c0)
    measured = _grown(BENCH, factor * limit, steps)
    return result_of(
        f"limit {exact:.6f} N/m; at {exactly(factor)} of it ln of growth {expected:+.4f} in {exactly(0.9 * steps)} "
        "periods",
        f"limit {limit:.6f} N/m (1e-8 allowed); ln of growth {measured:+.4f} (1 % and 0.005 allowed)",
        "Jury's conditions by hand, and a loop of plain floats run at that share of the package's limit",
        tolerance="1e-8 of the limit; 1 % and 0.005 of ln of growth",
        within=[(limit / exact - 1.0, 1e-8), (measured - expected, 0.01 * abs(expected) + 0.005)],
        holds=measured * (factor - 1.0) > 0.0,
    )


def _chatter(stiffness: float, steps: int, push: float) -> tuple[float, float]:
    """Return the swing in the last tenth of a run against a one-sided wall [m], by the batch engine and by hand."""
    wall = loops(mass=BENCH.mass, damping=BENCH.damping, period=PERIOD, stiffness=stiffness, unilateral=True,
                 push=push, position=1e-3)  # fmt: skip
    peak = float(batch.run(wall, steps).peaks[-1, 0])
    positions = contact.sampled_positions(BENCH, PERIOD, lambda x: -stiffness * x if x > 0.0 else 0.0, steps, push=push)
    return peak - push / stiffness, max(positions[-(steps // 10) :]) - push / stiffness


def wall_over(quick: bool) -> CaseResult:
    """Check that a wall with a hand leaning on it keeps chattering at 1.5 times its limit, and rests at half of it."""
    steps, push = (4000 if quick else 50_000), 5.0
    limit = contact.jury_limit(BENCH, PERIOD)
    chatter, brute = _chatter(1.5 * limit, steps, push)
    calm, _ = _chatter(0.5 * limit, steps, push)
    e, _, c0 = contact.plain_terms(BENCH, PERIOD)
    expected = math.sqrt(e + 1.5 * limit * c0)
    many = loops(mass=BENCH.mass, damping=BENCH.damping, period=PERIOD, stiffness=1.5 * limit, position=1e-3)
    grown = float(batch.run(many, 1000).growth[0]) ** (1.0 / 900.0)
    return result_of(
        f"in contact growth {expected:.4f} a period; leaning with 5 N, overshoot {brute * 1e6:.3f} µm for ever",
        f"growth {grown:.4f} (0.1 %); overshoot {chatter * 1e6:.3f} µm (1e-6), at half the limit "
        f"{rounded(calm * 1e6, 1)} µm",
        "ρ² = e + K·c0 by hand; a one-sided loop of plain floats",
        tolerance="0.1 % of the growth, 1e-6 of the overshoot",
        within=[(grown / expected - 1.0, 1e-3), (chatter / brute - 1.0, 1e-6), (calm, 1e-9 * push / limit)],
        holds=brute > 0.1 * push / limit,
    )


def delayed(delay: float, quick: bool) -> CaseResult:
    """Check the limits of many devices with delay against Schur and Cohn, and runs below and above one of them."""
    masses = (1e-5, 0.1, 10.0) if quick else (1e-5, 1e-3, 0.1, 1.0, 10.0)
    devices = [Plant(mass, damping) for mass in masses for damping in (1e-2, 1.0, 1e2)]
    by_hand = [contact.schur_cohn_limit(each, PERIOD, delay) for each in devices]
    worst = relative_error([_limit(each, delay=delay) for each in devices], by_hand)
    limit, exact = _limit(BENCH, delay=delay), contact.schur_cohn_limit(BENCH, PERIOD, delay)
    below, above = (_grown(BENCH, factor * limit, 20_000, delay=delay) for factor in (0.99, 1.01))
    return result_of(
        f"m = 0.1 kg, b = 50 N·s/m: {exact:.5f} N/m; fades at 0.99 of it, grows at 1.01",
        f"{limit:.5f} N/m; {len(devices)} other devices off by {rounded(worst, 1)} at most (1e-6 allowed); ln of "
        f"growth {below:+.2f}, {above:+.2f}",
        "characteristic polynomial by hand, Schur–Cohn in 60 digits; a loop of plain floats",
        tolerance="1e-6 of the limit; ln of growth beyond ±0.5",
        within=[(worst, 1e-6), (limit / exact - 1.0, 1e-6)],
        holds=below < -0.5 and above > 0.5,
    )


def slow_loop(quick: bool) -> CaseResult:
    """Check slow loops from 20 Hz to 0.1 Hz: the device stops between samples, and the limit goes to 2b/(T − 2m/b)."""
    device, stiffness = Plant(0.1, 5.0), 600.0
    periods = (0.05, 0.2, 1.0, 10.0)
    worst = greatest(abs(_limit(device, period) / contact.jury_limit(device, period) - 1.0) for period in periods)
    slowest = _limit(device, periods[-1])
    expected = 2.0 * device.damping / (periods[-1] - 2.0 * device.mass / device.damping)
    verdict = judge(alone(device, periods[0], 0.0), spring, stiffness)[0].verdict
    grown = _grown(device, stiffness, 50, periods[0])
    return result_of(
        f"limit {expected:.8f} N/m at 0.1 Hz; 600 N/m at 20 Hz grows",
        f"limit {slowest:.8f} N/m, off Jury's by {rounded(worst, 1)} (1e-8 allowed); 600 N/m {verdict.value}, ln of "
        f"growth {grown:+.0f} in 50 periods",
        "Jury's conditions by hand and their limit for bT ≫ m; a loop of plain floats",
        tolerance="1e-8 of the limit",
        within=[(worst, 1e-8), (slowest / expected - 1.0, 1e-8)],
        holds=verdict is Verdict.UNSTABLE and grown > 1.0,
    )


def undamped_wall(quick: bool) -> CaseResult:
    """Check that without friction no stiffness is stable: the product of the roots is 1 + K·T²/2m."""
    plants = [Plant(mass, 0.0) for mass in (1e-5, 0.1, 10.0)]
    limits = [_limit(plant, delay=delay) for plant in plants for delay in (0.0, 0.5, 1.0, 2.0, 10.0)]
    limits += [passive_limit(each, PERIOD, 0.0) for each in plants]
    share, steps = (1e-3 if quick else 1e-5), (20_000 if quick else 1_000_000)
    device = Plant(0.1, 0.0)
    measured = _grown(device, share * device.mass / PERIOD**2, steps)
    expected = 0.9 * steps * 0.5 * math.log1p(0.5 * share)
    return result_of(
        f"limit exactly 0 N/m; at K = {exactly(share)}·m/T² ln of growth {expected:.4f} in {exactly(0.9 * steps)} "
        "periods",
        f"largest limit {exactly(max(limits))} N/m of {len(limits)}; ln of growth {measured:.4f} (1 % allowed)",
        "product of the roots 1 + K·T²/2m > 1, by hand; a loop of plain floats",
        tolerance="limit exactly 0; 1 % of ln of growth",
        within=[(measured / expected - 1.0, 0.01)],
        holds=not np.any(limits),
    )


# Cases of loops of more than one body: axes that a coupling ties together, and a load on a compliant transmission.

ESTIMATOR = "backward-difference"
AGREEMENT, CUT, EXACT = 1e-6, 5e-4, 1e-12
"""Permitted relative differences of stability limits, of energies (motions are cut into cells), and of forces."""
DEVICES = ((Plant(0.1, 2.0, 0.02, 1e-5, 0.4e-3), 0.3e-3), (Plant(0.05, 0.8, 0.001, 2e-6), 1.2e-3))
"""Devices of two axes, with friction and encoder, and the time from sample to force [s]; the first motor lags."""
SHAFTS = ((0.05, -2.5), (0.15, 0.4))
"""Damping B [N·s/m] and ratio n of shafts between the axes."""


def _tied(damping: float, ratio: float) -> Group:
    members = tuple(Member(name, *device, (), None, ESTIMATOR) for name, device in zip("ab", DEVICES, strict=True))
    return Group(members, (Coupling(("a", "b"), 1.0, damping, ratio),), PERIOD)


def _stable_by_hand(damping: float, ratio: float) -> float:
    bodies = [events.motor(each.mass, each.damping, each.torque_lag) for each, _ in DEVICES]
    shots = [events.Shot(0.0, tuple(delay for _, delay in DEVICES))]

    def is_stable(stiffness: float) -> bool:
        law = events.shaft(stiffness, damping, ratio, PERIOD)
        # The shaft may be turned as a whole, and nothing turns it back: one eigenvalue is 1.
        return events.growth(events.map_of_turn(bodies, PERIOD, shots, law, memory=1), freely=1) <= 1.0

    return contact.largest(is_stable, 1.0, 1.4, 1e-8)


def _share_by_hand(stiffness: float, damping: float, ratio: float, cells: int) -> float:
    """Return the share of both dampings that the worst motion of both handles needs."""
    ends = np.outer([1.0, -ratio], [1.0, -ratio])
    drives = [energies.LateDrive(each.damping, delay, each.torque_lag) for each, delay in DEVICES]
    return energies.worst_share(lambda z: -(stiffness + damping * (1 - 1 / z) / PERIOD) * ends, drives, PERIOD, cells)


def _torn(damping: float, ratio: float) -> float:
    """Return the difference of the forces of a coupling from those of a spring and damper between x₁ and n·x₂."""
    law = Coupling(("a", "b"), 400.0, damping, ratio).begin(PERIOD)
    places = np.random.default_rng(2).uniform(-0.1, 0.1, (100, 4)).tolist()
    worst = 0.0
    for first, speed, second, turning in places:
        force = -400.0 * (first - ratio * second) - damping * (speed - ratio * turning)
        found = law(first, speed, second, turning) if damping else law(first, second)
        worst = greatest((worst, largest_error(found, (force, -ratio * force)) / (40.0 * max(1.0, ratio**2))))
    return worst


def coupled_axes(quick: bool) -> CaseResult:
    """Check a virtual shaft between two unequal axes: stability, energy with any hands, friction, and its forces."""
    judged = [_tied(*shaft).stability.stiffness_limit for shaft in SHAFTS]
    stable = [limit.stable or 0.0 for limit in judged]
    by_hand = [_stable_by_hand(*shaft) for shaft in SHAFTS]
    passive = [limit.passive or 0.0 for limit in judged]
    cells = 20 if quick else 60
    shares = [_share_by_hand(limit, *shaft, cells) for limit, shaft in zip(passive, SHAFTS, strict=True)]
    held = [2.0 * min(0.02 / 1e-5, 0.001 / 2e-6 / ratio**2) for _, ratio in SHAFTS]
    apart = relative_error(stable, by_hand)
    worst = greatest(abs(share - 1.0) for share in shares)
    friction = relative_error([limit.quantisation or 0.0 for limit in judged], held)
    torn = greatest(_torn(part * damping, ratio) for damping, ratio in SHAFTS for part in (0.0, 1.0))
    return result_of(
        f"ratios of -2.5 and 0.4: stable to {values_text(by_hand, 6)} N/m; where passivity ends, the worst motion of "
        f"both handles needs all of both dampings; friction bridges counts to {values_text(held, 4)} N/m",
        f"stable to {values_text(stable, 6)} N/m, apart by {rounded(apart, 1)}; passive to {values_text(passive, 4)} "
        f"N/m, needed share of the dampings off by {rounded(worst, 1)}; counts off by {rounded(friction, 1)}, forces "
        f"by {rounded(torn, 1)}",
        "both devices from event to event; the worst of all motions in cells of constant speed; F₂ = -n·F₁ and "
        "2·fc/(n²·D) by hand",
        tolerance=f"{exactly(AGREEMENT)} of the limits, {exactly(CUT)} of the energies, {exactly(EXACT)} of the rest",
        within=[(apart, AGREEMENT), (worst, CUT), (friction, EXACT), (torn, EXACT)],
    )


MOTOR, DELAY = Plant(0.1, 2.0, torque_lag=0.16e-3), 0.3e-3
LOAD, STIFF = 0.05, 3e3
"""Mass [kg] behind a transmission of a stiffness [N/m]: both swing against each other at 48 Hz."""
LOSSES = (0.0, 1.0, 20.0)
"""Dampings of transmissions [N·s/m]."""
RIGID = 1e9
"""Stiffness of a transmission that is as good as rigid [N/m]."""


def _judged(*bodies: HungBody, plant: Plant = MOTOR) -> float:
    """Return the limit of stability of a wall on a motor with these bodies [N/m]."""
    wall = Wall("handle", stiffness=100.0)
    group = Group((Member("handle", plant, DELAY, (wall,), None, ESTIMATOR, bodies=bodies),), (), PERIOD)
    return group.stability.stiffness_limit.stable or 0.0


def compliant_transmission(quick: bool) -> CaseResult:
    """Check the limit of a motor with a load behind a spring: their oscillation counts; a rigid one is one mass."""
    found = [_judged(HungBody(LOAD, STIFF, loss)) for loss in LOSSES]
    motor = events.motor(MOTOR.mass, MOTOR.damping, MOTOR.torque_lag)
    loaded = [events.motor_with_load(motor, MOTOR.mass, LOAD, STIFF, loss) for loss in LOSSES]
    by_hand = [contact.limit_in_contact(body, PERIOD, DELAY) for body in loaded]
    whole = _judged(plant=Plant(MOTOR.mass + LOAD, MOTOR.damping, torque_lag=MOTOR.torque_lag))
    rigid = _judged(HungBody(LOAD, RIGID, math.sqrt(RIGID * LOAD)))
    apart = relative_error(found, by_hand)
    off = abs(rigid / whole - 1.0)
    return result_of(
        f"transmissions of {exactly(STIFF)} N/m with 0, 1, 20 N·s/m: stable to {values_text(by_hand, 6)} N/m; one of "
        f"{exactly(RIGID)} N/m as a motor that has the load's mass",
        f"stable to {values_text(found, 6)} N/m, apart by {rounded(apart, 1)}; rigid {rounded(rigid, 6)} of "
        f"{rounded(whole, 6)} N/m, off by {rounded(off, 1)}",
        "motor, torque loop and load from event to event; a sum of two masses",
        tolerance=f"{exactly(AGREEMENT)} of each limit",
        within=[(apart, AGREEMENT), (off, AGREEMENT)],
    )


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
            runs[name] = follow(one, inputs, [0.0, 0.0])
    bounded = [name for name, run in runs.items() if not run.diverged and np.abs(run.outputs).max() <= 1.001 * k]
    worst = greatest(float(np.abs(runs[name].outputs[:, 0] - exact).max()) / k for name in ("exact-zoh", "exact-foh"))
    allowed = 2e-14 * h * steps
    expected = ["backward-euler", "trapezoidal", "exact-zoh", "exact-foh"]
    return result_of(
        f"bounded only: {', '.join(expected)}; exact ones on −k·cos(ωt) for {steps} steps",
        f"bounded: {', '.join(bounded)}; exact ones off by {rounded(worst, 2)} of k ({rounded(allowed, 1)} allowed)",
        "closed form −k·cos(ωt); stability at h = 1000 by hand",
        tolerance=f"{rounded(allowed, 1)} of k",
        within=[(worst, allowed)],
        holds=sorted(bounded) == sorted(expected),
    )


def _two_masses(puck: float, duration: float, steps: int, method: str) -> float:
    """Return the largest error of the position of a puck pushed with 1 N, relative to its largest position."""
    total, reduced = puck + MASS, puck * MASS / (puck + MASS)
    one = integrators.discretise(two_masses(puck, MASS, STIFFNESS), duration / steps, method)
    found = follow(one, np.tile([1.0, 0.0], (steps, 1)), [0.0] * 4).states[:, 0]
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
    worst = greatest(errors.values())
    coarse, fine = (_two_masses(0.2, 1.0, count, "rk4") for count in (100, 200))
    return result_of(
        f"exact steps on the closed form for {exactly(steps * PERIOD)} s; rk4's error 16 times less at half the step",
        f"off by {rounded(worst, 2)} of the way (1e-9 allowed); rk4 {coarse / fine:.2f} times less (14 to 18 allowed)",
        "closed form: uniform acceleration of both masses, and their oscillation",
        tolerance="1e-9 of the way; the ratio of 16 within 14 to 18",
        within=[(worst, 1e-9), (coarse / fine - 16.0, 2.0)],
    )


def light_puck(quick: bool) -> CaseResult:
    """Check a puck of 1 mg, which oscillates by 14 rad in a period, and the limit 2b/T of a wall for light handles."""
    steps = 1000 if quick else 10_000
    error = _two_masses(1e-6, steps * PERIOD, steps, "exact-foh")
    euler = _two_masses(1e-6, steps * PERIOD, steps, "forward-euler")
    damping, masses = 0.5, (1e-4, 1e-5, 1e-6, 1e-9)
    *limits, massless = (stiffness_limit(Plant(mass, damping), PERIOD, 0.0, spring) for mass in (*masses, 0.0))
    worst = relative_error(limits, [contact.jury_limit(Plant(mass, damping), PERIOD) for mass in masses])
    return result_of(
        "exact step on the closed form, forward Euler diverges; massless handle: limit "
        f"{exactly(2 * damping / PERIOD)} N/m",
        f"off by {rounded(error, 2)} (1e-8 allowed), Euler {rounded(euler, 1)}; limit {massless:.6f} N/m, masses from "
        f"1e-4 to 1e-9 kg off Jury's by {rounded(worst, 1)} (1e-8 allowed)",
        "closed form of two masses; Jury's conditions by hand, 2b/T without mass",
        tolerance="1e-8 of the way and of the limit",
        within=[(greatest((error, worst, abs(massless * PERIOD / (2.0 * damping) - 1.0))), 1e-8)],
        holds=euler > 1e6,
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
        x, v = contact.moved_by_force(device, x, v, force, PERIOD)
        q, speed = rule(q, speed, before, x, omega, PERIOD)
    return forces


def sampled_free_puck(quick: bool) -> CaseResult:
    """Check the virtual mass in the loop with a free handle: forces by each method of RULES, and which methods grow."""
    device, steps = Plant(0.3, 0.2), (8000 if quick else 40_000)
    plant = sample(device, PERIOD, 0.0)
    worst, growing, wrong = 0.0, [], []
    for method in RULES:
        virtual = sampled.environment(sprung_mass(), period=PERIOD, method=method, estimator=None)
        forces, radius = flicked(plant, virtual, steps).tolist(), sampled.growth(plant, virtual)
        brute = _textbook_forces(device, method, steps)
        tenth, peak = steps // 10, greatest(map(abs, brute))
        worst = greatest((worst, largest_error(forces, brute) / peak))
        grew = greatest(map(abs, brute[-tenth:])) > greatest(map(abs, brute[:tenth]))
        if grew:
            growing.append(method)
        if grew != (radius > 1.0):
            wrong.append(method)
    return result_of(
        f"forces of textbook loops for {steps} periods; in them grow: {', '.join(growing) or 'none'}",
        f"off by {rounded(worst, 2)} of the peak (1e-9 allowed); spectral radius disagrees for: "
        f"{', '.join(wrong) or 'none'}",
        "every method as textbooks write it, around a device in closed form, in plain floats",
        tolerance="1e-9 of the largest force; the set of methods exact",
        within=[(worst, 1e-9)],
        holds=not wrong,
    )


def start_inside_the_wall(quick: bool) -> CaseResult:
    """The limit fades in over 0.5 s, so a run that starts 10 mm inside a wall of 600 N/m begins without a kick.

    A run that would start with more than a quarter of the limit is refused, without any torque.
    """
    cycle = Feeder(plan("wall", settings={"wall.position": -0.01}))
    unit = cycle.plan.axes[0].effort_unit
    forces = []
    # Ends before 2 s, when counts that stand still under force are questioned.
    for number in range(1000 if quick else 1900):
        feed(cycle, t_ns=number * PERIOD_NS)
        forces.append(cycle.value("command"))
    worst = largest_error(forces, [-min(6.0, 1000 * unit * (number + 1) / 500.0) for number in range(len(forces))])
    deeper = Feeder(plan("wall", settings={"wall.position": -0.1}))
    refused = not any(feed(deeper)) and deeper.tripped is TripKind.START_FORCE
    return result_of(
        "10 mm deep: -6 N on the line of the limit, 50.3 N in 0.5 s; 100 mm deep: refused without torque",
        f"off the line by {worst:.4f} N (0.51 of a step of torque, {unit:.4f} N, allowed); "
        f"{'refused without torque' if refused else 'not refused'}",
        "the line by hand: rated torque · t/0.5 s until 600 N/m · 10 mm, rounded to the drive's step",
        tolerance="0.51 of a step of torque",
        within=[(worst, 0.51 * unit)],
        holds=refused,
    )
