"""Energy of whole runs: what a scene gives of its own trips, what a sampled scene leaks does not."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.assessing.result import Result, Trace
from haptic_fieldbus.drive.rig import Limits, Rig, default_axis
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.running.changes import Changes
from haptic_fieldbus.scenes.braking_pulse import BrakingPulse
from haptic_fieldbus.scenes.element import AnyElement, Law
from haptic_fieldbus.scenes.gravity import Gravity
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal, Workspace
from tests.builders import endless_rig
from tests.system.test_run import LINEAR

STIFFNESS, SURFACE = 600.0, 0.02
SOURCE = 0.02
"""[J] that a planted source gives in a contact."""


@dataclass(frozen=True)
class Planted:
    """The wall of the library with a source of energy; what it says of itself is said of the wall."""

    axis: str
    source: float
    """[J] in each contact."""
    name: str = "planted"
    needs: ClassVar = (Signal.POSITION,)

    def stored(self, position: float) -> float:
        return 0.5 * STIFFNESS * max(position - SURFACE, 0.0) ** 2

    def linearised(self) -> StateSpace:
        return gain([[-STIFFNESS, 0.0]])


@dataclass(frozen=True)
class HarderOnTheWayOut(Planted):
    """Hysteresis with the wrong sense: a constant force more on the way from the deepest place."""

    def begin(self, period: float) -> Law:
        deepest = 0.0

        def law(position: float) -> float:
            nonlocal deepest
            depth = position - SURFACE
            if depth <= 0.0:
                deepest = 0.0
                return 0.0
            deepest = max(deepest, depth)
            return -STIFFNESS * depth - (self.source / deepest if depth < deepest - 2e-5 else 0.0)

        return law


@dataclass(frozen=True)
class Late(Planted):
    """A spring that answers where the handle was: over a half sine of the amplitude A, ½·π·K·A²·sin(ω·lag) more."""

    def begin(self, period: float) -> Law:
        amplitude, omega = 0.009, math.sqrt(STIFFNESS / 0.63)
        lag = math.asin(min(1.0, self.source / (0.5 * math.pi * STIFFNESS * amplitude**2))) / omega
        past = [0.0] * round(lag / period)

        def law(position: float) -> float:
            past.append(max(position - SURFACE, 0.0))
            return -STIFFNESS * past.pop(0)

        return law


@dataclass(frozen=True)
class Kick(Planted):
    """A wall that pushes on for 5 mm outside, when the handle has left it."""

    def begin(self, period: float) -> Law:
        kicks, before = False, -1.0

        def law(position: float) -> float:
            nonlocal kicks, before
            depth, moved = position - SURFACE, position - SURFACE - before
            kicks = depth > 0.0 or (kicks and moved <= 0.0 and depth > -0.005)
            before = depth
            return -STIFFNESS * depth if depth > 0.0 else -self.source / 0.005 * kicks

        return law


def scene_with(*elements: AnyElement) -> Scene:
    return Scene("planted", "for tests", LINEAR, elements)


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize(
    ("kind", "hand"),
    [
        (HarderOnTheWayOut, "tap"),
        pytest.param(HarderOnTheWayOut, "push", marks=pytest.mark.thorough("another hand")),
        pytest.param(Late, "tap", marks=pytest.mark.thorough("another source")),
        (Kick, "tap"),
    ],
)
def test_a_source_of_20_mj_a_contact_trips(kind: Callable[[str, float], Planted], hand: str) -> None:
    scene = scene_with(kind("handle", SOURCE))
    with pytest.raises(SafetyTripError, match=r"put .* mJ more into the handle than allowed") as caught:
        run(scene, endless_rig(scene), hand=hand, duration=5.0)
    result = caught.value.result
    assert isinstance(result, Result)
    assert [trip.name for trip in result.trips] == ["energy limit"]
    (ledger,) = result.passivity
    assert ledger.limit < ledger.largest < SOURCE


@pytest.mark.thorough("three runs without their source")
@pytest.mark.parametrize("kind", [HarderOnTheWayOut, Late, Kick])
def test_the_same_law_without_its_source_does_not(kind: Callable[[str, float], Planted]) -> None:
    scene = scene_with(kind("handle", 0.0))
    (ledger,) = run(scene, endless_rig(scene), hand="tap", duration=5.0).passivity
    assert ledger.largest < 0.1 * ledger.limit


@pytest.mark.thorough("another run of a planted source")
def test_what_a_damper_took_before_the_wall_is_no_credit_for_it() -> None:
    pulse = BrakingPulse("handle", damping=40.0, duration=0.01, rearm=0.002, position=0.012)
    scene = scene_with(pulse, HarderOnTheWayOut("handle", 1.5 * SOURCE))
    with pytest.raises(SafetyTripError, match="more into the handle than allowed"):
        run(scene, endless_rig(scene), hand="tap", duration=5.0)


def contacts(trace: Trace) -> list[tuple[float, float]]:
    """Work of the motor in each contact, and what its hold may leak [J]; from the true motion at 16 points a period."""
    force, x, t = trace.force, trace.position, trace.times
    touching = np.abs(force) > 0.05
    cuts = np.flatnonzero(np.diff(touching.astype(int)))
    age = 0.5e-3 + plan("wall").delay.total
    found = []
    for begin, end in pairwise(cuts):
        if touching[begin + 1]:
            part = slice(begin, end + 2)
            way = np.diff(x[part])
            work = float((0.5 * (force[part][1:] + force[part][:-1]) * way).sum())
            found.append((work, float((STIFFNESS * age * way**2 / np.diff(t[part])).sum())))
    return found


@pytest.mark.thorough("two sources", quick=1)
@pytest.mark.parametrize("source", [0.003, 0.0])
def test_the_ledger_agrees_with_the_work_of_the_true_motor_on_the_true_shaft(source: float) -> None:
    """Taken from the simulation's own motion: the wall leaks K·∫(T/2 + τ)·v² dt, and a source comes on top of it."""
    scene = scene_with(HarderOnTheWayOut("handle", source))
    result = run(scene, endless_rig(scene), hand="tap", duration=3.0)
    found = contacts(result.traces[0])
    assert len(found) >= 2
    above = [work - granted for work, granted in found]
    (ledger,) = result.passivity
    assert max(above) == pytest.approx(source, abs=4e-4)
    assert ledger.largest == pytest.approx(source, abs=4e-4)


