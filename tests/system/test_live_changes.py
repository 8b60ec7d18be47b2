"""Changes of a running scene on the simulated bus: what is rendered after, what is refused, and that nothing jumps."""

import math
import sys
from threading import Thread

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus import Changes, Result
from haptic_fieldbus.api import run
from haptic_fieldbus.errors import PlanError, UnstableSceneError
from haptic_fieldbus.running.loop import GIVE_WAY
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim import faults
from tests.builders import endless_rig

Array = NDArray[np.float64]
SURFACE = 0.02
"""[m]; where the wall of the library is."""
STEP = 0.4e-3 / (0.05 / (2 * math.pi))
"""[N]; one step of the drive's target torque."""


def rows_of(path: object) -> dict[str, Array]:
    """A recorded run by the names of its columns."""
    table = np.genfromtxt(str(path), delimiter=",", names=True, deletechars="", replace_space=" ")
    names = table.dtype.names
    assert names is not None
    return {name: table[name] for name in names}


def rendered(tmp_path: object, scene: str = "wall", **options: object) -> tuple[Result, dict[str, Array]]:
    """A run, and what it recorded from operation enabled on."""
    path = f"{tmp_path}/run.csv"
    result = run(scene, record=path, **options)  # type: ignore[arg-type]
    rows = rows_of(path)
    assert result.cycles is not None
    return result, {name: column[-result.cycles :] for name, column in rows.items()}


def slope(rows: dict[str, Array], first: int, last: int) -> float:
    """Stiffness that was rendered in these periods [N/m], by Hooke's law on what was recorded."""
    position, force = rows["handle.position"][first:last] - SURFACE, rows["handle.command"][first:last]
    inside = position > 1e-3
    return float(-(force[inside] @ position[inside]) / (position[inside] @ position[inside]))


def test_a_stiffness_that_is_raised_live_is_what_the_handle_feels_after_the_ramp(tmp_path: object) -> None:
    result, rows = rendered(tmp_path, duration=3.0, changes=[(1.0, {"wall.stiffness": 900.0})])
    assert slope(rows, 800, 1000) == pytest.approx(600.0, rel=0.01)
    assert slope(rows, 1100, 3000) == pytest.approx(900.0, rel=0.01)
    assert [(change.time, change.settings) for change in result.changes] == [(1.0, {"wall.stiffness": 900.0})]
    assert result.to_json()["changes"] == [{"t_s": 1.0, "settings": {"wall.stiffness": 900.0}}]


@pytest.mark.thorough("a long run")
def test_the_ramp_takes_a_tenth_of_a_second_and_its_share_rises_straight(tmp_path: object) -> None:
    _, rows = rendered(tmp_path, duration=2.0, changes=[(1.5, {"wall.stiffness": 900.0})])
    stiffness = -rows["handle.force"] / (rows["handle.position"] - SURFACE)
    share = (stiffness[1499:1602] - 600.0) / 300.0
    assert share == pytest.approx(np.clip(np.arange(103) / 100, 0.0, 1.0), abs=1e-9)


@pytest.mark.thorough("a long run")
def test_no_step_of_the_command_is_larger_than_motion_and_ramp_explain(tmp_path: object) -> None:
    """|ΔF| ≤ K·|Δx| + |ΔK|·x/N and one step of the drive."""
    _, rows = rendered(tmp_path, duration=2.0, changes=[(1.5, {"wall.stiffness": 1400.0})])
    depth = np.maximum(rows["handle.position"] - SURFACE, 0.0)[1400:]
    step = np.abs(np.diff(rows["handle.command"][1400:]))
    assert np.all(step <= 1400.0 * np.abs(np.diff(depth)) + 800.0 * depth[:-1] / 100 + STEP)
    jump = 800.0 * depth[100]
    assert step.max() < 0.1 * jump


@pytest.mark.thorough("a long run")
def test_damping_that_is_changed_live_is_what_the_handle_feels(tmp_path: object) -> None:
    """Force beyond Hooke's law, over the velocity that was estimated."""
    _, rows = rendered(tmp_path, "damped_wall", duration=1.5, changes=[(0.9, {"wall.damping": 9.0})])
    wall = vars(load_scene("damped_wall").elements[0])
    for part, damping in ((slice(600, 900), wall["damping"]), (slice(1000, 1500), 9.0)):
        depth, force, velocity = (rows[f"handle.{name}"][part] for name in ("position", "force", "velocity"))
        inside = (depth > SURFACE) & (force < 0.0) & (np.abs(velocity) > 0.01)
        felt = -force[inside] - wall["stiffness"] * (depth[inside] - SURFACE)
        assert inside.sum() > 20
        assert felt / velocity[inside] == pytest.approx(np.full(inside.sum(), damping))


