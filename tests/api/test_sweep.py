"""Sweeps beside the single calls that they stand for, and every way to end one early."""

import json
import math
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus import Result, Sweep, UsageError, run, stability, sweep
from haptic_fieldbus.api import sweep_folder
from haptic_fieldbus.api.stability_limits import judge_scene
from haptic_fieldbus.api.sweep_folder import HOST, SweepPoints
from haptic_fieldbus.documents.own_parts import OwnName, content_digest
from haptic_fieldbus.drive.rig import Identified
from haptic_fieldbus.margins.closed_loop import environment_of
from haptic_fieldbus.numerics.estimators import Estimator
from haptic_fieldbus.numerics.estimators.estimator import EstimatorSetup
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.sim.hand import Hand, Piece

WALLS = {"wall.stiffness": [50.0, 600.0, 2500.0, 60000.0], "wall.damping": [0.0, 3.0, 40.0]}


@pytest.fixture
def usual_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def rows(found: Sweep) -> list[dict[str, Any]]:
    told: list[dict[str, Any]] = found.to_arrow().to_pylist()
    return told


def equal(one: Sweep, other: Sweep) -> bool:
    return bool(one.to_arrow().equals(other.to_arrow()))


@pytest.mark.thorough("9 plans", quick=3)
@pytest.mark.parametrize("rendering", [{}, {"rate": 500.0}, {"estimator": "low-pass"}], ids=str)
@pytest.mark.parametrize("place", [{}, {"wall.sides": "bilateral"}, {"wall.side": "negative"}], ids=str)
def test_walls_that_share_a_plan_have_the_verdicts_of_single_ones(
    rendering: dict[str, Any], place: dict[str, Any]
) -> None:
    found = rows(sweep("wall", WALLS, settings=place, workers=1, **rendering))
    single = rows(sweep("wall", WALLS | {key: [value] for key, value in place.items()}, workers=1, **rendering))
    assert [row["verdict"] for row in found] == [row["verdict"] for row in single]
    for row in found[::5]:
        values = {name: row[name] for name in WALLS} | place
        told = stability("wall", settings=values, **rendering)
        assert row["verdict"] == told.nominal.value
        assert row["outcome"] == "done"


@pytest.mark.thorough("judges 300 walls one by one")
def test_random_walls_on_random_benches_have_the_verdicts_of_single_ones() -> None:
    """With growth and share of the damping, by the scalar forms, which this one shares no line with."""
    random = np.random.default_rng(31)
    points = [
        {
            "wall.stiffness": float(np.exp(random.uniform(0.0, 12.0))),
            "wall.damping": 0.0 if random.random() < 0.3 else float(random.uniform(0.0, 30.0)),
            "wall.position": float(random.choice([0.0, 0.05, -0.03, 0.1, -0.1])),
            "wall.side": str(random.choice(["positive", "negative"])),
            "wall.sides": str(random.choice(["unilateral", "bilateral"])),
            "rate": float(random.choice([1000.0, 500.0, 250.0])),
            "estimator": str(random.choice(["backward-difference", "low-pass", "least-squares"])),
        }
        for _ in range(300)
    ]
    kinds = set()
    for row in rows(sweep("wall", points)):
        values = {name: row[name] for name in points[0] if name.startswith("wall.")}
        task = Task("wall", rate=row["rate"], estimator=row["estimator"], settings=values)
        group = judge_scene(task).group
        kinds.add(row["verdict"])
        assert row["verdict"] == group.stability.nominal.value
        assert row["growth"] == pytest.approx(group.loop.growth(group.environment()), rel=1e-9)
        assert row["damping_share"] == pytest.approx(group.loop.damping_share(group.environment()), rel=1e-9)
    assert kinds == {"passive", "stable", "unstable"}


def test_growth_has_the_free_handle_beside_the_contact() -> None:
    """Outside of a damped wall the handle decays by its own friction, exp(-b·T/m) a period, and more slowly."""
    group = judge_scene(Task("damped_wall", settings={"wall.damping": 100.0})).group
    plant = group.members[0].plant
    (row,) = rows(sweep("damped_wall", {"wall.damping": [100.0]}, workers=1))
    assert row["growth"] == pytest.approx(math.exp(-plant.damping * group.period / plant.mass), rel=1e-9)
    assert row["growth"] > stability("damped_wall", settings={"wall.damping": 100.0}).spectral_radius


def test_other_scenes_have_a_plan_a_point_and_the_bench_is_a_parameter() -> None:
    points = {"sprung_mass.mass": [0.05, 2.0], "rig.handle.viscous_damping": [1e-6, 1e-4]}
    found = rows(sweep("sprung_mass", points, workers=1))
    for row in found:
        assert row["verdict"] in ("passive", "stable", "limit-cycle", "unstable")
    usual = rows(sweep("sprung_mass", {"sprung_mass.mass": [0.5]}, workers=1))
    assert usual[0]["verdict"] == stability("sprung_mass").nominal.value
    damped = rows(sweep("wall", {"rig.handle.viscous_damping": [0.0, 1.0]}, workers=1))
    assert [row["damping_share"] for row in damped] == [math.inf, pytest.approx(0.0, abs=1e-3)]


