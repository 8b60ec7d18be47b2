"""The gates between a scene and a hand, against their definitions."""

import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.cycle.safety import Permission, bind_hold, bind_limiter
from haptic_fieldbus.planning.limits import EffortLimits

PERIOD = 0.001
FADED_IN = 1.0
HOLDING = 0.25
"""Force that a hand may hold while the sign is looked for."""
SOON = 15
"""Missing periods after which feedback comes back soon: half of the 30 ms that end a run."""


def limits(effort: float = 5.0, slew: float = 1e9, fade_in: float = PERIOD) -> EffortLimits:
    return EffortLimits(effort=effort, speed=1.0, slew=slew, fade_in=fade_in, holding=HOLDING, age=0.03)


def bound(
    permission: Permission, of: EffortLimits | None = None
) -> tuple[Callable[[float], float], Callable[[int], float]]:
    """The limiter of an axis, and what it gives without feedback."""
    of = of or limits(slew=1000.0)
    return bind_limiter(of, PERIOD, permission), bind_hold(of, PERIOD, permission)


def test_the_limit_fades_in_linearly_from_the_first_period() -> None:
    limit = bind_limiter(limits(fade_in=0.01), PERIOD, Permission())
    assert [limit(99.0) for _ in range(12)] == pytest.approx(
        [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.0, 5.0]
    )


@pytest.mark.parametrize(("step", "most"), [(0.0, 5.0), (0.3, 4.8), (0.5, 5.0), (1.6, 4.8), (3.0, 3.0)])
def test_a_limit_that_is_no_whole_number_of_steps_is_not_rounded_up(step: float, most: float) -> None:
    limit = bind_limiter(limits(), PERIOD, Permission(), step)
    force = [limit(99.0) for _ in range(3)][-1]
    assert force == pytest.approx(most)
    assert not step or round(force / step) * step <= 5.0


def test_a_small_force_is_whole_as_soon_as_the_limit_has_passed_it() -> None:
    limit = bind_limiter(limits(fade_in=0.01), PERIOD, Permission())
    assert [limit(1.0) for _ in range(4)] == pytest.approx([0.5, 1.0, 1.0, 1.0])


@given(st.floats(1.0, 1e6))
def test_a_large_force_at_the_start_grows_no_faster_than_the_limit(asked: float) -> None:
    limit = bind_limiter(limits(slew=1000.0, fade_in=0.5), PERIOD, Permission())
    permitted = [0.0, *[limit(asked) for _ in range(500)]]
    assert max(b - a for a, b in pairwise(permitted)) <= 5.0 * PERIOD / 0.5 + 1e-12


@pytest.mark.parametrize(("asked", "permitted"), [(9.0, 5.0), (-9.0, -5.0), (4.0, 4.0)])
def test_effort_is_clamped_on_both_sides(asked: float, permitted: float) -> None:
    assert bind_limiter(limits(), PERIOD, Permission())(asked) == permitted


def test_what_was_clipped_is_counted() -> None:
    permission = Permission()
    limit = bind_limiter(limits(), PERIOD, permission)
    for asked in (1.0, 9.0, -9.0, 2.0):
        limit(asked)
    assert permission.clipped == 2


def test_slew_bounds_the_change_of_a_period_in_both_directions() -> None:
    limit = bind_limiter(limits(slew=1000.0), PERIOD, Permission())
    assert [limit(5.0), limit(5.0), limit(-5.0), limit(-5.0)] == pytest.approx([1.0, 2.0, 1.0, 0.0])


Step = tuple[float, int]
"""Force that the scene asks for, and how many periods without feedback come before."""


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.integers(0, 40)), min_size=2, max_size=30))
def test_no_input_and_no_gap_passes_effort_or_slew(steps: list[Step]) -> None:
    permission = Permission()
    limit, hold = bound(permission, limits(slew=1000.0, fade_in=0.02))
    permitted = [0.0]
    for asked, missing in steps:
        permitted += [hold(number + 1) for number in range(missing)]
        permitted.append(limit(asked))
    assert max(abs(value) for value in permitted) <= 5.0
    assert all(abs(b - a) <= 1.0 + 1e-12 for a, b in pairwise(permitted))


