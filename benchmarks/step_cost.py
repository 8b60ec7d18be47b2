"""One exact step of a virtual mass beside forward Euler written by hand."""

from collections.abc import Callable

from rows import Row, cost, show

from haptic_fieldbus.numerics.integrators import METHODS, bind
from haptic_fieldbus.scenes.sprung_mass import SprungMass

PERIOD = 1e-3


def by_hand() -> Callable[[float], float]:
    """The textbook's pseudocode: 600 N/m, 0.5 kg."""
    p = q = 0.0

    def step(x: float) -> float:
        nonlocal p, q
        force = 600.0 * (p - x)
        p, q = p + PERIOD * q, q + PERIOD * (600.0 / 0.5) * (x - p)
        return force

    return step


def row(method: str) -> Row:
    step, reference = bind(SprungMass("handle", 600.0, 0.5).dynamics, PERIOD, method), by_hand()
    step(0.0)
    allowed = 2.5 if method == "exact-foh" else None
    return Row(method, cost(lambda: step(0.001), 2000), cost(lambda: reference(0.001), 2000), allowed)


if __name__ == "__main__":
    show([row(method) for method in METHODS])
