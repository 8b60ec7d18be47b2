"""The energy ledger on motions whose energy has a closed form."""

import math
from dataclasses import dataclass, replace

import pytest

from haptic_fieldbus.cycle.energy import EnergyRecord, Ledger, LedgerAxis, shares
from haptic_fieldbus.cycle.energy_steps import bind_ledger
from haptic_fieldbus.cycle.laws import AxisState, Sensed
from haptic_fieldbus.cycle.safety import Permission, TripKind
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.energy import axis_terms, larger_of
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
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
        self.trips: list[tuple[object, ...]] = []
        port = LedgerAxis(axis, self.state, Sensed(), self.permission)
        self.ledger = Ledger([port], [(element,)], (), PERIOD, lambda *trip: self.trips.append(trip))
        self.ledger.tally.limit = 1e3
        self.step = bind_ledger(self.ledger, controls=False)
        self.force = self.law = 0.0
        self.t_ns = 0

    @property
    def tally(self) -> EnergyRecord:
        return self.ledger.tally

    def move(self, position: float, force: float, law: float | None = None, steps: int = 1) -> None:
        """Latch a position, look at the period that has passed, and send a force for the coming one.

        The scene's law asks for `law`, else for what is sent; the sample comes `steps` periods after the one before.
        """
        self.state.position, self.force, self.law = position, force, force if law is None else law
        self.state.steps = steps
        self.t_ns += round(1e9 * PERIOD)
        self.state.moved_ns = self.t_ns
        self.step()
        self.state.target, self.state.force = round(self.force / self.unit), self.law

    def loosen(self, fade: float = 0.5) -> None:
        """From now on another force may be sent than that of the law."""
        self.permission.fade = fade
        self.permission.loosen()

    def settle(self) -> None:
        """The law is followed again."""
        self.permission.fade, self.permission.unchanged = 1.0, True


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
def test_a_source_of_the_size_of_the_leak_is_seen_in_full(delay: float) -> None:
    """A push of one step of force on the way out; what the spring leaks is granted beside it, and no more."""
    bench, deep = Bench(KnownSpring("handle"), delay * PERIOD), 200
    way = bench.unit / STIFFNESS
    before = 0
    for place in [0, *range(1, deep + 1), *range(deep - 1, -1, -1), 0, 0, 0]:
        bench.move(place * way, -STIFFNESS * place * way - (bench.unit if 0 < place < before else 0.0))
        before = place
    assert bench.tally.largest == pytest.approx(deep * bench.unit * way, rel=0.05)


@pytest.mark.parametrize("delay", [0.0, 0.56, 1.7])
def test_an_element_that_states_nothing_is_judged_by_what_it_took(delay: float) -> None:
    bench = Bench(Spring("handle"), delay * PERIOD)
    assert bench.ledger.memory.silence > 0
    assert turned(bench, turns=20) < 0.2 * leak(delay)


def test_twice_the_stiffness_that_is_stated_is_seen() -> None:
    assert turned(Bench(KnownSpring("handle", granted=0.5 * STIFFNESS), 0.56 * PERIOD)) > 0.4 * leak(0.56)


def contact(
    bench: Bench,
    source: float,
    periods: int = 60,
    depth: float = 0.01,
    sent: tuple[float, float] = (1.0, 1.0),
    given: float = 0.0,
) -> None:
    """One touch of the wall from outside, whose way out is harder by a constant force that gives `source` [J].

    `sent` are the shares of the law that are sent on the way in and on the way out. At its deepest pulses that ask the
    encoder may have `given` some [J].
    """
    for k in range(-5, periods + 6):
        x = depth * math.sin(math.pi * k / periods) if 0 <= k <= periods else -0.001
        force = -STIFFNESS * x - (source / depth if 2 * k > periods else 0.0) if x > 0.0 else 0.0
        bench.permission.given += given if 2 * k == periods else 0.0
        bench.move(x, sent[2 * k > periods] * force, force)


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
    """Energy that a first contact takes, here 40 mJ that it does not give back, is no credit for the second."""
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


