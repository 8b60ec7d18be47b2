"""Where the law of a scene stands after gaps, and what energy that costs or gives; energies by hand, not by the ledger.

A potential is written out here for each law, and integrated from its force where it is drawn. `tests.cycle.gap_bench`
has the handle and the work of the torque.
"""

import math
from collections.abc import Sequence

import pytest

from haptic_fieldbus.cycle.energy import EnergyRecord
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.dahl import Dahl
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.gravity import Gravity
from haptic_fieldbus.scenes.kelvin_voigt import KelvinVoigt
from haptic_fieldbus.scenes.virtual_coupling import VirtualCoupling
from haptic_fieldbus.scenes.wall import Wall
from tests.cycle.gap_bench import AtPlaces, Handled, bench_plan, carry, every, never, run

AMPLITUDE, PITCH = 1.5, 0.01
DETENTS = Detents("handle", AMPLITUDE, PITCH)
WALL = Wall("handle", 600.0)
MILLI = 1e-3


@pytest.mark.parametrize("phase", [0.0, 0.9])
def test_detents_with_gaps_at_their_valleys_give_a_hand_no_energy(phase: float) -> None:
    """20 of them at 0.1 m/s; what is forgotten on a crest would be given back as a whole valley, 4.8 mJ."""
    bench = Handled(bench_plan(DETENTS))
    carry(bench, 20 * PITCH, 0.1, AtPlaces(14, PITCH, phase))
    assert bench.axis.permission.gaps.short >= 19
    assert bench.given < 0.1 * MILLI
    assert bench.tripped is None


def test_a_free_handle_that_gaps_meet_in_the_valleys_comes_to_rest() -> None:
    """Damped by 1.58 N·s/m without dry friction; its speed of 0.4 m/s is enough for many detents."""
    bench = Handled(bench_plan(DETENTS))
    bench.v = 0.4
    run(bench, 4.0, AtPlaces(14, PITCH, pause=70))
    assert bench.axis.permission.gaps.short >= 2
    assert abs(bench.v) < 0.01
    assert bench.given < 0.0


def trembling(time: float) -> float:
    """6 N within half a second, and 0.9 N at 8 Hz [N]."""
    return min(6.0, 12.0 * time) + 0.9 * math.sin(16.0 * math.pi * time)


def test_a_wall_stays_where_it_is_under_a_hand_that_leans_and_trembles() -> None:
    """2 ms are lost in each tenth of a second, for 20 s; 6 N press 10 mm into 600 N/m, and 0.9 N move by 1.5 mm."""
    bench = Handled(bench_plan(WALL))
    whole = Handled(bench_plan(WALL))
    run(bench, 20.0, every(100, 2), trembling)
    run(whole, 2.0, never, trembling)
    assert bench.axis.permission.gaps.short > 190
    assert bench.tripped is None
    assert bench.farthest < 1.0 * MILLI
    assert bench.x - whole.x == pytest.approx(0.0, abs=1.0 * MILLI)


@pytest.mark.thorough("half an hour of periods")
def test_a_wall_stays_where_it_is_for_half_an_hour() -> None:
    bench = Handled(bench_plan(WALL))
    run(bench, 1800.0, every(100, 2), trembling)
    assert bench.tripped is None
    assert bench.farthest < 1.0 * MILLI


def test_torque_held_across_a_valley_is_charged_and_ends_the_run() -> None:
    """The handle is carried at 1 m/s; each gap begins before a valley, and the torque held there goes on beyond it."""
    strong = Detents("handle", 30.0, 0.04)
    bench = Handled(bench_plan(strong))
    left, timing = 0, AtPlaces(8, 0.04, 0.88)
    for _ in range(400):
        left = left - 1 if left else timing(bench)
        bench.move(lost=left > 0, to=bench.x + 1.0 * MILLI)
        if bench.tripped:
            break
    assert bench.tripped == TripKind.HELD.value
    assert bench.held > 0.05


