"""The cycle from bytes to bytes: every fault of the link, every trip, every power state, without a bus or a clock."""

import math
import struct
from dataclasses import dataclass, replace
from typing import Any

import pytest

from haptic_fieldbus.cycle.axis import COMPUTED
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.drive.rig import Limits, LinearMechanism
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import WALL, plan_of, rig_of, scene_of

ENABLED, SWITCHED_ON, READY, DISABLED, FAULT, QUICK_STOP = 0x0637, 0x0633, 0x0631, 0x0650, 0x0618, 0x0617
COUNT = 0.05 / 4096
UNIT = 0.4 / 1000 / (0.05 / (2 * math.pi))
FADED_IN = 501
ANY_MOTION = Limits(speed=1e9, acceleration=1e12)
"""For tests whose handle jumps from place to place."""


@dataclass(frozen=True)
class Constant:
    """An element that always asks for the same force."""

    axis: str
    value: float
    name: str = "constant"
    needs: tuple[Signal, ...] = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return self.value

    @property
    def strongest(self) -> float:
        return abs(self.value)

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


def image(counts: int = 0, status: int = ENABLED, flags: int = 0, t_ns: int = 0, age: int = 0, code: int = 0) -> bytes:
    return struct.pack("<qIHHHih", t_ns, age, flags, code, status, counts, 0)


def sent(output: bytearray) -> tuple[int, int]:
    control, target = struct.unpack("<Hh", output)
    return control, target


def enabled_cycle(plan: Plan | None = None, counts: int = 0) -> Cycle:
    """A cycle that has been in operation enabled until force has faded in."""
    cycle = Cycle(plan or plan_of())
    for _ in range(FADED_IN):
        cycle(image(counts))
    return cycle


def plan_with(scene: Scene, **changes: Any) -> Plan:
    return plan_of(scene, rig=rig_of(scene, **changes))


def jumping(scene: Scene, **changes: Any) -> Plan:
    """A plan on whose axes the handle may jump from place to place."""
    return plan_with(scene, **{"limits": ANY_MOTION, **changes})


class Ticks:
    """The time [ns] of one sample after the other."""

    def __init__(self) -> None:
        self._t_ns = 0

    def next(self, periods: int = 1) -> int:
        self._t_ns += periods * 1_000_000
        return self._t_ns


@pytest.mark.parametrize(
    ("status", "controlword"),
    [(0x0600, 0x00), (DISABLED, 0x06), (READY, 0x07), (SWITCHED_ON, 0x0F), (QUICK_STOP, 0x00)],
)
def test_below_operation_enabled_torque_is_zero_and_the_next_transition_is_asked(status: int, controlword: int) -> None:
    cycle = Cycle(plan_of(scene_of(Constant("handle", 3.0))))
    assert sent(cycle(image(status=status))) == (controlword, 0)
    assert not cycle.enabled
    assert cycle.trip is None


def test_below_operation_enabled_nothing_is_computed_yet() -> None:
    cycle = Cycle(plan_of())
    cycle(image(1000, status=SWITCHED_ON))
    computed = dict(zip(cycle.columns, cycle.row, strict=True))
    assert [computed[f"handle.{name}"] for name in COMPUTED] == [0.0, 0.0, 0.0, 1.0, 0.0]


def test_a_wall_pushes_out_by_stiffness_times_penetration_in_the_drives_unit() -> None:
    """600 N/m, 1000 counts beyond the wall at 20 mm; one step of target torque is UNIT newtons."""
    cycle = enabled_cycle(jumping(WALL))
    for counts in range(100, round(0.02 / COUNT) + 1100, 100):
        control, target = sent(cycle(image(counts)))
    penetration = counts * COUNT - 0.02
    assert control == 0x0F
    assert target == round(-600.0 * penetration / UNIT)
    assert cycle.row[cycle.columns.index("handle.command")] == pytest.approx(target * UNIT)


def test_free_space_writes_zero_after_contact() -> None:
    scene = scene_of(Wall("handle", stiffness=600.0, position=0.0))
    cycle = enabled_cycle(jumping(scene))
    assert sent(cycle(image(100)))[1] < 0
    outputs = [sent(cycle(image(-1))) for _ in range(5)]
    assert outputs[-1] == (0x0F, 0)


def test_zero_is_where_the_handle_was_enabled() -> None:
    cycle = enabled_cycle(counts=123_456)
    assert cycle.row[cycle.columns.index("handle.position")] == 0.0


