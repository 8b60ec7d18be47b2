"""The running plan: one input image in, one output image out, once a period.

A cycle has no I/O and no clock. In every period all axes *observe*: they decode the image and follow link, power state
and position. While every axis is in operation enabled and nothing has tripped, the axes then *sense* the other signals
that the scene needs, the couplings add their forces, and the axes *render*. Otherwise every target torque is 0. `row`
returns the decoded, computed and sent values of the period; only a recorded run calls it.
"""

import math
from collections.abc import Callable, Sequence
from itertools import chain

from haptic_fieldbus.cycle.axis import COMPUTED, AxisCycle
from haptic_fieldbus.cycle.energy import Ledger, LedgerAxis
from haptic_fieldbus.cycle.energy_steps import PlainAccount, bind_ledger
from haptic_fieldbus.cycle.laws import Noted, Over, PairField, PeriodStep, blended_pair, has_no_rest, in_order
from haptic_fieldbus.cycle.ordinary import Account, ElsewhereJudged, Step, bind_ordinary
from haptic_fieldbus.cycle.safety import Trip, TripKind
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.energy import judged_groups, ledger_elements
from haptic_fieldbus.planning.image import AGE_NS, AXIS_HEADER_FIELDS, T_NS
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.element import CouplingElement
from haptic_fieldbus.signals import Signal

DECODED_NAMES = {Signal.POSITION: "position counts", Signal.VELOCITY: "velocity reading"}
"""Column names of the raw readings; the plain names belong to the computed quantities."""


def decoded_columns(plan: Plan) -> tuple[str, ...]:
    """Return the names of the values in the input image: `t_ns`, then `axis.quantity` of headers and mapped signals.

    The mapped signals of an axis stand in the order of their octets.
    """
    headers = [f"{axis.name}.{field}" for axis in plan.axes for field in AXIS_HEADER_FIELDS]
    mapped = [(axis.name, each.signal) for axis in plan.axes for each in axis.traffic.incoming]
    return ("t_ns", *headers, *(f"{axis}.{DECODED_NAMES.get(signal, signal.value)}" for axis, signal in mapped))


def columns(plan: Plan) -> tuple[str, ...]:
    """Return the names of the values in a row: `t_ns`, then for each axis decoded, computed and sent values.

    The mapped signals of an axis stand in the order of the cycle.
    """
    names = ["t_ns"]
    for axis in plan.axes:
        decoded = [DECODED_NAMES.get(mapped.signal, mapped.signal.value) for mapped in axis.incoming]
        sent = [mapped.signal.value for mapped in axis.outgoing]
        names += [f"{axis.name}.{name}" for name in (*AXIS_HEADER_FIELDS, *decoded, *COMPUTED, *sent)]
    return tuple(names)


def _judged(judge: PeriodStep, render: PeriodStep) -> PeriodStep:
    """Return one step that judges the last period, and then renders."""

    def step() -> None:
        judge()
        render()

    return step


