"""Two axes that a coupling ties: what one of them misses, both must bear."""

import random
import struct
from dataclasses import dataclass, replace

import pytest

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import PairLaw
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import plan_of, scene_of
from tests.cycle.test_cycle import COUNT, ENABLED, UNIT

PERIOD_NS, FADED_IN, FADING = 1_000_000, 600, 10
TURNED = 400
"""Encoder counts by which the left handle is turned against the right one."""


FAR = 1200
"""Encoder counts at which the shaft asks for twice as much as a hand may hold."""
HOLDING = 50
"""Target torque that a hand may hold: 5 % of the rated one."""
PULSES = 99
"""Target torque of the pulses that look for the sign: 5 N."""
SLEWING = 5
"""Periods in which a target torque falls from the rated one to zero."""


class Shaft:
    """A spring between two handles in a running cycle; of the axes in `unseen` the sign is not known."""

    def __init__(self, *unseen: str) -> None:
        plan = plan_of(scene_of(Coupling(("left", "right"), 400.0)))
        axes = tuple(replace(axis, sign_known=axis.name not in unseen) for axis in plan.axes)
        self.cycle = Cycle(replace(plan, axes=axes))
        self.t_ns = 0
        for period in range(FADED_IN):
            self.torques(min(TURNED, 2 * period))

    def torques(self, counts: int, *, lost: bool = False, right: int = 0, lost_left: bool = False) -> tuple[int, int]:
        """Target torques of a period; `lost`: without feedback of the right axis."""
        self.t_ns += PERIOD_NS
        flags = [LinkFlag.STALE if each else 0 for each in (lost_left, lost)]
        axes = (0, flags[0], 0, 0, flags[1], 0, ENABLED, counts, 0, ENABLED, right, 0)
        _, left, _, other = struct.unpack("<HhHh", self.cycle(struct.pack("<qIHHIHHHihHih", self.t_ns, *axes)))
        return left, other


def test_axes_that_miss_samples_by_turns_fade_too() -> None:
    """Neither axis misses two samples in a row, but the force of the spring follows from both positions."""
    shaft = Shaft()
    before, _ = shaft.torques(TURNED)
    for missing in range(1, 2 * FADING):
        left, right = shaft.torques(TURNED, lost=missing % 2 == 0, lost_left=missing % 2 == 1)
        assert left == pytest.approx(before * max(0.0, 1.0 - (missing - 1) / FADING), abs=1)
        assert right == -left
    assert left == 0
    assert shaft.cycle.trip is None


@pytest.mark.parametrize("stale_periods", [2, 5, 30])
def test_axes_that_a_coupling_ties_fade_together(stale_periods: int) -> None:
    shaft = Shaft()
    before, _ = shaft.torques(TURNED)
    assert abs(before) > 20
    for missing in range(1, stale_periods + 1):
        left, right = shaft.torques(TURNED, lost=True)
        share = max(0.0, 1.0 - (missing - 1) / FADING)
        assert left == pytest.approx(before * share, abs=1)
        assert right == -left
    assert shaft.cycle.trip is None


def test_back_after_a_gap_neither_is_pushed_harder_than_before_it() -> None:
    shaft = Shaft()
    before, _ = shaft.torques(TURNED)
    for _ in range(20):
        shaft.torques(TURNED, lost=True)
    for more in range(100):
        left, right = shaft.torques(TURNED + 2 * more)
        assert abs(left) <= abs(before)
        assert abs(right) <= abs(before)


def test_after_a_short_gap_both_go_on_from_the_same_force() -> None:
    """With the handles further apart both forces grow as they do without a gap, but from those before it."""
    shaft, whole = Shaft(), Shaft()
    before, _ = shaft.torques(TURNED)
    for _ in range(3):
        shaft.torques(TURNED, lost=True)
    assert shaft.torques(TURNED + 8) == pytest.approx((before, -before), abs=1)
    seen, _ = whole.torques(TURNED + 8)
    for more in range(100):
        left, right = shaft.torques(TURNED + 8 + 2 * more)
        without, _ = whole.torques(TURNED + 8 + 2 * more)
        assert left == -right
    assert abs(without - seen) > 10
    assert left - before == pytest.approx(without - seen, abs=1)


