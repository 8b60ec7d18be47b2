"""New values for a running scene: the checks of a file, the stability of a new run, and nothing beyond what runs."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus.cycle.laws import Sensed, field_of
from haptic_fieldbus.errors import HapticFieldbusError, PlanError, SceneError, UnstableSceneError, UsageError
from haptic_fieldbus.numerals import rounded_down
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.live_changes import MISSING, Change, plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.scenes.inertia import Inertia
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import plan_of, rig_of, scene_of
from tests.loops import Array, motion_over

DAMPED = scene_of(Wall("handle", stiffness=600.0, damping=2.0))


def change(plan: Plan, **settings: Any) -> Change:
    """Settings of the wall on top of the plan."""
    return plan_change(plan, plan, {f"wall.{name}": value for name, value in settings.items()})


def test_a_change_is_the_plan_with_the_new_values_and_all_else_kept() -> None:
    friction = Friction("handle", coulomb=1.0, stiffness=500.0)
    plan = plan_of(scene_of(Wall("handle", stiffness=600.0, position=0.02), friction))
    found = change(plan, stiffness=800.0, position=0.03)
    assert found.settings == {"wall.stiffness": 800.0, "wall.position": 0.03}
    assert found.plan.axes[0].elements == (Wall("handle", stiffness=800.0, position=0.03), friction)
    assert found.plan.axes[0].elements[1] is friction
    assert found.plan.axes[0].stability != plan.axes[0].stability
    assert [axis.traffic for axis in found.plan.axes] == [axis.traffic for axis in plan.axes]


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("tied", [(), (Coupling(("left", "right"), 400.0),)])
def test_a_change_to_what_no_ledger_can_judge_is_refused(tied: tuple[Coupling, ...], force: bool) -> None:
    """A mass that is larger on one side may give any force by itself; the ledger would grant it, and be blind."""
    plan = plan_of(scene_of(Inertia("right", mass=0.1), *tied))
    with pytest.raises(PlanError, match=r"inertia could then apply any force by itself.*: start a new run"):
        plan_change(plan, plan, {"inertia.negative_coefficient": 0.5}, force=force)
    assert plan_change(plan, plan, {"inertia.mass": 0.05}, force=force)


def test_where_nothing_was_judged_a_change_needs_no_ledger() -> None:
    plan = plan_of(scene_of(Inertia("right", mass=0.1, negative_coefficient=0.5)))
    assert plan_change(plan, plan, {"inertia.negative_coefficient": 0.8})


def test_units_and_parts_of_the_limit_are_understood_as_in_a_setting() -> None:
    plan = plan_of()
    assert change(plan, stiffness="0.8 N/mm", position="25 mm").settings == {
        "wall.stiffness": 800.0,
        "wall.position": 0.025,
    }
    assert plan.stability is not None
    typed = rounded_down(plan.stability.limit.value / 2, 3)
    assert change(plan, stiffness="max/2").settings["wall.stiffness"] == typed


@pytest.mark.parametrize(
    "settings",
    [
        {"wall.stiffness": -1.0},
        {"wall.stiffness": float("nan"), "wall.damping": "2 mm"},
        {"wall.side": "positve"},
        {"wall.stifness": 1.0},
        {"wal.stiffness": 1.0},
        {"stiffness": 1.0},
    ],
)
def test_faults_are_told_in_the_words_of_a_new_run(settings: dict[str, float | str]) -> None:
    scene = load_scene("damped_wall")
    with pytest.raises(HapticFieldbusError) as of_file:
        load_scene("damped_wall", settings)
    plan = plan_of(scene)
    with pytest.raises(type(of_file.value)) as of_change:
        plan_change(plan, plan, settings)
    assert str(of_change.value) == str(of_file.value)


def test_rules_across_parameters_hold_for_a_scene_made_in_python() -> None:
    plan = plan_of(scene_of(Friction("handle", coulomb=1.0, stiffness=500.0, breakaway=2.0, window=0.01)))
    with pytest.raises(SceneError, match=r"friction\.breakaway: 2: expected 0, or at least coulomb, 3"):
        plan_change(plan, plan, {"friction.coulomb": 3.0})


def test_a_change_names_something() -> None:
    with pytest.raises(UsageError, match="names what it changes"):
        plan_change(plan_of(), plan_of(), {})


def test_an_unstable_value_is_refused_with_the_limit_and_only_the_hints_that_a_running_loop_can_take() -> None:
    with pytest.raises(UnstableSceneError) as of_run:
        check_stable(plan_of(scene_of(Wall("handle", stiffness=5000.0, position=0.02))))
    plan = plan_of()
    with pytest.raises(UnstableSceneError) as of_change:
        change(plan, stiffness=5000.0)
    softer, _, damped = str(of_run.value).partition(" · or ")
    assert str(of_change.value) == f"{softer}."
    assert "Inside the limit: --set wall.stiffness=" in softer
    assert damped.startswith("--set wall.damping=")
    assert plan.stability is not None
    assert of_change.value.limit == plan.stability.limit.value


def test_force_lets_an_unstable_value_pass() -> None:
    plan = plan_of()
    assert plan_change(plan, plan, {"wall.stiffness": 90_000.0}, force=True).settings == {"wall.stiffness": 90_000.0}


def test_on_an_unknown_bench_there_is_no_verdict_to_refuse_by() -> None:
    scene = scene_of(Wall("handle", stiffness=600.0))
    plan = plan_of(scene, rig=rig_of(scene, inertia=None))
    assert change(plan, stiffness=5000.0).plan.stability is None


def test_damping_is_refused_where_no_velocity_is_estimated() -> None:
    with pytest.raises(PlanError, match="wall needs velocity, which this run does not estimate: start a new run"):
        change(plan_of(), damping=2.0)


def test_damping_may_go_and_come_again_where_velocity_is_estimated() -> None:
    running = plan_of(DAMPED)
    without = change(running, damping=0.0)
    assert without.plan.axes[0].estimator is None
    again = plan_change(running, without.plan, {"wall.damping": 3.0})
    assert again.plan.axes[0].estimator == running.axes[0].estimator


@dataclass(frozen=True)
class TargetReadback:
    """An element that asks for one more signal once it is `curious`; it says nothing of how it is checked."""

    axis: str
    signal: Signal
    curious: bool = False
    name: str = "asking"

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, self.signal) if self.curious else (Signal.POSITION,)

    def force(self, position: float, more: float = 0.0) -> float:
        return -position - more

    def linearised(self) -> StateSpace:
        return gain([[-1.0, 0.0]])


@pytest.mark.parametrize("signal", MISSING)
def test_every_signal_that_the_loop_has_not_is_refused(signal: Signal) -> None:
    plan = plan_of(scene_of(TargetReadback("handle", signal)))
    with pytest.raises(PlanError, match=r"asking needs .*, which this run does not .*: start a new run"):
        plan_change(plan, plan, {"asking.curious": True})
    asked = plan_of(scene_of(TargetReadback("handle", signal, curious=True)))
    assert plan_change(asked, asked, {"asking.curious": False}).settings == {"asking.curious": False}


def coupled(stiffness: float, *elements: Element, damping: float = 0.0) -> Plan:
    """Two axes on a shaft, and elements of the left one."""
    alone = scene_of(*elements, Wall("left", 300.0, name="at left"), Wall("right", 300.0, name="at right"))
    return plan_of(replace(alone, elements=(*alone.elements, Coupling(("left", "right"), stiffness, damping))))


def test_a_coupling_is_changed_and_judged_as_an_element_is() -> None:
    plan = coupled(200.0)
    found = plan_change(plan, plan, {"coupling.stiffness": 300.0})
    assert found.plan.scene.couplings == (Coupling(("left", "right"), 300.0),)
    with pytest.raises(UnstableSceneError):
        plan_change(plan, plan, {"coupling.stiffness": 90_000.0})
    with pytest.raises(PlanError) as refused:
        plan_change(plan, plan, {"coupling.damping": 1.0})
    assert str(refused.value) == "coupling needs velocity, which this run does not estimate: start a new run"


STIFF = (
    Wall("handle", stiffness=181_000.0, damping=0.75, sides="bilateral"),
    DampedSprungMass("handle", stiffness=574.0, mass=0.62, damping=558.0),
)
SOFT = (
    Wall("handle", stiffness=7.3, damping=0.1, sides="bilateral"),
    DampedSprungMass("handle", stiffness=42.0, mass=1.19, damping=0.016),
)
TO_SOFT = {
    "wall.stiffness": 7.3,
    "wall.damping": 0.1,
    "damped_sprung_mass.stiffness": 42.0,
    "damped_sprung_mass.mass": 1.19,
    "damped_sprung_mass.damping": 0.016,
}


def _swing(plan: Plan, share: float, periods: int = 1500) -> Array:
    """The handle let go beside its rest, in a simulation by scipy's matrix exponential with the laws of the loop."""
    axis, sensed = plan.axes[0], Sensed()
    assert axis.plant is not None
    laws = [
        (weight, field_of(element, plan.period, axis.method, sensed))
        for weight, elements in ((1.0 - share, STIFF), (share, SOFT))
        for element in elements
    ]
    state, last, before, ways = np.array([1e-6, 0.0, 0.0]), 0.0, 1e-6, []
    for _ in range(periods):
        sensed.velocity, before = (state[0] - before) / plan.period, float(state[0])
        force = sum(weight * law(float(state[0])) for weight, law in laws)
        state = motion_over(axis.plant, axis.delay.transport) @ [*state, last]
        state = motion_over(axis.plant, plan.period - axis.delay.transport) @ [*state, force]
        last = force
        ways.append(abs(state[0]))
    return np.array(ways)


