"""A shaft with more than a rigid load: coupling, backlash, weight, cogging, Stribeck friction.

Theory: the motion is a chain of legs. The equations do not change on a leg: the shaft slips in one direction or sticks,
the coupling is on one flank or open. The linear part is followed exactly, the nonlinear torques within `leg.TOLERANCE`;
the length of a leg is halved until they are. A leg ends at its length, or earlier at a reversal, a breakaway, or a
flank that meets or parts; a new target or force of the hand cuts it short. Reading the shaft does not change its
motion, because each reading follows the leg from its start.

A reversal could be missed only in an oscillation faster than the ten nodes of a leg can show, and legs are short enough
for all frequencies of the linear part. All quantities are at the motor shaft, SI; `t_ns` is the plant's own time.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from haptic_fieldbus.drive.rig import Mechanics
from haptic_fieldbus.numerics.linear import Matrix, expm
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics import motion
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.motion import (
    ANGLE,
    FORCE,
    FRICTION,
    HAND_SPEED,
    SLOPE,
    SPEED,
    STRETCH,
    TARGET,
    TORQUE,
    Flow,
    Shaft,
    State,
)

# The parts that a rig may add to a rigid shaft, as linear systems and as nonlinear torques.
#
# The nine states of `motion` are followed by a constant one, the twist ψ = θ − θ_L of the coupling and the speed ω_L of
# the load behind it. Motor J_m and load J_L share the inertia of the axis; hand and weight act on the load:
#
#     J_m·ω'   = τ + c − b·ω − T + n_m          ψ' = ω − ω_L
#     J_L·ω_L' = T + k_h·δ + d_h·(ν − ω_L) + G + n_L          δ' = ν − ω_L
#
# Coupling, on the flank σ = ±1 of a backlash β: T = k·(ψ − σ·β/2) + d·(ω − ω_L), which never pulls. Contact ends where
# σ·T falls to zero. It begins where the flanks meet, or where σ·T rises from zero while they still overlap. In between
# T = 0. Without backlash there is one flank, and it also pulls. Without a coupling, motor and load are one body.
#
# The nonlinear torques are n_m (cogging, Stribeck) and n_L (a weight on a lever). All quantities are at the motor
# shaft, SI.

ONE, TWIST, LOAD_SPEED = range(motion.ORDER, motion.ORDER + 3)
ORDER = motion.ORDER + 3


@dataclass(frozen=True)
class Load:
    """Shaft and optional parts; `lever` is the signed ratio of handle to motor angle, None for a linear mechanism."""

    shaft: Shaft
    mechanics: Mechanics
    lever: float | None = None

    @property
    def motor_inertia(self) -> float:
        """Return the inertia on the motor's side of the coupling [kg·m²]; without a coupling, all of it."""
        return self.shaft.inertia - (self.load_inertia if self.mechanics.coupling is not None else 0.0)

    @property
    def load_inertia(self) -> float:
        """Return the inertia of the part that the hand holds [kg·m²]."""
        coupling = self.mechanics.coupling
        return self.shaft.inertia if coupling is None else coupling.load_inertia

    @property
    def held(self) -> int:
        """Return the index of the state that is the speed of the part that the hand holds."""
        return SPEED if self.mechanics.coupling is None else LOAD_SPEED

    @property
    def half_play(self) -> float:
        """Return half of the backlash [rad]; 0 without one."""
        coupling = self.mechanics.coupling
        return coupling.backlash / 2 if coupling is not None else 0.0

    @property
    def breakaway(self) -> float:
        """Return the largest torque that friction can hold at standstill [N·m]."""
        stribeck = self.mechanics.stribeck
        return self.shaft.coulomb + (stribeck.torque if stribeck is not None else 0.0)

    def system(self, grip: Grip | None, *, sticking: bool, flank: int) -> Matrix:
        """Return the linear part, shape (12, 12) in 1/s.

        `flank` is ±1, 0 while the coupling is open, and 1 where there is no backlash.
        """
        a = np.zeros((ORDER, ORDER))
        a[TORQUE, TARGET], a[TORQUE, TORQUE] = 1 / self.shaft.lag, -1 / self.shaft.lag
        if not sticking:
            a[ANGLE, SPEED] = 1.0
            # A sticking shaft does not move; the coupling and the hand still do.
            a[SPEED] = self._acting(grip, flank) / self.motor_inertia
            a[SPEED, SPEED] -= self.shaft.damping / self.motor_inertia
            a[SPEED, FRICTION] = 1 / self.motor_inertia
        if self.mechanics.coupling is not None:
            a[TWIST, SPEED], a[TWIST, LOAD_SPEED] = 1.0, -1.0
            a[LOAD_SPEED] = (self.coupling_torque(flank) + self._on_load(grip)) / self.load_inertia
        if grip is not None:
            a[STRETCH, HAND_SPEED], a[STRETCH, self.held] = 1.0, -1.0
            a[HAND_SPEED] = -_hand(grip, self.held) / grip.inertia
            a[HAND_SPEED, FORCE] = 1 / grip.inertia
            a[FORCE, SLOPE], a[SLOPE, FORCE] = 1.0, -(grip.angular_frequency**2)
        return a

    def coupling_torque(self, flank: int) -> Matrix:
        """Return T as a form of the states, shape (12,)."""
        form = np.zeros(ORDER)
        coupling = self.mechanics.coupling
        if coupling is not None and flank:
            # The constant state carries the offset of the flank.
            form[TWIST], form[ONE] = coupling.stiffness, -flank * coupling.stiffness * self.half_play
            form[SPEED], form[LOAD_SPEED] = coupling.damping, -coupling.damping
        return form

    def pull(self, grip: Grip | None, flank: int) -> Matrix:
        """Return the torque on the motor at rest as a form, shape (12,), without friction and nonlinear torques."""
        form = self._acting(grip, flank)
        form[SPEED] = 0.0
        return form

    def _acting(self, grip: Grip | None, flank: int) -> Matrix:
        """Return the torque on the motor as a form, shape (12,), without its own friction and nonlinear torques."""
        form = self._on_load(grip) if self.mechanics.coupling is None else -self.coupling_torque(flank)
        form[TORQUE] = 1.0
        return form

    def _on_load(self, grip: Grip | None) -> Matrix:
        """Return the torque of hand and constant weight on the load as a form, shape (12,)."""
        form = np.zeros(ORDER)
        if grip is not None:
            form += _hand(grip, self.held)
        gravity = self.mechanics.gravity
        if gravity is not None and self.lever is None:
            form[ONE] = gravity.torque
        return form


