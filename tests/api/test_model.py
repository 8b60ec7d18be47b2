"""The linear model of a scene's environment, against scipy and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from haptic_fieldbus.api import plan
from haptic_fieldbus.api.model import EnvironmentModel, model_of, poles_along, poles_of
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.report.analysis_texts import model_lines
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.numerics.textbook import TEXTBOOK

Array = NDArray[np.float64]
MODAL = ("sprung_mass", "damped_sprung_mass", "free_puck")
SCIPY = {
    "exact-zoh": "zoh",
    "exact-foh": "foh",
    "trapezoidal": "bilinear",
    "forward-euler": "euler",
    "backward-euler": "backward_diff",
}
"""Name of a method in scipy."""
RATE = 200.0


def model(scene: str, **words: object) -> EnvironmentModel:
    return model_of(Task(scene, **words))  # type: ignore[arg-type]


def closed(space: StateSpace) -> tuple[Array, Array, Array, Array]:
    return space.a, space.b, space.c, space.d


def answer(numerator: Array, denominator: Array, at: complex) -> complex:
    return complex(np.polyval(numerator, at) / np.polyval(denominator, at))


@pytest.mark.parametrize("scene", [*MODAL, "virtual_coupling", "generalised_maxwell"])
def test_the_transfer_functions_are_those_of_scipy(scene: str) -> None:
    continuous = model(scene).continuous
    for place, found in enumerate(continuous.transfer_functions.values()):
        numerators, denominator = signal.ss2tf(*closed(continuous.space), input=place)
        np.testing.assert_allclose(found.den, denominator, rtol=1e-9)
        np.testing.assert_allclose(found.num, numerators[0], rtol=1e-9, atol=1e-9 * np.abs(numerators).max())


@pytest.mark.parametrize("method", SCIPY)
@pytest.mark.parametrize("scene", MODAL)
def test_the_discrete_system_is_scipys_discretisation_with_the_velocity_of_a_backward_difference(
    scene: str, method: str
) -> None:
    """In the frequency domain, as the states of both differ."""
    found = model(scene, method=method, rate=RATE)
    period = 1.0 / RATE
    a, b, c, d, _ = signal.cont2discrete(closed(found.continuous.space), period, SCIPY[method])
    (function,) = found.discrete.transfer_functions.values()
    for angle in (0.13, 1.0, 2.5):
        z = complex(math.cos(angle), math.sin(angle))
        velocity = (1.0 - 1.0 / z) / period
        both = c @ np.linalg.solve(z * np.eye(len(a)) - a, b) + d
        expected = complex(both[0, 0] + both[0, 1] * velocity)
        assert function(z) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("method", SCIPY)
@pytest.mark.parametrize("scene", MODAL)
def test_growth_and_paths_are_the_poles_of_scipys_discretisation(scene: str, method: str) -> None:
    found = model(scene, method=method, rate=RATE)
    a = signal.cont2discrete(closed(found.integrated), 1.0 / RATE, SCIPY[method])[0]
    assert found.growth[method] == pytest.approx(np.abs(np.linalg.eigvals(a)).max(), rel=1e-9)
    (path,) = poles_along(found.integrated, np.array([1.0 / RATE]), method)
    np.testing.assert_allclose(path, np.sort_complex(np.linalg.eigvals(a)), atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rate", [1000.0, 40.0])
def test_the_growth_of_the_lectures_mass_is_that_of_the_textbooks_step(method: str, rate: float) -> None:
    """h = T·√(k/m), with 200 N/m and 0.5 kg."""
    found = model("sprung_mass", method=method, rate=rate)
    h = 20.0 / rate
    step = np.array([TEXTBOOK[method](*unit, 0.0, 0.0, 1.0 / rate, 400.0) for unit in np.eye(2)], dtype=float)
    assert found.growth[method] == pytest.approx(np.abs(np.linalg.eigvals(step)).max(), rel=1e-8)
    assert found.growth["forward-euler"] == pytest.approx(math.sqrt(1.0 + h * h), rel=1e-12)


def test_forward_euler_has_the_lectures_poles() -> None:
    poles = model("sprung_mass", method="forward-euler").discrete.poles
    np.testing.assert_allclose(poles, [1 - 0.02j, 1 + 0.02j], atol=1e-14)


def test_a_branch_of_tissue_relaxes_exactly_by_its_own_time() -> None:
    """Whatever the method: 3 ms, 0.1 s and 1 s of the scene."""
    for method in ("forward-euler", "exact-foh"):
        found = model("generalised_maxwell", method=method)
        expected = np.exp([-1e-3 / 0.003, -1e-3 / 0.1, -1e-3])
        np.testing.assert_allclose(found.discrete.poles, expected, rtol=1e-12)
        assert found.integrated.order == 0


def test_a_wall_is_its_stiffness_and_damping() -> None:
    found = model("damped_wall", settings={"wall.stiffness": 800.0, "wall.damping": 3.0})
    np.testing.assert_array_equal(found.continuous.space.d, [[-800.0, -3.0]])
    assert (found.continuous.space.order, len(found.continuous.poles)) == (0, 0)
    (function,) = found.discrete.transfer_functions.values()
    z = 0.3 + 0.7j
    assert function(z) == pytest.approx(-800.0 - 3.0 * (1.0 - 1.0 / z) / 1e-3, rel=1e-12)
    assert list(found.continuous.transfer_functions) == ["position", "velocity"]
    assert list(model("wall").continuous.transfer_functions) == ["position"]


@pytest.mark.thorough("plans every scene", quick=("sprung_mass", "damped_wall"))
@pytest.mark.parametrize("scene", scene_names())
def test_the_poles_are_those_of_the_environment_that_stability_is_judged_with(scene: str) -> None:
    """Of an axis without couplings; those of others are felt here with the other axis held."""
    found, judged = model(scene), plan(scene)
    group = judged.axes[0].group
    assert set(found.to_json()) == {"axis", "period_s", "method", "estimator", "continuous", "discrete", "growth"}
    if group is not None and not group.couplings:
        poles = poles_of(group.environment().a)
        if scene == "friction":  # shown as it holds; it is judged as it slides too, with the estimator's pole at 0
            poles = poles[np.argsort(np.abs(poles))]
            assert poles[0] == 0.0
            poles = poles[1:]
        np.testing.assert_allclose(found.discrete.poles, poles, atol=1e-12)


def test_an_implicit_equation_without_a_solution_has_no_growth_and_no_poles() -> None:
    """ż = 1000 z at 1 ms: 1 − T·λ is 0."""
    grows = StateSpace(np.array([[1000.0]]), np.zeros((1, 2)), np.ones((1, 1)), np.zeros((1, 2)))
    found = replace(model("sprung_mass"), integrated=grows)
    assert found.growth["backward-euler"] is None
    assert "backward-euler no step, trapezoidal 3" in dict(model_lines(found))["growth"]
    assert [*poles_along(grows, np.array([1e-3]), "backward-euler")] == []
