"""Bugs in the computation of limits, each with the cases of the report and the tests that must notice it.

Seven of them once stood in the package together, and all cases of the report passed; two survived as mutants. A bug
that no case or no test misses shows that something is computed and not judged.
"""

from dataclasses import dataclass
from pathlib import Path

MARGINS, NUMERICS = "haptic_fieldbus/margins", "haptic_fieldbus/numerics"
TESTS, LIMIT = "tests/margins", "tests/margins/test_passivity.py::TestPassiveLimit"

WORST_CORNER = "test_it_is_the_limit_at_the_longest_delay_and_lag_with_half_of_the_damping"
CONTRACT = "tests/scenes/test_element_contract.py"


@dataclass(frozen=True)
class Planted:
    """`text` of `file`, which stands there once, becomes `instead`; each of `cases` and of `tests` must fail."""

    file: str
    text: str
    instead: str
    cases: tuple[str, ...]
    tests: tuple[str, ...]

    def changed(self, text: str) -> str:
        """The text of the file with the bug; raises ValueError when its place is not there once."""
        if text.count(self.text) != 1:
            raise ValueError(f"{self.file} has its place {text.count(self.text)} times")
        return text.replace(self.text, self.instead)

    def apply(self, folder: Path) -> str:
        """Plant the bug in a checkout; return the file's text without it."""
        path = folder / self.file
        whole = path.read_text(encoding="utf-8")
        path.write_text(self.changed(whole), encoding="utf-8")
        return whole