STORED = 0.5 * STIFFNESS * 0.01**2
"""Of the wall at the deepest place of a contact [J]."""


def test_a_sound_law_of_which_less_is_sent_on_the_way_in_is_forgiven_what_that_gives() -> None:
    """Half of ½·K·x² is taken, all of it given back: the other half is forgiven. The law itself gives nothing."""
    bench = Bench(WALL)
    bench.loosen()
    contact(bench, 0.0, sent=(0.5, 1.0))
    assert bench.tally.booked == {"fade-in": pytest.approx(0.5 * STORED, rel=0.1)}
    assert bench.tally.most == bench.tally.booked["fade-in"]
    assert bench.tally.largest < 0.02 * STORED
    bench.settle()
    contact(bench, 0.02)
    assert bench.tally.largest == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("sent", [(1.0, 1.0), (0.5, 0.5), (0.0, 1.0), (1.0, 0.0), (0.0, 0.0)])
def test_a_source_in_the_law_trips_whatever_is_sent_of_it(sent: tuple[float, float]) -> None:
    bench = Bench(WALL)
    bench.tally.limit = 0.005
    bench.loosen()
    contact(bench, 0.0, sent=sent)
    assert not bench.trips
    contact(bench, 0.02, sent=sent)
    assert bench.trips
    assert bench.trips[0][1] == 0.005
    assert bench.tally.largest == pytest.approx(0.02, rel=0.1)


def test_a_source_trips_when_another_force_is_sent_from_the_middle_of_a_contact_on() -> None:
    """Energy that the open account took until then counts: 20 mJ less on the way in than on the way out."""
    for soft, trips in ((0.02, True), (0.0, False)):
        bench = Bench(WALL)
        bench.tally.limit = 0.005
        for k in range(61):
            x = 0.01 * math.sin(math.pi * k / 60)
            force = -STIFFNESS * x + (soft / 0.01 if x > 0.0 and k < 30 else 0.0)
            if k == 30:
                bench.loosen()
            bench.move(x, 0.3 * force if k >= 30 else force, force)
        assert bool(bench.trips) is trips


def test_a_force_that_the_effort_limit_cut_is_no_source_when_another_force_is_sent_later() -> None:
    """Cut at half on the way in the motor took less than the law asked for; the law alone gives nothing."""
    bench = Bench(WALL)
    bench.tally.limit = 0.005
    for k in range(61):
        x = 0.01 * math.sin(math.pi * k / 60)
        force = -STIFFNESS * x
        if k == 30:
            bench.loosen()
        bench.permission.clipped += force < -3.0
        bench.move(x, max(force, -3.0), force)
    assert not bench.trips


def test_a_way_that_was_not_seen_is_none_of_the_law() -> None:
    """The handle goes from the surface to the deepest place, and back, each within one gap."""
    bench = Bench(WALL)
    bench.tally.limit = 0.005
    bench.loosen(fade=1.0)
    for x in (0.0, 0.001, 0.01, 0.0101, 0.001, 0.0, -0.001):
        bench.move(x, 0.0, -STIFFNESS * max(x, 0.0), steps=10)
    assert not bench.trips
    assert bench.tally.largest == 0.0


@pytest.mark.parametrize(
    ("permitted", "reason"),
    [("proof", "sign"), ("doubt", "sign"), ("fade", "fade-in"), ("cap", "stall")],
)
def test_what_is_forgiven_has_the_name_of_its_reason(permitted: str, reason: str) -> None:
    bench = Bench(WALL)
    if permitted == "proof":
        bench.permission.proof = lambda force: force
        bench.permission.loosen()
    elif permitted == "fade":
        bench.loosen()
    elif permitted == "doubt":
        bench.permission.cap_after_doubt(1.0)
    else:
        bench.permission.cap_at(1.0, -1.0)
    contact(bench, 0.0, sent=(0.0, 1.0))
    assert bench.tally.booked == {reason: pytest.approx(STORED, rel=0.1)}