def after_contact(force: float) -> tuple[Permission, list[float]]:
    """A faded-in axis that gave this force, and then had no feedback for 20 periods."""
    permission = Permission()
    limit, hold = bound(permission)
    for _ in range(10):
        limit(force)
    return permission, [hold(number + 1) for number in range(20)]


def test_one_missing_period_is_held_and_a_longer_gap_fades_to_zero() -> None:
    _, held = after_contact(4.0)
    fading = [4.0 * max(0.0, 1.0 - number * PERIOD / 0.01) for number in range(20)]
    assert held == pytest.approx(fading)


@given(st.floats(-5.0, 5.0), st.lists(st.floats(0.0, 50.0), max_size=40))
def test_back_in_contact_the_force_stays_below_that_before_the_gap(before: float, depth: list[float]) -> None:
    permission, _ = after_contact(before)
    limit = bind_limiter(limits(slew=1000.0), PERIOD, permission)
    side = math.copysign(1.0, before)
    assert all(abs(limit(side * force + side)) <= abs(before) + 1e-12 for force in depth)


@pytest.mark.parametrize("leaving", [0.0, 1.0])
def test_the_cap_ends_when_contact_is_left(leaving: float) -> None:
    permission, _ = after_contact(-2.0)
    limit = bind_limiter(limits(slew=1000.0), PERIOD, permission)
    assert [limit(-4.0) for _ in range(5)][-1] == -2.0
    limit(leaving)
    assert [limit(-4.0) for _ in range(9)][-1] == -4.0


def test_a_gap_outside_of_contact_gives_no_force_until_contact_is_left() -> None:
    """The handle entered the wall unseen; nothing pushes it out."""
    permission, held = after_contact(0.0)
    limit = bind_limiter(limits(slew=1000.0), PERIOD, permission, least=0.01)
    assert held == [0.0] * 20
    assert [limit(-4.0) for _ in range(9)] == [0.0] * 9
    limit(0.0)
    assert [limit(-4.0) for _ in range(9)][-1] == -4.0


def test_a_second_gap_never_raises_the_cap() -> None:
    permission, _ = after_contact(-4.0)
    limit, hold = bound(permission)
    limit(-9.0)
    for number in range(20):
        hold(number + 1)
    assert max(abs(limit(-9.0)) for _ in range(20)) == pytest.approx(1.0)


@pytest.mark.parametrize("pulse", [0.0, 0.2, -0.2])
def test_a_proof_of_the_sign_leaves_no_contact(pulse: float) -> None:
    """A gap, then a doubt, whose pulses are no force and force to both sides while the scene pushes on."""
    permission, _ = after_contact(-2.0)
    limit, _ = bound(permission)
    permission.proof = lambda force: pulse
    for _ in range(20):
        limit(-4.0)
    permission.proof = None
    assert [limit(-4.0) for _ in range(9)][-1] == -2.0
    limit(0.0)
    assert [limit(-4.0) for _ in range(9)][-1] == -4.0


def test_a_cap_ends_when_the_scene_leaves_contact_while_the_sign_is_looked_for() -> None:
    permission, _ = after_contact(-2.0)
    limit, _ = bound(permission)
    permission.proof = lambda force: 0.2
    limit(1.0)
    permission.proof = None
    assert [limit(-4.0) for _ in range(9)][-1] == -4.0


