"""Cases of elements at their limits: fast impacts, stiff tissue, bristles, a standstill, sharp and varying slopes."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from haptic_fieldbus import Stability, Verdict
from haptic_fieldbus.margins import Group, Member, Plant, stiffness_limit
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.scenes.generalised_maxwell import GeneralisedMaxwell
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.lugre import LuGre
from haptic_fieldbus.sim import mechanics
from haptic_fieldbus.sim.mechanics import Shaft
from haptic_fieldbus.study.case import CaseResult, greatest, largest_error, relative_error, result_of, values_text
from haptic_fieldbus.study.explicit import bind_rates
from haptic_fieldbus.study.oracles import contact, energies, events

LOSS, IMPACT_MASS = 0.6, 0.2
"""Loss factor p of the impact [s/m], and the mass that hits [kg]."""
BODY = HuntCrossley("handle", effort=100.0, depth=0.01, exponent=1.5, loss=LOSS)
"""F = −k·xⁿ·(1 + p·v), k = 1e5 N/m^1.5."""
PERIOD = 1e-3


def _contact(depth: float, speed: float) -> float:
    """Return the force with which the body pushes outwards [N]; below 0 when it pulls."""
    return 0.0 - BODY.force(depth, speed)


def _impact(speed: float, period: float) -> tuple[float, float]:
    """Return exit speed [m/s] and smallest force [N] of a mass that hits at `speed`, computed by RK4."""
    step = bind_rates(lambda t, z: (z[1], -_contact(*z) / IMPACT_MASS), (0.0, speed), period, "rk4")
    smallest, (depth, now) = 0.0, step()
    while depth >= 0.0:
        depth, now = step()
        smallest = -greatest((-smallest, -_contact(depth, now)))
    return -now, smallest


def _exit_speed(speed: float) -> float:
    """Return the exit speed w [m/s] with −p·w − ln(1 − p·w) = p·v − ln(1 + p·v), by bisection."""
    entry = LOSS * speed - math.log1p(LOSS * speed)
    return contact.bisected(lambda leaving: -leaving - math.log1p(-leaving) < entry, 0.0, 1.0, 2.3e-16)[0] / LOSS


def hunt_crossley_fast_impact(quick: bool) -> CaseResult:
    """Check that p·v − ln(1 + p·v) is equal at entry and exit of slow and fast impacts, and the body never pulls."""
    speeds = (0.1, 1.0, 5.0, 20.0)
    found = [_impact(speed, 2e-6 if quick else 2e-7) for speed in speeds]
    exact = [_exit_speed(speed) for speed in speeds]
    error = greatest(abs(left - right) / right for (left, _), right in zip(found, exact, strict=True))
    pulled_out = _contact(1e-3, -3.0 / LOSS)
    smallest = -greatest(-force for _, force in found)
    return result_of(
        f"in at 0.1, 1, 5, 20 m/s, out at {values_text(exact, 5)} m/s (within 1e-6); never a force below 0 N",
        f"out at {values_text([left for left, _ in found], 5)} m/s, off by {rounded(error, 1)}; smallest force "
        f"{exactly(smallest)} N, {exactly(pulled_out)} N when pulled out at 3/p",
        "closed form: p·v − ln(1 + p·v) is equal at entry and exit, solved by bisection",
        tolerance="1e-6 of the speed; the sign of the force exact",
        within=[(error, 1e-6)],
        holds=smallest >= 0.0 and pulled_out == 0.0,
    )


TISSUE = GeneralisedMaxwell("handle", rest=100.0, branches=((200.0, 0.1), (300.0, 1e-3), (500.0, 1e-5)))
"""Tissue with a lasting stiffness [N/m], and branches of stiffness [N/m] and relaxation time [s]."""


def _pressed(branches: Sequence[tuple[float, float]], steps: int) -> list[float]:
    """Return the closed form of the force in the periods from a press of 1 mm on [N]."""
    return [-1e-3 * (TISSUE.rest + sum(k * math.exp(-n * PERIOD / tau) for k, tau in branches)) for n in range(steps)]


def _relaxation(method: str, steps: int) -> list[float]:
    """Return the force of a method minus the closed form [N], for each period."""
    step = bind(TISSUE.linearised(), PERIOD, method)
    step(0.0)
    return [step(1e-3) - force for force in _pressed(TISSUE.branches, steps)]


def _law(steps: int) -> float:
    """Return the largest difference of the element's own step from its closed form [N]."""
    # The element takes the press as a ramp over one period: each branch has relaxed a little at its end.
    law = TISSUE.begin(PERIOD)
    law(0.0)
    ramps = [(k * tau / PERIOD * -math.expm1(-PERIOD / tau), tau) for k, tau in TISSUE.branches]
    return greatest(abs(law(1e-3) - force) for force in _pressed(ramps, steps))