def test_a_value_that_is_varied_takes_the_place_of_a_measured_one() -> None:
    rig = load(Task("wall")).rig
    measured = Identified(viscous_damping=1e-4, viscous_damping_interval=(9e-5, 1.1e-4), digest="of the measured bench")
    rig = replace(rig, axis={name: replace(axis, identified=measured) for name, axis in rig.axis.items()})
    damped = rows(sweep("wall", {"rig.handle.viscous_damping": [0.0, 1.0]}, rig=rig, workers=1))
    assert [row["damping_share"] for row in damped] == [math.inf, pytest.approx(0.0, abs=1e-3)]


def test_refusals_are_rows() -> None:
    points = [
        {"wall.stiffness": stiffness, "wall.damping": 0.0, "rate": rate}
        for stiffness, rate in ((600.0, 1000.0), (-1.0, 1000.0), (math.nan, 1000.0), (600.0, 900.0), (1e300, 500.0))
    ]
    points += [{**points[0], "rate": rate} for rate in (0.0, -1000.0, math.nan, 1e9)]
    found = rows(sweep("wall", points, workers=1))
    assert [row["outcome"] for row in found] == ["done"] + ["refused"] * 8
    assert all("expected a rate above 0" in row["message"] for row in found[5:])
    assert "wall.stiffness: -1" in found[1]["message"]
    assert "does not support a period" in found[3]["message"]
    assert found[0]["message"] is None
    assert all(row["verdict"] is None and row["growth"] is None for row in found[1:])


def test_a_run_at_a_point_is_a_run() -> None:
    points = {"wall.stiffness": [100.0, 90000.0], "hand": ["push", "tap"]}
    found = rows(sweep("wall", points, engine="full", duration=0.6, workers=1))
    told = run("wall", settings={"wall.stiffness": 100.0}, hand="tap", duration=0.6)
    assert [row["outcome"] for row in found] == ["done", "done", "refused", "refused"]
    assert told.torque_error is not None
    assert found[1]["error_rms"] == told.torque_error.rms
    assert found[1]["energy_generated_j"] == told.energy_generated
    assert "exceeds the limit" in found[2]["message"]


def cycles(result: Result) -> dict[str, Any]:
    return {"cycles": np.int64(result.cycles or 0), "clock": result.clock}


def test_a_trip_is_a_row_and_a_measure_of_ones_own_is_kept() -> None:
    points = {"rig.handle.limits.speed": [1.0, 0.001]}
    found = rows(sweep("wall", points, engine="full", duration=0.6, measure=cycles, workers=1))
    assert (found[0]["outcome"], found[0]["cycles"]) == ("done", 600.0)
    assert found[1]["outcome"] == "tripped"
    assert found[1]["message"]
    assert found[1]["cycles"] < 600.0


def test_a_measure_that_fails_ends_the_sweep() -> None:
    def wrong(result: Result) -> dict[str, float]:
        raise ZeroDivisionError(result.scene)

    with pytest.raises(ZeroDivisionError, match="wall"):
        sweep("wall", {"seed": [1, 2]}, engine="full", duration=0.05, measure=wrong, workers=1)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        (3, "measure: expected a mapping of figures"),
        ({"outcome": 1.0}, "measure: figure 'outcome': expected a name that is neither"),
        ({"seed": 7}, "measure: figure 'seed'"),
        ({4: 7}, "measure: figure 4"),
        ({"felt": [1.0, 2.0]}, "measure: felt: expected a number"),
        ({"felt": np.ones(2)}, "measure: felt: expected a number"),
        ({"felt": 2**80}, "measure: felt: expected a number"),
        ({"growth": "much"}, "measure: growth: expected a number"),
    ],
)
def test_figures_that_are_no_part_of_a_row_name_the_measure(figures: Any, words: str) -> None:
    with pytest.raises((TypeError, UsageError), match=words):
        sweep("wall", {"seed": [1]}, engine="full", duration=0.05, measure=lambda _: figures, workers=1)


def test_a_measure_that_cannot_be_sent_says_so_before_it_runs() -> None:
    with pytest.raises(UsageError, match=r"measure: cannot be sent to another process.*or workers=1"):
        sweep("wall", {"seed": [1, 2]}, engine="full", duration=0.05, measure=lambda _: {}, workers=2)


@pytest.mark.thorough("starts processes", quick=1)
@pytest.mark.parametrize("lent", [None, 2])
def test_the_rows_are_the_same_whoever_computes_them(lent: int | None) -> None:
    points = {"wall.stiffness": np.linspace(1.0, 3000.0, 90), "wall.damping": (0.0, 5.0)}
    alone = sweep("wall", points, workers=1)
    with ThreadPoolExecutor(2) as executor:
        told: list[tuple[int, int]] = []
        other = sweep(
            "wall", points, workers=lent, executor=executor if lent is None else None, chunk=7,
            progress=lambda done, total: told.append((done, total)),
        )  # fmt: skip
    assert equal(alone, other)
    assert told[0] == (0, 180)
    assert told[-1] == (180, 180)
    assert alone.stable_fraction == other.stable_fraction
    assert multiprocessing.active_children() == []


