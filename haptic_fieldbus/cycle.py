"""The running plan: one input image in, one output image out, once a period.

A cycle has no I/O and no clock. It works on one row of numbers, which is also the row that is recorded: the decoded
input image comes first, then what the steps of each axis add. *Observing* steps run every period (link, power state);
*rendering* steps only while every axis is in operation enabled and nothing has tripped. Whatever they leave undone is
zero torque: the target is written last and starts each period at zero.
"""

from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.axis_plan import AxisPlan
from haptic_fieldbus.drive.image import AXIS_HEADER_FIELDS
from haptic_fieldbus.drive.power import (
    DISABLE_VOLTAGE,
    RELEVANT_BITS,
    STATE_OF_BITS,
    TOWARDS_OPERATION_ENABLED,
    PowerState,
)
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.safety import Trip, TripKind, bind_limiter, hold_gain, is_finite
from haptic_fieldbus.scenes.element import DynamicElement, Element, StaticElement
from haptic_fieldbus.signals import LinkFlag, Signal

Row = list[float]
Step = Callable[[], None]
COMPUTED = ("position", "velocity", "force", "gain", "command", "controlword", "target torque")
"""Columns that the steps of an axis add to the decoded ones."""
LINK_TRIPS = (
    (LinkFlag.BUS_OFF, TripKind.BUS_OFF),
    (LinkFlag.EMERGENCY, TripKind.EMERGENCY),
    (LinkFlag.BOOT_UP, TripKind.NODE_RESET),
    (LinkFlag.HEARTBEAT_LOST, TripKind.HEARTBEAT_LOST),
    (LinkFlag.NOT_OPERATIONAL, TripKind.NODE_NOT_OPERATIONAL),
    (LinkFlag.EXCEPTION, TripKind.BUS_EXCEPTION),
)
FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)


def columns(plan: Plan) -> tuple[str, ...]:
    """Names of a row: `t_ns`, then `axis.quantity` for headers, mapped signals and computed quantities."""
    headers = [f"{axis.name}.{field}" for axis in plan.axes for field in AXIS_HEADER_FIELDS]
    mapped = [
        f"{axis.name}.{'position counts' if signal is Signal.POSITION else signal.value}"
        for axis in plan.axes
        for pdo in axis.tpdos
        for signal in pdo.signals
    ]
    computed = [f"{axis.name}.{name}" for axis in plan.axes for name in COMPUTED]
    return ("t_ns", *headers, *mapped, *computed)


@dataclass
class _AxisState:
    """What one axis remembers between periods."""

    power: PowerState = PowerState.UNKNOWN
    stale_periods: int = 0
    periods_apart: int = 1
    """Between this feedback and the one before."""
    zero_counts: int | None = None


class Cycle:
    """`cycle(image)` → output image (one buffer, reused); `row`, `trip`, `enabled` tell what happened."""

    def __init__(self, plan: Plan) -> None:
        self.columns = columns(plan)
        self.row: Row = [0.0] * len(self.columns)
        self.trip: Trip | None = None
        self.enabled = False
        self.enabled_periods = 0
        self._unpack = plan.image.input.unpack_from
        self._pack = plan.image.output.pack_into
        self._output = bytearray(plan.image.output_size)
        self._decoded = self.columns.index(f"{plan.axes[0].name}.{COMPUTED[0]}")
        self._axes = tuple(_AxisState() for _ in plan.axes)
        self._states = {axis.name: state for axis, state in zip(plan.axes, self._axes, strict=True)}
        index = {name: position for position, name in enumerate(self.columns)}
        binders = [_AxisBinder(self, axis, state, index) for axis, state in zip(plan.axes, self._axes, strict=True)]
        self._observe = tuple(step for binder in binders for step in binder.observing())
        self._render = tuple(step for binder in binders for step in binder.rendering(plan.period))
        self._controlwords = tuple(index[f"{axis.name}.controlword"] for axis in plan.axes)
        self._targets = tuple(index[f"{axis.name}.target torque"] for axis in plan.axes)
        self._sent = tuple(
            index[f"{axis.name}.{signal.value}"] for axis in plan.axes for pdo in axis.rpdos for signal in pdo.signals
        )

    def __call__(self, image: bytes | bytearray) -> bytearray:
        """One period; after a trip the output stays torque-free."""
        row = self.row
        row[: self._decoded] = self._unpack(image)
        for target in self._targets:
            row[target] = 0
        if self.trip is None:
            for step in self._observe:
                step()
        if self.enabled and self.trip is None:
            self.enabled_periods += 1
            for step in self._render:
                step()
        if self.trip is not None:
            self._release(row)
        self._pack(self._output, 0, *[row[position] for position in self._sent])
        return self._output

    def power_state(self, axis: str) -> PowerState:
        """The last power state that the drive of an axis reported."""
        return self._states[axis].power

    def zero_counts(self, axis: str) -> int:
        """The encoder count at which the handle's position is zero; 0 before the first enabled period."""
        return self._states[axis].zero_counts or 0

    def _release(self, row: Row) -> None:
        self.enabled = False
        for target in self._targets:
            row[target] = 0
        for controlword in self._controlwords:
            row[controlword] = DISABLE_VOLTAGE

    def update_enabled(self) -> None:
        """True only while every axis is in operation enabled."""
        self.enabled = all(state.power is PowerState.OPERATION_ENABLED for state in self._axes)