def multi_scale_tissue(quick: bool) -> CaseResult:
    """Check three methods on a press of 1 mm, with branches of 100 ms, 1 ms and 10 µs at a period of 1 ms.

    Forward Euler explodes, the trapezoidal rule rings, and the exact step follows the closed form.
    """
    steps = 50
    euler, trapezoid, exact = (_relaxation(method, steps) for method in ("forward-euler", "trapezoidal", "exact-zoh"))
    growth = abs(euler[-1] / euler[-2])
    late = trapezoid[15:]  # the branch of 1 ms has died away, that of 10 µs rings on
    turns = sum(a * b < 0.0 for a, b in pairwise(late))
    ratio = late[2] - late[1], late[1] - late[0]
    error = greatest((*map(abs, exact), _law(steps)))
    return result_of(
        "forward Euler ×99.0 a period, the trapezoid turns sign every period by ×-0.961 (within 0.003), "
        "exact step on the closed form within 1e-12 N",
        f"forward Euler ×{rounded(growth, 4)}; trapezoid {turns} turns in {len(late) - 1} periods, "
        f"×{ratio[0] / ratio[1]:.3f}; exact step off by {rounded(error, 1)} N",
        "closed form: F = −x·(k₀ + Σ k·e^(−t/τ)); factors 1 − T/τ and (1 − T/2τ)/(1 + T/2τ) of the fastest branch",
        tolerance="0.01 of 99, 0.003 of the turns; 1e-12 N",
        within=[(growth - 99.0, 0.01), (ratio[0] / ratio[1] + 49.0 / 51.0, 3e-3), (error, 1e-12)],
        holds=turns == len(late) - 1,
    )


BRISTLE, LEVEL = 1e5, 2.0
"""Stiffness σ0 [N/m] and level g [N] of a LuGre bristle, without the Stribeck effect."""
LUGRE = LuGre("handle", coulomb=LEVEL, stiffness=BRISTLE)


def _explicit_error(speed: float, steps: int) -> float:
    """Return the distance of a bristle from its steady stretch after so many periods of forward Euler, relative to it.

    It slips at constant speed.
    """
    step = bind_rates(lambda t, z, v: (v - BRISTLE * abs(v) / LEVEL * z[0],), (0.0,), PERIOD, "forward-euler")
    return abs([step(speed) for _ in range(steps + 1)][-1][0] * BRISTLE / LEVEL - 1.0)


def _element_bristle(speeds: Iterable[float]) -> list[float]:
    """Return the stretch of the element's bristle after each period [m], at constant speed within it."""
    law, place = LUGRE.begin(PERIOD), 0.0
    law(place)
    return [-law(place := place + speed * PERIOD) / BRISTLE for speed in speeds]


def lugre_fast_slip(quick: bool) -> CaseResult:
    """Check that an explicit bristle explodes above |v| = 2·g/(σ0·T), and the element's exact step at no speed."""
    limit, steps = 2.0 * LEVEL / (BRISTLE * PERIOD), 500
    below, above = _explicit_error(0.99 * limit, steps), _explicit_error(1.01 * limit, steps)
    slips = [share * limit for share in (1e-4, 0.01, 0.3, 1.0, -1.01)]
    by_hand = [contact.stretches(speed, PERIOD, 3, BRISTLE, LEVEL) for speed in slips]
    error = greatest(map(relative_error, (_element_bristle([speed] * 3) for speed in slips), by_hand))
    speeds = ((-1.0) ** n * limit * 10.0 ** (n % 9) for n in range(steps if quick else 1_000_000))
    largest = greatest(BRISTLE * abs(z) / LEVEL for z in _element_bristle(speeds))
    rates = [math.log(value) / steps for value in (below, above)]
    return result_of(
        f"explicit: error ×0.98 a period at 0.99 of {exactly(limit)} m/s, ×1.02 at 1.01; element: z = g/σ0·(1 - "
        "e^(-σ0·v·t/g)) within 1e-12, force within g up to 1e8 times the limit",
        f"×{math.exp(rates[0]):.4f} and ×{math.exp(rates[1]):.4f} a period; element off by {rounded(error, 1)}, "
        f"largest force {rounded(largest, 6)} g",
        "closed forms of the bristle, and of the error of its explicit step, which is multiplied by 1 − σ0·|v|·T/g",
        tolerance="1e-6 of ln of growth; 1e-12 of the force",
        within=[(rates[0] - math.log(0.98), 1e-6), (rates[1] - math.log(1.02), 1e-6), (error, 1e-12)],
        holds=largest <= 1.0 + 1e-12,
    )


