"""The invariants of the proofs of guards, which come before a run: torque-free, few, and each of them over.

A proof is a part of its own, in which the drives are enabled, left alone, and stopped (`witness.Part`). All laws of a
run hold in each part as well, so nothing is enabled twice in one.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from tests.invariants.laws import LAWS
from tests.invariants.parts import parts_of
from tests.invariants.reading import axes_of, enabled_ns_of, set_points_of, stranger_commands, when
from tests.invariants.stated import StatedAxis
from tests.invariants.witness import MASTER, Shaft, Witness
from tests.invariants.words import ARROWS, EMERGENCY, LOST_MASTER, MAKES_TORQUE, RESET_FAULT, State

MOST = 5
"""Proofs before one run."""
CONTROL = 0.001
"""[s] by which a drive may act later than its guard, because it looks once in a tick."""
Parts = Sequence[Witness]
ProofLaw = Callable[[Parts], Iterator[str]]


def proofs_are_torque_free(parts: Parts) -> Iterator[str]:
    """While guards are proved every set-point on the wire is 0, and so is every target of a motor."""
    for part in _proofs(parts):
        for axis, shaft in axes_of(part):
            wire = float(np.abs(set_points_of(part, axis, shaft)[:, 1]).max(initial=0.0))
            motor = max((abs(torque) for _, torque in shaft.targets), default=0.0)
            if wire or (motor and not stranger_commands(part)):
                yield f"{axis.name}: {max(wire, motor):.4g} N·m while its guard was proved"


def proofs_come_first(parts: Parts) -> Iterator[str]:
    """Only proofs are followed by another configuration; they are asked for, few, and each is over before the next."""
    *earlier, last = parts
    if not all(part.proves for part in earlier):
        yield "configured again after a run"
    proofs = list(_proofs(parts))
    if len(proofs) > MOST:
        yield f"{len(proofs)} proofs of guards, at most {MOST}"
    if proofs and not last.may_prove:
        yield "guards were proved that nobody asked to prove"
    for part, following in pairwise(parts):
        if part.enabled_ns is not None and part.released_ns is None:
            yield f"configured again at {when(part, following.begun_ns)}, and nobody has let go"
        for axis, shaft in axes_of(following):
            if shaft.state in MAKES_TORQUE:
                yield f"{axis.name}: configured again in {shaft.state.value}"


def only_a_lost_master_is_acknowledged(parts: Parts) -> Iterator[str]:
    """The fault of a drive is cleared only after a proof, and only when the drive has said that it lost its master."""
    for part in parts:
        for axis, shaft in axes_of(part):
            cleared = [t_ns for t_ns, number in shaft.transitions if number == RESET_FAULT]
            if not cleared or stranger_commands(part):
                continue
            told = [t_ns for t_ns, can_id, data, _ in part.frames if _is_loss(can_id, data, axis.node)]
            is_over = part.proves and part.released_ns is not None and part.released_ns <= cleared[0]
            if not is_over or not told or told[0] > cleared[0]:
                yield f"{axis.name}: its fault was cleared at {when(part, cleared[0])}"


def guards_act_before_a_run(parts: Parts) -> Iterator[str]:
    """After a proof a run follows only when every drive that was left alone let go by itself, and in time.

    On a real bus a drive of whose guard nothing is known is not enabled without one.
    """
    *earlier, last = parts
    if last.proves or last.enabled_ns is None:
        return
    if earlier:
        for axis, _ in axes_of(earlier[-1]):
            took = let_go_after(earlier[-1], axis)
            longest = axis.guard + 2.0 * last.stated.period + CONTROL
            if took is not None and took > longest:
                yield f"{axis.name}: a run, though its guard took {1e3 * took:.4g} ms, {1e3 * longest:.4g} ms permitted"
    for axis, shaft in axes_of(last):
        is_proved = any(let_go_after(part, axis) is not None for part in _proofs(earlier))
        if last.must_prove and axis.unproved and not is_proved and enabled_ns_of(shaft) is not None:
            yield f"{axis.name}: enabled for a run, and its guard was not proved"


PROOF_LAWS: dict[str, ProofLaw] = {
    "proofs are torque-free": proofs_are_torque_free,
    "proofs come first": proofs_come_first,
    "only a lost master is acknowledged": only_a_lost_master_is_acknowledged,
    "guards act before a run": guards_act_before_a_run,
}


def broken(witness: Witness) -> list[tuple[str, str]]:
    """All that is broken: (name of the law, sentence)."""
    parts = parts_of(witness)
    found = [(name, sentence) for part in parts for name, law in LAWS.items() for sentence in law(part)]
    return found + [(name, sentence) for name, of_proofs in PROOF_LAWS.items() for sentence in of_proofs(parts)]


def let_go_after(part: Witness, axis: StatedAxis) -> float | None:
    """How long after the last set-point the drive left *operation enabled* by itself [s].

    None when it was not enabled; infinite when it stayed enabled until it was told.
    """
    shaft = part.shafts[axis.node]
    enabled_ns, left_ns = enabled_ns_of(shaft), _left_ns(shaft)
    if enabled_ns is None:
        return None
    told_ns = part.released_ns if part.released_ns is not None else part.seen_ns
    if left_ns is None or left_ns >= told_ns:
        return float("inf")
    written = [t_ns for t_ns, can_id, _, by in part.frames if can_id == axis.target.can_id and by == MASTER]
    return (left_ns - max((t_ns for t_ns in written if t_ns <= left_ns), default=enabled_ns)) * 1e-9


def _proofs(parts: Parts) -> Iterator[Witness]:
    return (part for part in parts if part.proves)


def _left_ns(shaft: Shaft) -> int | None:
    """When a drive left *operation enabled*; None when it did not."""
    state = shaft.state
    for t_ns, number in shaft.transitions:
        before, state = state, State.NOT_READY if number < 0 else ARROWS[number][1]
        if before is State.ENABLED and state is not State.ENABLED:
            return t_ns
    return None


def _is_loss(can_id: int, data: bytes, node: int) -> bool:
    return can_id == EMERGENCY + node and int.from_bytes(data[:2], "little") == LOST_MASTER
