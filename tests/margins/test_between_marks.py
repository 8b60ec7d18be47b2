"""Places at which several elements hold the handle together, sources that press it deeper, and a tool in the air.

The oracle is an own derivation of the sampled loop: plant and torque loop by the exponential of a matrix, the force
held from its delayed instant on, and the growth per period as the spectral radius.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from haptic_fieldbus.margins import Stability, Verdict
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.gravity import Gravity
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.texture import Texture
from haptic_fieldbus.scenes.virtual_coupling import VirtualCoupling
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import plan_of, scene_of

Matrix = NDArray[np.float64]


def judged(*elements: Element) -> tuple[Stability, tuple[float, float, float, float, float]]:
    """The verdict on the axis, and mass, damping, lag, delay and period of its loop at the nominal values."""
    plan = plan_of(scene_of(*elements))
    (axis,) = plan.axes
    assert axis.stability is not None
    assert axis.plant is not None
    times = axis.plant.torque_lag, axis.delay.transport, plan.period
    return axis.stability, (axis.plant.mass, axis.plant.damping, *times)


def held(a: Matrix, b: Matrix, time: float) -> tuple[Matrix, Matrix]:
    """Transition over a time with a constant input."""
    size = len(a)
    block = np.zeros((size + b.shape[1],) * 2)
    block[:size, :size], block[:size, size:] = a, b
    whole = expm(block * time)
    return whole[:size, :size], whole[:size, size:]


def growth(loop: tuple[float, float, float, float, float], law: tuple[ArrayLike, ...]) -> float:
    """Spectral radius of a period; `law` are the matrices of the discrete law from position to force."""
    mass, damping, lag, delay, period = loop
    a = np.array([[0.0, 1.0, 0.0], [0.0, -damping / mass, 1.0 / mass], [0.0, 0.0, -1.0 / lag]])
    b = np.array([[0.0], [0.0], [1.0 / lag]])
    whole, rest = divmod(delay, period)
    (first, by_before), (second, by_after) = held(a, b, rest), held(a, b, period - rest)
    la, lb, lc, ld = (np.atleast_2d(np.asarray(each, dtype=float)) for each in law)
    states, late = la.shape[0] if la.any() or lb.any() else 0, int(whole) + 1
    size = 3 + states + late
    force = np.zeros((1, size))
    force[0, 0] = ld[0, 0]
    force[:, 3 : 3 + states] = lc[:, :states]
    forces = [force, *(np.eye(size)[[3 + states + number]] for number in range(late))]
    period_matrix = np.zeros((size, size))
    period_matrix[:3, :3] = second @ first
    period_matrix[:3] += second @ by_before @ forces[late] + by_after @ forces[late - 1]
    if states:
        period_matrix[3 : 3 + states, :1], period_matrix[3 : 3 + states, 3 : 3 + states] = lb, la
    for number in range(late):
        period_matrix[3 + states + number] = forces[number]
    return float(np.abs(np.linalg.eigvals(period_matrix)).max())


def spring(stiffness: float) -> tuple[ArrayLike, ...]:
    return [[0.0]], [[0.0]], [[0.0]], [[-stiffness]]


@pytest.mark.parametrize("stiffness", [2000.0, 5000.0])
def test_two_walls_that_press_from_both_sides_are_judged_where_they_balance(stiffness: float) -> None:
    """In the middle, where neither has a mark, the slope is that of both; a third wall is felt farther out."""
    walls = (
        Wall("handle", stiffness, position=-0.09, name="low"),
        Wall("handle", stiffness, position=0.09, side="negative", name="high"),
        Wall("handle", stiffness + 1.0, position=0.095, name="beside"),
    )
    found, loop = judged(*walls)
    own = growth(loop, spring(2.0 * stiffness))
    assert own > 1.0
    assert found.verdict is Verdict.UNSTABLE
    assert found.spectral_radius == pytest.approx(own, abs=1e-6)
    assert found.place is not None
    assert found.place.position == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("stiffness", "is_stable"), [(400.0, True), (1000.0, False), (2000.0, False)])
def test_a_spring_that_is_stretched_by_another_one_has_the_slope_of_both(stiffness: float, *, is_stable: bool) -> None:
    found, loop = judged(*(Spring("handle", stiffness, position=at, name=f"at{at}") for at in (-0.09, 0.09)))
    assert (growth(loop, spring(2.0 * stiffness)) < 1.0) is is_stable
    assert (found.verdict is not Verdict.UNSTABLE) is is_stable


def test_contacts_that_stiffen_and_press_from_both_sides_are_judged_where_they_balance() -> None:
    """F = A·(x/d)ⁿ has the slope n·A/d·(x/d)ⁿ⁻¹, at the middle 90 mm deep in each."""
    low = HuntCrossley("handle", effort=7.0, depth=0.02, exponent=2.0, position=-0.09, name="low")
    high = replace(low, position=0.09, side="negative", name="high")
    found, loop = judged(low, high, Wall("handle", 740.0, position=0.0925))
    own = growth(loop, spring(2.0 * 2.0 * 7.0 / 0.02 * (0.09 / 0.02)))
    assert own > 1.0
    assert found.verdict is Verdict.UNSTABLE
    assert found.spectral_radius == pytest.approx(own, abs=1e-5)


def test_a_weight_presses_the_handle_deeper_than_the_motor_alone() -> None:
    """88 N on a body that gives 6.8 N at 50 mm and grows with the square: 180 mm deep, where its slope is 980 N/m."""
    body = HuntCrossley("handle", effort=6.8, depth=0.05, exponent=2.0, position=0.09, side="negative")
    found, _ = judged(body, Gravity("handle", 9.0))
    deep = 0.05 * math.sqrt(9.0 * 9.80665 / 6.8)
    slope = 2.0 * 6.8 / 0.05 * deep / 0.05
    assert slope == pytest.approx(980.0, rel=0.01)
    assert found.place is not None
    assert found.place.stiffness >= 0.98 * slope
    assert found.verdict is not Verdict.PASSIVE
    alone, _ = judged(body)
    assert found.limit.value < alone.limit.value
    pushed, _ = judged(body, Constant("handle", -88.0))
    assert pushed.limit.value <= found.limit.value


def test_ridges_on_a_body_that_stiffens_are_judged_at_their_steepest_place() -> None:
    body = HuntCrossley("handle", effort=6.8, depth=0.05, exponent=2.0, position=-0.0894, side="positive")
    ridges = Texture("handle", amplitude=0.145, pitch=0.001)
    found, loop = judged(body, ridges)
    ways = np.linspace(-0.1, 0.1, 400_001)
    deep = np.maximum(ways + 0.0894, 0.0)
    force, sine = 6.8 * (deep / 0.05) ** 2, 2.0 * math.pi / 0.001
    slope = 2.0 * 6.8 / 0.05 * deep / 0.05 + 0.145 * sine
    steepest = float(slope[force - 0.145 <= plan_of().axes[0].limits.effort].max())
    assert found.place is not None
    assert found.place.stiffness == pytest.approx(steepest, rel=0.025)
    assert growth(loop, spring(found.place.stiffness)) == pytest.approx(found.place.growth, abs=1e-6)


def tool(stiffness: float, damping: float, mass: float, wall: float, period: float) -> tuple[ArrayLike, ...]:
    """The tool of a virtual coupling by an exponential: its input on straight lines, velocity by difference."""
    a = np.array([[0.0, 1.0], [-(stiffness + wall) / mass, -damping / mass]])
    b = np.array([[0.0, 0.0], [stiffness / mass, damping / mass]])
    block = np.zeros((6, 6))
    block[:2, :2], block[:2, 2:4], block[2:4, 4:] = a, b, np.eye(2) / period
    whole = expm(block * period)
    step, before, now = whole[:2, :2], whole[:2, 2:4] - whole[:2, 4:], whole[:2, 4:]
    # States: the tool, position and velocity of the handle one period ago, and its position again for the difference.
    past = np.array([[0.0, 0.0], [0.0, -1.0 / period]])  # (x, v) now from the position before
    present = np.array([[1.0], [1.0 / period]])
    law_a = np.zeros((5, 5))
    law_a[:2, :2], law_a[:2, 2:4], law_a[:2, [4]] = step, before, now @ past[:, [1]]
    law_a[2:4, [4]] = past[:, [1]]
    law_b = np.vstack([now @ present, present, [[1.0]]])
    c, d = np.array([[stiffness, damping]]), np.array([[-stiffness, -damping]])
    law_c = np.hstack([c @ law_a[:2, :4], c @ law_a[:2, [4]] + d @ past[:, [1]]])
    return law_a, law_b, law_c, c @ law_b[:2] + d @ present


@pytest.mark.parametrize("wall", [0.0, 5000.0, 100_000.0])
def test_a_tool_behind_a_wall_is_judged_in_the_air_too(wall: float) -> None:
    """With the wall alone the loop would be called stable; before it touches, the light tool swings."""
    element = VirtualCoupling("handle", stiffness=890.0, damping=0.03, mass=0.03, wall_stiffness=wall, wall=0.02)
    found, loop = judged(element)
    own = growth(loop, tool(890.0, 0.03, 0.03, 0.0, loop[-1]))
    assert own > 1.0
    assert found.verdict is Verdict.UNSTABLE
    assert found.spectral_radius >= own - 1e-6
    if not wall:
        assert found.spectral_radius == pytest.approx(own, abs=1e-6)