@pytest.mark.parametrize("element", [KnownSpring("handle"), Spring("handle"), SprungMass("handle", 400.0, 0.2)])
def test_torque_held_in_gaps_is_charged_whatever_the_law_remembers(element: Element) -> None:
    """Each gap lasts 10 periods of 1 mm, in which 4 N push the handle on while the law pauses; 50 mJ are too much."""
    bench = Bench(element)
    for number in range(1, 3):
        assert not bench.trips
        bench.permission.blind, bench.permission.held = True, 4.0
        bench.permission.loosen()
        x = bench.state.position
        for _ in range(9):
            bench.move(x, 4.0, 4.0, steps=0)
        bench.permission.shift += 0.01
        bench.move(x + 0.01, 0.0, steps=10)
        bench.permission.blind = False
        for _ in range(3):
            bench.move(x + 0.01, 0.0)
        assert bench.tally.held == pytest.approx(number * 0.04, rel=0.15)
    assert {trip[2] for trip in bench.trips} == {TripKind.HELD}
    assert bench.tally.booked == {}


def test_more_within_a_second_than_is_forgiven_trips_and_the_same_over_more_seconds_does_not() -> None:
    """15 mJ each: three within a second are above 40 mJ, one in each second is not."""
    for pause, trips in ((200, True), (1000, False)):
        bench = Bench(WALL)
        bench.tally.budget = 0.04
        bench.loosen()
        for _ in range(4):
            contact(bench, 0.0, sent=(0.5, 1.0))
            bench.t_ns += pause * round(1e9 * PERIOD)
        assert bool(bench.trips) is trips
        assert bench.tally.booked["fade-in"] == pytest.approx(4 * 0.5 * STORED, rel=0.1)
        if trips:
            energy, limit, kind = bench.trips[0]
            assert (limit, kind) == (0.04, TripKind.FORGIVEN)
            assert energy == pytest.approx(3 * 0.5 * STORED, rel=0.1)


def test_what_a_drive_gave_beyond_what_it_was_sent_is_forgiven_too() -> None:
    bench = Bench(WALL)
    bench.tally.budget = 0.01
    bench.ledger.doubted(0.02)
    assert bench.tally.booked == {"echo": 0.02}
    assert bench.trips == [(0.02, 0.01, TripKind.FORGIVEN)]


@pytest.mark.parametrize("gap", [False, True])
def test_a_contact_in_which_the_limit_has_faded_in_owes_what_it_did_not_take_and_is_judged_on(gap: bool) -> None:
    """In against no force: ½·K·x² is there that nobody put in. Out by the law, and 20 mJ beyond."""
    bench, depth, source = Bench(WALL), 0.01, 0.02
    bench.loosen()
    for k in range(51):
        bench.move(depth * k / 50, -1e-9 * k, -STIFFNESS * depth * k / 50)
    bench.settle()
    bench.move(depth, -STIFFNESS * depth, steps=2 if gap else 1)
    for k in range(51):
        x = depth * (1.0 - k / 50)
        bench.move(x, -STIFFNESS * x - source / depth)
    for _ in range(5):
        bench.move(-0.001, 0.0)
    assert bench.tally.booked["fade-in"] == pytest.approx(0.5 * STIFFNESS * depth**2, rel=0.1)
    assert bench.tally.largest == pytest.approx(source, rel=0.15)


def test_a_contact_owes_no_more_than_the_effort_limit_gives_on_the_way_back() -> None:
    """A hand went through a wall of which the limit leaves little: what the law asks for in there is never given."""
    bench = Bench(WALL)
    (port,) = bench.ledger.ports
    weak, deep = replace(port.axis, limits=replace(port.axis.limits, effort=1.0)), 0.05
    bench.ledger.axes = (weak,)
    bench.loosen()
    for k in range(1001):
        bench.move(deep * k / 1000, -1e-9 * k, -STIFFNESS * deep * k / 1000)
    bench.settle()
    bench.move(deep, -1.0, -STIFFNESS * deep)
    assert bench.tally.booked["fade-in"] == pytest.approx(1.0 * deep, rel=0.05)


@pytest.mark.parametrize("inside", [0.0, 0.01])
def test_a_handle_at_rest_is_given_nothing_while_the_limit_fades_in(inside: float) -> None:
    bench = Bench(WALL, start=inside)
    bench.loosen()
    for _ in range(20):
        bench.move(inside, -STIFFNESS * inside)
    bench.settle()
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


