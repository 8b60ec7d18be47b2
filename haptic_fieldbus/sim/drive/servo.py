"""The drive's power stage and encoder: it takes torque targets and returns counts.

Theory: a target that arrives takes effect at the next control tick and is held until the next one. Ticks are multiples
of the control period counted from the end of the last SYNC (from power-on before the first one); a SYNC is itself a
tick. Ticks may also run free: then they are counted from power-on by the drive's own clock, and the encoder is read at
them. The position may be older by the latency of the encoder. The encoder counts floor(N·θ/2π + phase + 1/2) in 32
bits; `phase` is the position of its zero within a count.
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.mechanics.body import Body

_WRAP = 1 << 32
_HALF = 1 << 31


@dataclass(frozen=True)
class FirmwareTimes:
    """Times of the drive's firmware [ns]."""

    control_period_ns: int
    free: bool = False
    """Whether the control ticks run free, instead of being counted from SYNC."""
    phase: float = 0.0
    """Free: the first tick after power-on, as a share of the period."""
    drift: float = 0.0
    """Free: relative error of the drive's clock, positive when it is slow."""
    latency_ns: int = 0
    """Age of the position when it is read."""


class Servo:
    """The interface between the drive's firmware and the plant; times in integer nanoseconds."""

    def __init__(
        self,
        plant: Body,
        *,
        counts_per_revolution: int,
        timing: FirmwareTimes,
        phase: float = 0.0,
        stated_counts: int | None = None,
        torque_scale: float = 1.0,
    ) -> None:
        """Join them; `stated_counts` are the counts per revolution that the drive takes for true, None: the true ones.

        `torque_scale` is the torque of the motor over the torque that the drive believes to give.
        """
        self.plant = plant
        self.stuck_until_ns = 0
        """Until this time the encoder keeps its last counts."""
        self._counts_per_radian = counts_per_revolution / (2 * math.pi)
        self._round = phase + 0.5
        self._offset = 0
        self._shown = 0
        self._period_ns = timing.control_period_ns
        self._free = timing.free and timing.control_period_ns > 0
        self._tick_ns = timing.control_period_ns * (1.0 + timing.drift)
        self._latency_ns = timing.latency_ns
        self._late = self._free or self._latency_ns > 0
        """Whether the drive's angle is older than the present time."""
        self._grid_ns = plant.t_ns + (round(timing.phase * self._tick_ns) if self._free else 0)
        self._pending_ns = NEVER_NS
        self._pending = 0.0
        self.encoder_factor = counts_per_revolution / (stated_counts or counts_per_revolution)
        """Ratio of actual to correct counts of a motion; negative: backwards."""
        self.torque_sign = 1.0
        """−1.0: the motor turns the other way for the same current."""
        self.torque_scale = torque_scale
        """Ratio of actual to correct torque for the same current."""
        self._sound = torque_scale == 1.0
        self._largest = math.inf
        self._target = 0.0

    def advance(self, t_ns: int) -> None:
        """Move the plant to `t_ns`; on the way a waiting target takes effect at its tick."""
        if self._pending_ns <= t_ns:
            self.plant.advance(self._pending_ns)
            self._pending_ns = NEVER_NS
            self._target = self._pending
            self.plant.set_target(self._pending if self._sound else self._made(self._pending))
        self.plant.advance(t_ns)

    def sync(self, t_ns: int) -> None:
        """Count the control ticks from this SYNC on."""
        self.advance(t_ns)
        if self._free:
            return
        self._grid_ns = t_ns
        # The SYNC is a tick, so a waiting target takes effect now.
        if self._pending_ns != NEVER_NS and self._pending_ns > t_ns:
            self._pending_ns = t_ns

    def tick(self, t_ns: int) -> int:
        """Return the first control tick at or after `t_ns`; `t_ns` itself for a drive without control period."""
        if not self._period_ns:
            return t_ns
        if self._free:
            return max(t_ns, self._grid_ns + round(math.ceil((t_ns - self._grid_ns) / self._tick_ns) * self._tick_ns))
        # -(-a // b) is the quotient rounded up, exact for integers.
        return self._grid_ns + -(-(t_ns - self._grid_ns) // self._period_ns) * self._period_ns

    def next_tick(self, t_ns: int, period_ns: int) -> int:
        """Return the first multiple of `period_ns` at or after `t_ns`, for loops that need a period in every drive."""
        return self._grid_ns + -(-(t_ns - self._grid_ns) // period_ns) * period_ns

    def command(self, torque: float, t_ns: int) -> None:
        """Set a new torque target [N·m]; it replaces one that is still waiting."""
        if self._pending_ns <= t_ns:
            self.advance(self._pending_ns)
        self._pending = torque
        self._pending_ns = self.tick(t_ns)

    def cut(self, t_ns: int) -> None:
        """Switch the power stage off: the target is zero at once."""
        self.advance(t_ns)
        self._pending_ns = NEVER_NS
        self._target = 0.0
        self.plant.set_target(0.0)

    def jump(self, counts: int) -> None:
        """Let the encoder lose or gain counts from now on."""
        self._offset += counts

    def rescale(self, factor: float) -> None:
        """Let the encoder count `factor` times as much for the same motion, from the present count on."""
        self._round += self.plant.state[0] * self._counts_per_radian * (1.0 - factor)
        self._counts_per_radian *= factor
        self.encoder_factor *= factor

    def impair(self, largest: float, sign: float = 1.0) -> None:
        """Limit the torque of the current loop to `largest` [N·m], and multiply the torque of the motor by `sign`.

        Earlier faults persist: a second fault does not undo the first.
        """
        self._largest, self.torque_sign = min(self._largest, largest), min(self.torque_sign, sign)
        self._sound = False
        self.plant.set_target(self._made(self._target))

    def _made(self, torque: float) -> float:
        """Return the effective torque target of the motor."""
        return self.torque_sign * self.torque_scale * max(-self._largest, min(self._largest, torque))

    def counts(self) -> int:
        """Return the encoder's counts at the plant's present time, wrapped to 32 bits."""
        plant = self.plant
        if plant.t_ns >= self.stuck_until_ns:
            angle = plant.state[0]
            if self._late:
                read_ns = plant.t_ns
                if self._free:
                    ticks = math.floor((read_ns - self._grid_ns) / self._tick_ns)
                    read_ns = self._grid_ns + round(ticks * self._tick_ns)
                angle = plant.recorder.angle_at(read_ns - self._latency_ns)
            shown = math.floor(angle * self._counts_per_radian + self._round) + self._offset
            self._shown = (shown + _HALF) % _WRAP - _HALF
        return self._shown

    def fine_counts(self) -> float:
        """Return the counts before rounding and wrapping; a whole number in the middle of a count."""
        if self.plant.t_ns < self.stuck_until_ns:
            return float(self._shown)
        return self.plant.state[0] * self._counts_per_radian + self._round - 0.5 + self._offset
