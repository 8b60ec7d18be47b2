"""Statements of a run about its energy ledgers, and of the cost of the controller."""

import numpy as np
import pytest

import haptic_fieldbus
from haptic_fieldbus.assessing.passivity import Controlled, Passivity, cost_text, forgiven_text
from haptic_fieldbus.sim.faults import FrameDropped
from haptic_fieldbus.sim.hand import Hand, Piece

COST = Controlled(energy=0.0123, peak=0.24, share=0.125, unit="N")


def test_the_cost_of_the_controller_is_one_sentence() -> None:
    found = Passivity(("handle",), 0.0, 0.005, {}, COST)
    assert cost_text(found) == (
        "the passivity controller absorbed 0.0123 J with at most 0.24 N, in 12 % of the periods"
    )
    assert cost_text(Passivity(("handle",), 0.0, 0.005, {}, None)) is None


def test_a_ledger_is_an_object_in_si_units() -> None:
    shown = Passivity(("left", "right"), 0.001, 0.005, {"change": 0.02, "gap": 0.06}, COST, 0.05, 2.0, 0.003).to_json()
    assert shown == {
        "axes": ["left", "right"],
        "largest_j": 0.001,
        "limit_j": 0.005,
        "booked_j": {"change": 0.02, "gap": 0.06},
        "forgiven_j": 0.05,
        "forgiven_limit_j": 2.0,
        "held_j": 0.003,
        "controller": {"energy_j": 0.0123, "peak": 0.24, "unit": "N", "share": 0.125},
    }


def test_a_budget_that_does_not_exist_is_null() -> None:
    shown = Passivity(("handle",), 0.0, 0.005, {}, None).to_json()
    assert isinstance(shown, dict)
    assert shown["forgiven_limit_j"] is None


def test_what_was_forgiven_is_one_sentence_with_its_reasons_and_its_budget() -> None:
    booked = {"gap": 0.08, "change": 1.0, "fade-in": 0.02}
    assert forgiven_text(Passivity(("handle",), 0.0, 0.005, booked, None, 0.06, 2.0)) == (
        "0.1 J more went into the handle than the scene had stored, because another force than that of the scene acted "
        "(fade-in, gap); at most 0.06 J within one second (limit 2 J)"
    )
    assert forgiven_text(Passivity(("handle",), 0.0, 0.005, {"gap": 0.004}, None, 0.004, 2.0)) is None


@pytest.mark.parametrize(("lost", "is_told"), [(20, True), (1, False)])
def test_lost_set_points_that_let_a_free_handle_swing_wider_are_told(lost: int, is_told: bool) -> None:
    """Of each 23 set-points, some are lost, and the drive holds its torque; the swing of the handle is the oracle."""
    flick = Hand("flick", (Piece(0.6, 12.0), Piece(0.64, 0.0)), release=0.7, mass=0.01, damping=0.2, stiffness=50.0)
    faults = [FrameDropped("frame_dropped", round(0.9 + 0.023 * each, 3), "rpdo", lost) for each in range(45)]
    result = haptic_fieldbus.run("spring", duration=1.9, hand=flick, faults=faults)
    (trace,) = result.traces
    first, last = (np.ptp(trace.position[np.abs(trace.times - middle) < 0.2]) for middle in (1.1, 1.7))
    assert (last > 1.1 * first) == is_told
    assert any("set-points may be lost" in warning for warning in result.warnings) == is_told
