"""Cases of faults of bus, encoder and clock: a running loop sets its torque to zero, or continues unaffected."""

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

from haptic_fieldbus import BusError, Limits, LinearMechanism, Plan, Rig, Scene, SceneAxis, Workspace, load_profile
from haptic_fieldbus import plan as plan_scene
from haptic_fieldbus.api.site import simulated_bus
from haptic_fieldbus.assessing import LoopReport
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle import Cycle, LinkFlag, TripKind
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.running.loop import finished, loop_steps
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim.faults import BusOff, Fault
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.study.case import CaseResult, greatest, result_of, values_text
from haptic_fieldbus.study.oracles import events
from haptic_fieldbus.study.oracles.contact import limit_in_contact

# Bench of the cases in `drive`: a plan without files, a cycle fed with octets, and a short simulated run.

PERIOD_NS = 1_000_000
RATE = 1e9 / PERIOD_NS
COUNT = 0.05 / 4096
"""Encoder count at the handle [m]: 50 mm a turn of 4096 counts."""
UNIT = 0.4 / 1000 / (0.05 / (2 * math.pi))
"""Step of torque at the handle [N]: a thousandth of the rated 0.4 N·m."""
ENABLED = 0x0637
"""Statusword of operation enabled."""
FADED_IN = 501
"""Periods of the fade-in of 0.5 s at 1 kHz, and one more."""
CONTACT = 0.6
"""Time at which the bus is lost [s]; the pushing hand is in the wall by then."""


@cache
def _shipped_bench(workspace: Workspace) -> Rig:
    """Return the bench that a plan without a rig has, with one axis."""
    return plan_scene(Scene("free", "", (SceneAxis("handle", workspace),), (Constant("handle", 0.0),))).rig


def plan_of(
    *elements: Element,
    workspace: Workspace = Workspace.LINEAR,
    radius: float | None = None,
    limits: Limits | None = None,
    estimator: str | None = None,
) -> Plan:
    """Return a plan on the shipped bench; `radius` [m] replaces that of a linear mechanism."""
    scene = Scene("case", "a case of the report", (SceneAxis("handle", workspace),), elements)
    shipped = _shipped_bench(workspace)
    axis = shipped.axis["handle"]
    if radius is not None and workspace is Workspace.LINEAR:
        axis = replace(axis, mechanism=LinearMechanism("linear", 2 * math.pi * radius))
    axis = replace(axis, limits=limits or axis.limits)
    rig = Rig(shipped.bus, {"handle": axis})
    return compile_plan(scene, rig, {axis.profile: load_profile(axis.profile)}, RATE, estimator=estimator)


class Feeder(Cycle):
    """Cycle that keeps its plan for packing and unpacking its octets."""

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.plan = plan

    def value(self, name: str) -> float:
        """Return a column of the handle in the last period."""
        return self.row[self.columns.index(f"handle.{name}")]

    @property
    def tripped(self) -> TripKind | None:
        """Kind of the trip; None when there was none."""
        return self.trip.kind if self.trip else None


def feed(cycle: Feeder, counts: int = 0, flags: int = 0, t_ns: int = 0) -> bytes:
    """Run one period in operation enabled at this position, and return the octets of the output image.

    The drive shows the last torque sent to it.
    """
    shown = int(cycle.value("target torque"))
    return bytes(cycle(cycle.plan.image.input.pack(t_ns, 0, flags, 0, ENABLED, counts, shown)))


def torque(cycle: Feeder, counts: int = 0, flags: int = 0, t_ns: int = 0) -> int:
    """Run one period, and return its target torque [‰ of rated torque]."""
    return int(cycle.plan.image.output.unpack(feed(cycle, counts, flags, t_ns))[-1])


def running_feeder(plan: Plan, counts: int = 0, t_ns: int = 0) -> Feeder:
    """Return a cycle that has been in operation enabled, at rest, until force is faded in."""
    cycle = Feeder(plan)
    for _ in range(FADED_IN):
        feed(cycle, counts, t_ns=t_ns)
    return cycle