@settings(deadline=None)
@given(sizes=st.lists(st.integers(1, 5), min_size=1, max_size=4), chunk=st.integers(1, 9), sample=st.integers(1, 40))
def test_points_are_the_same_in_any_chunks(sizes: list[int], chunk: int, sample: int) -> None:
    """Products in the order of `itertools.product`; a hypercube has one value in each part of each range."""
    values = {f"a.{place}": [float(each) for each in range(size)] for place, size in enumerate(sizes)}
    points = SweepPoints.of(values, None, 0)
    parts = [points.columns(at, min(at + chunk, points.count)) for at in range(0, points.count, chunk)]
    found = list(zip(*([each for part in parts for each in part[name]] for name in values), strict=True))
    assert found == list(product(*values.values()))
    drawn = SweepPoints.of({"a.b": (2.0, 4.0), "a.c": (0.1, 10.0, "log")}, sample, chunk).columns(0, sample)
    assert sorted(int((value - 2.0) / 2.0 * sample) for value in np.array(drawn["a.b"])) == pytest.approx(
        list(range(sample)), abs=1
    )
    shares = np.log10(np.array(drawn["a.c"]) / 0.1) / 2.0
    assert sorted(np.floor(shares * sample + 1e-9).astype(int).tolist()) == list(range(sample))


@pytest.mark.parametrize(
    ("points", "options", "words"),
    [
        ({"wall.stifness": [1.0]}, {}, 'no parameter "stifness".*nearest: stiffness'),
        ({"rig.handel.inertia": [1.0]}, {}, "rig.handel.inertia: expected rig.AXIS.KEY.*handle"),
        ({"rig.handle.inertial": [1.0]}, {}, 'no "inertial" there; nearest: inertia'),
        ({"rig.handle.simulation.coupling.stiffness": [1.0]}, {}, 'the rig has no "stiffness" there'),
        ({"hand": ["push"]}, {}, "hand: the engine verdict has no such parameter"),
        ({"wall.stiffness": range(10**9)}, {}, "1000000000 values; expected at most 10000000"),
        ({"wall.stiffness": []}, {}, "each with at least one value"),
        ({}, {}, "at least one parameter"),
        ([{"rate": 500.0}, {"wall.damping": 1.0}], {}, "the same parameters in every point"),
        ([{"rate": 500.0}], {"sample": 3}, "a list has its points already"),
        ({"wall.stiffness": (5.0, 1.0)}, {"sample": 3}, "in rising order"),
        ({"wall.stiffness": (0.0, 1.0, "log")}, {"sample": 3}, '"log" above 0'),
        ({"wall.stiffness": (1.0, 2.0)}, {"sample": 0}, "sample 0: expected a whole number from 1 up"),
        ({"rate": [500.0]}, {"engine": "fast", "chunk": 0}, 'chunk 0.*\nengine "fast": expected verdict'),
        ({"rate": [500.0]}, {"engine": "loop", "steps": 4}, "steps 4: expected 8 to"),
        ({"wall.damping": [1.0]}, {"rate": 0.0}, "rate 0: expected a rate above 0"),
        ({"wall.damping": [1.0]}, {"hand": "nope"}, 'no hand "nope"'),
        ({"wall.damping": [1.0]}, {"fade_in": -3.0}, "fade-in -3 s: expected"),
        ({"rate": [500.0]}, {"measure": cycles}, "only runs of the engine full"),
        ({"rate": [500.0]}, {"engine": "full", "bus": "socketcan:can9"}, "a sweep runs simulated drives alone"),
        ({"rate": [500.0]}, {"engine": "full", "duration": math.nan}, "expected a time above 0 s"),
        ({"a": [0.0] * 100_000, "b": [0.0] * 100_000}, {}, "10000000000 points: expected 1 to"),
    ],
)
def test_what_no_point_could_have_is_refused_before_anything_is_computed(
    points: Any, options: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=words):
        sweep("wall", points, out=tmp_path / "out", workers=1, **options)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ("wall.stiffness", "points: expected a mapping"),
        ({"wall.stiffness": "600"}, "points: wall.stiffness: expected a list of values"),
        ({"wall.stiffness": [None]}, "points: wall.stiffness: expected a number"),
        ({"method": {"rk4", "verlet"}}, "points: method: expected a list of values"),
        ({1: [1.0]}, "expected the name of a parameter"),
        ({"wall.stiffness": [2**80]}, "points: wall.stiffness: expected a number"),
        ({"wall.stiffness": np.ones((2, 2))}, "points: wall.stiffness: expected a number"),
        ({"rate": ["fast"]}, r"points: rate: expected a number in Hz, not 'fast' \(str\)"),
        ({"method": ["rk4", 3]}, r"points: method: expected a name or an Integrator, not 3 \(int\)"),
        ({"estimator": [3.0]}, "points: estimator: expected a name"),
    ],
)
def test_points_of_the_wrong_kind_name_the_argument(points: Any, words: str) -> None:
    with pytest.raises(TypeError, match=words):
        sweep("wall", points)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"executor": 3}, "executor: expected an Executor, not 3"),
        ({"sample": 2.5}, "sample: expected a whole number"),
        ({"steps": "9"}, "steps: expected a whole number, not '9'"),
        ({"chunk": 1.5}, "chunk: expected a whole number"),
        ({"workers": 1.5}, "workers: expected a whole number"),
        ({"out": 3}, "out: expected a path"),
        ({"engine": []}, "engine: expected a name"),
        ({"scheduler": 3}, "scheduler: expected a name"),
        ({"engine": "full", "measure": 3}, "measure: expected a function"),
    ],
    ids=str,
)
def test_options_of_the_wrong_kind_name_the_argument(given: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=rf"sweep\(\) {words}"):
        sweep("wall", {"wall.stiffness": [600.0]}, **given)


