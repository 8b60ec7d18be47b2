"""The proof of the sign, on systems that scipy moves: right signs are never contradicted, wrong ones never seen."""

import math
from dataclasses import replace
from itertools import groupby, pairwise
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray

from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.cycle.sign import SignProof, thue_morse
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.sign_probe import ATTEMPTS, PAUSE, SignProbe, sign_probe
from tests.builders import plan_of

PERIOD = 1e-3
RATED = 0.4 * 2.0 * math.pi / 0.05
"""[N] of the shipped bench."""


def unseen(plan: Plan, **changes: object) -> tuple[AxisPlan, SignProbe]:
    """An axis whose sign is not known, and its probe with these changes."""
    axis = replace(plan.axes[0], sign_known=False)
    probe = sign_probe(axis, plan.period)
    assert probe is not None
    return axis, replace(probe, **changes)  # type: ignore[arg-type]


class Watched:
    """A proof that is given positions."""

    def __init__(self, *, again: bool = False, **changes: object) -> None:
        axis, self.probe = unseen(plan_of(), **changes)
        self.state, self.trips, self.seen = AxisState(), list[TripKind](), 0
        self.told = list[tuple[float, float]]()
        self.proof = SignProof(axis, self.probe, self.state, self._trip, self, again=again)

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        self.trips.append(kind)
        self.told.append((value, limit or 0.0))

    def sign_seen(self) -> None:
        """Count the proofs, as their owner."""
        self.seen += 1

    def sign_doubted(self) -> None:
        """Do nothing: the proof alone never doubts."""

    def give(self, position: float, force: float = 0.0, steps: int = 1) -> float:
        """The force of a period; positions are those of the encoder."""
        self.state.steps = steps
        self.state.position = round(position / self.probe.step) * self.probe.step
        return self.proof.give(force)

    @property
    def decided(self) -> int:
        """1: seen, −1: contradicted, 0: neither."""
        return self.seen - self.trips.count(TripKind.SIGN)


def held(mass: float, damping: float, hand: float, stiffness: float, grip: float) -> NDArray[np.float64]:
    """The motion over a period of a mass held by another one through a spring and a damper; the force comes last."""
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-stiffness / mass, -(damping + grip) / mass, stiffness / mass, grip / mass, 1.0 / mass],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [stiffness / hand, grip / hand, -stiffness / hand, -grip / hand, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    moved: NDArray[np.float64] = scipy.linalg.expm(a * PERIOD)
    return moved


def decided_on(motion: NDArray[np.float64], sign: float, seconds: float = 3.0) -> int:
    return watched_on(motion, sign, seconds).decided


def watched_on(motion: NDArray[np.float64], sign: float, seconds: float, **changes: Any) -> Watched:
    watched, state, late = Watched(**changes), np.zeros(5), 0.0
    for _ in range(round(seconds / PERIOD)):
        force = watched.give(float(state[0]))
        if watched.decided:
            break
        state[4], late = sign * late, force  # what is sent now acts in the next period, at the latest
        state = motion @ state
    return watched


@pytest.mark.thorough("draws 300 benches and hands", quick=5)
@pytest.mark.parametrize("seed", range(300))
def test_whatever_is_passive_never_shows_the_wrong_sign(seed: int) -> None:
    draw = np.random.default_rng(seed)
    values = [float(10.0 ** draw.uniform(*range_)) for range_ in ((-2, 1), (-2, 1.5), (-2, 3), (0, 4.5), (-1, 2))]
    motion = held(*values)
    right, wrong = decided_on(motion, 1.0), decided_on(motion, -1.0)
    assert right >= 0
    assert wrong <= 0


@pytest.mark.parametrize("mass", [0.1, 0.63])
def test_a_trip_tells_how_far_its_pulses_moved_a_free_mass(mass: float) -> None:
    """½·a·t², against the torque; the second difference takes away what the handle did before."""
    watched = watched_on(held(mass, 0.0, 1e3, 0.0, 0.0), -1.0, 3.0, step=1e-10)
    ((moved, force),) = watched.told
    (stage,) = [stage for stage in watched.probe.stages if stage.effort == force]
    assert moved == pytest.approx(-0.5 * force / mass * (stage.periods * PERIOD) ** 2, rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_shipped_bench_decides_within_a_tenth_of_a_second(sign: float) -> None:
    assert decided_on(held(0.63, 1.6, 1e3, 300.0, 4.0), sign, seconds=0.1) == sign


@pytest.mark.parametrize("power", [0, 1, 2, 3])
@pytest.mark.parametrize("size", [1e-3, -0.03, 1.0])
def test_a_hand_that_leads_the_handle_evenly_decides_nothing(power: int, size: float) -> None:
    """At a constant speed, acceleration or jerk: size·tⁿ [m], whatever the torque."""
    watched = Watched()
    for period in range(900):
        watched.give(size * (period * PERIOD) ** power)
    assert watched.decided == 0


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0, 10.0])
@pytest.mark.parametrize("amplitude", [0.001, 0.03])
def test_a_hand_that_goes_to_and_fro_rigidly_decides_nothing(frequency: float, amplitude: float) -> None:
    for phase in np.linspace(0.0, 2.0 * np.pi, 7):
        watched = Watched()
        for period in range(900):
            watched.give(amplitude * float(np.sin(2.0 * np.pi * frequency * period * PERIOD + phase)))
        assert watched.decided == 0


