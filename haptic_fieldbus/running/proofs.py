"""Watchdog proof: test that the drives switch off by themselves without their master, at zero torque.

1. The drives are brought to *operation enabled* by the ordinary exchange. Every set-point is 0.
2. All writes end. Feedback is still requested, which does not restart the watchdog, so the statusword is read once a
   period. A drive may leave the exchange when it has lost its master; then its statusword is read directly.
3. The time from our last write to the first reading outside *operation enabled* is measured.
4. All drives are stopped, and the fault that this test caused is cleared (`Bus.acknowledge`).

A drive passes if it is read as off in time: its watchdog time, plus the travel time of the last write (in an exchange
that writes before it reads, this is the next period), plus two periods and a control tick between the event and its
reading. The measured time may be shorter than the watchdog time by the time between two watchdog restarts, because the
watchdog runs from the last one. A drive that is off still sooner was switched off by another cause, such as STO.
Otherwise it has failed. The test is repeated if it was inconclusive: the drive was off too soon, or this computer read
no state at the decisive time.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime

from haptic_fieldbus.assessing.result import Proof
from haptic_fieldbus.buses.bus import Bus, DriveFacts
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.documents.edits import Value, table_text, write_table
from haptic_fieldbus.drive.profile import ENERGISED, Identity, PowerState
from haptic_fieldbus.drive.rig import Proved
from haptic_fieldbus.errors import (
    BusError,
    BusTimeoutError,
    DriveFaultError,
    Fault,
    RigError,
    UnprovedGuardError,
    UsageError,
)
from haptic_fieldbus.numerals import exactly, in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.guards import CAPPED, LONGEST_QUESTION, SetGuard
from haptic_fieldbus.planning.image import EMERGENCY, FLAGS, STATUSWORD, T_NS, AxisImage
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.loop import (
    check_link,
    enabled_by_itself,
    enabling_time,
    feedback_time_ns,
    not_enabled,
    started,
)
from haptic_fieldbus.signals import LinkFlag, Signal, Workspace

PATIENCE = 4.0
"""Longest time without writes, in watchdog times."""
ATTEMPTS = 5
"""Largest number of tests of the watchdogs while the result is inconclusive."""
FAULTS = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
WHILE_ALONE = LinkFlag.BUS_OFF | LinkFlag.FOREIGN | LinkFlag.DUPLICATE
"""Flags that end a proof; a drive may show the others when it has lost its master."""


def prove(plan: Plan, bus: Bus, clock: Clock, axes: Collection[str], ending: EndSignals) -> tuple[Proof, ...]:
    """Test the watchdogs of these axes of an inspected bus, and return the outcomes; the other axes stay off.

    An early or missed proof means that all attempts were inconclusive.

    The drives are then stopped and not configured. Raises KeyboardInterrupt after a signal, BusError, DriveFaultError
    or SafetyTripError; by then `bus.stop` was called, and a note says so when a drive did not confirm it.
    """
    for _ in range(ATTEMPTS):
        with started(plan, bus, ending):
            exchange = _ProofExchange(plan, bus, clock, axes, ending)
            exchange.enable()
            proofs = tuple(exchange.leave_alone())
        bus.acknowledge()
        if not any(proof.early or proof.missed for proof in proofs):
            break
    return proofs


class _TestedDrive:
    """State of one drive, and the times of its readings."""

    def __init__(self, axis: AxisPlan, image: AxisImage, guard: SetGuard) -> None:
        self.axis, self.guard = axis, guard
        self.state = PowerState.UNKNOWN
        self.enabled_ns = 0
        self.off_ns: int | None = None
        self._image = image
        self._asking_ns = 0
        self._enabled = False

    def take(self, image: bytes | bytearray) -> tuple[int, int, int]:
        """Decode the state; returns the instant [ns], flags and code of the feedback."""
        feedback = self._image.input.unpack_from(image)
        self.state = self.axis.power.state(feedback[STATUSWORD])
        return feedback[T_NS], feedback[FLAGS], feedback[EMERGENCY]

    def check_way(self) -> None:
        """Raise DriveFaultError for a fault, and if *operation enabled* was left, because nothing enables it again."""
        enabled = self.state is PowerState.OPERATION_ENABLED
        if self.state in FAULTS or (self._enabled and not enabled):
            raise DriveFaultError(
                f"axis {self.axis.name}: node {self.axis.node} changed to {self.state.value} by itself before the "
                "watchdog test began. No torque was commanded"
            )
        self._enabled = enabled

    def answer(self, output: bytearray, *, enabling: bool) -> None:
        """Encode the controlword on the way to *operation enabled*, or the one for off; torque 0."""
        power = self.axis.power
        controlword = power.answer(self.state) if enabling else power.off
        self._image.output.pack_into(output, self._image.outputs[0], controlword, 0)

    def note(self, at_ns: int) -> None:
        """Keep the time of this reading of the state."""
        if self.state in ENERGISED:
            self.enabled_ns = at_ns
        elif self.off_ns is None:
            self.off_ns = at_ns

    def ask(self, bus: Bus, clock: Clock) -> None:
        """Read the state of a drive that sent no feedback."""
        asked_ns = clock.now_ns()
        word = bus.ask(self.axis.name)
        answered_ns = clock.now_ns()
        self._asking_ns += answered_ns - asked_ns
        if word is not None:
            self.state = self.axis.power.state(word)
            self.note(answered_ns)

    def proof(self, alone_ns: int) -> Proof:
        """Return the outcome of the test without writes since `alone_ns`."""
        asking = min(self._asking_ns * 1e-9, LONGEST_QUESTION)
        off = None if self.off_ns is None else (self.off_ns - alone_ns) * 1e-9
        seen = (self.enabled_ns - alone_ns) * 1e-9
        guard = self.guard
        allowed, between = guard.allowed + asking, guard.between + asking
        return Proof(self.axis.name, guard.seconds, guard.earliest, allowed, seen, off, between)


class _ProofExchange:
    """The exchange of a proof: the loop's own, with torque 0."""

    def __init__(self, plan: Plan, bus: Bus, clock: Clock, axes: Collection[str], ending: EndSignals) -> None:
        self._plan, self._bus, self._clock, self._ending = plan, bus, clock, ending
        self._output = bytearray(plan.image.output_size)
        self._feedback_ns = feedback_time_ns(plan)
        self._deadline_ns = clock.now_ns()
        guards = {guard.axis: guard.set_to for guard in plan.guards}
        every = [
            _TestedDrive(axis, image, guards[axis.name]) for axis, image in zip(plan.axes, plan.image.axes, strict=True)
        ]
        self._proved = tuple(each for each in every if each.axis.name in axes)
        self._others = tuple(each for each in every if each.axis.name not in axes)

    def enable(self) -> None:
        """Bring the drives to *operation enabled*; raises BusTimeoutError when they do not get there in time."""
        for _ in range(round(enabling_time(self._plan) * self._plan.rate)):
            image = self._read()
            for drive in (*self._proved, *self._others):
                self._check(drive.axis, drive.take(image), ~LinkFlag.STALE)
                drive.check_way()
                drive.answer(self._output, enabling=drive in self._proved)
            self._bus.write(self._output)
            if all(drive.state is PowerState.OPERATION_ENABLED for drive in self._proved):
                return
        raise not_enabled(self._plan, {each.axis.name: each.state for each in (*self._proved, *self._others)})

    def leave_alone(self) -> Iterator[Proof]:
        """Write nothing until all drives are read as off, or `PATIENCE` is over; yield the outcomes."""
        alone_ns = self._clock.now_ns()
        patience_ns = round(1e9 * PATIENCE * max(drive.guard.seconds for drive in self._proved))
        for drive in self._proved:
            drive.enabled_ns = alone_ns
        waiting = self._proved
        while waiting:
            patient = self._clock.now_ns() - alone_ns < patience_ns
            image = self._read()
            for drive in waiting:
                feedback = drive.take(image)
                self._check(drive.axis, feedback, WHILE_ALONE)
                if feedback[1] & LinkFlag.STALE:
                    drive.ask(self._bus, self._clock)
                else:
                    drive.note(feedback[0])
            # Asked before the look, so that one comes after the end of patience whatever else this computer did.
            waiting = tuple(drive for drive in waiting if drive.off_ns is None) if patient else ()
        for drive in self._proved:
            yield drive.proof(alone_ns)

    def _read(self) -> bytearray:
        """Wait for the next period and exchange feedback; missed periods are skipped."""
        if self._ending.signal is not None:
            raise KeyboardInterrupt
        late_ns = self._clock.sleep_until(self._deadline_ns)
        self._deadline_ns += late_ns // self._plan.period_ns * self._plan.period_ns
        image = self._bus.read(self._deadline_ns + late_ns % self._plan.period_ns + self._feedback_ns)
        self._deadline_ns += self._plan.period_ns
        return image

    def _check(self, axis: AxisPlan, feedback: Sequence[int], flags: int) -> None:
        """Raise the error of the first link fault among these flags."""
        _, found, code = feedback
        check_link(axis, found & flags, code, "during the watchdog test. No torque was commanded")


