"""One axis of a running plan, as two closures over the row: *observe* every period, *render* while force is permitted.

Both are straight lines for the period in which nothing is wrong; whatever is out of the ordinary is a call on the side.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from haptic_fieldbus.axis_plan import AxisPlan
from haptic_fieldbus.drive.power import RELEVANT_BITS, STATE_OF_BITS, TOWARDS_OPERATION_ENABLED, PowerState
from haptic_fieldbus.safety import Trip, TripKind, bind_limiter, hold_gain, is_finite
from haptic_fieldbus.scenes.element import DynamicElement, Element, StaticElement
from haptic_fieldbus.signals import LinkFlag, Signal

Row = list[float]
Step = Callable[[], None]
Field = Callable[[float], float]
"""Position of the handle → force of all elements on it, in the workspace."""

LINK_TRIPS = (
    (LinkFlag.BUS_OFF, TripKind.BUS_OFF),
    (LinkFlag.EMERGENCY, TripKind.EMERGENCY),
    (LinkFlag.BOOT_UP, TripKind.NODE_RESET),
    (LinkFlag.HEARTBEAT_LOST, TripKind.HEARTBEAT_LOST),
    (LinkFlag.NOT_OPERATIONAL, TripKind.NODE_NOT_OPERATIONAL),
    (LinkFlag.EXCEPTION, TripKind.BUS_EXCEPTION),
)
FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
HALF_TURN_OF_INT32, INT32 = 0x8000_0000, 0xFFFF_FFFF


class Owner(Protocol):
    """The cycle, as far as its axes know it."""

    row: Row
    trip: Trip | None
    enabled: bool

    def update_enabled(self) -> None: ...


@dataclass
class AxisState:
    """What one axis remembers between periods, and others may ask."""

    power: PowerState = PowerState.UNKNOWN
    stale_periods: int = 0
    periods_apart: int = 1
    """Between this feedback and the one before."""
    zero_counts: int | None = None


class AxisCycle:
    """Binds one axis of a plan to the row of its cycle; `index` gives the place of each column."""

    def __init__(self, cycle: Owner, axis: AxisPlan, index: dict[str, int]) -> None:
        self.state = AxisState()
        self._cycle, self._axis = cycle, axis
        self._index = index

    def _at(self, name: str) -> int:
        return self._index[f"{self._axis.name}.{name}"]

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        if self._cycle.trip is None:
            self._cycle.trip = Trip(kind, self._axis.name, int(self._cycle.row[0]), value, limit, detail)
            self._cycle.enabled = False

    def observe(self) -> Step:
        """Link flags and statusword; acts only when one of them is not as in the period before."""
        row, state, link, power = self._cycle.row, self.state, self._link(), self._power()
        flags_at, statusword_at = self._at("flags"), self._at(Signal.STATUSWORD.value)
        row[self._at("gain")] = 1.0
        bits_before = -1

        def observe() -> None:
            nonlocal bits_before
            if row[flags_at] or state.stale_periods or state.periods_apart != 1:
                link()
            bits = int(row[statusword_at]) & RELEVANT_BITS
            if bits != bits_before:
                bits_before = bits
                power()

        return observe

    def _link(self) -> Step:
        """Staleness and faults of the link: hold one period, fade the second, stop at the third."""
        row, state, cycle, trip = self._cycle.row, self.state, self._cycle, self._trip
        flags_at, age_at, gain_at = self._at("flags"), self._at("age_ns"), self._at("gain")
        emergency_at = self._at("emergency")

        def link() -> None:
            flags = int(row[flags_at])
            for flag, kind in LINK_TRIPS:
                if flags & flag:
                    trip(kind, row[emergency_at])
            state.periods_apart = state.stale_periods + 1
            state.stale_periods = state.stale_periods + 1 if flags & LinkFlag.STALE else 0
            gain = hold_gain(state.stale_periods)
            if gain is None and cycle.enabled:
                trip(TripKind.FEEDBACK_LOST, row[age_at] * 1e-9)
            row[gain_at] = gain or 0.0

        return link

    def _power(self) -> Step:
        """Statusword → power state → the controlword that asks for the next transition."""
        row, state, cycle, trip = self._cycle.row, self.state, self._cycle, self._trip
        statusword_at, controlword_at = self._at(Signal.STATUSWORD.value), self._at("controlword")

        def power() -> None:
            statusword = int(row[statusword_at])
            before, state.power = state.power, STATE_OF_BITS[statusword & RELEVANT_BITS]
            row[controlword_at] = TOWARDS_OPERATION_ENABLED[state.power].controlword
            if state.power in FAULT_STATES:
                trip(TripKind.DRIVE_FAULT, statusword, detail=state.power.value)
            elif before is PowerState.OPERATION_ENABLED is not state.power:
                trip(TripKind.DRIVE_DISABLED, statusword, detail=state.power.value)
            cycle.update_enabled()

        return power

    def render(self, period: float) -> Step:
        """Counts → position → force → permitted force → target torque."""
        row, state, trip, axis = self._cycle.row, self.state, self._trip, self._axis
        field, limit, check = self._field(period), bind_limiter(axis.limits, period), self._motion(period)
        counts_at, position_at, force_at = self._at("position counts"), self._at("position"), self._at("force")
        gain_at, command_at, target_at = self._at("gain"), self._at("command"), self._at("target torque")
        unit, effort_unit, sign = axis.position_unit, axis.effort_unit, axis.rig.mechanism.sign
        lowest, highest = axis.limits.position or (float("-inf"), float("inf"))
        largest_way = axis.limits.speed * period + abs(unit)
        position: float | None = None

        def render() -> None:
            nonlocal position
            if position is None or state.zero_counts is None:
                position = self._begin(int(row[counts_at]))
            since_zero = int(row[counts_at]) - (state.zero_counts or 0)
            here = ((since_zero + HALF_TURN_OF_INT32 & INT32) - HALF_TURN_OF_INT32) * unit
            if not (-largest_way <= here - position <= largest_way and lowest <= here <= highest):
                check(here, abs(here - position))
            row[position_at] = position = here
            row[force_at] = force = field(here)
            if not is_finite(force):
                row[command_at] = 0.0
                trip(TripKind.NOT_FINITE, force)
                return
            target = round(limit(force) * row[gain_at] / effort_unit)
            row[command_at] = target * effort_unit
            row[target_at] = sign * target

        return render

    def _begin(self, counts: int) -> float:
        """The first rendered period: where zero is, and where the handle is then."""
        zero = self._axis.rig.mechanism.zero
        self.state.zero_counts = counts if zero == "start" else zero
        return (counts - self.state.zero_counts) * self._axis.position_unit

    def _motion(self, period: float) -> Callable[[float, float], None]:
        """Called when the handle seems to be too fast, or outside; after held periods a longer way is allowed."""
        state, limits, trip = self.state, self._axis.limits, self._trip
        largest_way = limits.speed * period + abs(self._axis.position_unit)
        lowest, highest = limits.position or (float("-inf"), float("inf"))

        def check(here: float, way: float) -> None:
            if way > largest_way * state.periods_apart:
                trip(TripKind.SPEED, way / period, limits.speed)
            if not lowest <= here <= highest:
                trip(TripKind.POSITION, here, lowest if here < lowest else highest)

        return check

    def _field(self, period: float) -> Field:
        """The sum of the elements; each takes exactly the signals that it declared."""
        axis = self._axis
        laws = [law_of(element, period, axis.method) for element in axis.elements]
        if len(laws) == 1 and axis.elements[0].needs == (Signal.POSITION,):
            return laws[0]
        row, velocity_at, estimate = self._cycle.row, self._at("velocity"), self._estimator(period)
        torque_at = self._index.get(f"{axis.name}.{Signal.TORQUE_ACTUAL.value}", velocity_at)
        effort_unit = axis.effort_unit * axis.rig.mechanism.sign
        order = (Signal.POSITION, Signal.VELOCITY, Signal.TORQUE_ACTUAL)
        bound = [
            (law, tuple(order.index(signal) for signal in element.needs))
            for law, element in zip(laws, axis.elements, strict=True)
        ]

        def field(position: float) -> float:
            row[velocity_at] = velocity = estimate(position)
            feedback = (position, velocity, row[torque_at] * effort_unit)
            return sum([law(*[feedback[place] for place in places]) for law, places in bound])

        return field

    def _estimator(self, period: float) -> Field:
        """Position → velocity; a scene that does not ask for velocity imports no estimator."""
        if self._axis.estimator is None:
            return lambda position: 0.0
        from haptic_fieldbus.numerics.estimators import bind, is_timed

        row, estimate = self._cycle.row, bind(self._axis.estimator, period, self._axis.rig.resolution)
        return (lambda position: estimate(position, row[0])) if is_timed(self._axis.estimator) else estimate


def law_of(element: Element, period: float, method: str | None = None) -> Callable[..., float]:
    """The element as a function of the signals that it needs, fresh; only virtual states import an integrator."""
    if isinstance(element, DynamicElement):
        from haptic_fieldbus.numerics.integrators import DEFAULT_METHOD, bind

        return bind(element.dynamics, period, method or DEFAULT_METHOD)
    if isinstance(element, StaticElement):
        return element.force
    raise TypeError(f"{element.name} is neither a static nor a dynamic element")
