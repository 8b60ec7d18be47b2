"""The invariants of a run, judged from what a witness has written down: each law yields what it finds broken.

Energy after a fault. From the event of a fault that takes the way to zero (`causes.FADES`) torque is held, fades, or
ends; so its amount is at most τ, the largest of the event's own two periods, and the motor turns at most at the speed
limit ω of the plan, for at most the stated time D. The energy that it can give to the hand is then at most τ·ω·D. Both
are checked: that torque does not grow beyond τ, and the work ∫τ dφ along the true way of the shaft, from the event on.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.invariants import causes
from tests.invariants.reading import (
    axes_of,
    controlwords_of,
    enabled_ns_of,
    motor_of,
    set_points_of,
    shown_ns_of,
    stranger_commands,
    when,
    words_of,
)
from tests.invariants.stated import StatedAxis
from tests.invariants.witness import Shaft, Witness
from tests.invariants.words import ARROWS, MAKES_TORQUE, STEP, Command, State, command_of, state_of

REMAINDER = 0.01
"""Share of the torque at an event at which it is zero."""
UNFOLLOWED = 35.0
"""‰ of rated torque by which the motor's target may differ from the wire's without being noticed."""
THEIRS, OVERSHOOT = 0.05, 0.25
"""Share of rated torque, and of the range of our torque, by which one of another master may be larger and unseen."""
Law = Callable[[Witness], Iterator[str]]


def torque_within_limits(witness: Witness) -> Iterator[str]:
    """No set-point on the wire, and no target at a motor, is above the limit; the limit fades in."""
    for axis, shaft in axes_of(witness):
        limit = axis.torque + shaft.unit
        wire = set_points_of(witness, axis, shaft)
        largest = float(np.abs(wire[:, 1]).max(initial=0.0))
        if largest > limit:
            yield f"{axis.name}: a set-point of {largest:.4g} N·m, the limit is {axis.torque:.4g} N·m"
        enabled_ns = enabled_ns_of(shaft)
        if enabled_ns is not None:
            faded = axis.permitted((wire[:, 0] - enabled_ns) * 1e-9, witness.stated.period)
            over = np.flatnonzero(np.abs(wire[:, 1]) > faded + 2.0 * shaft.unit)
            if over.size:
                at = over[0]
                yield f"{axis.name}: {wire[at, 1]:.4g} N·m when the limit had faded in to {faded[at]:.4g} N·m"
        if not stranger_commands(witness):
            motor = max((abs(torque) for _, torque in shaft.targets), default=0.0)
            if motor > limit:
                yield f"{axis.name}: a target of {motor:.4g} N·m at the motor, the limit is {axis.torque:.4g} N·m"


def slew_within_limits(witness: Witness) -> Iterator[str]:
    """From one set-point to the next torque changes by no more than the slew limit, unless it is taken away.

    On Modbus none is sent while a drive is silent; the next one then has the slew of all periods between.
    """
    for axis, shaft in axes_of(witness):
        wire = set_points_of(witness, axis, shaft)
        if len(wire) < 2:
            continue
        change = np.abs(np.diff(wire[:, 1]))
        let_go_ns = witness.released_ns if witness.released_ns is not None else np.inf
        # Torque-free by its controlword, or a zero after the order to let go.
        change[(wire[1:, 2] == 0) | ((wire[1:, 1] == 0.0) & (wire[1:, 0] >= let_go_ns))] = 0.0
        periods = np.maximum(1.0, np.round(np.diff(wire[:, 0]) * 1e-9 / witness.stated.period))
        permitted = axis.slew * witness.stated.period * periods + 1.5 * shaft.unit
        at = int((change - permitted).argmax())
        if change[at] > permitted[at]:
            step, at_time = f"{wire[at, 1]:.4g} → {wire[at + 1, 1]:.4g} N·m", when(witness, wire[at + 1, 0])
            time = "a period" if periods[at] == 1.0 else f"{periods[at]:.0f} periods"
            yield f"{axis.name}: {step} in {time} at {at_time}, at most {permitted[at]:.4g} N·m"


def no_torque_outside_of_operation(witness: Witness) -> Iterator[str]:
    """A motor has torque in *operation enabled* and while it brakes, and nowhere else."""
    for axis, shaft in axes_of(witness):
        state, events = shaft.state, iter([*shaft.transitions, (witness.seen_ns + 1, 0)])
        until_ns, number = next(events)
        for t_ns, torque in dict(shaft.targets).items():  # of those at one instant the last counts
            while until_ns <= t_ns and until_ns <= witness.seen_ns:
                state = State.NOT_READY if number < 0 else ARROWS[number][1]
                until_ns, number = next(events)
            if torque and state not in MAKES_TORQUE:
                yield f"{axis.name}: {torque:.4g} N·m at {when(witness, t_ns)} in {state.value}"
                break


def nothing_enables_again(witness: Witness) -> Iterator[str]:
    """A drive that has left *operation enabled* does not come back, and nobody asks it to."""
    for axis, shaft in axes_of(witness):
        enabled = [t_ns for t_ns, number in shaft.transitions if number in (4, 16)]
        if len(enabled) > 1 and not stranger_commands(witness):
            yield f"{axis.name}: enabled again at {when(witness, enabled[1])}"
        words = controlwords_of(witness, axis)
        asked = [at for at, (_, word) in enumerate(words) if command_of(word) is Command.ENABLE_OPERATION]
        if asked and asked[-1] - asked[0] + 1 != len(asked):
            gap = next(at for at, following in pairwise(asked) if following != at + 1)
            yield f"{axis.name}: asked to enable again after {when(witness, words[gap][0])}"


def automaton_never_skips(witness: Witness) -> Iterator[str]:
    """Transitions follow the standard's graph, and no command skips a state that the drive has not shown yet."""
    for axis, shaft in axes_of(witness):
        state = shaft.state
        for t_ns, number in shaft.transitions:
            if number < 0:
                state = State.NOT_READY
                continue
            starts, end = ARROWS[number]
            if state not in starts:
                yield f"{axis.name}: transition {number} from {state.value} at {when(witness, t_ns)}"
                break
            state = end
        yield from _commands_in_order(witness, axis, shaft)