def test_a_way_back_out_of_a_wall_pays_with_what_gaps_took_on_the_way_in() -> None:
    """A hand goes in by 6 mm within gaps, and out within others: it gets back what it gave, and nothing trips."""
    bench = Handled(bench_plan(WALL))
    for _ in range(100):
        bench.move(to=bench.x + 0.1 * MILLI)
    for way in (0.2, -0.2):
        for number in range(15 * 40):
            lost = number % 40 in (37, 38)
            bench.move(lost=lost, to=bench.x + (way * MILLI if number % 40 in (37, 38, 39) else 0.0))
        if way > 0.0:
            assert bench.axis.permission.shift == pytest.approx(6.0 * MILLI, abs=0.1 * MILLI)
    assert bench.tripped is None
    assert abs(bench.axis.permission.shift) < 0.3 * MILLI


def going(bench: Handled, ways: Sequence[float], *, lost: bool = False) -> None:
    """Move the handle by these ways, one a period [m]."""
    for way in ways:
        bench.move(lost=lost, to=bench.x + way)


def shift(bench: Handled) -> float:
    return bench.axis.permission.shift


def test_a_law_at_rest_is_drawn_back_up_to_where_it_resists() -> None:
    """A gap leads from 3 mm before a wall to 3 mm behind its surface: nothing resists on the way to the surface."""
    bench = Handled(bench_plan(WALL), x=-3.0 * MILLI)
    going(bench, [0.0, 1.0 * MILLI])
    going(bench, [1.0 * MILLI] * 4, lost=True)
    going(bench, [1.0 * MILLI, 0.0])
    assert shift(bench) == pytest.approx(2.0 * MILLI, abs=0.02 * MILLI), "a count at most"
    assert bench.force == pytest.approx(-0.6, abs=0.05), "of the millimetre since"
    going(bench, [-1.0 * MILLI] * 5)
    assert shift(bench) == 0.0


@pytest.mark.parametrize("others", [(), (Constant("handle", 2.0),), (Damper("handle", 3.0),)])
def test_a_law_with_a_memory_is_drawn_back_by_the_motion_of_a_period_where_it_pushes_that_way(
    others: tuple[Element, ...],
) -> None:
    """A coupling that is pulled along, by 2.5 mm within a gap: it pushes back and resists. Pulled the other way it
    does not, whatever a constant force or a damper does."""
    bench = Handled(bench_plan(VirtualCoupling("handle", 300.0, 2.0), *others))
    going(bench, [0.5 * MILLI] * 4)
    going(bench, [0.5 * MILLI] * 4, lost=True)
    going(bench, [0.5 * MILLI] * 4)
    hidden = shift(bench)
    assert hidden == pytest.approx(2.5 * MILLI, abs=0.02 * MILLI)
    for _ in range(200):  # the coupled mass catches up and overtakes
        before, way = shift(bench), 0.01 * MILLI
        going(bench, [way])
        assert abs(shift(bench) - before) <= way + 0.02 * MILLI
    going(bench, [-0.5 * MILLI] * 12)
    assert shift(bench) == 0.0


def test_friction_has_no_say_where_detents_go() -> None:
    """Friction of 1 N opposes the way on, the detents push it along: they alone decide."""
    bench = Handled(bench_plan(DETENTS, Dahl("handle", 1.0, 2000.0)), x=0.005)
    going(bench, [0.2 * MILLI] * 5)
    going(bench, [0.2 * MILLI] * 4, lost=True)
    at = shift(bench)
    going(bench, [0.2 * MILLI] * 2)
    assert shift(bench) > 0.5 * MILLI > at
    going(bench, [0.2 * MILLI] * 6)
    assert shift(bench) == 0.0


def test_a_weight_has_no_place() -> None:
    bench = Handled(bench_plan(Gravity("handle", 0.3)))
    going(bench, [0.5 * MILLI] * 3)
    going(bench, [0.5 * MILLI] * 5, lost=True)
    going(bench, [0.5 * MILLI] * 2)
    assert bench.axis.permission.gaps.short == 1
    assert bench.farthest == 0.0