def _run(plan: Plan, clock: VirtualClock, cycles: int, faults: tuple[Fault, ...] = ()) -> tuple[Any, LoopReport, str]:
    """Run a plan on the simulated drive with a hand that pushes at once; return truth, report and the error's class."""
    report, error, hand = LoopReport(), "none", hand_named("push")
    at_once = None if hand is None else hand.after(-plan.axes[0].limits.fade_in)
    bus, truth = simulated_bus(plan, plan.buses[0], clock, hand=at_once, faults=faults)
    try:
        bus.open(plan)
        finished(loop_steps(plan, Cycle(plan), bus, clock, cycles=cycles, report=report))
    except BusError as raised:
        error = type(raised).__name__
    finally:
        bus.close()
    return truth, report, error


def bus_off_in_contact() -> tuple[str, float, float, float]:
    """Run into a bus-off of our own controller while the wall pushes back, then watch the drive for 0.5 s.

    Returns the class of the error that ended the run, "none" without one; the time set in the drive watchdog [s]; the
    target torque of the drive when the bus was lost [N·m]; and the time from the loss to a target torque of 0 [s], ∞
    when it was not 0 at the end.
    """
    plan, clock = plan_of(Wall("handle", stiffness=600.0, position=0.02)), VirtualClock()
    truth, report, error = _run(plan, clock, 700, (BusOff("bus_off", CONTACT),))
    clock.sleep_until(clock.now_ns() + 500_000_000)
    times, torques = truth.trajectory(plan.axes[0].node).targets()
    lost_ns = (report.enabled_at_ns or 0) + round(CONTACT * 1e9)
    held = [float(torque) for at, torque in zip(times, torques, strict=True) if at <= lost_ns]
    ended = [int(at) for at, torque in zip(times, torques, strict=True) if at > lost_ns and torque == 0.0]
    free = (ended[0] - lost_ns) * 1e-9 if ended and torques[-1] == 0.0 else math.inf
    return error, plan.guards[0].seconds, held[-1], free


def lost_bus(quick: bool) -> CaseResult:
    """Check that after bus-off in contact the target is 0 in that period, and the drive frees itself."""
    cycle = running_feeder(plan_of(Constant("handle", 3.0)))
    before = torque(cycle)
    after = [torque(cycle, flags=LinkFlag.BUS_OFF), *(torque(cycle) for _ in range(100))]
    error, guard, pushed, free_after = bus_off_in_contact()
    return result_of(
        f"target {round(3.0 / UNIT)} ‰, then 0 from the period of the loss on; the drive's torque is asked to be 0 "
        f"within its guard time of {exactly(1e3 * guard)} ms and a period, and the run ends with an error",
        f"target {before} ‰, then at most {max(map(abs, after))} ‰ for {len(after)} periods; drive without torque "
        f"{1e3 * free_after:.2f} ms later; {error}",
        "hand-derived: 3 N in thousandths of rated torque; the guard time that the drive was given",
        tolerance="exact in ‰; the drive within its guard time and a period",
        within=[(free_after, guard + PERIOD_NS * 1e-9)],
        holds=before == round(3.0 / UNIT)
        and not any(after)
        and cycle.tripped is TripKind.BUS_OFF
        and pushed < 0.0 <= free_after
        and error == "BusError",
    )


def stale_position(quick: bool) -> CaseResult:
    """One missing sample changes nothing; the second in a row removes a tenth of the torque, the eleventh removes all.

    The first new sample restores the torque, here in one period, because the slew limit allows it.
    """
    full = round(3.0 / UNIT)
    cycle = running_feeder(plan_of(Constant("handle", 3.0)))
    single = [torque(cycle, flags=flag) for _ in range(3) for flag in (LinkFlag.STALE, 0)]
    gap = [torque(cycle, flags=LinkFlag.STALE) for _ in range(12)]
    later = [torque(cycle) for _ in range(10)]
    line = [round(3.0 * max(0, 10 - number) / 10 / UNIT) for number in range(12)]
    return result_of(
        f"{full} ‰ throughout with every other sample; in a gap {', '.join(map(str, line))} ‰; then {full} ‰ (exact)",
        f"{min(single)} to {max(single)} ‰; {', '.join(map(str, gap))} ‰; then {later[-1]} ‰",
        "hand-derived: a straight line of 10 ms from the second missing sample, in thousandths of rated torque",
        tolerance="exact in ‰",
        holds=single == [full] * 6 and gap == line and later == [full] * 10,
    )