class _AxisBinder:
    """Binds the steps of one axis to the row: each step is a closure over the places that it reads and writes."""

    def __init__(self, cycle: Cycle, axis: AxisPlan, state: _AxisState, index: dict[str, int]) -> None:
        self._cycle, self._axis, self._state, self._index = cycle, axis, state, index

    def _at(self, name: str) -> int:
        return self._index[f"{self._axis.name}.{name}"]

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        if self._cycle.trip is None:
            self._cycle.trip = Trip(kind, self._axis.name, int(self._cycle.row[0]), value, limit, detail)

    def observing(self) -> tuple[Step, ...]:
        return (self._link(), self._power())

    def rendering(self, period: float) -> tuple[Step, ...]:
        estimate = (self._estimate(period),) if self._axis.estimator else ()
        return (self._position(period), *estimate, self._force(period), self._limits(period), self._encode())

    def _link(self) -> Step:
        """Staleness and faults of the link: hold one period, fade the second, stop at the third."""
        row, state, cycle, trip = self._cycle.row, self._state, self._cycle, self._trip
        flags_at, age_at, gain_at = self._at("flags"), self._at("age_ns"), self._at("gain")
        emergency_at = self._at("emergency")

        def link() -> None:
            flags = int(row[flags_at])
            if not flags:
                state.periods_apart = state.stale_periods + 1
                state.stale_periods = 0
                row[gain_at] = 1.0
                return
            for flag, kind in LINK_TRIPS:
                if flags & flag:
                    trip(kind, row[emergency_at])
            state.stale_periods = state.stale_periods + 1 if flags & LinkFlag.STALE else 0
            gain = hold_gain(state.stale_periods)
            if gain is None and cycle.enabled:
                trip(TripKind.FEEDBACK_LOST, row[age_at] * 1e-9)
            row[gain_at] = gain or 0.0

        return link

    def _power(self) -> Step:
        """Statusword → power state → the controlword that asks for the next transition."""
        row, state, cycle, trip = self._cycle.row, self._state, self._cycle, self._trip
        statusword_at, controlword_at = self._at(Signal.STATUSWORD.value), self._at("controlword")

        def power() -> None:
            statusword = int(row[statusword_at])
            before = state.power
            state.power = now = STATE_OF_BITS[statusword & RELEVANT_BITS]
            row[controlword_at] = TOWARDS_OPERATION_ENABLED[now].controlword
            if now is before:
                return
            if now in FAULT_STATES:
                trip(TripKind.DRIVE_FAULT, statusword, detail=now.value)
            elif before is PowerState.OPERATION_ENABLED:
                trip(TripKind.DRIVE_DISABLED, statusword, detail=now.value)
            cycle.update_enabled()

        return power

    def _position(self, period: float) -> Step:
        """Counts since zero → position; faster than the speed limit or outside the position limits trips."""
        row, state, trip, limits = self._cycle.row, self._state, self._trip, self._axis.limits
        counts_at, position_at, unit = self._at("position counts"), self._at("position"), self._axis.position_unit
        zero = self._axis.rig.mechanism.zero
        largest_way = limits.speed * period + abs(unit)
        lowest, highest = limits.position or (float("-inf"), float("inf"))

        def position() -> None:
            counts = int(row[counts_at])
            if state.zero_counts is None:
                state.zero_counts = counts if zero == "start" else zero
                row[position_at] = (counts - state.zero_counts) * unit
            here = (((counts - state.zero_counts) + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000) * unit
            way = abs(here - row[position_at])
            row[position_at] = here
            if way > largest_way * state.periods_apart:
                trip(TripKind.SPEED, way / period, limits.speed)
            if not lowest <= here <= highest:
                trip(TripKind.POSITION, here, lowest if here < lowest else highest)

        return position

    def _estimate(self, period: float) -> Step:
        from haptic_fieldbus.numerics.estimators import bind

        row, position_at, velocity_at = self._cycle.row, self._at("position"), self._at("velocity")
        estimator = bind(self._axis.estimator or "", period)

        def estimate() -> None:
            row[velocity_at] = estimator(row[position_at])

        return estimate

    def _force(self, period: float) -> Step:
        """The sum of the elements; each takes exactly the signals that it declared."""
        row, force_at = self._cycle.row, self._at("force")
        laws = [law_of(element, period, self._axis.method) for element in self._axis.elements]
        places = [tuple(self._at(signal.value) for signal in element.needs) for element in self._axis.elements]
        if len(laws) == 1 and len(places[0]) == 1:
            law, place = laws[0], places[0][0]

            def one() -> None:
                row[force_at] = law(row[place])

            return one

        def several() -> None:
            row[force_at] = sum(
                [law(*[row[place] for place in needed]) for law, needed in zip(laws, places, strict=True)]
            )

        return several

    def _limits(self, period: float) -> Step:
        row, trip, limiter = self._cycle.row, self._trip, bind_limiter(self._axis.limits, period)
        force_at, gain_at, command_at = self._at("force"), self._at("gain"), self._at("command")

        def limits() -> None:
            force = row[force_at]
            if is_finite(force):
                row[command_at] = limiter(force) * row[gain_at]
            else:
                row[command_at] = 0.0
                trip(TripKind.NOT_FINITE, force)

        return limits

    def _encode(self) -> Step:
        """Effort → whole steps of the drive's target torque; the command is what is really asked for."""
        row, sign, unit = self._cycle.row, self._axis.rig.mechanism.sign, self._axis.effort_unit
        command_at, target_at = self._at("command"), self._at("target torque")

        def encode() -> None:
            target = round(row[command_at] / unit)
            row[command_at] = target * unit
            row[target_at] = sign * target

        return encode


def law_of(element: Element, period: float, method: str | None = None) -> Callable[..., float]:
    """The element as a function of the signals that it needs, fresh; only virtual states import an integrator."""
    if isinstance(element, DynamicElement):
        from haptic_fieldbus.numerics.integrators import DEFAULT_METHOD, bind

        return bind(element.dynamics, period, method or DEFAULT_METHOD)
    if isinstance(element, StaticElement):
        return element.force
    raise TypeError(f"{element.name} is neither a static nor a dynamic element")