# The engine `loop`.


FINE = {"rig.handle.encoder_counts_per_revolution": [2**28]}
"""An encoder whose counts are too small to count."""


@pytest.mark.parametrize(
    ("scene", "values"),
    [
        ("wall", {"wall.stiffness": 900.0}),
        ("damped_wall", {"wall.stiffness": 2000.0, "wall.damping": 5.0}),
        ("wall", {"wall.stiffness": 1700.0}),
        ("kelvin_voigt", {}),
        ("standard_linear_solid", {}),
    ],
)
def test_a_simulated_loop_is_that_of_scipy(scene: str, values: dict[str, float]) -> None:
    """By `dlsim` of the matrix of a period, which the batch does not use."""
    steps = 1200
    points = {name: [value] for name, value in values.items()} | FINE
    (row,) = rows(sweep(scene, points, engine="loop", steps=steps, workers=1))
    group = judge_scene(Task(scene, settings=values)).group
    (member,) = group.members
    environment = environment_of(member.elements, group.period, member.method, member.estimator)
    matrix = group.loop.matrix(environment)
    order = len(matrix)
    system = scipy.signal.dlti(matrix, np.zeros((order, 1)), np.eye(order)[:1], np.zeros((1, 1)), dt=group.period)
    _, positions, _ = scipy.signal.dlsim(system, np.zeros(steps), x0=np.eye(order)[1])
    peaks = [float(np.abs(part).max()) for part in np.split(positions[:, 0], 4)]
    assert row["outcome"] == "done"
    assert row["peak"] == pytest.approx(max(peaks), rel=1e-5)
    assert row["last"] == pytest.approx(peaks[3], rel=1e-4)
    assert row["grew"] is (peaks[3] > peaks[1])
    assert row["growth"] == pytest.approx((peaks[3] / peaks[1]) ** (2.0 / steps), rel=1e-6)


@pytest.mark.thorough("simulates 400 loops of 4000 periods", quick=("backward-difference",))
@pytest.mark.parametrize("estimator", ["backward-difference", "low-pass", "least-squares"])
def test_loops_grow_where_the_verdict_says_unstable(estimator: str) -> None:
    points = {"wall.stiffness": np.geomspace(300.0, 20000.0, 20), "wall.damping": np.linspace(0.0, 15.0, 20)}
    loops = rows(sweep("wall", points | FINE, engine="loop", steps=4000, estimator=estimator))
    verdicts = rows(sweep("wall", points | FINE, estimator=estimator))
    apart = [
        (one["grew"], other["verdict"] == "unstable")
        for one, other in zip(loops, verdicts, strict=True)
        if abs(other["growth"] - 1.0) > 2e-4
    ]
    assert len(apart) > 300
    assert {grew for grew, _ in apart} == {True, False}
    assert [pair for pair in apart if pair[0] != pair[1]] == []


def test_a_loop_does_not_depend_on_the_loops_beside_it() -> None:
    points = {
        "rate": [1000.0, 500.0, 333.0],
        "wall.stiffness": np.linspace(100.0, 2000.0, 5),
        "wall.damping": [0.0, 2.0],
    }
    options: dict[str, Any] = {"engine": "loop", "steps": 1200, "workers": 1}
    together = sweep("wall", points, **options)
    assert equal(together, sweep("wall", points, chunk=1, **options))
    assert equal(together, sweep("wall", points, chunk=7, **options))
    assert together.loop_steps == 36_000
    assert together.loop_steps_per_s is not None
    assert together.outcomes == {"done": 20, "refused": 10, "tripped": 0}


@pytest.mark.parametrize("steps", [16, 60, 200, 400, 1000, 4000])
def test_a_passive_wall_never_grows_however_few_the_steps_are(steps: int) -> None:
    """Half of a swing takes π·√(m/K) seconds, about, which must fit into a quarter of the steps of 1 ms."""
    points = {"wall.stiffness": np.geomspace(50.0, 1200.0, 20)} | FINE
    assert {row["verdict"] for row in rows(sweep("wall", points, workers=1))} == {"passive"}
    found = rows(sweep("wall", points, engine="loop", steps=steps, workers=1))
    assert not any(row["grew"] for row in found)
    (member,) = judge_scene(Task("wall")).group.members
    for row in found:
        least = 4e3 * math.pi * math.sqrt(member.plant.mass / row["wall.stiffness"])
        if abs(steps / least - 1.0) > 0.05:
            assert row["outcome"] == ("done" if steps > least else "refused")
            assert row["message"] is None or float(row["message"].split()[5].strip(",")) == pytest.approx(
                least, rel=0.05
            )