def _hand(grip: Grip, held: int) -> Matrix:
    """Return the torque of the hand's spring and damper on the part that it holds as a form, shape (12,)."""
    form = np.zeros(ORDER)
    form[STRETCH], form[HAND_SPEED], form[held] = grip.stiffness, grip.damping, -grip.damping
    return form


class Torques:
    """The nonlinear torques of a load."""

    def __init__(self, load: Load) -> None:
        self._load = load
        parts = load.mechanics
        on_motor = parts.cogging is not None or parts.stribeck is not None
        on_load = parts.gravity is not None and load.lever is not None
        rows = [SPEED] * on_motor + [load.held] * on_load
        self.rows = tuple(dict.fromkeys(rows))
        """Indices of the speeds on which they act, each once."""
        self.inertias = tuple(load.motor_inertia if row == SPEED else load.load_inertia for row in self.rows)
        on_lever = abs(parts.gravity.torque) if parts.gravity is not None and load.lever is not None else 0.0
        self.scale = sum((part.torque for part in (parts.cogging, parts.stribeck) if part is not None), on_lever)
        """Sum of the largest torques [N·m]."""
        self.fineness = max(
            abs(load.lever or 0.0), parts.cogging.periods_per_revolution if parts.cogging is not None else 0.0
        )
        """Largest angular frequency of the torques along the shaft's angle [rad/rad]."""

    def at(self, angle: Matrix, speed: Matrix, handle: Matrix, direction: int) -> Matrix:
        """Return the torques on each of `rows` [N·m] at m instants, shape (len(rows), m).

        `angle`, `speed` and `handle` have shape (m,); `handle` is the angle of the load at the motor shaft. `direction`
        is the slip direction of the shaft, 0 while it sticks.
        """
        torques = np.zeros((len(self.rows), len(angle)))
        parts, lever = self._load.mechanics, self._load.lever
        if parts.cogging is not None:
            torques[0] -= parts.cogging.torque * np.sin(parts.cogging.periods_per_revolution * angle)
        if parts.stribeck is not None and direction:
            torques[0] -= direction * parts.stribeck.torque * np.exp(-((speed / parts.stribeck.velocity) ** 2))
        if parts.gravity is not None and lever is not None:
            towards = math.copysign(1.0, lever)
            torques[-1] -= towards * parts.gravity.torque * np.sin(lever * handle - parts.gravity.hanging_at)
        return torques


