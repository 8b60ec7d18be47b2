"""What a run says of its energy ledgers, and of the cost of the controller."""

from haptic_fieldbus.assessing.passivity import Controlled, Passivity, cost_text

COST = Controlled(energy=0.0123, peak=0.24, share=0.125, unit="N")


def test_the_cost_of_the_controller_is_one_sentence() -> None:
    found = Passivity(("handle",), 0.0, 0.005, {}, COST)
    assert cost_text(found) == (
        "the controller took 0.0123 J from the hand, with at most 0.24 N, in 12 % of the periods"
    )
    assert cost_text(Passivity(("handle",), 0.0, 0.005, {}, None)) is None


def test_a_ledger_is_an_object_in_si_units() -> None:
    shown = Passivity(("left", "right"), 0.001, 0.005, {"change": 0.02}, COST).to_json()
    assert shown == {
        "axes": ["left", "right"],
        "largest_j": 0.001,
        "limit_j": 0.005,
        "booked_j": {"change": 0.02},
        "controller": {"energy_j": 0.0123, "peak": 0.24, "unit": "N", "share": 0.125},
    }
