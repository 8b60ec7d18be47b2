"""The true motion of a simulated shaft, stored as a few states; all other states follow from them exactly.

A segment starts where the law of the motion changes: a new target, a piece of the hand's force, a reversal, standstill.
"""

from array import array
from bisect import bisect_right
from struct import Struct

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.mechanics.motion import ANGLE, SPEED, TORQUE, Flow, State, moved

Times = NDArray[np.int64]


class Recorder:
    """The record that a plant writes: segments (start [ns], fraction of the start [ns], state) and targets.

    `order` is the number of states of a segment. At least the `longest` latest segments are kept, None: all.
    """

    def __init__(self, order: int, longest: int | None = None) -> None:
        self.order = order
        self.longest = longest
        self.flows: list[Flow] = []
        self._numbers: dict[Flow, int] = {}
        self.flow_of_segment = array("H")
        self.segments = array("d")
        self._pack = Struct(f"{2 + order}d").pack
        self._flow: Flow | None = None
        self._number = 0
        """The flow of the last segment, and its number."""
        self.target_times_ns = array("q")
        self.target_torques = array("d")

    def segment(self, t_ns: int, offset_ns: float, flow: Flow, state: State) -> None:
        """Add a segment: from t_ns + offset_ns on, the state follows this flow."""
        if flow is not self._flow:
            self._flow, self._number = flow, self._numbers.setdefault(flow, len(self.flows))
            if self._number == len(self.flows):
                self.flows.append(flow)
        self.flow_of_segment.append(self._number)
        self.segments.frombytes(self._pack(t_ns, offset_ns, *state))
        if self.longest is not None and len(self.flow_of_segment) > 2 * self.longest:
            del self.flow_of_segment[: -self.longest], self.segments[: -self.longest * (2 + self.order)]

    def target(self, t_ns: int, torque: float) -> None:
        """Add a target [N·m] of the torque loop."""
        self.target_times_ns.append(t_ns)
        self.target_torques.append(torque)
        if self.longest is not None and len(self.target_torques) > 2 * self.longest:
            del self.target_times_ns[: -self.longest], self.target_torques[: -self.longest]

    def angle_at(self, t_ns: int) -> float:
        """Return the shaft angle at a recent instant [rad]; before the first kept segment, the angle at its start."""
        columns = 2 + self.order
        for number in range(len(self.flow_of_segment) - 1, -1, -1):
            at = number * columns
            span_ns = t_ns - self.segments[at] - self.segments[at + 1]
            if span_ns >= 0.0 or not number:
                state = np.array(self.segments[at + 2 : at + columns])
                return float(self.flows[self.flow_of_segment[number]].advance(state, max(0.0, span_ns))[ANGLE])
        raise ValueError("no motion was recorded")

    def forget(self, before_ns: int) -> None:
        """Drop segments and targets that end before an instant [ns]; those in force at this instant stay."""
        columns = 2 + self.order
        begins_ns = np.array(self.segments, dtype=np.float64).reshape(-1, columns)[:, :2].sum(axis=1)
        first = max(0, int(np.searchsorted(begins_ns, before_ns, side="right")) - 1)
        del self.flow_of_segment[:first], self.segments[: first * columns]
        targets = max(0, bisect_right(self.target_times_ns, before_ns) - 1)
        del self.target_times_ns[:targets], self.target_torques[:targets]


class Trajectory:
    """The true motion up to `end_ns`, at the motor shaft; a copy that later motion does not change."""

    def __init__(self, recorder: Recorder, end_ns: int) -> None:
        self.end_ns = end_ns
        self._flows = tuple(recorder.flows)
        self._flow_of_segment = np.array(recorder.flow_of_segment, dtype=np.int64)
        table = np.array(recorder.segments, dtype=np.float64).reshape(-1, 2 + recorder.order)
        self._start_ns = table[:, 0].astype(np.int64)
        self._offset_ns = table[:, 1].copy()
        self.begins_ns = table[:, 0] + table[:, 1]
        """Start of each segment [ns], not necessarily whole, shape (n_segments,)."""
        self._states = table[:, 2:].copy()
        self._target_times_ns = np.array(recorder.target_times_ns, dtype=np.int64)
        self._target_torques = np.array(recorder.target_torques, dtype=np.float64)

    def sample(self, times_ns: Times) -> tuple[Matrix, Matrix, Matrix]:
        """Return position [rad], velocity [rad/s] and motor torque after the torque loop [N·m], exact, shape (n,) each.

        `times_ns` has shape (n,). Raises ValueError for a time before the start or after `end_ns`.
        """
        states = self.states(times_ns)
        return states[:, ANGLE], states[:, SPEED], states[:, TORQUE]

    def targets(self) -> tuple[Times, Matrix]:
        """Return (times [ns], torques [N·m]) of the targets that the torque loop took over, shape (n_targets,) each."""
        return self._target_times_ns, self._target_torques

    def states(self, times_ns: Times) -> Matrix:
        """Return all states of the plant at each time, shape (n, order).

        Raises ValueError for a time before the start or after `end_ns`.
        """
        times = np.asarray(times_ns, dtype=np.int64)
        if times.size and (times.min() < self._start_ns[0] or times.max() > self.end_ns):
            raise ValueError(f"the motion is known from {self._start_ns[0]} to {self.end_ns} ns")
        segment = np.searchsorted(self.begins_ns, times.astype(np.float64), side="right") - 1
        spans = np.maximum((times - self._start_ns[segment]).astype(np.float64) - self._offset_ns[segment], 0.0)
        # The first time of each evenly spaced run is followed from the start of its segment. Then the states of the
        # ranks 2^d to 2^(d+1) − 1 follow from known ones by one matrix product for all of them.
        spacing_ns, rank = _runs(times, segment)
        states = self._states[segment]
        first = np.flatnonzero(rank == 0)
        states[first] = self.follow(segment[first], spans[first])
        flow_of_row = self._flow_of_segment[segment]
        for doubling in range(int(rank.max(initial=0)).bit_length()):
            rows = np.flatnonzero(rank >> doubling == 1)
            for number in np.unique(flow_of_row[rows], return_counts=True)[0]:
                here = rows[flow_of_row[rows] == number]
                transition = self._flows[number].transition(spacing_ns << doubling)
                states[here] = moved(states[here - (1 << doubling)], transition)
        return states

    def follow(self, segment: Times, spans_ns: Matrix) -> Matrix:
        """Return all states of these segments (m,) after `spans_ns` (m,), which need not be whole; shape (m, order)."""
        states = self._states[segment]
        flow_of_row = self._flow_of_segment[segment]
        for number in np.unique(flow_of_row, return_counts=True)[0]:  # alone it imports numpy.ma
            rows = flow_of_row == number
            states[rows] = self._flows[number].advance_many(states[rows], spans_ns[rows])
        return states


def _runs(times: Times, segment: Times) -> tuple[int, Times]:
    """Return (spacing [ns], rank of each time in its run); a run is evenly spaced within one segment.

    Only the first time of a run is followed from the start of its segment, the others by doubling from there.
    """
    gaps = np.diff(times)
    spacing_ns = int(np.median(gaps)) if len(gaps) else 0
    begins = np.ones(len(times), dtype=bool)
    if spacing_ns > 0:
        begins[1:] = (gaps != spacing_ns) | (np.diff(segment) != 0)
    place = np.arange(len(times))
    return spacing_ns, place - np.maximum.accumulate(np.where(begins, place, 0))