def zero_in_time(witness: Witness) -> Iterator[str]:
    """After a fault that must end the run, and after the order to let go, torque is zero within the stated time."""
    faults, stated = witness.faults, witness.stated
    for axis, shaft in axes_of(witness):
        for fault, cause, event_ns in ending(witness):
            longest = causes.allowed(cause, faults, stated)
            took = time_to_zero(witness, axis, shaft, event_ns, 1.0 + causes.LATER.get(fault.kind, 0.0))
            if took is not None and took > longest:
                what = f"{fault.kind} at {fault.at:.4f} s"
                yield f"{axis.name}: {what}: {1e3 * took:.2f} ms to zero, {1e3 * longest:.2f} ms stated"
        if witness.released_ns is not None and not stranger_commands(witness):
            longest = stated.deadlines[causes.END]
            if not witness.is_plain:
                longest = causes.allowed(causes.STOPPED, [*faults, *faults, None], stated)
            took = time_to_zero(witness, axis, shaft, witness.released_ns)
            if took is not None and took > longest:
                yield f"{axis.name}: let go: {1e3 * took:.2f} ms to zero, {1e3 * longest:.2f} ms stated"


def energy_after_a_fault_bounded(witness: Witness) -> Iterator[str]:
    """From a fault that takes the way to zero torque does not grow; see the theory above."""
    if len(witness.faults) != 1:
        return
    for axis, shaft in axes_of(witness):
        times, torques = motor_of(shaft)
        for fault, cause, event_ns in ending(witness):
            if cause not in causes.FADES or not len(times):
                continue
            if not witness.stated.coupled and getattr(fault, "node", None) not in (None, axis.node):
                continue  # an axis that goes on until the feedback of the other one is too old
            span_ns = 2e9 * witness.stated.period
            first, last = np.searchsorted(times, [event_ns - span_ns, event_ns + span_ns])
            around, after = torques[max(0, first - 1) : last], torques[last:]
            most = float(np.abs(around).max(initial=0.0)) + shaft.unit
            if float(np.abs(after).max(initial=0.0)) > most:
                yield f"{axis.name}: {np.abs(after).max():.4g} N·m after {fault.kind}, {most:.4g} N·m at the event"
            work = work_after(witness, shaft, event_ns)
            permitted = most * axis.speed * causes.allowed(cause, witness.faults, witness.stated)
            if work > permitted:
                yield f"{axis.name}: {work:.4g} J given after {fault.kind}, at most {permitted:.4g} J"