# Proofs of guards around a run: which are due, what a person is told before, and what is kept in the rig file.

KEYS = ("serial", "vendor", "product", "revision", "guard", "guard_ms", "asked_ms", "profile", "digest", "date")
"""Keys of a proof, in the order in which they are written."""


def questions(plan: Plan, due: Mapping[str, str]) -> Iterator[str]:
    """Yield a sentence for each axis whose watchdog is about to be tested; `due` has the reasons, some empty."""
    guards = {guard.axis: guard.seconds for guard in plan.guards}
    for name, why in due.items():
        yield (
            f"about to test the drive watchdog of axis {name}{f' ({why})' if why else ''}: the drive is enabled at "
            "zero torque, then receives nothing until it switches off by itself (watchdog "
            f"{exactly(1e3 * guards[name])} ms). It may report a lost master; that fault is then cleared."
        )


def check(plan: Plan, facts: Mapping[str, DriveFacts], proofs: Sequence[Proof], unkept: Sequence[str]) -> None:
    """Raise UnprovedGuardError if a drive did not switch off in time; `unkept` has the sentences of `keep`.

    Raises BusError if this computer was too late to read the state.
    """
    unknown = [_switched_off(plan, proof) for proof in proofs if proof.early]
    failed = [_failure(plan, facts, proof) for proof in proofs if not (proof.holds or proof.early or proof.missed)]
    if failed or unknown:
        raise UnprovedGuardError("\n".join([*failed, *unknown, *unkept]))
    if any(proof.missed for proof in proofs):
        raise BusError(
            f"this computer was late in all {ATTEMPTS} watchdog tests: another process uses the processor, or --rate "
            "is too high for this computer"
        )