@pytest.mark.parametrize(("given", "trips"), [(0.0, True), (0.015, False)])
def test_what_pulses_may_give_that_ask_an_encoder_is_granted_to_their_contact_and_booked(
    given: float, trips: bool
) -> None:
    """A contact that gives 20 mJ, where 10 are the limit; the next one has no grant."""
    bench = Bench(WALL)
    bench.tally.limit = 0.01
    contact(bench, source=0.02, given=given)
    assert bool(bench.trips) is trips
    assert bench.tally.booked == ({"pulses": given} if given else {})
    contact(bench, source=0.02)
    assert bench.trips


def test_a_force_with_pulses_is_judged_as_that_of_the_scene() -> None:
    bench = Bench(WALL)
    bench.tally.limit = 0.01
    bench.permission.unchanged, bench.permission.pulses = False, lambda force, bound: force
    contact(bench, source=0.02)
    assert bench.trips
    assert bench.tally.booked == {}


BODY = HuntCrossley("handle", effort=0.18, depth=0.01, exponent=2.0)
"""Its linear model has 36 N/m; at the deepest place of a blow it is eight times as stiff."""
DEEPEST = 0.08


def blow(bench: Bench, source: float = 0.0) -> tuple[float, float]:
    """A half sine into the body and out of it within 60 ms, harder on the way out by a force that gives `source` [J].

    Return the work of the held force, by sums over the samples, and the largest force [N].
    """
    sent, work, last = [0.0] * 4, 0.0, 0.0
    whole, share = shares(bench.ledger.axes[0], PERIOD)
    for k in range(-5, 70):
        x = DEEPEST * math.sin(math.pi * k / 60) if 0 <= k <= 60 else -0.001
        work += (x - last) * ((1.0 - share) * sent[-1 - whole] + share * sent[-2 - whole]) if k > -5 else 0.0
        force = BODY.force(x) - (source / DEEPEST if k > 30 and x > 0.0 else 0.0)
        sent.append(force)
        last = x
        bench.move(x, force)
    return work, max(map(abs, sent))


@pytest.mark.parametrize("delay", [0.0, 0.56, 1.7])
def test_a_body_that_stiffens_is_granted_the_leak_of_the_slope_where_the_handle_is(delay: float) -> None:
    bench = Bench(BODY, delay * PERIOD)
    work, most = blow(bench)
    assert work > 3.0 * bench.ledger.axes[0].limits.energy
    assert most < bench.ledger.axes[0].limits.effort
    assert bench.tally.largest < 0.02 * work


@pytest.mark.parametrize("delay", [0.0, 0.56, 1.7])
def test_a_source_in_a_body_that_stiffens_is_seen(delay: float) -> None:
    """Of 20 mJ all but what the slopes are rounded up by, which the leak of the blow is granted."""
    bench = Bench(BODY, delay * PERIOD)
    leak, _ = blow(Bench(BODY, delay * PERIOD))
    blow(bench, source=0.02)
    assert 0.02 - 0.25 * leak < bench.tally.largest < 0.02 * 1.1


def test_a_body_that_stiffens_is_judged_by_its_slope_while_another_force_is_sent() -> None:
    bench = Bench(BODY)
    bench.loosen(fade=1.0)
    blow(bench)
    assert bench.tally.largest < 1e-4


def test_terms_of_two_sets_are_those_of_the_steeper_one_at_each_place() -> None:
    (axis,) = plan_of(scene_of(BODY)).axes
    body, wall = (axis_terms(axis, (each,), (), PERIOD) for each in (BODY, WALL))
    both = larger_of(body, wall)
    for place in (-0.01, 0.01, 0.15, 0.5):
        pairs = [each.damping_between(place, place + 1e-4) for each in (body, wall)]
        assert both.damping_between(place, place + 1e-4) == max(pairs)
    assert body.damping_between(-0.01, -0.01) == 0.0
    assert not larger_of(wall, wall).by_place
