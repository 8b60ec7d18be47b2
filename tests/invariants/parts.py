"""The parts of a run, each as a witness of its own: a configuration of the drives and what followed from it."""

from dataclasses import replace

from tests.invariants.witness import Part, Shaft, Witness
from tests.invariants.words import ARROWS, State


def parts_of(witness: Witness) -> tuple[Witness, ...]:
    """Every part in its order, the last one at the end; a run without proofs is a single part."""
    if not witness.earlier:
        return (witness,)
    last = Part(witness.earlier[-1].ended_ns, witness.seen_ns + 1, witness.proves, witness.released_ns)
    enabled = [t_ns for shaft in witness.shafts.values() for t_ns, number in shaft.transitions if number == 4]
    return tuple(_alone(witness, part, min(enabled, default=None)) for part in (*witness.earlier, last))


def state_at(shaft: Shaft, before_ns: int) -> State:
    """The state of a drive just before an instant."""
    state = shaft.state
    for t_ns, number in shaft.transitions:
        if t_ns < before_ns:
            state = State.NOT_READY if number < 0 else ARROWS[number][1]
    return state


def _alone(witness: Witness, part: Part, enabled_ns: int | None) -> Witness:
    return replace(
        witness,
        shafts={node: _shaft(shaft, part) for node, shaft in witness.shafts.items()},
        begun_ns=part.begun_ns,
        frames=[frame for frame in witness.frames if part.begun_ns <= frame[0] < part.ended_ns],
        released_ns=part.released_ns,
        seen_ns=min(witness.seen_ns, part.ended_ns),
        earlier=[],
        proves=part.proves,
        first_enabled_ns=enabled_ns,
    )


def _shaft(shaft: Shaft, part: Part) -> Shaft:
    before = [(part.begun_ns, torque) for t_ns, torque in shaft.targets if t_ns < part.begun_ns][-1:]
    return replace(
        shaft,
        state=state_at(shaft, part.begun_ns),
        transitions=[each for each in shaft.transitions if part.begun_ns <= each[0] < part.ended_ns],
        targets=before + [each for each in shaft.targets if part.begun_ns <= each[0] < part.ended_ns],
    )
