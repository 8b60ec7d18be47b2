"""What a plan costs on a CAN bus: load, and the delay from the encoder's latch to the motor's torque.

t_k is the end of SYNC k, where the drive latches its position. The torque computed from it acts at t_k + delay and is
held for a period. Worst-case stuffing is assumed, as is a bus without foreign frames.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.drive.pdo import INTERFRAME_SPACE_BITS, Pdo, worst_case_bits
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.errors import BusOverloadError

COMPUTE_NS = 50_000
"""[ns]; from the last TPDO to the first RPDO: what the plan grants the host."""
LARGEST_BUS_LOAD = 0.9
HEARTBEATS_PER_DEADLINE = 5
NODE_HEARTBEAT_MS = 100


@dataclass(frozen=True)
class Delay:
    """From latch to torque [s]; the hold's T/2 is not part of it."""

    bus: float
    compute: float
    drive: float
    torque_loop: float

    @property
    def total(self) -> float:
        return self.bus + self.compute + self.drive + self.torque_loop

    @property
    def transport(self) -> float:
        """Pure delay: all but the torque loop's lag."""
        return self.bus + self.compute + self.drive


@dataclass(frozen=True)
class Exchange:
    """One period's traffic of one bus, worst case; bit rate in bit/s."""

    tpdos: tuple[Pdo, ...]
    rpdos: tuple[Pdo, ...]
    bitrate: int
    waiting: float = 0.0
    """[s]; from its last TPDO to that of the slowest bus of the rig: only then is there something to compute with."""

    @property
    def feedback_time(self) -> float:
        """[s]; SYNC and TPDOs."""
        bits = worst_case_bits(0) + sum(worst_case_bits(pdo.size) for pdo in self.tpdos)
        return bits / self.bitrate

    @property
    def answer_bits(self) -> int:
        """From the end of SYNC to the end of the last RPDO."""
        return sum(worst_case_bits(pdo.size) for pdo in self.tpdos + self.rpdos) - INTERFRAME_SPACE_BITS

    @property
    def period_bits(self) -> int:
        return worst_case_bits(0) + self.answer_bits + INTERFRAME_SPACE_BITS

    @property
    def shortest_period(self) -> float:
        """[s]; SYNC, TPDOs, the wait for other buses, compute and RPDOs one after another."""
        return self.period_bits / self.bitrate + self.waiting + COMPUTE_NS * 1e-9

    def load(self, rate: float, heartbeat_every: int, nodes: int) -> float:
        """Share of the bus in use, heartbeats of master and nodes included."""
        heartbeats = rate / heartbeat_every + nodes * 1000 / NODE_HEARTBEAT_MS
        return (self.period_bits * rate + worst_case_bits(1) * heartbeats) / self.bitrate


def heartbeat_every(deadline: float, rate: float) -> int:
    """Periods between our heartbeats, so that the drive's deadline [s] spans several."""
    return max(1, int(deadline / HEARTBEATS_PER_DEADLINE * rate))


def highest_rate(exchange: Exchange, rate: float, load: float) -> float:
    """[Hz]; what the bus could carry, from the load at `rate`; heartbeats stay as they are. 0 or less: nothing."""
    heartbeats = load - exchange.period_bits * rate / exchange.bitrate
    return min(
        (LARGEST_BUS_LOAD - heartbeats) * exchange.bitrate / exchange.period_bits, 1.0 / exchange.shortest_period
    )


def check_load(exchange: Exchange, rate: float, load: float, bus: str = "") -> None:
    """Raises BusOverloadError, with the numbers and the highest rate, when the bus cannot carry the exchange.

    `bus` is its name, where there are several.
    """
    if load <= LARGEST_BUS_LOAD and exchange.shortest_period * rate <= 1.0:
        return
    highest, subject = highest_rate(exchange, rate, load), f"bus {bus}: " if bus else ""
    fits = f"Would fit: --rate {_round_down(highest):g}" if highest > 0.0 else "No rate would fit"
    raise BusOverloadError(
        f"{subject}{rate:g} Hz needs {exchange.period_bits} bits a period: {100 * load:.0f} % of {exchange.bitrate} "
        f"bit/s, and {exchange.shortest_period * 1e3:.2f} ms for SYNC, TPDOs, {COMPUTE_NS / 1e3:.0f} µs of computing "
        f"and RPDOs. At most {100 * LARGEST_BUS_LOAD:.0f} % and one period are allowed. {fits}"
    )


def _round_down(rate: float) -> float:
    step = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return math.floor(rate / step) * step


def delay_of(exchange: Exchange, profile: DriveProfile, period: float) -> Delay:
    """The budget of one axis of the exchange; the RPDO's type and the profile say when the drive acts."""
    bus = exchange.answer_bits / exchange.bitrate + exchange.waiting
    compute = COMPUTE_NS * 1e-9
    torque_loop = 1.0 / (2 * math.pi * profile.timing.torque_bandwidth)
    if acts_on_reception(profile, exchange.rpdos):
        acts_at = _next_tick(bus + compute, profile.timing.control_period)
    else:
        acts_at = period
    return Delay(bus, compute, acts_at - bus - compute, torque_loop)


def acts_on_reception(profile: DriveProfile, rpdos: Sequence[Pdo]) -> bool:
    """False also when the profile does not know: the longer delay is assumed."""
    return profile.pdo.rpdo_acts == "reception" and not any(pdo.synchronous for pdo in rpdos)


def _next_tick(instant: float, control_period: float) -> float:
    if control_period == 0.0:
        return instant
    return math.ceil(instant / control_period - 1e-9) * control_period