@pytest.mark.parametrize("steps", [1000, 1500, 4000, 9000, 10000, 11000])
def test_a_loop_that_has_come_to_rest_has_not_grown(steps: int) -> None:
    """Its matrix has no eigenvalue beyond 1, and its handle rests within a count of the encoder."""
    (row,) = rows(sweep("knob_menu", {"rate": [1000.0]}, engine="loop", steps=steps, workers=1))
    (judged,) = rows(sweep("knob_menu", {"rate": [1000.0]}, workers=1))
    assert judged["growth"] < 1.0
    assert row["grew"] is False
    (member,) = judge_scene(Task("knob_menu")).group.members
    assert row["last"] < member.plant.resolution


@pytest.mark.parametrize(
    ("scene", "words"),
    [("sprung_mass", "nothing holds the handle"), ("virtual_shaft", "one axis with a rigid shaft")],
)
def test_a_loop_that_cannot_be_simulated_is_a_row(scene: str, words: str) -> None:
    (row,) = rows(sweep(scene, {"rate": [1000.0]}, engine="loop", workers=1))
    assert row["outcome"] == "refused"
    assert words in row["message"]


GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "sweep_parameters.md"
PROGRAMS = re.findall(r"^```python\n(.*?)^```", GUIDE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.thorough("makes runs and many points")
@pytest.mark.parametrize("program", PROGRAMS, ids=range(len(PROGRAMS)))
def test_the_programs_of_the_guide_run(program: str, tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True, capture_output=True)


# The folder.


def test_a_folder_is_taken_up_where_it_was_left(tmp_path: Path) -> None:
    out, points = tmp_path / "out", {"wall.stiffness": np.linspace(1.0, 3000.0, 40)}

    def stop(done: int, total: int) -> None:
        if done >= 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep("wall", points, out=out, chunk=5, workers=2, progress=stop)
    assert multiprocessing.active_children() == []
    half = Sweep.read(out)
    assert not half.complete
    kept = len(half.to_arrow())
    assert kept in (20, 25, 30, 35)  # a chunk that the other process was at may have been finished
    sorted(out.glob("chunk-*.parquet"))[1].write_bytes(b"PAR1 cut off")
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    (out / f"chunk-000002.parquet.{gone.pid}-{HOST}-0a.new").write_bytes(b"")
    written = {
        f"chunk-000003.parquet.{os.getppid()}-{HOST}-0a.new",
        f"chunk-000003.parquet.{gone.pid}-elsewhere-0a.new",
    }
    for name in written:
        (out / name).write_bytes(b"of a sweep that still writes, here or on another computer")
    found = sweep("wall", points, out=out, chunk=5, workers=1)
    assert found.complete
    assert found.computed == 40 - kept + 5
    assert {path.name for path in out.glob("*.new")} == written
    assert equal(found, sweep("wall", points, workers=1, chunk=5))
    assert sweep("wall", points, out=out, chunk=5).computed == 0
    assert Sweep.read(out).complete


def test_a_folder_with_other_inputs_is_refused_and_names_them(tmp_path: Path) -> None:
    out, points = tmp_path / "out", {"wall.stiffness": [400.0]}
    first = sweep("wall", points, out=out, workers=1)
    for change, words in (
        ({"rate": 500.0}, "rendering"),
        ({"settings": {"wall.damping": 1.0}}, "scene"),
        ({"chunk": 3}, "chunk"),
        ({"engine": "full", "duration": 0.05}, "engine, run"),
    ):
        with pytest.raises(UsageError, match=rf"holds a sweep with other inputs \({words}\)"):
            sweep("wall", points, out=out, workers=1, **change)
    with pytest.raises(UsageError, match=r"other inputs \(points\)"):
        sweep("wall", {"wall.stiffness": [401.0]}, out=out, workers=1)
    assert equal(first, Sweep.read(out))


def mean_of(number: int) -> Estimator:
    """Mean velocity over so many periods, always by the same name."""

    def start(setup: EstimatorSetup) -> Callable[[float], float]:
        seen: list[float] = []

        def step(position: float) -> float:
            seen[:] = [*(seen or [position] * number), position]
            return (seen[-1] - seen.pop(0)) / (number * setup.period)

        return step

    def system(setup: EstimatorSetup) -> StateSpace:
        share = 1.0 / (number * setup.period)
        moved, first, last = np.eye(number, k=-1), np.eye(number)[:, :1], -share * np.eye(number)[-1:]
        return StateSpace(moved, first, last, np.array([[share]]))

    return Estimator("mine", "mean velocity", start, system)


def test_two_estimators_of_one_name_have_verdicts_of_their_own() -> None:
    """The single judgement, and the eigenvalues that it is of, decide which is stable."""
    points = {"wall.damping": [20.0, 200.0]}
    found = []
    for number in (1, 40):
        estimator = mean_of(number)
        found.append([row["growth"] for row in rows(sweep("damped_wall", points, estimator=estimator, workers=1))])
        for damping, grown in zip(points["wall.damping"], found[-1], strict=True):
            group = judge_scene(Task("damped_wall", estimator=OwnName("mine", estimator),
                                     settings={"wall.damping": damping})).group  # fmt: skip
            assert grown == pytest.approx(group.loop.growth(group.environment()), rel=1e-9)
    assert found[0] != pytest.approx(found[1], rel=1e-6)


def travelled(result: Result, unit: float) -> dict[str, float]:
    return {"travelled": unit * result.travel[0].highest}


class Travelled:
    def __init__(self, unit: float) -> None:
        self.unit = unit

    def __call__(self, result: Result) -> dict[str, float]:
        return travelled(result, self.unit)


def travelled_in(unit: float) -> Callable[[Result], dict[str, float]]:
    def measure(result: Result) -> dict[str, float]:
        return {"travelled": unit * result.travel[0].highest}

    return measure


def pushed(force: float) -> Hand:
    return Hand("mine", (Piece(0.0, force),))


RUNS: dict[str, Any] = {"engine": "full", "duration": 0.05}
OF_ONE_NAME: dict[str, Callable[[float], dict[str, Any]]] = {
    "a partial": lambda value: {**RUNS, "measure": partial(travelled, unit=value)},
    "an object": lambda value: {**RUNS, "measure": Travelled(value)},
    "a closure": lambda value: {**RUNS, "measure": travelled_in(value)},
    "a hand": lambda value: {**RUNS, "hand": pushed(value)},
    "an estimator": lambda value: {"estimator": mean_of(round(value))},
}


@pytest.mark.parametrize("made", OF_ONE_NAME.values(), ids=OF_ONE_NAME)
def test_a_folder_of_another_object_of_the_same_name_is_refused(
    made: Callable[[float], dict[str, Any]], tmp_path: Path
) -> None:
    points = {"wall.stiffness": [200.0]}
    first = sweep("damped_wall", points, out=tmp_path / "out", workers=1, **made(3.0))
    assert first.computed == 1
    assert sweep("damped_wall", points, out=tmp_path / "out", workers=1, **made(3.0)).computed == 0
    with pytest.raises(UsageError, match="holds a sweep with other inputs"):
        sweep("damped_wall", points, out=tmp_path / "out", workers=1, **made(9.0))


def test_a_folder_is_not_taken_up_for_an_object_that_nobody_can_look_into(tmp_path: Path) -> None:
    class Local(Travelled):
        pass

    for measure in (Local(1.0), partial(travelled, unit=cast(float, threading.Lock()))):
        assert content_digest(measure) != content_digest(measure)
    sweep("wall", {"wall.stiffness": [200.0]}, out=tmp_path / "out", workers=1, measure=Local(1.0), **RUNS)
    with pytest.raises(UsageError, match=r"other inputs \(measure\)"):
        sweep("wall", {"wall.stiffness": [200.0]}, out=tmp_path / "out", workers=1, measure=Local(1.0), **RUNS)


WITH_A_DIGEST = """
from haptic_fieldbus.documents.own_parts import content_digest
UNIT = {unit}
def scaled(value):
    return [UNIT * each for each in value]
def measure(result):
    return {{"a": scaled([1.0]), "b": result.verdict in {{"x", "y", "zz"}}}}
print(content_digest(measure))
"""


def test_a_measure_is_known_again_by_another_process_and_by_the_constants_that_it_uses() -> None:
    def told(unit: float) -> str:
        program = [sys.executable, "-c", WITH_A_DIGEST.format(unit=unit)]
        return subprocess.run(program, check=True, capture_output=True, text=True).stdout

    assert told(1.0) == told(1.0) != told(2.0)


def test_a_folder_that_is_damaged_is_read_up_to_what_is_whole(tmp_path: Path) -> None:
    out, points = tmp_path / "out", {"wall.stiffness": np.linspace(1.0, 3000.0, 40), "rate": [1000]}
    whole = rows(sweep("wall", points, out=out, chunk=10, workers=1))
    chunks = sorted(out.glob("chunk-*.parquet"))
    stray = out / "chunk-000009.parquet"
    stray.write_bytes(chunks[0].read_bytes())
    assert (Sweep.read(out).complete, rows(Sweep.read(out))) == (True, whole)
    octets = chunks[1].read_bytes()
    chunks[1].write_bytes(octets[:4] + b"\xff" * 200 + octets[204:])
    with pytest.raises(UsageError, match=r"chunk-000001\.parquet: damaged \(.*\); delete it, and repeat the sweep"):
        Sweep.read(out).to_arrow()
    chunks[1].write_bytes(octets[:100])
    found = Sweep.read(out)
    assert not found.complete
    assert rows(found) == whole[:10] + whole[20:]
    assert sum(found.outcomes.values()) == 30
    for each in chunks:
        each.unlink()
    found = Sweep.read(out)
    assert found.to_arrow().schema.names == ["wall.stiffness", "rate", "outcome", "message"]
    assert [str(each) for each in found.to_arrow().schema.types] == ["double", "int64", "string", "string"]
    assert (len(found.to_frame()), found.stable_fraction) == (0, None)
    manifest = json.loads((out / "manifest.json").read_text())
    torn = manifest["inputs"] | {"points": 3}
    wrong: tuple[tuple[str, Any], ...] = (
        ("inputs", {}),
        ("inputs", []),
        ("inputs", torn),
        ("names", ["x"]),
        ("names", 3),
        ("digest", 3),
    )
    for key, value in (("chunk", 0), ("chunk", "x"), ("points", 0), *wrong):
        (out / "manifest.json").write_text(json.dumps(manifest | {key: value}))
        with pytest.raises(UsageError, match=r"no manifest\.json of a sweep"):
            Sweep.read(out)


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    points = {"wall.stiffness": [400.0]}
    with pytest.raises(UsageError, match="is no folder of a sweep"):
        sweep("wall", points, out=tmp_path, workers=1)
    with pytest.raises(UsageError, match="is no folder of a sweep"):
        sweep("wall", points, out=tmp_path / "thesis.tex", workers=1)
    with pytest.raises(UsageError, match=r"no manifest\.json"):
        Sweep.read(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(UsageError, match=r"no manifest\.json of a sweep"):
        sweep("wall", points, out=tmp_path, workers=1)
    assert {path.name for path in tmp_path.iterdir()} == {"thesis.tex", "manifest.json"}


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"manifest\.json: cannot be written: Not a directory"):
        sweep("wall", {"rate": [500.0]}, out=tmp_path / "file" / "rows", workers=1)

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(UsageError, match=r"manifest\.json: cannot be written: No space left on device"):
        sweep("wall", {"rate": [500.0]}, out=tmp_path / "rows", workers=1)


KILLED = """
import sys
import numpy as np
from haptic_fieldbus import sweep
points = {"wall.stiffness": np.linspace(1.0, 3000.0, 400), "wall.damping": np.linspace(0.0, 9.0, 100)}
sweep("wall", points, out=sys.argv[1], chunk=400, workers=2)
"""


def ended(condition: Callable[[], bool], within: float) -> bool:
    for _ in range(round(within / 0.05)):
        if condition():
            return True
        time.sleep(0.05)
    return condition()


@pytest.mark.thorough("kills processes and waits for their children")
@pytest.mark.parametrize("chunks", [3, 0, 1, 17, 60])
def test_a_killed_sweep_goes_on_and_leaves_no_process(chunks: int, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(out)], start_new_session=True)
    assert ended(lambda: len(list(out.glob("*.parquet"))) >= chunks and out.exists(), 60.0)
    process.kill()
    process.wait()
    left = len(list(out.glob("*.parquet")))

    def gone() -> bool:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return True
        return False

    assert ended(gone, 10.0)
    points = {"wall.stiffness": np.linspace(1.0, 3000.0, 400), "wall.damping": np.linspace(0.0, 9.0, 100)}
    found = sweep("wall", points, out=out, chunk=400, workers=2)
    assert found.computed <= 40_000 - 400 * left
    assert equal(found, sweep("wall", points, chunk=400))


