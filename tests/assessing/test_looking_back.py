"""Runs look back: no library scene on its own bench is contradicted, and one whose rig is wrong by three is."""

import math
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus.api import Trial, plan, prepare_run, run
from haptic_fieldbus.assessing.looking_back import Contradiction, contradictions, noted, seen_values
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.errors import SafetyTripError, UnstableSceneError
from haptic_fieldbus.identification.estimates import Estimate
from haptic_fieldbus.identification.experiment import Experiment, Stage
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.hand import Hand, Piece
from tests.api.test_identification import rig_text
from tests.identification.benches import Bench, conducted, plant_of_bench

BENCH = Bench(ShaftModel(4e-5, 1e-4, 2e-3, 4e-4, 1.6e-4), 4096, 1000.0, 0.1, 50.0, 6.0)


# What a record shows, on a plant of the simulation.


class Released(Experiment):
    """A spring that lets the shaft go from a place; another force, which the record does not show, acts beside it."""

    other = 0.0
    """Strength of the other force [N·m]."""

    def _all(self) -> Stage:
        for number in range(1500):
            yield -0.02 * (self.place - 2.5) + self.other * math.sin(0.03 * number)


def shown(other: float, coulomb: float = 2e-3) -> list[tuple[float, float, float, float]]:
    """Return inertia and damping of each window that counts, each with its upper end, in shares of the true ones."""
    bench = replace(BENCH, model=replace(BENCH.model, coulomb=coulomb))
    law = Released(bench.bounds)
    law.other = other
    record = conducted(law, bench, plant_of_bench(bench)).record
    hidden = other * np.sin(0.03 * np.arange(len(record.torques)))
    record = replace(record, torques=tuple((np.array(record.torques) - hidden).tolist()))
    found = list(seen_values(record, bench.model.delay + bench.model.lag))
    pairs = [(each.inertia, each.viscous_damping) for each in found]
    return [(j.value / 4e-5, j.high / 4e-5, b.value / 1e-4, b.high / 1e-4) for j, b in pairs]


def test_a_shaft_that_swings_on_a_known_spring_shows_its_inertia_and_damping() -> None:
    found = shown(0.0)
    assert len(found) > 10
    for inertia, most, damping, highest in found:
        assert inertia == pytest.approx(1.0, abs=most - inertia + 0.01)
        assert damping == pytest.approx(1.0, abs=highest - damping + 0.1)
    best = min(found, key=lambda each: each[3] - each[2])
    assert best[0] == pytest.approx(1.0, rel=0.02)
    assert best[2] == pytest.approx(1.0, rel=0.15)


def test_a_force_that_the_record_does_not_show_leaves_no_window() -> None:
    assert shown(0.01) == []


def test_a_hand_that_drives_the_shaft_by_its_speed_shows_no_damping_of_0() -> None:
    """A torque along the speed is a damping below 0, -4e-4 N·m·s/rad here beside 1e-4 of the bench."""
    bench = replace(BENCH, model=replace(BENCH.model, damping=-3e-4))
    record = conducted(Released(bench.bounds), bench, plant_of_bench(bench)).record
    assert list(seen_values(record, bench.model.delay + bench.model.lag)) == []


@pytest.mark.thorough("runs a bench for 20 s")
def test_a_hand_that_shakes_the_handle_contradicts_no_correct_bench(tmp_path: Path) -> None:
    rig = rig_for("wall", tmp_path)
    rig.write_text(rig.read_text(encoding="utf-8").replace("[-0.1, 0.1]", "[-0.15, 0.15]"), encoding="utf-8")
    result = run("wall", rig, hand="shake", duration=20.0, settings={"wall.stiffness": 120.0})
    assert not any("this run shows" in each for each in result.warnings)


def test_a_record_that_is_too_short_or_at_rest_shows_nothing() -> None:
    record = conducted(Released(BENCH.bounds), BENCH, plant_of_bench(BENCH)).record
    assert list(seen_values(replace(record, positions=record.positions[:200], torques=record.torques[:200]), 0.0)) == []
    still = replace(record, positions=(0.0,) * 2000, torques=(0.0,) * 2000)
    assert list(seen_values(still, 0.0)) == []


