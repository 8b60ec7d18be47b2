"""What a protocol says of its traffic, once for each axis and once for each bus of a plan.

The plan holds these values, adds nothing to them, and prints what they say. Times are counted from the instant t_k at
which the drives latch their feedback; the torque computed from it acts at t_k + delay and is held for a period.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.signals import LinkFlag

COMPUTE_NS = 50_000
"""[ns]; from the last feedback to the first set-point: what the plan grants the host."""

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


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


class AxisTraffic(Protocol):
    """How the signals of one axis travel."""

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        """In the order of their octets in the process image."""

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        """The same of what is sent."""

    def lines(self) -> Iterator[tuple[str, str]]:
        """For `plan`: a key, empty where the line before goes on, and a text."""

    def summary(self) -> Iterator[str]:
        """For `run`: what goes in and out, a line each."""

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """Lists of what is exchanged on the bus of that name, by the key that `plan --json` has for them."""

    def fault_text(self, flag: LinkFlag, code: int) -> str:
        """What happened when the bus raised this flag; `code` is that of an emergency."""


class BusTraffic(Protocol):
    """What one bus carries each period at the rate of the plan."""

    @property
    def load(self) -> float:
        """Share of the bus in use, worst case."""

    @property
    def highest_rate(self) -> float:
        """Of the loop [Hz] that the bus can sustain; 0 or less: none."""

    @property
    def latch(self) -> float:
        """From the beginning of the exchange until the drives latch [s]."""

    @property
    def feedback_time(self) -> float:
        """From the beginning of the exchange until all feedback is in [s]."""

    @property
    def sending_ns(self) -> float:
        """How long the set-points travel [ns]."""

    def delay(self, axis: str) -> Delay:
        """The delay budget of one of its axes."""

    def guard(self, axis: str) -> float:
        """Time after which the drive of an axis takes the torque away by itself, when nothing comes from us [s]."""

    def check(self, bus: str) -> None:
        """Raises BusOverloadError where the bus cannot carry this; `bus` is its name, empty where there is one."""

    @property
    def speed(self) -> str:
        """Of the bus, in words: `1 Mbit/s`."""

    def line(self) -> str:
        """Rate, speed of the bus and load, in words."""
