"""Generalised Maxwell tissue: any number of branches, however fast."""

import math

import pytest
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.generalised_maxwell import GeneralisedMaxwell

PERIOD = 1e-3
TISSUE = GeneralisedMaxwell("handle", rest=100.0, branches=((200.0, 0.1), (300.0, 1e-3), (500.0, 1e-5)), position=0.01)


def test_after_a_press_every_branch_relaxes_in_its_own_time() -> None:
    """F = −D·(k₀ + Σ k·g·e^(−t/τ)), g = τ/T·(1 − e^(−T/τ)) for the ramp of one period that the press is."""
    force = TISSUE.begin(PERIOD)
    force(0.0)
    force(0.01)
    for n in range(300):
        exact = 100.0 + sum(
            k * tau / PERIOD * -math.expm1(-PERIOD / tau) * math.exp(-n * PERIOD / tau) for k, tau in TISSUE.branches
        )
        assert force(0.012) == pytest.approx(-2e-3 * exact, rel=1e-12)


def test_a_hundred_branches_share_a_spring_as_one_would() -> None:
    many = GeneralisedMaxwell("handle", rest=100.0, branches=((2.0, 0.1),) * 100).begin(PERIOD)
    one = GeneralisedMaxwell("handle", rest=100.0, branches=((200.0, 0.1),)).begin(PERIOD)
    for n in range(200):
        x = 0.01 * math.sin(0.05 * n)
        assert many(x) == pytest.approx(one(x), abs=1e-12)


def test_left_fast_and_touched_again_the_dent_is_still_there() -> None:
    """A slow branch holds the surface down: no push at half the depth, push again once it has recovered."""
    deep = GeneralisedMaxwell("handle", rest=50.0, branches=((300.0, 2.0),)).begin(PERIOD)
    for _ in range(20_000):
        deep(0.01)
    assert deep(0.005) == 0.0
    for _ in range(40_000):
        deep(-0.01)
    assert deep(0.005) < 0.0


def test_stability_sees_every_branch() -> None:
    space = TISSUE.linearised()
    assert space.order == 3
    assert sorted((-1.0 / space.a.diagonal()).tolist()) == pytest.approx([1e-5, 1e-3, 0.1])
    assert TISSUE.stiffness == 1100.0
    scaled = TISSUE.with_stiffness(550.0)
    assert (scaled.rest, scaled.branches) == (50.0, ((100.0, 0.1), (150.0, 1e-3), (250.0, 1e-5)))


def test_a_file_gives_branches_as_a_list_of_pairs() -> None:
    found = TypeAdapter(GeneralisedMaxwell).validate_json(
        '{"axis": "handle", "rest": 100, "branches": [[200, 0.1], [300, 0.001], [500, 1e-5]], "position": 0.01}'
    )
    assert found == TISSUE


@pytest.mark.parametrize(
    "wrong",
    [{"branches": []}, {"branches": [[1.0]]}, {"branches": [[0.0, 0.1]]}, {"branches": [[1.0, 0.0]]}, {"rest": 0.0}],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(GeneralisedMaxwell).validate_python(
            {"axis": "handle", "rest": 100.0, "branches": [[200.0, 0.1]], **wrong}
        )
