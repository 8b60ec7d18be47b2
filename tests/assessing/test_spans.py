"""The error split of a run whose elements changed, against motions in closed form and scipy's solution."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.integrate
from numpy.typing import NDArray

from haptic_fieldbus.assessing.element_forces import Handover, spans
from haptic_fieldbus.assessing.recording import Conversion, Recording
from haptic_fieldbus.cycle.laws import Field, Sensed, blended, field_of
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from tests.assessing.splitting import ErrorSplit, split

Array = NDArray[np.float64]
Times = NDArray[np.int64]

PERIOD = 1e-3
PERIOD_NS = 1_000_000
PERIODS, AT, RAMP = 400, 150, 50
"""Recorded; the last with the old elements alone; of the ramp."""
ANGULAR = 2 * np.pi * 4.0


def seconds(times_ns: Times) -> Array:
    found: Array = times_ns.astype(np.float64) * 1e-9
    return found


def way(t: Array) -> Array:
    return np.asarray(0.01 * (1 - np.cos(ANGULAR * t)))


def speed(t: Array) -> Array:
    return np.asarray(0.01 * ANGULAR * np.sin(ANGULAR * t))


def share(t: Array) -> Array:
    """Of the new, in continuous time."""
    found: Array = np.clip((t / PERIOD - AT) / RAMP, 0.0, 1.0)
    return found


@dataclass
class Given:
    """The handle moved by an ideal hand; each command acts at once, for a period."""

    times_ns: Times
    command: Array
    end_ns: int = 2**62

    def sample(self, times_ns: Times) -> tuple[Array, Array, Array]:
        t = seconds(times_ns)
        held = np.maximum(np.searchsorted(self.times_ns, times_ns, side="right") - 1, 0)
        return way(t), speed(t), self.command[held]

    def targets(self) -> tuple[Times, Array]:
        return self.times_ns, self.command


def changed(before: Element, after: Element, *staying: Element) -> tuple[ErrorSplit, Recording]:
    """Record of a loop that goes over from one to the other, and the split of its error."""
    times_ns = PERIOD_NS * np.arange(PERIODS, dtype=np.int64)
    sensed = Sensed()
    old, new, *others = (field_of(element, PERIOD, "exact-foh", sensed) for element in (before, after, *staying))
    field: Field = old
    force = np.zeros(PERIODS)
    for k, position in enumerate(way(seconds(times_ns)).tolist()):
        if k == AT + 1:
            field, _ = blended(old, new, RAMP)
        force[k] = field(position) + sum(other(position) for other in others)
    recording = Recording(times_ns, way(seconds(times_ns)), force, force)
    found = split(
        (before, *staying),
        recording,
        Given(times_ns, force),
        Conversion(1.0),
        period=PERIOD,
        begin_ns=0,
        method="exact-foh",
        exchanges=[Handover(AT * PERIOD_NS, RAMP, (after, *staying))],
    )
    return found, recording


SOFT, STIFF = (Wall("handle", stiffness, position=0.004, sides="bilateral") for stiffness in (300.0, 900.0))


def test_the_ideal_of_a_wall_that_changes_is_the_mix_of_both_by_a_straight_ramp() -> None:
    found, _ = changed(SOFT, STIFF)
    t = seconds(found.times_ns)
    stiffness = 300.0 + 600.0 * share(t)
    assert found.ideal == pytest.approx(-stiffness * (way(t) - 0.004), abs=1e-12)
    assert found.replay_difference < 1e-12


def test_nothing_but_sampling_is_wrong_with_a_ramp_that_was_rendered_as_it_should_be() -> None:
    found, _ = changed(SOFT, STIFF)
    assert found.by_source["sampling and delay"] == pytest.approx(1.0)
    assert all(abs(share) < 1e-9 for name, share in found.by_source.items() if name != "sampling and delay")
    largest_step = 900.0 * speed(np.array([0.0625])).max() * PERIOD + 600.0 * 0.016 / RAMP
    assert found.max <= largest_step


def test_without_the_exchange_the_same_record_is_judged_wrong() -> None:
    _, recording = changed(SOFT, STIFF)
    blind = split(
        (SOFT,), recording, Given(recording.times_ns, recording.force), Conversion(1.0), period=PERIOD, begin_ns=0
    )
    assert blind.replay_difference > 1.0


@pytest.mark.parametrize("staying", [(), (Friction("handle", coulomb=0.5, stiffness=400.0),)], ids=["alone", "beside"])
def test_friction_sticks_anew_in_the_replay_as_in_the_loop(staying: tuple[Element, ...]) -> None:
    before = Friction("handle", coulomb=1.0, stiffness=500.0, name="changing")
    found, _ = changed(before, Friction("handle", coulomb=2.0, stiffness=500.0, name="changing"), *staying)
    assert found.replay_difference < 1e-12


def test_a_mass_that_changes_is_compared_with_one_that_begins_at_rest_where_the_handle_is() -> None:
    """Both masses by scipy, the new one from the instant at which its ramp begins."""
    before, after = SprungMass("handle", 300.0, 0.2), SprungMass("handle", 150.0, 0.5)
    found, _ = changed(before, after)
    t = seconds(found.times_ns)
    begin = AT * PERIOD
    old = _pull(before, 0.0, t)
    new = np.where(t >= begin, _pull(after, begin, np.maximum(t, begin)), 0.0)
    assert found.ideal == pytest.approx((1 - share(t)) * old + share(t) * new, abs=1e-7)
    assert found.replay_difference < 1e-12
    late = t > (AT + RAMP) * PERIOD
    assert found.virtual["sprung_mass"][late, 0] == pytest.approx(way(t[late]) + new[late] / 150.0, abs=1e-9)


def _pull(element: SprungMass, begin: float, t: Array) -> Array:
    square = element.stiffness / element.mass

    def motion(at: float, state: Array) -> tuple[float, float]:
        return float(state[1]), float(square * (way(np.array(at)) - state[0]))

    start = [float(way(np.array(begin))), 0.0]
    solved = scipy.integrate.solve_ivp(
        motion, (begin, t.max()), start, rtol=1e-10, atol=1e-13, dense_output=True, method="DOP853"
    )
    pull: Array = element.stiffness * (solved.sol(t)[0] - way(t))
    return pull


def test_what_came_before_the_first_recorded_period_has_always_been() -> None:
    times_ns = PERIOD_NS * np.arange(100, 200, dtype=np.int64)
    (span,) = spans([SOFT], [Handover(50 * PERIOD_NS, RAMP, (STIFF,))], times_ns)
    assert (span.element, span.rows) == (STIFF, slice(0, 100))
    assert np.all(span.share == 1.0)


def test_what_comes_after_the_last_recorded_period_was_never_rendered() -> None:
    times_ns = PERIOD_NS * np.arange(100, dtype=np.int64)
    (span,) = spans([SOFT], [Handover(99 * PERIOD_NS, RAMP, (STIFF,))], times_ns)
    assert span.element == SOFT
    assert np.all(span.share == 1.0)


def test_a_change_of_the_last_period_has_one_period() -> None:
    times_ns = PERIOD_NS * np.arange(100, dtype=np.int64)
    old, new = spans([SOFT], [Handover(98 * PERIOD_NS, RAMP, (STIFF,))], times_ns)
    assert (old.rows.stop, new.rows) == (100, slice(99, 100))
    assert new.share[-1] == pytest.approx(1 / RAMP)
