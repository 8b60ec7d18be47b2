"""The loaded shaft once more, from Newton's law and scipy's solver with events: slow, general, and shares nothing."""

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics.loaded_plant import Load

Function = Callable[[float, Matrix], float]


class EventSolver:
    """States: motor angle and speed, motor torque, load angle and speed, hand angle and speed."""

    def __init__(self, load: Load, grip: Grip | None, target: float, position: float, velocity: float) -> None:
        self.load, self.grip, self.target = load, grip, target
        self.y = np.array([position, velocity, 0.0, position, velocity, position, velocity])
        self.direction = 1 if velocity > 0 else -1 if velocity < 0 else 0
        self.flank = 0 if load.half_play else 1
        self.changes = 0
        if velocity == 0.0:
            self._from_rest()

    def run(self, times: Matrix, max_step: float) -> Matrix:
        """The states at these times [s], the first one now; (7, n)."""
        found = np.empty((7, len(times)))
        t = times[0]
        while True:
            events = self._events()
            solution = solve_ivp(
                self._rates, (t, times[-1]), self.y, method="DOP853", rtol=1e-12, atol=1e-14, max_step=max_step,
                events=[function for function, _ in events], dense_output=True,
            )  # fmt: skip
            end = solution.t[-1]
            here = (times >= t) & (times <= end)
            if here.any():
                found[:, here] = solution.sol(times[here])
            t, self.y = end, solution.y[:, -1]
            if solution.status != 1:
                return found
            self.changes += 1
            next(change for hits, (_, change) in zip(solution.t_events, events, strict=True) if len(hits))()

    def _torques(self, y: Matrix) -> tuple[float, float]:
        """(on the motor without its friction, on the load), as one sum each."""
        angle, speed, torque, load_angle, load_speed, hand_angle, hand_speed = y.tolist()
        parts = self.load.mechanics
        motor, load = torque, 0.0
        if parts.cogging is not None:
            motor -= parts.cogging.torque * math.sin(parts.cogging.periods_per_revolution * angle)
        if parts.coupling is None:
            load_angle, load_speed = angle, speed
        else:
            transmitted = self._pressing(self.flank)(0.0, y) * self.flank
            motor, load = motor - transmitted, transmitted
        if parts.gravity is not None and self.load.lever is None:
            load += parts.gravity.torque
        elif parts.gravity is not None and self.load.lever is not None:
            lever = self.load.lever
            load -= math.copysign(parts.gravity.torque, lever) * math.sin(lever * load_angle - parts.gravity.hanging_at)
        if self.grip is not None:
            load += self.grip.stiffness * (hand_angle - load_angle) + self.grip.damping * (hand_speed - load_speed)
        return (motor + load, 0.0) if parts.coupling is None else (motor, load)

    def _rates(self, _t: float, y: Matrix) -> list[float]:
        parts, shaft = self.load.mechanics, self.load.shaft
        motor, load = self._torques(y)
        speed, load_speed = y[1], y[4]
        friction = shaft.coulomb
        if parts.stribeck is not None:
            friction += parts.stribeck.torque * math.exp(-((speed / parts.stribeck.velocity) ** 2))
        load_inertia = parts.coupling.load_inertia if parts.coupling is not None else 0.0
        acceleration = (motor - shaft.damping * speed - self.direction * friction) / (shaft.inertia - load_inertia)
        stands = self.direction == 0
        hand = 0.0
        if self.grip is not None:
            held, held_speed = (y[3], y[4]) if parts.coupling is not None else (y[0], y[1])
            pulled = self.grip.stiffness * (y[5] - held) + self.grip.damping * (y[6] - held_speed)
            hand = (self.grip.pieces[0].force - pulled) / self.grip.inertia
        return [
            0.0 if stands else speed,
            0.0 if stands else acceleration,
            (self.target - y[2]) / shaft.lag,
            load_speed,
            load / load_inertia if load_inertia else 0.0,
            y[6],
            hand,
        ]

    def _pressing(self, flank: int) -> Function:
        """Force of the spring on a flank when it touches, positive towards it."""
        coupling, half = self.load.mechanics.coupling, self.load.half_play

        def pressing(_t: float, y: Matrix) -> float:
            if coupling is None or not flank:
                return 0.0
            overlap = flank * (y[0] - y[3]) - half
            return float(coupling.stiffness * overlap + coupling.damping * flank * (y[1] - y[4]))

        return pressing

    def _events(self) -> list[tuple[Function, Callable[[], None]]]:
        """(function that falls through zero, what happens then)"""
        events: list[tuple[Function, Callable[[], None]]] = []
        if self.load.breakaway and self.direction:
            direction = self.direction
            events.append((lambda _t, y: float(direction * y[1]), self._from_rest))
        elif self.load.breakaway:
            events.append((lambda _t, y: self.load.breakaway - abs(self._torques(y)[0]), self._from_rest))
        if self.load.half_play and self.flank:
            events.append((self._pressing(self.flank), lambda: self._touch(0)))
        elif self.load.half_play:
            events += [(self._apart(flank), lambda flank=flank: self._touch(flank)) for flank in (1, -1)]  # type: ignore[misc]
        for function, _ in events:
            function.terminal, function.direction = True, -1  # type: ignore[attr-defined]
        return events

    def _apart(self, flank: int) -> Function:
        pressing, half = self._pressing(flank), self.load.half_play
        return lambda t, y: -min(flank * (y[0] - y[3]) - half, pressing(t, y))

    def _touch(self, flank: int) -> None:
        self.flank = flank
        if self.direction == 0:
            self._from_rest()

    def _from_rest(self) -> None:
        """The shaft stands: does it stick? At a breakaway the torque is that of breaking away, but for rounding."""
        self.y[1] = 0.0
        motor = self._torques(self.y)[0]
        holds = abs(motor) < self.load.breakaway * (1 - 1e-9)
        self.direction = 0 if holds else 1 if motor > 0 else -1
