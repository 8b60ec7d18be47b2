"""Cases of time: gaps in the feedback, instants that differ from period to period, requests on Modbus."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from haptic_fieldbus import Limits, Plan, Rig, Scene, SceneAxis, Workspace, load_profile
from haptic_fieldbus import plan as plan_scene
from haptic_fieldbus.api.site import simulated_bus
from haptic_fieldbus.assessing import Record
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle import Cycle, LinkFlag, columns
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import (
    EnvironmentOf,
    Plant,
    check_times,
    dynamics,
    gaps,
    limit_of,
    pattern_growth,
    pattern_limit,
    sample,
    stiffness_limit,
    through_torque_loop,
)
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, zoh
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.running.loop import finished, loop_steps
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.study.case import CaseResult, greatest, largest_error, relative_error, result_of, values_text
from haptic_fieldbus.study.cases.drive import COUNT, FADED_IN, PERIOD_NS, UNIT, Feeder, feed, plan_of
from haptic_fieldbus.study.measure import region
from haptic_fieldbus.study.oracles import events
from haptic_fieldbus.study.oracles.contact import growth_of_turn, largest, schur_cohn_limit

# Cases of instants that differ from period to period: samples that are lost in a pattern, and a drive's own ticks.

PERIOD = 1e-3
DEVICE, VIRTUAL = Plant(0.1, 2.0, torque_lag=0.16e-3), 0.5
"""Device, and the damper of a wall by backward difference [N·s/m]."""
MOTOR = events.motor(0.1, 2.0, 0.16e-3)
"""The same device."""
AGREEMENT = 1e-6
"""Permitted relative difference of limits."""


def _wall(stiffness: float) -> StateSpace:
    return region.wall(stiffness, VIRTUAL, PERIOD, "backward-difference")


def _growth_by_hand(stiffness: float, turn: float, shots: Sequence[events.Shot]) -> float:
    """Return the growth over a whole turn."""
    return growth_of_turn(MOTOR, turn, shots, stiffness, VIRTUAL, PERIOD)


def _limit_by_hand(turn: float, shots: Sequence[events.Shot]) -> float:
    return largest(lambda stiffness: _growth_by_hand(stiffness, turn, shots) <= 1.0, 1.0, 1.4, 1e-9)


LATE = 0.3e-3
"""Time from a sample to its force [s]."""
LOST = ((1, 2), (1, 1, 3), (5, 1, 1))
"""Patterns, by the numbers of periods for which each force is held."""


def _shots(lengths: Sequence[int]) -> tuple[float, list[events.Shot]]:
    received = [place == 0 for length in lengths for place in range(length)]
    shots = [events.Shot(at * PERIOD, (at * PERIOD + LATE,), has_come) for at, has_come in enumerate(received)]
    return len(received) * PERIOD, shots


def missed_frames_pattern(quick: bool) -> CaseResult:
    """Check limit and growth of a loop with delay and lag that loses samples in a pattern and holds its last force.

    The damper keeps the last received position, and divides the way from it by one period.
    """
    found = [pattern_limit(DEVICE, PERIOD, LATE, _wall, gaps(lengths)) for lengths in LOST]
    by_hand = [_limit_by_hand(*_shots(lengths)) for lengths in LOST]
    whole = stiffness_limit(DEVICE, PERIOD, LATE, _wall)
    apart = relative_error(found, by_hand)
    device, over = sample(DEVICE, PERIOD, LATE), 1.5 * by_hand[0]
    grown = pattern_growth(device, _wall(over), gaps(LOST[0])) ** sum(LOST[0])
    expected = _growth_by_hand(over, *_shots(LOST[0]))
    off = abs(grown / expected - 1.0)
    return result_of(
        f"one of three lost {rounded(by_hand[0], 6)} N/m, two of five {rounded(by_hand[1], 6)} N/m, four of seven "
        f"{rounded(by_hand[2], 6)} N/m; over three periods ×{rounded(expected, 6)} at 1.5 times the first",
        f"{values_text(found, 6)} N/m of {rounded(whole, 6)} without losses, apart by {rounded(apart, 1)}; "
        f"×{rounded(grown, 6)}, off by {rounded(off, 1)}",
        "each pattern from event to event, with the force before given again for a lost sample",
        tolerance=f"{exactly(AGREEMENT)} of limits and growth",
        within=[(apart, AGREEMENT), (off, AGREEMENT)],
        holds=max(found) < whole and expected > 1.01,
    )


TICK, ARRIVAL, AGE = 0.4e-3, 0.25e-3, 0.05e-3
"""Control ticks of a drive, travel time of a set-point to it, and age of a position at its tick [s]."""
LATENESS = (0.0, 0.15e-3)
"""Lateness of each of two SYNC messages [s]; two periods are five ticks."""
PHASES = (0.0, 0.1e-3, 0.3e-3)


def _ticked(phase: float) -> tuple[float, list[events.Shot]]:
    """Return a turn of two periods; the ticks are found by enumeration."""
    ticks = [phase + number * TICK for number in range(-10, 20)]
    shots = []
    for number, late in enumerate(LATENESS):
        sync = number * PERIOD + late
        measured = max(tick for tick in ticks if tick <= sync + 1e-9) - AGE
        shots.append(events.Shot(measured, (min(tick for tick in ticks if tick >= sync + ARRIVAL - 1e-9),)))
    return len(LATENESS) * PERIOD, shots


def tick_phase(quick: bool) -> CaseResult:
    """Check the limit of a drive with ticks not locked to SYNC, for each phase; the longest delay bounds it."""
    found, by_hand = [], []
    for phase in PHASES:
        pattern = free_ticks(Ticks(TICK, phase), PERIOD, ARRIVAL, LATENESS, AGE)
        found.append(schedule_limit(DEVICE, PERIOD, pattern, _wall))
        by_hand.append(_limit_by_hand(*_ticked(phase)))
    apart = relative_error(found, by_hand)
    longest = AGE + TICK + ARRIVAL + TICK + max(LATENESS)
    least = stiffness_limit(DEVICE, PERIOD, longest, _wall)
    return result_of(
        f"phases of 0, 0.1, 0.3 ms: {values_text(by_hand, 6)} N/m",
        f"{values_text(found, 6)} N/m, apart by {rounded(apart, 1)}; with the longest delay, {rounded(1e3 * longest)} "
        f"ms, in each period {rounded(least, 6)} N/m",
        "each pattern from event to event, its ticks gone through one after another",
        tolerance=f"{exactly(AGREEMENT)} of each limit",
        within=[(apart, AGREEMENT)],
        holds=least < min(found) < 0.99 * max(found),
    )


# Case of a request that writes before it reads: on Modbus its torque acts one whole period late.

DRIVE = "generic_cia402_modbus"
NETWORK = 0.5e-3
"""Time that a request and its answer take in the network [s]."""
FASTEST = 1e8
"""Bandwidth of a torque loop without lag [Hz], which the oracle does not know."""


def modbus_one_period(quick: bool) -> CaseResult:
    """Check that with function 23 each torque acts one period after its sample, and that the limit includes this delay.

    The limit is compared with a polynomial in 60 digits. The instants at which torque changed in the simulated drive
    are compared with those of its samples.
    """
    plan = _late_plan()
    plant = plan.axes[0].plant
    limit = plan.stability.stiffness_limit.stable if plan.stability is not None else None
    if plant is None or limit is None:
        raise ValueError("the shipped bench on Modbus has a limit of stability")
    exact = schur_cohn_limit(Plant(plant.mass, plant.damping), PERIOD, 1.0)
    late = _late(plan, 800 if quick else 3000)
    worst = greatest(abs(each - PERIOD) for each in late)
    return result_of(
        f"limit {exact:.3f} N/m; each of at least 50 changes of torque {exactly(1e3 * PERIOD)} ms after its sample",
        f"limit off by {rounded(abs(limit / exact - 1.0), 1)} (1e-5 allowed); {len(late)} changes, off by at most "
        f"{rounded(1e9 * worst, 2)} ns (2 allowed)",
        "polynomial of a loop with one period of delay, by Schur and Cohn; instants at the drive, which knows no plan",
        tolerance="1e-5 of the limit; 2 ns",
        within=[(limit / exact - 1.0, 1e-5), (worst, 2e-9)],
        holds=len(late) >= 50,
    )


def _late_plan() -> Plan:
    """Return a wall on the shipped bench, over a network in which two requests do not fit into a period.

    The drive has no lag of its own.
    """
    profile: Any = load_profile(DRIVE)
    profile = replace(profile, timing=replace(profile.timing, torque_bandwidth=FASTEST, control_period=0.0))
    wall = Wall("handle", stiffness=300.0, position=0.005)
    scene = Scene("case", "a case of the report", (SceneAxis("handle", Workspace.LINEAR),), (wall,))
    shipped = plan_scene(scene, drive=DRIVE, bus="sim-modbus-tcp").rig
    ((name, section),) = cast(dict[str, Any], shipped.bus).items()
    rig = Rig({name: replace(section, round_trip=NETWORK)}, shipped.axis)
    return compile_plan(scene, rig, {DRIVE: profile}, 1.0 / PERIOD)


def _late(plan: Plan, cycles: int) -> list[float]:
    """Return how long after its sample each new torque acted in the drive [s]."""
    axis, clock = plan.axes[0], VirtualClock()
    bus, line = simulated_bus(plan, plan.buses[0], clock, hand=hand_named("push"))
    record = Record(columns(plan), cycles + 1000)
    try:
        bus.open(plan)
        finished(loop_steps(plan, Cycle(plan), bus, clock, cycles=cycles, record=record))
        if line is None:
            return [math.inf]
        times, torques = line.trajectory(axis.node).targets()
    finally:
        bus.close()
    acted = {round(1e6 * float(torque)): int(at) for at, torque in zip(times[::-1], torques[::-1], strict=True)}
    unit = axis.effort_unit * axis.rig.mechanism.ratio
    found: dict[int, int] = {}
    for at, target in zip(record.column("t_ns"), record.column("handle.target torque"), strict=True):
        found.setdefault(round(1e6 * float(target) * unit), int(at))
    return [1e-9 * (acted[torque] - at) for torque, at in found.items() if torque and torque in acted]


# Cases of gaps in the feedback: how the force fades and comes back, and how many gaps a loop bears.

WAY, FADE = 20, 10
"""Counts that the hand moves in a period, and periods of a whole fade."""
STIFFNESS, EFFORT = 10.0 * UNIT / (WAY * COUNT), 400.0 * UNIT
"""Wall [N/m] and effort limit [N]; both give whole steps of torque, so no torque is rounded."""
SLEW = EFFORT / 5.0
"""Largest change of the force in a period [N]: from 0 to the limit in 5 ms."""
SOON = 15
"""Longest gap [periods] after which the wall continues unchanged; after a longer gap its force also has a cap."""
PRESSED, DEEPER = 30, 10
"""Periods of pressing before the gap, and after it."""
EXACT = 1e-9
"""Permitted difference of forces and works, relative to the effort limit and to the energy of the wall."""


def _forces(gap: int) -> tuple[list[float], list[float]]:
    """Return the commanded and the expected forces [N], with a gap of so many periods in the feedback.

    The hand presses deeper during the gap, and for a while after it. Then it leaves the wall and enters it again. After
    a trip the command is 0.
    """
    cycle = Feeder(plan_of(Wall("handle", STIFFNESS), limits=Limits(effort=EFFORT)))
    turn = PRESSED + gap + DEEPER
    places = [WAY * number for number in range(1, turn + 1)]
    places += [*places[-2::-1], 0, -WAY, *(WAY * number for number in range(PRESSED))]
    lost = range(PRESSED, PRESSED + gap)
    found, seen = [], (0, 0)
    for number in range(FADED_IN + len(places)):
        at = number - FADED_IN
        is_lost = at in lost
        if not is_lost:
            seen = places[at] if at >= 0 else 0, number * PERIOD_NS
        feed(cycle, seen[0], LinkFlag.STALE if is_lost else 0, seen[1])
        if at >= 0:
            found.append(cycle.value("command"))
    return found, _expected(places, gap)


def _expected(places: Sequence[int], gap: int) -> list[float]:
    """Return the force by hand [N], segment after segment."""
    asked = [-STIFFNESS * COUNT * max(place, 0) for place in places]
    kept = asked[PRESSED - 1]
    faded = [kept * max(0.0, 1.0 - max(0, missing - 1) / FADE) for missing in range(1, gap + 1)]
    left = next(number for number in range(PRESSED + gap, len(places)) if not asked[number])
    # Back in contact it rises as fast as it may. The wall waits until the force is that of before within a step of the
    # drive, and goes on from there. After a long gap that force is a cap: the wall goes on for a period, in which it is
    # seen to cut, and then for as long as the hand presses on it waits again. A gap of one period is none: every force
    # is held for a period.
    cap, pauses = kept if gap > SOON else -EFFORT, gap > 1
    risen = [faded[-1] - SLEW * number for number in range(1, left - PRESSED - gap + 1)]
    waits = next(number for number, force in enumerate(risen) if force <= kept + UNIT) if pauses else 0
    beside = places[PRESSED + gap + waits] - places[PRESSED - 1] if pauses else 0
    if gap > SOON:
        beside += WAY * max(0, DEEPER - waits - 2)
        waits = max(waits, DEEPER)
    wanted = [kept] * waits
    wanted += [-STIFFNESS * COUNT * max(place - beside, 0) for place in places[PRESSED + gap + waits : left]]
    back = [max(cap, *each) for each in zip(risen, wanted, strict=True)]
    return [*asked[:PRESSED], *faded, *back, *asked[left:]]


def _given(forces: Sequence[float], gap: int) -> float:
    """Return the work of the force on the hand from the first contact until contact is left [J]."""
    inwards = PRESSED + gap + DEEPER - 1
    ways = [WAY * COUNT] * inwards + [-WAY * COUNT] * (inwards + 1)
    return sum(force * way for force, way in zip(forces, ways, strict=False))


def fade_return(quick: bool) -> CaseResult:
    """Check that a force fades in a gap and returns at its slew limit, and that the wall continues or is capped.

    The hand presses deeper in the gap and for a while after it, then leaves. It gets back more energy than it gave: the
    leak of held forces and the energy of the faded force. A force that returned in full would give it more.
    """
    gaps = (1, 4, 15, 20) if quick else range(1, 21)
    off, works, by_hand = 0.0, [], []
    for gap in gaps:
        found, wanted = _forces(gap)
        off = greatest((off, largest_error(found, wanted)))
        works.append(_given(found, gap))
        by_hand.append(_given(wanted, gap))
    apart = largest_error(works, by_hand)
    stored = 0.5 * STIFFNESS * (WAY * COUNT * PRESSED) ** 2
    return result_of(
        f"pressing to {rounded(STIFFNESS * WAY * COUNT * PRESSED, 4)} N, gaps of {', '.join(map(str, gaps))} periods: "
        f"held, fading over {FADE}, back by at most {rounded(SLEW, 3)} N a period to that force; after {SOON} at most "
        "the wall goes on from there, after more with that force at most; the hand gets "
        f"{values_text([1e3 * each for each in by_hand], 3)} mJ",
        f"off by at most {rounded(off, 1)} N; the hand gets "
        f"{values_text([1e3 * each for each in works], 3)} mJ, off by {rounded(1e3 * apart, 1)} mJ",
        "the force by hand, segment after segment, and its work",
        tolerance=f"{exactly(EXACT)} of {rounded(EFFORT, 3)} N and of {rounded(1e3 * stored, 3)} mJ",
        within=[(off, EXACT * EFFORT), (apart, EXACT * stored)],
    )


LENGTH, EACH = 10, 51
"""Periods from sample to sample in a gap, and periods from gap to gap: less than a fifth of the samples is missing."""
SPANS = (1.5, 40.0)
"""Stiffness limit over stiffness, for two walls."""


def _given_up(stiffness: float) -> str | None:
    """Return the kind of the trip of a loop with such gaps while the handle rests in the wall; None without a trip."""
    cycle = Feeder(plan_of(Wall("handle", stiffness)))
    for number in range(FADED_IN + 1200):
        within = max(number - FADED_IN, 0) % EACH
        lost = 0 < within < LENGTH
        feed(cycle, WAY, LinkFlag.STALE if lost else 0, (number - (within if lost else 0)) * PERIOD_NS)
        if cycle.tripped is not None:
            return cycle.tripped.value
    return None


def gaps_given_up(quick: bool) -> CaseResult:
    """Check that a loop trips if its gaps make it grow, although few samples are missing, and another loop does not.

    A gap counts by the square of its length, because its force is older by its length.
    """
    axis = plan_of(Wall("handle", STIFFNESS)).axes[0]
    if axis.plant is None or axis.stability is None:
        raise ValueError("the bench of the cases is known")
    limit = axis.stability.stiffness_limit.stable or 0.0
    body = events.motor(axis.plant.mass, axis.plant.damping, axis.plant.torque_lag)
    period, late = PERIOD_NS * 1e-9, axis.delay.transport
    shots = [events.Shot(at * period, (at * period + late,), not 0 < at < LENGTH) for at in range(EACH)]
    grown = [growth_of_turn(body, EACH * period, shots, limit / span, 0.0, period) for span in SPANS]
    found = [_given_up(limit / span) for span in SPANS]
    stretch = (LENGTH**2 + EACH - LENGTH) / EACH
    return result_of(
        f"{LENGTH - 1} of {EACH} samples lost, stretch {rounded(stretch, 3)}: at 1/{exactly(SPANS[0])} of the limit a "
        f"knock is multiplied by {rounded(grown[0], 4)} from gap to gap, and the loop is given up; at "
        f"1/{exactly(SPANS[1])} by {rounded(grown[1], 4)}",
        f"{found[0] or 'no trip'}; {found[1] or 'no trip'}",
        "device and torque loop from event to event, over a gap and the samples up to the next one",
        tolerance="exact",
        holds=grown[0] > 1.0 > grown[1] and found[0] is not None and found[1] is None,
    )


# A loop whose samples and forces come at instants that differ from period to period, in a pattern that repeats.
# A control tick that is not locked to SYNC, a position that is older than its latch, an adapter, a late host: each
# shifts the instant at which a position is measured, or the instant from which its force acts. Between two instants the
# device moves under a constant force, exactly. A pattern of N periods is therefore one linear map. Its eigenvalue of
# the largest modulus decides stability (Floquet). A constant delay is a pattern of one period.


@dataclass(frozen=True)
class Instants:
    """Instants of one period [s], counted from its nominal beginning k·T."""

    measured: float
    """Instant at which the position was measured; negative if it was measured before the latch."""
    acts: float
    """Instant from which its force acts."""


@dataclass(frozen=True)
class Ticks:
    """Control ticks of a drive at phase + n·period [s], in the time of the loop."""

    period: float
    phase: float = 0.0

    def after(self, instant: float) -> float:
        """Return the first tick from `instant` on."""
        return self.phase + math.ceil((instant - self.phase) / self.period - 1e-9) * self.period

    def before(self, instant: float) -> float:
        """Return the last tick up to `instant`."""
        return self.phase + math.floor((instant - self.phase) / self.period + 1e-9) * self.period


def free_ticks(
    ticks: Ticks, period: float, arrival: float, lateness: Sequence[float], latency: float = 0.0
) -> tuple[Instants, ...]:
    """Return the pattern of a drive whose ticks are not locked to SYNC, for the lateness [s] of each SYNC.

    A set-point arrives `arrival` after SYNC. The position at SYNC is that of the last tick, older by `latency`. The
    pattern repeats only if its periods together are a whole number of ticks; otherwise raises UsageError.
    """
    turns = len(lateness) * period / ticks.period
    if abs(turns - round(turns)) > 1e-6:
        raise UsageError(f"{len(lateness)} periods are {exactly(turns)} ticks: expected a whole number")
    syncs = [place * period + late for place, late in enumerate(lateness)]
    return tuple(
        Instants(ticks.before(sync) - latency - place * period, ticks.after(sync + arrival) - place * period)
        for place, sync in enumerate(syncs)
    )


def schedule_growth(plant: Plant, period: float, pattern: Sequence[Instants], environment: StateSpace) -> float:
    """Return the mean growth of the loop in a period of the pattern; below 1 is stable.

    The environment is that of a contact. Without a restoring force, an eigenvalue is 1, and it counts.
    """
    return float(spectral_radius(_map(plant, period, pattern, environment)) ** (1.0 / len(pattern)))


def schedule_limit(plant: Plant, period: float, pattern: Sequence[Instants], environment_of: EnvironmentOf) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which the loop with this pattern is stable.

    0 and ∞ have the meaning of `linear.limit_of`. Raises UsageError for impossible times [s].
    """
    check_times(period, 0.0)
    return limit_of(
        lambda stiffness: schedule_growth(plant, period, pattern, environment_of(stiffness)),
        plant.mass / period**2 + plant.damping / period,
    )