def test_zero_can_be_an_encoder_count() -> None:
    mechanism = LinearMechanism("linear", 0.05, zero=1000)
    cycle = enabled_cycle(plan_with(scene_of(Constant("handle", 0.0)), mechanism=mechanism), counts=1500)
    assert cycle.row[cycle.columns.index("handle.position")] == pytest.approx(500 * COUNT)


def test_the_encoder_may_wrap() -> None:
    cycle = Cycle(plan_of(scene_of(Constant("handle", 0.0))))
    for counts in (0x7FFF_FFFE, 0x7FFF_FFFF, -0x8000_0000, -0x7FFF_FFFF):
        cycle(image(counts))
    assert cycle.trip is None
    assert cycle.row[cycle.columns.index("handle.position")] == pytest.approx(3 * COUNT)


@pytest.mark.parametrize("counts", [0x7FFF_FFFE, 0x7FFF_FFFF])
def test_a_count_beyond_half_the_range_of_the_encoder_is_on_the_other_side(counts: int) -> None:
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 0.0))), counts=-2)
    cycle(image(counts))
    assert cycle.row[cycle.columns.index("handle.position")] == pytest.approx((counts + 2 - 2**32) * COUNT)


def test_a_mirrored_mechanism_turns_both_position_and_torque() -> None:
    mechanism = LinearMechanism("linear", 0.05, sign=-1)
    scene = scene_of(Wall("handle", stiffness=600.0, position=0.0))
    mirrored, plain = enabled_cycle(jumping(scene, mechanism=mechanism)), enabled_cycle(jumping(scene))
    assert sent(mirrored(image(-100)))[1] == -sent(plain(image(100)))[1] > 0


def test_the_limit_fades_in_when_the_run_starts_inside_the_wall() -> None:
    """6 N are asked for; the limit reaches rated torque on a straight line over 0.5 s, and meets them on its way."""
    scene = scene_of(Wall("handle", stiffness=600.0, position=-0.01))
    cycle = Cycle(plan_of(scene))
    targets = [sent(cycle(image()))[1] for _ in range(FADED_IN)]
    line = [-min(2.0 * (number + 1), 6.0 / UNIT) for number in range(FADED_IN)]
    assert targets == pytest.approx(line, abs=0.51)


@pytest.mark.parametrize("inside", [-0.1, -0.03])
def test_a_start_with_a_large_force_is_refused_with_the_place_that_would_do(inside: float) -> None:
    """A quarter of rated torque is 12.57 N, 20.9 mm deep in this wall."""
    plan = plan_of(scene_of(Wall("handle", stiffness=600.0, position=inside)))
    cycle = Cycle(plan)
    assert sent(cycle(image())) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.START_FORCE
    words = str(trip_error(cycle.trip, plan, 0))
    place = float(words.split("Start with the handle ")[1].split()[0])
    assert place == pytest.approx(inside + 250 * UNIT / 600.0, abs=0.5 / 2000)
    assert abs(600.0 * (place - inside)) <= 250 * UNIT


def test_a_start_that_is_too_strong_everywhere_says_so() -> None:
    plan = plan_of(scene_of(Constant("handle", 20.0)))
    cycle = Cycle(plan)
    cycle(image())
    assert cycle.trip is not None
    assert "No position nearby has a smaller force" in str(trip_error(cycle.trip, plan, 0))


def test_effort_is_limited_to_the_rigs_limit() -> None:
    scene = scene_of(Wall("handle", stiffness=600.0, position=0.0))
    cycle = enabled_cycle(plan_with(scene, limits=replace(ANY_MOTION, effort=8.0)))
    for _ in range(10):
        target = sent(cycle(image(-5000)))[1]
    assert target == 0
    for _ in range(10):
        target = sent(cycle(image(5000)))[1]
    assert target == -round(8.0 / UNIT)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_force_that_is_not_finite_trips_and_writes_zero(value: float) -> None:
    cycle = Cycle(plan_of(scene_of(Constant("handle", value))))
    assert sent(cycle(image(t_ns=77))) == (0x00, 0)
    assert cycle.trip is not None
    assert (cycle.trip.kind, cycle.trip.axis, cycle.trip.t_ns) == (TripKind.NOT_FINITE, "handle", 77)


