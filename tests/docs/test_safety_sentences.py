"""Each sentence of a safety decision with *never*, *at most* or *within* has a test of what it says.

A new sentence needs a line in `TESTS`, and a test that fails without what it says.
"""

import re
from collections.abc import Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
DECISIONS = PROJECT / "docs" / "explanation" / "decisions"
CYCLE, PLANNING, SYSTEM = "tests/cycle/test_", "tests/planning/test_", "tests/system/test_"
SAFETY, PROBE = f"{CYCLE}safety.py::test_", f"{PLANNING}sign_probe.py::test_"
PLACE = f"{CYCLE}place.py::test_"
MEMORY = f"{PLACE}a_law_with_a_memory_is_drawn_back_by_the_motion_of_a_period_where_it_pushes_that_way"
DOUBT = f"{CYCLE}tied_axes.py::test_a_doubt_about_one_limits_the_other_as_well_until_contact_is_left"
BUDGET = f"{CYCLE}energy.py::test_more_within_a_second_than_is_forgiven_trips_and_the_same_over_more_seconds_does_not"
NO_GAP = f"{PLANNING}energy.py::test_no_gap_gives_more_than_force_times_speed_times_its_length"
ENCODER = f"{PLANNING}encoder_probe.py::test_"
SIGN, WATCH = f"{CYCLE}sign.py::test_", f"{CYCLE}sign_watch.py::test_"
HELD = f"{SIGN}while_nothing_is_seen_the_scene_goes_on_within_what_a_hand_may_hold"
GROW = f"{SIGN}pulses_grow_step_by_step_while_nothing_moves_and_never_beyond_the_bound"
BLOCKS = f"{WATCH}a_right_sign_is_never_doubted_and_a_wrong_one_within_a_tenth_of_a_second"
ANSWERS = f"{PLANNING}deadlines.py::test_feedback_that_one_of_two_drives_loses_ends_the_torque_of_both"
KEYS = f"{PLANNING}descriptive_keys.py::test_no_descriptive_key_of_a_rig_lifts_what_is_permitted"
LOWERED = f"{CYCLE}standstill.py::test_at_the_limit_the_force_is_lowered_slowly_and_no_pulse_goes_beyond_it"