@pytest.mark.thorough("a minute of each wall at half its limit")
@pytest.mark.parametrize(
    ("scene", "rate"), [("wall", 1000.0), ("damped_wall", 1000.0), ("wall", 250.0), ("wall", 2000.0)]
)
def test_no_wall_at_half_its_limit_trips(scene: str, rate: float) -> None:
    duration = 60.0 if rate == 1000.0 else 5.0
    settings = {"wall.stiffness": "max/2"}
    rig = endless_rig(scene, "generic_cia402")
    result = run(scene, rig, hand="tap", rate=rate, duration=duration, settings=settings)
    assert all(ledger.largest < 0.1 * ledger.limit for ledger in result.passivity)


CHANGES = {
    "wall": [(2.0, {"wall.stiffness": 1200.0}), (3.0, {"wall.stiffness": 100.0}), (4.0, {"wall.position": 0.01})],
    "sprung_mass": [(1.0, {"sprung_mass.stiffness": 400.0}), (2.0, {"sprung_mass.mass": 1.5})],
    "virtual_coupling": [(0.8, {"virtual_coupling.stiffness": 800.0}), (2.0, {"virtual_coupling.mass": 0.2})],
    "virtual_shaft": [(2.0, {"shaft.stiffness": 400.0}), (3.0, {"wall.position": 0.005})],
    "gravity": [(2.0, {"gravity.mass": 0.6})],
    "detents": [(2.0, {"detents.amplitude": 0.3}), (3.0, {"detents.position": -0.02})],
}


@pytest.mark.thorough("live changes of six scenes", quick=("wall",))
@pytest.mark.parametrize("scene", CHANGES)
def test_no_live_change_trips(scene: str) -> None:
    result = run(scene, endless_rig(scene), duration=5.0, changes=CHANGES[scene])
    assert all(ledger.largest < 0.1 * ledger.limit for ledger in result.passivity)


@pytest.mark.thorough("a slow change")
def test_what_a_change_under_a_leaning_hand_gives_is_booked() -> None:
    """Slowly from K to 2K under F: ½·K·∫x(s)² ds with x = F/((1 + s)·K) is F²/4K; friction moves x by ±4 %."""
    changes = Changes([(2.0, {"wall.stiffness": 2.0 * STIFFNESS})], ramp=2.0)
    (ledger,) = run("wall", duration=5.0, changes=changes).passivity
    assert ledger.booked["change"] == pytest.approx(6.0**2 / (4.0 * STIFFNESS), rel=0.1)


