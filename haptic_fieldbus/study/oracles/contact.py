"""Oracles of a body in contact: with a spring and damper, with counts and friction, under held forces."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from typing import Protocol

from haptic_fieldbus.study.oracles.events import LinearBody, Shot, growth, map_of_turn, spring_damper_law
from haptic_fieldbus.study.oracles.textbook import Number

# Device of one mass under held forces, in closed form and plain numbers.
#
# A plant m·ẍ = −b·ẋ + F is driven by a held force F_k = −K·x_k, which acts from td after its sample. With τ = m/b and
# ε(t) = 1 − exp(−t/τ), a force f moves the plant from rest within t by f·(t − τ·ε)/b, to the speed f·ε/b.


class Massive(Protocol):
    """Device with a mass [kg] and a damping [N·s/m], or their rotary counterparts."""

    @property
    def mass(self) -> float: ...

    @property
    def damping(self) -> float: ...


def moved_by_force(device: Massive, x: float, v: float, force: float, span: float) -> tuple[float, float]:
    """Return position [m] and velocity [m/s] after a span [s] of constant force [N]."""
    if not device.damping:
        a = force / device.mass
        return x + span * (v + 0.5 * a * span), v + a * span
    tau = device.mass / device.damping
    part = -math.expm1(-span / tau)  # keeps its digits when the span is short
    return x + tau * part * v + force * (span - tau * part) / device.damping, v + part * (force / device.damping - v)


def sampled_positions(
    device: Massive,
    period: float,
    law: Callable[[float], float],
    steps: int,
    *,
    delay: float = 0.0,
    push: float = 0.0,
    start: tuple[float, float] = (1e-3, 0.0),
) -> list[float]:
    """Return the positions at the samples [m]; fewer than `steps` when the loop diverged.

    `law` maps a position to a force, `delay` is in periods, `push` is a constant force of the hand [N], and `start` is
    position and velocity at the first sample.
    """
    whole = math.floor(delay)
    rest = (delay - whole) * period
    x, v = start
    forces = [0.0] * (whole + 2)
    positions = []
    for _ in range(steps):
        positions.append(x)
        forces = [law(x), *forces[:-1]]
        if rest:  # until the delay is over, the force of the sample before still acts
            x, v = moved_by_force(device, x, v, forces[whole + 1] + push, rest)
        x, v = moved_by_force(device, x, v, forces[whole] + push, period - rest)
        if not abs(x) < 1e100:
            break
    return positions


def growth_of(positions: list[float]) -> float:
    """Return ln of the greatest |position| in the last tenth over that in the first tenth."""
    tenth = max(1, len(positions) // 10)
    return math.log(max(map(abs, positions[-tenth:])) / max(map(abs, positions[:tenth])))


# A mass with viscous and Coulomb friction at a spring that sees counts of an encoder, in plain numbers.
#
# A hand presses with a constant force. Between two samples the force is constant, so the mass slides in one direction
# until it stops, and then rests or slides back: both instants are known in closed form.


@dataclass(frozen=True)
class Pressed:
    """Mass [kg], damping [N·s/m], Coulomb friction [N]; spring [N/m], count [m], hand [N]; period [s]."""

    mass: float
    damping: float
    coulomb: float
    stiffness: float
    step: float
    push: float
    period: float
    one_sided: bool = False
    """Whether the spring pushes at positions above 0 only."""
    most: float = math.inf
    """Largest force of the spring [N]."""

    def force(self, x: float) -> float:
        """Return the force on the mass for the count at a position [N]."""
        counted = math.floor(x / self.step + 0.5) * self.step
        spring = self.stiffness * (max(counted, 0.0) if self.one_sided else counted)
        return self.push - min(max(spring, -self.most), self.most)

    def moved(self, x: float, v: float) -> tuple[float, float]:
        """Return position and velocity a period later."""
        force, span = self.force(x), self.period
        while span > 0.0:
            if v == 0.0 and abs(force) <= self.coulomb:
                return x, 0.0
            left = force - math.copysign(self.coulomb, v or force)
            turn = self._turn(v, left)
            x, v = moved_by_force(self, x, v, left, min(turn, span))
            v = 0.0 if turn <= span else v
            span -= turn
        return x, v

    def _turn(self, v: float, left: float) -> float:
        """Return the time until the velocity passes 0 [s]; infinite when it never does."""
        if v * left >= 0.0:
            return math.inf
        return self.mass / self.damping * math.log1p(-v * self.damping / left)

    def rests(self, x: float, v: float, settle: int) -> bool:
        """Return whether the mass has come to rest within so many periods."""
        for _ in range(settle):
            x, v = self.moved(x, v)
            if v == 0.0 and abs(self.force(x)) <= self.coulomb:
                return True
        return False

    def dies(self, start: float) -> bool:
        """Return whether an oscillation from rest at a position decays; growth or decay by half decides."""
        x, v, peak, side = start, 0.0, 0.0, 1.0
        while True:
            x, v = self.moved(x, v)
            if v == 0.0 and abs(self.force(x)) <= self.coulomb:
                return True
            if x * side >= 0.0:
                peak = max(peak, abs(x))
            elif not 0.5 * start < peak < 1.5 * start:
                return peak < start
            else:
                side, peak = -side, abs(x)


def relay_speed(device: Pressed, samples: float) -> float:
    """Return the largest speed [m/s] of a symmetric cycle over the edge of a count, with so many samples in a half.

    The force is ±K·D/2. The speed goes from −v to +v within a half: v·(1 + e) = K·D/(2·b)·(1 − e), e = e^(−b·n·T/m).
    """
    turn = device.damping * samples * device.period / device.mass
    return 0.5 * device.stiffness * device.step / device.damping * math.tanh(0.5 * turn)


# Stretch of a LuGre bristle without the Stribeck effect: ż = v − σ0·|v|/g·z, from z = 0 at constant speed.


def stretches(speed: float, period: float, periods: int, stiffness: float, level: float) -> list[float]:
    """Return the stretch after each period [m]: g/σ0·(1 − e^(−σ0·|v|·t/g)) in the direction of the motion."""
    longest, rate = math.copysign(level / stiffness, speed), stiffness * abs(speed) / level
    return [-longest * math.expm1(-rate * number * period) for number in range(1, periods + 1)]


# Largest stable stiffness of a spring on a device under a held force, by characteristic polynomials.
#
# The device, its force and the letters are those of `held`.

DIGITS = 60
"""Digits of Decimal; a polynomial of degree 13 with roots close to 1 loses many of them."""


def plain_terms(device: Massive, period: float) -> tuple[float, float, float]:
    """Return (e, c1, c0) of the loop without delay, z² − (1 + e)·z + e + K·(c1·z + c0)."""
    tau, e = device.mass / device.damping, math.exp(-period * device.damping / device.mass)
    part = -math.expm1(-period / tau)
    return e, (period - tau * part) / device.damping, (tau * part - e * period) / device.damping


def jury_limit(device: Massive, period: float) -> float:
    """Return the stiffness limit without delay [N/m] by Jury's conditions K < 2·(1 + e)/(c1 − c0), K < (1 − e)/c0."""
    e, c1, c0 = plain_terms(device, period)
    return min(2.0 * (1.0 + e) / (c1 - c0), -math.expm1(-period * device.damping / device.mass) / c0)