class Cycle:
    """A running plan: `cycle(image)` returns the output image of the period, in one buffer that is reused.

    `row`, `trip` and `enabled` describe the period; `axes` and `ledgers` keep the state of the run.
    """

    def __init__(self, plan: Plan) -> None:
        self.columns = columns(plan)
        self.trip: Trip | None = None
        self.failure: Exception | None = None
        """Exception that an element raised; torque is zero from then on."""
        self.enabled = False
        """True while every axis is in operation enabled and nothing has tripped."""
        self.output = bytearray(plan.image.output_size)
        """Output image, shared by all axes."""
        self.axes = {
            axis.name: AxisCycle(self, axis, image, plan.period, controlled=plan.scene.controlled)
            for axis, image in zip(plan.axes, plan.image.axes, strict=True)
        }
        # Every axis decodes the t_ns of the image, so any axis can serve.
        self._first, *self._others = self.axes.values()
        self._pairs = [self._pair(element, plan.period) for element in plan.scene.couplings]
        self._ramps: list[Over] = []
        """Ramps of couplings that have begun, each by whether it is over."""
        self._couplings = [self._coupled(place, element) for place, element in enumerate(plan.scene.couplings)]
        tied = dict.fromkeys(name for element in plan.scene.couplings for name in element.axes)
        self._tied = tuple(self.axes[name].state for name in tied)
        self._sensed = tuple(self.axes[name].sensed for name in tied)
        self._apart = 0
        """Periods in a row in which a coupled axis had no sample."""
        if tied:
            watches = [self.axes[name].watch for name in tied]
            strictest = min((watch.gaps for watch in watches), key=lambda gaps: gaps.tolerance)
            for watch in watches:
                watch.gaps = strictest
        self._controlled = plan.scene.controlled
        self.ledgers = tuple(self._ledger(plan, names) for names in judged_groups(plan.axes, plan.scene.couplings))
        """The energy ledgers, in the order of their first axes."""
        self._render = self._begin
        self._account: Account | None = None
        """Account that both steps of an only axis use."""
        self.full = self._bind_full()
        """The cycle as a function that takes each period through all of its code."""
        self.step = self._bind_step()
        """The cycle as a function; periods of an only axis in which nothing happens go a shorter way."""

    def __call__(self, image: bytes | bytearray) -> bytearray:
        """Compute one period and return the output image; after a trip it stays torque-free."""
        return self.step(image)

    def _bind_full(self) -> Step:
        output, observers = self.output, tuple(axis.observe for axis in self.axes.values())

        def step(image: bytes | bytearray) -> bytearray:
            try:
                for observe in observers:
                    observe(image)
                if self.enabled:
                    self._render()
            except Exception as error:
                self.fail(error)
            if not self.enabled:
                for axis in self.axes.values():
                    axis.release(tripped=self.trip is not None)
            return output

        return step

    def _bind_step(self) -> Step:
        """Return the step of ordinary periods, or `full` for a plan that has no such step."""
        axis = self._first
        if self._others or not self.ledgers or axis.echo is None or axis.axis.integrates:
            return self.full
        (ledger,) = self.ledgers
        plain = ledger.is_plain and not self._controlled
        self._account = PlainAccount(ledger) if plain else ElsewhereJudged(ledger, controls=self._controlled)
        return bind_ordinary(self, axis, self._account, axis.echo, self.output, self.full)

    @property
    def row(self) -> tuple[float, ...]:
        """One number for each name in `columns`."""
        first = self._first.row()
        return first if not self._others else (*first, *chain.from_iterable([axis.row()[1:] for axis in self._others]))

    @property
    def t_ns(self) -> int:
        """Instant at which the drives latched the feedback of this period [ns]."""
        return self._first.state.feedback[T_NS]

    @property
    def age_ns(self) -> int:
        """Age of the oldest feedback when it was used [ns]."""
        return max([axis.state.feedback[AGE_NS] for axis in self.axes.values()])

    @property
    def changing(self) -> bool:
        """Whether the ramp of a change still goes on; it pauses while samples are missing."""
        self._ramps = [over for over in self._ramps if not over()]
        return bool(self._ramps) or any(axis.changing for axis in self.axes.values())

    def prepare(self, before: Plan, after: Plan, periods: int) -> Callable[[], bool]:
        """Return a function that begins the ramp from the elements of `before` to those of `after`.

        Both are plans of this loop. `prepare` may be called from any thread; the returned function must be called
        once a period, between two periods, until it returns True. It returns False and begins nothing while the new
        elements would throw a handle: while a force would change by more than a scene may ask for in its first period.
        Elements that are equal in both plans keep their state. Each changed element starts afresh and is faded in over
        `periods`, while the old one is faded out. A changed coupling, and an element with a memory, has no force at
        rest that would tell what it does. So another one like it is first rendered for `periods` without acting.
        """
        exchanges, changes = [], {}
        trial = 0
        for old, new in zip(before.axes, after.axes, strict=True):
            axis = self.axes[new.name]
            both = enumerate(zip(old.elements, new.elements, strict=True))
            fields = {place: axis.field_of(to) for place, (was, to) in both if to != was}
            tried = {at: axis.field_of(new.elements[at]) for at in fields if has_no_rest(new.elements[at])}
            changes[new.name] = axis.changed_by(old.elements, new.elements, tried)
            exchanges.append((axis, fields, new.elements))
            trial = periods if tried else trial
        couplings = enumerate(zip(before.scene.couplings, after.scene.couplings, strict=True))
        pairs = {place: self._pair(to, after.period) for place, (was, to) in couplings if to != was}
        tried_pairs = {place: self._pair(after.scene.couplings[place], after.period) for place in pairs}
        trial, calm = periods if pairs else trial, 0

        def throws() -> bool:
            steps = {name: change() for name, change in changes.items()}
            for place, pair in tried_pairs.items():
                forces = zip(after.scene.couplings[place].axes, pair(), self._last_pair(place), strict=True)
                for name, force, last in forces:
                    steps[name] += force - last
            return not all(abs(step) <= self.axes[name].largest_step for name, step in steps.items())

        def change() -> bool:
            nonlocal calm
            calm = -1 if throws() else calm
            calm += 1
            if calm <= trial:
                return False
            for ledger in self.ledgers:
                ledger.exchange(*ledger_elements(after, ledger.axes), periods)
            for axis, fields, elements in exchanges:
                axis.exchange(fields, elements, periods)
            for place, pair in pairs.items():
                self._pairs[place], over = blended_pair(self._pairs[place], pair, periods)
                self._ramps.append(over)
            return True

        return change

    def sign_seen(self) -> None:
        """Let forces rise once the motor direction of every axis is confirmed: a coupling acts on two axes."""
        if all(each.sign.proof is None or each.sign.proof.seen for each in self.axes.values()):
            deep = any(each.is_deep for each in self.axes.values())
            for each in self.axes.values():
                each.sign.permit(self.t_ns, deep=deep)

    def sign_doubted(self) -> None:
        """Limit all axes to the holding force while one motor direction is tested: a coupling acts on two axes."""
        for each in self.axes.values():
            each.sign.hold()

    def update_enabled(self) -> None:
        """Set `enabled` after a power state has changed."""
        states = [axis.state.power for axis in self.axes.values()]
        self.enabled = self.trip is None and all(state is PowerState.OPERATION_ENABLED for state in states)

    def _begin(self) -> None:
        """Render the first period in operation enabled, and bind `_render` to the steps that the plan needs.

        This is the first period in which every axis has feedback. The handles are then at their zero and start
        positions.
        """
        axes = self.axes.values()
        if not all(axis.state.steps for axis in axes):
            for axis in axes:
                axis.release(tripped=False)
            return
        for axis in axes:
            axis.begin()
        if any(axis.sign.proof for axis in axes):
            self.sign_doubted()
        # Coupling forces must be complete before any axis renders, and every coupling may read any sensed signal.
        before: list[Callable[[], None]] = [axis.sense for axis in axes if axis.sense is not None]
        if self._couplings:
            before.insert(0, self._share_gaps)
            before.append(self._uncouple)
        renders, account = {name: axis.render for name, axis in self.axes.items()}, self._account
        for ledger in self.ledgers:
            # Before any axis of the ledger renders, while the states still hold the last targets sent.
            first, controls = ledger.axes[0].name, self._controlled
            judge = account.bind() if account else bind_ledger(ledger, controls=controls)
            renders[first] = _judged(judge, renders[first])
        self._render = in_order((*before, *self._couplings, *renders.values()))
        self._render()
        for axis in axes:
            axis.check_start()

    def fail(self, error: Exception) -> None:
        """Set torque to zero from this period on, because a law of the scene raised `failure`."""
        self.failure, self.enabled = error, False
        if self.trip is None:
            name, detail = next(iter(self.axes)), f"{type(error).__name__}: {error}"
            self.trip = Trip(TripKind.ELEMENT_FAILED, name, self.t_ns, math.nan, detail=detail)

    def _ledger(self, plan: Plan, axes: Sequence[AxisPlan]) -> Ledger:
        """Return the ledger of axes that are judged together; an account above its limit trips the first axis."""
        name = axes[0].name

        def trip(energy: float, limit: float, kind: TripKind = TripKind.ENERGY) -> None:
            if self.trip is None:
                position = self.axes[name].state.position
                self.trip = Trip(kind, name, self.t_ns, energy, limit, position=position)
                self.enabled = False

        cycles = [(axis, self.axes[axis.name]) for axis in axes]
        ports = [LedgerAxis(axis, each.state, each.sensed, each.permission) for axis, each in cycles]
        ledger = Ledger(ports, *ledger_elements(plan, axes), plan.period, trip)
        for _, each in cycles:
            each.forgive, each.place.moved = ledger.doubted, ledger.moved_by(each.permission, each.state)
        return ledger

    def _pair(self, element: CouplingElement, period: float) -> PairField:
        """Return a fresh law of the coupling; it reads the signals of its two axes itself."""
        law, (one, other) = element.begin(period), (self.axes[name] for name in element.axes)
        first, second, on_first, on_second = one.state, other.state, one.permission, other.permission
        # Common combinations are written out, as in `with_signals`.
        if element.needs == (Signal.POSITION,):
            return lambda: law(first.position - on_first.shift, second.position - on_second.shift)
        if element.needs == (Signal.POSITION, Signal.VELOCITY):
            of_first, of_second = one.sensed, other.sensed
            return lambda: law(
                first.position - on_first.shift,
                of_first.velocity,
                second.position - on_second.shift,
                of_second.velocity,
            )
        read_first, read_second = one.reader(element.needs), other.reader(element.needs)
        return lambda: law(*read_first(), *read_second())

    def _last_pair(self, place: int) -> tuple[float, float]:
        """Return the forces of a coupling in the last period; nan in the first call, which begins to note them."""
        pair = self._pairs[place]
        if not isinstance(pair, Noted):
            self._pairs[place] = pair = Noted(pair, (math.nan, math.nan))
        return pair.last

    def _coupled(self, place: int, element: CouplingElement) -> Callable[[], None]:
        """Return the step that adds the forces of a coupling to its two axes."""
        pairs, (first, second) = self._pairs, (self.axes[name] for name in element.axes)

        def couple() -> None:
            on_first, on_second = pairs[place]()  # looked up in each period, because a change replaces the pair
            first.sensed.coupled += on_first
            second.sensed.coupled += on_second

        return couple

    def _share_gaps(self) -> None:
        """Let the gap of one axis be a gap of all axes coupled with it: their forces follow from its position.

        It ends with a period in which all of them have a sample.
        """
        missing = 0
        for state in self._tied:
            missing += state.missing
        if missing or self._apart:
            self._apart = self._apart + 1 if missing else 0
            for state in self._tied:
                state.holding = self._apart

    def _uncouple(self) -> None:
        """Reset the coupling force of each axis to 0, before the couplings of the period add to it."""
        for sensed in self._sensed:
            sensed.coupled = 0.0