# Runs on simulated benches.

AXIS = """
[axis.{name}]
bus = "here"
node = {node}
profile = "maxon_epos4"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = {inertia}
viscous_damping = {damping}
coulomb_friction = 2.0e-3
mechanism = {mechanism}
limits = {limits}
simulation = {{ inertia = 4.0e-5, viscous_damping = 1.0e-4 }}
"""
KINDS = {
    Workspace.LINEAR: (
        '{ kind = "linear", metres_per_revolution = 0.05 }',
        "{ speed = 10.0, position = [-0.1, 0.1] }",
    ),
    Workspace.ROTARY: ('{ kind = "rotary", gear_ratio = 1.0 }', "{ speed = 1.0e4 }"),
}


def rig_for(scene: str, folder: Path, inertia: float = 1.0, damping: float = 1.0) -> Path:
    """Write a rig for a scene that states these multiples of the true values."""
    text = '[bus.here]\ninterface = "haptic_sim"\nchannel = "bench"\n'
    for place, axis in enumerate(load_scene(scene).axes):
        mechanism, limits = KINDS[axis.workspace]
        text += AXIS.format(
            name=axis.name, node=5 + place, inertia=inertia * 4e-5, damping=damping * 1e-4, mechanism=mechanism,
            limits=limits,
        )  # fmt: skip
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def found_in(scene: str, rig: Path, hand: str | None = None) -> set[str]:
    """Run a scene for 4 s and return the values that the run contradicts."""
    session, place = prepare_run(Task(scene, rig), Trial(duration=4.0, hand=hand, force=True))
    with suppress(SafetyTripError):  # of a handle that a hand throws against the end of its travel
        session.render(place)
    begin_ns = session.report.enabled_at_ns
    assert begin_ns is not None
    return {each.key for each in contradictions(session.plan, session.kept, begin_ns)}


@pytest.mark.thorough("runs every scene of the library", quick=1)
@pytest.mark.parametrize("scene", scene_names())
def test_no_scene_on_a_bench_as_its_rig_states_it_is_contradicted(scene: str, tmp_path: Path) -> None:
    assert found_in(scene, rig_for(scene, tmp_path)) == set()


@pytest.mark.thorough("runs six scenes whose handle is released", quick=("wall",))
@pytest.mark.parametrize("scene", ["wall", "damped_wall", "end_stops", "kelvin_voigt", "hunt_crossley", "spring"])
def test_a_value_that_is_stated_three_times_too_large_is_found_when_the_handle_is_released(
    scene: str, tmp_path: Path
) -> None:
    assert found_in(scene, rig_for(scene, tmp_path, damping=3.0), "release") == {"viscous_damping"}
    assert found_in(scene, rig_for(scene, tmp_path, inertia=3.0), "release") == {"inertia"}


