"""The batch engine against the same loop in plain floats, bit for bit, and against the exact limits."""

import math
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, sample, stiffness_limit
from haptic_fieldbus.numerics.batch import BLOCK, loops, run
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import SampledPlant
from tests.loops import PERIOD, ByHand, sprung_mass, with_damping

STEPS = 400


class Alone:
    """One loop in plain floats; the plant's map is that of `margins.sample`."""

    def __init__(self, device: SampledPlant, environment: StateSpace, **options: float) -> None:
        columns = np.hstack([device.transition, device.before, device.after])
        self.rows = [[float(value) for value in row] for row in columns]
        self.whole = device.whole
        self.a, self.b = environment.a.tolist(), environment.b[:, 0].tolist()
        self.c, self.d = environment.c[0].tolist(), float(environment.d[0, 0])
        self.inner = [0.0] * environment.order
        self.forces = [0.0] * (device.whole + 2)
        self.options = options

    def run(self, state: list[float], steps: int) -> list[float]:
        for _ in range(steps):
            self.forces = [self.force(self.measured(state[0])), *self.forces[:-1]]
            known = [*state, self.forces[self.whole + 1], self.forces[self.whole]]
            state = [self.total(row, known) for row in self.rows]
        return state

    @staticmethod
    def total(row: list[float], known: list[float]) -> float:
        total = row[0] * known[0]
        for factor, value in zip(row[1:], known[1:], strict=True):
            total = total + factor * value
        return total

    def measured(self, position: float) -> float:
        step = self.options.get("resolution", 0.0)
        return math.floor(position / step + (self.options.get("phase", 0.0) + 0.5)) * step if step else position

    def force(self, position: float) -> float:
        force = self.d * position
        for factor, value in zip(self.c, self.inner, strict=True):
            force = force + factor * value
        inner = []
        for row, by in zip(self.a, self.b, strict=True):
            total = by * position
            for factor, value in zip(row, self.inner, strict=True):
                total = total + factor * value
            inner.append(total)
        self.inner = inner
        if self.options.get("unilateral") and (position <= 0.0 or force > 0.0):
            force = 0.0
        most = self.options.get("saturation", math.inf)
        return min(max(force, -most), most)


@pytest.mark.thorough("10 cases of one rule", quick=3)
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"resolution": 1e-5},
        {"resolution": 1e-5, "phase": 0.3, "unilateral": True},
        {"saturation": 0.05},
        {"resolution": 3e-6, "unilateral": True, "saturation": 0.2},
    ],
    ids=["plain", "encoder", "unilateral", "saturated", "all"],
)
@pytest.mark.parametrize("lag", [0.0, 1.6e-4])
def test_every_loop_is_bit_for_bit_that_of_plain_floats(options: dict[str, Any], lag: float) -> None:
    random = np.random.default_rng(7)
    count = 24
    mass, damping = random.uniform(0.01, 2.0, count), random.uniform(0.1, 5.0, count)
    delay = random.choice([0.0, 0.3e-3, 1e-3, 1.7e-3, 3e-3], count)
    stiffness, virtual = random.uniform(50.0, 4000.0, count), random.uniform(0.0, 1.0, count)
    position, velocity = random.uniform(-1e-3, 1e-3, count), random.uniform(-0.1, 0.1, count)
    many = loops(
        mass=mass, damping=damping, period=PERIOD, delay=delay, stiffness=stiffness, virtual_damping=virtual, lag=lag,
        position=position, velocity=velocity, **options,
    )  # fmt: skip
    found = run(many, STEPS)
    for row in range(count):
        plant = Plant(mass[row], damping[row], torque_lag=lag)
        environment = StateSpace(many.a[row], many.b[row, :, None], many.c[row, None], many.d[row, None, None])
        alone = Alone(sample(plant, PERIOD, delay[row]), environment, **options)
        state = alone.run([position[row], velocity[row], *([0.0] if lag else [])], STEPS)
        assert (found.position[row], found.velocity[row]) == (state[0], state[1])


@pytest.mark.thorough("many loops for each delay")
@pytest.mark.parametrize("delay", [0.0, 0.4, 2.0])
def test_loops_decay_below_their_limit_and_grow_above_it(delay: float) -> None:
    limit = stiffness_limit(Plant(0.1, 2.0), PERIOD, delay * PERIOD, with_damping(0.3))
    many = loops(
        mass=0.1, damping=2.0, period=PERIOD, delay=delay * PERIOD, stiffness=[0.99 * limit, 1.01 * limit],
        virtual_damping=0.3, position=1e-3,
    )  # fmt: skip
    below, above = run(many, 20_000).growth
    assert below < 1.0 < above


def test_virtual_states_run_as_environments() -> None:
    environment = sprung_mass(0.3, "exact-foh")(500.0)
    many = loops(mass=0.6, damping=1.5, period=PERIOD, environments=[environment] * 3, velocity=[0.1, 0.2, -0.1])
    found = run(many, STEPS)
    state = Alone(sample(Plant(0.6, 1.5), PERIOD, 0.0), environment).run([0.0, 0.1], STEPS)
    assert (found.position[0], found.velocity[0]) == (state[0], state[1])
    np.testing.assert_allclose(found.position, found.position[0] * np.array([1.0, 2.0, -1.0]), rtol=1e-9)


def test_the_map_is_that_of_the_loop_written_by_hand() -> None:
    by_hand = ByHand(Plant(0.6, 1.5), 0.3e-3, 900.0, 0.4)
    state = np.zeros(len(by_hand.period_map()))
    state[0] = 1e-3
    for _ in range(50):
        state = by_hand.period_map() @ state
    many = loops(
        mass=0.6, damping=1.5, period=PERIOD, delay=0.3e-3, stiffness=900.0, virtual_damping=0.4, position=1e-3
    )
    # By hand, the first difference is taken to a position of 0 before, as here.
    assert run(many, 50).position[0] == pytest.approx(state[0], rel=1e-10)