def non_finite_input(quick: bool) -> CaseResult:
    """Check that a force of NaN or infinity becomes zero torque and a trip, and that walls and states pass NaN on."""
    values = (math.nan, -math.nan, math.inf, -math.inf, 1e308 * 10.0, math.inf - math.inf)
    torques, trips = [], 0
    for value in values:
        cycle = Feeder(plan_of(Constant("handle", value)))
        torques += [abs(torque(cycle)) for _ in range(10)]
        trips += cycle.tripped is TripKind.NOT_FINITE
    step = bind(SprungMass("handle", 200.0, 0.5).dynamics, 1e-3)
    step(0.0)
    shown = [
        step(math.nan),
        step(0.0),
        *(Wall("handle", 600.0, damping=b).force(math.nan, 0.0) for b in (0.0, 1.0)),
        Wall("handle", 600.0, damping=1.0).force(1.0, math.nan),
    ]
    visible = sum(math.isnan(force) for force in shown)
    return result_of(
        f"{len(values)} of {len(values)} such forces trip, largest target 0 ‰; {len(shown)} of {len(shown)} "
        "not-a-number inputs come out as not-a-number",
        f"{trips} of {len(values)} trip, largest target {max(torques)} ‰; {visible} of {len(shown)} come out",
        "IEEE 754: an operation on not-a-number gives not-a-number; zero torque by definition of a trip",
        tolerance="exact",
        holds=trips == len(values) and not any(torques) and visible == len(shown),
    )


def denormal_input(quick: bool) -> CaseResult:
    """Check that forces below 2.2e-308 N give no torque and no trip, and such motions keep virtual states exact."""
    targets, trips = [], 0
    for value in (5e-324, -5e-324, 1e-310, 2.2250738585072014e-308):
        cycle = running_feeder(plan_of(Constant("handle", value)))
        targets.append(abs(torque(cycle)))
        trips += cycle.trip is not None
    stiffness, mass, height, steps = 200.0, 0.5, 1e-310, 1000 if quick else 100_000
    step = bind(SprungMass("handle", stiffness, mass).dynamics, 1e-3, "exact-zoh")
    step(0.0)
    turn = math.sqrt(stiffness / mass) * 1e-3
    error = greatest(abs(step(height) / height + stiffness * math.cos(turn * n)) for n in range(steps)) / stiffness
    return result_of(
        f"targets 0 ‰, 0 trips; a sprung mass pushed by {exactly(height)} m swings as k·x·cos(ω·t) for {steps} "
        "periods, within 1e-6",
        f"largest target {max(targets)} ‰, {trips} trips; off by {rounded(error, 1)}",
        "closed form: F = −k·x·cos(ω·t) after a step of the handle",
        tolerance="1e-6 of the swing; targets exact",
        within=[(error, 1e-6)],
        holds=not any(targets) and not trips,
    )


def encoder_wrap(quick: bool) -> CaseResult:
    """A position counter that wraps at 2³¹, there and back, is followed without a jump."""
    wall = Wall("handle", stiffness=1.0, position=-1.0, damping=0.5)
    cycle = running_feeder(plan_of(wall, limits=Limits(speed=10.0, acceleration=1e9)), 0x7FFF_FFFF - 2000)
    true, off, off_speed, crossings = 0, 0.0, 0.0, 0
    ways = [way for _ in range(20 if quick else 2000) for way in (700, 700, 700, 1, 699, -700, -1, -699, -700, -700)]
    counts = 0x7FFF_FFFF - 2000
    # The unlimited count in integers and the position in fractions: no rounding of floats in the oracle.
    for way in ways:
        true += way
        moved = (counts + way + 2**31) % 2**32 - 2**31
        crossings += moved * counts < 0
        counts = moved
        feed(cycle, counts)
        # A Fraction of not-a-number raises ValueError.
        off = max(off, abs(float(Fraction(cycle.value("position")) - true * Fraction(1, 4096) * Fraction(1, 20))))
        off_speed = greatest((off_speed, abs(cycle.value("velocity") - way * COUNT / 1e-3)))
    expected = 2 * len(ways) // 10
    return result_of(
        f"{expected} crossings, no trip, position within 1e-15 m and velocity within 1e-11 m/s of the unlimited count",
        f"{crossings} crossings, {cycle.tripped.value if cycle.tripped else 'no trip'}, position off by "
        f"{rounded(off, 1)} m, velocity by {rounded(off_speed, 1)} m/s",
        "integers without a largest value, and fractions",
        tolerance="1e-15 m, 1e-11 m/s",
        within=[(off, 1e-15), (off_speed, 1e-11)],
        holds=crossings == expected and cycle.trip is None,
    )