def half_damped() -> Rig:
    """The shipped bench with half its viscous damping, and without the Coulomb friction that holds small motions."""
    axis = default_axis(Workspace.LINEAR, bus="bus", node=1, profile="maxon_epos4")
    assert axis.viscous_damping is not None
    axis = replace(axis, viscous_damping=0.5 * axis.viscous_damping, coulomb_friction=0.0, limits=Limits(speed=100.0))
    return Rig({"bus": CanSection("haptic_sim", "sim")}, {"handle": axis})


def too_stiff(**wall: object) -> Wall:
    """A wall at 1.3 times the limit of that bench."""
    mild = Wall("handle", STIFFNESS, **wall)  # type: ignore[arg-type]
    stability = plan(Scene("wall", "", LINEAR, (mild,)), half_damped(), bus="sim").stability
    assert stability is not None
    assert stability.stiffness_limit.stable is not None
    return replace(mild, stiffness=1.3 * stability.stiffness_limit.stable)


def rebounds(result: Result, surface: float, begin: float) -> list[float]:
    """Largest distances from the surface between each two crossings of it [m], with their signs."""
    (trace,) = result.traces
    x = trace.position[trace.times > begin] - surface
    cuts = np.flatnonzero(np.diff(np.sign(x)))
    parts = [x[a + 1 : b + 1] for a, b in pairwise(cuts)]
    return [float(part[np.abs(part).argmax()]) for part in parts]


def rendered(scene: Scene, **options: object) -> Result:
    return run(scene, half_damped(), bus="sim", hand="none", duration=3.0, force=True, **options)  # type: ignore[arg-type]


@pytest.mark.thorough("two runs of seconds")
def test_a_wall_beyond_its_limit_grows_and_with_the_controller_stays_below_its_first_rebound() -> None:
    """Begun 6 mm from its place, when the limit has faded in; damping of 1.3·b against b grows by e^(0.15·b/m·t)."""
    wall = too_stiff(position=0.006, sides="bilateral")
    free = Scene("wall", "", LINEAR, (wall,))
    grown = np.abs(rebounds(rendered(free), 0.006, 0.6))
    assert grown[-1] > 1.4 * grown[0]
    assert np.all(np.diff(grown) > 0.0)
    result = rendered(replace(free, passivity="controller"))
    calmed = np.abs(rebounds(result, 0.006, 0.6))
    assert np.all(calmed[1:] < calmed[0])
    assert calmed[-1] < 0.5 * calmed[0]
    cost = result.passivity[0].controller
    assert cost is not None
    assert 0.0 < cost.peak < 0.05 * np.abs(result.traces[0].force).max()
    # Energy at the first rebound, which bench and controller share in proportion to their dampings.
    assert cost.energy < 0.5 * wall.stiffness * (1.1 * calmed[0]) ** 2 + 0.5 * wall.stiffness * 0.006**2


@pytest.mark.thorough("two bouncing weights")
def test_a_weight_on_that_wall_bounces_lower_with_the_controller() -> None:
    floor = too_stiff(position=-0.05, side="negative")
    bouncing = Scene("bounce", "", LINEAR, (floor, Gravity("handle", 0.5)))
    heights = [each for each in rebounds(rendered(bouncing, fade_in=0.1), -0.05, 0.12) if each > 0.0]
    result = rendered(replace(bouncing, passivity="controller"), fade_in=0.1)
    lower = [each for each in rebounds(result, -0.05, 0.12) if each > 0.0]
    assert all(low < high for low, high in zip(lower, heights, strict=False))
    assert max(lower[1:]) < lower[0]


@pytest.mark.thorough("two runs of a tap")
def test_a_passive_wall_costs_the_controller_little_and_the_hand_nothing_that_it_feels() -> None:
    """The controller takes what the hold leaks, also where the bench would have: well below the 8 % of a hand."""
    wall = Scene("wall", "", LINEAR, (Wall("handle", STIFFNESS, SURFACE),))
    controlled = run(replace(wall, passivity="controller"), endless_rig(wall), hand="tap", duration=3.0)
    plain = run(wall, endless_rig(wall), hand="tap", duration=3.0)
    assert plain.torque_error is not None
    assert controlled.torque_error is not None
    assert plain.torque_error.contact is not None
    assert controlled.torque_error.contact is not None
    assert abs(controlled.torque_error.contact - plain.torque_error.contact) < 0.04
    assert plain.passivity[0].controller is None