PLANTED = {
    "torque lag gone from stability": Planted(
        f"{MARGINS}/plant.py",
        "sampled.sample(*through_torque_loop(*dynamics(plant), plant.torque_lag), period, delay)",
        "sampled.sample(*dynamics(plant), period, delay)",
        ("torque-lag",),
        (f"{TESTS}/test_bodies.py::test_a_stiff_transmission_is_one_mass",),
    ),
    "torque lag gone from passivity": Planted(
        f"{MARGINS}/passivity.py",
        "centre = 0.5 * period + delay + plant.torque_lag",
        "centre = 0.5 * period + delay",
        ("torque-lag",),
        (f"{LIMIT}::test_the_lag_of_the_torque_loop_costs_a_little_less_than_a_delay_of_the_same_time",),
    ),
    "torque lag gone from the largest gain": Planted(
        f"{MARGINS}/passivity.py",
        "largest_gain(base, added, plant.damping, period, delay, plant.torque_lag)",
        "largest_gain(base, added, plant.damping, period, delay)",
        ("torque-lag",),
        (f"{LIMIT}::test_the_limit_with_a_damper_needs_all_the_damping_there_is",),
    ),
    "a sign in the passivity spread": Planted(
        f"{NUMERICS}/passivity.py",
        "- 2.0 * first.real * gone / rate",
        "+ 2.0 * first.real * gone / rate",
        ("torque-lag",),
        ("tests/numerics/test_passivity.py::test_the_damping_needed_is_that_of_the_worst_motion_of_all_aliases",),
    ),
    "coupling reaction without its ratio": Planted(
        f"{NUMERICS}/coupled.py",
        "gain([first.tolist(), (-ratio * first).tolist()])",
        "gain([first.tolist(), (-first).tolist()])",
        ("coupled-axes",),
        (
            "tests/numerics/test_coupled.py::TestLoopMatrix::test_has_the_characteristic_polynomial_of_the_loop_written_by_hand",
        ),
    ),
    "coupled spread doubled": Planted(
        "haptic_fieldbus/margins/coupled.py",
        "spread = 0.5 * np.sqrt(",
        "spread = 1.0 * np.sqrt(",
        ("coupled-axes",),
        (
            "tests/numerics/test_coupled_passivity.py::TestAgainstTheFormula::test_with_its_share_the_hermitian_form_touches_zero",
        ),
    ),
    "edge chatter halved": Planted(
        "haptic_fieldbus/study/cases/friction.py",
        "return 2.0 * plant.resolution / (math.pi * gain)",
        "return 1.0 * plant.resolution / (math.pi * gain)",
        ("one-count-wall",),
        (
            f"{TESTS}/test_cycles.py::TestChatterOverTheEdgeOfACount::test_is_told_right_in_order_of_magnitude_when_it_lasts_a_few_samples_only",
        ),
    ),
    "damping asked without torque lag": Planted(
        f"{MARGINS}/closed_loop.py",
        "damping_needed(environment, self.period, axis.delay, axis.plant.torque_lag)",
        "damping_needed(environment, self.period, axis.delay)",
        ("torque-lag",),
        (f"{LIMIT}::test_the_lag_counts_in_the_damping_that_is_asked",),
    ),
    "damping asked at places without torque lag": Planted(
        f"{MARGINS}/closed_loop.py",
        "times = (period, self.delay, self.plant.torque_lag)",
        "times = (period, self.delay, 0.0)",
        ("varying-slope",),
        (f"{TESTS}/test_group.py::test_what_a_wall_asks_at_its_places_is_what_a_spring_asks_behind_a_torque_loop",),
    ),
    "bisection of passivity without torque lag": Planted(
        f"{MARGINS}/passivity.py",
        "damping_needed(environment, period, delay, plant.torque_lag)",
        "damping_needed(environment, period, delay)",
        ("torque-lag",),
        (f"{LIMIT}::test_the_lag_counts_where_the_limit_is_searched",),
    ),
    "torque lag gone from coupled energies": Planted(
        f"{MARGINS}/coupled.py",
        "PassivityPort(damping, axis.delay, axis.plant.torque_lag)",
        "PassivityPort(damping, axis.delay, 0.0)",
        ("coupled-axes",),
        (f"{TESTS}/test_coupled.py::TestPassiveLimit::test_needs_all_the_damping_there_is",),
    ),
    "coupling law without its ratio": Planted(
        "haptic_fieldbus/scenes/coupling.py",
        "force = shaft(first - ratio * second)\n            return force, -ratio * force",
        "force = shaft(first - ratio * second)\n            return force, -force",
        ("coupled-axes",),
        ("tests/scenes/test_coupling.py::test_a_rack_and_pinion_has_the_pinions_radius_as_its_ratio",),
    ),
    "torque lag gone from a load": Planted(
        f"{MARGINS}/bodies.py",
        "through_torque_loop(*dynamics(plant, bodies), plant.torque_lag)",
        "dynamics(plant, bodies)",
        ("compliant-transmission",),
        (
            f"{TESTS}/test_bodies.py::test_the_limit_with_a_compliant_transmission_is_where_the_loop_by_hand_begins_to_grow",
        ),
    ),
    "torque lag gone from ticks": Planted(
        "haptic_fieldbus/study/cases/timing.py",
        "through_torque_loop(*dynamics(plant), plant.torque_lag)",
        "dynamics(plant)",
        ("tick-phase",),
        (f"{TESTS}/test_schedules.py::test_a_constant_delay_is_a_pattern_of_one_period_or_two",),
    ),
    "a lost sample moves the estimator": Planted(
        f"{NUMERICS}/sampled.py",
        "environment = StateSpace(np.eye(inner), np.zeros((inner, inputs)), environment.c, environment.d)",
        "pass",
        ("missed-frames-pattern",),
        (f"{TESTS}/test_patterns.py::test_the_limit_is_where_the_loop_run_step_by_step_begins_to_grow",),
    ),
    "force returns in full after a gap": Planted(
        "haptic_fieldbus/cycle/safety.py",
        "permission.give_up_place()",
        "pass",
        ("fade-return",),
        ("tests/cycle/test_safety.py::test_back_in_contact_the_force_stays_below_that_before_the_gap",),
    ),
    "stiffest place alone is judged": Planted(
        f"{MARGINS}/stiffness_map.py",
        "at, growth = int(self._tried[growths.argmax()]), float(growths.max())",
        "at, growth = int(self._tried[self.stiffness[self._tried].argmax()]), "
        "float(growths[self.stiffness[self._tried].argmax()])",
        ("varying-slope",),
        (
            f"{TESTS}/test_false_verdicts.py::test_a_body_that_is_stable_deep_inside_is_refused_where_it_grows_near_the_surface",
        ),
    ),
    "friction 1 % too large": Planted(
        "haptic_fieldbus/numerics/batch.py",
        "= SampledMass(loops.mass, loops.damping, loops.coulomb)",
        "= SampledMass(loops.mass, loops.damping, 1.01 * loops.coulomb)",
        ("coarse-encoder", "coulomb-rescue", "local-stability"),
        ("tests/numerics/test_batch.py::test_friction_stops_a_free_mass_after_m_v2_over_2_fc",),
    ),
    "links of bodies 1 % too stiff": Planted(
        f"{MARGINS}/bodies.py",
        "link = np.array([body.stiffness, body.damping]) / mass",
        "link = 1.01 * np.array([body.stiffness, body.damping]) / mass",
        ("hand-lets-go", "compliant-transmission"),
        (
            f"{TESTS}/test_bodies.py::test_the_limit_with_a_compliant_transmission_is_where_the_loop_by_hand_begins_to_grow",
        ),
    ),
    "work of a force 1 % too large": Planted(
        "haptic_fieldbus/cycle/energy_steps.py",
        "self.early, self.late = share * unit, (1.0 - share) * unit",
        "self.early, self.late = 1.01 * share * unit, 1.01 * (1.0 - share) * unit",
        ("passivity-observer-timing", "passivity-observer-delay", "saturation-ledger"),
        ("tests/cycle/test_energy.py::test_a_contact_at_constant_speed_shows_its_leak_to_the_last_digit",),
    ),
    "least inertia of the worst case 0.9": Planted(
        f"{MARGINS}/plant.py",
        "INERTIA_SHARES: Range = (0.8, 1.25)",
        "INERTIA_SHARES: Range = (0.9, 1.25)",
        ("worst-of-ranges",),
        (f"{TESTS}/test_limit.py::{WORST_CORNER}",),
    ),
    "longest delay ignored": Planted(
        f"{MARGINS}/limit.py",
        "    time = (1.0 - delay) * low + delay * high",
        "    time = low",
        ("worst-of-ranges",),
        (f"{TESTS}/test_limit.py::{WORST_CORNER}",),
    ),
    "estimator's weight gone from the passivity bound": Planted(
        f"{MARGINS}/resting_points.py",
        "            damping *= weight(self.estimator, self.period)",
        "            pass",
        ("estimator-weight",),
        (f"{TESTS}/test_increments.py::test_a_damper_counts_by_what_its_estimator_makes_of_single_moves",),
    ),
    "velocity gone from the rounding that friction bridges": Planted(
        f"{MARGINS}/passivity.py",
        "(0.5 * self.slope + self.damping / period) * plant.resolution",
        "0.5 * self.slope * plant.resolution",
        ("rounding-bridged",),
        (f"{TESTS}/test_increments.py::test_friction_bridges_half_a_count_of_position_and_one_of_velocity",),
    ),
    "a magnet's stored energy doubled": Planted(
        "haptic_fieldbus/scenes/magnet.py",
        "self.radius**2 / 6.0",
        "self.radius**2 / 3.0",
        ("stored-energy",),
        ("tests/scenes/test_magnet.py::test_what_it_stores_is_what_its_force_takes_to_go_there",),
    ),
    "a magnet's outer slope missed": Planted(
        "haptic_fieldbus/scenes/magnet.py",
        "(-(0.6**0.5), 0.0, 0.6**0.5)",
        "(0.0,)",
        ("magnet-outside",),
        (f"{CONTRACT}::TestEveryElement::test_keeps_the_contract_that_others_hold_theirs_to",),
    ),
    "damping of the controller halved": Planted(
        "haptic_fieldbus/cycle/energy.py",
        "LEAKS = 2.0",
        "LEAKS = 1.0",
        ("controller-damping",),
        ("tests/cycle/test_energy_steps.py::test_the_controller_damps_by_twice_what_takes_the_leak_and_no_more",),
    ),
    "leak allowance doubled": Planted(
        "haptic_fieldbus/planning/energy.py",
        "AxisTerms(active, stiffness * age, age / period, ",
        "AxisTerms(active, 2.0 * stiffness * age, age / period, ",
        ("leak-allowance",),
        ("tests/cycle/test_energy.py::test_a_source_of_the_size_of_the_leak_is_seen_in_full",),
    ),
    "leak without half a period": Planted(
        "haptic_fieldbus/planning/energy.py",
        "age = 0.5 * period + axis.delay.total",
        "age = axis.delay.total",
        ("leak-allowance",),
        ("tests/cycle/test_energy.py::test_what_is_granted_is_the_leak_and_no_more",),
    ),
    "stretch of gaps without a square": Planted(
        "haptic_fieldbus/cycle/gaps.py",
        "surplus, periods = self._surplus, float(self._periods)",
        "surplus, periods = self._missing, float(self._periods)",
        ("gaps-given-up",),
        ("tests/cycle/test_gaps.py::test_a_loop_is_given_up_when_its_margin_is_used_up",),
    ),
    "moving contact from half of the fastest speed": Planted(
        "haptic_fieldbus/assessing/torque_error.py",
        "MOVING = 0.05",
        "MOVING = 0.5",
        ("score-by-hand",),
        ("tests/assessing/test_torque_error.py::test_what_is_scored_is_contact_in_which_the_handle_moves",),
    ),
    "score 2 % too large": Planted(
        "haptic_fieldbus/assessing/torque_error.py",
        "error_rms_contact=float(wrong)",
        "error_rms_contact=1.02 * float(wrong)",
        ("score-by-hand",),
        ("tests/assessing/test_torque_error.py::test_what_is_scored_is_contact_in_which_the_handle_moves",),
    ),
    "slope of a straight input 1 % wrong": Planted(
        f"{NUMERICS}/linear.py",
        "held - slope, slope",
        "held - slope, 1.01 * slope",
        ("straight-line-step",),
        ("tests/numerics/test_exact.py::test_hold_and_ramp_agree_with_scipy",),
    ),
}