@pytest.mark.thorough("a long run")
def test_two_changes_follow_one_another(tmp_path: object) -> None:
    changes = [(1.0, {"wall.stiffness": 900.0}), (1.5, {"wall.stiffness": 300.0})]
    result, rows = rendered(tmp_path, duration=2.5, changes=changes)
    assert slope(rows, 1100, 1500) == pytest.approx(900.0, rel=0.01)
    assert slope(rows, 1600, 2500) == pytest.approx(300.0, rel=0.01)
    assert [change.time for change in result.changes] == [1.0, 1.5]


@pytest.mark.thorough("two long runs", quick=("other thread",))
@pytest.mark.parametrize("threaded", [False, True], ids=["own thread", "other thread"])
def test_a_request_while_the_loop_runs_holds_from_the_next_period_on(tmp_path: object, threaded: bool) -> None:
    changes = Changes()

    def progress(done: int, total: int) -> None:
        if done != 1000:
            return
        assert sys.getswitchinterval() == pytest.approx(GIVE_WAY)
        if threaded:
            thread = Thread(target=changes.request, args=({"wall.stiffness": 900.0},))
            thread.start()
            thread.join()
        else:
            changes.request({"wall.stiffness": 900.0})

    result, rows = rendered(tmp_path, duration=2.0, changes=changes, progress=progress)
    assert slope(rows, 1100, 2000) == pytest.approx(900.0, rel=0.01)
    assert [change.time for change in result.changes] == [1.0]
    assert changes.since == 1.0


def test_an_unstable_request_is_refused_and_the_old_value_stays(tmp_path: object) -> None:
    changes = Changes()
    refused: list[UnstableSceneError] = []

    def progress(done: int, total: int) -> None:
        if done == 1000:
            with pytest.raises(UnstableSceneError, match="90000 N/m exceeds the limit of 750 N/m") as error:
                changes.request({"wall.stiffness": 90_000.0})
            refused.append(error.value)

    result, rows = rendered(tmp_path, duration=2.0, changes=changes, progress=progress)
    assert refused[0].limit is not None
    assert slope(rows, 1000, 2000) == pytest.approx(600.0, rel=0.01)
    assert result.changes == ()


def test_a_schedule_that_cannot_be_is_refused_before_anything_moves() -> None:
    announced: list[object] = []
    with pytest.raises(UnstableSceneError) as refused:
        run("wall", changes=[(1.0, {"wall.stiffness": 90_000.0})], announce=announced.append)
    assert announced == []
    assert isinstance(refused.value.result, Result)
    with pytest.raises(PlanError, match="does not estimate"):
        run("wall", changes=[(1.0, {"wall.damping": 2.0})])


@pytest.mark.thorough("long runs")
def test_a_changed_run_is_compared_with_the_ideal_in_force_at_each_time() -> None:
    """A wall that is asked to be what it is has the error of one that nobody touched; one that changes has no more."""
    plain = run("wall", duration=2.0)
    same = run("wall", duration=2.0, changes=[(1.5, {"wall.stiffness": 600.0})])
    other = run("wall", duration=2.0, changes=[(1.5, {"wall.stiffness": 700.0})])
    assert plain.torque_error is not None
    assert same.torque_error == plain.torque_error
    assert other.torque_error is not None
    assert other.torque_error.max == pytest.approx(plain.torque_error.max)
    assert other.torque_error.rms == pytest.approx(plain.torque_error.rms, rel=0.2)
    assert sum(other.torque_error.by_source.values()) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.thorough("a long run")
def test_a_sprung_mass_begins_afresh_and_is_compared_with_an_ideal_that_does_so_too() -> None:
    change = {"sprung_mass.stiffness": 150.0, "sprung_mass.mass": 0.2}
    result = run("sprung_mass", endless_rig("sprung_mass"), duration=3.0, hand="sine", changes=[(1.5, change)])
    assert result.torque_error is not None
    assert result.torque_error.contact is not None
    assert result.torque_error.contact < 0.08
    assert result.changes[0].settings == change


