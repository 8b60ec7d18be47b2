"""The watch on the sign while a scene runs: a mass moved by random torques, and what a doubt does."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.plausibility import sign_watch
from haptic_fieldbus.cycle.safety import Permission, Trip, TripKind
from haptic_fieldbus.cycle.sign import Sign
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim import faults
from tests.builders import endless_rig, plan_of, scene_of

PERIOD = 1e-3
AXIS = plan_of().axes[0]
assert AXIS.plant is not None
MASS = AXIS.plant.mass
RATED = 0.4 * 2.0 * math.pi / 0.05
"""[N]"""
TORQUES = np.repeat(np.random.default_rng(1).choice([-20.0, 20.0], 100), 20)
"""[N], of which each lasts for 20 periods."""


class Owner:
    """Of a motor direction: it does nothing, or what it is made with."""

    def __init__(self, seen: Callable[[], None] = lambda: None, doubted: Callable[[], None] = lambda: None) -> None:
        self.sign_seen, self.sign_doubted = seen, doubted


class Handle:
    """A mass that follows what is sent, or goes against it, and is read in counts."""

    def __init__(self, sign: float) -> None:
        self.state = AxisState(permitted_ns=0)
        self._sign, self._position, self._velocity = sign, 0.0, 0.0

    def move(self, force: float) -> None:
        """Go through a period with this force [N]."""
        acceleration = self._sign * force / MASS
        self._position += self._velocity * PERIOD + 0.5 * acceleration * PERIOD**2
        self._velocity += acceleration * PERIOD
        self.state.position = round(self._position / AXIS.resolution) * AXIS.resolution


def doubts(sign: float, *, gaps: bool = False) -> list[int]:
    """Periods in which the sign of the handle was doubted."""
    handle, found, now = Handle(sign), list[int](), 0

    def render() -> None:
        handle.state.target = round(TORQUES[now] / AXIS.effort_unit)

    watch = sign_watch(AXIS, handle.state, PERIOD, lambda: found.append(now))
    assert watch is not None
    step = watch.bind(render)
    for now in range(len(TORQUES)):
        handle.state.steps = 2 if gaps and now % 10 == 0 else 1
        step()
        handle.move(handle.state.target * AXIS.effort_unit)
    return found


def test_a_right_sign_is_never_doubted_and_a_wrong_one_within_a_tenth_of_a_second() -> None:
    assert doubts(1.0) == []
    assert doubts(-1.0)[0] < 100


def test_where_feedback_is_missing_all_the_time_nothing_is_concluded() -> None:
    assert doubts(-1.0, gaps=True) == []


def test_of_an_unknown_bench_nothing_is_seen() -> None:
    axis = replace(AXIS, plant=None)
    assert sign_watch(axis, AxisState(), PERIOD, lambda: None) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_doubt_permits_little_until_pulses_have_decided(sign: float) -> None:
    handle, permission, trips, seen = Handle(sign), Permission(fade=1.0, unchanged=True), list[TripKind](), list[bool]()

    def trip(kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        trips.append(kind)

    owner = Owner(lambda: seen.append(True), lambda: subject.hold())
    subject = Sign(AXIS, PERIOD, handle.state, permission, trip, owner)
    subject.doubt()
    assert (subject.doubts, handle.state.permitted_ns, permission.unchanged) == (1, None, False)
    given = []
    assert subject.proof is not None
    while not (trips or seen):
        given.append(subject.proof.give(30.0))
        handle.move(given[-1])
    assert max(map(abs, given)) <= AXIS.limits.holding
    assert len(given) < 300
    assert (trips, seen) == (([], [True]) if sign > 0.0 else ([TripKind.SIGN], []))
    subject.permit(7, deep=False)
    assert permission.cap == pytest.approx(0.05 * RATED)
    assert (permission.proof, handle.state.permitted_ns) == (None, 7)
    assert permission.fade == pytest.approx(AXIS.limits.holding / AXIS.limits.effort)
    permission.fade = 0.8
    subject.permit(9, deep=False)
    assert (permission.fade, handle.state.permitted_ns) == (0.8, 7), "it was permitted before"


def test_the_cap_of_a_gap_that_is_smaller_stays_when_a_doubt_is_over() -> None:
    permission = Permission(fade=1.0, cap=1.0)
    subject = Sign(AXIS, PERIOD, AxisState(), permission, lambda *_: None, Owner())
    subject.hold()
    subject.permit(7, deep=False)
    assert permission.cap == 1.0


def test_the_first_time_that_a_sign_is_seen_leaves_no_cap() -> None:
    """Else a constant force, which never leaves contact, would never be more than a hand may hold."""
    permission = Permission()
    subject = Sign(AXIS, PERIOD, AxisState(), permission, lambda *_: None, Owner())
    subject.hold()
    subject.permit(7, deep=False)
    assert permission.cap == math.inf
    assert permission.fade == pytest.approx(0.05)


def test_a_handle_that_a_hand_pushed_deep_during_the_first_proof_is_not_thrown_out() -> None:
    """A wall that pushes with the force of a start or less stays; a deeper one is capped until contact is left."""
    plan = plan_of(scene_of(Wall("wall", stiffness=600.0)))
    for share, capped in ((0.99, False), (1.01, True)):
        cycle = Cycle(replace(plan, axes=tuple(replace(axis, sign_known=False) for axis in plan.axes)))
        (axis,) = cycle.axes.values()
        assert axis.sign.proof is not None
        axis.sign.hold()
        axis.sign.proof.seen, axis.state.force = True, -share * axis.largest_step
        cycle.sign_seen()
        assert axis.permission.cap == (pytest.approx(axis.axis.limits.before_sign) if capped else math.inf)


def test_forces_of_two_axes_wait_until_both_signs_are_seen() -> None:
    plan = plan_of(scene_of(Coupling(("left", "right"), 400.0)))
    cycle = Cycle(replace(plan, axes=tuple(replace(axis, sign_known=False) for axis in plan.axes)))
    cycle.sign_seen()
    assert [cycle.axes[name].state.permitted_ns for name in ("left", "right")] == [None, None]
    assert [cycle.axes[name].sign.unseen for name in ("left", "right")] == [0, 0]
    assert [cycle.axes[name].sign.broken_off for name in ("left", "right")] == [0, 0]


def test_the_first_reason_of_a_trip_stays_when_energy_is_given_too() -> None:
    cycle = Cycle(plan_of())
    cycle.trip = Trip(TripKind.SPEED, "handle", 1, 3.0, 2.0)
    cycle.ledgers[0]._trip(0.1, 0.005)
    assert cycle.trip.kind is TripKind.SPEED


def test_what_a_doubt_did_is_told() -> None:
    blow = faults.HandHit("hand_hit", 0.6, 60.0, 0.05)
    (told,) = [
        warning
        for warning in run("wall", endless_rig("wall"), duration=1.6, faults=[blow]).warnings
        if "against" in warning
    ]
    assert "the handle moved against the torque 1 times, as after a blow; the force was then limited to 2.51 N" in told


@pytest.mark.parametrize(("block", "watched"), [(0.009, True), (0.0101, False)])
def test_an_encoder_is_too_coarse_from_the_block_on_in_which_three_counts_are_5_percent_of_rated(
    block: float, watched: bool
) -> None:
    """3 m r / T² = 0.05 F, and the longest block T is 10 ms."""
    assert AXIS.plant is not None
    coarse = replace(AXIS, plant=replace(AXIS.plant, resolution=0.05 * RATED * block**2 / (3.0 * MASS)))
    assert (sign_watch(coarse, AxisState(permitted_ns=0), PERIOD, lambda: None) is not None) is watched