def test_a_handle_at_rest_between_two_counts_decides_nothing() -> None:
    """An encoder that flickers by a count at random."""
    draw = np.random.default_rng(5)
    watched = Watched()
    for _ in range(5000):
        watched.give(watched.probe.step * float(draw.integers(0, 2)))
    assert watched.decided == 0


def test_while_nothing_is_seen_the_scene_goes_on_within_what_a_hand_may_hold() -> None:
    watched = Watched()
    given = [watched.give(0.0, force=20.0) for _ in range(5000)]
    assert max(map(abs, given)) == watched.probe.largest
    held = [sum(1 for _ in run) for force, run in groupby(given) if force == watched.probe.holding]
    pauses = [periods for periods in held if periods > 5]  # and no pulses
    assert len(pauses) >= 3
    assert all(abs(pause - PAUSE / PERIOD) <= 1.0 for pause in pauses)
    assert watched.proof.failures >= 3


def test_a_handle_that_nothing_moves_is_refused_after_three_attempts() -> None:
    watched = Watched()
    while not watched.trips:
        watched.give(0.0)
    assert (watched.trips, watched.proof.failures) == ([TripKind.SIGN_HIDDEN], ATTEMPTS)


def test_a_handle_that_is_held_when_a_doubt_comes_stays_limited() -> None:
    """Its sign was seen at the start; a hand that leans hard is no reason to end the run."""
    watched = Watched(again=True)
    given = [watched.give(0.0, force=20.0) for _ in range(9000)]
    assert watched.trips == []
    assert max(map(abs, given)) <= watched.probe.largest
    assert watched.proof.failures > ATTEMPTS


def test_pulses_grow_step_by_step_while_nothing_moves_and_never_beyond_the_bound() -> None:
    watched = Watched()
    given = [abs(watched.give(0.0)) for _ in range(3000)]
    torques = list(dict.fromkeys(torque for torque in given if torque))
    assert torques == sorted(torques)
    assert torques[0] <= 0.05 * 2.0 / 3.0 * RATED * 1.01
    assert max(after / before for before, after in pairwise(torques)) <= 1.55, "to a whole step of the drive"
    assert torques[-1] == watched.probe.largest