# The note in the rig, and the next run.


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A rig that states three times the true damping."""
    path = tmp_path / "rig.toml"
    path.write_text(rig_text("viscous_damping = 1.0e-4"), encoding="utf-8")
    return path


def released(bench: Path) -> Result:
    return run("wall", bench, hand="release", duration=3.2)


def test_a_run_tells_the_contradiction_and_the_next_one_is_refused_until_the_rig_changes(bench: Path) -> None:
    before = bench.read_text(encoding="utf-8")
    (told,) = released(bench).warnings
    assert "this run shows a damping of" in told
    assert "the rig has 0.3 mN·m·s/rad (stated)" in told
    after = bench.read_text(encoding="utf-8")
    assert after.startswith(before)
    note = load_rig(bench).axis["handle"].contradicted
    assert note.simulated
    assert note.viscous_damping_interval is not None
    assert note.viscous_damping_interval[0] < 1e-4 < note.viscous_damping_interval[1]
    stiff = {"wall.stiffness": 2000.0}
    with pytest.raises(UnstableSceneError, match=r"showed damping .* where the rig has 0\.3 mN·m·s/rad"):
        run("wall", bench, hand="none", duration=0.05, settings=stiff)
    bench.write_text(after.replace("viscous_damping = 3.0e-4", "viscous_damping = 3.1e-4"), encoding="utf-8")
    assert run("wall", bench, hand="none", duration=0.05, settings=stiff).cycles == 50


def test_a_rig_that_cannot_be_written_is_told(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "it is read-only")

    monkeypatch.setattr("haptic_fieldbus.documents.edits.edit_file", refuse)
    assert released(bench).warnings[1] == f"this was not noted in {bench}: it is read-only"


def test_a_rig_made_in_python_and_a_run_on_the_shipped_bench_do_not_look_back(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[object] = []

    def look(plan: object, *_: object) -> list[object]:
        looked.append(plan)
        return []

    monkeypatch.setattr("haptic_fieldbus.assessing.looking_back.contradictions", look)
    run("wall", load_rig(bench), hand="none", duration=0.05)
    run("wall", hand="none", duration=0.05)
    assert looked == []
    run("wall", bench, hand="none", duration=0.05)
    assert len(looked) == 1


@pytest.mark.thorough("runs a bench for 80 s")
@pytest.mark.parametrize("seed", [pytest.param(each, id=str(each)) for each in range(4)])
def test_a_hand_that_plays_with_a_spring_contradicts_no_correct_bench(seed: int, tmp_path: Path) -> None:
    """It leads the handle by eight waves up to 2 Hz; a fit of a window leaves only noise."""
    assert run("spring", rig_for("spring", tmp_path), hand=player(seed), duration=20.0).warnings == ()


def player(seed: int) -> Hand:
    """A hand of 1 t, which nothing disturbs, on a smooth way of 3 cm to each side; it starts at rest."""
    random, every, mass = np.random.default_rng(seed), 0.02, 1000.0
    times = np.arange(0.0, 20.0, every / 10.0)
    rates, shares, phases = random.uniform(2.0, 12.0, 8), random.normal(size=8), random.uniform(0.0, 6.0, 8)
    way = np.sin(times[:, None] * rates + phases) @ shares
    way *= 0.03 / np.abs(way).max() * np.sin(0.5 * np.pi * np.minimum(times, 1.0)) ** 4
    forces = mass * np.gradient(np.gradient(way, times), times)[::10]
    pieces = [
        Piece(every * at, float(force), float(after - force) / every)
        for at, (force, after) in enumerate(pairwise(forces))
    ]
    return Hand("player", tuple(pieces), mass=mass)


def noting(rig: Path, key: str, value: float, bus: str | None = None) -> float:
    """Note a value of a run on a rig, and return the limit of the next plan."""
    seen = Estimate(value, 0.9 * value, 1.1 * value, "kg·m²" if key == "inertia" else "N·m·s/rad")
    list(noted(plan("wall", rig, bus=bus), iter([Contradiction("handle", key, 1.0, "stated", seen)])))
    return limit(rig)


def limit(rig: Path, bus: str | None = None) -> float:
    verdict = plan("wall", rig, bus=bus).axis("handle").stability
    assert verdict is not None
    return verdict.limit.value


def test_a_second_note_keeps_the_first(bench: Path) -> None:
    without = limit(bench)
    first = noting(bench, "viscous_damping", 1e-4)
    assert first < without
    assert noting(bench, "inertia", 1e-5) <= first
    note = load_rig(bench).axis["handle"].contradicted
    assert (note.viscous_damping, note.inertia) == (1e-4, 1e-5)


def test_a_note_of_the_simulation_takes_the_place_of_none_of_a_real_bench(bench: Path) -> None:
    text = bench.read_text(encoding="utf-8").replace('"haptic_sim"', '"socketcan"')
    bench.write_text(text, encoding="utf-8")
    real = noting(bench, "viscous_damping", 1e-4)
    before = bench.read_text(encoding="utf-8")
    assert noting(bench, "inertia", 1e-5, "sim") == real
    assert bench.read_text(encoding="utf-8") == before
    assert limit(bench, "sim") == real
