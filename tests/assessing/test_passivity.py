"""Statements of a run about its energy ledgers, and of the cost of the controller."""

from haptic_fieldbus.assessing.passivity import Controlled, Passivity, cost_text, forgiven_text

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
        "0.1 J more went into the handle than the scene had stored, because the force had been reduced before "
        "(fade-in, gap); at most 0.06 J within one second (limit 2 J)"
    )
    assert forgiven_text(Passivity(("handle",), 0.0, 0.005, {"gap": 0.004}, None, 0.004, 2.0)) is None