# A leg: one stretch of motion under one law, on which the nonlinear torques are polynomials in time.
#
# Theory: the polynomial p of degree 9 of each nonlinear torque passes through its values at the ten
# Legendre–Gauss–Lobatto nodes of the leg. With p the motion is linear, so a `Flow` follows it exactly; its last states
# are the coefficients of p about the instant half a leg ahead, x_i' = (i + 1)·x_{i+1}·2/h, p = Σ x_i·(−1)^i. The motion
# in turn determines the torques at the nodes. This fixed point is iterated to rounding (exponential collocation;
# Hochbruck & Ostermann 2010, doi:10.1017/S0962492910000048). Then p is compared with the torques between the nodes. A
# leg is too long when the iteration does not converge, or when p is off by more than `TOLERANCE` of the largest torque.
#
# Times are in nanoseconds, everything else is SI.

TOLERANCE = 1e-11
"""Largest error of p between the nodes, relative to the largest torque."""
TERMS = 10
"""Coefficients of each polynomial."""
_CONTRACTION = 0.25
"""Largest permitted ratio of the changes of two successive iterations."""
# The iteration ends when the torques change by less than this share of the largest torque.
_SETTLED = 1e-13
_ROUNDING = 4e-16

NODES = np.concatenate([[-1.0], np.sort(legendre.Legendre.basis(TERMS - 1).deriv().roots().real), [1.0]])
"""Nodes of a leg from −1 to 1: its ends and the extrema of the Legendre polynomial of degree 9."""
# Points between the nodes at which p is compared with the torques.
_BETWEEN = np.array([0.5 * (NODES[at] + NODES[at + 1]) for at in (1, 4, 7)])
_FIT = np.linalg.inv(np.vander(NODES, increasing=True))
_CHECK = np.vander(_BETWEEN, TERMS, increasing=True)
# Value of p at the present, from its coefficients about the instant half a leg ahead.
_OUTPUT = (-1.0) ** np.arange(TERMS)


@dataclass(frozen=True)
class LegWatch:
    """A watched form, sign·(form·z) + offset, that must not become negative; `row` is the index of the form."""

    row: int
    sign: float
    offset: float


