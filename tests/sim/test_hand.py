"""The hands: forces over time, and what the motor shaft feels of them."""

import math

import numpy as np
import pytest

from haptic_fieldbus.drive.rig import Cogging, LinearMechanism, Mechanics, RotaryMechanism
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import HANDS, LEADER, Hand, grip, hand_named
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.loaded_plant import Load, LoadedPlant
from haptic_fieldbus.sim.mechanics.motion import FORCE, Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

LINEAR = LinearMechanism("linear", metres_per_revolution=0.05)
RATIO = 0.05 / (2 * math.pi)


def _force(name: str, times: Matrix) -> Matrix:
    """Force on the hand's mass [N] at these times after enabling [s], read back through a linear mechanism."""
    hand = HANDS[name]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(hand, LINEAR))
    plant.advance(100_000_000)
    plant.start_hand()
    plant.advance(100_000_000 + round(times.max() * 1e9))
    trajectory = Trajectory(plant.recorder, plant.t_ns)
    return trajectory.states(100_000_000 + np.round(times * 1e9).astype(np.int64))[:, FORCE] / RATIO


def _expected(name: str, t: float) -> float:
    if name == "push":
        return min(12 * t, 6.0)
    if name == "release":
        return min(12 * t, 6.0) if t < 2 else 0.0
    if name == "guide":
        return 1000.0 * 0.03 * (0.5 * math.pi) ** 2 * math.cos(0.5 * math.pi * t)
    if name == "shake":
        return 1000.0 * 0.03 * (2.0 * math.pi) ** 2 * math.cos(2.0 * math.pi * t)
    if name == "sine":
        return 4 * math.sin(2 * math.pi * t)
    return 10.0 if any(start <= t < start + 0.05 for start in (0.5, 1.5, 2.5)) else 0.0


@pytest.mark.parametrize("name", [name for name, hand in HANDS.items() if hand is not None])
def test_the_force_of_each_hand_is_the_one_that_its_name_promises(name: str) -> None:
    times = np.array([0.0, 0.1, 0.25, 0.499, 0.52, 0.549, 0.551, 1.0, 1.51, 1.999, 2.001, 2.53, 3.3])
    assert _force(name, times) == pytest.approx([_expected(name, t) for t in times], abs=1e-9)


def test_a_guiding_hand_leads_the_handle_over_its_stroke_and_back_whatever_it_meets() -> None:
    """x = 30 mm·(1 − cos ωt), period 4 s; at the end of the stroke friction holds the handle back by at most fc/k."""
    hand = HANDS["guide"]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(hand, LINEAR))
    plant.start_hand()
    for t in (0.5, 1.0, 2.0, 3.0, 4.0):
        plant.advance(round(t * 1e9))
        assert plant.position * RATIO == pytest.approx(0.03 * (1.0 - math.cos(0.5 * math.pi * t)), abs=2e-3)


def test_before_the_drive_is_enabled_a_hand_exerts_no_force() -> None:
    hand = HANDS["push"]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 0.0, 1e-4), grip(hand, LINEAR))
    plant.advance(1_000_000_000)
    assert plant.position == 0.0


def test_a_pushing_hand_presses_its_force_into_a_held_handle() -> None:
    """Six newtons at rest against friction and motor: δ = F/k."""
    hand = HANDS["push"]
    assert hand is not None
    plant = Plant(Shaft(4e-5, 1e-4, 1.0, 1e-4), grip(hand, LINEAR))
    plant.start_hand()
    plant.advance(5_000_000_000)
    stretch = plant.state[3] * RATIO
    assert stretch == pytest.approx(6.0 / 300.0, rel=1e-6)


def test_a_grip_transforms_forces_by_the_ratio_and_impedances_by_its_square() -> None:
    felt = grip(Hand("test"), LINEAR)
    assert (felt.inertia, felt.damping, felt.stiffness) == pytest.approx((0.1 * RATIO**2, 4 * RATIO**2, 300 * RATIO**2))


def test_on_a_rotary_mechanism_a_newton_is_a_twentieth_of_a_newton_metre() -> None:
    push = HANDS["push"]
    assert push is not None
    felt = grip(push, RotaryMechanism("rotary", gear_ratio=2.0))
    assert felt.pieces[1].force == pytest.approx(6 * 0.05 / 2)
    assert felt.stiffness == pytest.approx(300 * (0.05 / 2) ** 2)


@pytest.mark.parametrize("sign", [1, -1])
def test_force_is_positive_towards_positive_positions_of_the_workspace(sign: int) -> None:
    push = HANDS["push"]
    assert push is not None
    mechanism = LinearMechanism("linear", metres_per_revolution=0.05, sign=sign)  # type: ignore[arg-type]
    plant = Plant(Shaft(4e-5, 1e-4, 0.0, 1e-4), grip(push, mechanism))
    plant.start_hand()
    plant.advance(100_000_000)
    assert plant.position * sign > 0


