"""One step of a virtual mass by every method beside forward Euler written by hand, of more states, and by any rates."""

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
from rows import Figure, Pair, Row, cost, show

from haptic_fieldbus.numerics.integrators import METHODS, bind
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.study.explicit import EXPLICIT, bind_rates

PERIOD = 1e-3
STIFFNESS, MASS = 600.0, 0.5
PROMISED = {"exact-foh": 2.5}


def by_hand() -> Callable[[float], float]:
    """The textbook's pseudocode: 600 N/m, 0.5 kg."""
    p = q = 0.0

    def step(x: float) -> float:
        nonlocal p, q
        force = STIFFNESS * (p - x)
        p, q = p + PERIOD * q, q + PERIOD * (STIFFNESS / MASS) * (x - p)
        return force

    return step


def rates(time: float, states: tuple[float, ...], x: float) -> tuple[float, float]:
    return states[1], STIFFNESS / MASS * (x - states[0])


def beside_by_hand(name: str, step: Callable[[float], object], allowed: float | None = None) -> Row:
    reference = by_hand()
    step(0.0)
    return Row(name, cost(lambda: step(0.001), 2000), cost(lambda: reference(0.001), 2000), allowed)


def linear(method: str) -> Row:
    step = bind(SprungMass("handle", STIFFNESS, MASS).dynamics, PERIOD, method)
    return beside_by_hand(method, step, PROMISED.get(method))


def relaxing(branches: int) -> StateSpace:
    """A tissue that relaxes in so many times."""
    rates = np.geomspace(1.0, 1e3, branches)
    inputs = np.stack([rates, np.zeros(branches)], axis=1)
    return StateSpace(np.diag(-rates), inputs, np.full((1, branches), 80.0), np.array([[-900.0, 0.0]]))


def more_states(method: str = "exact-foh") -> list[Row]:
    """The step does not depend on the method, only on how many states there are and whether velocity drives them."""
    mass = SprungMass("handle", STIFFNESS, MASS).dynamics
    damped = StateSpace(
        mass.a - np.diag([0.0, 4.0]), mass.b + np.array([[0.0, 0.0], [0.0, 4.0]]), mass.c, mass.d - np.array([[0, 2.0]])
    )
    spaces = {
        "no state": gain([[-STIFFNESS, -2.0]]),
        "one state": relaxing(1),
        "two states, by velocity": damped,
        "three states": parallel([mass, relaxing(1)]),
        "four states, by velocity": parallel([mass, damped]),
        "six lags": relaxing(6),
        "six states, by velocity": parallel([mass, damped, damped]),
    }
    return [_row(name, bind(space, PERIOD, method), space.uses_velocity) for name, space in spaces.items()]


def _row(name: str, step: Callable[..., float], by_velocity: bool) -> Row:
    return beside_by_hand(name, (lambda position: step(position, 0.1)) if by_velocity else step)


def nonlinear(method: str) -> Row:
    return beside_by_hand(f"{method}, any rates", bind_rates(rates, (0.0, 0.0), PERIOD, method, (0,)))


def pair(_: ExitStack) -> Pair:
    """One step of the method that is used unless another one is named."""

    def measure() -> tuple[float, float]:
        row = linear("exact-foh")
        return row.ours, row.reference

    return measure


FIGURES = (Figure("step of a virtual mass, exact-foh", "forward Euler by hand", PROMISED["exact-foh"], pair),)


if __name__ == "__main__":
    show([*map(linear, METHODS), *more_states(), *map(nonlinear, EXPLICIT)])