def test_a_way_that_is_unstable_between_two_stable_ends_is_refused() -> None:
    """The mass damps the stiff wall; half-way its damper is gone before the wall is."""
    plan = plan_of(scene_of(*STIFF))
    check_stable(plan)
    check_stable(plan_of(scene_of(*SOFT)))
    with pytest.raises(
        UnstableSceneError, match=r"the change to these values .* and [0-9.]+ % of the new ones"
    ) as refused:
        plan_change(plan, plan, TO_SOFT)
    share = float(str(refused.value).partition(" % of the new")[0].rpartition(" ")[2]) / 100
    ends, middle = [_swing(plan, end).max() for end in (0.0, 1.0)], _swing(plan, share)
    assert max(ends) < 1e-4
    assert middle[-100:].max() > 100.0 * middle[:100].max()
    assert plan_change(plan, plan, TO_SOFT, force=True).settings == TO_SOFT


def test_on_a_coupled_axis_the_way_is_judged_with_all_that_hangs_on_it() -> None:
    """Two drives on a bus answer later, so the values are others; a shaft of 1 N/m is hardly there."""
    soft = (
        Wall("left", stiffness=54.0, damping=0.18, sides="bilateral"),
        DampedSprungMass("left", stiffness=891.0, mass=0.66, damping=10.9),
    )
    stiff = {
        "wall.stiffness": 206_000.0,
        "wall.damping": 1.38,
        "damped_sprung_mass.stiffness": 4324.0,
        "damped_sprung_mass.mass": 0.96,
        "damped_sprung_mass.damping": 412.0,
    }
    plan = coupled(1.0, *soft)
    check_stable(plan)
    check_stable(plan_change(plan, plan, stiff, force=True).plan)
    with pytest.raises(UnstableSceneError, match="the change to these values is unstable"):
        plan_change(plan, plan, stiff)
    assert plan_change(plan, plan, {"wall.position": 0.001}).settings == {"wall.position": 0.001}


def test_on_a_coupled_axis_of_an_unknown_bench_there_is_no_verdict_on_the_way() -> None:
    plan = coupled(200.0)
    unknown = {
        name: replace(axis, inertia=None if name == "right" else axis.inertia) for name, axis in plan.rig.axis.items()
    }
    running = plan_of(plan.scene, rig=replace(plan.rig, axis=unknown))
    assert plan_change(running, running, {"at left.stiffness": 90_000.0}).plan.stability is None


def test_of_two_axes_only_the_changed_one_is_judged_on_its_way() -> None:
    scene: Scene = scene_of(Wall("left", 600.0), Wall("right", 600.0, name="other"))
    plan = plan_of(scene)
    found = change(plan, stiffness=800.0)
    assert found.plan.axes[1].elements == plan.axes[1].elements
    assert found.plan.axes[0].elements == (Wall("left", 800.0),)