UNGUARDED = """
import multiprocessing
from haptic_fieldbus import sweep
from haptic_fieldbus.api import sweeping
sweeping.FORKS = False
multiprocessing.set_start_method("spawn", force=True)
sweep("wall", {"wall.stiffness": [400.0, 500.0]}, workers=2)
"""


@pytest.mark.thorough("starts processes that import the script again")
def test_a_script_without_a_guard_is_told_of_it_where_processes_import_it(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, check=False)
    assert 'or the script lacks `if __name__ == "__main__":`' in done.stderr.splitlines()[-1]


class Lost:
    """Sends Ctrl-C where Python takes no exception: a KeyboardInterrupt there is printed and forgotten."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def sent_in_progress() -> dict[str, Any]:
    told: list[int] = []

    def progress(done: int, total: int) -> None:
        told.append(done)
        if len(told) == 2:
            Lost()

    return {"progress": progress}


def sent_in_a_chunk() -> dict[str, Any]:
    def measure(result: Result) -> dict[str, Any]:
        Lost()
        return {}

    return {"measure": measure}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("engine", "workers", "sent"),
    [("verdict", 1, sent_in_progress), ("verdict", 2, sent_in_progress), ("full", 1, sent_in_a_chunk)],
)
def test_a_signal_whose_exception_is_lost_ends_a_sweep(
    engine: str, workers: int, sent: Callable[[], dict[str, Any]], tmp_path: Path, usual_handler: None
) -> None:
    points = {"wall.stiffness": np.linspace(100.0, 900.0, 12)}
    with pytest.raises(KeyboardInterrupt):
        sweep("wall", points, out=tmp_path, chunk=1, engine=engine, workers=workers, duration=0.01, **sent())
    assert 0 < len([*tmp_path.glob("*.parquet")]) < 12 or engine == "full"
    assert not Sweep.read(tmp_path).complete
    assert multiprocessing.active_children() == []


def test_a_sweep_that_was_killed_while_it_wrote_its_manifest_goes_on(tmp_path: Path) -> None:
    left = subprocess.Popen([sys.executable, "-c", ""])
    left.wait()
    half = tmp_path / f"manifest.json.{left.pid}-{HOST}-0a.new"
    half.write_text('{"schema": 1, "dig')
    found = sweep("wall", {"wall.stiffness": [300.0, 400.0]}, out=tmp_path, workers=1)
    assert (found.computed, half.exists()) == (2, False)


def test_the_manifest_says_what_the_rows_are_of(tmp_path: Path) -> None:
    found = sweep("wall", {"wall.stiffness": (300.0, 400.0)}, sample=3, seed=7, out=tmp_path / "out", workers=1)
    manifest = json.loads((found.path / "manifest.json").read_text())
    assert manifest["inputs"]["points"] == {
        "kind": "hypercube", "values": {"wall.stiffness": [300.0, 400.0, False]}, "count": 3,
    }  # fmt: skip
    assert manifest["inputs"]["seed"] == 7
    assert "[[element]]" in manifest["inputs"]["scene"]
    assert [*manifest["inputs"]["profiles"]] == ["maxon_epos4.toml"]
    assert found.to_frame().shape == (3, 6)
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN


def test_of_two_sweeps_that_begin_at_once_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other one begins between our look at the folder and our manifest."""
    whole, out, others = sweep_folder._write_whole, tmp_path / "out", [{"wall.stiffness": [300.0]}]

    def write(path: Path, *given: Any, **words: Any) -> None:
        if others:
            sweep("wall", others.pop(), out=out, workers=1)
        whole(path, *given, **words)

    monkeypatch.setattr(sweep_folder, "_write_whole", write)
    with pytest.raises(UsageError, match="holds a sweep with other inputs"):
        sweep("wall", {"wall.stiffness": [200.0]}, out=out, workers=1)
    assert Sweep.read(out).to_arrow().column("wall.stiffness").to_pylist() == [300.0]


