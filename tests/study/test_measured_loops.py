"""Impedance, K–B region and the integrator in the loop, against loops that are written out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus import api
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.compile import grouped
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.study.measure import loops, region, timing
from haptic_fieldbus.study.measure.bench import Bench, Tools, bench_of
from haptic_fieldbus.study.measure.problems import MASS
from haptic_fieldbus.study.measure.timing import host_facts
from haptic_fieldbus.study.page import sources
from haptic_fieldbus.study.page import stability as page
from haptic_fieldbus.study.page.sources import felt_impedance, ideal_impedance, of_plan
from tests.loops import BENCH, PERIOD, ByHand, wall

TOOLS = Tools(api.run, api.plan)
SHIPPED = Bench(BENCH, delay=0.0004, period=PERIOD)
SUBSTEPS = 20


def shaken(bench: Bench, environment: StateSpace, frequency: float, seconds: float) -> complex:
    """Z of a loop that runs in time, in pieces of a twentieth of a period, under a force of 1 N."""
    plant, span, turn = bench.plant, bench.period / SUBSTEPS, 2.0 * math.pi * frequency
    lag = plant.torque_lag
    system = np.zeros((6, 6))  # position, velocity, motor force, target, sine, cosine
    system[0, 1], system[1, 1] = 1.0, -plant.damping / plant.mass
    system[1, 2], system[1, 4] = 1.0 / plant.mass, 1.0 / plant.mass
    system[2, 2:4] = -1.0 / lag, 1.0 / lag
    system[4, 5], system[5, 4] = turn, -turn
    moved = scipy.linalg.expm(system * span)
    late, steps = round(bench.delay / span), round(seconds / span)
    state, inner = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.zeros(environment.order)
    targets = [0.0] * (late + 1)
    positions = np.empty(steps)
    for step in range(steps):
        if step % SUBSTEPS == 0:
            force = float((environment.c @ inner)[0] + environment.d[0, 0] * state[0])
            inner = environment.a @ inner + environment.b[:, 0] * state[0]
        targets.append(force)
        state[3] = targets[-1 - late]
        positions[step] = state[0]
        state = moved @ state
    window = round(1.0 / frequency / span)
    times = np.arange(steps - window, steps) * span
    component = 2.0 * np.mean(positions[-window:] * np.exp(-1j * turn * times)) * 1j  # of sin, as of exp(jωt)
    return complex(1.0 / (1j * turn * component))


@pytest.mark.parametrize("frequency", [10.0, 50.0, 125.0])
def test_the_impedance_felt_is_that_of_a_loop_that_runs(frequency: float) -> None:
    bench = Bench(Plant(0.3, 25.0, torque_lag=2e-4), delay=0.0004, period=PERIOD)
    environment = wall(900.0, 4.0)
    expected = shaken(bench, environment, frequency, 1.0)
    found = felt_impedance(bench, environment, np.array([frequency]))[0]
    assert found == pytest.approx(expected, rel=2e-3)


def test_the_ideal_impedance_is_the_textbooks() -> None:
    frequency = np.array([0.5, 5.0, 50.0])
    s = 2j * np.pi * frequency
    plant = Plant(0.6, 1.5)
    spring = ideal_impedance(plant, gain([[-600.0, -2.0]]), frequency)
    np.testing.assert_allclose(spring, 0.6 * s + 1.5 + 600.0 / s + 2.0)
    k, m = 200.0, 0.5
    sprung = ideal_impedance(plant, SprungMass("handle", k, m).dynamics, frequency)
    np.testing.assert_allclose(sprung, 0.6 * s + 1.5 + k * m * s / (m * s**2 + k))


def test_at_a_high_rate_what_is_felt_is_the_ideal() -> None:
    plan = api.plan("wall")
    environment = next(grouped(plan.axes, 1e-6)).environment()
    bench = replace(bench_of(plan), period=1e-6, delay=0.0, plant=replace(bench_of(plan).plant, torque_lag=0.0))
    found = felt_impedance(bench, environment, np.array([1.0, 10.0]))
    np.testing.assert_allclose(found, of_plan_ideal(plan.axes[0].elements[0].linearised()), rtol=1e-4)


def of_plan_ideal(space: StateSpace) -> np.ndarray:
    ideal: np.ndarray = ideal_impedance(bench_of(api.plan("wall")).plant, space, np.array([1.0, 10.0]))
    return ideal


@pytest.mark.parametrize("scene", ["wall", "damped_wall", "sprung_mass"])
def test_the_impedance_of_a_scene_is_good_at_low_frequencies(scene: str) -> None:
    found = of_plan(api.plan(scene))
    assert abs(found.felt[0] / found.ideal[0] - 1.0) < 0.01
    assert found.frequency[-1] < 0.5 / PERIOD


def test_loops_grow_where_their_eigenvalues_say() -> None:
    bench = replace(SHIPPED, delay=0.0005)
    stiffness, damping = np.meshgrid(np.linspace(500.0, 9000.0, 5), np.array([0.0, 2.0, 8.0]))
    expected = [
        ByHand(bench.plant, bench.delay, k, b).growth() > 1.0
        for k, b in zip(stiffness.ravel(), damping.ravel(), strict=True)
    ]
    assert any(expected)
    assert not all(expected)
    assert region.grew(bench, stiffness, damping, 3000).ravel().tolist() == expected


def test_the_region_is_measured_as_it_is_predicted() -> None:
    found = region.region("bench", SHIPPED, 16, 2000)
    assert found.agreement == 1.0
    assert (found.passive_limit <= found.stable_limit + 1e-9).all()
    assert found.stable_limit[-1] == 0.0, "the grid goes on to where no stiffness is stable"
    assert found.stable_limit.argmax() not in (0, 15), "damping helps up to a point and then hurts"


def test_clamped_forward_euler_grows_at_the_rate_of_its_eigenvalues() -> None:
    found = loops.loop_growth(SHIPPED, "forward-euler", 5)
    expected = 0.5 * np.log1p(PERIOD**2 * found.stiffness / MASS) / PERIOD
    np.testing.assert_allclose(found.rate["clamped"], expected, rtol=1e-9, atol=1e-9)
    assert found.limit["clamped"] == 0.0


@pytest.mark.parametrize("method", ["forward-euler", "exact-foh"])
def test_the_stiffest_stable_spring_is_where_a_loop_by_hand_begins_to_grow(method: str) -> None:
    limit = loops.loop_growth(SHIPPED, method, 2).limit["free"]
    for factor, grows in ((0.999, False), (1.001, True)):
        loop = ByHand(SHIPPED.plant, SHIPPED.delay, factor * limit, mass=MASS, method=method)
        assert (loop.growth() > 1.0) is grows


def test_preserving_stability_is_neither_enough_nor_needed_in_the_loop() -> None:
    limits = {method: loops.loop_growth(SHIPPED, method, 2).limit["free"] for method in METHODS}
    assert limits["forward-euler"] < limits["semi-implicit-drift-first"] < 0.9 * limits["exact-foh"]
    assert limits["exact-zoh"] < 0.9 * limits["exact-foh"]
    assert limits["rk4"] == pytest.approx(limits["exact-foh"], rel=0.01)


def test_a_flicked_handle_swings_as_the_growth_rate_says() -> None:
    stiffness = 400.0
    radius = loops.radius_of("free", SHIPPED, "forward-euler")(stiffness)
    times, force = loops.flicked_free(SHIPPED, "forward-euler", 6.0, stiffness)
    early, late = (np.abs(force[(times > begin) & (times < begin + 1.0)]).max() for begin in (2.0, 4.0))
    assert late / early == pytest.approx(radius ** (2.0 / PERIOD), rel=0.02)


@pytest.mark.thorough("times every optional part")
def test_the_periods_that_are_timed_render_a_force() -> None:
    for scene in scene_names():
        plan = api.plan(scene)
        playback = timing.Playback(plan)
        cycle = playback.running_cycle()
        largest = 0.0
        for image in playback.images(2 * timing.IMAGES):
            cycle(image)
            forces = [cycle.row[cycle.columns.index(f"{axis.name}.force")] for axis in plan.axes]
            largest = max(largest, *map(abs, forces))
        assert (cycle.trip, cycle.enabled) == (None, True)
        if scene in ("wall", "damped_wall", "sprung_mass"):
            assert largest > 0.1


@pytest.mark.thorough("times every optional part")
def test_every_part_has_a_cost_and_a_name_of_its_own() -> None:
    plans = {name: api.plan(name) for name in ("wall", "damped_wall", "sprung_mass")}
    found = list(timing.parts(plans, SHIPPED))
    assert [part.part for part in found[:3]] == [f"whole period: {name}" for name in plans]
    assert len({part.part for part in found}) == len(found)
    # What one period takes more than another may be nothing on a busy machine.
    assert all(part.ns_per_step > 0.0 for part in found if part.cost is not None)
    assert all(part.ns_quartiles == tuple(sorted(part.ns_quartiles)) for part in found)
    assert all(part.ns_quartiles[0] <= part.ns_per_step <= part.ns_quartiles[2] for part in found)
    assert {f"integrator, two states: {method}" for method in METHODS} <= {part.part for part in found}
    assert {"element: wall", "coupling: coupling"} <= {part.part for part in found}


def test_a_period_shorter_than_the_exchange_is_always_missed() -> None:
    found = timing.deadlines(TOOLS, 200)
    assert found.bus == api.plan(timing.SCENE).delay.bus
    for each in found.rates:
        assert each.missed >= each.missed_computing
        if found.bus > 1.0 / each.rate:
            assert each.missed == 1.0


def test_the_error_of_each_scene_is_split_in_shares_that_sum_to_one() -> None:
    found = {name: sources.scene_error(TOOLS, name, 1.0) for name in ("wall", "no such scene")}
    assert sum(found["wall"].by_source.values()) == pytest.approx(1.0)
    assert "no such scene" in found["no such scene"].reason
    assert found["no such scene"].rms is None


def test_the_host_is_told_with_versions() -> None:
    assert {"processor", "cores", "system", "python", "numpy", "clock"} <= set(host_facts())


def test_quick_and_full_report_tell_the_same_of_the_passivity_controller() -> None:
    """Of any growth that rises with the stiffness and crosses 1 where the limit of stability says."""
    for limit, controlled_limit in ((1.0, 9.0), (0.97, 1.02), (1.04, 3.5)):
        found = [
            [
                page.Decay(share, controlled, share / (controlled_limit if controlled else limit))
                for share in shares
                for controlled in (False, True)
            ]
            for shares in (page.PASSIVITY_QUICK, page.PASSIVITY_FULL)
        ]
        quick, full = (page.limit_texts(each) for each in found)
        assert quick == full
    assert quick == ("at 1.05 times the limit of stability, and not at 0.95 times",
                     "at no stiffness up to 3 times the limit of stability")  # fmt: skip


@pytest.mark.thorough("runs each of the shares")
def test_what_is_measured_of_the_controller_is_the_same_quickly_and_in_full() -> None:
    told = [
        page.limit_texts(list(page.decays(TOOLS, shares, page.DURATION)))
        for shares in (page.PASSIVITY_QUICK, page.PASSIVITY_FULL)
    ]
    assert told[0] == told[1]
    assert told[0][0] == "at 1.05 times the limit of stability, and not at 0.95 times"