class Leg:
    """All legs of one length and one law; `system` (12, 12) in 1/s, `rows` (r, 12) are the forms that are watched."""

    def __init__(self, system: Matrix, torques: Torques, rows: Matrix, on_motor: int, length_ns: float) -> None:
        """Prepare the leg; `on_motor` is the form to which the nonlinear torque on the motor is added."""
        self.length_ns = length_ns
        self.torques = torques
        order = ORDER + TERMS * len(torques.rows)
        a = np.zeros((order, order))
        a[:ORDER, :ORDER] = system
        self._rows = np.zeros((len(rows), order))
        self._rows[:, :ORDER] = rows
        per_second = 2e9 / length_ns
        # The coefficients of one polynomial form a chain: the derivative of each is a multiple of the next one.
        for channel, (row, inertia) in enumerate(zip(torques.rows, torques.inertias, strict=True)):
            at = ORDER + TERMS * channel
            a[at : at + TERMS - 1, at + 1 : at + TERMS] = np.diag(np.arange(1, TERMS) * per_second)
            if row != SPEED or system[ANGLE, SPEED]:  # a shaft that sticks is not moved
                a[row, at : at + TERMS] = _OUTPUT / inertia
            if row == SPEED:
                self._rows[on_motor, at : at + TERMS] = _OUTPUT
        self.flow = Flow(a, rate=TERMS * per_second)
        self._prepare(a * 1e-9)

    def _prepare(self, a: Matrix) -> None:
        """Compute the motion at and between the nodes, from the state at the start and the torques at the nodes."""
        moments = (np.concatenate([NODES, _BETWEEN]) + 1) * (self.length_ns / 2)
        transitions = expm(a * moments[:, np.newaxis, np.newaxis])
        self._node_ns = moments[:TERMS]
        watched = np.stack([self._rows, self._rows @ a])
        self._watched = np.einsum("fro,mon->frmn", watched, transitions[:TERMS])
        self._to_node = transitions[:TERMS]
        seen = transitions[:, [ANGLE, SPEED, TWIST]].transpose(1, 0, 2)
        self._free = seen[..., :ORDER]
        channels = len(self.torques.rows)
        poly = seen[..., ORDER:].reshape(*seen.shape[:2], channels, TERMS) @ _FIT
        self._forced = poly.reshape(*seen.shape[:2], channels * TERMS)

    def start(self, state: Sequence[float], direction: int) -> tuple[Matrix, float]:
        """Return (state with the coefficients of the polynomials, error relative to the permitted one).

        `state` has shape (12,). The leg is short enough when the error is at most 1; it is inf when the iteration does
        not converge.
        """
        z = np.array(state)
        if not self.torques.rows:
            return z, 0.0
        free = self._free @ z
        moved = free
        values = np.zeros((len(self.torques.rows), TERMS))
        # At a large angle, the rounding of the angle itself limits the accuracy of the torques.
        allowed = self.torques.scale * max(1.0, _ROUNDING / _SETTLED * self.torques.fineness * abs(state[ANGLE]))
        change = np.inf
        while change > _SETTLED * allowed:
            before = change
            angle, speed, twist = moved
            torques = self.torques.at(angle, speed, angle - twist, direction)
            change = float(np.abs(torques[:, :TERMS] - values).max())
            # Slow convergence means that the leg is too long.
            if change > _CONTRACTION * before:
                return z, np.inf
            values = torques[:, :TERMS]
            moved = free + self._forced @ values.ravel()
        coefficients = values @ _FIT.T
        off = float(np.abs(coefficients @ _CHECK.T - torques[:, TERMS:]).max())
        return np.concatenate([z, coefficients.ravel()]), off / (TOLERANCE * allowed)

    def first(self, z: Matrix, watches: Sequence[LegWatch]) -> tuple[float, LegWatch] | None:
        """Return (time [ns], watch) of the first form that becomes negative; None when none does on this leg.

        `z` is the state of `start`.
        """
        values, rates = self._watched @ z
        found: tuple[float, LegWatch] | None = None
        for watch in watches:
            level = watch.sign * values[watch.row] + watch.offset
            rate = watch.sign * rates[watch.row]
            # Between two nodes: negative at the second one, or a minimum by the signs of the rate.
            suspicious = (level[1:] < 0.0) | ((rate[:-1] < 0.0) & (rate[1:] > 0.0))
            if suspicious.any():
                found = self._earlier(z, watch, np.flatnonzero(suspicious), found)
        return found

    def _earlier(
        self, z: Matrix, watch: LegWatch, nodes: NDArray[np.intp], found: tuple[float, LegWatch] | None
    ) -> tuple[float, LegWatch] | None:
        """Return the time at which this form becomes negative after one of these nodes, if it is before `found`."""
        form = watch.sign * self._rows[watch.row]
        for node in nodes:
            begin_ns, end_ns = self._node_ns[node], self._node_ns[node + 1]
            if found is not None and begin_ns >= found[0]:
                break
            after_ns = self.flow.first_negative(self._to_node[node] @ z, end_ns - begin_ns, form, watch.offset)
            if after_ns is not None:
                return (begin_ns + after_ns, watch) if found is None or begin_ns + after_ns < found[0] else found
        return found


