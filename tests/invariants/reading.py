"""Readings of the evidence: words on the wire, torques at the motors, and instants."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tests.invariants.stated import Place, StatedAxis
from tests.invariants.witness import MASTER, STRANGER, Shaft, Witness
from tests.invariants.words import State, state_of

Floats = NDArray[np.float64]


def axes_of(witness: Witness) -> Iterator[tuple[StatedAxis, Shaft]]:
    for axis in witness.stated.axes:
        if axis.node in witness.shafts:
            yield axis, witness.shafts[axis.node]


def enabled_ns_of(shaft: Shaft) -> int | None:
    return next((t_ns for t_ns, number in shaft.transitions if number == 4), None)


def motor_of(shaft: Shaft) -> tuple[Floats, Floats]:
    """Times [ns] and torques [N·m] of the motor's targets; of those at one instant the last counts."""
    table = np.array(shaft.targets, dtype=np.float64).reshape(-1, 2)
    last = np.append(np.diff(table[:, 0]) > 0.0, True) if len(table) else np.zeros(0, dtype=bool)
    return table[last, 0], table[last, 1]


def words_of(witness: Witness, place: Place, sender: int) -> list[tuple[int, int]]:
    """Times [ns] and values of a word that a sender has put on the wire."""
    first, last = place.offset, place.offset + place.size
    return [
        (t_ns, int.from_bytes(data[first:last], "little"))
        for t_ns, can_id, data, by in witness.frames
        if can_id == place.can_id and by == sender and len(data) == place.length
    ]


def shown_ns_of(witness: Witness, axis: StatedAxis) -> int:
    """When the drive has shown *operation enabled* first; the end of all when it never has."""
    words = words_of(witness, axis.statusword, axis.node)
    return next((t_ns for t_ns, word in words if state_of(word) is State.ENABLED), witness.seen_ns)


def controlwords_of(witness: Witness, axis: StatedAxis) -> list[tuple[int, int]]:
    return words_of(witness, axis.controlword, MASTER)


def set_points_of(witness: Witness, axis: StatedAxis, shaft: Shaft) -> Floats:
    """Of the master: time [ns], target torque [N·m], and whether the controlword goes with it (0: torque-free)."""
    targets, words = words_of(witness, axis.target, MASTER), controlwords_of(witness, axis)
    table = np.zeros((len(targets), 3))
    if targets:
        raw = np.array(targets, dtype=np.int64)
        table[:, 0] = raw[:, 0]
        wrap = 1 << 8 * axis.target.size
        table[:, 1] = np.where(raw[:, 1] < wrap // 2, raw[:, 1], raw[:, 1] - wrap) * shaft.unit
        table[:, 2] = [word & 0x08 for _, word in words] if len(words) == len(targets) else 1.0
    return table


def stranger_commands(witness: Witness) -> bool:
    """Whether somebody else was on the wire: what a drive does then is not the master's alone."""
    return any(sender == STRANGER for _, _, _, sender in witness.frames)


def when(witness: Witness, t_ns: float) -> str:
    enabled_ns = witness.enabled_ns
    if enabled_ns is None:
        return f"{t_ns * 1e-9:.4f} s"
    return f"{(t_ns - enabled_ns) * 1e-9:.4f} s after enabling"
