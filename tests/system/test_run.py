"""Whole runs on the simulated bus through the Python API: what the first user sees, and what must never happen."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus import Result
from haptic_fieldbus.api import plan, run
from haptic_fieldbus.drive.rig import Limits, Rig, default_axis
from haptic_fieldbus.errors import BusOverloadError, UnstableSceneError, UsageError
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace

LINEAR = (SceneAxis("handle", Workspace.LINEAR),)


def bilateral(stiffness: float, position: float = 0.002) -> Scene:
    """A spring about a place beside the start: a free decay or growth begins by itself."""
    return Scene("spring", "for tests", LINEAR, (Wall("handle", stiffness, position=position, sides="bilateral"),))


def fine_bench(**changes: object) -> Rig:
    """The shipped bench without Coulomb friction, with a fine encoder, and limits out of the way."""
    axis = default_axis(Workspace.LINEAR, bus="bus", node=1, profile="maxon_epos4")
    axis = replace(
        axis,
        coulomb_friction=0.0,
        encoder_counts_per_revolution=4_000_000,
        limits=Limits(speed=100.0),
        **changes,  # type: ignore[arg-type]
    )
    return Rig({"bus": CanSection("haptic_sim", "sim")}, {"handle": axis})


def stability_of(scene: Scene, rig: Rig) -> Stability:
    found = plan(scene, rig, bus="sim").stability
    assert found is not None
    return found


@pytest.fixture(scope="module")
def pushed() -> Result:
    """The demonstration's wall, for three seconds."""
    return run("wall", duration=3.0)


def test_the_wall_of_the_demonstration_runs_without_a_missed_period(pushed: Result) -> None:
    assert (pushed.cycles, pushed.missed_cycles, pushed.clock, pushed.trips) == (3000, 0, "virtual", ())
    assert pushed.duration == pytest.approx(3.0, abs=0.002)
    assert pushed.drive == "maxon_epos4"


@pytest.mark.thorough("a long run")
def test_the_hand_comes_to_rest_where_the_wall_balances_its_push(pushed: Result) -> None:
    """6 N on 600 N/m is 10 mm, give or take what Coulomb friction (0.25 N) holds and one torque step."""
    trace = pushed.traces[0]
    still = trace.times > trace.times[-1] - 0.2
    slack = (0.2514 + 0.051) / 600.0
    assert trace.position[still].mean() == pytest.approx(0.030, abs=slack)
    assert trace.force[still].mean() == pytest.approx(-6.0, abs=0.2514 + 0.051)


def test_shares_of_the_error_sum_to_one_and_the_error_is_below_what_is_felt(pushed: Result) -> None:
    error = pushed.torque_error
    assert error is not None
    assert error.unit == "N"
    assert list(error.by_source) == ["sampling and delay", "encoder", "torque step", "torque loop"]
    assert sum(error.by_source.values()) == pytest.approx(1.0, abs=1e-9)
    assert error.contact is not None
    assert error.contact < 0.08


def test_energy_generated_is_the_integral_of_error_times_velocity(pushed: Result) -> None:
    trace = pushed.traces[0]
    assert trace.ideal is not None
    velocity = np.gradient(trace.position, trace.times)
    expected = np.trapezoid((trace.force - trace.ideal) * velocity, trace.times)
    assert pushed.energy_generated == pytest.approx(expected, rel=0.02)


def test_the_feedback_is_as_old_as_the_bus_and_the_plan_say(pushed: Result) -> None:
    """From the end of SYNC to the end of the TPDO: 64 octet-bits and their overhead, 111 to 135 bits with stuffing."""
    assert pushed.timing is not None
    assert pushed.timing.age_us is not None
    assert 108 <= pushed.timing.age_us.p50 <= 135
    assert pushed.timing.period_us is not None
    assert pushed.timing.period_us.max == pytest.approx(1000.0, abs=1.0)