@pytest.mark.parametrize(("way", "pauses"), [(0.2 * MILLI, True), (-0.2 * MILLI, False)])
def test_while_the_force_comes_back_the_law_pauses_on_the_way_against_it(way: float, pauses: bool) -> None:
    """30 N that faded to nothing come back by 10 N a period."""
    bench = Handled(bench_plan(Wall("handle", 2000.0)))
    going(bench, [0.25 * MILLI] * 60)
    going(bench, [0.0] * 5)
    going(bench, [0.1 * MILLI] * 12, lost=True)
    going(bench, [way])
    before = shift(bench)
    assert bench.force == pytest.approx(-10.0, abs=0.1)
    going(bench, [way])
    assert bench.force == pytest.approx(-20.0, abs=0.2)
    assert shift(bench) - before == pytest.approx(way if pauses else 0.0, abs=0.02 * MILLI)


@pytest.mark.parametrize("law", [WALL, KelvinVoigt("handle", 600.0, 1.0)])
def test_a_scene_too_far_beside_its_place_is_capped_and_goes_back(law: Element) -> None:
    """Gaps lead in by 2 mm each, and what is seen by 1 mm more; the bound is 20 mm."""
    bench = Handled(bench_plan(law))
    going(bench, [0.2 * MILLI] * 25)
    assert bench.plan.axes[0].limits.shift == 0.02
    for _ in range(8):
        going(bench, [1.0 * MILLI] * 2, lost=True)
        going(bench, [1.0 * MILLI] * 1)
        going(bench, [0.0] * 30)
    assert shift(bench) == pytest.approx(16.0 * MILLI, abs=0.2 * MILLI)
    assert abs(bench.force) == pytest.approx(600.0 * 13.0 * MILLI, abs=0.2), "of 25 times 0.2 mm and 8 mm"
    before = bench.axis.permission.gaps.long
    for _ in range(6):
        going(bench, [0.5 * MILLI] * 14, lost=True)
        going(bench, [0.5 * MILLI] * 1)
        if bench.axis.permission.capped:
            break
        going(bench, [0.0] * 80)
    assert bench.axis.permission.gaps.long == before + 1
    most = bench.axis.permission.cap
    for way in (*[0.1 * MILLI] * 200, *[-0.5 * MILLI] * 140):
        last = shift(bench)
        going(bench, [way])
        assert abs(bench.force) <= most + 0.05
        assert last - shift(bench) <= 1.01 * abs(way) + 0.02 * MILLI or law is WALL
    assert bench.x < 0.0
    assert shift(bench) == 0.0
    assert bench.axis.permission.cap == math.inf
    assert bench.axis.permission.gaps.long == before + 1


def test_under_the_cap_of_a_gap_the_law_takes_up_no_more_than_the_hand_pays() -> None:
    """A long gap at the bottom of a detent leaves a cap of nothing; a hand that goes on over crests gets nothing."""
    bench = Handled(bench_plan(DETENTS))
    carry(bench, 40 * PITCH, 0.2, AtPlaces(25, PITCH, pause=130))
    assert bench.axis.permission.gaps.long >= 10
    assert bench.tripped is None
    assert bench.given < 0.1 * MILLI


def test_during_a_change_the_law_is_drawn_back_where_neither_of_both_resists() -> None:
    """From a wall to one that stands 5 mm nearer; after the change the old one has no say any more."""
    near = Wall("handle", 600.0, position=-5.0 * MILLI)
    for ramp, found in ((100, -5.0), (1, -5.0)):
        bench = Handled(bench_plan(WALL), x=-8.0 * MILLI)
        change = bench.cycle.prepare(bench.plan, bench_plan(near), ramp)
        change()
        going(bench, [0.0, 0.5 * MILLI, 0.5 * MILLI])
        going(bench, [1.0 * MILLI] * 8, lost=True)
        going(bench, [1.0 * MILLI, 0.0])
        place = bench.axis.state.position - shift(bench)
        assert place == pytest.approx((found + 1.0) * MILLI, abs=0.05 * MILLI)