def keep(plan: Plan, facts: Mapping[str, DriveFacts], proofs: Sequence[Proof]) -> Iterator[str]:
    """Write each outcome into the rig file of a real bench; yield a sentence for each that could not be written."""
    for proof in proofs if plan.rig.source and not plan.simulated else ():
        if proof.early or proof.missed:
            continue
        values = _values(plan, proof, facts[proof.axis].identity)
        if values is None:
            continue
        path = ("axis", proof.axis, "proved")
        if why := write_table(plan.rig.source, path, values):
            table = table_text(path, values).replace("\n", ", ")
            yield (
                f"the watchdog proof of axis {proof.axis} was not saved in {plan.rig.source}: {why}. To add it by "
                f"hand: {table}"
            )


def _values(plan: Plan, proof: Proof, drive: Identity) -> dict[str, Value] | None:
    """Return the keys of a proof; None if no later run could recognise the drive by them."""
    if proof.holds and drive.serial is None:
        return None
    kept = Proved(
        guard="proved" if proof.holds else "none",
        asked_ms=round(1e3 * proof.guard, 3),
        guard_ms=None if proof.off is None else round(1e3 * proof.off, 3),
        profile=plan.axis(proof.axis).profile.name,
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        **asdict(drive),
    )
    written = next(guard.set_to.written for guard in plan.guards if guard.axis == proof.axis)
    values = asdict(replace(kept, digest=kept.digest_with(written)))
    return {key: values[key] for key in KEYS if values[key] is not None}


def _failure(plan: Plan, facts: Mapping[str, DriveFacts], proof: Proof) -> str:
    """Return the measurement and the remedy."""
    axis = plan.axis(proof.axis)
    told = facts.get(proof.axis)
    number = None if told is None else told.identity.serial
    serial = "" if number is None else f" (serial {number:#010x})"
    stayed = f"for {rounded(1e3 * proof.enabled)} ms and did not switch off"
    when = stayed if proof.off is None else f"for {rounded(1e3 * proof.off)} ms"
    return (
        f"axis {proof.axis}: the watchdog of {axis.profile.title}, node {axis.node}{serial}, did not fire in time. "
        f"Without messages the power stage of the drive stayed on {when} (watchdog {exactly(1e3 * proof.guard)} ms, "
        f"at most {rounded(1e3 * proof.allowed)} ms accepted). No torque was applied. Such a drive keeps its torque "
        "if the computer dies or the cable breaks: check its watchdog and reaction with its own tool"
        f"{_instead(plan, proof.axis)}"
    )