def encoder_jump(quick: bool) -> CaseResult:
    """A jump that motor and hand could make is rendered at the slew limit; a jump larger by one count trips at once."""
    mass, effort = 4.0e-5 / (0.05 / (2 * math.pi)) ** 2, 1000 * UNIT
    allowed = math.floor((effort + LARGEST_HAND_FORCE) / mass * 1e-6 / COUNT) + 2
    plan = plan_of(Wall("handle", stiffness=2000.0))
    outcomes = {}
    for jump in range(allowed - 20, allowed + 21):
        cycle = running_feeder(plan)
        outcomes[jump] = (torque(cycle, jump), cycle.tripped)
    largest = max(jump for jump, (_, trip) in outcomes.items() if trip is None)
    tripped = [(sent, trip) for sent, trip in outcomes.values() if trip is not None]
    slew = plan.axes[0].limits.effort / 5.0 / UNIT
    kick = max(abs(sent) for sent, _ in outcomes.values())
    return result_of(
        f"jumps up to {allowed} counts pass ({effort:.1f} N of the motor and {exactly(LARGEST_HAND_FORCE)} N of a hand "
        f"on {mass:.3f} kg for 1 ms, and two counts), larger ones trip with 0 ‰; no step of torque beyond {slew:.1f} ‰ "
        "(a fifth of the limit, and rounding)",
        f"up to {largest} counts pass, {len(tripped)} of 20 larger ones trip with at most "
        f"{max(abs(sent) for sent, _ in tripped)} ‰; largest step {kick} ‰",
        "hand-derived from the largest forces, inertia, period and count; slew of 5 ms from 0 to the limit",
        tolerance="exact in counts; half a step of torque",
        within=[(kick, slew + 0.5)],
        holds=largest == allowed
        and len(tripped) == 20
        and all(sent == 0 and trip is TripKind.ACCELERATION for sent, trip in tripped)
        and kick > 0,
    )


LARGEST_HAND_FORCE = 500.0
"""[N]; stated in the reference of the limits."""


def clock_backwards(quick: bool) -> CaseResult:
    """Time stamps that stand still change nothing; one that goes back, by a nanosecond or by days, ends the run.

    After such a step neither the age of the feedback nor its velocity is known.
    """
    damped = plan_of(Wall("handle", stiffness=600.0, damping=0.5), estimator="tick-interval")
    plain = running_feeder(plan_of(Wall("handle", stiffness=600.0)), t_ns=600 * PERIOD_NS)
    off = 0.0
    for n in range(80):
        sent = torque(plain, 10 * (n + 1), t_ns=600 * PERIOD_NS)
        off = max(off, abs(sent + 6000.0 * (n + 1) * COUNT / UNIT))
    back = []
    for hop in (1, PERIOD_NS, 10**15):
        cycle = running_feeder(damped, t_ns=600 * PERIOD_NS)
        back.append((torque(cycle, 10, t_ns=600 * PERIOD_NS - hop), cycle.tripped))
    tripped = sum(trip is TripKind.CLOCK and sent == 0 for sent, trip in back)
    return result_of(
        "standing still: K·x within 0.5 ‰ at every sample, no trip; 3 of 3 that go back trip with 0 ‰",
        f"off by {off:.3f} ‰, {'no trip' if plain.trip is None else 'a trip'}; {tripped} of {len(back)} trip with 0 ‰",
        "closed form: F = −K·x; zero torque by definition of a trip",
        tolerance="0.5 ‰ of torque",
        within=[(off, 0.5 + 1e-9)],
        holds=plain.trip is None and tripped == len(back),
    )


