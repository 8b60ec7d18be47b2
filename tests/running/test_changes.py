"""The queue between those who ask for changes and the loop: what it refuses, in which order it hands on, and when."""

import struct
from dataclasses import dataclass
from threading import Thread
from typing import Any, ClassVar

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import PlanError, SafetyTripError, SceneError, UnstableSceneError, UsageError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.live_changes import plan_change
from haptic_fieldbus.running.changes import Changes
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import plan_of, scene_of

PERIOD_NS = 1_000_000
ENABLED = 0x0637
"""Statusword."""
PLAN = plan_of(scene_of(Wall("handle", 600.0)))


def begun(changes: Changes, duration: float = 10.0) -> Changes:
    """As a run has them from its first period on."""
    changes.check(PLAN, duration, force=False)
    changes.open(Cycle(PLAN))
    return changes


def step(cycle: Cycle) -> None:
    """One period in operation enabled, of a handle that stands still."""
    cycle(struct.pack("<qIHHHih", 0, 0, 0, 0, ENABLED, 0, 0))


def run_to(changes: Changes, first: int, last: int) -> list[tuple[int, dict[str, Setting]]]:
    """(period, settings) of what the loop makes in these periods."""
    made = []
    for period in range(first, last):
        if changes._cycle is not None:
            step(changes._cycle)
        before = len(changes.applied)
        if changes.waiting:
            changes.make(period * PERIOD_NS, (period - 1) * PERIOD_NS, PERIOD_NS)
        made += [(period, dict(applied.change.settings)) for applied in changes.applied[before:]]
    return made


def test_what_is_scheduled_begins_in_the_period_of_its_time() -> None:
    changes = begun(Changes([(0.5, {"wall.stiffness": 700.0}), (0.2, {"wall.stiffness": 800.0})]))
    assert run_to(changes, 1, 1000) == [(200, {"wall.stiffness": 800.0}), (500, {"wall.stiffness": 700.0})]


def test_a_change_waits_until_the_ramp_of_the_one_before_is_over() -> None:
    changes = begun(Changes(ramp=0.03))
    for stiffness in (700.0, 800.0, 900.0):
        changes.request({"wall.stiffness": stiffness})
    assert [period for period, _ in run_to(changes, 10, 100)] == [10, 40, 70]


def test_a_ramp_that_a_gap_has_held_up_is_waited_for() -> None:
    changes = begun(Changes(ramp=0.03))
    for stiffness in (700.0, 800.0):
        changes.request({"wall.stiffness": stiffness})
    assert [period for period, _ in run_to(changes, 10, 20)] == [10]
    held, changes._cycle = changes._cycle, None  # time goes on in a gap, and no law is called
    assert held is not None
    assert run_to(changes, 20, 25) == []
    changes._cycle = held
    assert [period for period, _ in run_to(changes, 25, 100)] == [45]


def test_a_run_that_ends_while_a_change_is_judged_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    changes = begun(Changes())
    judge = plan_change

    def slow(*given: Any, **named: Any) -> Any:
        changes.close(10.0)
        return judge(*given, **named)

    monkeypatch.setattr("haptic_fieldbus.running.changes.plan_change", slow)
    with pytest.raises(UsageError, match="the run ended while the change was judged; it was not made"):
        changes.request({"wall.stiffness": 700.0})
    assert not changes.waiting


def test_what_is_in_force_and_since_when_can_be_read() -> None:
    changes = begun(Changes())
    assert (changes.scene, changes.since) == (PLAN.scene, 0.0)
    asked = changes.request({"wall.stiffness": 800.0})
    assert changes.scene is PLAN.scene
    run_to(changes, 250, 251)
    assert changes.scene is asked.plan.scene
    assert changes.scene.elements == (Wall("handle", 800.0),)
    assert changes.since == pytest.approx(0.25)


def test_each_request_stands_on_those_before_though_they_wait() -> None:
    changes = begun(Changes())
    changes.request({"wall.stiffness": 800.0})
    assert changes.request({"wall.position": 0.01}).plan.scene.elements == (Wall("handle", 800.0, position=0.01),)


@pytest.mark.thorough("4 cases of one rule", quick=1)
@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"wall.stiffness": 90_000.0}, UnstableSceneError),
        ({"wall.stiffness": -1.0}, SceneError),
        ({"wall.damping": 2.0}, PlanError),
        ({"wall.colour": 2.0}, UsageError),
    ],
)
def test_a_refused_request_leaves_everything_as_it_was(settings: dict[str, float], error: type[Exception]) -> None:
    changes = begun(Changes())
    changes.request({"wall.stiffness": 800.0})
    with pytest.raises(error):
        changes.request(settings)
    assert run_to(changes, 1, 1000) == [(1, {"wall.stiffness": 800.0})]
    assert changes.request({"wall.position": 0.01}).plan.scene.elements == (Wall("handle", 800.0, position=0.01),)