def schur_cohn_limit(device: Massive, period: float, delay: float) -> float:
    """Return the stiffness at which a root first leaves the unit circle [N/m], in 60 digits; `delay` in periods."""
    with localcontext(prec=DIGITS):
        free, by_force = polynomials(device, period, delay)

        def stable(k: Decimal) -> bool:
            padded = [Decimal(0)] * (len(free) - len(by_force)) + by_force
            return _all_inside([a + k * c for a, c in zip(free, padded, strict=True)])

        return float(largest(stable, Decimal(device.damping / period) / 1000, Decimal("1.4"), Decimal("1e-10")))


def largest(stable: Callable[[Number], bool], first: Number, factor: Number, share: Number) -> Number:
    """Return the largest stable value, within a relative tolerance; 0 if even `first` is unstable.

    The search multiplies `first` by `factor` up to the first value that is not stable, and then bisects.
    """
    low, high = 0 * first, first
    while stable(high):
        low, high = high, high * factor
    return bisected(stable, low, high, share)[0] if low else low


def bisected(stable: Callable[[Number], bool], low: Number, high: Number, share: Number) -> tuple[Number, Number]:
    """Return a stable value and one that is not, closer than a share of it; `low` is stable, and `high` is not."""
    while high - low > share * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low, high


def polynomials(device: Massive, period: float, delay: float) -> tuple[list[Decimal], list[Decimal]]:
    """Return two polynomials P and Q of the characteristic equation P + K·Q = 0, highest power first.

    P = (z − 1)(z − e)·z^(n+1) and Q = (z − e)(b_x + a_x·z) + l·(b_v + a_v·z). A force moves the device by (a_x, a_v) in
    the period in which it begins to act, and by (b_x, b_v) in the next one; l is the distance in a period per unit of
    speed. `delay` is in periods.
    """
    m, b, span = Decimal(device.mass), Decimal(device.damping), Decimal(period)
    whole, tau = math.floor(delay + 1e-9), m / b
    early = max(Decimal(delay) - whole, Decimal(0)) * span
    late = span - early

    def held(time: Decimal) -> tuple[Decimal, Decimal]:
        part = 1 - (-time / tau).exp()
        return (time - tau * part) / b, part / b

    e, fading = (-span / tau).exp(), (-late / tau).exp()
    ax, av = held(late)
    x, v = held(early)
    bx, bv, way = x + tau * (1 - fading) * v, fading * v, tau * (1 - e)
    return [Decimal(1), -1 - e, e, *[Decimal(0)] * (whole + 1)], [ax, bx - e * ax + way * av, way * bv - e * bx]


def _all_inside(polynomial: list[Decimal]) -> bool:
    """Return whether all roots are inside the unit circle, by Schur and Cohn.

    Each step lowers the degree by one and keeps the number of roots outside.
    """
    while len(polynomial) > 1:
        first, last = polynomial[0], polynomial[-1]
        if abs(last) >= abs(first):
            return False
        turned = polynomial[::-1]
        polynomial = [x - last / first * y for x, y in zip(polynomial, turned, strict=True)][:-1]
    return True


# A body in contact with a spring and a damper by backward difference, from event to event: growth, and limit.


def growth_of_turn(
    body: LinearBody, turn: float, shots: Sequence[Shot], stiffness: float, damping: float, period: float
) -> float:
    """Return the growth over a turn of instants [s]; the damper divides each way by `period` [s]."""
    return growth(map_of_turn([body], turn, shots, spring_damper_law(stiffness, damping, period), memory=1))


def growth_in_contact(body: LinearBody, period: float, delay: float, stiffness: float, damping: float = 0.0) -> float:
    """Return the growth in a period [s] when each force acts `delay` [s] after its sample."""
    return growth_of_turn(body, period, [Shot(0.0, (delay,))], stiffness, damping, period)


def limit_in_contact(body: LinearBody, period: float, delay: float, damping: float = 0.0) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which nothing grows."""
    return largest(lambda k: growth_in_contact(body, period, delay, k, damping) <= 1.0, 1e-3, 1.4, 1e-9)
