"""Live view of drives without torque: their own values, in the units of the bench.

Nothing is enabled and nothing is written. An axis without a described mechanism is shown in the drive's own steps
alone.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

from haptic_fieldbus.buses.access import Observer
from haptic_fieldbus.buses.scan_result import DriveReading
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.profile import DriveProfile, PowerState, PowerTable
from haptic_fieldbus.drive.rig import RigAxis, metres_per_revolution, steps_per_revolution, torque_step, velocity_step
from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Watched:
    """A watched axis; `known`: a rig describes its mechanism and motor."""

    rig: RigAxis
    profile: DriveProfile
    power: PowerTable
    known: bool = True


@dataclass(frozen=True)
class View:
    """Shown values of one axis; None for values that neither the drive nor the rig gives."""

    node: int
    position: float | None
    """Position of the handle [m or rad]; zero is that of the rig, or the first position."""
    position_counts: int | None
    velocity: float | None
    """Velocity of the handle [m/s or rad/s]; computed from positions if the drive offers none."""
    torque_actual: float | None
    """At the motor shaft [N·m]."""
    torque_actual_raw: int | None
    statusword: int | None
    state: str | None
    nmt_state: str | None
    error_code: int | None
    age_s: float | None
    life_age_s: float | None
    note: str | None
    unit: str | None
    """Unit of the position: m or rad."""

    def to_json(self) -> Json:
        return asdict(self)


class Viewer:
    """Computes the views of one axis; it keeps the zero, and the last position for the velocity."""

    def __init__(self, axis: Watched) -> None:
        self._axis = axis
        self._offers = axis.profile.offers()
        zero = axis.rig.mechanism.zero
        self._zero = None if zero == "start" else zero
        self._before: tuple[int, float] | None = None
        """Instant [ns] and place of the last position."""

    def view(self, glimpse: DriveReading) -> View:
        """Return a reading in the units of the bench."""
        axis, values = self._axis, glimpse.values
        position = self._position(values.get(Signal.POSITION))
        statusword = values.get(Signal.STATUSWORD)
        state = None if statusword is None else axis.power.state(statusword)
        velocity = self._velocity(glimpse, position)
        enabled = ENABLED if state is PowerState.OPERATION_ENABLED else ""
        torque = values.get(Signal.TORQUE_ACTUAL)
        offered = None if torque is None else self._offers[Signal.TORQUE_ACTUAL].unit
        step = None if offered is None else torque_step(offered, axis.rig, axis.profile.full_scale)
        self._before = None if position is None else (glimpse.t_ns, position)
        return View(
            node=axis.rig.node,
            position=position,
            position_counts=values.get(Signal.POSITION),
            velocity=velocity,
            torque_actual=None if torque is None or step is None else torque * step,
            torque_actual_raw=torque,
            statusword=statusword,
            state=None if state is None else state.value,
            nmt_state=glimpse.nmt_state,
            error_code=glimpse.error_code,
            age_s=glimpse.age,
            life_age_s=glimpse.life_age,
            note="; ".join(filter(None, (enabled, glimpse.note))) or None,
            unit=axis.rig.mechanism.workspace.length_unit if axis.known else None,
        )

    def _position(self, counts: int | None) -> float | None:
        if counts is None or not self._axis.known:
            return None
        if self._zero is None:
            self._zero = counts
        rig = self._axis.rig
        steps = steps_per_revolution(
            self._offers[Signal.POSITION].unit, rig.encoder_counts_per_revolution, metres_per_revolution(rig)
        )
        return (counts - self._zero) * rig.mechanism.sign * 2 * math.pi * rig.mechanism.ratio / steps

    def _velocity(self, glimpse: DriveReading, position: float | None) -> float | None:
        rig = self._axis.rig
        if Signal.VELOCITY in glimpse.values and self._axis.known:
            step = velocity_step(self._offers[Signal.VELOCITY].unit, rig.encoder_counts_per_revolution)
            return glimpse.values[Signal.VELOCITY] * step * rig.mechanism.ratio * rig.mechanism.sign
        if position is None or self._before is None or glimpse.t_ns <= self._before[0]:
            return None
        return (position - self._before[1]) / (glimpse.t_ns - self._before[0]) * 1e9


ENABLED = "left enabled: torque may act"
"""Note about a drive in *operation enabled*, which another master has enabled."""


def watch_axes(
    axes: Mapping[str, Watched], onlookers: list[Observer], clock: Clock, interval: float, duration: float = math.inf
) -> Iterator[dict[str, View]]:
    """Yield the view of all axes every `interval` for `duration` [s]; raises BusError when a bus is dead."""
    viewers = {name: Viewer(axis) for name, axis in axes.items()}
    began_ns, period_ns = clock.now_ns(), round(interval * 1e9)
    number = 0
    while True:
        seen = {name: glimpse for onlooker in onlookers for name, glimpse in onlooker.look().items()}
        yield {name: viewers[name].view(seen[name]) for name in axes}
        # Looks that were late are left out, never made up for.
        number = max(number + 1, (clock.now_ns() - began_ns) // period_ns)
        if number * interval >= duration:
            return
        clock.sleep_until(began_ns + number * period_ns)
