"""Refusals: what they propose is stable, whatever parameter the stiffness of an element follows from."""

import re
from dataclasses import replace
from typing import Any, cast

import pytest

from haptic_fieldbus.errors import UnstableSceneError
from haptic_fieldbus.margins.closed_loop import stiffest_of
from haptic_fieldbus.numerals import rounded_down
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.element import AnyElement, abilities
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import plan_of, scene_of

GRADED = [
    name
    for name in scene_names()
    if len(load_scene(name).axes) == 1
    and abilities(stiffest_of(load_scene(name).of_axis(load_scene(name).axes[0].name))).with_stiffness is not None
]


def with_element(scene: Scene, old: AnyElement, new: AnyElement) -> Scene:
    return replace(scene, elements=tuple(new if element is old else element for element in scene.elements))


def proposed(element: AnyElement, text: str) -> AnyElement:
    """The element with what is proposed first."""
    first = text.partition("Inside the limit: ")[2].partition(" · ")[0]
    found = {key: float(value) for key, value in re.findall(rf"{element.name}\.(\w+)=([-+.e0-9]*[0-9])", first)}
    share = re.search(rf"{element.name} with all stiffnesses multiplied by ([.0-9]*[0-9])", first)
    graded = abilities(element).with_stiffness
    if share is not None and graded is not None:
        softened: AnyElement = graded(float(share[1]) * abilities(element).stiffness)
        return softened
    assert found
    changed: AnyElement = replace(element, **found)  # type: ignore[type-var]  # elements are dataclasses
    return changed


@pytest.mark.thorough("searches two limits for each", quick=("detents", "generalised_maxwell", "hunt_crossley"))
@pytest.mark.parametrize("name", GRADED)
def test_an_element_that_is_too_steep_is_refused_with_parameters_that_it_has(name: str) -> None:
    scene = load_scene(name)
    stability = plan_of(scene).stability
    element = cast(Any, stiffest_of(scene.of_axis(scene.axes[0].name)))
    assert stability is not None
    onset = stability.stiffness_limit.stable
    assert onset is not None
    steep = element.with_stiffness(3.0 * onset)
    with pytest.raises(UnstableSceneError) as refused:
        check_stable(plan_of(with_element(scene, element, steep)))
    assert refused.value.limit == pytest.approx(stability.limit.value)
    mended = plan_of(with_element(scene, element, proposed(steep, str(refused.value)))).stability
    assert mended is not None
    assert mended.is_inside


def test_scenes_of_every_steepness_were_looked_at() -> None:
    assert {"detents", "texture", "magnet", "hunt_crossley", "pendulum"} <= set(GRADED)


@pytest.mark.thorough("3 cases of one rule", quick=2)
@pytest.mark.parametrize("stiffness", [3000.0, 12_000.0, 1e6])
def test_what_is_proposed_is_inside_the_limit(stiffness: float) -> None:
    """Each proposal, the softer wall and the one with damping, is planned again and judged over all ranges."""
    soft = Wall("handle", stiffness=stiffness, damping=0.5)
    with pytest.raises(UnstableSceneError) as refused:
        check_stable(plan_of(scene_of(soft)))
    given = dict(re.findall(r"--set wall\.(\w+)=([.0-9]*[0-9])", str(refused.value)))
    assert set(given) == ({"stiffness", "damping"} if stiffness < 1e6 else {"stiffness"})
    for name, value in given.items():
        mended: Wall = replace(soft, **{name: float(value)})  # type: ignore[arg-type]  # both are numbers
        judged = plan_of(scene_of(mended)).stability
        assert judged is not None
        assert judged.is_inside
        assert mended.stiffness <= judged.limit.value


class Pushing:
    """Something that pushes the handle the way that it already goes, and has no stiffness."""

    axis, name, needs = "handle", "pushing", (Signal.VELOCITY,)

    def force(self, velocity: float) -> float:
        return 500.0 * velocity

    def linearised(self) -> StateSpace:
        return gain([[0.0, 500.0]])


def test_of_several_elements_the_stiffest_is_named() -> None:
    for elements, asked in (
        ((Wall("handle", 3000.0),), "3000 N/m exceeds"),
        ((Wall("handle", 3000.0), Spring("handle", 10.0)), "3000 N/m of wall exceeds"),
    ):
        with pytest.raises(UnstableSceneError, match=f"^{asked}"):
            check_stable(plan_of(scene_of(*elements)))


def test_what_has_no_stiffness_is_refused_without_a_proposal() -> None:
    with pytest.raises(UnstableSceneError) as refused:
        check_stable(plan_of(scene_of(Pushing())))
    assert "this scene is unstable" in str(refused.value)
    assert "Inside the limit" not in str(refused.value)


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize(
    ("name", "settings", "held"),
    [("detents", {"end_stop.stiffness": 5000.0, "detents.amplitude": 12.0}, "end_stop"),
     ("gear_shifter", {"end_stop.stiffness": 5000.0, "friction.stiffness": 4000.0}, "friction")],
)  # fmt: skip
def test_where_another_element_leaves_no_stiffness_it_is_named_and_made_softer(
    name: str, settings: dict[str, float], held: str
) -> None:
    with pytest.raises(UnstableSceneError) as refused:
        check_stable(plan_of(load_scene(name, settings)))
    given = {key: float(value) for key, value in re.findall(r"--set (\w+\.\w+)=([.0-9]*[0-9])", str(refused.value))}
    assert f"{held}.stiffness" in given
    assert all(value == float(f"{value:.4g}") for value in given.values()), "no more digits than one would type"
    mended = plan_of(load_scene(name, settings | given)).stability
    assert mended is not None
    assert mended.is_inside


def test_a_stop_that_alone_is_above_the_limit_of_a_wall_leaves_nothing_to_detents() -> None:
    wall = plan_of(load_scene("wall")).stability
    assert wall is not None
    high, low = 1.05 * wall.limit.value, rounded_down(wall.limit.value)
    above, inside = (
        load_scene("detents", {"detents.amplitude": 2.0, "end_stop.stiffness": each}) for each in (high, low)
    )
    found = f"end_stop alone is above its limit, {high:.4g} of {wall.limit.value:g} N/m, which leaves none for detents"
    text = explain(plan_of(above))
    assert f"{found}; inside: --set end_stop.stiffness={low:g}" in text
    assert "leaves none" not in explain(plan_of(inside))
