"""An encoder whose counts stand still under force is asked by pulses: a count that moves is life, none is a trip."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import pytest

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.safety import Permission, TripKind
from haptic_fieldbus.cycle.standstill import Standstill
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.encoder_probe import EncoderProbe, encoder_probe
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import VELOCITY_ONLY, plan_of, rig_of, scene_of
from tests.cycle.test_cycle import ANY_MOTION, COUNT, UNIT, enabled_cycle, image, jumping, plan_with, sent

WALL = scene_of(Wall("handle", stiffness=600.0, position=0.0))
STILL, PAIRS, FELT_SHARE = 2.0, 5, 0.08
"""[s], pairs, and the share of a force that a hand notices, as docs/explanation/safety.md promises them."""
PULSE = 8
"""Steps of the drive in a pulse of the shipped bench."""


def counts_of(force: float) -> int:
    """Counts of the handle in the wall, at which it pushes with this force [N]."""
    return round(force / 600.0 / COUNT)


class Leaned:
    """A cycle whose handle rests in a wall of 600 N/m, or follows what a test says of each period."""

    def __init__(self, force: float = 8.0, plan: Plan | None = None) -> None:
        self.plan = plan or jumping(WALL)
        probe = encoder_probe(self.plan.axes[0], self.plan.period)
        assert probe is not None
        self.probe: EncoderProbe = probe
        self.cycle = enabled_cycle(self.plan)
        self.counts, self.t_ns = counts_of(force), 0
        self.periods(20)
        self.full = self.sizes[-1]
        """Steps of the force of the wall."""
        self.began_ns, self.sizes = self.t_ns, list[int]()

    sizes: list[int]

    def periods(self, number: int, flags: int = 0) -> list[int]:
        """Run on; return the sizes of the set-points, in steps."""
        found = []
        for _ in range(number):
            self.t_ns += 1_000_000
            found.append(abs(sent(self.cycle(image(self.counts, t_ns=self.t_ns, flags=flags)))[1]))
        self.sizes = [*getattr(self, "sizes", []), *found]
        return found

    def until(self, size: Callable[[int], bool], most: int = 20_000) -> int:
        """Run until a set-point is of such a size; return after how many periods."""
        for number in range(1, most):
            if size(self.periods(1)[0]):
                return number
        raise AssertionError(f"none in {most} periods")

    @property
    def seconds(self) -> float:
        return 1e-9 * (self.t_ns - self.began_ns)


def test_an_encoder_that_no_pulse_moves_is_a_trip_within_the_stated_time() -> None:
    leaned = Leaned()
    leaned.until(lambda size: size == 0)
    trip = leaned.cycle.trip
    assert trip is not None
    assert trip.kind is TripKind.ENCODER_STILL
    assert STILL + PAIRS * 0.5 < leaned.seconds <= leaned.probe.time
    given = [size - leaned.full for size in leaned.sizes[:-1]]
    assert set(given) == {0, -PULSE, PULSE}
    assert given.count(PULSE) == given.count(-PULSE) == PAIRS * leaned.probe.periods, "zero on average"
    assert next(filter(None, given)) == -PULSE, "against the force first"
    assert FELT_SHARE * leaned.full >= PULSE
    assert given[: round(1e3 * STILL)] == [0] * round(1e3 * STILL)
    said = str(trip_error(trip, leaned.plan, leaned.began_ns))
    assert "the encoder does not count: under 8 N, 5 pairs of test pulses of ±0.402 N moved no count" in said
    assert "a hand of 1000 N/m; torque is off. Check the encoder and its cable" in said


@pytest.mark.parametrize("after", [1, 15, 30, 34])
def test_a_count_that_moves_after_a_pulse_has_begun_is_life(after: int) -> None:
    """Also in the last pair, by a single count; the pair ends soon, and 2 s later the next one begins."""
    leaned = Leaned()
    for _ in range(4):
        leaned.until(lambda size: size > leaned.full)
        leaned.until(lambda size: size == leaned.full)
    for number in range(3):
        leaned.until(lambda size: size < leaned.full - 2)
        leaned.periods(after)
        leaned.counts += -1 if number % 2 else 1
        leaned.sizes = []
        leaned.periods(1500)
        assert {leaned.full, leaned.full + 1} >= set(leaned.sizes[-1400:])
    assert leaned.cycle.trip is None


def test_a_count_that_moves_ends_the_first_pulse_and_the_second_is_as_long() -> None:
    leaned = Leaned()
    leaned.until(lambda size: size < leaned.full)
    leaned.periods(5)
    leaned.counts += 1
    leaned.sizes = []
    leaned.periods(100)
    along = [size for size in leaned.sizes if size > leaned.full + 2]
    assert len(along) == 6, "six periods against the force before"
    assert leaned.sizes[0] > leaned.full, "at once"
    assert set(leaned.sizes[6:]) <= {leaned.full, leaned.full + 1}


def test_after_a_motion_five_pairs_are_needed_again() -> None:
    leaned = Leaned()
    for _ in range(4):
        leaned.until(lambda size: size > leaned.full)
        leaned.until(lambda size: size == leaned.full)
    leaned.periods(20)
    leaned.counts += 1
    leaned.began_ns = leaned.t_ns
    leaned.until(lambda size: size == 0)
    assert STILL + PAIRS * 0.5 < leaned.seconds <= leaned.probe.time


def test_a_hand_that_moves_by_itself_is_asked_nothing() -> None:
    leaned = Leaned()
    leaned.sizes = []
    for number in range(8):
        leaned.periods(1990 if number % 2 else 2200)  # in the second case the lead of a pair has begun
        leaned.counts += 1 if number % 3 else -1
    assert set(leaned.sizes) <= {leaned.full, leaned.full + 1, leaned.full - 1}
    assert leaned.cycle.trip is None


def test_at_the_limit_the_force_is_lowered_slowly_and_no_pulse_goes_beyond_it() -> None:
    leaned = Leaned(25.0, jumping(WALL, limits=replace(ANY_MOTION, effort=10.0)))
    assert leaned.full == math.floor(10.0 / UNIT), "whole steps of the drive, and none beyond the limit"
    leaned.sizes = []
    first = leaned.until(lambda size: size < leaned.full - PULSE - 2)
    assert all(abs(a - b) <= 1 for a, b in pairwise(leaned.sizes[: first - 2])), "lowered slowly"
    leaned.until(lambda size: size == 0)
    assert max(leaned.sizes) == leaned.full
    assert min(leaned.sizes[:-1]) == leaned.full - 2 * PULSE
    assert leaned.cycle.trip is not None
    assert leaned.cycle.trip.kind is TripKind.ENCODER_STILL
    assert leaned.seconds <= leaned.probe.time


def test_below_the_force_whose_pulses_are_not_felt_the_rule_of_long_standstill_stays() -> None:
    leaned = Leaned(4.9, jumping(WALL, limits=replace(ANY_MOTION, stall=6.0)))
    leaned.sizes = []
    assert leaned.periods(5900) == [leaned.full] * 5900
    leaned.periods(200)
    assert leaned.sizes[-1] == 50
    assert leaned.cycle.trip is None
    assert leaned.cycle.axes["handle"].stalls == 1


def test_a_gap_begins_the_pair_anew_and_takes_nothing_from_the_force() -> None:
    leaned = Leaned()
    leaned.until(lambda size: size < leaned.full)
    leaned.periods(3)
    leaned.periods(3, flags=int(LinkFlag.STALE))
    leaned.sizes = []
    assert leaned.until(lambda size: size == leaned.full) < 10
    assert leaned.until(lambda size: size < leaned.full) == pytest.approx(leaned.probe.lead, abs=10)
    assert leaned.cycle.axes["handle"].permission.gaps.farthest == 0.0
    leaned.began_ns = leaned.t_ns
    leaned.until(lambda size: size == 0)
    assert leaned.seconds > (PAIRS - 1) * 0.5, "the pair of the gap does not count"


def test_a_long_gap_in_a_pulse_leaves_the_cap_of_the_scene_and_not_that_of_the_pulse() -> None:
    leaned = Leaned()
    leaned.until(lambda size: size < leaned.full)
    leaned.periods(3)
    leaned.periods(20, flags=int(LinkFlag.STALE))
    leaned.sizes = []
    leaned.counts += 100
    leaned.periods(400)
    assert max(leaned.sizes) == leaned.full, "capped at the force before the gap"
    leaned.sizes = []
    leaned.until(lambda size: size < leaned.full - PULSE)
    leaned.until(lambda size: size == 0)
    assert max(leaned.sizes) == leaned.full
    assert min(leaned.sizes[:-1]) == leaned.full - 2 * PULSE


@dataclass(frozen=True)
class Stepped:
    """An element whose force falls after a time."""

    axis: str
    name: str = "stepped"
    needs: tuple[Signal, ...] = (Signal.POSITION, Signal.ELAPSED_NS)

    def force(self, position: float, elapsed_ns: float) -> float:
        return 8.0 if elapsed_ns < 2.51e9 else 0.3

    @property
    def strongest(self) -> float:
        return 8.0

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


def test_a_force_that_falls_in_a_pair_gives_the_pair_up() -> None:
    plan = plan_with(scene_of(Stepped("handle")))
    cycle, sizes = Cycle(plan), list[int]()
    for number in range(6000):
        sizes.append(sent(cycle(image(t_ns=number * 1_000_000)))[1])
    full = round(8.0 / UNIT)
    sizes = sizes[1000:]  # from the end of the fade-in on
    assert full - PULSE in sizes
    assert full + PULSE not in sizes
    assert set(sizes[-3000:]) == {round(0.3 / UNIT)}
    assert cycle.trip is None


def test_a_drive_with_velocity_only_is_asked_nothing() -> None:
    plan = plan_of(profile=VELOCITY_ONLY, scene=WALL)
    assert encoder_probe(plan.axes[0], plan.period) is None
    Cycle(plan)


class TestOneQuestion:
    """A question apart from its cycle."""

    def asked(self, permission: Permission, target: int = 200) -> bool:
        probe = EncoderProbe(effort=0.4, periods=15, least=5.0, lead=500, wait=2, period=1e-3)
        state = AxisState(feedback=(0,), target=target)
        question = Standstill(probe, 0.05, state, permission, lambda *trip: None)
        question.look(3_000_000_000)
        return permission.pulses == question.give

    def test_is_asked_under_enough_force(self) -> None:
        assert self.asked(Permission(unchanged=True))
        assert self.asked(Permission(unchanged=True), target=-100)
        assert not self.asked(Permission(unchanged=True), target=99)

    def test_is_not_asked_while_the_sign_is_looked_for(self) -> None:
        assert not self.asked(Permission(proof=lambda force: force))

    def test_is_not_asked_twice(self) -> None:
        permission = Permission(pulses=lambda force, bound: force)
        assert not self.asked(permission)


@pytest.mark.parametrize(
    ("permission", "lawful"),
    [
        (Permission(fade=1.0, unchanged=True), True),
        (Permission(fade=1.0), False),
        (Permission(fade=1.0, pulses=lambda force, bound: force), True),
        (Permission(fade=0.5, pulses=lambda force, bound: force), False),
        (Permission(fade=1.0, cap=3.0, pulses=lambda force, bound: force), False),
        (Permission(fade=1.0, blind=True, pulses=lambda force, bound: force), False),
    ],
)
def test_pulses_alone_do_not_excuse_a_force_from_its_law(permission: Permission, lawful: bool) -> None:
    assert permission.lawful is lawful


def test_what_pulses_may_give_is_told_to_the_energy_ledger() -> None:
    """At most size times way: one count there and back again."""
    leaned = Leaned()
    for _ in range(3):
        leaned.until(lambda size: size < leaned.full)
        leaned.counts += 1
        leaned.until(lambda size: size > leaned.full)
        leaned.counts -= 1
        leaned.periods(100)
    (ledger,) = leaned.cycle.ledgers
    told = {"pulses": pytest.approx(3 * 2 * leaned.probe.effort * COUNT, rel=1e-6)}
    assert ledger.booked == told, "also while the contact lasts"
    leaned.counts = -1
    leaned.periods(20)
    assert ledger.booked == told
    assert ledger.tally.largest < 1e-4
    assert math.isfinite(ledger.tally.limit)


def test_limits_of_the_rig_stay_in_force() -> None:
    """An axis that may give no more than 5 % of rated torque has no question."""
    plan = plan_of(WALL, rig=rig_of(WALL, limits=Limits(effort=2.5)))
    assert encoder_probe(plan.axes[0], plan.period) is None


@pytest.mark.parametrize(("share", "ends"), [(0.6, False), (0.3, True)])
def test_a_pair_is_given_up_when_the_force_falls_below_half_of_what_begins_one(share: float, ends: bool) -> None:
    leaned = Leaned()
    leaned.until(lambda size: size > leaned.full)
    leaned.counts = counts_of(share * leaned.probe.least)
    alone = round(600.0 * leaned.counts * COUNT / UNIT)
    assert (abs(leaned.periods(1)[0] - alone) <= 1) is ends
