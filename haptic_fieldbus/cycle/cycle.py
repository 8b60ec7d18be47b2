"""The running plan: one input image in, one output image out, once a period.

A cycle has no I/O and no clock. Every period all axes *observe* (decode, link, power state, position); only while all
of them are in operation enabled and nothing has tripped they *sense* what else the scene needs, couplings act, and they
*render*. Otherwise every target is zero. `row` tells all that was decoded, computed and sent, when it is asked for.
"""

from collections.abc import Callable, Sequence

from haptic_fieldbus.cycle.axis import COMPUTED, AxisCycle
from haptic_fieldbus.cycle.laws import PairField, blended_pair
from haptic_fieldbus.cycle.safety import Trip
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.planning.image import AXIS_HEADER_FIELDS
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.element import CouplingElement
from haptic_fieldbus.signals import Signal

DECODED_NAMES = {Signal.POSITION: "position counts", Signal.VELOCITY: "velocity reading"}
"""Of what is computed from them the plain names are."""


def decoded_columns(plan: Plan) -> tuple[str, ...]:
    """What the input image holds: `t_ns`, then `axis.quantity` for headers and mapped signals."""
    headers = [f"{axis.name}.{field}" for axis in plan.axes for field in AXIS_HEADER_FIELDS]
    mapped = [
        f"{axis.name}.{DECODED_NAMES.get(mapped.signal, mapped.signal.value)}"
        for axis in plan.axes
        for mapped in axis.traffic.incoming
    ]
    return ("t_ns", *headers, *mapped)


def columns(plan: Plan) -> tuple[str, ...]:
    """Names of a row: `t_ns`, then of each axis what is decoded, computed and sent."""
    names = ["t_ns"]
    for axis in plan.axes:
        decoded = [DECODED_NAMES.get(mapped.signal, mapped.signal.value) for mapped in axis.incoming]
        sent = [mapped.signal.value for mapped in axis.outgoing]
        names += [f"{axis.name}.{name}" for name in (*AXIS_HEADER_FIELDS, *decoded, *COMPUTED, *sent)]
    return tuple(names)


class Cycle:
    """`cycle(image)` → output image (one buffer, reused); `row`, `trip`, `enabled` tell what happened."""

    def __init__(self, plan: Plan) -> None:
        self.columns = columns(plan)
        self.trip: Trip | None = None
        self.enabled = False
        """True while every axis is in operation enabled and nothing has tripped."""
        self._output = bytearray(plan.image.output_size)
        self._axes = {
            axis.name: AxisCycle(self, axis, image, self._output, plan.period)
            for axis, image in zip(plan.axes, plan.image.axes, strict=True)
        }
        self._first = next(iter(self._axes.values()))
        self._pairs = [self._pair(element, plan.period) for element in plan.scene.couplings]
        self._couplings = [self._coupled(place, element) for place, element in enumerate(plan.scene.couplings)]
        self._render = self._begin
        self.step = self._bind_step()
        """The cycle as a plain function, which Python calls faster than an object."""

    def __call__(self, image: bytes | bytearray) -> bytearray:
        """One period; after a trip the output stays torque-free."""
        return self.step(image)

    def _bind_step(self) -> Callable[[bytes | bytearray], bytearray]:
        output, observers = self._output, tuple(axis.observe for axis in self._axes.values())

        def step(image: bytes | bytearray) -> bytearray:
            for observe in observers:
                observe(image)
            if self.enabled:
                self._render()
            if not self.enabled:
                for axis in self._axes.values():
                    axis.release(tripped=self.trip is not None)
            return output

        return step

    @property
    def row(self) -> tuple[float, ...]:
        """One number for each of `columns`."""
        return (self.t_ns, *[value for axis in self._axes.values() for value in axis.row()])

    @property
    def t_ns(self) -> int:
        """The instant at which the drives latched this period's feedback."""
        return self._first.feedback[0]

    @property
    def age_ns(self) -> int:
        """Of the oldest feedback when it was used."""
        return max([axis.feedback[1] for axis in self._axes.values()])

    def power_state(self, axis: str) -> PowerState:
        """The last power state that the drive of an axis reported."""
        return self._axes[axis].state.power

    def zero_counts(self, axis: str) -> int:
        """The encoder count at which the handle's position is zero; 0 before the first enabled period."""
        return self._axes[axis].state.zero_counts or 0

    def prepare(self, before: Plan, after: Plan, periods: int) -> Callable[[], None]:
        """What goes over from the elements of one plan to those of another of the same loop, along a ramp.

        It is made in any thread, and called between two periods. Elements that stay go on as they are; those that
        change begin afresh, and the old fade.
        """
        exchanges = []
        for old, new in zip(before.axes, after.axes, strict=True):
            axis = self._axes[new.name]
            elements = enumerate(zip(old.elements, new.elements, strict=True))
            exchanges.append((axis, {place: axis.field_of(to) for place, (was, to) in elements if to != was}))
        couplings = enumerate(zip(before.scene.couplings, after.scene.couplings, strict=True))
        pairs = {place: self._pair(to, after.period) for place, (was, to) in couplings if to != was}

        def change() -> None:
            for axis, fields in exchanges:
                axis.exchange(fields, periods)
            for place, pair in pairs.items():
                self._pairs[place] = blended_pair(self._pairs[place], pair, periods)

        return change

    def drift(self, axis: str) -> float:
        """How far the handle's position may be off [m or rad]; 0 where the drive offers a position."""
        return self._axes[axis].state.drift

    def update_enabled(self) -> None:
        """After a power state changed."""
        states = [axis.state.power for axis in self._axes.values()]
        self.enabled = self.trip is None and all(state is PowerState.OPERATION_ENABLED for state in states)

    def _begin(self) -> None:
        """The first period in operation enabled; from then on `_render` is what the plan needs, and no more."""
        for axis in self._axes.values():
            axis.begin()
        axes = self._axes.values()
        before: list[Callable[[], None]] = [axis.sense for axis in axes if axis.sense is not None]
        if self._couplings:
            before.append(self._uncouple)
        steps = (*before, *self._couplings, *[axis.render for axis in axes])
        self._render = steps[0] if len(steps) == 1 else _in_order(steps)
        self._render()

    def _pair(self, element: CouplingElement, period: float) -> PairField:
        """The element's law between its two axes, fresh."""
        law = element.begin(period)
        read_first, read_second = (self._axes[name].reader(element.needs) for name in element.axes)
        return lambda: law(*read_first(), *read_second())

    def _coupled(self, place: int, element: CouplingElement) -> Callable[[], None]:
        """What a coupling gives is added to the force of each of its axes."""
        pairs, (first, second) = self._pairs, (self._axes[name] for name in element.axes)

        def couple() -> None:
            on_first, on_second = pairs[place]()
            first.sensed.coupled += on_first
            second.sensed.coupled += on_second

        return couple

    def _uncouple(self) -> None:
        """Couplings add up from zero."""
        for axis in self._axes.values():
            axis.sensed.coupled = 0.0


def _in_order(steps: Sequence[Callable[[], None]]) -> Callable[[], None]:
    def work() -> None:
        for step in steps:
            step()

    return work
