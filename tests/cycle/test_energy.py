"""The energy ledger on motions whose energy has a closed form."""

import math
from dataclasses import dataclass, replace

import pytest

from haptic_fieldbus.cycle.energy import Ledger, LedgerAxis, Tally
from haptic_fieldbus.cycle.safety import Permission
from haptic_fieldbus.cycle.state import AxisState, Sensed
from haptic_fieldbus.cycle.tied_energy import bind_ledger
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import plan_of, scene_of

STIFFNESS, AMPLITUDE, TURN, PERIOD = 600.0, 0.01, 80, 1e-3
"""Of the handle's sine: amplitude [m] and periods in a turn."""
ANGLE = 2.0 * math.pi / TURN


@dataclass(frozen=True)
class Spring:
    """A spring about 0 that does not state its energy; its linear model states the stiffness `granted`."""

    axis: str
    granted: float = STIFFNESS
    name: str = "spring"
    needs: tuple[Signal, ...] = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -STIFFNESS * position

    def linearised(self) -> StateSpace:
        return gain([[-self.granted, 0.0]])


@dataclass(frozen=True)
class KnownSpring(Spring):
    def stored(self, position: float) -> float:
        return 0.5 * STIFFNESS * position * position


class Bench:
    """A ledger whose axis is moved by hand from `start` on, and whose force is sent in the steps of the drive."""

    def __init__(self, element: Element, delay: float = 0.0, start: float = 0.0) -> None:
        plan = plan_of(scene_of(element))
        (axis,) = plan.axes
        axis = replace(axis, delay=replace(axis.delay, bus=delay, compute=0.0, drive=0.0, torque_loop=0.0))
        self.unit = axis.effort_unit
        self.state, self.permission = AxisState(position=start), Permission(fade=1.0, unchanged=True)
        self.trips: list[tuple[float, float]] = []
        port = LedgerAxis(axis, self.state, Sensed(), self.permission)
        self.ledger = Ledger([port], [(element,)], (), PERIOD, lambda *trip: self.trips.append(trip))
        self.ledger.tally.limit = 1e3
        self.step = bind_ledger(self.ledger, self._render, controls=False)
        self.force = 0.0

    @property
    def tally(self) -> Tally:
        return self.ledger.tally

    def move(self, position: float, force: float) -> None:
        """Latch a position, look at the period that has passed, and send a force for the coming one."""
        self.state.position, self.force = position, force
        self.step()

    def _render(self) -> None:
        self.state.target, self.state.force = round(self.force / self.unit), self.force


def turned(bench: Bench, turns: int = 3) -> float:
    """Move on a sine and return the most that an account was above what is granted [J]."""
    for k in range(turns * TURN + 2):
        x = AMPLITUDE * math.sin(ANGLE * k)
        bench.move(x, -STIFFNESS * x)
    return bench.tally.largest


def leak(delay: float) -> float:
    """Of half a turn [J]: N/4·K·A²·(cos ψ − cos(θ + ψ)), θ = ωT, ψ = ω·td; `delay` in periods."""
    turn = ANGLE * delay
    return 0.25 * TURN * STIFFNESS * AMPLITUDE**2 * (math.cos(turn) - math.cos(ANGLE + turn))


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.56, 1.0, 1.7, 2.0])
def test_without_a_grant_the_ledger_shows_the_leak_of_its_closed_form(delay: float) -> None:
    """Each half turn is a contact; to the θ by which a contact of whole periods is off."""
    found = turned(Bench(KnownSpring("handle", granted=0.0), delay * PERIOD))
    assert found == pytest.approx(leak(delay), rel=2.0 * ANGLE)


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.56])
def test_a_contact_at_constant_speed_shows_its_leak_to_the_last_digit(delay: float) -> None:
    """In ways of one step of force, M deep: M, and 3·M − 3 a period later, by sums over the samples.

    The account opens after the first way under force, two ways deep: 2 are stored there, and 1 − td/T is taken before.
    """
    bench, deep = Bench(KnownSpring("handle", granted=0.0), delay * PERIOD), 200
    way = bench.unit / STIFFNESS
    for place in [0, *range(1, deep + 1), *range(deep - 1, -1, -1), 0, 0, 0]:
        bench.move(place * way, -STIFFNESS * place * way)
    ways = (1.0 - delay) * deep + delay * (3 * deep - 3) - (1.0 + delay)
    assert bench.tally.largest == pytest.approx(ways * STIFFNESS * way**2, rel=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.56, 1.0, 1.7, 2.0])
def test_what_is_granted_is_the_leak_and_no_more(delay: float) -> None:
    assert abs(turned(Bench(KnownSpring("handle"), delay * PERIOD))) < 0.1 * leak(delay)


@pytest.mark.parametrize("delay", [0.0, 0.56, 1.7])
def test_an_element_that_states_nothing_is_judged_by_what_it_took(delay: float) -> None:
    bench = Bench(Spring("handle"), delay * PERIOD)
    assert bench.ledger.memory.silence > 0
    assert turned(bench, turns=20) < 0.2 * leak(delay)


def test_twice_the_stiffness_that_is_stated_is_seen() -> None:
    assert turned(Bench(KnownSpring("handle", granted=0.5 * STIFFNESS), 0.56 * PERIOD)) > 0.4 * leak(0.56)


def contact(bench: Bench, source: float, periods: int = 60, depth: float = 0.01) -> None:
    """One touch of the wall from outside, whose way out is harder by a constant force that gives `source` [J]."""
    for k in range(-5, periods + 6):
        x = depth * math.sin(math.pi * k / periods) if 0 <= k <= periods else -0.001
        force = -STIFFNESS * x - (source / depth if 2 * k > periods else 0.0) if x > 0.0 else 0.0
        bench.move(x, force)


