"""One step of a virtual mass by every method beside forward Euler written by hand, and by nonlinear rates."""

from collections.abc import Callable

from rows import Row, cost, show

from haptic_fieldbus.numerics.integrators import METHODS, bind
from haptic_fieldbus.numerics.integrators.explicit import EXPLICIT, bind_rates
from haptic_fieldbus.scenes.sprung_mass import SprungMass

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


def nonlinear(method: str) -> Row:
    return beside_by_hand(f"{method}, any rates", bind_rates(rates, (0.0, 0.0), PERIOD, method, (0,)))


if __name__ == "__main__":
    show([*map(linear, METHODS), *map(nonlinear, EXPLICIT)])