@pytest.mark.parametrize("pulse", [0.0, 0.2, -0.2])
def test_a_gap_while_the_sign_is_looked_for_caps_at_what_a_hand_may_hold(pulse: float) -> None:
    """Whatever the pulse was in which it came: it says neither where contact is nor how large its force."""
    permission = Permission()
    limit, hold = bound(permission)
    permission.proof = lambda force: pulse
    limit(-4.0)
    for number in range(20):
        hold(number + 1)
    limit(-4.0)
    permission.proof = None
    assert [limit(-4.0) for _ in range(9)][-1] == -HOLDING
    limit(0.0)
    assert [limit(-4.0) for _ in range(9)][-1] == -4.0


def test_a_short_gap_while_the_sign_is_looked_for_leaves_nothing() -> None:
    """The force before it is that of a pulse; what is permitted afterwards fades in from what a hand may hold."""
    permission = Permission()
    limit, hold = bound(permission)
    permission.proof = lambda force: 0.2
    limit(-4.0)
    for number in range(5):
        hold(number + 1)
    limit(-4.0)
    permission.proof = None
    assert [limit(-4.0) for _ in range(9)][-1] == -4.0


@pytest.mark.parametrize("missing", [2, 9, SOON])
def test_after_a_short_gap_the_place_of_the_law_is_looked_after_until_the_force_is_back(missing: int) -> None:
    """At 200 N/s, 4 N that faded by a tenth for each period after the first are back after as many halves of it."""
    permission = Permission()
    limit, hold = bound(permission, limits(slew=200.0))
    for _ in range(40):
        limit(4.0)
    before = permission.beside
    held = [hold(number + 1) for number in range(missing)][-1]
    assert (before, permission.beside, permission.pauses) == (False, True, True)
    back = [(limit(4.0), permission.pauses) for _ in range(30)]
    forces = [min(4.0, held + 0.2 * number) for number in range(1, 31)]
    assert [force for force, _ in back] == pytest.approx(forces)
    blind = [number < 10 and force < 4.0 - 1e-9 for number, force in enumerate(forces, start=1)]
    assert [paused for _, paused in back] == blind, "a hundredth of a second at most"
    assert permission.gaps.short == 1
    assert permission.gaps.long == 0


def test_a_long_gap_leaves_a_cap_and_the_law_pauses_until_the_force_is_that_of_the_cap() -> None:
    permission, _ = after_contact(-2.0)
    limit = bind_limiter(limits(slew=1000.0), PERIOD, permission)
    found = [(permission.capped, permission.pauses)]
    for _ in range(5):
        limit(-4.0)
        found.append((permission.capped, permission.pauses))
    assert found == [(True, True)] * 2 + [(True, False)] * 4
    assert permission.gaps.short == 0


def test_a_cap_stays_while_the_scene_is_too_far_beside_its_place() -> None:
    permission, _ = after_contact(-2.0)
    limit = bind_limiter(limits(slew=1000.0), PERIOD, permission)
    permission.astray = True
    limit(0.0)
    assert [limit(4.0) for _ in range(9)][-1] == 2.0, "to either side"
    permission.astray = False
    limit(0.0)
    assert [limit(4.0) for _ in range(9)][-1] == 4.0


def test_a_gap_while_the_limit_fades_in_takes_nothing_from_the_force_that_is_still_to_come() -> None:
    limit, hold = bound(Permission(), limits(slew=1e9, fade_in=0.1))
    for _ in range(20):
        limit(4.0)
    for number in range(5):
        hold(number + 1)
    assert [limit(4.0) for _ in range(100)][-1] == pytest.approx(4.0, abs=5.0 / 100 + 1e-9)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("periods_before", [0, 1000])
def test_what_is_not_finite_comes_out_as_no_number_and_leaves_no_trace(value: float, periods_before: int) -> None:
    limit = bind_limiter(limits(), PERIOD, Permission())
    for _ in range(periods_before):
        limit(1.0)
    untouched = bind_limiter(limits(), PERIOD, Permission())
    for _ in range(periods_before):
        untouched(1.0)
    assert math.isnan(limit(value))
    assert limit(1.0) == untouched(1.0)