_LONGEST_NS = 1 << 22
_HALVINGS = 18
"""Halvings of the shortest leg, 16 ns, which is used regardless of its error."""
_UNBOUNDED_NS = 1 << 40
"""Length of a leg without an end."""
_PHASE = 6.0
"""Largest phase of the fastest oscillation on one leg [rad]."""
_MAX_EVENTS = 100
"""Number of successive events within `_LONGEST_NS` after which one leg is followed without a search for events."""
# A shaft at exactly its limit must not switch between sticking and slipping by rounding.
_BREAKAWAY = 1.0 + 1e-12
_SPEED, _PULL, _TWIST, _SPRING = range(4)
"""Indices of the watched forms: ω, the pull on a shaft at rest, ψ, and k·ψ + d·(ω − ω_L)."""


class LoadedPlant(Body):
    """A shaft with a load, with or without a hand; it moves when `advance` is called."""

    def __init__(
        self, load: Load, grip: Grip | None, *, position: float = 0.0, velocity: float = 0.0, t_ns: int = 0
    ) -> None:
        # The load moves with the motor at first.
        behind = 0.0 if load.mechanics.coupling is None else velocity
        state = (position, velocity, 0.0, 0.0, velocity if grip else 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, behind)
        self._load = load
        self._torques = Torques(load)
        self._legs: dict[tuple[int, bool, int, int], Leg] = {}
        super().__init__(t_ns, state, ORDER + TERMS * len(self._torques.rows))
        self._flank = 0 if load.half_play else 1
        self._parting = 0
        """Flank of an open coupling that still overlaps, because it parts faster than its spring follows; otherwise
        0."""
        self._direction = 1
        self._halvings = 0
        self._event: LegWatch | None = None
        self._events: list[float] = []
        self._hold(grip)

    def prepare(self) -> None:
        """Do nothing: the required legs are not known in advance."""

    def _hold(self, grip: Grip | None) -> None:
        self._grip = grip
        self._pull = {flank: self._load.pull(grip, flank) for flank in (-1, 0, 1)}
        self._fewest = self._fewest_halvings()
        speed = self.state[SPEED]
        if not self._load.breakaway:
            self._enter(1)
        elif speed == 0.0:
            self._from_rest()
        else:
            self._enter(1 if speed > 0.0 else -1)
        self._begin_leg(self.t_ns, 0.0)

    def _continue(self, state: State) -> None:
        self.state = state
        self._begin_leg(self.t_ns, 0.0)

    def _move(self, t_ns: int) -> None:
        if t_ns == self.t_ns:
            return
        while (span_ns := t_ns - self._begin_ns - self._offset_ns) >= self._span_ns:
            self._end_leg()
        self.state = self._state(self._leg.flow.advance(self._z, span_ns))
        self.t_ns = t_ns

    # Legs.

    def _begin_leg(self, begin_ns: int, offset_ns: float) -> None:
        """Begin a leg from `state` at this time."""
        self._begin_ns, self._offset_ns = begin_ns, offset_ns
        self._leg, self._z = self._long_enough()
        found = self._leg.first(self._z, self._watches()) if self._may_change(begin_ns + offset_ns) else None
        self._span_ns, self._event = found if found is not None else (self._leg.length_ns, None)
        self.recorder.segment(begin_ns, offset_ns, self._leg.flow, tuple(self._z.tolist()))

    def _end_leg(self) -> None:
        """End the leg at its length or at its event, and begin the next one."""
        z = self._leg.flow.advance(self._z, self._span_ns)
        end_ns = self._offset_ns + self._span_ns
        # Whole and fractional nanoseconds are kept apart, because their sum would lose digits.
        whole_ns = int(end_ns)
        self.state = self._state(z)
        if self._event is not None:
            self._events.append(self._begin_ns + end_ns)
            self._change(self._event)
        self._begin_leg(self._begin_ns + whole_ns, end_ns - whole_ns)

    def _long_enough(self) -> tuple[Leg, Matrix]:
        """Return the longest leg on which the torques are accurate, at most twice the last one, and its start."""
        halvings = max(self._halvings, self._fewest)
        while True:
            leg = self._leg_of(halvings)
            z, off = leg.start(self.state, self._direction)
            if off <= 1.0 or halvings >= _HALVINGS:
                break
            halvings += 1
        # Doubling the length multiplies the error by about 2^TERMS, so try it only when that leaves it permitted.
        self._halvings = halvings - 1 if off < 0.5**TERMS else halvings
        return leg, z

    def _leg_of(self, halvings: int) -> Leg:
        load, flank, sticking = self._load, self._flank, self._direction == 0
        key = (self._holder(self._grip), sticking, flank, halvings)
        if (leg := self._legs.get(key)) is None:
            rows = np.zeros((4, ORDER))
            rows[_SPEED, SPEED] = rows[_TWIST, TWIST] = 1.0
            rows[_PULL] = self._pull[flank]
            rows[_SPRING] = (load.coupling_torque(1) + load.coupling_torque(-1)) / 2
            system = load.system(self._grip, sticking=sticking, flank=flank)
            bounded = load.breakaway or load.half_play or self._torques.rows
            length_ns = _LONGEST_NS >> halvings if bounded else _UNBOUNDED_NS
            leg = self._legs[key] = Leg(system, self._torques, rows, _PULL, float(length_ns))
        return leg

    def _fewest_halvings(self) -> int:
        """Return the number of halvings for which the fastest oscillation turns by at most `_PHASE` on a leg."""
        systems = [self._load.system(self._grip, sticking=s, flank=f) for s in (False, True) for f in (0, 1)]
        fastest = float(np.abs(np.linalg.eigvals(np.array(systems)).imag).max())
        turns = fastest * _LONGEST_NS * 1e-9 / _PHASE
        return max(0, int(np.ceil(np.log2(turns)))) if turns > 0 else 0

    # Events.

    def _watches(self) -> list[LegWatch]:
        """Return the watches that end a leg under the present law."""
        watches = []
        if self._load.breakaway:
            if self._direction:
                watches.append(LegWatch(_SPEED, self._direction, 0.0))
            else:
                threshold = self._load.breakaway * _BREAKAWAY
                watches += [LegWatch(_PULL, -1.0, threshold), LegWatch(_PULL, 1.0, threshold)]
        coupling, half = self._load.mechanics.coupling, self._load.half_play
        if coupling is not None and half:
            preload = coupling.stiffness * half
            if self._flank:
                return [*watches, LegWatch(_SPRING, self._flank, -preload)]
            for flank in (1, -1):
                if self._parting == flank:
                    # Overlapping flanks touch again when the spring pushes, or have parted when the overlap is gone.
                    watches += [LegWatch(_SPRING, -flank, preload), LegWatch(_TWIST, flank, -half)]
                else:
                    watches.append(LegWatch(_TWIST, -flank, half))
        return watches

    def _may_change(self, now_ns: float) -> bool:
        """Return whether to search for events: False after too many events in a short time."""
        while self._events and self._events[0] < now_ns - _LONGEST_NS:
            self._events.pop(0)
        return len(self._events) < _MAX_EVENTS

    def _change(self, event: LegWatch) -> None:
        """Change the law of friction or of the coupling after an event."""
        if event.row in (_SPEED, _PULL):
            self._from_rest()
            return
        # The contact has ended; the flanks may still overlap then, if the damper pulled.
        if self._flank:
            overlap = self._flank * self.state[TWIST] - self._load.half_play
            self._parting = self._flank if overlap > 0.0 else 0
            self._flank = 0
        elif self._parting:
            self._flank = self._parting if event.row == _SPRING else 0
            self._parting = 0
        else:
            self._flank = -1 if event.sign > 0 else 1
        if not self._direction:
            self._from_rest()

    def _from_rest(self) -> None:
        """Decide, at standstill, whether the shaft sticks or slips in the direction of the pull."""
        self.state = (self.state[ANGLE], 0.0, *self.state[TORQUE:])
        pull = float(self._pull[self._flank] @ self.state)
        if self._torques.rows and self._torques.rows[0] == SPEED:
            angle, twist = np.array([self.state[ANGLE]]), self.state[TWIST]
            pull += float(self._torques.at(angle, np.zeros(1), angle - twist, 0)[0, 0])
        self._enter(0 if abs(pull) <= self._load.breakaway else 1 if pull > 0.0 else -1)

    def _enter(self, direction: int) -> None:
        """Slip in a direction, or stick (0)."""
        self._direction = direction
        self.state = (*self.state[:FRICTION], -self._load.shaft.coulomb * direction, *self.state[FRICTION + 1 :])

    def _state(self, z: Matrix) -> State:
        return tuple(z[:ORDER].tolist())