def long_clock(quick: bool) -> CaseResult:
    """Check that near 2⁶² ns (146 years) velocity is as exact as at 0, and trips and periods are to the nanosecond."""
    start = 2**62 + 12_345
    damped = plan_of(Wall("handle", 600.0, damping=0.5), estimator="tick-interval")
    cycle = running_feeder(damped, t_ns=start - PERIOD_NS)
    error, counts, t_ns = 0.0, 0, start
    for n in range(400):
        late = (n * 7919) % 1000 - 500  # scattered over ±0.5 µs, the same in each run: 7919 is prime
        feed(cycle, counts := counts + 5, t_ns=(stamp := start + n * PERIOD_NS + late))
        exact = Fraction(5, 20 * 4096) / Fraction(stamp - t_ns, 10**9) if n else None
        error = error if exact is None else max(error, abs(float(Fraction(cycle.value("velocity")) / exact - 1)))
        t_ns = stamp
    feed(cycle, counts, flags=LinkFlag.BOOT_UP, t_ns=start + 10**15 + 1)
    stamp = cycle.trip.t_ns - start if cycle.trip is not None else 0
    _, report, _ = _run(plan_of(Wall("handle", stiffness=600.0)), VirtualClock(2**62 - 10**12 + 1), 300)
    odd = int((report.sample("period_ns")[1:] != PERIOD_NS).sum())
    return result_of(
        "velocity within 1e-9 of counts over nanoseconds, trip at 1000000000000001 ns, "
        "300 periods of exactly 1000000 ns, simulated 1000 s before 2⁶² ns (where the simulation's clock ends)",
        f"velocity off by {rounded(error, 1)}, trip at {stamp} ns, {report.cycles} simulated periods, {odd} of another "
        "length",
        "fractions of integer counts and nanoseconds; float64 has steps of 1024 ns there",
        tolerance="1e-9 of the velocity; times exact",
        within=[(error, 1e-9)],
        holds=stamp == 10**15 + 1 and report.cycles == 300 and odd == 0,
    )


VIRTUAL = 0.002
"""Damping of the wall, the same number in both workspaces [N·s/m or N·m·s/rad]."""


def rotary_equals_linear(quick: bool) -> CaseResult:
    """Check that with a radius of 1 m the linear and the rotary workspace give the same numbers."""
    wall = Wall("handle", stiffness=30.0, position=0.01, damping=VIRTUAL)
    limits = Limits(effort=0.3, speed=100.0)
    plans = [plan_of(wall, workspace=space, radius=1.0, limits=limits) for space in Workspace]
    cycles = [running_feeder(plan) for plan in plans]
    worst, apart, before = 0.0, 0, 0.0
    for n in range(1, 200):
        counts = round(20.0 * math.sin(0.05 * n))
        x = 2.0 * math.pi * counts / 4096
        exact = min(0.0, -30.0 * (x - 0.01) - VIRTUAL * (x - before) / 1e-3) if x > 0.01 else 0.0
        before = x
        outputs = [torque(cycle, counts) for cycle in cycles]
        worst = greatest((worst, *(abs(cycle.value("force") - exact) for cycle in cycles)))
        apart += outputs[0] != outputs[1]
    judged = [(plan.stability.stiffness_limit.stable if plan.stability else None) or math.nan for plan in plans]
    limit = _limit_by_hand(plans[0])
    off = greatest(abs(each / limit - 1.0) for each in judged)
    return result_of(
        f"force and torque within 1e-12 of −K·x − B·v, 0 of 199 targets differ, both limits of stiffness "
        f"{rounded(limit, 6)}",
        f"off by {rounded(worst, 1)}, {apart} of 199 targets differ, limits {values_text(judged, 6)}, off by "
        f"{rounded(off, 1)}",
        "closed form of a spring-damper, x = 2π·counts/4096 m or rad; inertia and friction of the motor, its torque "
        "loop and the damper from event to event",
        tolerance="1e-12 of the forces; targets exact; 1e-6 of the limit",
        within=[(worst, 1e-12), (off, 1e-6)],
        holds=apart == 0 and all(cycle.trip is None for cycle in cycles),
    )


def _limit_by_hand(plan: Plan) -> float:
    """Return the limit of stability of the shipped motor at a radius of 1 m, with the times of a plan."""
    delay = plan.axes[0].delay
    return limit_in_contact(events.motor(4e-5, 1e-4, delay.torque_loop), 1e-3, delay.transport, VIRTUAL)
