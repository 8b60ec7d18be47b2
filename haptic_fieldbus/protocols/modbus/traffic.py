"""Traffic of a plan on a Modbus line: time of all requests, highest rate, and the delay from latch to torque.

A period begins with the first request. All drives are read one after another, each latching its registers when it has
worked on its request; the torque is computed; and where no function 23 has written already, all drives are written.
The next period may begin when the last answer is in and the silence after it is over.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

from haptic_fieldbus.defaults import DEFAULT_RATE
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.errors import BusOverloadError
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.protocols.modbus import register_traffic
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile
from haptic_fieldbus.protocols.modbus.register_traffic import LineTimes, RegisterTraffic, Transaction, possible
from haptic_fieldbus.protocols.protocol import BusMember
from haptic_fieldbus.protocols.traffic import COMPUTE_NS, IDEAL, Delay, HostTimes, OtherMasters, round_down, ways
from haptic_fieldbus.signals import Signal

RESERVE = 0.05
"""Share by which a period is longer than its requests need, where no rate is asked for: what was late is made up."""
LAGS = 3.0
"""Time constants of the torque loop after which torque actual shows a set-point."""
PERIODS_PER_GUARD = 5
"""A drive's watchdog covers at least so many periods."""


ModbusMember = BusMember[ModbusProfile, RegisterTraffic]


@dataclass(frozen=True)
class Timeline:
    """Times from the beginning of a period [s]."""

    latched: dict[str, float]
    """When the drive of each axis reads its motion."""
    written: dict[str, float]
    """When it writes its set-point; with function 23 that of the period before."""
    feedback: float
    """When the last answer of the reading part is in."""
    end: float
    """When the next period can begin."""
    shown: dict[str, float]
    """When it reads the register that shows a set-point of another master; an axis without one is not there."""