def test_all_that_is_scheduled_is_checked_in_the_order_of_time_on_top_of_each_other() -> None:
    changes = Changes([(2.0, {"wall.stiffness": 700.0}), (1.0, {"wall.position": 0.01})])
    planned = changes.check(PLAN, 10.0, force=False)
    assert [change.time for change in planned] == [1.0, 2.0]
    assert planned[1].plan.scene.elements == (Wall("handle", 700.0, position=0.01),)


def test_a_schedule_with_an_impossible_change_is_refused_and_says_which() -> None:
    changes = Changes([(1.0, {"wall.stiffness": 700.0}), (2.0, {"wall.stiffness": 90_000.0})])
    with pytest.raises(UnstableSceneError, match="90000 N/m exceeds the limit") as refused:
        changes.check(PLAN, 10.0, force=False)
    assert refused.value.__notes__ == ["requested by the change at 2 s"]
    assert "Inside the limit: --change 2:wall.stiffness=870." in str(refused.value)


def test_force_lets_both_schedule_and_requests_pass() -> None:
    changes = Changes([(1.0, {"wall.stiffness": 90_000.0})])
    changes.check(PLAN, 10.0, force=True)
    changes.open(Cycle(PLAN))
    run_to(changes, 1, 1101)
    assert changes.request({"wall.stiffness": 95_000.0}).settings == {"wall.stiffness": 95_000.0}


def test_times_that_no_run_has_are_refused_all_at_once() -> None:
    changes = Changes([(0.0, {}), (float("nan"), {}), (10.0, {}), (1.0, {})], ramp=0.0)
    with pytest.raises(UsageError) as refused:
        changes.check(PLAN, 10.0, force=False)
    assert str(refused.value).splitlines() == [
        "ramp 0: expected a time above 0 s, at most 1e6 s",
        "change at 0 s: expected a time above 0 s and below the duration, 10 s",
        "change at nan s: expected a time above 0 s and below the duration, 10 s",
        "change at 10 s: expected a time above 0 s and below the duration, 10 s",
    ]


def test_requests_are_for_the_time_of_a_run() -> None:
    changes = Changes()
    with pytest.raises(UsageError, match="these changes belong to no run yet"):
        _ = changes.scene
    with pytest.raises(UsageError, match="no run uses these changes"):
        changes.request({"wall.stiffness": 800.0})
    begun(changes).close(10.0)
    with pytest.raises(UsageError, match="no run uses these changes"):
        changes.request({"wall.stiffness": 800.0})
    with pytest.raises(UsageError, match="belong to another run"):
        begun(changes)


def test_what_was_due_and_never_began_is_returned_at_the_end() -> None:
    changes = begun(Changes([(1.0, {"wall.stiffness": 700.0}), (1.05, {"wall.stiffness": 800.0})]))
    run_to(changes, 1, 1060)
    assert [dict(change.settings) for change in changes.close(1.06)] == [{"wall.stiffness": 800.0}]


def test_while_scheduled_changes_are_to_come_nobody_else_changes_what_they_were_judged_on() -> None:
    changes = begun(Changes([(1.0, {"wall.stiffness": 700.0})]))
    with pytest.raises(UsageError, match="scheduled changes are pending, up to 1 s"):
        changes.request({"wall.stiffness": 800.0})
    run_to(changes, 1, 1001)
    assert changes.request({"wall.stiffness": 800.0}).settings == {"wall.stiffness": 800.0}


def test_requests_of_several_threads_are_all_made_each_on_top_of_the_last() -> None:
    changes = begun(Changes(ramp=0.001))
    settings = [{"wall.stiffness": 600.0 + k} for k in range(1, 9)]
    threads = [Thread(target=changes.request, args=(each,)) for each in settings]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    made = run_to(changes, 1, 20)
    values = [float(each["wall.stiffness"]) for _, each in made]
    assert sorted(values) == [each["wall.stiffness"] for each in settings]
    assert changes.scene.elements == (Wall("handle", values[-1]),)


@dataclass(frozen=True)
class Breaks:
    """A spring whose law raises once it is armed."""

    axis: str
    stiffness: float
    name: str = "spring"
    armed: ClassVar[list[bool]] = []
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    def force(self, position: float) -> float:
        if self.armed:
            raise LookupError("no such place")
        return -self.stiffness * position

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


def test_a_law_that_raises_while_it_is_tried_ends_the_run_as_a_trip_with_its_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    make = Changes.make

    def armed(self: Changes, *instants: int) -> None:
        if instants[0] >= 200_000_000:
            Breaks.armed.append(True)
        make(self, *instants)

    monkeypatch.setattr(Changes, "make", armed)
    monkeypatch.setattr(Breaks, "armed", [])
    with pytest.raises(SafetyTripError, match="no such place") as tripped:
        run(scene_of(Breaks("handle", 400.0)), duration=0.5, changes=[(0.2, {"spring.stiffness": 300.0})])
    result = tripped.value.result
    assert isinstance(result, Result)
    assert result.cycles == pytest.approx(200, abs=1)
    assert "the result is incomplete: LookupError: no such place" in result.warnings
