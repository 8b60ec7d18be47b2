"""Stiff and extreme cases by name, each with its own oracle.

An oracle is a closed form, a computation in extended precision, or brute force. Oracles of more than a line are in
`study.oracles`. Each case is a function whose docstring states the claim that it checks.
"""

from functools import partial

from haptic_fieldbus.study.case import Case
from haptic_fieldbus.study.cases import (
    closed_loop,
    drive,
    elements,
    friction,
    integrators,
    ledger,
    sensing,
    sharing,
    stated,
    timing,
)


def _named_alike(*cases: Case) -> dict[str, Case]:
    """Return cases by the names of their functions, with hyphens."""
    return {case.__name__.replace("_", "-"): case for case in cases}


CASES: dict[str, Case] = {
    **_named_alike(
        integrators.tiny_h, integrators.h_sweep, integrators.forward_euler_any_t, integrators.rk4_at_its_limit,
        integrators.semi_implicit_at_its_limit, integrators.lecture_constants, integrators.damper_b_equals_kt,
    ),
    "energy-drift-1e7-steps": integrators.energy_drift,
    **_named_alike(
        integrators.float_overflow, integrators.mass_to_zero, integrators.mass_zero_refused,
        integrators.mass_negative_refused, integrators.zero_input_stays_zero, closed_loop.stiff_held_puck,
        closed_loop.free_puck, closed_loop.light_puck, closed_loop.sampled_free_puck,
        closed_loop.start_inside_the_wall,
    ),
    "wall-at-boundary-below": partial(closed_loop.at_boundary, 1.0 - 1e-4),
    "wall-at-boundary-above": partial(closed_loop.at_boundary, 1.0 + 1e-4),
    "wall-1.5x-over": closed_loop.wall_over,
    "delay-half-sample": partial(closed_loop.delayed, 0.5),
    "delay-one-sample": partial(closed_loop.delayed, 1.0),
    "delay-two-samples": partial(closed_loop.delayed, 2.0),
    "delay-ten-samples": partial(closed_loop.delayed, 10.0),
    **_named_alike(
        closed_loop.slow_loop, closed_loop.undamped_wall, sharing.z_width_damping, sharing.z_width_delay,
        sharing.z_width_filter, sharing.pure_damper_limit, sharing.filtered_damper_passivity,
        sharing.half_sample_wall, sharing.bounce_energy, ledger.passivity_observer_timing,
        ledger.passivity_observer_delay, ledger.saturation_ledger, sharing.hand_lets_go,
        sharing.contact_shorter_than_a_sample, friction.coarse_encoder, friction.one_count_wall,
        friction.coulomb_rescue, friction.local_stability, sensing.velocity_quantisation,
        sensing.zero_transition_window, sensing.differentiator_tau_below_half_t, sensing.lecture_noise,
        sensing.tachometer_drift, sensing.tachometer_alias, sensing.jittered_sampling, sensing.dropped_frames,
        elements.hunt_crossley_fast_impact, elements.multi_scale_tissue, elements.lugre_fast_slip,
        elements.coulomb_stop, elements.detent_too_sharp, drive.lost_bus, drive.stale_position,
        drive.non_finite_input, drive.denormal_input, drive.encoder_wrap, drive.encoder_jump, drive.clock_backwards,
        drive.long_clock, drive.rotary_equals_linear, sensing.torque_lag, closed_loop.coupled_axes,
        closed_loop.compliant_transmission, elements.varying_slope, timing.missed_frames_pattern, timing.tick_phase,
        timing.fade_return, timing.gaps_given_up, ledger.leak_allowance, ledger.controller_damping,
        ledger.stored_energy, stated.worst_of_ranges, stated.estimator_weight, stated.rounding_bridged,
        stated.magnet_outside,
    ),
    "score-by-hand": stated.late_spring_score,
    **_named_alike(stated.straight_line_step, timing.modbus_one_period),
}  # fmt: skip