def test_two_threads_of_a_process_fill_one_folder(tmp_path: Path) -> None:
    points = {"wall.stiffness": [200.0 + place for place in range(40)]}
    with ThreadPoolExecutor(4) as threads:
        asked = [threads.submit(sweep, "wall", points, out=tmp_path, chunk=1, workers=1) for _ in range(4)]
        assert all(each.result().complete for each in asked)
    assert len({*tmp_path.iterdir()}) == 41


def test_files_of_somebody_else_in_the_folder_stay(tmp_path: Path) -> None:
    points = {"wall.stiffness": [200.0, 300.0]}
    sweep("wall", points, out=tmp_path, workers=1)
    own = [tmp_path / name for name in ("figure.svg.new", "notes.new", "data.999999999.new")]
    torn = tmp_path / f"{sweep_folder.MANIFEST}.999999999-{HOST}-0a.new"
    for path in (*own, torn):
        path.write_text("mine", encoding="utf-8")
    assert sweep("wall", points, out=tmp_path, workers=1).computed == 0
    assert [path.exists() for path in (*own, torn)] == [True, True, True, False]


def number_or_text(result: Result) -> dict[str, Any]:
    return {"found": "none felt" if result.plan is not None and "300" in str(result.plan.scene.elements[0]) else 1.5}