def test_a_trip_is_final() -> None:
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 3.0))))
    cycle(image(flags=LinkFlag.EMERGENCY, code=0x8130))
    first = cycle.trip
    for _ in range(5):
        assert sent(cycle(image(flags=LinkFlag.BUS_OFF))) == (0x00, 0)
    assert cycle.trip is first
    assert not cycle.enabled


@pytest.mark.parametrize(
    ("flag", "kind"),
    [
        (LinkFlag.EMERGENCY, TripKind.EMERGENCY),
        (LinkFlag.BOOT_UP, TripKind.NODE_RESET),
        (LinkFlag.NO_SIGN_OF_LIFE, TripKind.NO_SIGN_OF_LIFE),
        (LinkFlag.NOT_OPERATIONAL, TripKind.NODE_NOT_OPERATIONAL),
        (LinkFlag.BUS_OFF, TripKind.BUS_OFF),
        (LinkFlag.EXCEPTION, TripKind.BUS_EXCEPTION),
        (LinkFlag.FOREIGN, TripKind.FOREIGN_MASTER),
        (LinkFlag.DUPLICATE, TripKind.DUPLICATE_NODE),
    ],
)
def test_each_fault_of_the_link_trips_at_once(flag: LinkFlag, kind: TripKind) -> None:
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 3.0))))
    assert sent(cycle(image()))[1] > 0
    assert sent(cycle(image(flags=flag, code=0x2310))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is kind
    assert cycle.trip.value == 0x2310


def test_stale_feedback_is_held_then_fades_to_zero_and_trips_at_its_age() -> None:
    """0.6 of the guard of 50 ms are 30 ms; the torque is gone 10 ms after the second missing sample."""
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 10.0))))
    full = sent(cycle(image()))[1]
    targets = [sent(cycle(image(flags=LinkFlag.STALE, age=number * 1_000_000)))[1] for number in range(1, 31)]
    assert targets == pytest.approx([full * max(0.0, 1.0 - number / 10) for number in range(30)], abs=0.51)
    assert cycle.enabled
    assert sent(cycle(image(flags=LinkFlag.STALE, age=31_000_000))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.FEEDBACK_LOST
    assert cycle.trip.value == pytest.approx(0.031)
    assert cycle.trip.limit == pytest.approx(0.03)


@pytest.mark.parametrize("force", [10.0, 0.0])
def test_a_row_shows_the_share_of_the_held_force_that_is_left(force: float) -> None:
    """From the second missing sample on a tenth less each; where no force is held, nothing of it is lost."""
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", force))))
    place, shown = cycle.columns.index("handle.gain"), []
    for number in range(1, 5):
        cycle(image(flags=LinkFlag.STALE, age=number * 1_000_000))
        shown.append(cycle.row[place])
    cycle(image())
    assert shown == pytest.approx([1.0, 0.9, 0.8, 0.7] if force else [1.0] * 4)
    assert cycle.row[place] == 1.0


def test_one_missing_sample_changes_nothing() -> None:
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 10.0))))
    full = sent(cycle(image()))[1]
    for _ in range(4):
        assert sent(cycle(image(flags=LinkFlag.STALE)))[1] == full
        assert sent(cycle(image()))[1] == full
    assert cycle.trip is None


def test_after_a_gap_a_wall_pushes_no_harder_than_before_it_until_it_is_left() -> None:
    clock = Ticks()
    cycle = enabled_cycle(jumping(scene_of(Wall("handle", stiffness=600.0, position=0.0))))
    before = sent(cycle(image(400, t_ns=clock.next())))[1]
    for _ in range(20):
        cycle(image(400, t_ns=clock.next(), flags=LinkFlag.STALE, age=1_000_000))
    inside = [sent(cycle(image(800, t_ns=clock.next())))[1] for _ in range(50)]
    assert min(inside) == before == inside[-1] < 0
    assert sent(cycle(image(-1, t_ns=clock.next())))[1] > before
    assert [sent(cycle(image(800, t_ns=clock.next())))[1] for _ in range(50)][-1] == pytest.approx(2 * before, abs=1)
    assert cycle.trip is None


def test_a_late_loop_renders_what_it_reads_and_nothing_fades() -> None:
    """The loop slept for 4 periods; what it then reads is fresh, 100 counts deeper in the wall."""
    clock = Ticks()
    cycle = enabled_cycle(jumping(scene_of(Wall("handle", stiffness=600.0, position=0.0))))
    cycle(image(100, t_ns=clock.next()))
    assert sent(cycle(image(200, t_ns=clock.next(5))))[1] == round(-600.0 * 200 * COUNT / UNIT)
    assert cycle.trip is None