INERTIA, VISCOUS, COULOMB, SPIN, LAG = 4e-5, 1e-4, 2e-3, 20.0, 1.6e-4
"""Shipped bench at the motor shaft [kg·m², N·m·s/rad, N·m], initial speed [rad/s], and lag of the torque loop [s]."""
RENDERED = Friction("shaft", coulomb=COULOMB, stiffness=0.05)
"""Element with the same friction, for a shaft that has none."""


def _thrown(damping: float, t_ns: int) -> mechanics.Plant:
    """Return the simulated shaft `t_ns` after it was set in motion, without torque and without a hand."""
    plant = mechanics.Plant(Shaft(INERTIA, damping, COULOMB, LAG), None, velocity=SPIN)
    plant.advance(t_ns)
    return plant


def _stop(damping: float) -> tuple[float, float]:
    """Return time [s] and angle [rad] of the simulated standstill, the time by bisection to a nanosecond."""
    low, high = 0, 1_000_000_000
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _thrown(damping, middle).velocity > 0.0 else (low, middle)
    return high * 1e-9, _thrown(damping, 2_000_000_000).position


def _rendered_way() -> float:
    """Return the angle at which the shaft reverses if the friction is rendered at 1 kHz [rad]."""
    plant, law, t_ns = mechanics.Plant(Shaft(INERTIA, 0.0, 0.0, LAG), None, velocity=SPIN), RENDERED.begin(PERIOD), 0
    way = 0.0
    while plant.velocity > 0.0:
        way = plant.position
        plant.set_target(law(way))
        t_ns += round(PERIOD * 1e9)
        plant.advance(t_ns)
    return max(way, plant.position)


def coulomb_stop(quick: bool) -> CaseResult:
    """Check that a shaft set in motion against Coulomb friction, its own or rendered, stops after a known angle."""
    logarithm = math.log1p(VISCOUS * SPIN / COULOMB)
    times = INERTIA / VISCOUS * logarithm, INERTIA * SPIN / COULOMB
    undamped = INERTIA * SPIN**2 / (2.0 * COULOMB)
    ways = INERTIA / VISCOUS * (SPIN - COULOMB / VISCOUS * logarithm), undamped
    found = [_stop(VISCOUS), _stop(0.0)]
    rendered = undamped + 0.5 * COULOMB / RENDERED.stiffness + SPIN * (PERIOD / 2 + LAG)
    turned = _rendered_way()
    late = largest_error([t for t, _ in found], times)
    off = relative_error([way for _, way in found], ways)
    return result_of(
        f"stands after {times[0]:.6f} s and {ways[0]:.6f} rad with damping, {times[1]:.6f} s and {ways[1]:.6f} rad "
        f"without (within 2 ns and 1e-9), and stays; rendered, it turns after {rendered:.4f} rad (within 1e-4 of it)",
        f"{found[0][0]:.6f} s and {found[0][1]:.6f} rad, {found[1][0]:.6f} s and {found[1][1]:.6f} rad; off by "
        f"{rounded(1e9 * late, 2)} ns and {rounded(off, 1)}; rendered {turned:.4f} rad, off by "
        f"{rounded(abs(turned / rendered - 1.0), 1)}",
        "closed form: t = J/b·ln(1 + b·ω/fc), θ = J/b·(ω − fc/b·ln(1 + b·ω/fc)); J·ω/fc and J·ω²/2fc for b = 0, to "
        "which rendering adds fc/2K of its spring and ω·(T/2 + λ) of hold and torque loop",
        tolerance="2 ns, 1e-9 rad; rendered 1e-4 of the way",
        within=[(late, 2e-9), (off, 1e-9), (turned / rendered - 1.0, 1e-4)],
    )


