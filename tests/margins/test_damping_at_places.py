"""Damping that differs from place to place: each pair of stiffness and damping counts, against loops by hand."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
from scipy.optimize import brentq

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.numerics.coupled import spring_damper
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, Local
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.loops import PERIOD, ByHand

PLANT = Plant(0.3, 1.0, torque_lag=0.2e-3)
DELAY, EFFORT = 0.4e-3, 94.0


def group(*elements: Element, effort: float = EFFORT) -> Group:
    member = Member("a", PLANT, DELAY, elements, "exact-foh", "backward-difference", effort=effort)
    return Group((member,), (), PERIOD)


def growth(stiffness: float, damping: float) -> float:
    return ByHand(PLANT, DELAY, stiffness, damping).growth()


SPRING_LIMIT = brentq(lambda stiffness: growth(stiffness, 0.0) - 1.0, 100.0, 5000.0)


def first_growth(loop: Callable[[float], float]) -> float:
    """Return the first stiffness, upwards from 10, at which a loop grows."""
    high = 10.0
    while loop(1.05 * high) <= 1.0:
        high *= 1.05
    return float(brentq(lambda stiffness: loop(stiffness) - 1.0, high, 1.05 * high))


def test_a_linear_body_with_loss_is_judged_where_its_damping_is_large() -> None:
    """With the exponent 1 the slope is the same at any depth, and the damping grows with the push: once "stable"."""
    body = HuntCrossley("a", 5.0, 0.02, exponent=1.0, loss=5.0)
    found = group(body).stability
    assert growth(body.stiffness, 5.0 * EFFORT) == pytest.approx(1.16014, abs=1e-4)
    assert (found.verdict, found.limit.value) == (Verdict.UNSTABLE, 0.0)
    assert found.spectral_radius == pytest.approx(growth(body.stiffness, 5.0 * EFFORT), abs=1e-9)
    assert group(body, effort=20.0).stability.verdict is Verdict.STABLE
    assert max(growth(body.stiffness, 5.0 * push) for push in (1e-6, 1.0, 5.0, 10.0, 20.0)) < 1.0


@dataclass(frozen=True)
class Syrup:
    """A force against the velocity from `position` on, of which `linearised` says nothing."""

    axis: str
    thickness: float
    position: float = 0.02
    name: str = "syrup"
    needs: ClassVar = (Signal.POSITION, Signal.VELOCITY)

    def force(self, position: float, velocity: float) -> float:
        return -self.thickness * velocity if position > self.position else 0.0

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


@dataclass(frozen=True)
class BoundedSyrup(Syrup):
    def local(self, lower: float, upper: float) -> Local:
        return Local((0.0, 0.0), (0.0, 0.0), self.thickness if upper >= self.position else 0.0)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        return (self.position,)


@pytest.mark.parametrize("kind", [Syrup, BoundedSyrup])
@pytest.mark.parametrize(("thickness", "verdict"), [(300.0, Verdict.STABLE), (500.0, Verdict.UNSTABLE)])
def test_a_damper_without_a_spring_is_judged(kind: type[Syrup], thickness: float, verdict: Verdict) -> None:
    moving = growth(1e-9, thickness)  # a spring that leaves the handle nearly free
    assert (moving > 1.0) == (verdict is Verdict.UNSTABLE)
    found = group(kind("a", thickness)).stability
    assert found.verdict is verdict
    assert found.spectral_radius == pytest.approx(max(moving, 1.0), abs=1e-6)


@dataclass(frozen=True)
class Viscoelastic:
    """A spring whose damping is a share of its stiffness."""

    axis: str
    stiffness: float
    time: float
    name: str = "viscoelastic"
    needs: ClassVar = (Signal.POSITION, Signal.VELOCITY)

    def force(self, position: float, velocity: float) -> float:
        return -self.stiffness * (position + self.time * velocity)

    def local(self, lower: float, upper: float) -> Local:
        slope = self.stiffness, self.stiffness
        return Local((-self.stiffness * upper, -self.stiffness * lower), slope, self.stiffness * self.time)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        return -effort / self.stiffness, effort / self.stiffness

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, -self.stiffness * self.time]])


@pytest.mark.parametrize("time", [1e-3, 0.05])
def test_the_limit_of_a_damping_that_scales_with_the_stiffness(time: float) -> None:
    """Once 1362 instead of 7773 N/m, and 21675 instead of 6373 N/m."""
    limit = group(Viscoelastic("a", 500.0, time)).stability.stiffness_limit.stable
    assert limit == pytest.approx(first_growth(lambda stiffness: growth(stiffness, stiffness * time)), rel=1e-6)


@dataclass(frozen=True)
class Hardening:
    """k·(x + c·x³), of which `linearised` states the slope in the middle."""

    axis: str
    stiffness: float
    cube: float
    name: str = "hardening"
    needs: ClassVar = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -self.stiffness * (position + self.cube * position**3)

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


def test_the_limit_of_a_sampled_force_is_where_the_motor_holds_it_last() -> None:
    """Once 51 instead of 35 N/m: with another stiffness no place was added between the first ones."""

    def steepest(stiffness: float) -> float:
        end = brentq(lambda x: stiffness * (x + 100.0 * x**3) - EFFORT, 0.0, 100.0)
        return float(stiffness * (1.0 + 300.0 * end**2))

    exact = brentq(lambda stiffness: steepest(stiffness) - SPRING_LIMIT, 1.0, 900.0)
    limit = group(Hardening("a", 100.0, 100.0)).stability.stiffness_limit.stable
    assert limit == pytest.approx(exact, rel=5e-3)


@dataclass(frozen=True)
class WrongMass(DampedSprungMass):
    """A virtual mass whose `linearised` is softer than what the loop runs."""

    def linearised(self) -> StateSpace:
        return gain([[-0.05, 0.0]])


def test_a_virtual_mass_is_judged_by_what_the_loop_runs() -> None:
    true, told = (group(kind("a", 5000.0, 3.0)).stability for kind in (DampedSprungMass, WrongMass))
    assert true.verdict is Verdict.UNSTABLE
    assert told == replace(true, find_limit=told.find_limit)


@dataclass(frozen=True)
class HardeningShaft:
    """A shaft that is stiffer than it states from some twist on."""

    axes: tuple[str, str] = ("a", "b")
    stiffness: float = 50.0
    name: str = "hardening_shaft"
    needs: ClassVar = (Signal.POSITION,)

    def begin(self, period: float) -> Callable[[float, float], tuple[float, float]]:
        def law(first: float, second: float) -> tuple[float, float]:
            twist = first - second
            force = -self.stiffness * (twist + 1e8 * twist**3)
            return force, -force

        return law

    def linearised(self) -> StateSpace:
        return spring_damper(self.stiffness, 0.0, 1.0)


def test_a_coupling_of_another_package_is_never_passive_and_told() -> None:
    members = tuple(Member(name, PLANT, DELAY, (), None, "backward-difference") for name in ("a", "b"))
    shaft: CouplingElement = HardeningShaft()
    found = Group(members, (shaft,), PERIOD).stability
    assert found.verdict is Verdict.STABLE
    (law,) = found.own_laws
    assert (law.element, law.places, law.stated, law.beyond) == ("hardening_shaft", 0, 50.0, ("two axes",))


DAMPED: dict[str, Element] = {
    "spring": Spring("a", 100.0, damping=60.0),
    "one side": Spring("a", 100.0, position=-0.2, damping=60.0, negative_coefficient=0.0),
    "end stop": EndStop("a", 100.0, lower=-0.2, upper=-0.1, damping=60.0),
}


@pytest.mark.parametrize("beside", DAMPED)
def test_a_stiff_element_has_the_damping_of_another_wherever_both_act(beside: str) -> None:
    """Once 910 instead of more than 5000 N/m: the other element was left out where it had two sides."""
    wall: AnyElement = Wall("a", 2000.0, position=0.01)
    found = group(wall, DAMPED[beside]).stability  # type: ignore[arg-type]
    exact = first_growth(lambda stiffness: growth(stiffness + 100.0, 60.0))
    assert SPRING_LIMIT < 2000.0 < exact
    assert found.verdict is Verdict.STABLE
    assert found.stiffness_limit.stable == pytest.approx(exact, rel=1e-6)


def test_beyond_its_saturation_a_damped_spring_gives_no_damping() -> None:
    """At rest there its force does not depend on a small speed, so a wall beside it is undamped."""
    saturated = Spring("a", 1000.0, damping=60.0, positive_saturation=1.0)
    assert math.isclose(saturated.local(0.5, 0.5).damping, 0.0)
    assert saturated.local(0.4, 0.5).damping == 60.0
    assert group(saturated, Wall("a", 2000.0, position=0.01)).stability.verdict is Verdict.UNSTABLE
