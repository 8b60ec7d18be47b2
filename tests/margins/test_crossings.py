"""Closed form of the stiffnesses at which an eigenvalue has the modulus 1, against eigenvalues and a full search."""

import math
from collections.abc import Callable, Sequence
from random import Random

import numpy as np
import pytest

from haptic_fieldbus import plan
from haptic_fieldbus.margins import Plant, alone, judge, stiffness_limit
from haptic_fieldbus.margins.linear import MOST_STATES, crossings, limit_of
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cases import every
from tests.loops import BENCH, PERIOD, Array, sprung_mass, with_damping

MatrixOf = Callable[[float], Array]


def through(matrix_of: MatrixOf, step: float) -> list[float] | None:
    return crossings([matrix_of(multiple * step) for multiple in (1.0, 2.0, 3.0)], step)


def drawn(seed: int) -> tuple[Plant, float, float]:
    """Device, delay [s] and virtual damping of one loop."""
    draw = Random(seed)
    mass = 10.0 ** draw.uniform(-5.0, 1.0)
    damping = mass / PERIOD * 10.0 ** draw.uniform(-5.0, 0.0)
    lag = draw.choice([0.0, PERIOD * 10.0 ** draw.uniform(-2.0, 0.5)])
    delay = PERIOD * draw.choice([0.0, draw.uniform(0.0, 2.0), draw.uniform(0.0, 8.0)])
    return Plant(mass, damping, torque_lag=lag), delay, draw.choice([0.0, mass / PERIOD * 10.0 ** draw.uniform(-4, 0)])


def loop_of(seed: int) -> tuple[MatrixOf, Callable[[float], float], float]:
    """Matrix and growth of a drawn loop by its stiffness, and its m/T² + b/T."""
    plant, delay, virtual = drawn(seed)
    loop, environment_of = alone(plant, PERIOD, delay), with_damping(virtual)
    scale = plant.mass / PERIOD**2 + plant.damping / PERIOD
    return (
        lambda stiffness: sampled.loop_matrix(loop.devices[0], environment_of(stiffness)),
        lambda stiffness: loop.growth(environment_of(stiffness)),
        scale,
    )


class Counted:
    """A function that counts its calls."""

    def __init__(self, function: Callable[[float], float]) -> None:
        self.function, self.calls = function, 0

    def __call__(self, value: float) -> float:
        self.calls += 1
        return self.function(value)


def test_two_states_have_the_bounds_of_jury() -> None:
    """z² − (2 − d − c·k)·z + 1 − d + c·k/2: the product of the roots is 1 at k = 2·d/c; at k = (8 − 4·d)/c z is −1."""
    c, d = 0.37, 0.11

    def matrix(k: float) -> Array:
        return np.array([[2.0 - d - c * k, -(1.0 - d + 0.5 * c * k)], [1.0, 0.0]])

    found = through(matrix, 0.01)
    assert found is not None
    assert sorted(found) == pytest.approx([0.0, 2.0 * d / c, (8.0 - 4.0 * d) / c], rel=1e-12, abs=1e-12)


@every("seed", range(20))
def test_at_each_crossing_an_eigenvalue_has_the_modulus_1(seed: int) -> None:
    matrix_of, _, scale = loop_of(seed)
    found = through(matrix_of, 1e-3 * scale)
    assert found
    for stiffness in filter(lambda each: 1e-6 * scale < each < 10.0 * scale, found):
        moduli = np.abs(np.linalg.eigvals(matrix_of(stiffness)))
        assert np.abs(moduli - 1.0).min() < 1e-8, stiffness


@every("seed", range(12))
def test_stability_changes_nowhere_but_at_a_crossing(seed: int) -> None:
    matrix_of, growth, scale = loop_of(seed)
    found = np.array(through(matrix_of, 1e-3 * scale))
    tried = np.geomspace(1e-6, 10.0, 150) * scale
    stable = [growth(stiffness) <= 1.0 for stiffness in tried]
    for low, high, before, after in zip(tried, tried[1:], stable, stable[1:], strict=False):
        if before is not after:
            assert ((found > low * (1.0 - 1e-9)) & (found < high * (1.0 + 1e-9))).any(), (low, high)


