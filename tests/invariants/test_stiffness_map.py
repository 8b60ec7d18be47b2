"""The checker on a simulated Modbus line: it sees what happens there, and finds what is broken."""

from dataclasses import replace

import pytest

from haptic_fieldbus.api import run
from tests.invariants.attach import watched
from tests.invariants.laws import LAWS
from tests.invariants.reading import axes_of, controlwords_of, set_points_of, words_of
from tests.invariants.witness import MASTER, Witness


@pytest.fixture(scope="module")
def witness() -> Witness:
    """A run in which the hand is in the wall for a while."""
    with watched(keep=True) as findings:
        run("wall", bus="sim-modbus-tcp", settings={"wall.stiffness": "max/2"}, duration=1.1)
    assert findings.broken == []
    (found,) = findings.witnesses
    return found


def test_commands_set_points_states_and_torques_are_written_down(witness: Witness) -> None:
    ((axis, shaft),) = axes_of(witness)
    assert [number for _, number in shaft.transitions][:3] == [2, 3, 4]
    words = [word for _, word in controlwords_of(witness, axis)]
    assert {6, 7, 15, 0} <= set(words)
    assert any(word & 0x6F == 0x27 for _, word in words_of(witness, axis.statusword, axis.node))
    wire = set_points_of(witness, axis, shaft)
    motor = [torque for _, torque in shaft.targets]
    assert min(wire[:, 1]) == pytest.approx(min(motor), abs=shaft.unit) != 0.0


@pytest.mark.parametrize("law", ["torque within limits", "slew within limits"])
def test_smaller_limits_than_those_that_were_kept_are_found_broken(law: str, witness: Witness) -> None:
    (axis,) = witness.stated.axes
    tighter = replace(axis, torque=0.02 * axis.torque, slew=0.001 * axis.slew)
    judged = replace(witness, stated=replace(witness.stated, axes=(tighter,)))
    assert list(LAWS[law](judged))
    assert not list(LAWS[law](witness))


def test_what_enables_again_is_found(witness: Witness) -> None:
    (axis,) = witness.stated.axes
    t_ns, can_id, octets, _ = next(frame for frame in witness.frames if frame[1] == axis.controlword.can_id)
    once_more = (witness.seen_ns, can_id, b"\x0f\x00" + octets[2:], MASTER)
    judged = replace(witness, frames=[*witness.frames, once_more])
    assert t_ns < witness.seen_ns
    assert list(LAWS["nothing enables again"](judged))
