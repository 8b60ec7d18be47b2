"""Motor shaft, friction and hand, followed exactly between events; `loaded_plant` has the further parts of a rig.

Theory: with a constant target the motion is linear while the shaft *slips* in one direction s (friction −fc·s) and
while it *sticks*. The pull is the torque on the shaft at rest, friction apart. The shaft sticks when it comes to rest
with |pull| ≤ fc. It slips again when the pull exceeds fc by one part in 1e12, so that rounding cannot make it switch
back and forth. The instants of both are found inside a step: a change of sign always, a dip if the tangent at the start
of the step allows one. With Coulomb friction a step lasts at most 1 ms, so only an oscillation above some 500 Hz could
hide a reversal.

All quantities are at the motor shaft, SI; `t_ns` is the plant's own time.
"""

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.motion import (
    ANGLE,
    FRICTION,
    HAND_SPEED,
    ORDER,
    SPEED,
    STRETCH,
    TORQUE,
    Motion,
    Shaft,
    State,
)

MAX_STEP_NS = 1_000_000
_MAX_EVENTS = 100
"""Events in one step after which the mode is kept to the end of the step."""
_BREAKAWAY = 1.0 + 1e-12


class Plant(Body):
    """A rigid shaft, with or without a hand; it moves when `advance` is called."""

    def __init__(
        self, shaft: Shaft, grip: Grip | None, *, position: float = 0.0, velocity: float = 0.0, t_ns: int = 0
    ) -> None:
        super().__init__(t_ns, (position, velocity, 0.0, 0.0, velocity if grip else 0.0, 0.0, 0.0, 0.0, 0.0), ORDER)
        self._shaft = shaft
        self._coulomb, self._inertia = shaft.coulomb, shaft.inertia
        self._threshold = shaft.coulomb * _BREAKAWAY
        self._longest_ns = MAX_STEP_NS if shaft.coulomb > 0 else NEVER_NS
        self._motions: dict[int, tuple[Motion, Motion]] = {}
        """Slipping and sticking, by the holder of the handle."""
        self._hold(grip)

    def _hold(self, grip: Grip | None) -> None:
        self._grip = grip
        self._stiffness, self._damping = (grip.stiffness, grip.damping) if grip is not None else (0.0, 0.0)
        self._drag = self._shaft.damping + self._damping
        self._slipping, self._sticking = self._motions_of(grip)
        speed = self.state[SPEED]
        if speed == 0.0:
            self._from_rest()
        else:
            self._enter(1 if speed > 0.0 else -1)
        self._record(0.0)

    def prepare(self) -> None:
        """Build the motions with each hand and without one, and prepare their steps."""
        for grip in (self._grip, self._hand, None):
            for motion in self._motions_of(grip):
                motion.prepare(MAX_STEP_NS)

    def _motions_of(self, grip: Grip | None) -> tuple[Motion, Motion]:
        """Return the motions that slip and stick; they are built once."""
        holder = self._holder(grip)
        if holder not in self._motions:
            slipping, sticking = (Motion(self._shaft, grip, sticking=sticks) for sticks in (False, True))
            self._motions[holder] = slipping, sticking
        return self._motions[holder]

    def _continue(self, state: State) -> None:
        self.state = state
        self._record(0.0)

    def _move(self, t_ns: int) -> None:
        longest_ns = self._longest_ns
        while (left_ns := t_ns - self.t_ns) > 0:
            before, span_ns = self.state, left_ns if left_ns < longest_ns else longest_ns
            after = self._motion.step(before, span_ns)
            # Without Coulomb friction the mode never changes; with it, most steps end at this cheap test.
            if self._coulomb and self._may_switch(before, after, span_ns * 1e-9):
                after = self._through_events(before, after, span_ns)
            self.state = after
            self.t_ns += span_ns
            # A shaft that sticks, where a step changes nothing, rests until something acts on it.
            if left_ns > longest_ns and not self._direction and after == before:
                self.t_ns = t_ns

    def _pull(self, state: State) -> float:
        """Return the torque on the shaft at rest, friction apart [N·m]."""
        return state[TORQUE] + self._stiffness * state[STRETCH] + self._damping * state[HAND_SPEED]

    def _may_switch(self, before: State, after: State, span: float) -> bool:
        """Return whether an event inside the step is possible."""
        _, speed, torque, stretch, hand_speed, force, _, target, friction = before
        pull, direction = torque + self._stiffness * stretch + self._damping * hand_speed, self._direction
        if direction:
            acceleration = (pull + friction - self._drag * speed) / self._inertia
            return direction * after[SPEED] < 0.0 or direction * (speed + acceleration * span) < 0.0
        # A bound on the rate of the pull, from the rates of the torque loop and of the hand's spring and damper.
        rate = abs(target - torque) / self._shaft.lag
        if self._grip is not None:
            press = force - self._stiffness * stretch - self._damping * hand_speed
            rate += abs(self._stiffness * hand_speed + self._damping * press / self._grip.inertia)
        return abs(self._pull(after)) > self._threshold or abs(pull) + rate * span > self._threshold

    def _through_events(self, before: State, after: State, span_ns: int) -> State:
        """Return the state at the end of the step, through the changes of mode inside it."""
        z = np.array(before)
        left_ns = float(span_ns)
        for count in range(_MAX_EVENTS):
            if (event_ns := self._first_event(z, left_ns)) is None:
                # No event after all: keep the state of the cached step.
                if count == 0:
                    return after
                break
            left_ns -= event_ns
            self.state = _state(self._motion.flow.advance(z, event_ns))
            self._from_rest()
            self._record(span_ns - left_ns)
            z = np.array(self.state)
        return _state(self._motion.flow.advance(z, left_ns))

    def _first_event(self, z: Matrix, span_ns: float) -> float | None:
        form = np.zeros(ORDER)
        flow = self._motion.flow
        if self._direction:
            form[SPEED] = self._direction
            return flow.first_negative(z, span_ns, form, 0.0)
        form[TORQUE], form[STRETCH], form[HAND_SPEED] = 1.0, self._stiffness, self._damping
        found = [flow.first_negative(z, span_ns, sign * form, self._threshold) for sign in (1.0, -1.0)]
        return min((event_ns for event_ns in found if event_ns is not None), default=None)

    def _from_rest(self) -> None:
        """Decide, at standstill, whether the shaft sticks or slips in the direction of the pull."""
        self.state = (self.state[ANGLE], 0.0, *self.state[TORQUE:])
        pull = self._pull(self.state)
        self._enter(0 if abs(pull) <= self._coulomb else 1 if pull > 0.0 else -1)

    def _enter(self, direction: int) -> None:
        """Slip in a direction, or stick (0)."""
        self._direction = direction
        # Without Coulomb friction a shaft at rest is not held: it slips with no friction.
        self._motion = self._slipping if direction or not self._coulomb else self._sticking
        self.state = (*self.state[:FRICTION], -self._coulomb * direction)

    def _record(self, offset_ns: float) -> None:
        self.recorder.segment(self.t_ns, offset_ns, self._motion.flow, self.state)


def _state(z: Matrix) -> State:
    return tuple(z.tolist())
