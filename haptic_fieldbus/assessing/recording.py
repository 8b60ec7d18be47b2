"""Data for the assessment of a simulated run: the loop's recording, and the true motion of the shaft."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.signals import Signal

Array = NDArray[np.float64]
Times = NDArray[np.int64]

WHOLE_PERIODS_OF_DELAY = 4
"""Longest delay from a sample to its command, in whole periods, that `acting` considers (0 up to this, exclusive)."""


class TrueMotion(Protocol):
    """The true motion of a simulated motor shaft."""

    end_ns: int
    """Instant up to which it is known [ns]."""

    def sample(self, times_ns: Times) -> tuple[Array, Array, Array]:
        """Return position [rad], velocity [rad/s] and motor torque after the torque loop [N·m], each `(n_times,)`."""

    def targets(self) -> tuple[Times, Array]:
        """Return the instants at which the drive took over targets [ns], and the targets [N·m], each `(n_targets,)`."""


class Truth(Protocol):
    """Access to the true motion of the simulated drives on one bus."""

    def trajectory(self, node: int) -> TrueMotion:
        """Return the true motion of a drive's shaft up to the present."""

    def so_far(self, node: int) -> TrueMotion:
        """Return the true motion up to the last simulated instant, without advancing the simulation."""

    def forget(self, before_ns: int) -> None:
        """Drop the motion before an instant [ns]."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Feedback and commands of one axis in its workspace, one value for each period in operation enabled.

    All arrays have the shape `(n_periods,)`.
    """

    times_ns: Times
    """Instants at which the position was latched."""
    position: Array
    """Decoded position [m or rad]."""
    force: Array
    """Force of the scene [N or N·m]."""
    command: Array
    """Commanded force after limits, fading and rounding to the drive's torque step [N or N·m]."""
    velocity: Array | None = None
    """Velocity, estimated or read from the drive [m/s or rad/s]; None without a velocity in the plan."""
    tachometer: bool = False
    """True when the drive offers velocity only, and the position was integrated from it."""
    overlap: int = 0
    """Number of periods at the beginning that the previous part contains too; 0 for the first part or a whole run."""
    began_ns: int | None = None
    """Instant of the first period of the run; None: that of this recording."""


@dataclass(frozen=True)
class Conversion:
    """Conversion from the motor shaft to the workspace: position = ratio·(angle − zero), torque = ratio·force."""

    ratio: float
    """Travel of the handle per radian of the motor [m/rad or rad/rad], with the mechanism's sign."""
    zero: float = 0.0
    """Shaft angle at which the handle is at 0 [rad]."""


def true_motion(times_ns: Times, trajectory: TrueMotion, conversion: Conversion) -> tuple[dict[Signal, Array], Array]:
    """Return the handle's true position and velocity, and the motor's force, in the workspace, each `(n_times,)`."""
    angle, speed, torque = trajectory.sample(times_ns)
    handle = {Signal.POSITION: conversion.ratio * (angle - conversion.zero), Signal.VELOCITY: conversion.ratio * speed}
    return handle, torque / conversion.ratio


def with_time(motion: Mapping[Signal, Array], times_ns: Times, recording: Recording) -> dict[Signal, Array]:
    """Return the motion with `Signal.ELAPSED_NS` added: the time since the first recorded period [ns], `(n_times,)`."""
    began_ns = recording.times_ns[0] if recording.began_ns is None else recording.began_ns
    return {**motion, Signal.ELAPSED_NS: (times_ns - began_ns).astype(np.float64)}