@pytest.mark.thorough("runs loops for seconds")
def test_a_push_is_balanced_by_the_spring() -> None:
    for extra in ({}, {"lag": 1e-4}, {"coulomb": 0.1}):
        options: dict[str, Any] = {"mass": 0.1, "damping": 3.0, "period": PERIOD, "stiffness": 500.0, **extra}
        found = run(loops(push=2.0, **options), 5000)
        assert found.position[0] == pytest.approx(2.0 / 500.0, abs=1e-12 + options.get("coulomb", 0.0) / 500.0)


@pytest.mark.thorough("runs loops for seconds")
def test_friction_stops_what_would_ring_for_long() -> None:
    many = loops(
        mass=0.6, damping=0.3, period=PERIOD, delay=[0.0, 0.4e-3], stiffness=300.0, coulomb=0.5, position=5e-3
    )  # fmt: skip
    found = run(many, 3000)
    np.testing.assert_array_equal(found.velocity, 0.0)
    assert (np.abs(found.position) <= 0.5 / 300.0).all()


def test_friction_stops_a_free_mass_after_m_v2_over_2_fc() -> None:
    found = run(loops(mass=0.5, damping=0.0, period=PERIOD, coulomb=[0.2, 0.202], velocity=0.1), 300)
    np.testing.assert_allclose(found.position, [0.0125, 0.0125 / 1.01], rtol=1e-9)
    np.testing.assert_array_equal(found.velocity, 0.0)


def test_a_push_that_equals_friction_leaves_the_damping_alone() -> None:
    """v = v₀·e^(−b·t/m), also where nothing is left of it after one period; x goes to m·v₀/b."""
    damping, velocity = (np.ravel(each) for each in np.meshgrid(np.geomspace(0.1, 1e3, 81), [-0.7, 0.3, 1.0]))
    mass, time = 1e-3, 50 * 1e-3
    ended = run(
        loops(mass=mass, damping=damping, period=1e-3, coulomb=1.0, push=np.sign(velocity), velocity=velocity), 50
    )
    left = np.exp(-damping * time / mass)
    assert not ended.diverged.any()
    np.testing.assert_allclose(ended.velocity, velocity * left, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(ended.position, velocity * mass / damping * (1.0 - left), rtol=1e-12)


def test_what_overflows_is_flagged_as_diverged() -> None:
    found = run(loops(mass=1e-3, damping=1.0, period=PERIOD, stiffness=[100.0, 1e9], position=1.0), 200)
    assert found.diverged.tolist() == [False, True]


def test_more_loops_than_a_block_are_the_same_loops() -> None:
    stiffness = np.linspace(10.0, 3000.0, BLOCK + 50)
    options: dict[str, Any] = {"mass": 0.6, "damping": 1.5, "period": PERIOD, "position": 1e-3}
    whole = run(loops(stiffness=stiffness, **options), 20)
    rest = run(loops(stiffness=stiffness[BLOCK:], **options), 20)
    np.testing.assert_array_equal(whole.position[BLOCK:], rest.position)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"mass": [1.0, 0.0]}, "loop 1: mass 0: expected a number above 0"),
        ({"mass": -1.0}, "mass -1: expected a number above 0"),
        ({"period": 0.0}, "period 0: expected a time above 0 s"),
        ({"stiffness": math.nan}, "nan: expected a number as stiffness"),
        ({"delay": -1e-3}, "delay -0.001: expected a number from 0 up"),
        ({"coulomb": -0.1}, "coulomb -0.1: expected a number from 0 up"),
        ({"coulomb": math.inf}, "coulomb inf: expected a number from 0 up"),
        ({"saturation": 0.0}, "saturation 0: expected a force above 0"),
        ({"coulomb": 0.1, "lag": 1e-4}, "coulomb 0.1: expected torque loop lag 0 with friction"),
    ],
)
def test_loops_that_cannot_be_are_refused_with_the_limit(wrong: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        loops(**{"mass": 1.0, "damping": 1.0, "period": PERIOD, **wrong})


@pytest.mark.parametrize("lag", [0.0, 2e-4])
def test_a_loop_among_others_of_all_kinds_is_that_loop_alone(lag: float) -> None:
    """A factor that is common to a block, an encoder that some have, a stop and a push: no neighbour changes a bit."""
    common: dict[str, Any] = {"mass": 0.6, "damping": 1.5, "period": PERIOD, "delay": 0.3e-3, "velocity": 0.2}
    many = loops(
        **common, stiffness=[200.0, 400.0, 600.0, 800.0], virtual_damping=[0.0, 1.0, 2.0, 3.0],
        push=[0.0, 0.5, 1.0, 0.0],
        resolution=[0.0, 1e-5, 0.0, 1e-4], unilateral=[False, True, True, False], saturation=[math.inf, 3.0, 2.0, 9.0],
        lag=lag, coulomb=0.0 if lag else 0.1,
    )  # fmt: skip
    together, digits = run(many, STEPS), 0.0 if lag else 1e-6  # numpy rounds logarithms by their place in an array
    for row in range(len(many)):
        alone = run(many.part(np.array([row])), STEPS)
        assert alone.position[0] == pytest.approx(together.position[row], rel=digits, abs=digits)
        assert alone.growth[0] == pytest.approx(together.growth[row], rel=digits, abs=digits)