def test_a_figure_that_is_a_number_here_and_a_text_there_is_a_text(tmp_path: Path) -> None:
    points = {"wall.stiffness": [200.0, 300.0]}
    found = sweep("wall", points, out=tmp_path, workers=1, measure=number_or_text, **RUNS)
    assert found.to_arrow().column("found").to_pylist() == ["1.5", "none felt"]


WHOLE = frozenset({"a.b"})


@pytest.mark.parametrize("seed", range(5))
def test_a_hypercube_of_a_whole_number_has_each_of_its_values_as_often(seed: int) -> None:
    drawn = replace(SweepPoints.of({"a.b": (3, 12)}, 40, seed), whole=WHOLE)
    values: list[Any] = drawn.columns(0, 40)["a.b"]
    assert sorted(values) == [value for value in range(3, 13) for _ in range(4)]
    assert {type(value) for value in values} == {int}
    assert drawn.types == {"a.b": "int64"}
    spread: list[Any] = replace(SweepPoints.of({"a.b": (1, 1023, "log")}, 50, seed), whole=WHOLE).columns(0, 50)["a.b"]
    assert [sum(2**power <= value < 2 ** (power + 1) for value in spread) for power in range(10)] == [5] * 10
    largest: list[Any] = replace(SweepPoints.of({"a.b": (0, 2**63 - 1)}, 50, seed), whole=WHOLE).columns(0, 50)["a.b"]
    assert 0 <= min(largest) < max(largest) <= 2**63 - 1


@pytest.mark.parametrize(("ends", "whole"), [((3.0, 12), WHOLE), ((3, 12), frozenset())])
def test_a_hypercube_of_numbers_is_not_rounded(ends: tuple[float, float], whole: frozenset[str]) -> None:
    drawn = replace(SweepPoints.of({"a.b": ends}, 40, 0), whole=whole)
    values: list[Any] = drawn.columns(0, 40)["a.b"]
    assert any(value % 1.0 for value in values)
    assert drawn.types == {"a.b": "float64"}


def test_seeds_counts_and_encoders_are_whole_numbers_and_a_stiffness_is_not() -> None:
    rows = sweep("detents", {"detents.count": (1, 10), "seed": (0, 99), "detents.pitch": (1, 2)}, engine="full",
                 sample=3, workers=1, duration=0.02).to_frame()  # fmt: skip
    assert rows["outcome"].tolist() == ["done"] * 3
    assert [rows[name].dtype.kind for name in ("detents.count", "seed", "detents.pitch")] == ["i", "i", "f"]
    counts = "rig.handle.encoder_counts_per_revolution"
    rows = sweep("wall", {counts: (500, 4000), "wall.stiffness": (100, 900)}, sample=3, workers=1).to_frame()
    assert [rows[name].dtype.kind for name in (counts, "wall.stiffness")] == ["i", "f"]
    assert rows["outcome"].tolist() == ["done"] * 3