def test_a_velocity_is_the_way_over_the_time_that_really_passed() -> None:
    """A damper of 1 N·s/m, 50 counts in 5 periods: 0.122 m/s, where one period would make 0.61 m/s of it."""
    clock = Ticks()
    cycle = enabled_cycle(jumping(scene_of(Damper("handle", damping=1.0))))
    cycle(image(0, t_ns=clock.next()))
    cycle(image(50, t_ns=clock.next(5)))
    force = cycle.row[cycle.columns.index("handle.force")]
    assert force == pytest.approx(-50 * COUNT / 0.005)


def test_virtual_states_go_through_the_periods_of_a_gap() -> None:
    """A sprung mass, moved on a straight line: with three of four samples gone it does what it does with all."""
    scene = scene_of(SprungMass("handle", stiffness=100.0, mass=0.5))
    whole, sparse = enabled_cycle(jumping(scene)), enabled_cycle(jumping(scene))
    clock = Ticks()
    for number in range(1, 201):
        t_ns = clock.next()
        whole(image(10 * number, t_ns=t_ns))
        if number % 4 == 0:
            sparse(image(10 * number, t_ns=t_ns))
    for cycle in (whole, sparse):
        assert cycle.row[cycle.columns.index("handle.force")] != 0.0
    assert sparse.row[sparse.columns.index("handle.force")] == pytest.approx(
        whole.row[whole.columns.index("handle.force")], rel=1e-9
    )


def test_a_loop_that_misses_a_fifth_of_its_periods_is_given_up() -> None:
    clock = Ticks()
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 1.0))))
    for _ in range(300):
        cycle(image(t_ns=clock.next(2)))
        if cycle.trip is not None:
            break
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.PERIODS_MISSED
    assert cycle.trip.t_ns < 1_000_000_000


def test_a_loop_that_slept_for_longer_than_feedback_may_be_old_is_given_up() -> None:
    clock = Ticks()
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 1.0))))
    cycle(image(t_ns=clock.next()))
    assert sent(cycle(image(t_ns=clock.next(40)))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.PERIODS_MISSED
    assert cycle.trip.value == pytest.approx(0.04)


def test_feedback_of_which_two_thirds_are_lost_is_given_up() -> None:
    clock = Ticks()
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 1.0))))
    for _ in range(400):
        for flags in (LinkFlag.STALE, LinkFlag.STALE, 0):
            cycle(image(t_ns=clock.next(), flags=flags))
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.FEEDBACK_SPARSE


def test_gaps_behind_answers_that_came_a_period_late_are_gaps_of_the_feedback() -> None:
    """As on Modbus TCP: nothing comes, then the sample of that period, then that of the period after next."""
    clock = Ticks()
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 1.0))))
    for _ in range(300):
        latched_ns = clock.next()
        cycle(image(t_ns=latched_ns, flags=LinkFlag.STALE))
        clock.next()
        cycle(image(t_ns=latched_ns, age=1_200_000))
        cycle(image(t_ns=clock.next(), age=100_000))
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.FEEDBACK_SPARSE