def a_wrong_sign_gets_no_force(witness: Witness) -> Iterator[str]:
    """Where torque moves a handle the wrong way, and nobody knew the sign, it gets pulses and what a hand may hold."""
    if not any(_is_reversed(axis, shaft) for axis, shaft in axes_of(witness)) or stranger_commands(witness):
        return
    for axis, shaft in axes_of(witness):
        _, torques = motor_of(shaft)
        largest = float(np.abs([*torques, *set_points_of(witness, axis, shaft)[:, 1]]).max(initial=0.0))
        if axis.probe is not None and largest > axis.unseen + 0.5 * shaft.unit:
            yield f"{axis.name}: {largest:.4g} N·m with a wrong sign, at most {axis.unseen:.4g} N·m until it is seen"


def little_torque_before_the_sign_is_seen(witness: Witness) -> Iterator[str]:
    """Until its sign can have been seen a motor gets at most 15 % of its own rated torque, and 5 N or 0.25 N·m."""
    if stranger_commands(witness):
        return
    for axis, shaft in axes_of(witness):
        probe, enabled_ns = axis.probe, enabled_ns_of(shaft)
        if probe is None or enabled_ns is None:
            continue
        times, torques = motor_of(shaft)
        early = np.abs(torques[times < enabled_ns + 1e9 * probe.least])
        most = min(probe.permitted, 1e3 * shaft.permille * probe.share)
        largest = max(float(early.max(initial=0.0)), axis.unseen)
        if largest > most * (1.0 + 1e-9):
            yield f"{axis.name}: {largest:.4g} N·m before the sign is seen, at most {most:.4g} N·m"


def what_has_no_effect_is_noticed(witness: Witness) -> Iterator[str]:
    """Set-points that a motor does not follow are noticed within the stated time."""
    faults = witness.faults
    longest = witness.stated.deadlines.get(causes.NO_EFFECT)
    if longest is None or len(faults) != 1 or faults[0].kind != "missing_rpdos" or stranger_commands(witness):
        return
    for axis, shaft in axes_of(witness):
        wire, (times, torques) = set_points_of(witness, axis, shaft), motor_of(shaft)
        if not len(wire) or not len(times):
            continue
        place = np.searchsorted(times, wire[:, 0] + 1e9 * witness.stated.period, side="right") - 1
        apart = np.abs(wire[:, 1] - np.where(place >= 0, torques[place], 0.0)) > UNFOLLOWED * shaft.permille
        began = None
        for t_ns, is_apart in zip(wire[:, 0], apart, strict=True):
            began = None if not is_apart else t_ns if began is None else began
            if began is not None and (t_ns - began) * 1e-9 > longest:
                yield f"{axis.name}: the motor has not followed since {when(witness, began)}"
                break


def set_points_of_another_master_are_noticed(witness: Witness) -> Iterator[str]:
    """Events that are long and large enough to be seen act for no longer than is stated, all of them together.

    Each lasts until the next one of ours. Too small are those within 5 % of rated torque and a quarter of the range of
    our own of the last time, as far as it is stated; a torque loop shows 95 % of a step after three time constants.
    """
    faults, stated = witness.faults, witness.stated
    if len(faults) != 1 or faults[0].kind != "foreign_set_points":
        return
    for axis, shaft in axes_of(witness):
        if axis.blind is None:
            continue
        acted = sum(each for each in _theirs(witness, axis, shaft) if each > axis.blind)
        longest = stated.deadline(causes.OTHER_MASTER)
        if acted > longest:
            yield f"{axis.name}: they acted for {1e3 * acted:.1f} ms, {1e3 * longest:.1f} ms stated"