def _switched_off(plan: Plan, proof: Proof) -> str:
    """Return the sentence about a drive that another cause than its watchdog switched off."""
    axis, off = plan.axis(proof.axis), rounded(1e3 * (proof.off or 0.0))
    return (
        f"axis {axis.name}: {axis.profile.title}, node {axis.node}, was off after {off} ms in all {ATTEMPTS} watchdog "
        f"tests, but its watchdog of {exactly(1e3 * proof.guard)} ms cannot fire before "
        f"{rounded(1e3 * proof.earliest)} ms. Something else switches it off, such as safe torque off (STO) or an "
        "enable input. The watchdog is not tested. No torque was applied"
    )


def _instead(plan: Plan, name: str) -> str:
    """Return the advice for a drive without a watchdog."""
    if not plan.rig.source:
        return (
            "; if an emergency stop cuts the motor power, a rig file can permit this drive (emergency_stop); then "
            f"{CAPPED}"
        )
    if plan.axis(name).rig.emergency_stop is None:
        stop = f'axis.{name}.emergency_stop = "power"'
        return f"; if an emergency stop within reach cuts the motor power, write {stop} into the rig; then {CAPPED}"
    if plan.simulated:
        return f"; the rig keeps no result of a simulated test; after this result on a real bus {CAPPED}"
    return f"; the result is saved in the rig; from the next run on {CAPPED}"


# The direction of an axis, shown by a person before the drive is enabled for the first time.
#
# With a reversed encoder *and* a reversed motor, torque and motion agree: no loop can tell this bench from a correct
# one, but a wall on the right is felt on the left. Only a person who sees the handle can tell. So at the first start of
# a rig on a real bus a person moves each handle to the positive side, while the drives are off. The rig file keeps the
# result in `[axis.NAME.seen]`.


ENOUGH = {Workspace.LINEAR: 0.01, Workspace.ROTARY: 0.2}
"""Required motion [m or rad]; too large for an accidental one."""
FEWEST_COUNTS = 3
PERSON_TIMEOUT = 60.0
"""Longest time to wait for a person [s]."""
MISSING_TIMEOUT = 1.0
"""Time without feedback after which nothing is waited for any more [s]."""
SHOWN_EVERY = 0.1
"""Time between two lines about the position [s]."""
INT32, HALF_TURN = 0x1_0000_0000, 0x8000_0000

Instruct = Callable[[str], None]


def confirm_direction(plan: Plan, bus: Bus, clock: Clock, instruct: Instruct | None, ending: EndSignals) -> list[str]:
    """Let a person show the direction of each axis whose rig does not have it; return the sentences about it.

    The bus must be inspected; the drives stay off, and are stopped before the rig file is written, because a disk may
    take longer than the watchdog time. Raises UsageError if the handle is not moved, RigError when positions fall on
    the way to the positive side, KeyboardInterrupt after a signal, and the error of a faulty link.
    """
    due = [axis for axis in plan.axes if axis.rig.seen.direction is None]
    if instruct is None or not plan.rig.source:
        return [
            f"axis {axis.name}: positive direction not confirmed by a person. Start once with a rig file at a "
            "terminal, without --yes, and move the handle when asked"
            for axis in due
        ]
    if not due:
        return []
    with started(plan, bus, ending):
        exchange = _WayExchange(plan, bus, clock, ending)
        for axis in due:
            _show(axis, plan, exchange, instruct)
    return [warning for axis in due for warning in _kept(axis, plan)]


