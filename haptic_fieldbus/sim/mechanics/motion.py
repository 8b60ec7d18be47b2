"""The modes of motion of the shaft, each a linear system: slipping or sticking, with a hand or without.

States: shaft angle θ and speed ω, motor torque τ, stretch δ = φ_h − θ of the hand's spring and the hand's speed ν, the
hand's force f and its slope g, the target u of the torque loop and the friction torque c:

    θ' = ω          ω' = (τ + c − b·ω + k·δ + d·(ν − ω)) / J         τ' = (u − τ) / T
    δ' = ν − ω      ν' = (f − k·δ − d·(ν − ω)) / m                   f' = g,  g' = −Ω²·f

While sticking, θ and ω are constant and the other equations hold. All quantities are at the motor shaft, SI.
"""

from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics.flow import MAX_TRANSITIONS, Flow

ANGLE, SPEED, TORQUE, STRETCH, HAND_SPEED, FORCE, SLOPE, TARGET, FRICTION = range(9)
ORDER = 9
State = tuple[float, ...]
"""All states, the nine of this module first, in this order."""

LONGEST_POWER = 48
"""Powers of two of a nanosecond that a prepared motion knows; together three days."""
_COUPLED = (SPEED, TORQUE, STRETCH, HAND_SPEED, FORCE, SLOPE, TARGET, FRICTION)
# Entries of the transition matrix that may be neither 0 nor 1, in the order in which `_held` and `_free` unpack them.
_HELD_ENTRIES = (
    *((row, column) for row in (ANGLE, SPEED, STRETCH, HAND_SPEED) for column in _COUPLED),
    *((TORQUE, TORQUE), (TORQUE, TARGET), (FORCE, FORCE), (FORCE, SLOPE), (SLOPE, FORCE), (SLOPE, SLOPE)),
)
_FREE_ENTRIES = (
    *((row, column) for row in (ANGLE, SPEED) for column in (SPEED, TORQUE, TARGET, FRICTION)),
    *((TORQUE, TORQUE), (TORQUE, TARGET)),
)


@dataclass(frozen=True)
class Shaft:
    """Inertia [kg·m²], viscous damping [N·m·s/rad], Coulomb friction [N·m] and lag of the torque loop [s]."""

    inertia: float
    damping: float
    coulomb: float
    lag: float


class Motion:
    """One mode of motion; `step` is the work of every period, in plain floats on the entries that are not zero."""

    def __init__(self, shaft: Shaft, grip: Grip | None, *, sticking: bool) -> None:
        self.flow = Flow(_matrix(shaft, grip, sticking))
        self._kernel = _free if grip is None else _held
        self._entries = _FREE_ENTRIES if grip is None else _HELD_ENTRIES
        self._tables: dict[int, tuple[float, ...]] = {}
        self._powers: tuple[tuple[float, ...], ...] = ()
        """Tables of 1, 2, 4 … ns once the motion is prepared."""

    def prepare(self, usual_ns: int) -> None:
        """Build what any step needs, for spans that do not repeat: from now on no exponential is computed.

        A step is then made of those over powers of two, which costs a few of them and is as exact; one of `usual_ns` is
        made at once.
        """
        self._tables[usual_ns] = self._table(usual_ns)
        self._powers = tuple(self._table(1 << power) for power in range(LONGEST_POWER))

    def step(self, state: State, span_ns: int) -> State:
        """Return the state after a whole number of nanoseconds."""
        table = self._tables.get(span_ns)
        if table is None:
            if self._powers:
                return self._by_powers(state, span_ns)
            # The spans of a run repeat, so the cache rarely fills.
            if len(self._tables) >= MAX_TRANSITIONS:
                self._tables.clear()
            table = self._tables[span_ns] = self._table(span_ns)
        return self._kernel(state, table)

    def _by_powers(self, state: State, span_ns: int) -> State:
        kernel, powers = self._kernel, self._powers
        while span_ns:
            power = min(span_ns.bit_length(), LONGEST_POWER) - 1
            state = kernel(state, powers[power])
            span_ns -= 1 << power
        return state

    def _table(self, span_ns: int) -> tuple[float, ...]:
        transition = self.flow.transition(span_ns)
        return tuple(float(transition[entry]) for entry in self._entries)


def _matrix(shaft: Shaft, grip: Grip | None, sticking: bool) -> Matrix:
    a = np.zeros((ORDER, ORDER))
    a[TORQUE, TARGET], a[TORQUE, TORQUE] = 1 / shaft.lag, -1 / shaft.lag
    k, d = (grip.stiffness, grip.damping) if grip is not None else (0.0, 0.0)
    if grip is not None:
        a[STRETCH, HAND_SPEED], a[STRETCH, SPEED] = 1.0, -1.0
        a[HAND_SPEED, FORCE], a[HAND_SPEED, STRETCH] = 1 / grip.inertia, -k / grip.inertia
        a[HAND_SPEED, HAND_SPEED], a[HAND_SPEED, SPEED] = -d / grip.inertia, d / grip.inertia
        a[FORCE, SLOPE], a[SLOPE, FORCE] = 1.0, -(grip.angular_frequency**2)
    if not sticking:
        a[ANGLE, SPEED] = 1.0
        a[SPEED, TORQUE] = a[SPEED, FRICTION] = 1 / shaft.inertia
        a[SPEED, SPEED] = -(shaft.damping + d) / shaft.inertia
        a[SPEED, STRETCH], a[SPEED, HAND_SPEED] = k / shaft.inertia, d / shaft.inertia
    return a


def _free(state: State, table: tuple[float, ...]) -> State:
    aw, at, au, ac, ww, wt, wu, wc, tt, tu = table
    angle, speed, torque, stretch, hand, force, slope, target, friction = state
    return (
        angle + aw * speed + at * torque + au * target + ac * friction,
        ww * speed + wt * torque + wu * target + wc * friction,
        tt * torque + tu * target,
        stretch,
        hand,
        force,
        slope,
        target,
        friction,
    )


def _held(state: State, table: tuple[float, ...]) -> State:
    # fmt: off
    (aw, at, ad, ah, af, ag, au, ac,
     ww, wt, wd, wh, wf, wg, wu, wc,
     dw, dt, dd, dh, df, dg, du, dc,
     hw, ht, hd, hh, hf, hg, hu, hc,
     tt, tu, ff, fg, gf, gg) = table
    w, t, d, h, f, g, u, c = state[1:]
    return (
        state[0] + aw * w + at * t + ad * d + ah * h + af * f + ag * g + au * u + ac * c,
        ww * w + wt * t + wd * d + wh * h + wf * f + wg * g + wu * u + wc * c,
        tt * t + tu * u,
        dw * w + dt * t + dd * d + dh * h + df * f + dg * g + du * u + dc * c,
        hw * w + ht * t + hd * d + hh * h + hf * f + hg * g + hu * u + hc * c,
        ff * f + fg * g,
        gf * f + gg * g,
        u,
        c,
    )
    # fmt: on
