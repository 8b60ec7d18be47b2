"""Each element gets the signals that it declared, in its order, and the forces of all are added."""

import itertools

import pytest

from haptic_fieldbus.cycle.laws import READERS, Sensed, law_of, summed, with_signals
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.signals import Signal

SENSED = Sensed(velocity=2.0, torque_actual=3.0, elapsed_ns=4)
VALUES = {Signal.POSITION: 1.0, Signal.VELOCITY: 2.0, Signal.TORQUE_ACTUAL: 3.0, Signal.ELAPSED_NS: 4}
NEEDS = [needs for count in range(3) for needs in itertools.permutations(READERS, count)]


def told(*values: float) -> float:
    """A law whose force names its arguments: digits of a number, the first signal in the first place."""
    return float("0" + "".join(f"{value:.0f}" for value in values))


@pytest.mark.parametrize("needs", NEEDS, ids=lambda needs: "+".join(signal.name for signal in needs) or "none")
def test_a_law_gets_the_signals_that_it_needs(needs: tuple[Signal, ...]) -> None:
    assert with_signals(told, needs, SENSED)(1.0) == told(*(VALUES[signal] for signal in needs))


def test_what_is_sensed_later_is_what_a_law_gets() -> None:
    sensed = Sensed()
    field = with_signals(told, (Signal.VELOCITY,), sensed)
    sensed.velocity = 7.0
    assert field(0.0) == 7.0


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_the_forces_of_all_elements_are_added(count: int) -> None:
    fields = [lambda position, slope=10.0**each: slope * position for each in range(count)]
    assert summed(fields)(2.0) == sum(2.0 * 10.0**each for each in range(count))


def test_a_coupling_has_no_law_of_one_axis() -> None:
    with pytest.raises(TypeError, match="shaft is no static, memory or dynamic element"):
        law_of(Coupling(("left", "right"), stiffness=100.0, name="shaft"), 1e-3)