def test_a_hand_may_wait_before_it_begins() -> None:
    release = HANDS["release"]
    assert release is not None
    later = release.after(0.25)
    assert [piece.start for piece in later.pieces] == [0.25, 0.75]
    assert later.release == 2.25
    push = HANDS["push"]
    assert push is not None
    assert push.after(1.0).release is None


class TestLeader:
    """The hand that moves the handle of a drive that is off: 2 s of rest, 60 mm in 2 s, 2 s of rest, and back."""

    @pytest.fixture(params=["rigid", "cogging"])
    def plant(self, request: pytest.FixtureRequest) -> Body:
        shaft, push = Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(_push(), LINEAR)
        if request.param == "rigid":
            return Plant(shaft, push)
        load = Load(shaft, Mechanics(cogging=Cogging(torque=1e-4, periods_per_revolution=6)), None)
        return LoadedPlant(load, push)

    def lead(self, plant: Body) -> None:
        plant.lead_when_off(grip(LEADER, LINEAR))

    def place(self, plant: Body, t: float) -> float:
        """Of the handle at a time [s], in m."""
        plant.advance(round(t * 1e9))
        return plant.position * RATIO

    def expected(self, t: float) -> float:
        t %= 8.0
        moving = 0.03 * (1.0 - math.cos(0.5 * math.pi * (t % 2.0)))
        return (0.0, moving, 0.06, 0.06 - moving)[int(t // 2.0)]

    @pytest.mark.thorough("seconds of nonlinear mechanics", quick=("rigid",))
    def test_it_leads_the_handle_to_and_fro_with_rests(self, plant: Body) -> None:
        self.lead(plant)
        for t in (1.0, 1.9, 2.5, 3.0, 3.7, 4.2, 5.9, 6.6, 7.2, 8.1, 9.9, 11.0, 13.0, 15.0, 16.5, 19.0):
            assert self.place(plant, t) == pytest.approx(self.expected(t), abs=5e-4), t

    @pytest.mark.thorough("seconds of nonlinear mechanics", quick=("rigid",))
    def test_the_other_hand_takes_the_handle_while_the_drive_is_enabled(self, plant: Body) -> None:
        self.lead(plant)
        self.place(plant, 5.0)
        plant.start_hand()
        assert not plant.led
        assert self.place(plant, 5.0) == pytest.approx(0.06, abs=5e-4)
        # 6 N accelerate handle and hand against little friction, where the leader would hold them at rest.
        assert self.place(plant, 6.0) > 0.2
        plant.rest_hand()
        assert plant.led

    @pytest.mark.thorough("seconds of nonlinear mechanics", quick=("rigid",))
    def test_it_begins_anew_where_the_handle_is_and_with_a_rest(self, plant: Body) -> None:
        self.lead(plant)
        self.place(plant, 3.0)
        plant.rest_hand()
        settled = self.place(plant, 3.5)
        assert settled == pytest.approx(0.03, abs=2e-3)
        assert self.place(plant, 4.9) == pytest.approx(settled, abs=5e-5)
        assert self.place(plant, 7.0) == pytest.approx(settled + 0.06, abs=5e-4)

    def test_a_hand_that_had_let_go_takes_hold_again(self) -> None:
        release = HANDS["release"]
        assert release is not None
        plant = Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(release, LINEAR))
        self.lead(plant)
        plant.start_hand()
        self.place(plant, 3.0)
        plant.rest_hand()
        assert plant.led
        begun = self.place(plant, 4.9)
        assert self.place(plant, 7.1) == pytest.approx(begun + 0.06, abs=2e-3)
        plant.start_hand()
        assert not plant.led

    def test_after_a_long_silence_the_handle_is_where_it_would_be(self) -> None:
        watched, alone = (Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(_push(), LINEAR)) for _ in "ab")
        for plant in (watched, alone):
            self.lead(plant)
        for t in range(1, 88):
            self.place(watched, float(t))
        assert self.place(alone, 87.0) == pytest.approx(watched.position * RATIO, abs=5e-4)
        # A day is as quick: no more than two cycles are followed step by step.
        assert self.place(alone, 86_400.0 + 3.0) == pytest.approx(0.03, abs=1e-3)
        alone.start_hand()
        assert not alone.led

    def test_all_that_its_steps_need_can_be_built_before(self) -> None:
        plant = Plant(Shaft(4e-5, 1e-4, 2e-3, 1e-4), grip(_push(), LINEAR))
        self.lead(plant)
        plant.prepare()
        assert len(plant._motions) == 3
        assert all(motion._powers for motions in plant._motions.values() for motion in motions)


def _push() -> Hand:
    push = HANDS["push"]
    assert push is not None
    return push


def test_hands_are_found_by_name() -> None:
    assert hand_named("tap") is HANDS["tap"]
    assert hand_named("none") is None
    with pytest.raises(UsageError, match='no hand "punch"; hands are: push, tap, sine, guide, shake, release, none'):
        hand_named("punch")