def turning(seed: int) -> None:
    """Two free handles on the shaft, wound up at first, one of which loses samples: it gives no more than it stored.

    Beside that there are the work of the torque held from the first missing sample until it is that of the shaft again,
    and the leak of a held force, at most its change times the way. Energies are those of positions and torques.
    """
    rng, shaft = random.Random(seed), Shaft()
    wound, mass = TURNED * COUNT, rng.uniform(0.3, 2.0)
    x, v, damping = [wound, 0.0], [rng.uniform(-0.3, 0.3) for _ in range(2)], rng.choice([0.05, 0.5, 1.5])
    given = held = leak = path = 0.0
    before, left, ports = [0.0, 0.0], 0, [shaft.cycle.axes[name].permission for name in ("left", "right")]
    for number in range(800):
        left = left - 1 if left else (rng.choice([2, 3, 5, 14]) if rng.random() < 0.01 else 0)
        torques = shaft.torques(round(x[0] / COUNT), lost=left > 0, right=round(x[1] / COUNT))
        gap = left > 0 or any(port.blind for port in ports)
        if shaft.cycle.trip or any(port.capped for port in ports):
            return
        for axis, torque in enumerate(torques):
            force = UNIT * torque
            v[axis] += (force - damping * v[axis]) / mass * 1e-3
            way = v[axis] * 1e-3
            x[axis] += way
            given, path = given + force * way, path + abs(way)
            held += force * way if gap else 0.0
            leak += abs(force - before[axis]) * abs(way) if number else 0.0
            before[axis] = force
        if not gap:
            assert given - held <= 0.5 * 400.0 * wound**2 + leak + 0.05 * path


@pytest.mark.parametrize("seed", range(3))
def test_no_timing_of_gaps_makes_a_shaft_give_more_than_it_stored(seed: int) -> None:
    turning(seed)


@pytest.mark.thorough("200 timings")
def test_none_of_200_timings_of_gaps_makes_a_shaft_give_more_than_it_stored() -> None:
    for seed in range(200):
        turning(seed)


def test_a_doubt_about_one_limits_the_other_as_well_until_contact_is_left() -> None:
    shaft = Shaft()
    for counts in range(TURNED, FAR, 2):
        before = shaft.torques(counts)
    assert min(map(abs, before)) > 2 * HOLDING
    shaft.cycle.axes["left"].sign.doubt()
    for period in range(200):
        left, right = shaft.torques(FAR)
        assert period < SLEWING or (abs(left) <= PULSES and abs(right) <= HOLDING)
    assert [shaft.cycle.axes[axis].sign.doubts for axis in ("left", "right")] == [1, 0]
    assert [shaft.cycle.axes[axis].sign.unseen is None for axis in ("left", "right")] == [False, True]
    shaft.cycle.axes["left"].sign.proof.seen = True  # type: ignore[union-attr]
    shaft.cycle.sign_seen()
    targets = shaft.torques(FAR)
    assert max(map(abs, targets)) <= HOLDING + 2, "it fades in from there"
    for _ in range(FADED_IN):
        assert shaft.torques(FAR) == pytest.approx((-HOLDING, HOLDING), abs=1), "until contact is left"
    for counts in range(FAR, -FAR, -2):
        left, right = shaft.torques(counts)
        assert left == -right
        assert counts < 0 or abs(left) <= HOLDING
    assert left > 2 * HOLDING, "on the other side it is whole again"


@pytest.mark.parametrize("unseen", ["left", "right"])
def test_an_axis_whose_sign_is_known_waits_for_that_of_the_other(unseen: str) -> None:
    shaft = Shaft(unseen)
    for counts in range(TURNED, FAR, 2):
        for axis, target in zip(("left", "right"), shaft.torques(counts), strict=True):
            assert abs(target) <= (PULSES if axis == unseen else HOLDING)
    assert [shaft.cycle.axes[axis].state.permitted_ns for axis in ("left", "right")] == [None, None]


@dataclass(frozen=True)
class Brake(Coupling):
    """A coupling that needs the speeds alone."""

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.VELOCITY,)

    def begin(self, period: float) -> PairLaw:
        return lambda first, second: (-self.damping * (first - second), self.damping * (first - second))


def test_a_coupling_may_need_the_speeds_alone() -> None:
    cycle = Cycle(plan_of(scene_of(Brake(("left", "right"), 1e-3, damping=2.0))))
    for period in range(FADED_IN):
        axes = (0, 0, 0, 0, 0, 0, ENABLED, period, 0, ENABLED, 0, 0)
        cycle(struct.pack("<qIHHIHHHihHih", (1 + period) * PERIOD_NS, *axes))
    left, right = (cycle.axes[name].sensed for name in ("left", "right"))
    assert left.velocity == pytest.approx(COUNT / 1e-3, rel=1e-6)
    assert left.coupled == -right.coupled == pytest.approx(-2.0 * left.velocity, rel=1e-6)