def _show(axis: AxisPlan, plan: Plan, exchange: "_WayExchange", instruct: Instruct) -> None:
    """Wait until the handle was moved far enough, and check the direction."""
    unit = axis.workspace.length_unit
    enough = max(ENOUGH[axis.workspace], FEWEST_COUNTS * axis.resolution)
    every = max(1, round(SHOWN_EVERY * plan.rate))
    try:
        for number, way in enumerate(exchange.ways(axis)):
            if number % every == 0:
                instruct(
                    f"axis {axis.name} is off: move the handle {rounded(1e3 * enough)} m{unit} to the positive "
                    f"side; it is at {round(1e3 * way)} m{unit}"
                )
            if abs(way) >= enough:
                break
        else:
            raise UsageError(
                f"not enabled: the handle of axis {axis.name} did not move within {PERSON_TIMEOUT:g} s. Move it to the "
                "positive side when asked, or start with --yes, which leaves the direction unconfirmed"
            )
    finally:
        instruct("\n")  # what is printed next begins a line
    if way < 0.0:
        message = (
            f"the handle moved to the positive side, but its position fell by {in_unit(-way, unit)}. If this side is "
            f"to be positive, write sign = {-axis.rig.mechanism.sign}"
        )
        raise RigError(plan.rig.source, [Fault(f"axis.{axis.name}.mechanism.sign", message)])


def _kept(axis: AxisPlan, plan: Plan) -> Iterator[str]:
    """Write the shown direction into the rig file; yield a sentence if it cannot be written."""
    values: dict[str, Value] = {} if axis.rig.seen.sign is None else {"sign": axis.rig.seen.sign}
    values |= {"direction": "confirmed", "date": datetime.now().astimezone().isoformat(timespec="seconds")}
    if why := write_table(plan.rig.source, ("axis", axis.name, "seen"), values):
        yield f"axis {axis.name}: the confirmed direction was not saved in {plan.rig.source}: {why}"


class _WayExchange:
    """The exchange of the loop with drives that stay off."""

    def __init__(self, plan: Plan, bus: Bus, clock: Clock, ending: EndSignals) -> None:
        self._plan, self._bus, self._clock, self._ending = plan, bus, clock, ending
        self._deadline_ns = clock.now_ns()
        self._output = bytearray(plan.image.output_size)
        for axis, image in zip(plan.axes, plan.image.axes, strict=True):
            image.output.pack_into(self._output, image.outputs[0], axis.power.off, 0)

    def ways(self, axis: AxisPlan) -> Iterator[float]:
        """Yield the travel of the handle of an axis since the first sample [m or rad], once a period."""
        image = self._plan.image.axes[self._plan.axes.index(axis)]
        signal = Signal.VELOCITY if axis.integrates else Signal.POSITION
        place = STATUSWORD + [mapped.signal for mapped in axis.incoming].index(signal)
        first: int | None = None
        way, missing = 0.0, 0
        for _ in range(round(PERSON_TIMEOUT * self._plan.rate)):
            reading = self._read(axis, image, place)
            missing = 0 if reading is not None else missing + 1
            if missing * self._plan.period >= MISSING_TIMEOUT:
                raise BusTimeoutError(
                    f"axis {axis.name}: no {signal.value} came for {MISSING_TIMEOUT:g} s while the handle was to be "
                    "moved. No torque was applied"
                )
            if reading is not None and axis.integrates:
                way += reading * axis.velocity_unit * self._plan.period
            elif reading is not None:
                first = reading if first is None else first
                way = ((reading - first + HALF_TURN) % INT32 - HALF_TURN) * axis.position_unit
            yield way

    def _read(self, axis: AxisPlan, image: AxisImage, place: int) -> int | None:
        """Go through one period; return the reading, None without new feedback."""
        self._clock.sleep_until(self._deadline_ns)
        if self._ending.signal is not None:
            raise KeyboardInterrupt
        # A computer that was late goes on from now, because nothing here depends on the time of a period.
        self._deadline_ns = max(self._deadline_ns, self._clock.now_ns()) + self._plan.period_ns
        octets = self._bus.read(self._deadline_ns)
        self._bus.write(self._output)
        feedback = image.input.unpack_from(octets)
        flags = feedback[FLAGS]
        check_link(axis, flags, feedback[EMERGENCY], "before enabling. No torque was applied")
        for each, its in zip(self._plan.axes, self._plan.image.axes, strict=True):
            _check_off(each, its.input.unpack_from(octets))
        return None if flags & LinkFlag.STALE else feedback[place]


def _check_off(axis: AxisPlan, feedback: Sequence[int]) -> None:
    """Raise DriveFaultError for a drive that may feed its motor, although a person was told that it is off."""
    state = axis.power.state(feedback[STATUSWORD])
    if state in ENERGISED and not feedback[FLAGS] & LinkFlag.STALE:
        raise enabled_by_itself(axis, state)