@pytest.mark.thorough("four long runs", quick=1)
@pytest.mark.parametrize(("factor", "grows"), [(0.9, False), (0.97, False), (1.03, True), (1.1, True)])
def test_the_bench_decays_below_the_limit_and_grows_above_it_at_the_predicted_rate(factor: float, grows: bool) -> None:
    """The envelope of a free oscillation changes by the spectral radius of the predicted loop each period."""
    rig = fine_bench()
    limit = stability_of(bilateral(500.0), rig).stiffness_limit.stable
    assert limit is not None
    scene = bilateral(factor * limit, position=0.006)
    predicted = stability_of(scene, rig)
    result = run(scene, rig, bus="sim", hand="none", duration=1.5, force=True)
    trace = result.traces[0]
    swing = trace.position - 0.006
    halves = [np.abs(swing[(trace.times >= begin) & (trace.times < begin + 0.4)]).max() for begin in (0.6, 1.1)]
    rate = math.log(halves[1] / halves[0]) / 500.0
    assert (rate > 0) is grows
    assert rate == pytest.approx(math.log(predicted.spectral_radius), rel=0.05, abs=2e-5)


def test_an_unstable_wall_is_refused_with_the_limit_and_what_would_be_stable() -> None:
    with pytest.raises(UnstableSceneError, match="3000 N/m exceeds the limit of 750 N/m") as refused:
        run("wall", settings={"wall.stiffness": 3000.0})
    limit = plan("wall").stability
    assert limit is not None
    assert refused.value.limit == limit.limit.value
    assert "--set wall.stiffness=" in str(refused.value)
    assert isinstance(refused.value.result, Result)
    assert refused.value.result.cycles is None


@pytest.mark.thorough("tries every proposal")
def test_what_a_refusal_proposes_is_not_refused() -> None:
    with pytest.raises(UnstableSceneError) as refused:
        run("wall", settings={"wall.stiffness": 3000.0})
    proposals = [text.split("--set ")[1].split(" ")[0].rstrip(".") for text in str(refused.value).split(" or ")]
    assert len(proposals) == 2
    for proposal in proposals:
        key, value = proposal.split("=")
        settings = {"wall.stiffness": 3000.0, key: float(value)}
        assert run("wall", settings=settings, duration=0.7).cycles == 700


def test_max_over_two_is_half_the_limit() -> None:
    limit = plan("wall").stability
    half = plan("wall", settings={"wall.stiffness": "max/2"}).stability
    assert limit is not None
    assert half is not None
    assert half.stiffness == pytest.approx(limit.limit.value / 2)


def test_a_start_inside_the_wall_does_not_kick() -> None:
    """Without a hand, 6 N wait inside the wall: the command grows no faster than the limit, 50.3 N in 500 periods.

    Each of two commands is off by half a step of torque, 0.05 N, and more where the drive's own rounding adds.
    """
    result = run("wall", settings={"wall.position": -0.01}, hand="none", duration=0.4)
    trace = result.traces[0]
    steps = np.abs(np.diff(trace.force))
    assert steps.max() <= 50.3 / 500 + 2 * 0.051
    assert trace.force.min() < -1.0


@pytest.mark.thorough("a long run")
def test_a_released_handle_leaves_the_wall_and_is_then_free() -> None:
    result = run("wall", hand="release", duration=4.0)
    trace = result.traces[0]
    inside = trace.position[(trace.times > 1.5) & (trace.times < 1.9)]
    assert inside.min() > 0.02
    gone = trace.position < 0.0199
    assert gone[-1]
    assert np.abs(trace.force[(trace.times > 3.5)]).max() == 0.0


@pytest.mark.thorough("two long runs")
def test_damped_wall_and_sprung_mass_render_too() -> None:
    damped = run("damped_wall", duration=1.5)
    assert damped.torque_error is not None
    assert "estimator" in damped.torque_error.by_source
    sprung = run("sprung_mass", duration=1.5)
    assert sprung.torque_error is not None
    assert "integrator" in sprung.torque_error.by_source
    assert "sprung_mass" in sprung.traces[0].virtual


