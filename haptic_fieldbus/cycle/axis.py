"""One axis of a running plan, as three closures over its feedback, called in this order in each period.

`observe` runs every period: it decodes the input image and follows link, power state and position. `sense` and `render`
run only while force is permitted. `sense` derives the signals that the scene needs: velocity, time, torque actual.
`render` computes and encodes the target torque. In a period without a fault each closure is straight-line code. A link
flag, a changed statusword or a motion beyond the limits is handled by a separate call.

The latch instant of the drive identifies a sample. A sample after a gap of several periods is used directly: speed and
acceleration are divided by the time since the last sample.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from haptic_fieldbus.cycle import laws
from haptic_fieldbus.cycle.gaps import Gaps, LawPlace
from haptic_fieldbus.cycle.plausibility import bind_asked_echo, bind_other_masters, sign_watch, torque_echo
from haptic_fieldbus.cycle.safety import LINK_TRIPS, Permission, Trip, TripKind, TripOff, bind_hold, bind_limiter
from haptic_fieldbus.cycle.sign import Sign, SignOwner
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import STILL, encoder_probe
from haptic_fieldbus.planning.image import AGE_NS, EMERGENCY, FLAGS, STATUSWORD, T_NS, AxisImage
from haptic_fieldbus.planning.limits import LARGEST_MISSING_SHARE, START_SHARE
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.signals import LinkFlag, Signal

if TYPE_CHECKING:  # imported for its type alone: only an axis with encoder pulses loads it
    from haptic_fieldbus.cycle.standstill import Standstill

Observe = Callable[[bytes | bytearray], None]

WAY = {PowerState.READY: 1, PowerState.SWITCHED_ON: 2, PowerState.OPERATION_ENABLED: 3}
"""States on the way to operation enabled; every other state comes before them."""
FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
HALF_TURN_OF_INT32, INT32 = 0x8000_0000, 0xFFFF_FFFF
COMPUTED = ("position", "velocity", "force", "gain", "command")
"""Columns of a row with computed values; they follow the decoded values."""
SHORTEST = 0.5
"""Shortest time between two samples from which a speed is computed, in periods."""

# Plain integers: an operation on a member of an IntFlag takes as long as the rest of the method.
_STALE = int(LinkFlag.STALE)
_FAULTS = tuple((int(flag), kind) for flag, kind in LINK_TRIPS.items())


class CycleContext(SignOwner, Protocol):
    """The part of a cycle that its axes use."""

    trip: Trip | None
    enabled: bool
    output: bytearray

    def update_enabled(self) -> None: ...


class AxisCycle:
    """One axis of a running plan; the output image of its owner is shared by all axes."""

    def __init__(
        self, owner: CycleContext, axis: AxisPlan, image: AxisImage, period: float, *, controlled: bool
    ) -> None:
        self.state, self.sensed, self.permission = laws.AxisState(), laws.Sensed(), Permission()
        self.forgive: Callable[[float], None] = lambda energy: None
        """Books energy [J] of torque that the echo shows beyond the set-points; the cycle sets it."""
        self.stalls = 0
        """Number of times that the force limit fell because counts stood still under torque."""
        self._owner, self.axis, self.period = owner, axis, period
        self.watch = AxisWatch(axis, self.state, period, self._trip)
        self.sign = Sign(axis, period, self.state, self.permission, self._trip, owner)
        self.image, self.output = image, owner.output
        self.largest_step = START_SHARE * axis.limits.effort
        """Largest force of a scene in its first period, and by a change [N or N·m]."""
        self._effort_unit, self._direction = axis.effort_unit, axis.rig.mechanism.sign
        self.standstill = self._bind_standstill()
        """Test of the encoder by pulses; None where it is impossible or not needed."""
        self.still_ns = 1e9 * (axis.limits.stall if self.standstill is None else min(axis.limits.stall, STILL))
        """Time without a change of the counts after which `_stand_still` is called [ns]."""
        self.state.feedback = (0,) * (STATUSWORD + len(axis.incoming))
        self.observe = self._bind_observe_velocity() if axis.integrates else self._bind_observe()
        self.sense, self._step_estimator = laws.bind_sense(axis, self.state, self.sensed, period)
        """Computes velocity, time and torque once a period; None if the scene needs none of them."""
        self._fields = [self.field_of(element) for element in axis.elements]
        """Force field of each element in order; the sum of all couplings is the last field, if the axis has any."""
        self._remembers = [laws.has_say(element) for element in axis.elements]
        """Whether each field depends on the position through a memory."""
        if axis.couplings:
            # The cycle adds up the couplings before any axis renders, so their field only reads the sum.
            self._fields.append(lambda position: self.sensed.coupled)
            self._remembers.append(True)
        if controlled:
            self._fields.append(lambda position: self.sensed.damped)
            self._remembers.append(False)
        self._resting: tuple[laws.Field, ...] = (laws.at_rest(axis.elements, period),)
        """Force at rest of the elements without memory, by position; during a change also the field before it."""
        self._ramps: list[laws.Over] = []
        """Ramps that have begun, each by whether it is over."""
        self.field = self._summed()
        steps_alone = not any(self._remembers) and all(map(laws.is_static, axis.elements))
        present, bounds = None if steps_alone else self._present, (1e-6 * axis.resolution, axis.limits.shift)
        self.place = LawPlace(self.permission, bounds, self._at_rest, present)
        self.limit = bind_limiter(axis.limits, period, self.permission, axis.effort_unit)
        self.echo = torque_echo(axis, self.state, period, self._trip, self._forgive)
        """Check of the echo of each period; None if the drive has none."""
        self.sign_watch = sign_watch(axis, self.state, period, self.sign.doubt)
        self.look = bind_other_masters(axis, self.state, period, self._trip)
        self.after = self._check_power if math.isfinite(axis.limits.power) else None
        """Steps before and after a force is rendered; None if they are not needed."""
        self.render = self._bind_render()

    def row(self) -> tuple[float, ...]:
        """Return t_ns and the columns of this axis: other decoded values, `COMPUTED`, controlword and target torque."""
        state = self.state
        target, feedback = state.target, state.feedback
        computed = (state.position, self.sensed.velocity, state.force, state.gain, target * self._effort_unit)
        return (*feedback, *computed, state.controlword, self._direction * target)

    def begin(self) -> None:
        """Set the zero and the position of the handle, in the first rendered period."""
        state, t_ns = self.state, self.state.feedback[T_NS]
        state.began_ns, state.moved_ns, state.begun = t_ns, t_ns, True
        self.sign.begin(t_ns)
        if self.axis.integrates:
            self._follow(self.state.feedback[T_NS], self.state.feedback[self.axis.place_of(Signal.VELOCITY)])
            return
        counts, zero = self.state.feedback[self.axis.place_of(Signal.POSITION)], self.axis.rig.mechanism.zero
        self.state.zero_counts = counts if zero == "start" else zero
        self.state.position = (counts - self.state.zero_counts) * self.axis.position_unit

    @property
    def is_deep(self) -> bool:
        """Whether the scene asks for more force than a handle may start with, as deep in a wall."""
        return abs(self.state.force) > self.largest_step

    def check_start(self) -> None:
        """Trip if the first force is large: it would throw the handle as soon as it is permitted."""
        if self.is_deep:
            self._trip(TripKind.START_FORCE, self.state.force, self.largest_step)

    def release(self, *, tripped: bool) -> None:
        """Encode target torque 0; after a trip also the controlword that disables the voltage."""
        self.state.target = 0
        if tripped:
            self.state.controlword = self.axis.power.off
        self.image.output.pack_into(self.output, self.image.outputs[0], self.state.controlword, 0)

    def field_of(self, element: Element) -> laws.Field:
        """Return a fresh force field of `element`, which needs no signal beyond those of the plan.

        May be called from any thread.
        """
        return laws.field_of(element, self.period, self.axis.method, self.sensed)

    def changed_by(
        self, before: Sequence[Element], after: Sequence[Element], fields: Mapping[int, laws.Field]
    ) -> Callable[[], float]:
        """Return the function of how much the force would change if these elements were exchanged now [N or N·m].

        It is the change of the force at rest. Elements without such a force are tried beside the loop, by their new
        `fields` at these indices. Then the function must be called once a period, between two periods.
        """
        old, new = laws.at_rest(before, self.period), laws.at_rest(after, self.period)

        def change() -> float:
            position = self.state.position - self.permission.shift
            tried = [field(position) - self._last_of(place) for place, field in fields.items()]
            return new(position) - old(position) + sum(tried)

        return change

    def _last_of(self, place: int) -> float:
        """Return the force of a field in the last period; nan in the first call, which begins to note it."""
        field = self._fields[place]
        if not isinstance(field, laws.Noted):
            self._fields[place] = field = laws.Noted(field, math.nan)
            self.field = self._summed()
        return field.last

    def exchange(self, fields: Mapping[int, laws.Field], elements: Sequence[Element], periods: int) -> None:
        """Replace the fields at these indices along a ramp of `periods`; the other fields keep their state.

        `elements` are all elements of the axis after the ramp.
        """
        resting = self._at_rest()  # before the ramp begins: fields of changes that are over are forgotten
        for place, field in fields.items():
            self._fields[place], over = laws.blended(self._fields[place], field, periods)
            self._ramps.append(over)
        self.field = self._summed()
        self._resting = (*resting, laws.at_rest(elements, self.period))

    @property
    def changing(self) -> bool:
        """Whether the ramp of a change still goes on."""
        self._ramps = [over for over in self._ramps if not over()]
        return bool(self._ramps)

    def _summed(self) -> laws.Field:
        """Return the sum of all fields; fields with a memory are summed apart, and their force is noted."""
        if len({*self._remembers}) < 2:
            return laws.summed(self._fields)
        fields = [*zip(self._fields, self._remembers, strict=True)]
        return laws.apart([each for each, of in fields if of], [each for each, of in fields if not of], self.state)

    def _present(self) -> float:
        """Return the force of the elements with a memory in the last period."""
        return self.state.force if all(self._remembers) else self.state.remembered

    def _at_rest(self) -> Sequence[laws.Field]:
        """Return the fields of the force at rest; the present force at rest lies between them."""
        if not self.changing:
            self._resting = self._resting[-1:]
        return self._resting

    def reader(self, needs: Sequence[Signal]) -> Callable[[], list[float]]:
        """Return a function that reads the signals `needs` of this axis, in their order."""
        state, sensed, permission = self.state, self.sensed, self.permission
        readers = [laws.READERS[each] for each in needs]
        return lambda: [read(state.position - permission.shift, sensed) for read in readers]

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        """Record the first trip of the run and withdraw the permission; later trips are ignored."""
        if self._owner.trip is None:
            t_ns, position = self.state.feedback[T_NS], self.state.position
            self._owner.trip = Trip(kind, self.axis.name, t_ns, value, limit, detail, position)
            self._owner.enabled = False

    def _bind_observe(self) -> Observe:
        """Return `observe`: decode, check link flags and statusword for a change, convert counts to position."""
        state, axis, owner, watch, permission = self.state, self.axis, self._owner, self.watch, self.permission
        unpack, power = self.image.input.unpack_from, self._power
        unit, mask = axis.position_unit, axis.power.mask
        place = self.axis.place_of(Signal.VELOCITY if axis.integrates else Signal.POSITION)
        lowest, highest = axis.limits.position or (-math.inf, math.inf)
        # Rounding to counts changes the difference of two positions by up to one count.
        largest_way, still_ns = axis.limits.speed * self.period + abs(unit), self.still_ns
        jump, (shortest, longest) = axis.limits.jump(self.period, abs(unit)), in_time(self.period)
        oldest_ns = 1e9 * axis.limits.age
        self.bounds = shortest, longest, oldest_ns, largest_way, jump

        def observe(image: bytes | bytearray) -> None:
            age_before_ns = state.feedback[AGE_NS]
            state.feedback = feedback = unpack(image)
            elapsed_ns = feedback[T_NS] - state.fresh_ns
            state.steps = steps = (
                1
                if shortest < elapsed_ns < longest
                and not feedback[FLAGS]
                and not state.missing
                and feedback[AGE_NS] <= oldest_ns
                else watch.link(feedback, elapsed_ns, owner.enabled, age_before_ns)
            )
            bits = feedback[STATUSWORD] & mask
            if bits != state.power_bits:
                state.power_bits = bits
                power()
            if not steps:
                return
            state.fresh_ns = fresh_ns = feedback[T_NS]
            zero = state.zero_counts
            if zero is not None:
                counts = feedback[place] - zero
                # The encoder may wrap around between zero and here; the difference modulo 2³² is still right.
                if not -HALF_TURN_OF_INT32 <= counts < HALF_TURN_OF_INT32:
                    counts = (counts + HALF_TURN_OF_INT32 & INT32) - HALF_TURN_OF_INT32
                here = counts * unit
                way = speed = here - state.position
                if (
                    steps != 1
                    or not (-largest_way <= way <= largest_way and lowest <= here <= highest)
                    or not -jump <= way - state.way <= jump
                ):
                    speed = watch.motion(here, way, elapsed_ns, feedback[AGE_NS])
                if way:
                    state.moved_ns = fresh_ns
                elif fresh_ns - state.moved_ns > still_ns:
                    self._stand_still(fresh_ns)
                if steps != 1:
                    self._catch_up(here, steps)
                state.way = speed
                state.position = here
                if permission.beside:
                    self.place.follow(here, way, steps)

        return observe

    def _bind_observe_velocity(self) -> Observe:
        """Return `observe` for a drive that offers velocity only, from which the position is integrated."""
        from haptic_fieldbus.cycle.tachometer import bind_follow  # a drive with a position does without it

        state, still_ns, place = self.state, self.still_ns, self.axis.place_of(Signal.VELOCITY)
        follow = self._follow = bind_follow(self.axis, state, self.sensed, self.period, self._trip)
        # Without an encoder there is no zero. Everything else is as in `_bind_observe`.
        decode = self._bind_observe()

        def observe(image: bytes | bytearray) -> None:
            decode(image)
            if state.begun:
                feedback, before, steps = state.feedback, state.position, state.steps
                follow(feedback[T_NS], feedback[place])
                if state.position != before:
                    state.moved_ns = feedback[T_NS]
                elif feedback[T_NS] - state.moved_ns > still_ns:
                    self._stand_still(feedback[T_NS])
                here = state.position
                if steps > 1:
                    state.position = before
                    self._catch_up(here, steps)
                    state.position = here
                if steps and self.permission.beside:
                    self.place.follow(here, here - before, steps)

        return observe

    def _catch_up(self, here: float, steps: int) -> None:
        """Step memories and estimators through the periods between two samples, along a straight line to `here`.

        Virtual states and estimators advance by one period in each call. Without these steps they would take the motion
        of the whole gap for that of one period. Estimators that take time stamps need no steps. In a gap the law
        pauses.
        """
        state = self.state
        if not self._owner.enabled:
            return
        before, way, force, work = state.position, (here - state.position) / steps, state.force, 0.0
        for step in range(1, steps):
            state.position = before + way * step
            if self._step_estimator is not None:
                self._step_estimator()
            if not self.permission.pauses:
                last, force = force, self.field(state.position - self.permission.shift)
                work += 0.5 * (last + force) * way
        state.led_work, state.led_force = 0.0 if self.permission.pauses else work + force * way, force

    def _power(self) -> None:
        """Derive the power state from the statusword, and the controlword that requests the next transition.

        Trips on a fault state, and when the drive leaves operation enabled.
        """
        state, table, statusword = self.state, self.axis.power, self.state.feedback[STATUSWORD]
        before, state.power = state.power, table.state(statusword)
        state.controlword = table.answer(state.power)
        if state.power in FAULT_STATES:
            self._trip(TripKind.DRIVE_FAULT, statusword, detail=state.power.value)
        # Also on the way to operation enabled: the drive may have reached and left it between two samples.
        elif WAY.get(state.power, 0) < WAY.get(before, 0):
            self._trip(TripKind.DRIVE_DISABLED, statusword, detail=state.power.value)
        self._owner.update_enabled()

    def _bind_render(self) -> laws.PeriodStep:
        """Return `render`: position → force → permitted force → target torque. Without new feedback the torque is held,
        then fades."""
        state, axis, permission, limit = self.state, self.axis, self.permission, self.limit
        hold = bind_hold(axis.limits, self.period, permission)
        effort_unit, sign = axis.effort_unit, axis.rig.mechanism.sign
        pack_into, output, offset = self.image.output.pack_into, self.output, self.image.outputs[0]

        def render() -> None:
            if state.steps:
                state.force = force = self.field(state.position - permission.shift)
            if not state.holding:
                state.gain = 1.0
                permitted = limit(force)
            else:
                permitted = hold(state.holding)
                state.gain = permitted / permission.held if permission.held else 1.0
            if permitted != permitted:
                self.not_finite()
                return
            state.target = target = round(permitted / effort_unit)
            pack_into(output, offset, state.controlword, sign * target)

        proved = render if self.sign_watch is None else self.sign_watch.bind(render)
        if self.echo is None:
            proved = bind_asked_echo(axis, state, self.period, self._trip, self._forgive, proved)
        else:
            proved = self.echo.bind(proved)
        return laws.in_order([each for each in (self.look, proved, self.after) if each is not None])

    def not_finite(self) -> None:
        """Trip because the force of the scene is no number."""
        self._trip(TripKind.NOT_FINITE, self.state.force)

    def _forgive(self, energy: float) -> None:
        self.forgive(energy)  # looked up late: the cycle sets it after it has made the ledgers

    def _check_power(self) -> None:
        state, limit = self.state, self.axis.limits.power
        power = state.target * self.axis.effort_unit * state.way / self.period
        if power > limit:
            self._trip(TripKind.POWER, power, limit)

    def _bind_standstill(self) -> "Standstill | None":
        """Return the pulse test of an encoder whose counts stand still; None where it is impossible or not needed."""
        probe = encoder_probe(self.axis, self.period)
        if probe is None:
            return None
        from haptic_fieldbus.cycle.standstill import Standstill

        return Standstill(probe, self.axis.effort_unit, self.state, self.permission, self._trip)

    def _stand_still(self, t_ns: int) -> None:
        """Test the encoder by pulses because counts stand still, and limit the force after the stall time."""
        still = 1e-9 * (t_ns - self.state.moved_ns)
        if self.standstill is not None and still > STILL:
            self.standstill.look(t_ns)
        if still <= self.axis.limits.stall:
            return
        # Either a hand leans on the handle, or the encoder is faulty; a smaller force is enough.
        effort, holding = self.state.target * self.axis.effort_unit, self.axis.limits.holding
        if abs(effort) > holding and self.permission.cap > holding:
            self.permission.cap_at(holding, math.copysign(1.0, effort))
            self.stalls += 1


class AxisWatch:
    """Watches one axis; `trip` takes the torque away."""

    def __init__(self, axis: AxisPlan, state: laws.AxisState, period: float, trip: TripOff) -> None:
        self._state, self._trip = state, trip
        self._period, self._period_ns = period, round(period * 1e9)
        self._looked = ((0.0, 0), (0.0, 0))
        """Motion before each of the last two checked samples, and its age."""
        self._limits, self._resolution = axis.limits, axis.resolution
        self._jump = axis.limits.jump(period, axis.resolution) - 2.0 * axis.resolution
        self._oldest_ns = self._limits.age * 1e9
        self._lowest, self._highest = axis.limits.position or (-math.inf, math.inf)
        self.gaps = Gaps(period, 0.5 + axis.delay.total / period, axis.largest_stretch)

    def link(self, feedback: Sequence[int], elapsed_ns: int, rendering: bool, age_before_ns: int) -> int:
        """Return how many periods this sample spans, 0 when it is not new; trip on faults of the link.

        `age_before_ns` is the age of the feedback of the period before.
        """
        state, flags = self._state, feedback[FLAGS]
        for bit, kind in _FAULTS:
            if flags & bit:
                self._trip(kind, feedback[EMERGENCY])
        if rendering and feedback[AGE_NS] > self._oldest_ns:
            self._trip(TripKind.FEEDBACK_LOST, feedback[AGE_NS] * 1e-9, self._limits.age)
        if flags & _STALE:
            state.missing += 1
            state.holding = state.missing
            return 0
        # An answer that came a period late was used in that period, so the gap behind it is a gap of the feedback too.
        lost = state.missing > 0 or age_before_ns > self._period_ns
        state.missing = state.holding = 0
        if not rendering or not state.begun:
            return 1
        if elapsed_ns < 0:
            self._trip(TripKind.CLOCK, elapsed_ns * 1e-9)
        steps = max(1, round(elapsed_ns * 1e-9 / self._period))
        if steps > 1:
            self._spanned(feedback[T_NS], steps, lost=lost)
        return steps

    def _spanned(self, t_ns: int, steps: int, *, lost: bool) -> None:
        """Handle a sample that spans several periods, because feedback was lost or the loop was late."""
        passed = steps * self._period
        if not lost and passed > self._limits.age:
            self._trip(TripKind.PERIODS_MISSED, passed, self._limits.age)
        self.gaps.note(t_ns, steps)
        if self.gaps.too_many:
            kind = TripKind.FEEDBACK_SPARSE if lost else TripKind.PERIODS_MISSED
            self._trip(kind, self.gaps.share, LARGEST_MISSING_SHARE, f"{self.gaps.stretch:.2f}")

    def motion(self, here: float, way: float, elapsed_ns: int, age_ns: int) -> float:
        """Trip if the motion by `way` to `here` [m or rad] was too fast or too sudden, or left the position range.

        Return the motion in one period at this speed, or at the speed before if too little time has passed.
        """
        limits, state = self._limits, self._state
        passed = max(elapsed_ns * 1e-9, self._period)
        # If the computer stood still between SYNC and the answer, a simulated drive may not have latched.
        passed += max(0.0, age_ns * 1e-9 - self._period)
        if abs(way) > limits.speed * passed + self._resolution:
            self._trip(TripKind.SPEED, abs(way) / passed, limits.speed)
        if not self._lowest <= here <= self._highest:
            self._trip(TripKind.POSITION, here, self._lowest if here < self._lowest else self._highest)
        # A period after a late period is shorter; divided by its length the same speed shows no change.
        periods = elapsed_ns / self._period_ns
        change, widest = abs(way - state.way * periods), max(periods, 1.0)
        # A late drive latched at some instant between SYNC and arrival; a change of speed depends on three instants.
        (_, first_ns), (way_before, second_ns) = self._looked
        unsure = (first_ns + second_ns + age_ns) / self._period_ns * max(abs(way_before), abs(state.way))
        if change > self._jump * widest**2 + 2.0 * self._resolution * widest + unsure:
            self._trip(TripKind.ACCELERATION, change / passed**2, limits.acceleration)
        if periods <= SHORTEST:  # the speed before is kept, with its uncertainty
            self._looked = ((way_before, first_ns), (state.way, second_ns + age_ns))
            return state.way
        self._looked = ((way_before, second_ns), (state.way, age_ns))
        return way / periods


def in_time(period: float) -> tuple[int, int]:
    """Return the earliest and the latest time [ns] after the last sample for a sample of the next period."""
    return round(SHORTEST * 1e9 * period), round(1.5e9 * period)
