"""Steps that are written out for few states beside the same products walked row by row, to the last bit."""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest

from haptic_fieldbus.numerics.integrators import METHODS, bind, discretise, rest
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from tests.numerics.systems import DAMPED, DRIVEN, GROUNDED, Array, sprung_mass


def tissue(branches: int, *, by_velocity: bool = False) -> StateSpace:
    """Springs and dampers in series beside a spring, their rates over three decades."""
    rates = np.geomspace(1.0, 1500.0, branches)
    inputs = np.stack([np.zeros(branches), np.ones(branches)] if by_velocity else [rates, np.zeros(branches)], axis=1)
    return StateSpace(np.diag(-rates), inputs, np.full((1, branches), 80.0), np.array([[-900.0, 0.0]]))


SPACES = {
    "no state": gain([[-300.0, -2.0]]),
    "one": GROUNDED,
    "one, by velocity": tissue(1, by_velocity=True),
    "two": DAMPED,
    "two, free": DRIVEN,
    "three": parallel([sprung_mass(0.05), GROUNDED]),
    "three, by velocity": parallel([GROUNDED, DAMPED]),
    "four": parallel([sprung_mass(0.05), sprung_mass(0.4)]),
    "four, by velocity": parallel([DAMPED, DRIVEN]),
    "seven": parallel([sprung_mass(0.05), DAMPED, DRIVEN, GROUNDED]),
    "six lags": tissue(6),
    "nine lags, by velocity": tissue(9, by_velocity=True),
}


def walked(space: StateSpace, method: str, period: float, motion: Array) -> Iterator[float]:
    """y = base + C z + D u, z⁺ = z + (E z + G u), every sum from left to right."""
    system = discretise(space, period, method).increments
    state: list[float] = [0.0] * space.order
    origin = float(motion[0, 0])
    for x, v in motion.tolist():
        known = [*state, x - origin, v if space.uses_velocity else 0.0]
        yield rest(space)[1] * origin + total(np.hstack([system.c, system.d])[0], known)
        rows = np.hstack([system.a, system.b])
        state = [z + total(row, known) for z, row in zip(state, rows, strict=True)]


def total(row: Array, known: list[float]) -> float:
    *_, last = itertools.accumulate(map(float.__mul__, row.tolist(), known))
    return last


@pytest.mark.thorough("every method on 12 systems", quick=18)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", SPACES)
def test_a_step_is_its_matrices_to_the_last_bit(name: str, method: str) -> None:
    space = SPACES[name]
    times = np.arange(400) * 1e-3
    motion = np.stack([0.3 + 0.01 * np.sin(30.0 * times), 0.3 * np.cos(30.0 * times)], axis=1)
    step = bind(space, 1e-3, method)
    found = [step(x, v) if space.uses_velocity else step(x) for x, v in motion.tolist()]
    assert found == list(walked(space, method, 1e-3, motion))
