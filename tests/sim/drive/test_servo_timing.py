"""Free ticks, latencies and lateness of the simulated drive: its walls against the limits computed with them.

The loop is written out here: a SYNC, the counts of the servo, and the target that it gets for them. The encoder has 2³¹
counts a revolution and there is no friction, so that the loop is linear. A slowly decaying oscillation satisfies
x_{k+2L} = a·x_{k+L} + b·x_k, where −b is its growth over L periods, squared.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import cycle
from random import Random

import numpy as np
import pytest

from haptic_fieldbus.margins import Basis, Group, Member, Plant, Stability, stiffness_limit
from haptic_fieldbus.margins.plant import ASSUMED_BANDWIDTH, DAMPING_SHARES, Ranges, exact_bench
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim.drive.servo import FirmwareTimes, Servo
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant as Motor
from haptic_fieldbus.study.cases.timing import Instants, Ticks, free_ticks, schedule_limit
from tests.loops import Array

T_NS, CONTROL_NS, ARRIVAL_NS = 1_000_000, 400_000, 277_000
INERTIA, DAMPING, LAG = 4e-5, 1e-4, 1 / (2 * math.pi * 1000)
COUNTS = 2**31 - 1
START = 0.3
"""[rad]"""
JITTERS = {
    "on time": (0, 0),
    "every second late": (0, 150_000),
    "five in a row": (0, 40_000, 120_000, 10_000, 90_000, 0, 0, 200_000, 60_000, 30_000),
}


def servo(timing: FirmwareTimes, *, damping: float = DAMPING, lag: float = LAG) -> Servo:
    motor = Motor(Shaft(INERTIA, damping, 0.0, lag), None, position=START)
    return Servo(motor, counts_per_revolution=COUNTS, timing=timing)


def swing(drive: Servo, stiffness: float, lateness_ns: Iterable[int], periods: int, arrival_ns: int) -> Array:
    """Run a spring on the shaft [N·m/rad]; the position that the drive reads in each period [rad]."""
    seen = np.empty(periods)
    for k, late_ns in zip(range(periods), lateness_ns, strict=False):
        sync_ns = (k + 10) * T_NS + late_ns
        drive.sync(sync_ns)
        seen[k] = drive.counts() * 2 * math.pi / COUNTS
        drive.command(-stiffness * seen[k], sync_ns + arrival_ns)
    return seen


def growth(seen: Array, turn: int) -> float:
    """Growth of the motion per period, from samples a whole number of patterns apart."""
    lag = turn * max(1, round(20 / turn))
    late = seen[len(seen) // 3 :][: (len(seen) // 2 // turn) * turn]
    first, second, third = late[: -2 * lag], late[lag:-lag], late[2 * lag :]
    (_, b), *_ = np.linalg.lstsq(np.column_stack([second, first]), third, rcond=None)
    return float(math.sqrt(-b) ** (1 / lag))


def borders(timing: FirmwareTimes, lateness_ns: Sequence[int], arrival_ns: int, limit: float) -> tuple[float, float]:
    """Growth of the simulated loop 1e-4 below and above a limit."""
    found = [
        growth(swing(servo(timing), part * limit, cycle(lateness_ns), 3000, arrival_ns), len(lateness_ns))
        for part in (1 - 1e-4, 1 + 1e-4)
    ]
    return found[0], found[1]


PLANT = Plant(INERTIA, DAMPING, torque_lag=LAG)


def spring(stiffness: float) -> StateSpace:
    return gain([[-stiffness]])


@pytest.mark.thorough("runs long loops", quick=1)
@pytest.mark.parametrize("jitter", JITTERS.values(), ids=JITTERS)
@pytest.mark.parametrize("phase", [0.1, 0.45, 0.8])
@pytest.mark.parametrize("latency_ns", [0, 70_000])
def test_walls_with_free_ticks_grow_above_the_limit_computed_with_them(
    jitter: Sequence[int], phase: float, latency_ns: int
) -> None:
    timing = FirmwareTimes(CONTROL_NS, free=True, phase=phase, latency_ns=latency_ns)
    ticks = Ticks(CONTROL_NS * 1e-9, phase * CONTROL_NS * 1e-9)
    late = [each * 1e-9 for each in jitter]
    pattern = free_ticks(ticks, T_NS * 1e-9, ARRIVAL_NS * 1e-9, late, latency_ns * 1e-9)
    below, above = borders(timing, jitter, ARRIVAL_NS, schedule_limit(PLANT, T_NS * 1e-9, pattern, spring))
    assert below < 1.0 < above


@pytest.mark.thorough("runs long loops", quick=1)
@pytest.mark.parametrize("latency_ns", [0, 70_000, 430_000])
@pytest.mark.parametrize("adapter_ns", [0, 100_000])
def test_walls_with_locked_ticks_and_latencies_grow_above_the_limit_of_their_delay(
    latency_ns: int, adapter_ns: int
) -> None:
    arrival_ns = ARRIVAL_NS + 2 * adapter_ns
    acts_ns = -(-arrival_ns // CONTROL_NS) * CONTROL_NS
    limit = stiffness_limit(PLANT, T_NS * 1e-9, (acts_ns + latency_ns) * 1e-9, spring)
    exchange = Instants(-latency_ns * 1e-9, acts_ns * 1e-9)
    assert schedule_limit(PLANT, T_NS * 1e-9, [exchange], spring) == pytest.approx(limit, rel=1e-8)
    below, above = borders(FirmwareTimes(CONTROL_NS, latency_ns=latency_ns), (0,), arrival_ns, limit)
    assert below < 1.0 < above


@pytest.mark.thorough("runs a minute of four loops")
@pytest.mark.parametrize("seed", range(4))
def test_random_jitter_and_a_drifting_tick_do_not_grow_in_a_minute_below_the_limit_at_the_longest_delay(
    seed: int,
) -> None:
    """On the worst bench of the ranges: the least damping, the slowest torque loop."""
    random, most_ns = Random(f"jitter {seed}"), 200_000
    damping, lag = DAMPING_SHARES[0] * DAMPING, LAG / ASSUMED_BANDWIDTH[0]
    longest = (ARRIVAL_NS + most_ns + 2 * CONTROL_NS) * 1e-9
    longest_limit = stiffness_limit(Plant(INERTIA, damping, torque_lag=lag), T_NS * 1e-9, longest, spring)
    timing = FirmwareTimes(CONTROL_NS, free=True, phase=random.random(), drift=random.uniform(-5e-5, 5e-5))
    late = iter(lambda: random.randrange(most_ns + 1), None)
    seen = np.abs(swing(servo(timing, damping=damping, lag=lag), 0.999 * longest_limit, late, 60_000, ARRIVAL_NS))
    assert seen[-10_000:].max() < seen[10_000:20_000].max() < START


def test_a_free_tick_takes_targets_and_positions_at_its_own_instants() -> None:
    drive = servo(FirmwareTimes(CONTROL_NS, free=True, phase=0.25))
    drive.sync(1_000_000)
    assert drive.tick(1_000_000) == 1_300_000
    assert drive.tick(1_300_000) == 1_300_000
    locked = servo(FirmwareTimes(CONTROL_NS))
    locked.sync(1_000_000)
    assert locked.tick(1_000_001) == 1_400_000


@pytest.mark.parametrize(("free", "acts_ns", "read_ns"), [(False, 0, 1_930_000), (True, 100_000, 1_630_000)])
def test_a_position_is_as_old_as_the_encoder_and_the_tick_make_it(free: bool, acts_ns: int, read_ns: int) -> None:
    drive = servo(FirmwareTimes(CONTROL_NS, free=free, phase=0.25, latency_ns=70_000))
    drive.command(1e-2, 0)
    drive.sync(2_000_000)
    at_once = servo(FirmwareTimes(0))
    at_once.command(1e-2, acts_ns)
    at_once.advance(read_ns)
    assert drive.counts() == pytest.approx(at_once.counts(), abs=2)


class OpenBench:
    """A bench with a limit, and one draw of all values that it leaves open."""

    def __init__(self, seed: int) -> None:
        random = Random(f"open {seed}")
        lag = 1 / (2 * math.pi * 10 ** random.uniform(2.5, 3.5))
        plant = Plant(10 ** random.uniform(-5.0, -4.2), 10 ** random.uniform(-4.0, -3.3), torque_lag=lag)
        control_ns, self.arrival_ns = random.choice((200_000, 400_000, 1_000_000)), random.randrange(100_000, 500_000)
        most_ns = random.choice((0, 100_000, 300_000))
        self.plant, self.delay = plant, self.arrival_ns * 1e-9
        lags, delays = (lag / 2.0, lag / 0.3), (self.delay, self.delay + (most_ns + 2 * control_ns) * 1e-9)
        exact = exact_bench(lags, delays, Basis.SIMULATED)
        self.ranges = random.choice((exact, Ranges(lags, delays)))
        self.virtual = random.choice((0.0, 0.0, 0.2 * plant.damping))

        def within(ends: tuple[float, float]) -> float:
            """An end of the range every second time."""
            return random.choice((*ends, random.uniform(*ends), random.uniform(*ends)))

        inertia, damping = plant.mass * within(self.ranges.mass), plant.damping * within(self.ranges.damping)
        free, latency_ns = random.random() < 0.5, round(within((0.0, float(control_ns))))
        # A drive with free ticks reads its position at them, which is a latency of up to a control period.
        timing = FirmwareTimes(control_ns, free=free, phase=random.random(), latency_ns=0 if free else latency_ns)
        motor = Motor(Shaft(inertia, damping, 0.0, within(self.ranges.torque_lag)), None, position=START)
        self.servo = Servo(motor, counts_per_revolution=COUNTS, timing=timing)
        self.lateness = iter(lambda: round(within((0.0, float(most_ns)))), None)

    def judged(self, stiffness: float) -> Stability:
        elements = (Wall("a", stiffness, damping=self.virtual),)
        member = Member("a", self.plant, self.delay, elements, None, "backward-difference", ranges=self.ranges)
        return Group((member,), (), T_NS * 1e-9).stability

    def peaks(self, stiffness: float) -> tuple[float, float]:
        """The largest swing in the second and in the third turn of the simulated shaft on its spring [rad]."""
        turn = math.ceil(2 * math.pi * math.sqrt(1.25 * self.plant.mass / stiffness) / (T_NS * 1e-9)) + 20
        seen = np.empty(3 * turn)
        before = START
        for k, late_ns in zip(range(len(seen)), self.lateness, strict=False):
            sync_ns = (k + 10) * T_NS + late_ns
            self.servo.sync(sync_ns)
            seen[k] = self.servo.counts() * 2 * math.pi / COUNTS
            speed, before = (seen[k] - before) / (T_NS * 1e-9), seen[k]
            self.servo.command(-stiffness * seen[k] - self.virtual * speed, sync_ns + self.arrival_ns)
        return float(np.abs(seen[turn : 2 * turn]).max()), float(np.abs(seen[2 * turn :]).max())


@pytest.mark.thorough("simulates 2000 loops", quick=1)
@pytest.mark.parametrize("batch", range(200))
def test_inside_its_limit_a_loop_is_stable_for_every_draw_of_the_open_values(batch: int) -> None:
    """The simulated drive takes the place of the formulas: mass, friction, lag, ticks, latency and lateness drawn."""
    for seed in range(10 * batch, 10 * (batch + 1)):
        bench = OpenBench(seed)
        limit = bench.judged(1.0).limit.value
        assert bench.judged(limit).is_inside, seed
        assert not bench.judged(1.1 * limit).is_inside, seed
        second, third = bench.peaks(limit)
        assert third <= second * (1.0 + 1e-6), seed