def test_samples_whose_time_goes_back_are_given_up() -> None:
    clock = Ticks()
    cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 1.0))))
    t_ns = clock.next(5)
    cycle(image(t_ns=t_ns))
    assert sent(cycle(image(t_ns=t_ns - 1_000_000))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.CLOCK
    assert cycle.trip.value == pytest.approx(-1e-3)


def test_an_element_that_raises_takes_the_torque_away_and_is_named() -> None:
    @dataclass(frozen=True)
    class Raising(Constant):
        def force(self, position: float) -> float:
            return 1.0 / (100 - round(position / COUNT))

    plan = jumping(scene_of(Raising("handle", 0.0)))
    cycle = enabled_cycle(plan)
    assert sent(cycle(image(100))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.ELEMENT_FAILED
    assert isinstance(cycle.failure, ZeroDivisionError)
    assert "ZeroDivisionError" in str(trip_error(cycle.trip, plan, 0))
    assert sent(cycle(image(0))) == (0x00, 0)


def test_counts_that_stand_still_under_torque_lower_the_limit_and_no_more() -> None:
    """After 2 s, here; 5 % of rated torque are left, until contact is left."""
    plan = plan_with(scene_of(Wall("handle", stiffness=600.0, position=0.0)), limits=replace(ANY_MOTION, stall=2.0))
    cycle, clock = enabled_cycle(plan), Ticks()
    full = [sent(cycle(image(500, t_ns=clock.next())))[1] for _ in range(1900)][-1]
    assert full == pytest.approx(-600.0 * 500 * COUNT / UNIT, abs=1)
    assert [sent(cycle(image(500, t_ns=clock.next())))[1] for _ in range(300)][-1] == -50
    assert cycle.trip is None
    for counts, force in ((-1, 0), (500, full)):
        assert [sent(cycle(image(counts, t_ns=clock.next())))[1] for _ in range(20)][-1] == force


def test_power_beyond_the_limit_trips() -> None:
    """10 N over 0.12 m/s are 1.2 W."""
    plan = plan_with(scene_of(Constant("handle", 10.0)), limits=Limits(power=1.0))
    cycle, clock = enabled_cycle(plan), Ticks()
    for number in range(20):
        cycle(image(number * (number + 1) // 2, t_ns=clock.next()))
        if cycle.trip is not None:
            break
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.POWER
    assert 1.0 < cycle.trip.value < 1.3
    assert number == math.ceil(0.1 / (COUNT / 0.001))


def test_before_enabling_stale_feedback_only_waits() -> None:
    cycle = Cycle(plan_of())
    for _ in range(10):
        assert sent(cycle(image(status=0, flags=LinkFlag.STALE)))[1] == 0
    assert cycle.trip is None


@pytest.mark.parametrize(("status", "kind"), [(FAULT, TripKind.DRIVE_FAULT), (0x061F, TripKind.DRIVE_FAULT)])
def test_a_fault_state_trips_whether_enabled_or_not(status: int, kind: TripKind) -> None:
    for cycle in (Cycle(plan_of()), enabled_cycle()):
        assert sent(cycle(image(status=status))) == (0x00, 0)
        assert cycle.trip is not None
        assert cycle.trip.kind is kind
        assert "fault" in cycle.trip.detail


@pytest.mark.parametrize("back", [READY, DISABLED, 0x0600])
def test_a_drive_that_falls_back_on_its_way_is_not_led_on(back: int) -> None:
    """Between two looks it may have been in operation enabled."""
    cycle = Cycle(plan_of())
    for status in (READY, SWITCHED_ON, back, READY, SWITCHED_ON, ENABLED):
        controlword = sent(cycle(image(status=status)))[0]
    assert cycle.trip is not None
    assert (cycle.trip.kind, controlword) == (TripKind.DRIVE_DISABLED, 0)


@pytest.mark.parametrize("status", [DISABLED, SWITCHED_ON, QUICK_STOP])
def test_a_drive_that_leaves_operation_enabled_is_not_enabled_again(status: int) -> None:
    cycle = enabled_cycle()
    assert sent(cycle(image(status=status))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.DRIVE_DISABLED
    assert sent(cycle(image())) == (0x00, 0)


def test_a_position_jump_beyond_the_speed_limit_trips() -> None:
    cycle = enabled_cycle(jumping(scene_of(Constant("handle", 3.0)), limits=replace(ANY_MOTION, speed=1.0)))
    allowed = int(0.001 / COUNT)
    assert sent(cycle(image(allowed)))[0] == 0x0F
    assert sent(cycle(image(2 * allowed + 3))) == (0x00, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.SPEED
    assert cycle.trip.limit == 1.0
    assert cycle.trip.value > 1.0


@pytest.mark.parametrize("flags", [0, LinkFlag.STALE])
def test_after_a_gap_the_speed_is_that_over_the_whole_time(flags: int) -> None:
    """Two periods' way in two periods, whether a sample was lost or the loop was late; in one it is too much."""
    plan = jumping(scene_of(Constant("handle", 3.0)), limits=replace(ANY_MOTION, speed=1.0))
    cycle, clock = enabled_cycle(plan), Ticks()
    cycle(image(0, t_ns=clock.next()))
    if flags:
        cycle(image(0, flags=flags, t_ns=clock.next()))
    cycle(image(int(0.0019 / COUNT), t_ns=clock.next(1 if flags else 2)))
    assert cycle.enabled
    cycle(image(2 * int(0.0019 / COUNT), t_ns=clock.next()))
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.SPEED


@pytest.mark.parametrize(("way", "trips"), [(0.0029, False), (0.0031, True)])
def test_a_sample_of_unknown_instant_has_moved_for_its_age_too(way: float, trips: bool) -> None:
    """1 ms since the last one, and 2 ms by which the answer came later than a period after its SYNC, at 1 m/s."""
    plan = jumping(scene_of(Constant("handle", 3.0)), limits=replace(ANY_MOTION, speed=1.0))
    cycle, clock = enabled_cycle(plan), Ticks()
    cycle(image(0, t_ns=clock.next()))
    cycle(image(int(way / COUNT), t_ns=clock.next(), age=3_000_000))
    assert (cycle.trip is not None) is trips


def test_a_jump_that_no_motion_can_make_trips() -> None:
    """9 mm; (50.3 N of the motor + 500 N of a hand) over 0.632 kg make 0.87 mm in a period."""
    plan = plan_with(scene_of(Constant("handle", 3.0)), limits=Limits(speed=10.0))
    mass, effort = 4.0e-5 / (0.05 / (2 * math.pi)) ** 2, 1000 * UNIT
    largest = (effort + 500.0) / mass * 1e-6 + 2 * COUNT
    for jump, trips in ((0.009, True), (largest + COUNT, True), (largest - COUNT, False)):
        cycle, clock = enabled_cycle(plan), Ticks()
        cycle(image(0, t_ns=clock.next()))
        cycle(image(round(jump / COUNT), t_ns=clock.next()))
        assert (cycle.trip is not None and cycle.trip.kind is TripKind.ACCELERATION) is trips


@pytest.mark.parametrize(("counts", "limit"), [(20, 0.0001), (-20, -0.0001)])
def test_leaving_the_position_limits_trips(counts: int, limit: float) -> None:
    cycle = enabled_cycle(plan_with(scene_of(Constant("handle", 3.0)), limits=Limits(position=(-0.0001, 0.0001))))
    assert sent(cycle(image(counts))) == (0x00, 0)
    assert cycle.trip is not None
    assert (cycle.trip.kind, cycle.trip.limit) == (TripKind.POSITION, limit)


@pytest.mark.parametrize("counts", [150, -150])
def test_the_limit_itself_is_inside_also_after_a_held_period(counts: int) -> None:
    limit = 150 * plan_of().axes[0].position_unit
    limits = replace(ANY_MOTION, speed=1.0, position=(-limit, limit))
    cycle, clock = enabled_cycle(plan_with(scene_of(Constant("handle", 3.0)), limits=limits)), Ticks()
    cycle(image(0, t_ns=clock.next()))
    cycle(image(0, flags=LinkFlag.STALE, t_ns=clock.next()))
    cycle(image(counts, t_ns=clock.next()))
    assert cycle.trip is None


def test_a_damped_wall_takes_the_backward_difference_of_position() -> None:
    scene = scene_of(Wall("handle", stiffness=1.0, position=0.0, damping=2.0))
    cycle = enabled_cycle(plan_of(scene), counts=0)
    cycle(image(10))
    cycle(image(30))
    force = cycle.row[cycle.columns.index("handle.force")]
    assert force == pytest.approx(-1.0 * 30 * COUNT - 2.0 * 20 * COUNT / 0.001)


def test_an_element_gets_every_signal_that_it_asks_for_and_in_its_order() -> None:
    """Velocity by backward difference, torque actual in the workspace, and the time since the drive was enabled."""
    seen: list[tuple[float, ...]] = []

    @dataclass(frozen=True)
    class Watching:
        axis: str = "handle"
        name: str = "watching"
        needs: tuple[Signal, ...] = (Signal.ELAPSED_NS, Signal.TORQUE_ACTUAL, Signal.VELOCITY, Signal.POSITION)

        def force(self, *feedback: float) -> float:
            seen.append(feedback)
            return 0.0

        def linearised(self) -> StateSpace:
            return gain([[0.0, 0.0]])

    cycle = Cycle(plan_of(scene_of(Watching())))
    for number, counts in enumerate((5, 5, 25)):
        t_ns = 7_000_000 + 1_000_000 * number
        cycle(struct.pack("<qIHHHih", t_ns, 0, 0, 0, ENABLED, counts, 3 * number))
    assert seen == [
        (0, 0.0, 0.0, 0.0),
        (1_000_000, pytest.approx(3 * UNIT), 0.0, 0.0),
        (2_000_000, pytest.approx(6 * UNIT), pytest.approx(20 * COUNT / 0.001), pytest.approx(20 * COUNT)),
    ]


def test_virtual_states_advance_only_in_operation_enabled() -> None:
    """A held sprung mass starts at rest where the handle is when the drive is enabled: no force until it moves."""
    scene = scene_of(SprungMass("handle", stiffness=100.0, mass=0.5))
    cycle = Cycle(plan_of(scene))
    for _ in range(20):
        cycle(image(5000, status=SWITCHED_ON))
    for _ in range(FADED_IN):
        assert sent(cycle(image(5000))) == (0x0F, 0)
    for counts in range(5000, 6000, 50):
        output = sent(cycle(image(counts)))
    assert output[1] < 0


def test_elements_of_an_axis_add_up() -> None:
    scene = scene_of(Constant("handle", 3.0), Constant("handle", -1.0, name="other"))
    cycle = enabled_cycle(plan_of(scene))
    assert sent(cycle(image()))[1] == round(2.0 / UNIT)


def two_axes(status: tuple[int, int], flags: tuple[int, int] = (0, 0)) -> bytes:
    return struct.pack("<qIHHIHHHihHih", 0, 0, flags[0], 0, 0, flags[1], 0, status[0], 0, 0, status[1], 0, 0)


def test_two_axes_wait_for_each_other_and_fall_together() -> None:
    scene = scene_of(Constant("left", 3.0), Constant("right", 3.0))
    cycle = Cycle(plan_of(scene))
    assert struct.unpack("<HhHh", cycle(two_axes((ENABLED, SWITCHED_ON)))) == (0x0F, 0, 0x0F, 0)
    for _ in range(FADED_IN):
        output = cycle(two_axes((ENABLED, ENABLED)))
    assert struct.unpack("<HhHh", output) == (0x0F, round(3 / UNIT), 0x0F, round(3 / UNIT))
    assert struct.unpack("<HhHh", cycle(two_axes((ENABLED, ENABLED), (0, LinkFlag.BOOT_UP)))) == (0, 0, 0, 0)
    assert cycle.trip is not None
    assert cycle.trip.axis == "right"


def test_the_power_state_of_an_axis_can_be_asked() -> None:
    cycle = Cycle(plan_of())
    cycle(image(status=READY))
    assert cycle.axes["handle"].state.power is PowerState.READY


def test_an_element_that_is_neither_static_nor_dynamic_is_refused() -> None:
    @dataclass(frozen=True)
    class Neither:
        axis: str = "handle"
        name: str = "neither"
        needs: tuple[Signal, ...] = (Signal.POSITION,)

        def linearised(self) -> StateSpace:
            return gain([[0.0, 0.0]])

    with pytest.raises(TypeError, match="neither"):
        Cycle(plan_of(scene_of(Neither())))


def test_the_target_stays_in_the_drives_type() -> None:
    scene = scene_of(Wall("handle", stiffness=1e9, position=0.001))
    plan = jumping(scene, limits=replace(ANY_MOTION, effort=1e9))
    # On a known bench a handle that jumps whatever its torque is would be one that goes the wrong way.
    cycle = enabled_cycle(replace(plan, axes=tuple(replace(axis, plant=None) for axis in plan.axes)))
    for _ in range(20):
        target = sent(cycle(image(200)))[1]
    assert target == -1000


def test_a_timed_estimator_divides_by_the_time_between_the_latch_instants() -> None:
    """A wall of 0.5 N·s/m, 50 counts in 5 ms and nothing in a gap."""
    scene = scene_of(Wall("handle", stiffness=1.0, position=0.0, damping=0.5))
    plan = plan_of(scene, rig=rig_of(scene, limits=ANY_MOTION), estimator="tick-interval")
    cycle, clock = Cycle(plan), Ticks()
    for counts in (0, 10, 20):
        cycle(image(counts, t_ns=clock.next()))
    cycle(image(20, t_ns=clock.next(), flags=LinkFlag.STALE))
    cycle(image(70, t_ns=clock.next(4)))
    force = cycle.row[cycle.columns.index("handle.force")]
    assert force == pytest.approx(-70 * COUNT - 0.5 * 50 * COUNT / 0.005)


def test_the_first_reason_is_kept_when_another_axis_fails_in_the_same_period() -> None:
    @dataclass(frozen=True)
    class Raising(Constant):
        def force(self, position: float) -> float:
            raise ValueError("no")

    cycle = Cycle(plan_of(scene_of(Constant("left", math.nan), Raising("right", 0.0))))
    assert struct.unpack("<HhHh", cycle(two_axes((ENABLED, ENABLED)))) == (0, 0, 0, 0)
    assert cycle.trip is not None
    assert (cycle.trip.kind, cycle.trip.axis) == (TripKind.NOT_FINITE, "left")


def test_a_loop_that_slept_says_for_how_long() -> None:
    plan, clock = plan_of(scene_of(Constant("handle", 1.0))), Ticks()
    cycle = enabled_cycle(plan)
    cycle(image(t_ns=clock.next()))
    cycle(image(t_ns=clock.next(40)))
    assert cycle.trip is not None
    assert "the loop slept for 40 ms" in str(trip_error(cycle.trip, plan, 0))


def test_in_a_gap_the_last_velocity_stays() -> None:
    cycle, clock = enabled_cycle(jumping(scene_of(Damper("handle", damping=1.0)))), Ticks()
    for counts, flags in ((0, 0), (10, 0), (10, LinkFlag.STALE)):
        cycle(image(counts, t_ns=clock.next(), flags=flags))
    assert cycle.row[cycle.columns.index("handle.velocity")] == pytest.approx(10 * COUNT / 0.001)


class TestUnevenPeriods:
    """A loop that was late keeps to its grid, so that the period after it is shorter; the handle goes 3 mm in 1 ms."""

    @staticmethod
    def way(time: float) -> float:
        """[m] after so many milliseconds: 500 m/s², then 3 m/s."""
        return 250e-6 * min(time, 6.0) ** 2 + 3e-3 * max(0.0, time - 6.0)

    def run(self, latches: list[float], ages: list[float] | None = None) -> Cycle:
        """Samples dated by these times [ms] of a handle at one speed, and latched so much later."""
        limits = Limits(speed=10.0, acceleration=900.0)
        cycle = Cycle(plan_with(WALL, limits=limits))
        dated = [float(number) for number in range(20)] + [19.0 + time for time in latches]
        late = [0.0] * 20 + (ages or [0.0] * len(latches))
        for time, more in zip(dated, late, strict=True):
            counts = round(self.way(time + more) / COUNT)
            cycle(image(counts, t_ns=round(1e6 * time) + 1, age=round(1e6 * more)))
        return cycle

    @pytest.mark.parametrize(
        "latches", [[3.44, 4.0, 5.0], [2.9, 3.46, 3.97, 5.0], [1.3, 2.0, 3.0], [1.0, 1.6, 3.0], [3.8, 4.0, 5.0]]
    )
    def test_the_same_speed_is_no_jump(self, latches: list[float]) -> None:
        assert self.run(latches).trip is None

    def test_a_drive_that_latched_late_is_no_jump(self) -> None:
        assert self.run([1.0, 2.0, 3.0, 4.0], [0.0, 0.6, 0.0, 0.0]).trip is None

    @pytest.mark.parametrize("much_later", [0.7, 0.78, 0.9])
    def test_a_drive_that_latched_late_before_a_period_that_was_cut_short_is_no_jump(self, much_later: float) -> None:
        """Too little time tells no speed: that of before stays, and with it how sure it is."""
        dated = [1.0, 2.0, 2.9, 4.58, 4.68, 5.68]
        assert self.run(dated, [0.0, 0.0, much_later, 0.0, 0.0, 0.0]).trip is None

    def test_without_the_age_that_shows_it_the_same_is_one(self) -> None:
        cycle = self.run([1.0, 2.0, 3.0, 4.0])
        cycle(image(round(self.way(25.0) / COUNT), t_ns=24_000_001))
        assert cycle.trip is not None
        assert (cycle.trip.kind, cycle.trip.t_ns) == (TripKind.ACCELERATION, 24_000_001)


def test_feedback_that_comes_in_its_period_and_is_too_old_trips() -> None:
    """As after a pause of the computer between SYNC and reading: nothing else tells it."""
    for age, kinds in ((30_000_000, []), (30_000_001, [TripKind.FEEDBACK_LOST])):
        cycle = enabled_cycle(plan_of(scene_of(Constant("handle", 3.0))))
        assert sent(cycle(image(t_ns=1_000_000)))[1] > 0
        target = sent(cycle(image(t_ns=2_000_000, age=age)))[1]
        assert ([cycle.trip.kind] if cycle.trip else []) == kinds
        assert (target == 0) is bool(kinds)