def test_after_a_change_the_law_of_before_has_no_say() -> None:
    """A wall goes away: what it would resist no longer counts."""
    far = Wall("handle", 600.0, position=0.1)
    bench = Handled(bench_plan(WALL))
    bench.cycle.prepare(bench.plan, bench_plan(far), 20)()
    going(bench, [0.2 * MILLI] * 8)
    going(bench, [0.2 * MILLI] * 3, lost=True)
    going(bench, [0.2 * MILLI] * 2)
    assert shift(bench) > 0.4 * MILLI
    going(bench, [0.2 * MILLI] * 20)
    assert shift(bench) == 0.0


def test_a_gap_on_the_way_into_a_wide_valley_is_no_energy_of_the_law() -> None:
    """2 samples are lost at 1.4 m/s where a detent pushes on with 12 N: the valley had as much as the torque gave."""
    bench = Handled(bench_plan(Detents("handle", 12.0, 0.1)), x=0.05)
    going(bench, [1.4 * MILLI] * 18)
    going(bench, [1.4 * MILLI] * 2, lost=True)
    assert bench.force > 10.0
    going(bench, [1.4 * MILLI] * 4)
    assert bench.held > 0.03
    assert bench.tripped is None
    (ledger,) = bench.cycle.ledgers
    assert ledger.tally.largest < 1.0 * MILLI
    assert ledger.tally.held_most < 1.0 * MILLI


def test_torque_held_on_the_way_out_of_a_body_with_a_memory_is_paid_by_what_the_body_gives_up() -> None:
    """15 N that fade push a handle out by 4 mm in a gap, and the body falls by more as it is drawn back to it."""
    bench = Handled(bench_plan(KelvinVoigt("handle", 600.0, 1.0)))
    going(bench, [0.25 * MILLI] * 100)
    going(bench, [0.0] * 20)
    going(bench, [-0.5 * MILLI] * 8, lost=True)
    going(bench, [-0.5 * MILLI] * 25)
    assert bench.held > 0.03
    assert bench.tripped is None
    assert shift(bench) == 0.0
    (ledger,) = bench.cycle.ledgers
    assert 0.02 < ledger.tally.held_most < bench.held
    assert ledger.tally.held == 0.0, "of the body that is drawn back"


def test_a_change_waits_while_it_would_throw_the_handle() -> None:
    """A wall of 600 N/m that comes 50 mm nearer would push with 30 N; a quarter of the limit is 12.6 N."""
    bench = Handled(bench_plan(Wall("handle", 600.0, position=0.01)))
    begin = bench.cycle.prepare(bench.plan, bench_plan(Wall("handle", 600.0, position=-0.05)), 10)
    assert not begin()
    going(bench, [-0.5 * MILLI] * 50)
    assert not begin(), "15 N at -25 mm"
    going(bench, [-0.5 * MILLI] * 10)
    assert begin(), "12 N at -30 mm"


def test_what_held_torque_gives_is_forgotten_at_the_power_that_is_not_felt() -> None:
    tally = EnergyRecord(1.0)
    assert tally.charge(0.003, 0.0, 0) == 0.003
    assert tally.charge(0.0, 0.0, 1_000_000_000) == pytest.approx(0.001)
    assert tally.charge(0.0, 0.0, 2_000_000_000) == 0.0
    assert tally.charge(-0.004, -0.001, 2_000_000_000) == -0.001, "of what was paid the shift tells how much is left"
    assert tally.charge(0.0, -0.001, 3_000_000_000) == -0.001
    assert tally.charge(0.0, 0.0, 3_000_000_000) == 0.0
    assert tally.held_most == 0.003
