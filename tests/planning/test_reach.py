"""Places of elements against the range of their axis: what the handle cannot reach is refused with the range."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.drive.rig import Limits, Rig
from haptic_fieldbus.errors import SceneError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.running.changes import Changes
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.element import AnyElement, Place
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.pendulum import Pendulum
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, place_names
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal, Workspace
from tests.builders import plan_of, rig_of, scene_of
from tests.scenes.test_element_contract import SHEETS

RANGE = r"expected -0\.1 to 0\.1 m, the range of the axis handle on this bench"


def with_place(kind: type[AnyElement]) -> Scene:
    """A scene of the library, else of a sheet, with an element of this kind, and of no other that must fit to it."""
    for name in scene_names():
        scene = load_scene(name)
        mine = [each for each in scene.elements if type(each) is kind]
        if mine:
            return replace(scene, elements=(mine[0],))
    return scene_of(next(sheet.examples[0] for sheet in SHEETS.values() if type(sheet.examples[0]) is kind))


def placed(scene: Scene, parameter: str, place: float) -> Scene:
    element: Any = scene.elements[0]
    return replace(scene, elements=(replace(element, **{parameter: place}),))


LINEAR = [
    pytest.param(element_type(kind), parameter, id=f"{kind}.{parameter}")
    for kind in ELEMENTS
    for parameter in place_names(element_type(kind))
    if getattr(element_type(kind), "workspace", None) is not Workspace.ROTARY
]


@pytest.mark.parametrize(("kind", "parameter"), LINEAR)
def test_a_place_out_of_reach_is_refused_with_the_range_for_every_kind(kind: type[AnyElement], parameter: str) -> None:
    place = -20.0 if parameter == "lower" else 20.0  # a lower stop is below the upper one
    scene = placed(with_place(kind), parameter, place)
    name = scene.elements[0].name
    with pytest.raises(SceneError, match=rf"{name}\.{parameter}: {place:g} m; {RANGE}; {place:g} mm is written "):
        plan_of(scene, rig=rig_of(scene, limits=Limits(position=(-0.1, 0.1))))


def test_the_shipped_bench_and_a_setting_are_told_so_too() -> None:
    with pytest.raises(SceneError, match=rf'wall\.position: 20 m; {RANGE}; 20 mm is written "20 mm"$'):
        plan("wall", settings={"wall.position": 20})
    assert plan("wall", settings={"wall.position": "20 mm"}).scene.elements[0].position == 0.02  # type: ignore[attr-defined]


@pytest.mark.parametrize(("place", "hint"), [(0.5, ""), (1.5, '; 1.5 mm is written "1.5 mm"')])
def test_a_place_of_a_metre_or_more_was_perhaps_meant_in_millimetres(place: float, hint: str) -> None:
    with pytest.raises(SceneError, match=rf"wall\.position: {place} m; {RANGE}{hint}$"):
        plan("wall", settings={"wall.position": place})


def test_the_range_of_a_rig_is_told_with_its_file_and_all_places_at_once() -> None:
    left = Wall("handle", 600.0, position=-0.07, side="negative", name="b")
    scene = scene_of(Wall("handle", 600.0, position=0.06, name="a"), left)
    rig = replace(rig_of(scene, limits=Limits(position=(-0.05, 0.05))), source="mine.toml")
    with pytest.raises(SceneError) as refused:
        plan_of(scene, rig=rig)
    told = "expected -0.05 to 0.05 m, the range of the axis handle (limits.position in mine.toml)"
    assert [str(fault) for fault in refused.value.faults] == [
        f"a.position: 0.06 m; {told}",
        f"b.position: -0.07 m; {told}",
    ]


def test_the_ends_of_the_range_are_within_it() -> None:
    stops = scene_of(EndStop("handle", 600.0, lower=-0.1, upper=0.1))
    assert plan_of(stops, rig=rig_of(stops, limits=Limits(position=(-0.1, 0.1)))).scene == stops


def test_a_knob_that_turns_without_end_has_no_range() -> None:
    far = scene_of(Wall("knob", 0.5, position=500.0), workspace=Workspace.ROTARY)
    assert plan_of(far, rig=rig_of(far)).scene == far
    assert plan(far).axes[0].limits.position is None


@pytest.mark.parametrize(
    "element",
    [Spring("handle", 100.0, position=-0.12), Wall("handle", 100.0, position=-0.12)],
    ids=["a preloaded spring", "a wall in which the handle begins"],
)
def test_what_is_felt_within_the_range_may_begin_outside_of_it(element: AnyElement) -> None:
    scene = scene_of(element)
    assert plan_of(scene, rig=rig_of(scene, limits=Limits(position=(-0.1, 0.1)))).scene == scene


def test_a_pendulum_may_hang_where_the_knob_does_not_go() -> None:
    scene = scene_of(Pendulum("knob", 0.02, position=3.0), workspace=Workspace.ROTARY)
    assert plan_of(scene, rig=rig_of(scene, limits=Limits(position=(-1.0, 1.0)))).scene == scene


@dataclass(frozen=True)
class Own:
    """An element of one's own with two places, one of them open."""

    axis: str
    begin_at: Place = 0.0
    end_at: Place | None = None
    name: str = "own"
    needs: ClassVar = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -position

    def linearised(self) -> StateSpace:
        return gain([[-1.0, 0.0]])


def test_the_places_of_an_element_of_ones_own_count_by_their_annotation() -> None:
    rig: Rig = rig_of(scene_of(Own("handle")), limits=Limits(position=(-0.1, 0.1)))
    assert plan_of(scene_of(Own("handle")), rig=rig)
    with pytest.raises(SceneError, match=rf"own\.begin_at: 0\.2 m; {RANGE}$"):
        plan_of(scene_of(Own("handle", 0.2)), rig=rig)


def test_a_change_of_a_running_scene_is_refused_alike() -> None:
    running = plan("wall")
    with pytest.raises(SceneError, match=RANGE) as refused:
        Changes([(0.5, {"wall.position": 20.0})]).check(running, 1.0, force=False)
    assert refused.value.__notes__ == ["requested by the change at 0.5 s"]
