"""One step under constant force, friction included, against scipy with an event at standstill."""

import numpy as np
import pytest
import scipy.integrate

from haptic_fieldbus.numerics.batch import SampledMass, slide
from tests.cases import every

SPAN = 1e-3


def by_scipy(mass: float, damping: float, coulomb: float, x: float, v: float, force: float) -> tuple[float, float]:
    """Slip, stop at the event, stick or slip on."""

    def standstill(t: float, y: np.ndarray) -> float:
        return float(y[1])

    standstill.terminal = True  # type: ignore[attr-defined]
    left, state = SPAN, np.array([x, v])
    for _ in range(2):
        direction = np.sign(state[1]) if abs(state[1]) > 1e-15 else np.sign(force) * (abs(force) > coulomb)
        if direction == 0.0:
            return float(state[0]), 0.0
        state[1] += 1e-300 * direction
        found = scipy.integrate.solve_ivp(
            lambda t, y, s=direction: [y[1], (force - s * coulomb - damping * y[1]) / mass],
            (0.0, left), state, rtol=1e-12, atol=1e-18, events=standstill if state[1] * direction > 1e-15 else None,
        )  # fmt: skip
        state, left = found.y[:, -1], left - found.t[-1]
        if left <= 0.0:
            break
        state[1] = 0.0
    return float(state[0]), float(state[1])


@every("mass", [0.01, 0.6])
@every("damping", [0.0, 1e-6, 1.5, 40.0])
@every(
    ("velocity", "force"),
    [
        (0.1, 3.0),
        (0.1, -3.0),
        (1e-4, -3.0),
        (1e-4, -0.3),
        (1e-4, 0.3),
        (0.0, 3.0),
        (0.0, -3.0),
        (0.0, 0.3),
        (-1e-4, 3.0),
    ],
)
def test_a_step_is_what_scipy_finds(mass: float, damping: float, velocity: float, force: float) -> None:
    coulomb, x = 0.5, 0.02
    device = SampledMass(np.array([mass]), np.array([damping]), np.array([coulomb]))
    found = slide(device, np.array([x]), np.array([velocity]), np.array([force]), np.array([SPAN]))
    expected = by_scipy(mass, damping, coulomb, x, velocity, force)
    assert float(found[0][0]) - x == pytest.approx(expected[0] - x, rel=1e-6, abs=1e-13)
    assert float(found[1][0]) == pytest.approx(expected[1], rel=1e-6, abs=1e-11)


@every("velocity", [0.3, -2e-4, 0.0])
@every("damping", [0.0, 1e-9, 1e-3, 0.0119, 0.0121, 5.0])
def test_two_halves_are_one_step_whatever_formula_is_taken(velocity: float, damping: float) -> None:
    """Series and closed form meet."""
    device = SampledMass(np.array([0.6]), np.array([damping]), np.array([0.4]))
    force, x, v = np.array([-1.0]), np.array([0.0]), np.array([velocity])
    whole = slide(device, x, v, force, np.array([1.0]))
    half = slide(device, *slide(device, x, v, force, np.array([0.5])), force, np.array([0.5]))
    np.testing.assert_allclose(half, whole, rtol=1e-12, atol=1e-15)