WALL = Wall("handle", STIFFNESS)


def test_a_source_in_a_contact_is_what_the_account_shows() -> None:
    bench = Bench(WALL, 0.56 * PERIOD)
    contact(bench, 0.02)
    assert bench.tally.largest == pytest.approx(0.02, rel=0.1)


def test_a_source_above_the_limit_trips_and_one_below_does_not_however_often() -> None:
    bench = Bench(WALL, 0.56 * PERIOD)
    bench.tally.limit = 0.005
    for _ in range(50):
        contact(bench, 0.003)
    assert not bench.trips
    contact(bench, 0.02)
    assert bench.trips
    assert bench.trips[0][1] == 0.005


def test_credit_does_not_outlive_a_contact() -> None:
    """What a first contact takes, here 40 mJ that it does not give back, is no credit for the second."""
    alone, after = Bench(WALL, 0.56 * PERIOD), Bench(WALL, 0.56 * PERIOD)
    contact(after, -0.04)
    contact(after, 0.02)
    contact(alone, 0.02)
    assert after.tally.largest == pytest.approx(alone.tally.largest, rel=1e-6)


def test_a_start_inside_gives_back_what_was_stored_there() -> None:
    bench = Bench(WALL)
    for k in range(101):
        x = 0.02 * (1.0 - k / 100)
        bench.move(x, -STIFFNESS * x)
    assert bench.tally.largest < 0.03 * 0.5 * STIFFNESS * 0.02**2


def test_while_the_limit_fades_in_energy_is_booked_and_not_judged() -> None:
    bench = Bench(WALL)
    bench.permission.fade, bench.permission.unchanged = 0.5, False
    contact(bench, 0.05)
    assert bench.tally.booked["fade-in"] == pytest.approx(0.05, rel=0.1)
    assert bench.tally.largest == 0.0
    bench.permission.fade, bench.permission.unchanged = 1.0, True
    contact(bench, 0.02)
    assert bench.tally.largest == pytest.approx(0.02, rel=0.1)


def test_energy_above_the_limit_that_comes_while_the_limit_fades_in_is_booked_and_trips_nothing() -> None:
    bench = Bench(WALL)
    bench.tally.limit = 0.005
    bench.permission.fade, bench.permission.unchanged = 0.5, False
    contact(bench, 0.05)
    assert bench.tally.booked["fade-in"] == pytest.approx(0.05, rel=0.1)
    assert not bench.trips


def test_a_contact_in_which_the_limit_has_faded_in_is_booked_until_then_and_judged_from_there() -> None:
    """In against no force: ½·K·x² is there that nobody put in. Out by the law, and 20 mJ beyond."""
    bench, depth, source = Bench(WALL), 0.01, 0.02
    bench.permission.fade, bench.permission.unchanged = 0.5, False
    for k in range(51):
        bench.move(depth * k / 50, -1e-9 * k)
    bench.move(depth, -STIFFNESS * depth)
    bench.permission.fade, bench.permission.unchanged = 1.0, True
    for k in range(51):
        x = depth * (1.0 - k / 50)
        bench.move(x, -STIFFNESS * x - source / depth)
    for _ in range(5):
        bench.move(-0.001, 0.0)
    assert bench.tally.booked["fade-in"] == pytest.approx(0.5 * STIFFNESS * depth**2, rel=0.1)
    assert bench.tally.largest == pytest.approx(source, rel=0.15)


@pytest.mark.parametrize("inside", [0.0, 0.01])
def test_a_handle_at_rest_is_given_nothing_while_the_limit_fades_in(inside: float) -> None:
    bench = Bench(WALL, start=inside)
    bench.permission.fade, bench.permission.unchanged = 0.5, False
    for _ in range(20):
        bench.move(inside, -STIFFNESS * inside)
    bench.permission.fade, bench.permission.unchanged = 1.0, True
    for _ in range(20):
        bench.move(inside, -STIFFNESS * inside)
    assert bench.tally.booked == {}


@pytest.mark.parametrize("position", [0.004, 0.01])
def test_a_change_at_rest_grants_the_energy_by_which_the_spring_grows_there(position: float) -> None:
    """½·(K₂ − K₁)·x², in equal steps; moved back afterwards the handle gets all of it."""
    bench, ramp, after = Bench(WALL), 100, 2.0 * STIFFNESS
    for k in range(50):
        bench.move(position * k / 49, -STIFFNESS * position * k / 49)
    bench.ledger.exchange([(Wall("handle", after),)], (), ramp)
    for k in range(ramp + 2):
        bench.move(position, -(STIFFNESS + (after - STIFFNESS) * min(1.0, k / ramp)) * position)
    assert bench.tally.booked["change"] == pytest.approx(0.5 * (after - STIFFNESS) * position**2, rel=1e-6)
    for k in range(50):
        bench.move(position * (1.0 - k / 49), -after * position * (1.0 - k / 49))
    assert bench.tally.largest < 0.05 * 0.5 * after * position**2
    assert not bench.ledger.changing


def test_a_virtual_mass_keeps_its_credit_until_it_has_been_silent_for_a_turn() -> None:
    mass = SprungMass("handle", 200.0, 0.5)
    turn = 2.0 * math.pi * math.sqrt(0.5 / 200.0) / PERIOD
    assert Bench(mass).ledger.memory.silence == math.ceil(turn)


def test_the_limit_holds_a_count_of_the_largest_force() -> None:
    (axis,) = plan_of(scene_of(WALL)).axes
    bench = Ledger([LedgerAxis(axis, AxisState(), Sensed(), Permission())], [(WALL,)], (), PERIOD, lambda *_: None)
    assert bench.tally.limit == pytest.approx(0.005 + axis.limits.effort * axis.resolution)
