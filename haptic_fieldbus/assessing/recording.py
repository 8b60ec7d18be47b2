"""What a simulated run leaves to be judged by: what the loop recorded, and what the shaft truly did."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.signals import Signal

Array = NDArray[np.float64]
Times = NDArray[np.int64]

WHOLE_PERIODS_OF_DELAY = 4
"""Commands that act later than so many periods after their sample are not recognised."""


class TrueMotion(Protocol):
    """The true motion of a simulated motor shaft."""

    def sample(self, times_ns: Times) -> tuple[Array, Array, Array]:
        """Position [rad], velocity [rad/s], motor torque after the torque loop [N·m] at these times."""

    def targets(self) -> tuple[Times, Array]:
        """When the drive took over each target torque [ns], and its value [N·m]."""


class Truth(Protocol):
    """The simulated drives of a bus, as far as a run is judged by them."""

    def trajectory(self, node: int) -> TrueMotion:
        """The true motion of a drive's shaft up to the present."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What the loop did in each period from the first enabled one on, in the workspace; all of shape (n,)."""

    times_ns: Times
    """When the position was latched."""
    position: Array
    """As decoded [m or rad]."""
    force: Array
    """Of the scene [N or N·m]."""
    command: Array
    """After limits, fading and rounding to the drive's steps [N or N·m]."""
    velocity: Array | None = None
    """As estimated or read [m/s or rad/s]; None where it was neither."""
    tachometer: bool = False
    """Whether velocity was read and the position integrated from it, instead of the other way round."""


@dataclass(frozen=True)
class Conversion:
    """Shaft to workspace: position = ratio·(angle − zero), torque = ratio·force."""

    ratio: float
    """Metres or radians of the handle per radian of the motor, with the mechanism's sign."""
    zero: float = 0.0
    """Shaft angle where the handle is at 0 [rad]."""


def true_motion(times_ns: Times, trajectory: TrueMotion, conversion: Conversion) -> tuple[dict[Signal, Array], Array]:
    """(position and velocity of the handle, force of the motor) in the workspace."""
    angle, speed, torque = trajectory.sample(times_ns)
    handle = {
        Signal.POSITION: conversion.ratio * (angle - conversion.zero),
        Signal.VELOCITY: conversion.ratio * speed,
    }
    return handle, torque / conversion.ratio


def with_time(motion: Mapping[Signal, Array], times_ns: Times, recording: Recording) -> dict[Signal, Array]:
    """With the time since the first recorded period [ns]."""
    return {**motion, Signal.ELAPSED_NS: (times_ns - recording.times_ns[0]).astype(np.float64)}


def made_real(recording: Recording, sampled: Mapping[Signal, Array]) -> dict[str, dict[Signal, Array]]:
    """What the loop knew of an axis in each period, by the source of error that is made real last."""
    decoded = {**sampled, Signal.POSITION: recording.position}
    known = decoded if recording.velocity is None else {**decoded, Signal.VELOCITY: recording.velocity}
    feedback = {"sampling and delay": {**sampled}}
    if recording.tachometer:
        return {**feedback, "tachometer": known}
    feedback["encoder"] = decoded
    return feedback if recording.velocity is None else {**feedback, "estimator": known}


def columns_of(needs: Sequence[Signal], feedback: Mapping[Signal, Array]) -> list[list[float]]:
    """The signals that a law takes, in their order, as plain numbers; the time is a whole one."""
    return [
        (feedback[signal].astype(np.int64) if signal is Signal.ELAPSED_NS else feedback[signal]).tolist()
        for signal in needs
    ]


def target_in_force(trajectory: TrueMotion, times_ns: Times) -> Array:
    """The target torque that the drive follows at these times [N·m]; none before the first."""
    target_ns, target = trajectory.targets()
    values: Array = np.concatenate([[0.0], target])[np.searchsorted(target_ns, times_ns, side="right")]
    return values


def acting(recording: Recording, trajectory: TrueMotion, ratio: float) -> tuple[Times, NDArray[np.int64]]:
    """(instants, periods): from each instant on acts the command of that period, until the next.

    A period belongs to the target taken over next after its sample, or so many periods later as makes most values
    agree. A period without a target of its own acted if its value was in force anyway, and was lost otherwise.
    """
    target_ns, target = trajectory.targets()
    command = recording.command * ratio
    tolerance = 1e-6 * float(np.abs(command).max(initial=0.0))
    newest = np.searchsorted(recording.times_ns, target_ns, side="right") - 1
    agreeing: list[tuple[int, NDArray[np.int64]]] = []
    for whole in range(WHOLE_PERIODS_OF_DELAY):
        period = newest - whole
        agrees = (period >= 0) & (np.abs(command[period] - target) <= tolerance)
        agreeing.append((whole, np.flatnonzero(agrees)))
    whole, found = max(agreeing, key=lambda entry: (len(entry[1]), -entry[0]))
    if not len(found):
        raise ValueError("no recorded command was taken over by the drive")
    delay_ns = int(np.median(target_ns[found] - recording.times_ns[newest[found] - whole]))
    acting_ns = recording.times_ns + delay_ns
    own = np.zeros(len(command), dtype=bool)
    latest_first = found[::-1]
    acting_ns[newest[latest_first] - whole] = target_ns[latest_first]
    own[newest[found] - whole] = True
    row = np.flatnonzero(own | (np.abs(target_in_force(trajectory, acting_ns) - command) <= tolerance))
    return np.maximum.accumulate(acting_ns[row]), row
