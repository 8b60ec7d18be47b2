"""The constant force: when it plays, its envelope, and what it needs for that."""

import pytest
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.signals import Signal

SECOND = 1_000_000_000


def test_a_force_for_ever_needs_no_signal_at_all() -> None:
    constant = Constant("handle", magnitude=-2.0)
    assert constant.needs == ()
    assert constant.force() == -2.0


@pytest.mark.parametrize(
    "changing",
    [
        Constant("handle", magnitude=2.0, start_delay=0.1),
        Constant("handle", magnitude=2.0, duration=1.0),
        Constant("handle", magnitude=2.0, attack_time=0.5),
    ],
)
def test_one_that_changes_needs_the_time(changing: Constant) -> None:
    assert changing.needs == (Signal.ELAPSED_NS,)


def test_it_plays_from_its_delay_on_for_its_duration() -> None:
    force = Constant("handle", magnitude=2.0, start_delay=1.0, duration=2.0).force
    times = [0, SECOND - 1, SECOND, 3 * SECOND - 1, 3 * SECOND, 10**18]
    assert [force(time) for time in times] == [0.0, 0.0, 2.0, 2.0, 0.0, 0.0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_its_levels_have_the_sign_of_its_magnitude(sign: float) -> None:
    constant = Constant(
        "handle",
        magnitude=sign * 2.0,
        start_delay=1.0,
        duration=4.0,
        attack_level=3.0,
        attack_time=1.0,
        fade_level=1.0,
        fade_time=2.0,
    )
    expected = [0.0, 3.0, 2.5, 2.0, 2.0, 1.5, 0.0]
    times = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0]
    assert [constant.force(round(time * SECOND)) for time in times] == pytest.approx([sign * each for each in expected])


def test_no_motion_changes_it() -> None:
    assert not Constant("handle", magnitude=2.0).linearised().d.any()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"fade_time": 1.0}, "expected a duration too"),
        ({"duration": 1.0, "attack_time": 2.0}, "expected to fit into the duration"),
        ({"attack_level": -1.0, "attack_time": 1.0}, "greater than or equal to 0"),
        ({"duration": 0.0}, "greater than"),
        ({"start_delay": -1.0}, "greater than or equal to 0"),
        ({"magnitude": float("inf")}, "finite"),
        ({"frequency": 1.0}, "frequency"),
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        TypeAdapter(Constant).validate_python({"axis": "handle", "magnitude": 2.0, **wrong})
