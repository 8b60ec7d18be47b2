"""Traffic of a plan, in terms that are common to all protocols: one value for each axis, one for each bus.

A plan holds these values, adds nothing to them, and prints their texts. Delays count from the instant t_k at which the
drives latch their feedback; the torque computed from it acts at t_k + delay and is held for one period.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, Protocol

from haptic_fieldbus.drive.profile import MappedSignal, TimingSection
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.signals import LinkFlag, Signal

COMPUTE_NS = 50_000
"""Time that the plan grants the host from the last feedback to the first set-point [ns]."""
ADAPTER_LATENCY, JITTER = 0.25e-3, 0.1e-3
"""[s], of a real bus whose rig does not state them, for the longest delay alone: a USB adapter takes a quarter of a
millisecond for a frame, and a host with real-time rights is rarely later than a tenth."""
ANSWER_TIME, ANSWER_PERIODS = 0.015, 2
"""[s] and periods, the longer of them: so long a drive may take to answer what it is asked beside the exchange, before
it is asked again."""

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


def answer_time(period: float) -> float:
    """Return the time after which an answer beside the exchange counts as lost [s]."""
    return max(ANSWER_TIME, ANSWER_PERIODS * period)


@dataclass(frozen=True)
class Delay:
    """Delay from latch to torque, in parts [s]; the hold's T/2 is not included."""

    bus: float
    compute: float
    drive: float
    """Time from the reception of the set-point until the drive acts on it."""
    torque_loop: float
    """Time constant of the torque loop."""
    shortest: float | None = None
    """Shortest `transport` over all that is assumed; None: always as it is."""
    longest: float | None = None
    """Longest `transport` over all that is assumed, or that changes from period to period; None: always as it is."""
    lateness: float = 0.0
    """Longest time by which the host may be late in a period [s]."""
    acts_first: bool = False
    """True: a set-point that acts at the instant of a sample acts before it, so that the sample shows it."""

    @property
    def total(self) -> float:
        """Sum of all parts [s]."""
        return self.bus + self.compute + self.drive + self.torque_loop

    @property
    def transport(self) -> float:
        """Pure delay: all parts but the lag of the torque loop [s]."""
        return self.bus + self.compute + self.drive

    @property
    def range(self) -> tuple[float, float]:
        """Shortest and longest `transport` [s]."""
        shortest = self.transport if self.shortest is None else self.shortest
        return shortest, self.transport if self.longest is None else self.longest


@dataclass(frozen=True)
class OtherMasters:
    """How the set-points of another master are seen on a bus on which its messages cannot be heard."""

    shown_by: Signal | None
    """Signal that shows a set-point of another master before ours replaces it; None: no signal does."""
    blind: float = math.inf
    """Longest time for which a set-point of another master acts unseen [s]; infinity: for ever."""
    every: int = 1
    """Periods from one look at this axis to the next."""


class AxisTraffic(Protocol):
    """Traffic of one axis: its mapped signals, and their description in words."""

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        """Signals from the drive, in the order of their octets in the process image."""

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        """Signals to the drive, in the order of their octets in the process image."""

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield the lines of `plan`: a key, empty when the line continues the one before, and a text."""

    def summary(self) -> Iterator[str]:
        """Yield the lines of `run`: one for each message that goes in or out."""

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """Return the messages exchanged on the bus of that name, by their key in `plan --json`."""

    def fault_text(self, flag: LinkFlag, code: int, bus: str = "the bus") -> str:
        """Return the fault of a link flag in words; `code` is the code in the header."""


class BusTraffic(Protocol):
    """Traffic of one bus in each period, at the rate of the plan."""

    @property
    def load(self) -> float:
        """Share of the bus in use, worst case."""

    @property
    def highest_rate(self) -> float:
        """Highest rate of the loop that the bus can sustain [Hz]; 0 or less: none."""

    def of(self, axis: str) -> AxisTraffic:
        """Return the traffic of an axis as it is exchanged on this bus."""

    def others(self) -> "tuple[BusTraffic, ...]":
        """Return other ways of the same exchange that were not chosen, each at the rate of this one or at its own
        highest; empty where there is one way."""

    @property
    def exchange(self) -> str:
        """The way of the exchange in words; empty where there is one way."""

    @property
    def rate(self) -> float:
        """Rate of the loop [Hz]."""

    def latch(self, axis: str) -> float:
        """Return the time from the beginning of the exchange until the drive of an axis latches [s]."""

    @property
    def feedback_time(self) -> float:
        """Time from the beginning of the exchange until all feedback is received [s]."""

    @property
    def sending_ns(self) -> float:
        """Time that the set-points take on the bus [ns]."""

    def delay(self, axis: str) -> Delay:
        """Return the delay budget of an axis on this bus."""

    def guard(self, axis: str) -> float:
        """Time after which the drive of an axis switches its torque off by itself when the master is silent [s]."""

    def guarding(self, axis: str, rig: RigAxis) -> tuple[str, ...]:
        """Return what is written to the drive of an axis before its guard is proved, in a fixed order: an object or
        register with its value in each text. `rig` is the axis in the rig."""

    @property
    def silence(self) -> float:
        """Time without a device's own sign of life after which it counts as gone [s]; inf where devices send none."""

    @property
    def waits_for_answers(self) -> bool:
        """True when no set-point is sent while an answer is missing: the torque is then held and does not fade."""

    @property
    def doubted_periods(self) -> int:
        """Periods for which a position that looks torn is not believed."""

    @property
    def disturbance(self) -> float:
        """Time by which messages outside the exchange can delay it [s]."""

    def other_masters(self, axis: str) -> OtherMasters | None:
        """Return how set-points of another master are seen; None where its messages are heard on the bus."""

    def check(self, bus: str) -> None:
        """Raise BusOverloadError when the bus cannot carry this; `bus` is its name, empty when the plan has one bus."""

    @property
    def speed(self) -> str:
        """Speed of the bus in words: `1 Mbit/s`."""

    def line(self) -> str:
        """Return rate, speed of the bus and load in words."""