FORGIVEN = f"{SYSTEM}energy_in_gaps.py::test_no_scene_of_the_library_trips_by_energy_in_gaps"
ALONE = f"{CYCLE}energy_in_gaps.py::test_a_handle_that_is_left_alone_is_given_no_power_that_is_felt"
CERTIFIED = "tests/api/test_certification.py::test_the_onset_of_a_bench_that_its_rig_describes_badly_"
LIMIT = "tests/planning/test_limit_of_a_plan.py::test_"
TESTS: dict[int, dict[str, str]] = {
    20: {},
    21: {
        "Time scales the *limit*, never": f"{SAFETY}a_small_force_is_whole_as_soon_as_the_limit_has_passed_it",
        "fades within 10 ms": f"{SAFETY}one_missing_period_is_held_and_a_longer_gap_fades_to_zero",
    },
    22: {},
    23: {"every 5 ms at most": f"{SYSTEM}set_points_that_are_asked.py::test_6071h_is_requested_every_5_ms_at_most"},
    25: {
        "is given at most 5 %": HELD,
        "blocks of 5 ms": BLOCKS,
        "back to 5 % within the 5 ms": DOUBT,
        "stays at 5 % at most": DOUBT,
        "otherwise never be more": f"{WATCH}the_first_time_that_a_sign_is_seen_leaves_no_cap",
    },
    26: {},
    31: {"1010h is never written": "tests/buses/canopen/test_max_torque.py::test_nothing_is_stored_in_the_drive"},
    39: {"within 5 s of its end": "tests/cli/test_output.py::test_a_stopped_terminal_holds_up_no_end"},
    40: {"never counted on it": ANSWERS},
    42: {
        "never raises a permission": KEYS,
        "At most 15 %": f"{PROBE}whatever_friction_is_told_no_pulse_is_above_the_bound",
        "never sees more than 3.3 %": GROW,
        "at most 30 %": f"{PROBE}more_than_30_percent_of_rated_torque_is_no_permission",
    },
    43: {
        "within 10 s are a trip": f"{CYCLE}other_masters.py::test_fewer_than_three_within_10_seconds",
        "Within a third of the deadline": f"{CYCLE}other_masters.py::test_a_burst_counts_as_one",
    },
    44: {
        "off by at most": f"{PLANNING}energy.py::test_the_trapezoid_of_a_law_is_off_by_a_quarter_of_its_slope_at_most",
        "within a budget for each second": BUDGET,
        "at most the limit F": f"{SAFETY}back_in_contact_the_force_stays_below_that_before_the_gap",
        "went at most v·t": NO_GAP,
        "last at most a fifth": f"{CYCLE}gaps.py::test_with_a_fifth_missing_no_margin_helps",
        "So gaps give at most": NO_GAP,
        "the most within a second": BUDGET,
    },
    45: {},
    46: {
        "within 50 ms": f"{ENCODER}a_pair_moves_two_counts_whatever_friction_held_before",
        "at most 8 % of the force": f"{ENCODER}no_pulse_is_felt_or_asked_for_later_than_ten_seconds",
        "never below 5 %": f"{ENCODER}force_that_a_hand_may_be_left_alone_with_asks_nothing",
        "within half a second": LOWERED,
    },
    47: {
        "for at most 10 ms": f"{SAFETY}after_a_short_gap_the_place_of_the_law_is_looked_after_until_the_force_is_back",
        "by at most the motion": MEMORY,
        "wall within a millimetre": f"{PLACE}a_wall_stays_where_it_is_under_a_hand_that_leans_and_trembles",
        "within the budget of 0044": FORGIVEN,
    },
    48: {
        "raises it by at most": f"{CYCLE}gaps.py::test_the_stretch_is_what_the_worst_timing_costs_in_stiffness",
        "divide the stiffness limit by at most": f"{CYCLE}gaps.py::test_no_pattern_that_is_permitted_grows",
        "they never did": f"{CYCLE}gaps.py::test_two_gaps_in_each_second_are_a_pattern",
    },
    49: {},
    55: {
        "is `stable` at most": "tests/margins/test_limit.py::test_above_the_limit_a_loop_is_not_called_passive",
        "at most 5 % of rated": f"{LIMIT}what_is_forced_above_its_limit_has_5_percent_of_rated_torque",
    },
    58: {
        "never takes up more energy": f"{PLACE}under_the_cap_of_a_gap_the_law_takes_up_no_more_than_the_hand_pays",
        "forgiven within the budget": FORGIVEN,
        "at most 50 mJ and 2 mW": ALONE,
    },
    62: {},
    68: {
        "never raises a limit": f"{PLANNING}known_bench.py::"
        "test_a_delay_that_was_measured_with_another_adapter_never_raises_the_limit",
    },
    77: {},
    78: {},
    79: {
        "at most 80 % of the predicted": f"{CERTIFIED}is_told_and_not_reached",
    },
    80: {
        "never replaces the note of a real bench": "tests/assessing/test_looking_back.py::"
        "test_a_note_of_the_simulation_takes_the_place_of_none_of_a_real_bench",
    },
    81: {
        "never raises a permitted torque": "tests/api/test_twin.py::test_a_twin_raises_no_permitted_torque",
    },
    85: {},
    86: {},
    87: {},
    88: {},
    92: {
        "never gets torque": "tests/running/test_loop.py::"
        "test_a_drive_that_enables_itself_before_it_is_commanded_gets_no_torque",
    },
    94: {},
}  # fmt: skip
"""By the number of the decision and a part of the sentence; a decision without such a sentence has none yet."""


def sentences(number: int) -> Iterator[str]:
    """Parameters with a bound, in what is decided and in what follows from it."""
    (path,) = DECISIONS.glob(f"{number:04}-*.md")
    parts = re.split(r"^## (.*)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    named = dict(zip(parts[1::2], parts[2::2], strict=True))
    for part in ("Decision", "Consequences"):
        for paragraph in re.split(r"\n\n|\n(?=- )", named[part]):
            for sentence in re.split(r"(?<=[.:?!])\*? (?=[A-Z*`])", " ".join(paragraph.split())):
                if re.search(r"\b(never|at most|within)\b", sentence, flags=re.IGNORECASE):
                    yield sentence


def test_each_sentence_of_a_safety_decision_with_a_bound_has_a_test() -> None:
    for number, tests in TESTS.items():
        bounds = list(sentences(number))
        without = [each for each in bounds if sum(part in each for part in tests) != 1]
        assert not without, f"{number:04}: one line of TESTS for each of these"
        gone = [part for part in tests if sum(part in each for each in bounds) != 1]
        assert not gone, f"{number:04}: no sentence has these any more"


def test_the_test_of_each_sentence_exists() -> None:
    for tests in TESTS.values():
        for named in tests.values():
            file, _, function = named.partition("::")
            assert f"def {function}(" in (PROJECT / file).read_text(encoding="utf-8"), named


def test_each_later_decision_about_torque_is_looked_at() -> None:
    """A decision that speaks of torque or force in its title or its first lines belongs into `TESTS`."""
    speaking = {
        int(path.name[:4])
        for path in DECISIONS.glob("[0-9]*.md")
        if int(path.name[:4]) > max(TESTS) and re.search(r"torque|force", path.read_text(encoding="utf-8"))
    }
    assert not speaking, "add these numbers to TESTS, with the tests of their sentences"
