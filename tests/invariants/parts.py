"""The parts of a run, each as a witness of its own: a configuration of the drives and what followed from it."""

from dataclasses import replace
from typing import Any

from tests.invariants.witness import Part, Shaft, Witness
from tests.invariants.words import ARROWS, MAKES_TORQUE, State


def parts_of(witness: Witness) -> tuple[Witness, ...]:
    """Every part in its order, the last one at the end; a run without proofs is a single part."""
    if not witness.earlier:
        return (witness,)
    last = Part(witness.earlier[-1].ended_ns, witness.seen_ns + 1, witness.proves, witness.released_ns)
    parts: list[Witness] = []
    for part in (*witness.earlier, last):
        parts.append(_alone(witness, part, [fault for each in parts for fault in _happened(each)]))
    return tuple(parts)


def state_at(shaft: Shaft, before_ns: int) -> State:
    """The state of a drive just before an instant."""
    state = shaft.state
    for t_ns, number in shaft.transitions:
        if t_ns < before_ns:
            state = State.NOT_READY if number < 0 else ARROWS[number][1]
    return state


def _happened(part: Witness) -> list[Any]:
    """The faults that fell due while the drives were under power; once there was one, all that fell due."""
    enabled_ns = part.enabled_ns
    if enabled_ns is None:
        return []
    due = [(enabled_ns + round(fault.at * 1e9), fault) for fault in part.faults if hasattr(fault, "at")]
    freed_ns = min((_freed_ns(shaft, enabled_ns) for shaft in part.shafts.values()), default=part.seen_ns)
    until_ns = part.seen_ns if any(due_ns < freed_ns for due_ns, _ in due) else freed_ns
    return [fault for due_ns, fault in due if due_ns < until_ns]


def _freed_ns(shaft: Shaft, enabled_ns: int) -> int:
    """When the drive left the states that make torque; the greatest time when it did not."""
    after = ((t_ns, number) for t_ns, number in shaft.transitions if t_ns > enabled_ns)
    return next((t_ns for t_ns, number in after if number < 0 or ARROWS[number][1] not in MAKES_TORQUE), 1 << 62)


def _alone(witness: Witness, part: Part, happened: list[Any]) -> Witness:
    return replace(
        witness,
        shafts={node: _shaft(shaft, part) for node, shaft in witness.shafts.items()},
        begun_ns=part.begun_ns,
        frames=[frame for frame in witness.frames if part.begun_ns <= frame[0] < part.ended_ns],
        released_ns=part.released_ns,
        seen_ns=min(witness.seen_ns, part.ended_ns),
        earlier=[],
        proves=part.proves,
        happened=happened,
    )


def _shaft(shaft: Shaft, part: Part) -> Shaft:
    before = [(part.begun_ns, torque) for t_ns, torque in shaft.targets if t_ns < part.begun_ns][-1:]
    return replace(
        shaft,
        state=state_at(shaft, part.begun_ns),
        transitions=[each for each in shaft.transitions if part.begun_ns <= each[0] < part.ended_ns],
        targets=before + [each for each in shaft.targets if part.begun_ns <= each[0] < part.ended_ns],
    )
