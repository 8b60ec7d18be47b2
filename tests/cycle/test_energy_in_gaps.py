"""Energy of every scene of the library while feedback is lost at drawn times; energies by hand, not by the ledger.

A potential is integrated here from the force of the elements at rest. `tests.cycle.gap_bench` has the handle and the
work of the torque.
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from haptic_fieldbus.cycle.laws import Sensed, field_of
from haptic_fieldbus.planning.limits import HELD_ENERGY, HELD_POWER
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.element import Element, StaticElement, abilities
from haptic_fieldbus.scenes.generalised_maxwell import GeneralisedMaxwell
from haptic_fieldbus.scenes.gravity import Gravity
from haptic_fieldbus.scenes.proxy import Proxy
from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal, Workspace
from tests.cycle.gap_bench import LEVER, MASS, PERIOD, AtPlaces, Handled, Timing, TwoHandles, bench_plan, run

REACH = 0.15
"""[m] to both sides, in which a potential is known."""
ROUNDING = 0.05
"""[N] by which a torque of whole steps and a place of whole counts may be off, along the way."""
STATIC = (
    *("detents", "magnet", "wall", "damped_wall", "end_stops", "spring", "spring_with_play", "texture"),
    *("hunt_crossley", "gravity", "predicted_wall", "damper"),
)
REMEMBERING = (
    *("friction", "dahl", "lugre", "stick_slip", "needle", "grating", "proxy", "kelvin_voigt", "standard_linear_solid"),
    *("generalised_maxwell", "sprung_mass", "damped_sprung_mass", "free_puck", "braking_pulse", "virtual_coupling"),
    *("inertia", "gear_shifter"),
)
ROTARY = ("pendulum", "knob_menu")
COUPLED = ("virtual_shaft", "teleoperation")
SUMS = (("detents", "kelvin_voigt"), ("magnet", "sprung_mass"), ("texture", "gravity"), ("virtual_coupling", "detents"))


def in_library(name: str) -> tuple[Element, ...]:
    """The elements of a scene of one axis, which is called handle here."""
    scene = load_scene(name)
    found: Any = scene.of_axis(scene.axes[0].name)
    return tuple(replace(each, axis="handle") for each in found)


def of_scenes(names: Sequence[str]) -> tuple[Element, ...]:
    """The elements of several scenes of the library together, each with a name of its own."""
    every: list[Any] = [each for name in names for each in in_library(name)]
    return tuple(replace(each, name=f"{each.name}{number}") for number, each in enumerate(every))


def potential(elements: Sequence[Element], reach: float) -> Callable[[float], float]:
    """The energy of these forces at rest, by quadrature of their sum on a fine grid, from the lowest place."""
    laws = [
        field_of(each, PERIOD, None, Sensed())
        for each in elements
        if isinstance(each, StaticElement) and Signal.POSITION in each.needs
    ]
    count = 4000
    width = 2.0 * reach / count
    sums = [0.0]
    for number in range(count):
        a = number * width - reach
        middle = -width / 6.0 * sum(law(a) + 4.0 * law(a + 0.5 * width) + law(a + width) for law in laws)
        sums.append(sums[-1] + middle)

    def stored(x: float) -> float:
        at = min(max((x + reach) / width, 0.0), count - 1e-9)
        part, number = at % 1.0, int(at)
        return sums[number] * (1.0 - part) + sums[number + 1] * part

    return stored


def steepest(stored: Callable[[float], float], reach: float) -> float:
    """The steepest slope of the force of a potential [N/m or N·m/rad]."""
    step = reach / 1500.0
    places = [number * step - reach + 2.0 * step for number in range(2996)]
    return max(abs(stored(x + 2.0 * step) - 2.0 * stored(x) + stored(x - 2.0 * step)) for x in places) / (
        4.0 * step * step
    )


def drawn(rng: random.Random, elements: Sequence[Element], *, rotary: bool = False) -> None:
    """Gaps of one timing on one scene: at every sample the energy given is bounded.

    Elements without a memory give what they stored where the law was first, less what they store where it is. One that
    remembers, and begins at rest, stores nothing at first and holds no less than nothing later, beside the reserve of
    friction.
    """
    lever = LEVER if rotary else 1.0
    reach = REACH / lever
    stored = potential(elements, reach)
    weight = sum(each.share * each.mass * 9.80665 for each in elements if isinstance(each, Gravity))
    reserve = sum(abilities(each).reserve or 0.0 for each in elements)
    damping = rng.choice([0.05, 0.3, 1.58]) * lever**2
    plan = bench_plan(*elements, rotary=rotary)
    remembers = not all(isinstance(each, StaticElement) for each in elements)
    bench = Handled(plan, mass=MASS * lever**2, damping=damping, by_changes=remembers)
    bench.stiffness, bench.v = 1.1 * steepest(stored, reach), rng.uniform(0.05, 0.6) / lever
    missing = rng.choice([2, 3, 5, 8, 14])
    pitch = rng.choice([0.005, 0.01, 0.02]) / lever
    timing = AtPlaces(missing, pitch, rng.random(), pause=5 * missing, of_law=rng.random() < 0.3)
    push = rng.choice([0.0, 2.0, 4.0]) * rng.choice([-1.0, 1.0]) * lever
    turn, left = rng.uniform(0.05, 0.3), 0
    first, permission = stored(bench.x) + reserve, bench.axis.permission
    for number in range(800):
        left = left - 1 if left else timing(bench)
        here, given = bench.x, bench.given - bench.held - bench.leak + weight * bench.outside
        bench.move(lost=left > 0, push=push * math.sin(number * PERIOD / turn))
        if bench.tripped or abs(bench.x) > reach - 0.01 / lever:
            return
        if not left:
            allowed = first - stored(here - permission.shift) + ROUNDING * lever * bench.path
            assert given <= allowed, f"{given - allowed} J above {allowed}: {elements}, {missing} lost, {timing}"


def drawn_pair(rng: random.Random, name: str) -> None:
    """Gaps of one timing on a coupled scene of the library; one handle loses samples, or both do."""
    scene = load_scene(name)
    rotary = scene.axes[0].workspace is Workspace.ROTARY
    lever = LEVER if rotary else 1.0
    bench = TwoHandles(scene, [rng.choice([0.05, 0.5, 1.5]) for _ in range(2)], rotary)
    bench.v = [rng.uniform(-0.5, 0.5) / lever for _ in range(2)]
    pushes = [rng.choice([0.0, 2.0, 4.0]) * lever for _ in range(2)]
    missing, pitch, turn = rng.choice([2, 3, 5, 8, 14]), rng.choice([0.005, 0.01, 0.02]) / lever, rng.uniform(0.05, 0.3)
    which, last, begun, left = rng.choice([(True, False), (False, True), (True, True)]), 0, 0, 0

    def stored() -> float:
        return sum(each.stored(*bench.places) for each in scene.couplings) + sum(  # type: ignore[attr-defined]
            each.stored(bench.places[number])  # type: ignore[attr-defined]
            for number, axis in enumerate(scene.axes)
            for each in scene.of_axis(axis.name)
        )

    first = stored()
    for number in range(1000):
        place = math.floor((bench.x[0] - bench.x[1]) / pitch)
        passed, last = place != last, place
        left -= left > 0
        if not left and passed and number - begun > 5 * missing:
            left, begun = missing, number
        lost = (which[0] and left > 0, which[1] and left > 0)
        shakes = [push * math.sin(number * PERIOD / turn + phase) for phase, push in enumerate(pushes)]
        had = bench.given - bench.held - bench.leak
        gap = bench.move(lost, shakes)
        if bench.tripped:
            return
        if not gap:
            allowed = first - stored() + ROUNDING * lever * bench.path
            assert had <= allowed, f"{had - allowed} J above {allowed}: {name}, {missing} lost of {which}"


@pytest.mark.parametrize("name", ["detents", "magnet", "wall", "sprung_mass", "kelvin_voigt"])
def test_no_timing_of_gaps_gives_more_than_the_law_stored_and_the_torque_held(name: str) -> None:
    rng = random.Random(name)
    for _ in range(3):
        drawn(rng, in_library(name))


def test_a_virtual_mass_takes_up_no_energy_under_a_cap_that_its_hand_did_not_pay() -> None:
    """Gaps lead the scene away by more than its bound; the mass was then driven by a force that the cap cut off."""
    drawn(random.Random(42), of_scenes(["virtual_coupling"]))


@pytest.mark.thorough("2,000 timings")
@pytest.mark.parametrize("seed", range(20))
def test_no_timing_of_2000_gives_more_than_the_law_stored_and_the_torque_held(seed: int) -> None:
    """Of a hundred 40 with one or two scenes of laws without a memory, 40 with one that remembers, 10 with both."""
    rng = random.Random(seed)
    for number in range(100):
        if number % 10 < 4:
            drawn(rng, of_scenes(rng.sample(STATIC, rng.choice([1, 1, 2]))))
        elif number % 10 < 8:
            drawn(rng, of_scenes([rng.choice(REMEMBERING)]))
        elif number % 10 < 9:
            drawn(rng, of_scenes([rng.choice(REMEMBERING), rng.choice(STATIC)]))
        else:
            drawn(rng, in_library(rng.choice(ROTARY)), rotary=True)
        drawn_pair(rng, rng.choice(COUPLED)) if number % 10 == 9 else None


def at_turns(missing: int) -> Timing:
    """Gaps that begin where the handle turns around."""
    last = 0.0

    def timing(bench: Handled) -> int:
        nonlocal last
        before, last = last, bench.v
        return missing if before * bench.v < 0.0 else 0

    return timing


def left_alone(elements: Sequence[Element], damping: float, timing: Timing, seconds: float, rotary: bool) -> None:
    """A handle that is thrown and left alone rests in the end, or its run has, or it was given no power that is felt.

    It is given what was stored where it began, the leak of the held force, 50 mJ and 2 mW at most.
    """
    lever = LEVER if rotary else 1.0
    plan = bench_plan(*elements, rotary=rotary)
    bench = Handled(plan, mass=MASS * lever**2, damping=damping * lever**2, by_changes=True)
    stored = potential(elements, REACH / lever)
    first = stored(bench.x) - min(stored((number / 500.0 - 1.0) * REACH / lever) for number in range(1001))
    bench.stiffness, bench.v = 1.1 * steepest(stored, REACH / lever), 0.6 / lever
    run(bench, seconds, timing)
    time = bench.period * PERIOD
    weight = sum(each.share * each.mass * 9.80665 for each in elements if isinstance(each, Gravity))
    most = first + weight * abs(bench.x) + bench.leak + 1.1 * HELD_ENERGY + HELD_POWER * time
    assert bench.given <= most + ROUNDING * lever * bench.path, f"{bench.given} J above {most}: {elements}"


@pytest.mark.thorough("each scene of the library for seconds", quick=("detents",))
@pytest.mark.parametrize("name", [*STATIC, *REMEMBERING, *ROTARY, *map("+".join, SUMS)])
def test_a_handle_that_is_left_alone_is_given_no_power_that_is_felt(name: str) -> None:
    elements, rotary = of_scenes(name.split("+")), name in ROTARY
    pitch = 0.01 * (1.0 / LEVER if rotary else 1.0)
    for damping in (0.003, 0.2, 1.58, 10 ** random.Random(name).uniform(-2.5, 0.7)):
        for timing in (AtPlaces(14, pitch, pause=70), AtPlaces(8, pitch, 0.88, pause=40), at_turns(5)):
            left_alone(elements, damping, timing, 2.0, rotary)


@pytest.mark.thorough("each coupled scene for seconds", quick=("virtual_shaft",))
@pytest.mark.parametrize("name", COUPLED)
def test_two_handles_that_are_left_alone_are_given_no_power_that_is_felt(name: str) -> None:
    scene = load_scene(name)
    rotary = scene.axes[0].workspace is Workspace.ROTARY
    both = True, True
    for damping, missing, lost in (
        (0.3, 14, (True, False)),
        (1.58, 8, (False, True)),
        (0.3, 5, both),
        (0.003, 8, both),
    ):
        bench = TwoHandles(scene, [damping, damping], rotary)
        bench.v, last, left = [0.6 / (LEVER if rotary else 1.0), 0.0], 0.0, 0
        for number in range(2000):
            speed = bench.v[0] - bench.v[1]
            if speed * last < 0.0 or (not left and number % (5 * missing) == 0):
                left = missing
            last, left = speed, max(0, left - 1)
            bench.move((lost[0] and left > 0, lost[1] and left > 0))
            if bench.tripped:
                break
        most = bench.leak + 1.1 * HELD_ENERGY + HELD_POWER * 2.0
        assert bench.given <= most + ROUNDING * (LEVER if rotary else 1.0) * bench.path


# Live changes: the energy that they add, while samples are missing.


def stiffening(bench: Handled, soft: float, stiff: float) -> None:
    """Begin to fade from a wall at 0 of one stiffness to one of the other, within 100 periods."""
    before, after = (bench_plan(Wall("handle", each, position=0.0)) for each in (soft, stiff))
    assert bench.cycle.prepare(before, after, 100)()


def test_a_change_in_a_gap_charges_no_torque_that_moved_nothing() -> None:
    """The handle is held still, so the torque gives nothing, while the springs grow by ½·ΔK·x² = 480 mJ."""
    bench = Handled(bench_plan(Wall("handle", 50.0, position=0.0)), x=0.08)
    stiffening(bench, 50.0, 200.0)
    for number in range(200):
        bench.move(to=0.08, lost=5 <= number % 40 < 19)
    assert (bench.given, bench.tripped) == (0.0, None)
    tally = bench.cycle.ledgers[0].tally
    assert tally.held_most == pytest.approx(0.0, abs=1e-9)
    assert tally.booked == {"change": pytest.approx(0.5 * 150.0 * 0.08**2, rel=1e-3)}


@pytest.mark.parametrize("late", [False, True], ids=["lost", "late"])
@pytest.mark.parametrize("begun", [5, 40, 70])
def test_a_hand_that_presses_in_after_a_gap_of_a_change_gets_back_what_it_did(begun: int, late: bool) -> None:
    """The ramp pauses in the gap, or goes on while the loop is late; the hand then presses deeper and draws back."""
    bench = Handled(bench_plan(Wall("handle", 100.0, position=0.0)), x=0.005)
    stiffening(bench, 100.0, 500.0)
    deepest = False
    for number in range(500):
        way = 0.0009 if number > 75 else 0.0
        deepest = deepest or bench.x + way > 0.03
        to = max(-0.002, bench.x - 0.0003) if deepest and number > 200 else min(0.03, bench.x + way)
        if late and number == begun:
            bench.period += 14
        bench.move(to=to, lost=not late and begun <= number < begun + 14)
    assert bench.tripped is None
    assert bench.cycle.ledgers[0].tally.largest == pytest.approx(0.0, abs=1e-3)


def test_the_controller_takes_back_no_energy_that_a_change_has_granted() -> None:
    """The hand draws back as slowly from a wall that a change has made stiff as from one that was stiff before."""
    taken = []
    for soft in (100.0, 499.999):
        plan = bench_plan(Wall("handle", soft, position=0.0))
        bench = Handled(replace(plan, scene=replace(plan.scene, passivity="controller")), x=0.03)
        stiffening(bench, soft, 500.0)
        for _ in range(120):
            bench.move(to=0.03)
        before = bench.cycle.ledgers[0].tally.taken
        for number in range(600):
            bench.move(to=0.03 - 5e-5 * number)
        taken.append(bench.cycle.ledgers[0].tally.taken - before)
    assert taken[0] == pytest.approx(taken[1], rel=0.1)


def test_forces_of_changes_that_are_over_are_forgotten() -> None:
    bench = Handled(bench_plan(Wall("handle", 100.0, position=0.0)), x=0.005)
    for _ in range(5):
        for soft, stiff in ((100.0, 200.0), (200.0, 100.0)):
            stiffening(bench, soft, stiff)
            for _ in range(101):
                bench.move(to=0.005)
    stiffening(bench, 100.0, 200.0)
    assert len(bench.axis.place._resting()) == 2


# Elements with a memory: the place alone does not tell what they store.


BESIDE_WEIGHTS: dict[str, tuple[Element, float]] = {
    "free side of a plate": (Proxy("handle", 400.0, position=0.001), 1.0),
    "relaxed tissue": (StandardLinearSolid("handle", rest=200.0, branch=300.0, time=0.1), -1.0),
    "slowly relaxed tissue": (GeneralisedMaxwell("handle", rest=200.0, branches=((300.0, 0.1),)), -1.0),
}


@pytest.mark.parametrize("name", BESIDE_WEIGHTS)
def test_a_weight_beside_an_element_with_a_memory_is_no_source(name: str) -> None:
    """The weight moves the handle over 20 mm and is lifted again, so that the hand gets no more than the leak."""
    element, down = BESIDE_WEIGHTS[name]
    bench = Handled(bench_plan(element, Gravity("handle", mass=0.5, share=down)), by_changes=True)
    for number in range(2400):
        bench.move(to=-0.01 * down * (1.0 - math.cos(2.0 * math.pi * number / 2400)))
    assert bench.tripped is None
    assert bench.given <= bench.leak + ROUNDING * bench.path


def test_a_plate_that_is_moved_while_the_handle_presses_on_it_gives_back_what_it_took() -> None:
    """The new plate begins with the handle on its other side; the old one is left, and stores nothing there."""
    old, new = (Proxy("handle", 400.0, position=place) for place in (0.019, 0.023))
    bench = Handled(bench_plan(old), x=0.0)
    for number in range(500):
        bench.move(to=0.0242 * math.sin(0.5 * math.pi * number / 500))
    begin = bench.cycle.prepare(bench_plan(old), bench_plan(new), 100)
    while not begin():  # an element with a memory is tried first
        bench.move(to=0.0242)
    for number in range(250):
        bench.move(to=0.0242 * math.cos(2.0 * math.pi * number / 250))
    assert bench.tripped is None