def recorded(path: Path, **options: object) -> bytes:
    run("wall", duration=0.5, record=path, **options)  # type: ignore[arg-type]
    return path.read_bytes()


@pytest.mark.thorough("renders the same twice")
def test_the_same_seed_gives_the_same_frames_byte_for_byte(tmp_path: Path) -> None:
    first = recorded(tmp_path / "first.log")
    assert first == recorded(tmp_path / "second.log")
    assert first != recorded(tmp_path / "other.log", seed=1)
    assert b" 601#" in first
    assert first.count(b" 080#\n") > 500


@pytest.mark.thorough("renders the same in two processes")
def test_another_process_gives_the_same_frames(tmp_path: Path) -> None:
    here = recorded(tmp_path / "here.log")
    code = "import haptic_fieldbus as h, sys; h.run('wall', duration=0.5, record=sys.argv[1])"
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "there.log")], check=True, env={"PYTHONHASHSEED": "7"})
    assert (tmp_path / "there.log").read_bytes() == here


def test_a_rate_that_the_bus_cannot_carry_is_refused_with_the_numbers() -> None:
    with pytest.raises(BusOverloadError, match=r"5000 Hz needs 285 bits per period: 1\d\d %"):
        run("wall", drive="generic_cia402", rate=5000.0)


@pytest.mark.thorough("two long runs")
@pytest.mark.parametrize("rate", [250.0, 1500.0])
def test_other_rates_run_too(rate: float) -> None:
    result = run("wall", drive="generic_cia402", rate=rate, duration=1.0, settings={"wall.stiffness": "max/3"})
    assert result.cycles == rate


def whole(module: str) -> str:
    """The package of integrators or estimators that a module belongs to: the plan names these as a whole."""
    packages = ("haptic_fieldbus.numerics.integrators", "haptic_fieldbus.numerics.estimators")
    return next((package for package in packages if module.startswith(f"{package}.")), module)


@pytest.mark.thorough("starts a process for each scene", quick=("wall",))
@pytest.mark.parametrize("scene", ["wall", "damped_wall", "sprung_mass"])
def test_a_run_imports_only_what_its_scene_needs(scene: str) -> None:
    """In a fresh interpreter, for `plan`: the modules that only some scenes need are those the plan names."""
    code = (
        "import sys, haptic_fieldbus as h; p = h.plan(sys.argv[1]); "
        "folders = ('haptic_fieldbus.scenes.', 'haptic_fieldbus.numerics.'); "
        "print(*[m for m in sys.modules if m.startswith(folders)]); print(*p.modules)"
    )
    out = subprocess.run([sys.executable, "-c", code, scene], check=True, capture_output=True, text=True).stdout
    imported, named = (set(map(whole, line.split())) for line in out.splitlines())
    shared = {
        "haptic_fieldbus.scenes.catalogue",
        "haptic_fieldbus.scenes.element_checks",
        "haptic_fieldbus.scenes.element",
        "haptic_fieldbus.scenes.files",
        "haptic_fieldbus.scenes.own_faults",
        "haptic_fieldbus.scenes.registry",
        "haptic_fieldbus.scenes.scene",
        "haptic_fieldbus.numerics.linear",
        "haptic_fieldbus.numerics.passivity",
        "haptic_fieldbus.numerics.sampled",
    }
    # Of these rooms; what the cycle itself can do without is imported when it is bound.
    assert imported - shared == {module for module in named if ".cycle." not in module}


@pytest.mark.parametrize("option", [{"method": "euler"}, {"estimator": "foo"}])
def test_a_method_or_estimator_that_does_not_exist_is_refused_even_where_none_is_needed(option: dict[str, str]) -> None:
    with pytest.raises(UsageError, match=r"no (method|estimator) .*there are: "):
        run("wall", **option)  # type: ignore[arg-type]
