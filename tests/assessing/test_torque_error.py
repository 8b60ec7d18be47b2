"""The error split against motions in closed form: the hand moves the handle, whatever the motor does."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.assessing.element_forces import POINTS_PER_PERIOD
from haptic_fieldbus.assessing.recording import Conversion, Recording
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.scenes.element import DynamicElement, Element, StaticElement
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.assessing.splitting import ErrorSplit, split

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Motion = Callable[[Array], tuple[Array, Array]]

PERIOD = 1e-3
PERIOD_NS = 1_000_000
AMPLITUDE = 0.01
ANGULAR = 2 * math.pi * 3.0
START_NS = 123_456_789


def seconds(times_ns: Times) -> Array:
    """Since the start."""
    since: Array = (times_ns - START_NS).astype(np.float64) * 1e-9
    return since


def sine(t: Array) -> tuple[Array, Array]:
    """A handle that starts at rest: x = a·(1 − cos ωt)."""
    return AMPLITUDE * (1 - np.cos(ANGULAR * t)), AMPLITUDE * ANGULAR * np.sin(ANGULAR * t)


@dataclass
class Given:
    """A trajectory given in closed form, at a shaft with 200 rad to the metre and its zero at 7 rad."""

    target_ns: Times
    target: Array
    lag: float = 0.0
    motion: Motion = sine
    conversion: Conversion = field(default=Conversion(ratio=-0.005, zero=7.0))
    end_ns: int = 2**62

    def sample(self, times_ns: Times) -> tuple[Array, Array, Array]:
        position, velocity = self.motion(seconds(times_ns))
        ratio = self.conversion.ratio
        return position / ratio + self.conversion.zero, velocity / ratio, self._torque(times_ns)

    def targets(self) -> tuple[Times, Array]:
        return self.target_ns, self.target

    def _torque(self, times_ns: Times) -> Array:
        current = np.maximum(np.searchsorted(self.target_ns, times_ns, side="right") - 1, 0)
        started = times_ns >= self.target_ns[0]
        if not self.lag:
            return np.where(started, self.target[current], 0.0)
        begin = np.zeros(len(self.target))
        for step in range(1, len(begin)):
            decay = math.exp(-(self.target_ns[step] - self.target_ns[step - 1]) * 1e-9 / self.lag)
            begin[step] = self.target[step - 1] + (begin[step - 1] - self.target[step - 1]) * decay
        decays = np.exp(-np.maximum(times_ns - self.target_ns[current], 0) * 1e-9 / self.lag)
        return np.where(started, self.target[current] + (begin[current] - self.target[current]) * decays, 0.0)


@dataclass
class Run:
    """Record that a loop would have made of such a motion."""

    elements: list[Element]
    periods: int = 600
    delay_ns: int = 330_000
    count: float = 0.0
    torque_step: float = 0.0
    lag: float = 0.0
    method: str | None = None
    estimator: str | None = None
    motion: Motion = sine
    lost: tuple[int, ...] = ()

    def record(self) -> tuple[Recording, Given]:
        times_ns = START_NS + PERIOD_NS * np.arange(self.periods, dtype=np.int64)
        true, _ = self.motion(seconds(times_ns))
        position = np.round(true / self.count) * self.count if self.count else true
        velocity = None
        if self.estimator:
            velocity = np.array(list(map(estimators.bind(self.estimator, PERIOD), position.tolist())))
        force = sum((self._force(element, position, velocity) for element in self.elements), np.zeros(len(position)))
        command = np.round(force / self.torque_step) * self.torque_step if self.torque_step else force
        kept = np.setdiff1d(np.arange(self.periods), self.lost)
        given = Given((times_ns + self.delay_ns)[kept], command[kept] * -0.005, self.lag, self.motion)
        return Recording(times_ns, position, force, command, velocity), given

    def split(self, begin_ns: int = START_NS) -> ErrorSplit:
        recording, given = self.record()
        return split(
            self.elements,
            recording,
            given,
            given.conversion,
            period=PERIOD,
            begin_ns=begin_ns,
            method=self.method,
            step=self.torque_step,
        )

    def _force(self, element: Element, position: Array, velocity: Array | None) -> Array:
        feedback = {Signal.POSITION: position, Signal.VELOCITY: velocity}
        if isinstance(element, DynamicElement):
            law = integrators.bind(element.dynamics, PERIOD, self.method or "")
        else:
            assert isinstance(element, StaticElement)
            law = element.force
        return np.array([law(*row) for row in zip(*(feedback[signal] for signal in element.needs), strict=True)])


SPRING = Wall("handle", stiffness=500.0, position=0.004, sides="bilateral")
WALL = Wall("handle", stiffness=500.0, position=0.015)
DAMPED = Wall("handle", stiffness=500.0, damping=2.0, position=0.005)
MASS = SprungMass("handle", stiffness=400.0, mass=0.3)
EVERYTHING = {
    "wall": Run([WALL], count=1e-5, torque_step=0.01, lag=1.6e-4),
    "damped wall": Run([DAMPED], count=1e-5, torque_step=0.01, lag=1.6e-4, estimator="backward-difference"),
    "sprung mass": Run([MASS], count=1e-5, torque_step=0.01, lag=1.6e-4, method="exact-foh"),
    "all at once": Run(
        [DAMPED, MASS, SPRING],
        count=1e-5,
        torque_step=0.01,
        lag=1.6e-4,
        method="forward-euler",
        estimator="backward-difference",
        lost=(100, 101, 250),
    ),
}


@pytest.mark.parametrize("run", EVERYTHING.values(), ids=EVERYTHING.keys())
def test_the_sources_sum_to_the_error_and_the_shares_to_one(run: Run) -> None:
    found = run.split()
    np.testing.assert_allclose(sum(found.sources.values()), found.error, rtol=0, atol=1e-9 * found.max)
    assert sum(found.by_source.values()) == pytest.approx(1.0, abs=1e-9)
    assert found.rms == pytest.approx(math.sqrt(float(np.mean(found.error**2))))


@pytest.mark.parametrize("run", EVERYTHING.values(), ids=EVERYTHING.keys())
def test_the_recorded_force_is_found_again_to_the_last_bit(run: Run) -> None:
    assert run.split().replay_difference == 0.0


def test_a_force_that_the_elements_do_not_give_is_exposed() -> None:
    recording, given = EVERYTHING["wall"].record()
    recording.force[321] += 0.125
    found = split([WALL], recording, given, given.conversion, period=PERIOD, begin_ns=START_NS)
    assert found.replay_difference == pytest.approx(0.125)


@pytest.mark.parametrize(
    ("name", "left_out"),
    [
        ("wall", {"estimator", "integrator"}),
        ("damped wall", {"integrator"}),
        ("sprung mass", {"estimator"}),
        ("all at once", set()),
    ],
)
def test_sources_that_the_plan_does_not_have_are_left_out(name: str, left_out: set[str]) -> None:
    order = ["sampling and delay", "encoder", "estimator", "integrator", "torque step", "torque loop"]
    assert list(EVERYTHING[name].split().by_source) == [source for source in order if source not in left_out]


def test_with_everything_else_ideal_all_error_is_sampling_and_delay() -> None:
    found = Run([SPRING]).split(START_NS + PERIOD_NS)
    assert found.by_source["sampling and delay"] == pytest.approx(1.0, abs=1e-12)
    for name in ("encoder", "torque step", "torque loop"):
        np.testing.assert_allclose(found.sources[name], 0.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("delay_ns", [0, 330_000, 500_000, 999_999])
def test_a_held_and_delayed_spring_errs_by_stiffness_times_the_way_made_meanwhile(delay_ns: int) -> None:
    found = Run([SPRING], periods=2001, delay_ns=delay_ns).split(START_NS + 100 * PERIOD_NS)
    delay = delay_ns * 1e-9
    mean_square_age = delay**2 + delay * PERIOD + PERIOD**2 / 3  # age of what is held: uniform from td to td + T
    expected = 500.0 * AMPLITUDE * ANGULAR / math.sqrt(2) * math.sqrt(mean_square_age)
    assert found.rms == pytest.approx(expected, rel=0.01)
    # A force that lags by φ gives the energy π·K·a²·sin φ in each turn.
    turns = (found.times_ns[-1] - found.times_ns[0]) * 1e-9 * ANGULAR / (2 * math.pi)
    leak = math.pi * 500.0 * AMPLITUDE**2 * math.sin(ANGULAR * (delay + PERIOD / 2))
    assert found.energy_generated == pytest.approx(turns * leak, rel=0.03)


def test_a_delay_of_a_whole_period_is_found_in_the_values() -> None:
    found = Run([SPRING], delay_ns=PERIOD_NS, torque_step=0.01).split(START_NS + 100 * PERIOD_NS)
    late = AMPLITUDE * ANGULAR * 500.0 * 1.6e-3
    assert np.abs(found.sources["sampling and delay"]).max() > late
    assert np.abs(found.sources["torque step"]).max() <= 0.005 + 1e-9


def test_a_force_that_was_cut_is_an_error_of_limits_and_not_of_the_torque_step() -> None:
    """The motor gives 2 N of up to 5 N: what lies between is the only error beside sampling and rounding."""
    run = Run([SPRING], torque_step=0.01)
    recording, given = run.record()
    cut = replace(recording, command=np.clip(recording.command, -2.0, 2.0))
    given = replace(given, target=np.clip(given.target, -0.01, 0.01))
    found = split([SPRING], cut, given, given.conversion, period=PERIOD, begin_ns=START_NS + PERIOD_NS, step=0.01)
    held = found.sources["limits"]
    assert held.min() == pytest.approx(-found.ideal.max() + 2.0, abs=0.1)
    assert np.abs(found.sources["torque step"]).max() <= 0.005 + 1e-9
    assert found.by_source["limits"] > 0.95


def test_each_source_is_what_a_plain_loop_over_time_finds() -> None:
    run = Run([DAMPED], periods=80, count=2e-4, torque_step=0.05, lag=2e-4, estimator="backward-difference")
    run.motion = lambda t: (0.01 + 0.05 * t, np.full_like(t, 0.05))
    found, (recording, given) = run.split(START_NS + 10 * PERIOD_NS), run.record()
    assert recording.velocity is not None
    for index, t_ns in enumerate(found.times_ns.tolist()):
        k = (t_ns - START_NS - run.delay_ns) // PERIOD_NS
        here, there = 0.01 + 0.05e-9 * (t_ns - START_NS), 0.01 + 0.05 * k * PERIOD
        levels = [
            DAMPED.force(here, 0.05),
            DAMPED.force(there, 0.05),
            DAMPED.force(recording.position[k], 0.05),
            DAMPED.force(recording.position[k], recording.velocity[k]),
            recording.command[k],
            given.sample(np.array([t_ns]))[2][0] / -0.005,
        ]
        found_here = [source[index] for name, source in found.sources.items() if name != "limits"]
        np.testing.assert_allclose(found_here, np.diff(levels), rtol=0, atol=1e-11)


def test_the_command_of_a_lost_frame_never_acts() -> None:
    whole, lossy = (Run([SPRING], torque_step=0.01, lost=lost).split(START_NS + PERIOD_NS) for lost in ((), (300,)))
    acted = (whole.times_ns >= START_NS + 300 * PERIOD_NS + 330_000) & (
        whole.times_ns < START_NS + 301 * PERIOD_NS + 330_000
    )
    assert np.abs(lossy.sources["torque step"]).max() <= 0.005 + 1e-9
    changed = lossy.sources["sampling and delay"] != whole.sources["sampling and delay"]
    np.testing.assert_array_equal(changed, acted)


def test_a_target_that_is_not_repeated_because_it_is_the_same_still_acts() -> None:
    run = Run([WALL], periods=300, motion=lambda t: (0.016 + 1e-7 * t, np.full_like(t, 1e-7)), torque_step=0.1)
    recording, given = run.record()
    given.target_ns, given.target = given.target_ns[:1], given.target[:1]
    found = split([WALL], recording, given, given.conversion, period=PERIOD, begin_ns=START_NS + PERIOD_NS)
    assert found.sources["sampling and delay"].max() <= 500.0 * 1e-7 * 1.34e-3
    assert found.by_source["torque loop"] == 0.0


def sprung_mass_on_a_sine(t: Array) -> Array:
    """Position of the mass while the puck moves by `sine`, both from rest: closed form."""
    natural = math.sqrt(MASS.stiffness / MASS.mass)
    forced = natural**2 / (natural**2 - ANGULAR**2)
    moved: Array = AMPLITUDE * (1 - forced * np.cos(ANGULAR * t) - (1 - forced) * np.cos(natural * t))
    return moved


def test_the_ideal_of_a_sprung_mass_is_its_closed_form() -> None:
    found = Run([MASS], periods=3000, method="exact-foh").split()
    mass = sprung_mass_on_a_sine(seconds(found.times_ns))
    np.testing.assert_allclose(found.ideal, MASS.stiffness * (mass - found.position), rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.virtual["sprung_mass"][:, 0], mass, rtol=0, atol=1e-12)


def test_the_first_order_method_has_the_larger_share_of_error() -> None:
    first, second = (Run([MASS], method=method).split() for method in ("forward-euler", "exact-foh"))
    assert second.by_source["integrator"] < 1e-3 < first.by_source["integrator"]
    assert first.rms > second.rms


def test_contact_is_where_the_ideal_pushes() -> None:
    found = Run([WALL]).split()
    np.testing.assert_array_equal(found.ideal != 0.0, found.position > 0.015)
    assert found.touched == (found.ideal != 0.0).sum()


def test_what_is_scored_is_contact_in_which_the_handle_moves() -> None:
    """x = a·(1 − cos ωt) is slower than 5 % of its fastest within asin 0.05 of each turning point, in bins of 1 %."""
    found = Run([WALL], periods=2001, delay_ns=330_000).split()
    speed = np.abs(np.sin(ANGULAR * seconds(found.times_ns)))
    surely, perhaps = ((found.ideal != 0.0) & (speed > 0.05 * share) for share in (1.011, 0.989))
    assert surely.sum() <= found.scored <= perhaps.sum()
    assert 0.9 * found.touched < found.scored < 0.99 * found.touched
    for rms, values in ((found.error_rms_contact, found.error), (found.ideal_rms_contact, found.ideal)):
        assert rms == pytest.approx(math.sqrt(float(np.mean(values[surely] ** 2))), rel=1e-3)


MOVED = math.ceil((math.pi / 2 + 0.4) / ANGULAR / PERIOD) + 2
"""Periods after which the handle of the next test rests."""


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("rest", [0, 3000, 30_000])
def test_rest_does_not_dilute_the_score(rest: int) -> None:
    """The handle comes into the wall by a quarter of a turn, and stays there."""

    def way(t: Array) -> tuple[Array, Array]:
        phase = np.minimum(ANGULAR * t, np.pi / 2 + 0.4)
        moves = ANGULAR * t < np.pi / 2 + 0.4
        return AMPLITUDE * (1 - np.cos(phase)), np.where(moves, AMPLITUDE * ANGULAR * np.sin(phase), 0.0)

    soon = Wall("handle", stiffness=500.0, position=0.004)
    moved, rested = (
        Run([soon], periods=periods, delay_ns=500_000, motion=way).split(START_NS + 20 * PERIOD_NS)
        for periods in (MOVED, MOVED + rest)
    )
    ratio = [found.error_rms_contact / found.ideal_rms_contact for found in (moved, rested)]
    assert ratio[1] == pytest.approx(ratio[0], rel=1e-9)
    assert rested.scored == moved.scored
    assert rested.touched == pytest.approx(moved.touched + POINTS_PER_PERIOD * rest, rel=1e-3)


def test_in_free_space_there_is_no_error_and_nothing_to_share() -> None:
    found = Run([Wall("handle", stiffness=500.0, position=1.0)]).split()
    assert (found.rms, found.max, found.ideal_rms_contact, found.error_rms_contact) == (0.0, 0.0, 0.0, 0.0)
    assert set(found.by_source.values()) == {0.0}


def test_the_time_before_full_fade_in_does_not_count() -> None:
    begin_ns = START_NS + 57 * PERIOD_NS + 1234
    found = Run([WALL], periods=100).split(begin_ns)
    assert found.times_ns[0] >= begin_ns
    assert found.times_ns[-1] <= START_NS + 99 * PERIOD_NS
    assert np.diff(found.times_ns) == pytest.approx(PERIOD_NS / 16, rel=2e-3)


def test_nothing_recorded_after_the_fade_in_is_refused() -> None:
    with pytest.raises(ValueError, match="nothing was recorded"):
        Run([WALL], periods=100).split(START_NS + 200 * PERIOD_NS)


def test_commands_that_never_reach_the_drive_are_refused() -> None:
    recording, given = EVERYTHING["sprung mass"].record()
    given.target = given.target + 1.0
    with pytest.raises(ValueError, match="accepted no recorded command"):
        split([MASS], recording, given, given.conversion, period=PERIOD, begin_ns=START_NS, method="exact-foh")