@dataclass(frozen=True)
class ModbusTraffic:
    """Traffic of one line in a period; the rate is in Hz."""

    members: tuple[ModbusMember, ...]
    wire: LineTimes
    way: Transaction
    rate: float
    waiting: float = 0.0
    """Time from the last answer of this line to the feedback of the slowest bus, when computing can begin [s]."""
    host: HostTimes = IDEAL
    """Times of adapter and host."""
    silence: ClassVar = math.inf
    """Drives on Modbus send no signs of life of their own."""
    doubted_periods: ClassVar = 1
    """A drive may tear a value of two registers: a jump by about 65536 counts counts only when it is seen twice."""
    disturbance: ClassVar = 0.0
    """A request beside the exchange takes the place of a set-point and adds no time."""

    @cached_property
    def instants(self) -> Timeline:
        """Times of one period."""
        latched, written, shown, at = {}, {}, {}, 0.0
        # Any one of the target torques is read back in a period, so the longest time counts.
        for member in self.members:
            if (block := self.of(member.axis).asked) is not None:
                request = register_traffic.RegisterRequest(member.profile.line.reading or READ_HOLDING, block)
                shown[member.axis], end = self._pass(member, request, 0.0)
                at = max(at, end)
        for member in self.members:
            for request in self.of(member.axis).reading:
                executed, at = self._pass(member, request, at)
                if request.read is not None and request.read.has(member.traffic.motion):
                    latched[member.axis] = executed
                if request.read is not None and request.read.has(self.shown_by(member.axis)):
                    shown[member.axis] = executed
                if request.write is not None:
                    written[member.axis] = executed
        feedback = at = at - self.wire.silence
        # Computing and waiting go on during the silence that the line needs anyway.
        at += max(self.wire.silence, self.waiting + COMPUTE_NS * 1e-9)
        for member in self.members:
            for request in self.of(member.axis).writing:
                written[member.axis], at = self._pass(member, request, at)
        return Timeline(latched, written, feedback, at, shown)

    def shown_by(self, axis: str) -> Signal:
        """Return the signal that shows set-points of another master, whether or not it is read."""
        member = self.member(axis)
        if self.of(axis).asked is not None or member.profile.echo is None:
            return Signal.TARGET_ASKED
        return Signal.TORQUE_ACTUAL if self.way is Transaction.READ_WRITE else member.profile.echo

    def other_masters(self, axis: str) -> OtherMasters:
        """Return how set-points of another master are seen in the registers of a drive, before ours replace them."""
        shown_by, instants, member = self.shown_by(axis), self.instants, self.member(axis)
        if axis not in instants.shown:
            return OtherMasters(None)
        # When a drive writes and reads during its answer time, and when a set-point acts, is known no better.
        unsure = member.profile.line.answer_time + member.profile.timing.control_period
        lag = LAGS * member.profile.torque_lag if shown_by is Signal.TORQUE_ACTUAL else 0.0
        turns = sum(self.of(each.axis).asked is not None for each in self.members)
        every = turns if shown_by is Signal.TARGET_ASKED else 1
        return OtherMasters(shown_by, instants.written[axis] - instants.shown[axis] + unsure + lag, every)

    def _pass(self, member: ModbusMember, request: register_traffic.RegisterRequest, at: float) -> tuple[float, float]:
        """Return when the drive executes a request that is sent at that time, and when the next may be sent [s]."""
        answer_time = member.profile.line.answer_time
        end = at + self.wire.exchange(request, answer_time) + self.wire.silence
        return at + self.wire.executed(request, answer_time), end

    @cached_property
    def _bound(self) -> dict[str, RegisterTraffic]:
        """Registers of each axis with the requests of this way."""
        return {each.axis: each.traffic.requested(self.way, self.wire, each.profile.line) for each in self.members}

    def of(self, axis: str) -> RegisterTraffic:
        """Return the registers of an axis with their requests."""
        return self._bound[axis]

    def guard(self, axis: str) -> float:
        """Time after which the watchdog of the drive acts [s]: that of its profile, but five periods at least, in whole
        steps of its register."""
        watchdog = self.member(axis).profile.watchdog
        deadline, unit = (watchdog.deadline, watchdog.time.unit) if watchdog is not None else (0.0, "ms")
        steps = STEPS_PER_SECOND.get(unit, 1e3)
        return math.ceil(max(deadline, PERIODS_PER_GUARD / self.rate) * steps - 1e-9) / steps

    def guarding(self, axis: str, rig: RigAxis) -> tuple[str, ...]:
        """Return what is written to the drive of an axis before its watchdog is proved: watchdog, reactions, set-up."""
        profile = self.member(axis).profile
        watchdog, mode = profile.watchdog, profile.mode
        held = [(each.address, str(each.value)) for each in profile.setup]
        if watchdog is not None:
            held += [(each.address, str(each.value)) for each in watchdog.writes]
            held += [(watchdog.time.address, f"{round(1e3 * self.guard(axis))} ms, in {watchdog.time.unit}")]
        if mode is not None:
            held += [(mode.write.address, str(mode.value))]
        return tuple(f"register {address:04X}h = {value}" for address, value in held)

    @property
    def waits_for_answers(self) -> bool:
        """True on TCP: requests would queue behind one without an answer, and be executed late."""
        return self.wire.frame_octets == register_traffic.TCP_OCTETS

    def latch(self, axis: str) -> float:
        """Return the time from the beginning of the exchange until the drive of an axis latches [s]."""
        return self.instants.latched[axis]

    @property
    def feedback_time(self) -> float:
        """Time from the first request until the last answer of the reading part [s]."""
        return self.instants.feedback

    @property
    def sending_ns(self) -> float:
        """Time from the end of computing until the last set-point is answered [ns]."""
        computed = self.feedback_time + self.waiting + COMPUTE_NS * 1e-9
        return 1e9 * max(0.0, self.instants.end - computed) if self.way is Transaction.READ_THEN_WRITE else 0.0

    @property
    def shortest_period(self) -> float:
        """Time of all requests and answers, silences, the wait for other buses, and computing [s]."""
        return self.instants.end

    @property
    def load(self) -> float:
        """Share of the time in which the line is in use, silences included."""
        alone = self if self.waiting == 0.0 else replace(self, waiting=0.0)
        idle = max(0.0, COMPUTE_NS * 1e-9 - self.wire.silence)
        return (alone.instants.end - idle) * self.rate

    @property
    def highest_rate(self) -> float:
        """Highest rate that the line can sustain [Hz]."""
        return 1.0 / self.shortest_period

    @property
    def sustained_rate(self) -> float:
        """Rate of a loop that is not told one [Hz]: the highest with a reserve, rounded down; 1000 Hz at most, as on
        other buses."""
        return min(DEFAULT_RATE, round_down(self.highest_rate / (1.0 + RESERVE)))

    @property
    def fits(self) -> bool:
        """True when a period has time for all requests."""
        return self.shortest_period * self.rate <= 1.0 + 1e-9

    @property
    def age(self) -> float:
        """Half a period and the longest delay of an axis [s]: the shorter, the stiffer a wall may be."""
        return 0.5 / self.rate + max(self.delay(member.axis).transport for member in self.members)

    def others(self) -> tuple["ModbusTraffic", ...]:
        """Return the other ways that all drives have, each at this rate, or at the highest that it sustains.

        The highest is taken where this rate does not fit, and where this one is the highest of this way itself.
        """
        found = [replace(self, way=way) for way in possible_ways(self.members) if way is not self.way]
        own = self.rate == self.sustained_rate
        return tuple(replace(each, rate=each.sustained_rate) if own or not each.fits else each for each in found)

    def check(self, bus: str) -> None:
        """Raise BusOverloadError, with the figures and a rate that fits, when a period is too short."""
        if self.fits:
            return
        subject = f"bus {bus}: " if bus else ""
        takes = f"{self.exchange} takes {rounded(1e3 * self.shortest_period)} ms per period at {self.speed}"
        fits = f"Fits: --rate {exactly(self.sustained_rate)}"
        raise BusOverloadError(f"{subject}{exactly(self.rate)} Hz is too fast: {takes}. {fits}")

    def delay(self, axis: str) -> Delay:
        """Return the delay budget of an axis, by the way of its set-points and its profile."""
        member, instants = self.member(axis), self.instants
        period, first = round(1e9 / self.rate) * 1e-9, self.way is Transaction.READ_WRITE
        later = period if first else 0.0
        arrival, compute = later + instants.written[axis] - instants.latched[axis], COMPUTE_NS * 1e-9
        planned, shortest, longest = ways(member.profile.timing, arrival, self.host, period, on_reception=True)
        # When the drive writes and reads during its answer time is not known. Function 23 writes before it reads.
        early = member.profile.line.answer_time
        late = 0.0 if first else early
        bus, drive, lag = arrival - compute, planned - arrival, member.profile.torque_lag
        return Delay(bus, compute, drive, lag, shortest - early, longest + late, self.host.lateness, acts_first=first)

    def member(self, axis: str) -> ModbusMember:
        """Return the axis of that name, which must be on this line."""
        return next(member for member in self.members if member.axis == axis)

    @property
    def exchange(self) -> str:
        """The way by its functions."""
        functions = dict.fromkeys(request.function for request in self.of(self.members[0].axis).requests)
        return " then ".join(f"FC{function}" for function in functions)

    @property
    def speed(self) -> str:
        """The line in words."""
        return self.wire.speed

    def line(self) -> str:
        """Return rate, way, speed of the line and load in words, and what it costs that units take turns."""
        shown = f"{exactly(self.rate)} Hz by {self.exchange} on {self.speed}, load {percent(self.load)}"
        if len(self.members) == 1:
            return shown
        alone = max(replace(self, members=(member,)).shortest_period for member in self.members)
        together = f"{rounded(1e3 * self.shortest_period)} ms per period, one alone {rounded(1e3 * alone)} ms"
        return f"{shown}; {len(self.members)} units in turn take {together}"


STEPS_PER_SECOND = {"ms": 1e3, "s": 1.0}
"""Unit of the register of a watchdog → steps in a second."""


def possible_ways(members: tuple[ModbusMember, ...]) -> list[Transaction]:
    """Return the ways whose functions all drives have."""
    return [way for way in Transaction if all(possible(way, each.traffic, each.profile.line) for each in members)]
