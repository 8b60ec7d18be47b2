"""Every guard between a scene and a hand, each with the change that removes it and the tests that must notice.

A guard that no test misses is a guess. A new guard gets a line here; `tests/test_guards_removed.py` takes them out, one
at a time, in a copy of the checkout.
"""

from dataclasses import dataclass

CYCLE, BUSES, RUNNING = "tests/cycle/test_cycle.py", "tests/buses/canopen", "tests/running/test_loop.py"


@dataclass(frozen=True)
class Guard:
    """A guard: `text` of `file`, which stands there once, becomes `instead`, and one of `tests` must fail."""

    file: str
    text: str
    instead: str
    tests: tuple[str, ...]


def _cycle(file: str, text: str, instead: str, *tests: str, of: str = CYCLE) -> Guard:
    return Guard(f"haptic_fieldbus/cycle/{file}.py", text, instead, tuple(f"{of}::{test}" for test in tests))


def _bus(file: str, text: str, instead: str, of: str, *tests: str) -> Guard:
    named = tuple(f"{BUSES}/{of}.py::{test}" for test in tests)
    return Guard(f"haptic_fieldbus/buses/canopen/{file}.py", text, instead, named)


def _line(file: str, text: str, instead: str, of: str, *tests: str) -> Guard:
    named = tuple(f"tests/buses/modbus/{of}.py::{test}" for test in tests)
    return Guard(f"haptic_fieldbus/buses/modbus/{file}.py", text, instead, named)


PROVING = "tests/running/test_guard_proof.py"
SAFETY, ECHO, PLACE = "tests/cycle/test_safety.py", "tests/cycle/test_echo.py", "tests/cycle/test_place.py"
BENCH = "tests/planning/test_known_bench.py::"
STILL = "tests/cycle/test_standstill.py"
SIGN, SIGN_WATCH, TIED = "tests/cycle/test_sign.py", "tests/cycle/test_sign_watch.py", "tests/cycle/test_tied_axes.py"