def test_pulses_grow_no_further_once_something_moved() -> None:
    """A free mass that breaks loose at the second torque and is caught after a pair, so the stage does not agree."""
    watched, given, place, speed = Watched(), list[float](), 0.0, 0.0
    second, caught = watched.probe.stages[1].effort, False
    while not watched.proof.failures:
        force = watched.give(place)
        given.append(abs(force))
        caught = caught or (len(watched.proof._shown) == 2 and watched.proof._stage.effort == second)
        speed = 0.0 if caught or max(given) < second else speed + force / 0.63 * PERIOD
        place += speed * PERIOD
    assert caught
    assert max(given) == second
    while not watched.trips:
        given.append(abs(watched.give(place)))
    assert max(given) == watched.probe.largest, "what nothing moves any more is tried with more in the next attempt"


def decided_with_gaps(sign: float, every: int, steps: int) -> tuple[int, int]:
    """Decision about the shipped bench, and after how many periods; gaps of `steps` come every so often."""
    motion, state, late = held(0.63, 1.6, 1e3, 300.0, 4.0), np.zeros(5), 0.0
    watched = Watched()
    for period in range(1000):
        gap = period % every == every - 1
        for _ in range(steps - 1 if gap else 0):
            state = motion @ state
        force = watched.give(float(state[0]), steps=steps if gap else 1)
        if watched.decided:
            break
        state[4], late = sign * late, force
        state = motion @ state
    return watched.decided, period


@pytest.mark.thorough("18 cases of one rule", quick=9)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("steps", [2, 5, 10])
@pytest.mark.parametrize("every", [50, 70, 100])
def test_gaps_that_come_sooner_than_a_stage_is_long_spoil_a_pair_and_no_more(
    sign: float, steps: int, every: int
) -> None:
    """A pair takes 30 ms and the handle 15 ms to come to rest, so between two gaps is one whole pair at least."""
    decided, period = decided_with_gaps(sign, every, steps)
    assert decided == sign
    assert period <= 4 * every


def test_a_gap_in_every_pair_leaves_the_sign_unseen() -> None:
    assert decided_with_gaps(1.0, 40, 2) == (0, 999)


@pytest.mark.thorough("6 cases of one rule", quick=3)
@pytest.mark.parametrize(("frequency", "power"), [(0.0, 1), (0.0, 2), (0.0, 3), (2.0, 0), (5.0, 0), (10.0, 0)])
def test_a_hand_that_leads_the_handle_decides_nothing_with_gaps_either(frequency: float, power: int) -> None:
    """Evenly or to and fro [Hz], at gaps that leave one to three pairs between them."""
    for seed in range(7):
        draw, watched = np.random.default_rng(seed), Watched()
        period = left = 0
        while period < 900:
            steps = 1 if left else int(draw.integers(2, 11))
            left = left - 1 if left else int(draw.integers(46, 110))
            period += steps
            time = period * PERIOD
            swing = 0.03 * float(np.sin(2.0 * np.pi * frequency * time + seed)) if frequency else -0.03 * time**power
            watched.give(swing, steps=steps)
        assert watched.decided == 0
        assert watched.proof.broken_off > 5


def test_the_signs_of_the_pulses_cancel_what_grows_evenly() -> None:
    """Their first four sum to zero, and so do their first four times their number (Prouhet, 1851)."""
    signs = [thue_morse(number) for number in range(8)]
    assert sum(signs[:4]) == sum(sign * number for number, sign in enumerate(signs[:4])) == 0.0
    assert sum(sign * number**2 for number, sign in enumerate(signs)) == 0.0
    assert sum(signs[:6]) == 0.0, "so that the handle comes back"


@pytest.mark.parametrize(("speed", "refused"), [(0.0, True), (1e-5, True), (0.005, False), (-0.2, False)])
def test_a_handle_that_a_hand_moves_is_never_refused_as_one_that_nothing_moves(speed: float, refused: bool) -> None:
    """Evenly [m/s], so that no pulse shows; at 10 µm/s it goes less than a count within an attempt."""
    watched = Watched()
    for period in range(9000):
        watched.give(speed * period * PERIOD)
    assert watched.proof.failures > ATTEMPTS
    assert (TripKind.SIGN_HIDDEN in watched.trips) is refused