def made_real(recording: Recording, sampled: Mapping[Signal, Array]) -> dict[str, dict[Signal, Array]]:
    """Return the feedback of each stage, in the order in which sources of error are added.

    A key is the source that the stage adds; its value maps signals to arrays `(n_periods,)`. The first stage has the
    true motion `sampled` at the latch instants, the last stage has the feedback as the loop used it.
    """
    decoded = {**sampled, Signal.POSITION: recording.position}
    known = decoded if recording.velocity is None else {**decoded, Signal.VELOCITY: recording.velocity}
    feedback = {"sampling and delay": {**sampled}}
    if recording.tachometer:
        # Position and velocity come from the same reading, so their errors cannot be told apart.
        return {**feedback, "tachometer": known}
    feedback["encoder"] = decoded
    return feedback if recording.velocity is None else {**feedback, "estimator": known}


def columns_of(needs: Sequence[Signal], feedback: Mapping[Signal, Array]) -> list[list[float]]:
    """Return one list of plain numbers for each signal in `needs`, in that order; elapsed time as int.

    The laws are those of the loop, which take Python floats, never arrays.
    """
    columns = ((signal, feedback[signal]) for signal in needs)
    return [(each.astype(np.int64) if signal is Signal.ELAPSED_NS else each).tolist() for signal, each in columns]


def target_in_force(trajectory: TrueMotion, times_ns: Times) -> Array:
    """Return the target torque that the drive follows at these times [N·m], `(n_times,)`; 0 before the first target."""
    target_ns, target = trajectory.targets()
    # With a 0 in front, the number of targets taken over so far is the index of the one in force.
    return np.asarray(np.concatenate([[0.0], target])[np.searchsorted(target_ns, times_ns, side="right")])


class CommandDelay:
    """Finds the instant from which each command of a run acts, part by part.

    A target does not show the period that computed it, so it is assigned by its value. The delay from sample to target
    is assumed to be the same whole number of periods during the whole run: the number with which most targets so far
    equal their command.
    """

    def __init__(self) -> None:
        self._agreeing = [0] * WHOLE_PERIODS_OF_DELAY
        self._largest = 0.0
        self._delay_ns: int | None = None

    def acting(self, recording: Recording, trajectory: TrueMotion, ratio: float) -> tuple[Times, NDArray[np.int64]]:
        """Return instants [ns] and indices of periods, both `(n_acting,)`: each command acts from its instant on.

        A period without a target of its own still acted if its value was in force at that time (a drive takes over
        nothing if the value stays the same). Otherwise its command was lost and is left out.

        Raises ValueError when no target of the run has equalled a recorded command.
        """
        target_ns, target = trajectory.targets()
        command = recording.command * ratio
        self._largest = max(self._largest, float(np.abs(command).max(initial=0.0)))
        tolerance = 1e-6 * self._largest
        # Index of the newest period sampled before each target was taken over; −1 before the first period.
        newest = np.searchsorted(recording.times_ns, target_ns, side="right") - 1
        agreeing: list[NDArray[np.int64]] = []
        for whole in range(WHOLE_PERIODS_OF_DELAY):
            period = newest - whole
            agreeing.append(np.flatnonzero((period >= 0) & (np.abs(command[period] - target) <= tolerance)))
            self._agreeing[whole] += len(agreeing[whole])
        # The shortest delay among equals: a constant command agrees with every delay.
        whole = max(range(WHOLE_PERIODS_OF_DELAY), key=lambda whole: (self._agreeing[whole], -whole))
        found = agreeing[whole]
        if len(found):
            self._delay_ns = int(np.median(target_ns[found] - recording.times_ns[newest[found] - whole]))
        if self._delay_ns is None:
            raise ValueError("the drive accepted no recorded command")
        acting_ns = recording.times_ns + self._delay_ns
        own = np.zeros(len(command), dtype=bool)
        # numpy keeps the last of several writes to one index: in reverse order, the first target of a period wins.
        latest_first = found[::-1]
        acting_ns[newest[latest_first] - whole] = target_ns[latest_first]
        own[newest[found] - whole] = True
        row = np.flatnonzero(own | (np.abs(target_in_force(trajectory, acting_ns) - command) <= tolerance))
        return np.maximum.accumulate(acting_ns[row]), row