@pytest.mark.thorough("some thousand eigenvalues for each loop", quick=3)
@pytest.mark.parametrize("first", range(0, 240, 12))
def test_the_limit_is_that_of_the_full_search_in_far_fewer_steps(first: int) -> None:
    asked = {True: 0, False: 0}
    for seed in range(first, first + 12):
        matrix_of, growth, scale = loop_of(seed)
        limits = {}
        for closed in asked:
            found = Counted(growth)
            limits[closed] = limit_of(found, scale, expected=through(matrix_of, 1e-3 * scale) if closed else None)
            asked[closed] += found.calls
        assert limits[True] == limits[False], seed
    assert asked[True] < 0.5 * asked[False]


LINEAR = ("wall", "damped_wall", "detents", "texture", "lugre", "virtual_shaft", "teleoperation")
"""Scenes whose loop is linear in its stiffness: one place, many places, two axes."""


@pytest.mark.thorough("searches the limit of each scene twice", quick=("wall", "detents", "teleoperation"))
@pytest.mark.parametrize("scene", scene_names())
def test_the_limit_of_a_library_scene_is_that_of_the_full_search(scene: str) -> None:
    group = plan(scene).axes[0].group
    assert group is not None
    if group.stiffest is None:
        return
    loop = group.loop

    def environment_of(stiffness: float) -> StateSpace:
        return group.environment(stiffness=stiffness)

    assert (loop.crossings(environment_of) is not None) or scene not in LINEAR
    found = limit_of(lambda stiffness: loop.growth(environment_of(stiffness)), loop.scale(environment_of))
    assert group.stability.stiffness_limit.stable == found


def test_a_loop_that_is_not_linear_in_its_stiffness_has_no_closed_form() -> None:
    device = alone(BENCH, PERIOD, 0.0).devices[0]
    of_mass = sprung_mass(0.5, "exact-foh")
    assert through(lambda stiffness: sampled.loop_matrix(device, of_mass(stiffness)), 100.0) is None


def test_two_forces_of_the_same_stiffness_have_no_closed_form() -> None:
    assert through(lambda k: np.array([[0.5 + k, 0.0], [0.0, 0.3 - k]]), 0.01) is None


def test_a_long_delay_has_no_closed_form_but_a_limit() -> None:
    delay = (MOST_STATES + 1) * PERIOD
    device = alone(BENCH, PERIOD, delay).devices[0]
    springs = with_damping(0.0)
    assert through(lambda stiffness: sampled.loop_matrix(device, springs(stiffness)), 100.0) is None
    assert 0.0 < stiffness_limit(BENCH, PERIOD, delay, springs) < math.inf


def test_states_that_come_with_the_stiffness_have_no_closed_form() -> None:
    sizes = iter((2, 2, 3))
    assert through(lambda k: k * np.eye(next(sizes)), 0.1) is None


@every("expected", [[], [1e-6], [1e9]])
def test_a_crossing_that_was_not_expected_is_searched(expected: Sequence[float]) -> None:
    """The last step of the search is tried too; it is unstable, and so is the one before."""
    _, growth, scale = loop_of(1)
    limit = limit_of(growth, scale)
    assert 0.0 < limit < math.inf
    assert limit_of(growth, scale, expected=expected) == limit


def test_a_crossing_at_a_step_of_the_search_is_found_on_either_side() -> None:
    """The growth exceeds 1 just above or at the seventh step, where the expected value is rounded to the other side."""
    steps = [1e-9 * math.sqrt(2.0) ** number for number in range(10)]
    for bound in (steps[6] * (1.0 - 1e-12), steps[6] * (1.0 + 1e-12)):
        for expected in (steps[6] * (1.0 - 1e-12), steps[6] * (1.0 + 1e-12)):
            found = limit_of(lambda k: 2.0 if k > bound else 0.5, 1.0, expected=[expected])  # noqa: B023
            assert found == pytest.approx(bound, rel=1e-9)


def test_a_verdict_uses_the_closed_form() -> None:
    """A judgement of the shipped bench takes fewer than a third of the eigenvalues that a search takes."""
    loop = alone(BENCH, PERIOD, 0.4 * PERIOD)
    asked: list[float] = []

    def environment_of(stiffness: float) -> StateSpace:
        asked.append(stiffness)
        return with_damping(0.2)(stiffness)

    judge(loop, environment_of, 600.0)
    assert len(asked) < 60
