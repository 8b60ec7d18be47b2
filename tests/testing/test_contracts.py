"""Contracts that anybody holds parts of his own to: ours keep them, and a planted fault is told."""

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus import UsageError, run
from haptic_fieldbus.numerics.estimators import ESTIMATORS, estimator_named
from haptic_fieldbus.numerics.estimators.estimator import EstimatorSetup
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import Law
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.hand import HANDS, Hand, Piece
from haptic_fieldbus.testing import check_element, check_estimator, check_hand, check_integrator
from tests.margins.own_drawn import BoundedPolynomial, Stated


@dataclass(frozen=True)
class Lawless:
    """All that an element has beside its law."""

    axis: str = "handle"
    stiffness: float = 100.0
    name: str = "mine"

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


class Spring(Lawless):
    """An element that keeps the contract; each class below breaks one clause of it."""

    def force(self, position: float) -> float:
        return -self.stiffness * position


@dataclass
class Thawed:
    """As `Spring`, and its values can be changed while it runs."""

    axis: str = "handle"
    stiffness: float = 100.0
    name: str = "mine"
    needs = Lawless.needs
    linearised = Lawless.linearised
    force = Spring.force


@dataclass(frozen=True)
class Remembering(Lawless):
    seen: list[float] = field(default_factory=list)

    def begin(self, period: float) -> Law:
        def law(position: float) -> float:
            self.seen.append(position)
            return -self.stiffness * sum(self.seen)

        return law


class Doubled(Spring):
    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.POSITION)

    def force(self, position: float, again: float) -> float:  # type: ignore[override]
        return -self.stiffness * position


class Braked(Spring):
    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, -1.0]])


class Misshapen(Spring):
    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness]])


class Steep(Spring):
    def force(self, position: float) -> float:
        return -2.0 * self.stiffness * position


class Whole(Spring):
    def force(self, position: float) -> float:
        return -100 if position > 0 else 0


class Endless(Spring):
    def force(self, position: float) -> float:
        return -self.stiffness * position / (1.0 if position < 1e3 else 0.0)


class Deaf(Spring):
    def force(self, position: float) -> float:
        return -self.stiffness * position if position == position else 0.0


@pytest.mark.parametrize(
    ("element", "fault"),
    [
        (Thawed(), "expected a frozen dataclass"),
        (Spring(name=7), "name: expected a text, not 7"),  # type: ignore[arg-type]
        (Lawless(), "expected one of force, begin and dynamics"),
        (Remembering(), "the memory of one acts on the other"),
        (Doubled(), "needs a signal twice"),
        (Braked(), "linearised() uses the velocity, which the element does not need"),
        (Misshapen(), "linearised() must return a StateSpace with 2 inputs and 1 output"),
        (Steep(), "stiffness 200 at "),
        (Whole(), "expected 1 finite float"),
        (Endless(), "ZeroDivisionError"),
        (Deaf(), "not-a-number becomes the force"),
        (Stated(lambda x: -100.0 * x - 2e5 * x**3, 100.0), "but it states -inf to 100"),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)
def test_an_element_that_breaks_a_clause_is_told(element: Any, fault: str) -> None:
    with pytest.raises(AssertionError) as caught:
        check_element(element)
    assert fault in str(caught.value)
    assert all(line.startswith(f"{element.name}: ") for line in str(caught.value).splitlines())


def test_an_element_that_keeps_the_contract_passes() -> None:
    check_element(Spring())
    check_element(Stated(lambda x: -100.0 * x - 2e5 * x**3, 700.0))
    check_element(BoundedPolynomial("a", 100.0, 0.0, 100.0, cube=2e3))


def test_bounds_that_do_not_hold_are_told() -> None:
    class Lying(BoundedPolynomial):
        def slope(self, away: float) -> float:
            return 1.0

    with pytest.raises(AssertionError, match="but it states"):
        check_element(Lying("a", 100.0, 0.0, 100.0, cube=2e3))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_our_estimators_keep_their_contract(name: str) -> None:
    check_estimator(estimator_named(name))


@pytest.mark.parametrize("name", METHODS)
def test_our_methods_keep_their_contract(name: str) -> None:
    check_integrator(METHODS[name])


@pytest.mark.parametrize("hand", [hand for hand in HANDS.values() if hand is not None], ids=lambda hand: hand.name)
def test_our_hands_keep_their_contract(hand: Hand) -> None:
    check_hand(hand)


DIFFERENCE = estimator_named("backward-difference")


def starting(first: float, factor: float) -> Callable[[EstimatorSetup], Any]:
    """A step whose first velocity and whose scale are wrong."""

    def start(setup: EstimatorSetup) -> Any:
        last: float | None = None

        def step(position: float) -> float:
            nonlocal last
            before, last = last, position
            return first if before is None else factor * (position - before) / setup.period

        return step

    return start


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"start": starting(1.0, 1.0)}, "the first velocity is 1.0; expected 0"),
        ({"start": starting(0.0, 1.1)}, "the step does not do what system says"),
        ({"start": starting(0.0, 1.1), "system": None}, "at a constant 0.1"),
        ({"start": lambda setup: lambda position: float("nan")}, "a velocity is not a finite float"),
        ({"start": lambda setup: lambda position: 1 / 0}, "velocity: ZeroDivisionError: division by zero"),
        ({"system": None, "stand_in": lambda setup: "levant"}, 'stand_in "levant" is not linear'),
        (
            {"system": lambda setup: StateSpace(np.array([[1.5]]), np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)))},
            "system is not stable",
        ),
    ],
)
def test_an_estimator_that_breaks_a_clause_is_told(changes: dict[str, Any], fault: str) -> None:
    with pytest.raises(AssertionError) as caught:
        check_estimator(replace(DIFFERENCE, name="mine", **changes))
    assert fault in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"oscillator_growth": lambda h: 1.0}, "on an oscillator of h = 0.1, claimed 1"),
        ({"growth": lambda product: 1.0}, "growth 0.7 of a decay with λ·T = -0.3, claimed 1"),
        ({"free_order": 2.0}, "error of a free motion falls with order 1.0"),
        ({"order": 2}, "error of a driven motion falls with order 1.0"),
        ({"oscillator_limit": 0.5}, "oscillator_limit 0.5: spectral radius 1.1"),
        ({"oscillator_limit": math.inf}, "oscillator_limit inf: spectral radius 1000.0"),
        ({"lag_limit": 1.99}, "lag_limit 1.99: spectral radius 0.99"),
        ({"lag_limit": 2.01}, "lag_limit 2.01: spectral radius 1.0"),
        ({"lag_limit": 0.0}, "lag_limit 0: spectral radius 0.9"),
        ({"discretise": METHODS["rk4"].discretise}, "on an oscillator of h = "),
        ({"discretise": lambda space, period: 1 / 0}, "rest: ZeroDivisionError"),
    ],
)
def test_a_method_that_breaks_a_clause_is_told(changes: dict[str, Any], fault: str) -> None:
    with pytest.raises(AssertionError) as caught:
        check_integrator(replace(METHODS["forward-euler"], name="mine", **changes))
    assert fault in str(caught.value)


