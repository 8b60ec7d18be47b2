"""What the ledger of an axis is granted, by the elements and couplings that act on it, and whether it has one."""

from dataclasses import replace

import pytest

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.planning.energy import TWIST, axis_terms
from haptic_fieldbus.planning.limit_table import limit_rows
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.inertia import Inertia
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


SHAFT = Coupling(("left", "right"), 400.0)
UNEVEN = Inertia("right", mass=0.1, negative_coefficient=0.5)
"""Without a saturation it may give any force by itself."""


def told(plan: Plan) -> dict[str, float]:
    """Limit of the energy of each axis, as the plan tells it."""
    rows = ((axis.name, row) for axis in plan.axes for row in limit_rows(axis, plan.period))
    return {name: row.value for name, row in rows if row.name == "energy of its own"}


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