def _theirs(witness: Witness, axis: StatedAxis, shaft: Shaft) -> Iterator[float]:
    """For how long each set-point of another master has acted that is large enough to be seen [s]."""
    wire, (times, torques) = set_points_of(witness, axis, shaft), motor_of(shaft)
    recent_ns = 1e9 * (max(0.035, 3.0 * witness.stated.period) + axis.age + 3.0 * axis.lag)
    began, since_ns = None, shown_ns_of(witness, axis)
    for t_ns, torque in [*zip(times, torques, strict=True), (float(witness.seen_ns), 0.0)]:
        ours = wire[(wire[:, 0] >= t_ns - recent_ns) & (wire[:, 0] <= t_ns), 1]
        low, high = min(0.0, float(ours.min(initial=0.0))), max(0.0, float(ours.max(initial=0.0)))
        slack = THEIRS * 1e3 * shaft.permille + (OVERSHOOT + 0.05) * (high - low) + 2.0 * shaft.unit
        theirs = t_ns >= since_ns and (torque > (high + slack) / 0.95 or torque < (low - slack) / 0.95)
        if began is not None and not theirs:
            yield (t_ns - began) * 1e-9
        began = None if not theirs else t_ns if began is None else began


def a_frozen_encoder_is_noticed(witness: Witness) -> Iterator[str]:
    """Under a force that is enough to ask it, an encoder that keeps its counts ends the run within the stated time.

    Between the pulses force is what it was, and a pulse lowers it by twice its size at most.
    """
    if len(witness.faults) != 1 or witness.faults_ns is None or stranger_commands(witness):
        return
    for axis, shaft in axes_of(witness):
        stuck = [fault for fault in shaft.faults or () if fault.kind == "position_stuck"]
        if not stuck or axis.question is None:
            continue
        began_ns = witness.faults_ns + round(1e9 * stuck[0].at)
        over_ns = began_ns + 1e9 * (math.inf if stuck[0].duration is None else stuck[0].duration)
        wire = set_points_of(witness, axis, shaft)
        wire = wire[(wire[:, 0] >= began_ns) & (wire[:, 0] <= over_ns)]
        longest = 1e9 * (axis.question.seconds + witness.stated.deadlines[causes.TRIP])
        pushed = np.abs(wire[:, 1]) >= axis.question.torque - 2.0 * axis.question.pulse
        for first, last in _runs(pushed):
            forces = np.abs(wire[first:last, 1])
            took = wire[last - 1, 0] - wire[first, 0]
            if took > longest and np.median(forces) > axis.question.torque + axis.question.pulse:
                yield f"{axis.name}: {1e-9 * took:.2f} s of force from {when(witness, wire[first, 0])} on"