@pytest.mark.parametrize(
    ("name", "limit"), [("verlet", 1.99), ("verlet", 2.01), ("verlet", 0.0), ("rk4", 2.82), ("rk4", 2.84)]
)
def test_a_limit_that_is_not_that_of_the_method_is_told(name: str, limit: float) -> None:
    """Verlet's is 2, that of rk4 2·√2."""
    with pytest.raises(AssertionError, match=f"oscillator_limit {limit:.9g}: spectral radius"):
        check_integrator(replace(METHODS[name], oscillator_limit=limit))


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"mass": 0.0}, "mass is 0.0; expected a finite number above 0"),
        ({"damping": -1.0}, "damping is -1.0; expected a finite number from 0 up"),
        ({"pieces": (Piece(1.0, 2.0), Piece(0.5, 2.0))}, "each later than the one before"),
        ({"pieces": (Piece(0.0, float("nan")),)}, "not a finite number"),
        ({"release": -1.0}, "release is -1.0 s"),
        ({"release": "1"}, "release is '1'; expected a number"),
        ({"name": "push"}, "name is 'push'; expected a text that no shipped hand has"),
        ({"name": 3}, "name is 3; expected a text"),
        ({"mass": "1"}, "mass is '1'; expected a number"),
        ({"mass": 1e-300}, "mass is 1e-300; expected more"),
        ({"pieces": ((0.0, 1.0),)}, "pieces has (0.0, 1.0); expected objects of Piece"),
        ({"pieces": None}, "pieces has None; expected objects of Piece"),
        ({"pieces": (Piece("0", 1.0),)}, "start is '0'; expected a number"),  # type: ignore[arg-type]
    ],
)
def test_a_hand_that_cannot_be_simulated_is_told(changes: dict[str, Any], fault: str) -> None:
    with pytest.raises(AssertionError) as caught:
        check_hand(replace(Hand("mine"), **changes))
    assert fault in str(caught.value)


@pytest.mark.parametrize("changes", [{"mass": "1"}, {"mass": 1e-300}, {"pieces": ((0.0, 1.0),)}], ids=str)
def test_a_run_refuses_a_hand_that_the_check_refuses(changes: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r'hand "mine": (mass|pieces) '):
        run("wall", duration=0.01, hand=replace(Hand("mine"), **changes))


@pytest.mark.parametrize(
    ("check", "expected"),
    [
        (
            check_element,
            "element: expected an object with name, needs, linearised, axis or axes, a law, not 3 (int)",
        ),
        (check_estimator, "estimator: expected an object of Estimator, not 3 (int)"),
        (check_integrator, "integrator: expected an object of Integrator, not 3 (int)"),
        (check_hand, "hand: expected an object of Hand, not 3 (int)"),
    ],
)
def test_what_is_no_part_is_a_type_error(check: Callable[[Any], None], expected: str) -> None:
    with pytest.raises(TypeError) as caught:
        check(3)
    assert str(caught.value) == expected


def test_a_class_in_the_place_of_an_element_is_a_type_error() -> None:
    with pytest.raises(TypeError, match="element: expected an object with name"):
        check_element(Spring)  # type: ignore[arg-type]


def test_an_element_without_an_axis_is_a_type_error() -> None:
    """Its law is there; to name that as missing would mislead."""

    @dataclass(frozen=True)
    class Nowhere:
        name: str = "nowhere"
        needs: tuple[Signal, ...] = (Signal.POSITION,)

        def linearised(self) -> StateSpace:
            return gain([[-1.0, 0.0]])

        def force(self, position: float) -> float:
            return -position

    with pytest.raises(
        TypeError, match="element: expected an object with name, needs, linearised, axis or axes, a law"
    ):
        check_element(Nowhere())


@pytest.mark.parametrize(
    "reach", [(0.0, 0.0), (0.0, -1.0), (0.0, math.nan), (0.0, 1e300), (math.inf, 1.0), (1.0,), 3, ("a", "b")]
)
def test_a_reach_that_is_none_is_a_type_error(reach: Any) -> None:
    """At a single place every element holds its bounds."""
    with pytest.raises(TypeError, match="reach: expected a middle, and an amplitude above 0 and below 1e6, not"):
        check_element(Spring(), reach)


def test_the_contracts_need_no_pytest() -> None:
    program = "import sys, haptic_fieldbus.testing as t; t.check_hand; print('pytest' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["False"]
