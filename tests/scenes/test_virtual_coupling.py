"""The virtual coupling: what the hand feels of a tool and its wall."""

import math

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from haptic_fieldbus.scenes.virtual_coupling import VirtualCoupling
from haptic_fieldbus.signals import Signal

PERIOD = 1e-3
TOOL = VirtualCoupling("handle", stiffness=800.0, damping=2.0, mass=0.05, wall_stiffness=2e3, wall=0.01)


def test_pressed_on_for_long_coupling_and_wall_are_felt_in_series() -> None:
    """K·K_w/(K + K_w): however stiff the wall, no more than K."""
    for wall, expected in ((2e3, 800.0 * 2e3 / 2.8e3), (1e9, 800.0 * 1e9 / (1e9 + 800.0))):
        force = VirtualCoupling("handle", 800.0, 0.05, 2.0, wall_stiffness=wall).begin(PERIOD)
        found = [force(min(0.01, 1e-5 * n), 0.0) for n in range(5000)][-1]
        assert found == pytest.approx(-expected * 0.01, rel=1e-6)


@pytest.mark.parametrize("side", ["positive", "negative"])
def test_begun_inside_it_is_at_rest_there(side: str) -> None:
    """And does not kick: the same force at once and later."""
    coupling = TypeAdapter(VirtualCoupling).validate_python(
        {"axis": "handle", "stiffness": 800.0, "mass": 0.05, "wall_stiffness": 2e3, "side": side}
    )
    inside = 0.01 if side == "positive" else -0.01
    force = coupling.begin(PERIOD)
    first = force(inside)
    assert first == pytest.approx(-math.copysign(800.0 * 2e3 / 2.8e3 * 0.01, inside))
    assert [force(inside) for _ in range(100)] == pytest.approx([first] * 100, rel=1e-9)


def test_without_a_wall_it_is_the_damped_sprung_mass() -> None:
    """The loop's own step of the linear element, for a handle that starts from rest."""
    alone = VirtualCoupling("handle", stiffness=300.0, damping=3.0, mass=0.4)
    force, known = alone.begin(PERIOD), bind(DampedSprungMass("handle", 300.0, 0.4, 3.0).dynamics, PERIOD)
    for n in range(500):
        x, v = 0.01 * (1.0 - math.cos(20.0 * n * PERIOD)), 0.2 * math.sin(20.0 * n * PERIOD)
        assert force(x, v) == pytest.approx(known(x, v), abs=1e-9)


def test_the_hand_feels_the_wall_as_the_differential_equation_says() -> None:
    """Dipping into the wall and out again, by scipy."""
    force, times = TOOL.begin(PERIOD), np.arange(401) * PERIOD

    def handle(t: float) -> tuple[float, float]:
        return 0.012 * (1.0 - math.cos(20.0 * t)), 0.24 * math.sin(20.0 * t)

    def rates(t: float, z: np.ndarray) -> list[float]:
        x, v = handle(t)
        push = 800.0 * (x - z[0]) + 2.0 * (v - z[1])
        return [z[1], (push - 2e3 * max(0.0, z[0] - 0.01)) / 0.05]

    exact = solve_ivp(rates, (0.0, 0.4), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-13, max_step=1e-4).y
    x, v = np.array([handle(t) for t in times]).T
    expected = 800.0 * (exact[0] - x) + 2.0 * (exact[1] - v)
    found = [force(*handle(t)) for t in times]
    assert expected.min() < -5.0
    np.testing.assert_allclose(found, expected, atol=5e-3 * np.abs(expected).max())


def test_a_handle_far_from_the_wall_feels_the_tool_only() -> None:
    far = VirtualCoupling("handle", stiffness=800.0, damping=2.0, mass=0.05, wall_stiffness=2e3, wall=1.0)
    none = VirtualCoupling("handle", stiffness=800.0, damping=2.0, mass=0.05)
    one, two = far.begin(PERIOD), none.begin(PERIOD)
    for n in range(300):
        values = 0.01 * (1.0 - math.cos(0.05 * n)), 0.5 * math.sin(0.05 * n)
        assert one(*values) == pytest.approx(two(*values), abs=1e-9)


def test_stability_is_judged_with_the_tool_on_the_wall() -> None:
    space = TOOL.linearised()
    turn = math.sqrt((800.0 + 2e3) / 0.05)
    assert np.abs(np.linalg.eigvals(space.a)).max() == pytest.approx(turn)


def test_the_law_on_the_wall_is_the_system_that_stability_judges() -> None:
    """Begun deep inside and moved a little: the discrete environment of `linearised`, step by step."""
    undamped = VirtualCoupling("handle", stiffness=800.0, mass=0.05, wall_stiffness=2e3)
    space = environment(undamped.linearised(), period=PERIOD, method="exact-foh", estimator=None)
    force, state, rng = undamped.begin(PERIOD), np.zeros(space.order), np.random.default_rng(5)
    first, moved = force(0.05), 0.0
    for _ in range(300):
        moved = 0.9 * moved + 1e-4 * rng.normal()
        expected = float((space.c @ state + space.d[:, 0] * moved)[0])
        state = space.a @ state + space.b[:, 0] * moved
        assert force(0.05 + moved) - first == pytest.approx(expected, abs=1e-10)


def test_with_its_damper_the_law_on_the_wall_is_that_system_too() -> None:
    """A sine about a place deep inside, once it has settled, beside the frequency response of `linearised`."""
    space, turn, period = TOOL.linearised(), 150.0, 2e-4
    answer = space.c @ np.linalg.solve(1j * turn * np.eye(2) - space.a, space.b) + space.d
    wave = np.exp(1j * turn * np.arange(20_000) * period)
    way, speed = 1e-3 * wave.imag, 1e-3 * turn * wave.real
    force = TOOL.begin(period)
    found = np.array([force(0.06 + x, v) for x, v in zip(way.tolist(), speed.tolist(), strict=True)])
    expected = 1e-3 * ((answer @ [1.0, 1j * turn])[0] * wave).imag
    late = slice(10_000, None)
    settled = found[late] - TOOL.begin(period)(0.06, 0.0)
    np.testing.assert_allclose(settled, expected[late], atol=1e-3 * np.abs(expected).max())


def test_it_needs_the_velocity_only_for_the_damper_of_its_coupling() -> None:
    assert TOOL.needs == (Signal.POSITION, Signal.VELOCITY)
    assert VirtualCoupling("handle", 800.0, 0.05).needs == (Signal.POSITION,)


@pytest.mark.parametrize("wrong", [{"mass": 0.0}, {"wall_stiffness": -1.0}, {"damping": -1.0}, {"side": "left"}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(VirtualCoupling).validate_python({"axis": "handle", "stiffness": 800.0, "mass": 0.05, **wrong})