@pytest.mark.thorough("two long runs of a coupling")
def test_a_coupling_that_changes_has_no_more_error_than_one_that_stays() -> None:
    axes = tuple(SceneAxis(name, Workspace.LINEAR) for name in ("left", "right"))
    elements = (Coupling(("left", "right"), 300.0), Wall("right", 400.0, position=0.02))
    scene = Scene("pair", "for tests", axes, elements)
    plain, changed = (run(scene, duration=2.0, changes=each) for each in ([], [(1.0, {"coupling.stiffness": 150.0})]))
    assert plain.torque_error is not None
    assert changed.torque_error is not None
    assert changed.torque_error.max == pytest.approx(plain.torque_error.max)
    assert changed.torque_error.rms == pytest.approx(plain.torque_error.rms, rel=0.2)


@pytest.mark.thorough("a long run")
@pytest.mark.parametrize("change", [{"wall.stiffness": 1400.0}, {"wall.position": 0.01}], ids=["stiffer", "nearer"])
def test_a_change_amid_a_long_gap_in_contact_never_gives_more_than_before_the_gap(
    tmp_path: object, change: dict[str, float]
) -> None:
    """20 ms without feedback, and a wall that asks for more from then on: the cap holds until contact is left."""
    lost = faults.MissingTpdos("missing_tpdos", 3.0, 20)
    rig = endless_rig("wall")
    result, rows = rendered(tmp_path, rig=rig, duration=6.0, changes=[(3.005, change)], faults=[lost])
    assert result.trips == ()
    before = np.abs(rows["handle.command"][2900:3000]).max()
    assert np.abs(rows["handle.force"][3100:]).max() > 1.5 * before, "what the wall asks for"
    assert np.abs(rows["handle.command"][3000:]).max() <= before + STEP


@pytest.mark.thorough("a long run")
def test_a_change_amid_a_doubt_about_the_sign_gives_no_more_than_a_hand_may_hold(tmp_path: object) -> None:
    blow = faults.HandHit("hand_hit", 1.5, 100.0, 0.02)
    rig = endless_rig("wall")
    changes = [(at, {"wall.stiffness": stiffness}) for at, stiffness in ((1.7, 1400.0), (2.5, 300.0), (3.0, 1200.0))]
    _, rows = rendered(tmp_path, rig=rig, duration=4.0, changes=changes, faults=[blow])
    assert np.abs(rows["handle.command"][1600:]).max() <= 0.1 * 50.3 + STEP, "5 N of the pulses, 2.5 N from then on"
    assert np.abs(rows["handle.command"][2400:]).max() <= 0.05 * 50.3 + STEP


EFFORT = 0.4 * 2.0 * math.pi / 0.05
"""[N]; the limit of the shipped bench: its rated torque at the handle."""


def test_a_wall_that_is_moved_past_the_handle_waits_instead_of_throwing_it(tmp_path: object) -> None:
    """Before, it came within the ramp: up to 25 N on a hand that leaned with 6 N."""
    result, rows = rendered(tmp_path, duration=3.0, changes=[(2.0, {"wall.position": -0.06})])
    assert (result.trips, result.changes) == ((), ())
    assert np.abs(rows["handle.command"][2000:]).max() <= 6.5
    assert [sentence for sentence in result.warnings if sentence.startswith("the change of wall.position was not made")]


def test_several_changes_that_still_wait_are_told_in_one_sentence(tmp_path: object) -> None:
    asked = [{"wall.position": -0.06}, {"wall.stiffness": 500.0}, {"wall.position": -0.07}]
    result, _ = rendered(tmp_path, duration=2.5, changes=[(2.0, each) for each in asked])
    (told,) = [sentence for sentence in result.warnings if "not made" in sentence]
    assert told.startswith("3 changes, of wall.position, wall.stiffness, were not made. A change waits for the end")


def test_it_comes_once_it_changes_the_force_at_the_handle_by_a_quarter_of_the_limit_at_most(tmp_path: object) -> None:
    moved = -0.005
    result, rows = rendered(tmp_path, hand="release", duration=4.0, changes=[(1.5, {"wall.position": moved})])
    (made,) = result.changes
    assert made.time > 2.0, "the hand lets go 2 s after it began"
    period = round(made.time * 1e3)
    wall = np.maximum(rows["handle.position"] - moved, 0.0) - np.maximum(rows["handle.position"] - SURFACE, 0.0)
    assert (600.0 * wall[1500 : period - 1] > 0.25 * EFFORT).all()
    assert 600.0 * wall[period] <= 0.25 * EFFORT