HANDLE, PITCH = Plant(0.6, 1.6), 2e-3
"""Device, and pitch of its detents [m]."""
DETENTS = Detents("handle", amplitude=1.0, pitch=PITCH)


def _swing(stiffness: float, steps: int) -> float:
    """Return the growth factor of a swing of a millionth of a pitch in detents of this local stiffness [N/m]."""
    start, law = 1e-6 * PITCH, DETENTS.with_stiffness(stiffness).force
    positions = contact.sampled_positions(HANDLE, PERIOD, law, steps + 1, start=(start, 0.0))
    return greatest(map(abs, positions[-499:])) / start


def detent_too_sharp(quick: bool) -> CaseResult:
    """Check that a detent is calm in its valley when 2π·A/p is below the stiffness limit of a wall, and not above."""
    limit, steps = contact.jury_limit(HANDLE, PERIOD), 20_000 if quick else 200_000
    predicted = stiffness_limit(HANDLE, PERIOD, 0.0, lambda k: gain([[-DETENTS.with_stiffness(k).stiffness]]))
    calm, restless = _swing(0.9 * predicted, steps), _swing(1.1 * predicted, steps)
    off = abs(predicted / limit - 1.0)
    return result_of(
        f"limit {limit:.3f} N/m (within 1e-8), so A = {1e3 * limit * PITCH / (2 * math.pi):.1f} mN at 2 mm; a small "
        "swing at least halves at 0.9 of it and doubles at 1.1",
        f"limit {predicted:.3f} N/m, off by {rounded(off, 1)}; swing ×{rounded(calm)} and ×{rounded(restless)} in "
        f"{steps} periods",
        "Jury's criterion written by hand, and the sine simulated step by step",
        tolerance="1e-8 of the limit; the swing beyond a factor of 2",
        within=[(off, 1e-8)],
        holds=calm < 0.5 and restless > 2.0,
    )


# Case of contacts with a position-dependent slope: a body that stiffens with depth, and hilltops of detents.

SLOPES_PERIOD, DELAY, SLOPES_LAG = 1e-3, 0.3e-3, 0.16e-3
MASS, DAMPING, EFFORT = 0.1, 2.0, 20.0
"""Device [kg, N·s/m], and the largest force of its motor [N]."""
SLOPES_BODY = events.motor(MASS, DAMPING, SLOPES_LAG)
"""The same device."""
EXPONENT, DEPTH, FORCE, SLOPES_LOSS = 1.5, 0.01, 2.0, 1.0
"""Body k·dⁿ·(1 + p·ḋ): n, the force [N] at a depth [m] that gives k, and p [s/m]."""
STEEP = 300.0
"""Force [N] at that depth of a body that is stable at the effort limit and unstable at smaller forces."""
HEIGHT, SLOPES_PITCH = 0.4, 4e-3
"""Amplitude [N] and pitch [m] of detents."""
AGREEMENT, CUT = 1e-6, 5e-4
"""Permitted relative difference of limits and growths, and of energies: motions are cut into cells."""


def _judged(element: Element) -> Stability:
    plant = Plant(MASS, DAMPING, torque_lag=SLOPES_LAG)
    member = Member("handle", plant, DELAY, (element,), None, "backward-difference", effort=EFFORT)
    return Group((member,), (), SLOPES_PERIOD).stability


def _growth_by_hand(stiffness: float, damping: float) -> float:
    """Return the growth a period at a spring and damper by backward difference."""
    return contact.growth_in_contact(SLOPES_BODY, SLOPES_PERIOD, DELAY, stiffness, damping)


def _steepest(stiffness: float) -> float:
    """Return the slope at the effort limit of a body of this stiffness at DEPTH [N/m]: n·F/d ∝ F^(1 − 1/n)."""
    force = stiffness * DEPTH / EXPONENT
    return stiffness * math.pow(EFFORT / force, 1.0 - 1.0 / EXPONENT)