def _events(period: float, pattern: Sequence[Instants]) -> list[tuple[float, bool]]:
    """Return the events of one turn of the pattern in their order: its instant, shifted into [0, N·T), and a truth.

    True: a force begins to act; False: a position is measured.
    """
    turn = len(pattern) * period
    found = []
    for place, each in enumerate(pattern):
        for instant, acts in ((each.measured, False), (each.acts, True)):
            found.append(((place * period + instant) % turn, acts))
    # A force that acts at the very instant of a measurement does not change it.
    return sorted(found)


def _waiting(period: float, pattern: Sequence[Instants]) -> int:
    """Return the forces that are computed before the beginning of the pattern and act after it."""
    turn = len(pattern) * period
    count = 0
    for place, each in enumerate(pattern):
        begins, ends = place * period + each.measured, place * period + each.acts
        # Forces of the turns before and of this one that are measured before 0 and act from 0 on.
        count += math.floor(ends / turn) - math.floor(begins / turn)
    return count


def _map(plant: Plant, period: float, pattern: Sequence[Instants], environment: StateSpace) -> Matrix:
    """Return the map of one turn on (device, environment, acting force, waiting forces, the oldest first)."""
    a, b = through_torque_loop(*dynamics(plant), plant.torque_lag)
    order, inner = len(a), environment.order
    # Each row is one state now, as it follows from the states at the beginning of the turn.
    rows = np.eye(order + inner + 1 + _waiting(period, pattern))
    device, memory, (force, *queue) = rows[:order], rows[order : order + inner], rows[order + inner :]
    now, turn = 0.0, len(pattern) * period
    for at, acts in _events(period, pattern):
        device, now = _moved(a, b, at - now, device, force), at
        if acts:
            force = queue.pop(0)
        else:
            queue.append(environment.c[0] @ memory + environment.d[0, 0] * device[0])
            memory = environment.a @ memory + np.outer(environment.b[:, 0], device[0])
    return np.vstack([_moved(a, b, turn - now, device, force), memory, force, *queue])


def _moved(a: Matrix, b: Matrix, span: float, device: Matrix, force: Matrix) -> Matrix:
    """Return the rows of the device after `span` [s] under a force."""
    transition, gain = zoh(a, b, span)
    return np.asarray(transition @ device + np.outer(gain[:, 0], force))
