"""A shaft with more than a rigid load: coupling, backlash, weight, cogging, Stribeck friction.

Theory: the motion is a chain of legs. The law does not change on a leg: the shaft slips in one direction or sticks, the
coupling is on one flank or open. The linear part is followed exactly, the nonlinear torques within `leg.TOLERANCE`; the
length of a leg is halved until they are. A leg ends at its length, or earlier where a reversal, a breakaway, or a flank
that meets or parts is found on it; a new target or force of the hand cuts it short. Reading the shaft does not change
its motion, because each reading follows the leg from its start.

A reversal could be missed only in an oscillation faster than the ten nodes of a leg can show, and legs are short enough
for all frequencies of the linear part. All quantities are at the motor shaft, SI; `t_ns` is the plant's own time.
"""

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.leg import TERMS, Leg, LegWatch
from haptic_fieldbus.sim.mechanics.load import ORDER, TWIST, Load, Torques
from haptic_fieldbus.sim.mechanics.motion import ANGLE, FRICTION, SPEED, TORQUE, State

_LONGEST_NS = 1 << 22
_HALVINGS = 18
"""Halvings of the shortest leg, 16 ns, which is used whatever its error."""
_UNBOUNDED_NS = 1 << 40
"""Length of a leg that nothing ends."""
_PHASE = 6.0
"""Largest phase of the fastest oscillation on one leg [rad]."""
_MAX_EVENTS = 100
"""Events in succession within `_LONGEST_NS` after which one leg is followed without looking for more."""
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
        """Flank of an open coupling that still overlaps, because it parts faster than its spring follows; else 0."""
        self._direction = 1
        self._halvings = 0
        self._event: LegWatch | None = None
        self._events: list[float] = []
        self._hold(grip)

    def prepare(self) -> None:
        """Do nothing: which legs are needed shows only on the way."""

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
        sticking = self._direction == 0
        key = (self._holder(self._grip), sticking, self._flank, halvings)
        leg = self._legs.get(key)
        if leg is None:
            load, flank = self._load, self._flank
            rows = np.zeros((4, ORDER))
            rows[_SPEED, SPEED] = rows[_TWIST, TWIST] = 1.0
            rows[_PULL] = self._pull[flank]
            rows[_SPRING] = (load.coupling_torque(1) + load.coupling_torque(-1)) / 2
            system = load.system(self._grip, sticking=sticking, flank=flank)
            length_ns = _LONGEST_NS >> halvings if self._bounded else _UNBOUNDED_NS
            leg = self._legs[key] = Leg(system, self._torques, rows, _PULL, float(length_ns))
        return leg

    @property
    def _bounded(self) -> bool:
        return bool(self._load.breakaway or self._load.half_play or self._torques.rows)

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
        """Return whether events are looked for: not after too many of them in too short a time."""
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