def _worst_by_hand(force: float, loss: float) -> tuple[float, float]:
    """Return the largest growth a period over all depths up to the effort limit, and its depth [m]."""
    deepest = DEPTH * math.pow(EFFORT / force, 1.0 / EXPONENT)
    depths = [deepest * 10.0 ** (-number / 20) for number in range(80)]
    found = [
        (_growth_by_hand(EXPONENT * push / depth, loss * push), depth)
        for depth in depths
        for push in [force * math.pow(depth / DEPTH, EXPONENT)]
    ]
    return max(found)


def _hilltop_by_hand() -> tuple[float, float]:
    """Return the growth a period on a hilltop of detents, of the loop and of the ideal: m·s² + b·s − K = 0."""
    steep = 2.0 * math.pi * HEIGHT / SLOPES_PITCH
    fall = 2.0 * steep / (DAMPING + math.sqrt(DAMPING**2 + 4.0 * MASS * steep))
    return _growth_by_hand(-steep, 0.0), math.exp(fall * SLOPES_PERIOD)


def varying_slope(quick: bool) -> CaseResult:
    """Check that a body is judged by its slope wherever the motor can hold the handle, hilltops by ideal growth.

    Without loss the slope at the effort limit decides. With loss the worst depth is somewhere in between.
    """
    elastic = _judged(HuntCrossley("handle", FORCE, DEPTH, exponent=EXPONENT)).stiffness_limit
    stable, passive = (_steepest(limit or math.nan) for limit in (elastic.stable, elastic.passive))
    by_hand = contact.limit_in_contact(SLOPES_BODY, SLOPES_PERIOD, DELAY)
    drives = [energies.LateDrive(DAMPING, DELAY, SLOPES_LAG)]
    share = energies.worst_share(lambda z: complex(-passive), drives, SLOPES_PERIOD, 24 if quick else 96)
    lossy = _judged(HuntCrossley("handle", STEEP, DEPTH, exponent=EXPONENT, loss=SLOPES_LOSS))
    crest, hilltop = _judged(Detents("handle", amplitude=HEIGHT, pitch=SLOPES_PITCH)).crest, _hilltop_by_hand()
    if lossy.place is None or lossy.place.position is None or crest is None or crest.ideal is None:
        raise ValueError("a body has a worst place, and detents have hilltops")
    place, deep, (growth, depth) = lossy.place, lossy.place.position, _worst_by_hand(STEEP, SLOPES_LOSS)
    push = STEEP * math.pow(deep / DEPTH, EXPONENT)
    pairs = (
        (stable, by_hand),
        (place.growth, _growth_by_hand(EXPONENT * push / deep, SLOPES_LOSS * push)),
        (crest.growth, hilltop[0]),
        (crest.ideal, hilltop[1]),
    )
    off = greatest(abs(one / other - 1.0) for one, other in pairs)
    return result_of(
        f"elastic: stable to a slope of {rounded(by_hand, 6)} N/m at the effort limit; where passivity ends, the worst "
        f"motion needs all of the damping; lossy: grows the most {rounded(1e3 * depth, 2)} mm deep, "
        f"×{rounded(growth, 5)} a period; hilltops ×{rounded(hilltop[0], 5)}, the ideal ×{rounded(hilltop[1], 5)}",
        f"stable to {rounded(stable, 6)}, passive to {rounded(passive, 4)} N/m, needed share off by "
        f"{rounded(abs(share - 1.0), 1)}; {lossy.verdict.value}, ×{rounded(place.growth, 5)} at "
        f"{rounded(1e3 * deep, 2)} mm; hilltops ×{rounded(crest.growth, 5)}, the ideal ×{rounded(crest.ideal, 5)}; off "
        f"by {rounded(off, 1)}",
        "slope and damping of k·dⁿ·(1 + p·ḋ) by hand at 80 depths, each from event to event; the worst of all motions "
        "in cells of constant speed; m·s² + b·s - K = 0",
        tolerance=f"{exactly(AGREEMENT)} of limit and growths, {exactly(CUT)} of the energy; 0.5 % of the worst excess "
        "over 1, as depths are tried in steps",
        within=[(off, AGREEMENT), (share - 1.0, CUT), (abs((place.growth - 1.0) / (growth - 1.0) - 1.0), 0.005)],
        holds=lossy.verdict is Verdict.UNSTABLE,
    )