# When the torque of a sample acts: at the latest, at the earliest, and as the plan counts it.
#
# The way of a sample: the drive measures the position, latches it at SYNC (`encoder_latency` later), the adapter takes
# a frame to the host and another one back (`adapter_latency` each), and the drive takes the set-point over at its next
# control tick. A tick that is locked to SYNC makes all of this repeat. With one that runs free, the measurement is up
# to a control period older and the set-point waits for up to another one; the plan counts half a period for each, which
# is their mean. What the profile leaves open is planned as a locked tick and a position of the latch; only the longest
# delay takes the other case.

NO_TICK = 1e-9
"""Control period below which a drive takes over a target at once [s]."""


@dataclass(frozen=True)
class HostTimes:
    """Times of adapter and host [s]; None: unknown, except on a simulated bus, which adds none by itself."""

    adapter_latency: float | None = None
    jitter: float | None = None
    simulated: bool = False

    @property
    def known_latency(self) -> float:
        """Latency of the adapter for a frame and its answer, as far as it is known [s]."""
        return 2.0 * (self.adapter_latency or 0.0)

    @property
    def most(self) -> float:
        """Longest time by which adapter and host can delay a set-point beyond `known_latency` [s]."""
        is_known = self.simulated or self.adapter_latency is not None
        return (0.0 if is_known else 2.0 * ADAPTER_LATENCY) + self.lateness

    @property
    def lateness(self) -> float:
        """Longest time by which the host may be late in a period [s]."""
        return self.jitter if self.jitter is not None else 0.0 if self.simulated else JITTER


IDEAL = HostTimes(simulated=True)
"""A host that adds no time, as that of a simulated bus."""


def ways(
    timing: TimingSection, arrival: float, host: HostTimes, period: float, *, on_reception: bool
) -> tuple[float, float, float]:
    """Return the time from the measurement of a position to the torque of it as planned, the shortest and the longest.

    The set-point of the drive arrives so long after the latch, host as known [s].

    With `on_reception` False the set-point is taken over at the next SYNC.
    """
    locked, least = timing.control_tick == "sync", timing.encoder_latency or 0.0
    # A drive that does not measure at SYNC shows what it measured at its own last tick.
    most = least + (0.0 if locked and timing.encoder_latency is not None else timing.control_period)

    def acts(ready: float, tick: Literal["sync", "free", "at once"]) -> float:
        at = ready if on_reception else math.ceil(ready / period - NO_TICK) * period
        if tick == "free":
            return at + timing.control_period
        if tick == "at once" or timing.control_period < NO_TICK or not on_reception:  # SYNC is a tick
            return at
        # The tolerance keeps rounding from adding a whole period to an instant that is a multiple.
        return math.ceil(at / timing.control_period - 1e-9) * timing.control_period

    planned = least + acts(arrival, "free" if timing.control_tick == "free" else "sync")
    shortest = least + acts(arrival, "sync" if locked else "at once")
    return planned, shortest, most + acts(arrival + host.most, "sync" if locked else "free")


def round_down(rate: float) -> float:
    """Return the rate rounded down to two significant digits [Hz]."""
    step = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return math.floor(rate / step) * step