def _runs(held: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """The stretches in which something holds: their first place, and the one after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], held.astype(np.int8), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


LAWS: dict[str, Law] = {
    "torque within limits": torque_within_limits,
    "slew within limits": slew_within_limits,
    "no torque outside of operation": no_torque_outside_of_operation,
    "nothing enables again": nothing_enables_again,
    "the automaton never skips": automaton_never_skips,
    "zero in time": zero_in_time,
    "energy after a fault bounded": energy_after_a_fault_bounded,
    "a wrong sign gets no force": a_wrong_sign_gets_no_force,
    "little torque before the sign is seen": little_torque_before_the_sign_is_seen,
    "what has no effect is noticed": what_has_no_effect_is_noticed,
    "set-points of another master are noticed": set_points_of_another_master_are_noticed,
    "a frozen encoder is noticed": a_frozen_encoder_is_noticed,
}


def ending(witness: Witness) -> Iterator[tuple[Any, str, int]]:
    """The faults that must end the run and happened within it: (fault, cause, instant)."""
    enabled_ns = witness.faults_ns
    if enabled_ns is None:
        return
    # Another master feeds the drive's watch on its master, and its set-points act after ours: nothing is stated then.
    if len(witness.faults) > 1 and any(fault.kind == "foreign_set_points" for fault in witness.faults):
        return
    # A master that has not been shown *operation enabled* is still on its way there.
    shown_ns = max((shown_ns_of(witness, axis) for axis, _ in axes_of(witness)), default=enabled_ns)
    for fault in witness.faults:
        cause = causes.cause_of(fault, witness.stated, witness.faults)
        event_ns = (witness.counts_from_ns(fault) or enabled_ns) + round(getattr(fault, "at", 0.0) * 1e9)
        over_ns = witness.released_ns if witness.released_ns is not None else witness.seen_ns
        if cause is not None and shown_ns <= event_ns < over_ns:
            yield fault, cause, event_ns


def time_to_zero(witness: Witness, axis: StatedAxis, shaft: Shaft, event_ns: int, periods: float = 1.0) -> float | None:
    """How long the motor had torque after an event [s], which is noticed within `periods`; None when it had none.

    A torque loop of first order with the lag T falls from τ to a hundredth of τ₀ within T·ln(100·τ/τ₀).
    """
    times, torques = motor_of(shaft)
    # A drive that lets go by itself does so at the very instant of the event.
    at = int(np.searchsorted(times, event_ns, side="left")) - 1
    held = torques[max(at, 0) :]
    # A set-point that was on its way when the event was noticed may still be taken over.
    until = int(np.searchsorted(times, event_ns + periods * 1e9 * witness.stated.period, side="right"))
    first = float(np.abs(torques[max(at, 0) : max(until, at + 1)]).max()) if at >= 0 else 0.0
    zero = REMAINDER * max(first, shaft.permille)
    pushing = np.flatnonzero(np.abs(held) > zero)
    if not pushing.size:
        return None
    last = max(at, 0) + int(pushing[-1])
    end_ns = float(times[last + 1]) if last + 1 < len(times) else float(witness.seen_ns)
    return max(0.0, (end_ns - event_ns) * 1e-9) + axis.lag * math.log(abs(float(torques[last])) / zero)


def work_after(witness: Witness, shaft: Shaft, event_ns: int) -> float:
    """Work of the motor after an event [J]: its target, held, along the way of the shaft."""
    times, torques = motor_of(shaft)
    at = max(0, int(np.searchsorted(times, event_ns)) - 1)
    known_ns = np.array(sorted(shaft.angles), dtype=np.float64)
    angles = np.array([shaft.angles[int(t_ns)] for t_ns in known_ns])
    ends_ns = np.append(np.maximum(times[at:], event_ns), witness.seen_ns)
    return float(torques[at:] @ np.diff(np.interp(ends_ns, known_ns, angles)))


def lasted(witness: Witness, node: int, event_ns: int) -> float:
    """How long the motor of a node had torque after an event [s]."""
    axis = next(axis for axis in witness.stated.axes if axis.node == node)
    return time_to_zero(witness, axis, witness.shafts[node], event_ns) or 0.0


def _commands_in_order(witness: Witness, axis: StatedAxis, shaft: Shaft) -> Iterator[str]:
    """Until the drive is enabled nothing disturbs the wire: the master knows the last statusword that was sent."""
    enabled_ns = enabled_ns_of(shaft)
    until_ns = witness.seen_ns if enabled_ns is None else enabled_ns
    words: Sequence[tuple[int, int, bool]] = sorted(
        [(t_ns, word, False) for t_ns, word in words_of(witness, axis.statusword, axis.node)]
        + [(t_ns, word, True) for t_ns, word in controlwords_of(witness, axis)]
    )
    state: State | None = None
    for t_ns, word, is_command in words:
        if t_ns > until_ns:
            return
        if not is_command:
            state = state_of(word)
            if state is None:
                yield f"{axis.name}: statusword {word:04X}h is in no table"
        elif state is not None and command_of(word) not in STEP[state]:
            yield f"{axis.name}: {command_of(word).value} in {state.value} at {when(witness, t_ns)}"
            return


def _is_reversed(axis: StatedAxis, shaft: Shaft) -> bool:
    """Whether torque moves the handle the wrong way from the first moment on, and the sign was not known."""
    kinds = [fault.kind for fault in shaft.faults or () if getattr(fault, "at", 1.0) <= 0.0]
    turned = kinds.count("encoder_reversed") + kinds.count("torque_reversed")
    scaled = any(fault.kind == "encoder_scaling" for fault in shaft.faults or ())
    return axis.probe is not None and turned % 2 == 1 and not scaled
