"""Energy granted to the ledger of an axis by the elements and couplings that act on it, and whether it has one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import accumulate, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import geomspace, interp
from scipy.integrate import quad

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.energy import LIPSCHITZ
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.planning.energy import TWIST, axis_terms, bind_stored
from haptic_fieldbus.planning.explain import limit_rows
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.inertia import Inertia
from haptic_fieldbus.scenes.magnet import Magnet
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import plan_of, rig_of, scene_of

PERIOD = 1e-3


def test_stiffness_of_walls_and_of_the_axis_own_couplings_is_granted_and_no_other() -> None:
    plan = plan_of(scene_of(Wall("left", 100.0), Wall("right", 100.0, name="other")))
    axis = plan.axes[0]
    own, others = Coupling(("left", "right"), 50.0), Coupling(("right", "third"), 1e6)
    alone, tied, beside = (
        axis_terms(axis, axis.elements, couplings, PERIOD).damping for couplings in ((), (own,), (own, others))
    )
    assert tied == pytest.approx(alone * (1.0 + TWIST * 50.0 / 100.0))
    assert beside == tied


def test_the_stored_energy_of_tied_axes_is_that_of_their_walls_and_of_the_spring_between_them() -> None:
    """½·K·x² of each wall that is pressed, and ½·K·(x₁ - x₂)² of the spring, at the places of the laws."""
    tied = Coupling(("left", "right"), 400.0)
    plan = plan_of(scene_of(Wall("left", 100.0), Wall("right", 300.0, name="other"), tied))
    stored = bind_stored(plan.axes, [axis.elements for axis in plan.axes], [tied])
    places = (0.03, 0.01)
    assert stored((0.0, 0.0), places) == pytest.approx(
        0.5 * (100.0 * 0.03**2 + 300.0 * 0.01**2 + 400.0 * (0.03 - 0.01) ** 2)
    )


SHAFT = Coupling(("left", "right"), 400.0)
UNEVEN = Inertia("right", mass=0.1, negative_coefficient=0.5)
"""Without a saturation it may give any force by itself."""


def told(plan: Plan) -> dict[str, float]:
    """Limit of the energy of each axis, as the plan tells it."""
    return rows_of(plan, "energy of its own")


def rows_of(plan: Plan, limit: str) -> dict[str, float]:
    rows = ((axis.name, row) for axis in plan.axes for row in limit_rows(axis, plan.period))
    return {name: row.value for name, row in rows if row.name == limit}


@pytest.mark.thorough("4 cases of one rule", quick=2)
@pytest.mark.parametrize(
    ("elements", "judged"),
    [
        ((SHAFT,), ("left", "right")),
        ((SHAFT, UNEVEN), ()),
        ((Wall("left", 100.0), UNEVEN), ("left",)),
        ((SHAFT, replace(UNEVEN, positive_saturation=2.0, negative_saturation=2.0)), ("left", "right")),
    ],
)
def test_the_plan_tells_of_a_ledger_where_the_cycle_has_one(
    elements: tuple[AnyElement, ...], judged: tuple[str, ...]
) -> None:
    plan = plan_of(scene_of(*elements))
    assert tuple(axis.name for ledger in Cycle(plan).ledgers for axis in ledger.axes) == judged
    assert tuple(told(plan)) == judged
    assert tuple(step.split(":")[0] for step in plan.steps if ": energy: " in step) == judged
    assert [left.what for left in plan.left_out].count("energy ledger") == (len(judged) < len(plan.axes))


def test_tied_axes_are_told_the_limit_that_they_share() -> None:
    """The right motor may give a fifth of the force, so that a count of it is worth less."""
    scene = scene_of(SHAFT)
    rig = rig_of(scene)
    weaker = replace(rig, axis=rig.axis | {"right": replace(rig.axis["right"], limits=Limits(effort=10.0))})
    plan = plan_of(scene, rig=weaker)
    (ledger,) = Cycle(plan).ledgers
    assert told(plan) == {"left": ledger.tally.limit, "right": ledger.tally.limit}
    left = plan.axes[0]
    assert ledger.tally.limit == pytest.approx(0.005 + left.limits.effort * left.resolution)


FORGIVEN = "energy forgiven in a second"


def test_a_fifth_of_a_second_at_the_limits_of_force_and_speed_is_forgiven() -> None:
    """The lost share of a second that ends a run, times what the axis may do at most; a limit of power counts too."""
    for limits, expected in (
        (Limits(effort=10.0, speed=0.5), 0.2 * 10.0 * 0.5),
        (Limits(effort=10.0, speed=0.5, power=2.0), 0.2 * 2.0),
        (Limits(effort=10.0, speed=0.5, power=50.0), 0.2 * 10.0 * 0.5),
    ):
        scene = scene_of(Wall("handle", 100.0))
        plan = plan_of(scene, rig=rig_of(scene, limits=limits))
        (ledger,) = Cycle(plan).ledgers
        assert rows_of(plan, FORGIVEN) == {"handle": pytest.approx(expected)}
        assert ledger.tally.budget == pytest.approx(expected)


def test_tied_axes_share_what_is_forgiven_and_axes_without_a_ledger_have_none() -> None:
    tied = plan_of(scene_of(SHAFT), rig=rig_of(scene_of(SHAFT), limits=Limits(effort=10.0, speed=0.5)))
    assert rows_of(tied, FORGIVEN) == {"left": pytest.approx(2.0), "right": pytest.approx(2.0)}
    assert rows_of(plan_of(scene_of(SHAFT, UNEVEN)), FORGIVEN) == {}


@pytest.mark.parametrize("length", [0.003, 0.015, 0.03])
def test_no_gap_gives_more_than_force_times_speed_times_its_length(length: float) -> None:
    """A handle goes at the limit of speed into a spring and out again, through a gap on its way in.

    By quadrature of the force that 0021 and 0037 allow: held and faded within 10 ms in the gap, then capped at the
    force before it, or the law less what it rose by. A cap gives most where the limit of force is reached before.
    """
    effort, speed = 10.0, 0.5
    bound = effort * speed * length
    found = []
    for stiffness in (100.0, 600.0, 3000.0):
        for before in (0.3 * effort, effort):
            begin, way = before / stiffness, speed * length
            end = begin + way

            def law(x: float, k: float = stiffness) -> float:
                return k * x

            faded = min(0.01, length)
            held = quad(lambda t, f=before: f * (1.0 - t / 0.01) * speed, 0.0, faded)[0]
            taken = quad(law, 0.0, begin)[0] + held
            deficit = law(end) - before
            capped = quad(lambda x, f=before: min(law(x), f), 0.0, end, points=[begin])[0]
            lessened = quad(lambda x, d=deficit: max(law(x) - d, 0.0), 0.0, end, points=[deficit / stiffness])[0]
            found += [capped - taken, lessened - taken]
    assert max(found) <= bound
    assert max(found) == pytest.approx(bound - held, rel=0.01)  # which the held force took in the gap


def lipschitz(xs: Sequence[float], stiffness: float) -> Callable[[float], float]:
    """A law of the steepest slope, up and down between these places."""
    values = list(accumulate((stiffness * (b - a) * (-1) ** k for k, (a, b) in enumerate(pairwise(xs))), initial=0.0))
    return lambda x: float(interp(x, xs, values))


@given(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=5), st.floats(1.0, 1e4))
def test_the_trapezoid_of_a_law_is_off_by_a_quarter_of_its_slope_at_most(parts: list[float], stiffness: float) -> None:
    xs = [0.0, *accumulate(parts)]
    law, way = lipschitz(xs, stiffness), xs[-1]
    exact = quad(law, 0.0, way, points=xs[1:-1] or None)[0]
    assert abs(0.5 * (law(0.0) + law(way)) * way - exact) <= (LIPSCHITZ + 1e-6) * stiffness * way**2


def test_a_law_that_turns_in_the_middle_is_off_by_all_of_it() -> None:
    law = lipschitz((0.0, 0.5, 1.0), 1.0)
    assert 0.5 * (law(0.0) + law(1.0)) - quad(law, 0.0, 1.0, points=[0.5])[0] == pytest.approx(-LIPSCHITZ)


BODY = HuntCrossley("handle", effort=0.18, depth=0.01, exponent=2.0)
"""At its depth it has 36 N/m; where it pushes with the limit of 50 N, at 0.17 m, 601 N/m."""


def test_the_leak_of_a_body_is_granted_at_its_slope_at_each_depth() -> None:
    """n·k·dⁿ⁻¹·(T/2 + td), never less, and at most a third more, until its push is so small that no leak matters."""
    (axis,) = plan_of(scene_of(BODY)).axes
    terms = axis_terms(axis, axis.elements, (), PERIOD)
    reach = 0.01 * (axis.limits.effort / 0.18) ** 0.5
    for depth in geomspace(0.002, 0.999 * reach, 60):
        exact = 36.0 * depth / 0.01 * terms.age * PERIOD
        assert exact <= terms.damping_between(depth, depth) <= 1.35 * exact
    deep = terms.damping_between(0.1, 0.1)
    assert terms.damping_between(-0.1, 0.1) == deep
    assert terms.damping_between(-0.1, -0.05) == 0.0
    assert terms.damping_between(1.1 * reach, 2.0 * reach) == 0.0  # there the effort limit cuts the push


def test_beside_another_element_the_body_is_looked_at_beyond_the_effort_limit() -> None:
    """Friction holds against it there, and has a slope of its own."""
    friction = Friction("handle", coulomb=1.0, stiffness=500.0)
    (axis,) = plan_of(scene_of(BODY, friction)).axes
    terms = axis_terms(axis, axis.elements, (), PERIOD)
    reach = 0.01 * (axis.limits.effort / 0.18) ** 0.5
    assert terms.damping_between(1.1 * reach, 1.1 * reach) > (500.0 + 36.0 * 1.1 * reach / 0.01) * terms.age * PERIOD
    assert terms.damping_between(-0.1, -0.1) == pytest.approx(500.0 * terms.age * PERIOD)


def test_where_the_linear_model_is_the_steepest_it_counts_everywhere() -> None:
    for element in (Wall("handle", 600.0), Magnet("handle", 2.0, 0.01), Friction("handle", 1.0, 500.0)):
        (axis,) = plan_of(scene_of(element)).axes
        terms = axis_terms(axis, axis.elements, (), PERIOD)
        assert not terms.by_place
        assert terms.damping_between(-0.1, -0.1) == terms.damping


def test_the_travel_ends_the_places() -> None:
    limits = Limits(position=(-0.05, 0.05))
    (axis,) = plan_of(scene_of(BODY), rig=rig_of(scene_of(BODY), limits=limits)).axes
    (places,) = axis_terms(axis, axis.elements, (), PERIOD).by_place
    assert all(-0.05 < edge < 0.05 for edge in places.edges)
    assert len(places.dampings) == len(places.edges) + 1