GUARDS = {
    "torque only in operation enabled": _cycle(
        "cycle",
        "states = [axis.state.power for axis in self.axes.values()]",
        "states = [PowerState.OPERATION_ENABLED]",
        "test_below_operation_enabled_torque_is_zero_and_the_next_transition_is_asked",
    ),
    "a trip is final": _cycle(
        "cycle",
        "self.enabled = self.trip is None and all(",
        "self.enabled = all(",
        "test_a_drive_that_leaves_operation_enabled_is_not_enabled_again",
    ),
    "after a trip the voltage is disabled": _cycle(
        "axis", "self.state.controlword = self.axis.power.off", "pass", "test_a_trip_is_final"
    ),
    "faults of the link": _cycle("axis", "if flags & bit:", "if False:", "test_each_fault_of_the_link_trips_at_once"),
    "age of the feedback": _cycle(
        "axis",
        "if rendering and feedback[AGE_NS] > self._oldest_ns:",
        "if False:",
        "test_stale_feedback_is_held_then_fades_to_zero_and_trips_at_its_age",
    ),
    "clock that goes back": _cycle(
        "axis", "if elapsed_ns < 0:", "if False:", "test_samples_whose_time_goes_back_are_given_up"
    ),
    "periods missed in a row": _cycle(
        "axis",
        "if not lost and passed > self._limits.age:",
        "if False:",
        "test_a_loop_that_slept_for_longer_than_feedback_may_be_old_is_given_up",
    ),
    "too many gaps": _cycle(
        "axis",
        "if self.gaps.too_many:",
        "if False:",
        "test_a_loop_that_misses_a_fifth_of_its_periods_is_given_up",
    ),
    "gaps beyond the margin": _cycle(
        "gaps",
        "return len(self._last) >= FEWEST_GAPS and self.stretch > self._largest",
        "return False",
        "test_a_loop_is_given_up_when_its_margin_is_used_up",
        of="tests/cycle/test_gaps.py",
    ),
    "speed": _cycle(
        "axis",
        "if abs(way) > limits.speed * passed + self._resolution:",
        "if False:",
        "test_a_position_jump_beyond_the_speed_limit_trips",
    ),
    "range": _cycle(
        "axis",
        "if not self._lowest <= here <= self._highest:",
        "if False:",
        "test_leaving_the_position_limits_trips",
    ),
    "acceleration": _cycle(
        "axis",
        "if change > self._jump * widest**2",
        "if False and change > self._jump * widest**2",
        "test_a_jump_that_no_motion_can_make_trips",
    ),
    "power": _cycle("axis", "if power > limit:", "if False:", "test_power_beyond_the_limit_trips"),
    "drive fault": _cycle(
        "axis", "if state.power in FAULT_STATES:", "if False:", "test_a_fault_state_trips_whether_enabled_or_not"
    ),
    "drive disabled": _cycle(
        "axis",
        "elif WAY.get(state.power, 0) < WAY.get(before, 0):",
        "elif False:",
        "test_a_drive_that_leaves_operation_enabled_is_not_enabled_again",
    ),
    "force at the start": _cycle(
        "axis",
        "if self.is_deep:",
        "if False:",
        "test_a_start_with_a_large_force_is_refused_with_the_place_that_would_do",
    ),
    "a start without feedback": _cycle(
        "cycle",
        "if not all(axis.state.steps for axis in axes):",
        "if False:",
        "test_a_large_force_is_refused_also_when_feedback_comes_later_than_the_power_state",
        of="tests/cycle/test_first_period.py",
    ),
    "counts that stand still": _cycle(
        "axis",
        "if abs(effort) > holding and self.permission.cap > holding:",
        "if False:",
        "test_counts_that_stand_still_under_torque_lower_the_limit_and_no_more",
    ),
    "an encoder that stands still": _cycle(
        "standstill",
        "if self.vain >= PAIRS:",
        "if False:",
        "test_an_encoder_that_no_pulse_moves_is_a_trip_within_the_stated_time",
        of=STILL,
    ),
    "pulses to an encoder within the limit": _cycle(
        "standstill",
        "lowered = max(0.0, size + probe.effort - bound)",
        "lowered = 0.0",
        "test_at_the_limit_the_force_is_lowered_slowly_and_no_pulse_goes_beyond_it",
        of=STILL,
    ),
    "pulses to an encoder that no hand feels": _cycle(
        "standstill",
        " and abs(self._state.target) >= self._least",
        "",
        "test_below_the_force_whose_pulses_are_not_felt_the_rule_of_long_standstill_stays",
        of=STILL,
    ),
    "pulses to an encoder are judged in whole pairs": _cycle(
        "standstill",
        "self._place + 1 if t_ns - self._last_ns < self._longest_ns else 0",
        "self._place + 1",
        "test_a_gap_begins_the_pair_anew_and_takes_nothing_from_the_force",
        of=STILL,
    ),
    "force not finite": _cycle(
        "axis", "if permitted != permitted:", "if False:", "test_a_force_that_is_not_finite_trips_and_writes_zero"
    ),
    "an element that raises": _cycle(
        "cycle",
        "except Exception as error:",
        "except MemoryError as error:",
        "test_an_element_that_raises_takes_the_torque_away_and_is_named",
    ),
    "one gap of several tied axes": _cycle(
        "cycle",
        "state.holding = self._apart",
        "pass",
        "test_axes_that_a_coupling_ties_fade_together",
        of=TIED,
    ),
    "samples that tied axes miss by turns": _cycle(
        "cycle",
        "self._apart + 1 if",
        "1 if",
        "test_axes_that_miss_samples_by_turns_fade_too",
        of=TIED,
    ),
    "the age of a sample in its period": _cycle(
        "axis",
        "and feedback[AGE_NS] <= oldest_ns",
        "and True",
        "test_feedback_that_comes_in_its_period_and_is_too_old_trips",
    ),
    "effort limit": _cycle(
        "safety",
        "if -bound <= force <= bound:",
        "if True:",
        "test_effort_is_clamped_on_both_sides",
        of=SAFETY,
    ),
    "fade-in of the limit": _cycle(
        "safety",
        "permission.fade = min(1.0, permission.fade + growth)",
        "permission.fade = 1.0",
        "test_the_limit_fades_in_linearly_from_the_first_period",
        of=SAFETY,
    ),
    "slew after every gain": _cycle(
        "safety",
        "if not -largest_change <= force - before <= largest_change:",
        "if False:",
        "test_slew_bounds_the_change_of_a_period_in_both_directions",
        of=SAFETY,
    ),
    "fade of a gap": _cycle(
        "safety",
        "share = max(0.0, 1.0 - (missing - 1) / fading)",
        "share = 1.0",
        "test_one_missing_period_is_held_and_a_longer_gap_fades_to_zero",
        of=SAFETY,
    ),
    "cap after a gap": _cycle(
        "safety",
        "if permission.blind and missing > soon and not permission.is_long:",
        "if False:",
        "test_back_in_contact_the_force_stays_below_that_before_the_gap",
        of=SAFETY,
    ),
    "the law pauses in a short gap": _cycle(
        "gaps",
        "permission.shift += way",
        "pass",
        "test_detents_with_gaps_at_their_valleys_give_a_hand_no_energy",
        of=PLACE,
    ),
    "the law goes on pausing until the force is back": _cycle(
        "safety",
        "self.blind = not arrived and self.returning < longest",
        "self.blind = False",
        "test_after_a_short_gap_the_place_of_the_law_is_looked_after_until_the_force_is_back",
        of=SAFETY,
    ),
    "energy of torque held in gaps": _cycle(
        "energy",
        "if held > HELD_ENERGY:",
        "if False:",
        "test_torque_held_across_a_valley_is_charged_and_ends_the_run",
        of=PLACE,
    ),
    "little force until the sign is seen": _cycle(
        "safety",
        "bounded(permission.proof(force), unseen)",
        "bounded(force, effort)",
        "test_a_doubt_about_one_limits_the_other_as_well_until_contact_is_left",
        of=TIED,
    ),
    "a wrong sign": _cycle(
        "sign",
        "self._trip(TripKind.SIGN, 0.5 * pair, stage.effort)",
        "pass",
        "test_the_shipped_bench_decides_within_a_tenth_of_a_second",
        of=SIGN,
    ),
    "every pulse must agree": _cycle(
        "sign",
        "elif not self._agree(math.copysign(1.0, first)):",
        "elif False:",
        "test_a_hand_that_goes_to_and_fro_rigidly_decides_nothing",
        of=SIGN,
    ),
    "motion against the torque while the scene runs": _cycle(
        "plausibility",
        "self._doubt()",
        "pass",
        "test_a_right_sign_is_never_doubted_and_a_wrong_one_within_a_tenth_of_a_second",
        of=SIGN_WATCH,
    ),
    "one sign that is unseen of several": _cycle(
        "cycle",
        "if all(each.sign.proof is None",
        "if True or all(each.sign.proof is None",
        "test_forces_of_two_axes_wait_until_both_signs_are_seen",
        of=SIGN_WATCH,
    ),
    "a handle that goes to the other side": Guard(
        "haptic_fieldbus/running/proofs.py",
        "if way < 0.0:",
        "if False:",
        ("tests/running/test_direction.py::test_a_handle_that_goes_down_is_refused_with_the_key_to_change",),
    ),
    "contact while the sign is looked for": _cycle(
        "safety",
        "permission.leave_contact(force, least)",
        "permission.leave_contact(permission.before, least)",
        "test_a_proof_of_the_sign_leaves_no_contact",
        of=SAFETY,
    ),
    "the cap of all axes after a doubt": _cycle(
        "sign",
        "self._owner.sign_doubted()",
        "pass",
        "test_a_doubt_about_one_limits_the_other_as_well_until_contact_is_left",
        of=TIED,
    ),
    "the cap when a doubt is over": _cycle(
        "sign",
        "if deep or permission.fade > 0.0:",
        "if False:",
        "test_a_doubt_about_one_limits_the_other_as_well_until_contact_is_left",
        of=TIED,
    ),
    "the cap of a handle that was pushed deep meanwhile": _cycle(
        "sign",
        "if deep or permission",
        "if permission",
        "test_a_handle_that_a_hand_pushed_deep_during_the_first_proof_is_not_thrown_out",
        of="tests/cycle/test_sign_watch.py",
    ),
    "the cap of an axis whose sign is known": _cycle(
        "cycle",
        "if any(axis.sign.proof for axis in axes):",
        "if False:",
        "test_an_axis_whose_sign_is_known_waits_for_that_of_the_other",
        of=TIED,
    ),
    "set-points that do not act": _cycle(
        "plausibility",
        "if waited_ns > self._deadline_ns:",
        "if False:",
        "test_a_drive_that_no_longer_hears_trips_in_time",
        of=ECHO,
    ),
    "set-points of another master": _cycle(
        "plausibility",
        "if len(seen) == FOREIGN_TIMES and passed <= FOREIGN_WITHIN:",
        "if False:",
        "test_the_trip_names_the_bus_what_was_shown_and_what_was_sent",
        of="tests/cycle/test_other_masters.py",
    ),
    "a target that is read back": _line(
        "exchange",
        "self._targets, self._present = (*others, first), (first, *self._readings)",
        "pass",
        "test_read_back",
        "test_it_goes_out_first_and_alone",
    ),
    "feedback that is more than a period late": _bus(
        "setup",
        "if took_ns <= period_ns:",
        "if True:",
        "test_late_answers",
        "test_a_drive_that_answers_more_than_a_period_late_is_refused_before_torque",
    ),
    "silence of the drive": _bus(
        "link",
        "if now_ns - node.heartbeat_ns > self._silence_ns:",
        "if False:",
        "test_master",
        "test_a_heartbeat_that_stays_away_for_three_times_its_period_is_flagged",
    ),
    "NMT state of the drive": _bus(
        "link",
        "if node.state != _OPERATIONAL:",
        "if False:",
        "test_master",
        "test_a_heartbeat_that_names_another_state_is_flagged",
    ),
    "restart of the drive": _bus(
        "link", "if node.booted:", "if False:", "test_master", "test_a_restart_is_flagged_for_good"
    ),
    "emergency": _bus(
        "link",
        "if node.emergency:",
        "if False:",
        "test_master",
        "test_an_emergency_is_flagged_with_its_code_until_it_is_reset",
    ),
    "feedback of the wrong length": _bus(
        "link",
        "if len(data) != self._size:",
        "if False:",
        "test_master",
        "test_a_tpdo_of_the_wrong_length_is_refused",
    ),
    "feedback of the period before": _bus(
        "link",
        "if not exchange.taking:",
        "if False:",
        "test_master",
        "test_a_late_tpdo_is_not_taken_for_the_next_period",
    ),
    "a second node": _bus(
        "link",
        "if self.owed < 0:",
        "if False:",
        "test_other_master",
        "TestDuplicates::test_feedback_that_comes_twice_for_one_sync_is_flagged",
    ),
    "bus-off": _bus(
        "master",
        "flags = BUS_OFF * wire.error_frames.bus_off |",
        "flags =",
        "test_master",
        "test_bus_off_is_flagged_on_every_axis",
    ),
    "set-points that cannot be sent": _bus(
        "master",
        "accepted &= self._wire.offer(",
        "self._wire.offer(",
        "test_master",
        "test_a_full_queue_drops_set_points_and_is_an_exception_when_it_lasts",
    ),
    "somebody else in the loop": _bus(
        "other_master",
        "if weight is Severity.COMMAND and self.cob_id is None:",
        "if False:",
        "test_other_master",
        "test_a_command_of_somebody_else_is_flagged_with_its_cob_id_and_stays_so",
    ),
    "somebody else before": _bus(
        "master",
        "heard.refuse(traffic.master_node)",
        "pass",
        "test_listening",
        "test_a_bus_with_a_master_is_refused_and_nothing_is_sent",
    ),
    "somebody else while a person thought": _bus(
        "master",
        'self._foreign.refuse(self._wire.name, "Nothing was written")',
        "pass",
        "test_other_master",
        "TestBeforeTheLoop::test_a_master_that_came_while_a_person_thought_is_refused_before_anything_is_written",
    ),
    "life guarding begins with our requests": _bus(
        "guard",
        "[node.guarding_request for node in nodes if node.guarded]",
        "[]",
        "test_guard",
        "TestAnswers::test_answers_are_the_sign_of_life_and_the_nmt_state",
    ),
    "a toggle bit that stands still": _bus(
        "node",
        "if self._toggle != before:",
        "if True:",
        "test_guard",
        "TestAnswers::test_a_toggle_bit_that_stands_still_is_no_sign_of_life",
    ),
    "a request of somebody else feeds the guard": _bus(
        "other_master",
        "Severity.COMMAND for node in guarded",
        "Severity.QUESTION for node in guarded",
        "test_guard",
        "TestSomebodyElse::test_a_request_in_the_loop_is_a_command",
    ),
    "a heartbeat beside life guarding": _bus(
        "guard", "if held:", "if False:", "test_guard", "TestConfiguration::test_a_heartbeat_that_is_on_is_switched_off"
    ),
    "answers about the set-points that stay away": _cycle(
        "plausibility",
        "doubt.unanswered(t_ns - heard_ns, sent[0])",
        "pass",
        "test_answers_that_stay_away_are_a_trip_in_the_stated_time",
        of="tests/cycle/test_asked_echo.py",
    ),
    "answers that belong to another question": _bus(
        "master",
        "LATEST * self._patience_ns if self._repeated else self._every_ns",
        "self._every_ns",
        "test_target_readback",
        "TestAnswers::test_after_a_repetition_nothing_is_asked_until_the_other_answer_can_come_no_more",
    ),
    "the drive's watch on us": _bus(
        "setup",
        "self._guard_link()\n",
        "pass\n",
        "test_setup",
        "test_a_drive_is_configured_entry_by_entry_in_the_order_of_the_standard",
    ),
    "read-back of what was written": _bus(
        "node",
        "if held != value:",
        "if False:",
        "test_setup",
        "test_a_drive_that_cannot_be_configured_is_left_pre_operational_and_never_enabled",
    ),
    "torque limit in the drive": _bus(
        "setup",
        "self.torque_limits.configure()",
        "pass",
        "test_max_torque",
        "test_a_higher_limit_is_lowered_for_the_time_of_the_run",
    ),
    "another drive than that of the profile": _bus(
        "setup",
        "if wrong_vendor or wrong_product:",
        "if False:",
        "test_setup",
        "test_a_wrong_drive_is_refused_before_anything_is_written",
    ),
    "rated torque of the rig": Guard(
        "haptic_fieldbus/buses/torque_limits.py",
        "if expected is not None and abs(rated - expected)",
        "if False and abs(rated - expected)",
        (f"{BUSES}/test_setup.py::test_a_wrong_drive_is_refused_before_anything_is_written",),
    ),
    "torque-free set-points at the end": _bus(
        "master",
        "        self._send_set_points()\n        self._step(now_ns)",
        "        self._step(now_ns)",
        "test_release",
        "test_set_points_and_downloads_to_all_drives_go_out_before_anything_is_waited_for",
    ),
    "controlword 0 by SDO at the end": _bus(
        "master",
        "ASK if self._sent == DISABLE else DISABLE",
        "ASK",
        "test_release",
        "test_a_drive_whose_set_points_do_not_act_is_freed_within_milliseconds_at_any_rate",
    ),
    "no failure keeps an axis from being freed": _bus(
        "master",
        "except Exception as error:",
        "except MemoryError as error:",
        "test_release",
        "test_a_frame_that_cannot_be_sent_keeps_no_axis_from_being_freed",
        "test_a_full_disk_keeps_no_axis_from_being_freed",
    ),
    "no bus keeps another from being freed": Guard(
        "haptic_fieldbus/buses/bus.py",
        "except Exception as error:",
        "except MemoryError as error:",
        ("tests/buses/test_group.py::test_a_bus_that_raises_although_it_must_not_keeps_no_other_from_being_freed",),
    ),
    "the end of every loop": Guard(
        "haptic_fieldbus/running/loop.py",
        "report.released = bus.stop()",
        "report.released = True",
        (
            f"{RUNNING}::test_ctrl_c_stops_torque_free_and_is_no_error",
            f"{RUNNING}::test_torque_is_off_on_the_wire_before_the_exception",
        ),
    ),
    "a drive that nobody has commanded": Guard(
        "haptic_fieldbus/running/loop.py",
        "raise enabled_by_itself(at.axis, at.state.power)",
        "asked.add(name)",
        (f"{RUNNING}::test_a_drive_that_enables_itself_before_it_is_commanded_gets_no_torque",),
    ),
    "an end that no drive confirmed": Guard(
        "haptic_fieldbus/running/loop.py",
        "    if not report.released:\n        raise BusError",
        "    if False:\n        raise BusError",
        (f"{RUNNING}::test_a_run_whose_end_a_drive_did_not_confirm_is_no_success",),
    ),
    "signals while torque is taken away": Guard(
        "haptic_fieldbus/running/ending.py",
        "if now >= self._raises_from:",
        "if True:",
        (
            "tests/running/test_ending.py::test_in_the_loop_it_is_only_noted_however_often_it_comes",
            "tests/running/test_ending.py::test_after_the_first_signal_no_other_one_interrupts_the_way_to_zero",
        ),
    ),
    "energy of the scene's own": _cycle(
        "energy",
        "if excess > tally.limit:",
        "if False:",
        "test_a_source_above_the_limit_trips_and_one_below_does_not_however_often",
        of="tests/cycle/test_energy.py",
    ),
    "energy of the law while another force is sent": _cycle(
        "energy",
        "ledger.compare(self._energy - ledger.memory.reserve)",
        "pass",
        "test_a_source_in_the_law_trips_whatever_is_sent_of_it",
        of="tests/cycle/test_energy.py",
    ),
    "the law takes over a contact in which a gap falls": _cycle(
        "energy",
        "self.law.open(energy, self._origin)",
        "self.law.open(0.0, self.stored(positions))",
        "test_a_source_trips_when_another_force_is_sent_from_the_middle_of_a_contact_on",
        of="tests/cycle/test_energy.py",
    ),
    "what is forgiven within a second": _cycle(
        "energy",
        "if second > self.tally.budget:",
        "if False:",
        "test_more_within_a_second_than_is_forgiven_trips_and_the_same_over_more_seconds_does_not",
        of="tests/cycle/test_energy.py",
    ),
    "credit ends with its contact": _cycle(
        "energy_steps",
        "self.energy, self.settles = 0.0, ledger.reason is not None or ledger.changing",
        "self.settles = ledger.reason is not None or ledger.changing",
        "test_credit_does_not_outlive_a_contact",
        of="tests/cycle/test_energy.py",
    ),
    "a change that no ledger can judge": Guard(
        "haptic_fieldbus/planning/live_changes.py",
        "if math.isfinite(axis.limits.energy):",
        "if False:",
        ("tests/planning/test_live_changes.py::test_a_change_to_what_no_ledger_can_judge_is_refused",),
    ),
    "a change that would throw the handle": Guard(
        "haptic_fieldbus/cycle/cycle.py",
        "calm = -1 if throws() else calm",
        "pass",
        ("tests/system/test_live_changes.py::test_a_wall_that_is_moved_past_the_handle_waits_instead_of_throwing_it",),
    ),
    "the question before torque": Guard(
        "haptic_fieldbus/running/session.py",
        "if not agreed(self.confirm, question):",
        "if False:",
        ("tests/peers/test_question.py::test_a_question_that_is_not_confirmed_leaves_nothing_but_uploads_on_the_bus",),
    ),
    "a guard that does not act ends the run": Guard(
        "haptic_fieldbus/assessing/result.py",
        "return self.off is not None and self.earliest <= self.off <= self.allowed",
        "return True",
        (f"{PROVING}::TestAGuardThatDoesNot::test_ends_the_run_torque_free_and_says_what_was_measured",),
    ),
    "proofs of life through skipped periods": _bus(
        "guard",
        "if passed_ns < self._late_ns:",
        "if True:",
        "test_guard",
        "TestRequests::test_periods_that_are_skipped_leave_no_guard_waiting",
    ),
    "a guard that cannot have acted yet": Guard(
        "haptic_fieldbus/assessing/result.py",
        "return self.off is not None and self.off < self.earliest",
        "return False",
        (f"{PROVING}::TestWhileADriveIsLeftAlone::test_a_drive_that_something_else_switched_off_has_proved_nothing",),
    ),
    "a handle that goes to the negative side": Guard(
        "haptic_fieldbus/running/proofs.py",
        "if way < 0.0:",
        "if False:",
        ("tests/running/test_direction.py::test_a_handle_that_goes_down_is_refused_with_the_key_to_change",),
    ),
    "a state that nobody knows": Guard(
        "haptic_fieldbus/drive/profile.py",
        "    PowerState.UNKNOWN,\n)",
        ")",
        ("tests/buses/canopen/test_release.py::test_a_drive_in_a_state_that_nobody_knows_is_not_off",),
    ),
    "zero torque while a guard is proved": Guard(
        "haptic_fieldbus/running/proofs.py",
        "self._image.outputs[0], controlword, 0)",
        "self._image.outputs[0], controlword, 5)",
        (f"{PROVING}::TestAGuardThatDoesNot::test_ends_the_run_torque_free_and_says_what_was_measured",),
    ),
    "somebody else while a guard is proved": Guard(
        "haptic_fieldbus/running/proofs.py",
        "self._check(drive.axis, feedback, WHILE_ALONE)",
        "pass",
        (f"{PROVING}::TestWhileADriveIsLeftAlone::test_somebody_else_who_feeds_its_guard_ends_the_run",),
    ),
    "no fault but that of a lost master is cleared": _bus(
        "master",
        "if code not in (LOST_MASTER, release.NO_CODE):",
        "if False:",
        "test_acknowledging",
        "test_another_fault_is_told_and_left_as_it_is",
    ),
    "the cap without a guard": Guard(
        "haptic_fieldbus/planning/guards.py",
        "    return unguarded(profile, axis)\n\n\ndef check_guarded(",
        '    return ""\n\n\ndef check_guarded(',
        (
            "tests/planning/test_guards.py::"
            "test_a_known_failure_is_refused_without_an_emergency_stop_and_capped_with_one",
        ),
    ),
    "the emergency stop without a guard": Guard(
        "haptic_fieldbus/planning/guards.py",
        "if why and axis.emergency_stop is None:",
        "if False:",
        (
            "tests/planning/test_guards.py::"
            "test_a_known_failure_is_refused_without_an_emergency_stop_and_capped_with_one",
        ),
    ),
    "the serial number of a proof": Guard(
        "haptic_fieldbus/planning/guards.py",
        "if other and known.serial is not None and drive.serial is not None:",
        "if False:",
        ("tests/planning/test_guards.py::test_a_known_failure_is_not_tried_again_on_the_same_drive",),
    ),
    "a serial number that was never given": Guard(
        "haptic_fieldbus/drive/profile.py",
        "number & ones in (0, ones)",
        "False",
        (
            "tests/drive/test_identity.py::test_a_number_that_was_never_given_is_unknown",
            "tests/running/test_proofs.py::TestADriveWithoutASerialNumber::"
            "test_gets_no_proof_of_another_one_although_both_tell_the_same",
        ),
    ),
    "no proof counts for a drive without a serial number": Guard(
        "haptic_fieldbus/planning/guards.py",
        "if drive.serial is None:",
        "if False:",
        ("tests/planning/test_guards.py::test_a_proof_counts_for_one_drive_one_profile_and_one_time",),
    ),
    "what was written for the guard that was proved": Guard(
        "haptic_fieldbus/planning/guards.py",
        "if proved.digest != proved.digest_with(set_to.written):",
        "if False:",
        ("tests/planning/test_guards.py::test_a_proof_does_not_outlive_what_was_written_for_it_nor_its_place",),
    ),
    "the place of a proof": Guard(
        "haptic_fieldbus/planning/plan.py",
        "(*traffic.guarding(axis.name, axis.rig), self.place(axis))",
        "traffic.guarding(axis.name, axis.rig)",
        ("tests/planning/test_guards.py::test_a_proof_does_not_outlive_what_was_written_for_it_nor_its_place",),
    ),
    "the measured time of a proof": Guard(
        "haptic_fieldbus/planning/guards.py",
        "if proved.guard_ms is not None and low -",
        "if True or low -",
        ("tests/planning/test_guards.py::test_a_measured_time_counts_where_a_proof_at_this_rate_would_have_passed",),
    ),
    "a measured time that no proof accepts": Guard(
        "haptic_fieldbus/drive/plausible.py",
        "not low <= measured <= high",
        "False",
        (
            "tests/planning/test_guards.py::"
            "test_a_measured_time_that_no_proof_accepts_is_refused_with_file_key_value_and_what_is_expected",
        ),
    ),
    "a measured value that lies outside of its interval": Guard(
        "haptic_fieldbus/drive/plausible.py",
        "_is_number(low) and _is_number(high) and low <= value <= high",
        "True",
        (f"{BENCH}test_a_table_that_no_measurement_writes_is_a_fault_of_the_file",),
    ),
    "a measured bench that was changed by hand": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        "measured.digest is not None and measured.digest != digest_with(axis, measured)",
        "False",
        (
            f"{BENCH}test_an_axis_that_was_changed_after_the_measurement_is_another_bench",
            f"{BENCH}test_every_value_of_the_table_is_sealed",
        ),
    ),
    "a bench that was measured on a simulated bus": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        "measured.simulated and not only_simulated(rig.bus[rig.axis[name].bus])",
        "False",
        (f"{BENCH}test_what_was_measured_on_a_simulated_bus_does_not_count_on_a_real_one",),
    ),
    "a bench that was measured on another axis": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        "measured.axis not in (None, name)",
        "False",
        (f"{BENCH}test_what_was_measured_on_another_axis_does_not_count",),
    ),
    "a delay that was measured with another adapter": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        "measured.bus != bus.route and not bus.stands_for_real",
        "False",
        (f"{BENCH}test_a_delay_that_was_measured_with_another_adapter_never_raises_the_limit",),
    ),
    "a bench that was measured with another profile": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        "measured.profile is not None and measured.profile != profile.name",
        "False",
        (f"{BENCH}test_a_run_names_what_does_not_count_and_the_way_out",),
    ),
    "a bench that was measured with another drive": Guard(
        "haptic_fieldbus/running/session.py",
        "check_measured_drive(axis.name, axis.bench, self.identities[axis.name])",
        "pass",
        ("tests/running/test_measured_drive.py::test_another_drive_is_refused_and_nothing_is_written_to_it",),
    ),
    "the region of 99.7 % of a measured bench": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        "half = WIDER * max(",
        "half = 0.5 * max(",
        (f"{BENCH}test_the_limit_is_below_that_of_every_bench_inside_the_region",),
    ),
    "a control tick that is not locked": Guard(
        "haptic_fieldbus/planning/known_bench.py",
        '0.0 if profile.timing.control_tick == "sync" else profile.timing.control_period',
        "0.0",
        (f"{BENCH}test_a_tick_that_is_not_locked_may_be_a_control_period_later_after_the_next_start",),
    ),
    "no note of a drive without a serial number": Guard(
        "haptic_fieldbus/drive/profile.py",
        "if self.serial is None:",
        "if False:",
        (
            f"{BUSES}/test_max_torque.py::TestKilled::"
            "test_another_drive_without_a_serial_number_keeps_the_limit_that_a_person_has_set",
        ),
    ),
    "a note that was damaged or changed by hand": Guard(
        "haptic_fieldbus/buses/torque_limits.py",
        "or digest != self._digest(changes):",
        "or False:",
        (
            f"{BUSES}/test_max_torque.py::TestKilled::test_a_note_that_was_changed_by_hand_is_told_and_nothing_is_restored",
        ),
    ),
    "values of a note that the object cannot hold": Guard(
        "haptic_fieldbus/buses/torque_limits.py",
        "if any(not low <= value <= high for value in (*ours, original)):",
        "if False:",
        (
            f"{BUSES}/test_max_torque.py::TestKilled::"
            "test_a_note_with_values_that_the_object_cannot_hold_is_told_whoever_wrote_it",
        ),
    ),
    "a note on the disk before the limit is changed": Guard(
        "haptic_fieldbus/documents/edits.py",
        "            os.fsync(descriptor)\n        yield name",
        "            pass\n        yield name",
        (
            f"{BUSES}/test_max_torque.py::TestKilled::"
            "test_a_note_has_reached_the_disk_as_a_whole_before_the_limit_is_changed",
        ),
    ),
    "Modbus: a set-point that is not ours": _line(
        "exchange",
        "    if target:\n",
        "    if False:\n",
        "test_setup",
        "test_a_drive_that_must_not_be_touched_is_refused_in_a_sentence_and_nothing_is_written",
    ),
    "Modbus: a command that is not ours": _line(
        "exchange",
        "if command in power.enabling:",
        "if False:",
        "test_setup",
        "test_a_drive_that_must_not_be_touched_is_refused_in_a_sentence_and_nothing_is_written",
    ),
    "Modbus: a power stage that somebody switched on": _line(
        "exchange",
        "if state in ENERGISED:",
        "if False:",
        "test_setup",
        "test_a_drive_that_must_not_be_touched_is_refused_in_a_sentence_and_nothing_is_written",
    ),
    "Modbus: answers that belong to another question": _line(
        "framing", "transaction != self._transaction", "False", "test_framing", "test_on_tcp_another_frame_is_no_answer"
    ),
    "Modbus: answers of another unit": _line(
        "framing", "if unit != asked.unit:", "if False:", "test_framing", "test_on_rtu_another_frame_is_no_answer"
    ),
    "Modbus: a set-point is sent once": _line(
        "exchange",
        "if not (reading.writing and set_point.waiting):",
        "if not reading.writing:",
        "test_exchange",
        "test_a_set_point_is_sent_once_so_that_a_loop_that_hangs_feeds_no_watchdog",
    ),
    "Modbus: no set-points queue up": _line(
        "exchange",
        "if self._requester.outstanding is not None:",
        "if False:",
        "test_exchange",
        "test_on_tcp_nothing_is_sent_while_an_answer_is_outstanding",
    ),
    "Modbus: a late sample has its own age": _line(
        "link",
        "self.link.latch_ns = latched_ns if latched_ns <= latest_ns else max(sent_ns, latest_ns)",
        "self.link.latch_ns = arrived_ns",
        "test_exchange",
        "test_a_sample_of_an_earlier_question_counts_for_the_age_that_it_has",
    ),
    "Modbus: a late answer is that of its own question": _line(
        "exchange",
        "if form is None or reading.asks(form):",
        "if True:",
        "test_exchange",
        "test_a_late_sample_of_one_unit_is_not_taken_for_that_of_another",
    ),
    "Modbus: the stop waits out a delayed acknowledgement": _line(
        "master",
        "round(1e9 * DELAYED_ACK)",
        "0",
        "test_release",
        "test_a_server_with_nagles_algorithm_confirms_that_it_is_off",
    ),
    "Modbus: a late answer is not that of now": _line(
        "exchange",
        "if READ_WRITE in late:",
        "if False:",
        "test_exchange",
        "test_after_function_23_stayed_unanswered_a_serial_line_gets_the_set_point_by_another_function",
    ),
    "Modbus: torn positions": _line(
        "link",
        "if wide.torn(data, sent_ns):",
        "if False:",
        "test_exchange",
        "test_a_torn_position_is_dropped_and_told_but_a_motion_is_not",
    ),
    "Modbus: exceptions": _line(
        "link", "flags | EXCEPTION", "flags", "test_exchange", "test_an_exception_is_flagged_with_its_code"
    ),
    "Modbus: the drive's watch on us": _line(
        "setup",
        "self.watchdog.arm()",
        "pass",
        "test_setup",
        "test_what_is_written_is_what_the_profile_asks_for_and_it_is_put_back",
    ),
    "Modbus: read-back of what was written": _line(
        "unit",
        "if held != value:",
        "if False:",
        "test_setup",
        "test_a_register_that_keeps_another_value_ends_the_set_up",
    ),
    "Modbus: the way to zero feeds no watchdog": _line(
        "master",
        "MOST_ZEROS = 2",
        "MOST_ZEROS = 99",
        "test_release",
        "test_a_drive_that_confirms_nothing_is_told_after_its_watchdog_and_still_gets_zero_torque",
    ),
    "Modbus: zero torque at the end": _line(
        "master",
        "self._zeros -= 1",
        "return steps",
        "test_release",
        "test_the_first_thing_that_goes_out_is_zero_torque",
    ),
    "Modbus: a line that was reset": _line(
        "master",
        "self._requester.transport.reopen()",
        "pass",
        "test_release",
        "test_a_reset_connection_is_opened_again_for_zero_torque_alone",
    ),
}
