"""Certificate of a contact on its bench: stiffness is raised in steps, each a run with all guards, and tapped.

Up to the limit a person may tap by hand. Above it the drive taps, nobody holds the handle, and the effort is at most
`BEYOND_SHARE` of rated torque. No stiffness is above a share of the onset, of the predicted one and of that which the
taps so far have told. The motor is off between two stiffnesses.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from haptic_fieldbus.api import Trial, prepare_run
from haptic_fieldbus.api.identification import FADE_IN, LONGEST, MeasuringLaw, Question, Tell, conduct, has_faded_in
from haptic_fieldbus.assessing.looking_back import shaft_record
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.documents.own_parts import OwnName
from haptic_fieldbus.drive.profile import Identity
from haptic_fieldbus.errors import PlanError, SafetyTripError, UsageError
from haptic_fieldbus.identification.certificate import (
    FIRST_COUNTS,
    FIRST_STEPS,
    GAVE_WAY,
    Certificate,
    TappedContact,
    Tapping,
)
from haptic_fieldbus.identification.estimates import Estimate
from haptic_fieldbus.identification.experiment import Bounds
from haptic_fieldbus.identification.fit import ShaftFit, fit_shaft
from haptic_fieldbus.identification.shaft import ShaftModel, ShaftRecord
from haptic_fieldbus.margins.closed_loop import with_parameters
from haptic_fieldbus.numerals import in_unit, percent, rounded_down
from haptic_fieldbus.planning.limits import BEYOND_SHARE
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import select
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.running.session import Session, agreed
from haptic_fieldbus.scenes.element import AnyElement, Varying
from haptic_fieldbus.sim.hand import Hand, Piece

TOP_SHARE, LARGEST_SHARE = 0.8, 0.9
"""Share of the onset that no stiffness exceeds, and the largest share that a caller may ask for."""
FIRST_STEP, STEP, LAST_STEP = 0.2, 1.6, 1.05
"""First stiffness as a share of the limit; largest ratio of neighbours, and the smallest one that is worth a run."""
FITTED = 3
"""Stiffnesses whose pulses are fitted: the first and the last ones."""
WELL_FITTED = 1.0
"""Error of a fit from which on it is begun anew [counts]."""
PRESS_SHARE, ROOM_SHARE = 0.95, 0.3
"""Effort of the press as a share of the effort limit, and its depth as a share of the travel behind the surface."""
INSIDE = 0.02
"""Part of the travel at each of its ends in which the taps end, before the run trips."""
LONGEST_DELAY = 20.0
"""Longest delay of an interval, in periods."""
FINGER = OwnName("finger", Hand("finger", tuple(
    Piece(start, force) for at in (3.0, 5.0, 7.0) for start, force in ((at, 2.0), (at + 0.05, 0.0))
)))  # fmt: skip
"""Finger of a simulation, which taps while the drive listens [s, N]."""
FEW = "resolution: the swings of a contact have too few encoder counts or torque steps"


@dataclass(frozen=True)
class CertifyTask:
    """Request of a caller: a scene on its bench, and how it is tapped."""

    task: Task
    by_hand: bool = False
    """Whether a person taps up to the limit; else the drive does."""
    share: float = TOP_SHARE
    """Share of the onset that no stiffness exceeds."""
    seed: int = DEFAULT_SEED


def certify(
    asked: CertifyTask,
    *,
    confirm: Question | None = None,
    above: Question | None = None,
    instruct: Tell | None = None,
    announce: Callable[[tuple[str, ...]], None] | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Certificate:
    """Raise the stiffness of a scene in steps, tap it, and return what was seen.

    `confirm` is asked before a real drive is enabled for the first time, and `above` before the first stiffness above
    the limit; without `above` a real bench stays below. `announce` is called before any bus is opened, `progress` with
    each stiffness and its unit. Raises DocumentError, UsageError, PlanError, and as a run BusError, DriveFaultError or
    SafetyTripError; the motor is off by then.
    """
    bench = _TappedBench(asked, confirm, above, instruct)
    if announce is not None:
        announce(tuple(bench.announced()))
    for stiffness in bench.stiffnesses():
        if progress is not None:
            progress(stiffness, bench.unit)
        bench.tap(stiffness)
    return bench.certificate()


def _at_rest(element: AnyElement) -> float:
    """Return the stiffness against a constant push; that of a mass behind a spring is 0."""
    told = element.linearised()
    rest = np.linalg.lstsq(told.a, told.b[:, 0], rcond=None)[0] if told.order else np.zeros(0)
    stiffness = abs(float(told.d[0, 0] - told.c[0] @ rest))
    return stiffness if stiffness > 1e-6 * abs(float(told.d[0, 0])) else 0.0


def _surface(element: AnyElement, side: float) -> float:
    """Return the place at which the contact begins for a push to a side."""
    places = (getattr(element, key, None) for key in ("position", "wall", "upper"))
    return next((float(each) for each in places if each is not None), 0.0) + side * getattr(element, "dead_band", 0.0)


class _TappedBench:
    """The bench of a certificate, and what its taps have told so far."""

    def __init__(
        self, asked: CertifyTask, confirm: Question | None, above: Question | None, instruct: Tell | None
    ) -> None:
        check_request(rate=asked.task.rate, seed=asked.seed)
        if not 0.0 < asked.share <= LARGEST_SHARE:
            raise UsageError(f"--share {asked.share}: expected a number above 0, up to {LARGEST_SHARE}")
        self._asked, self._confirm, self._above, self._instruct = asked, confirm, above, instruct
        self.plan = select(asked.task).plan
        self.axis = axis = self.plan.axes[0]
        group = axis.group
        if len(self.plan.axes) != 1 or group is None or group.stiffest is None or axis.integrates:
            raise UsageError("certify needs a scene of one axis with a stiffness, on a drive that reports its position")
        self.group, self.element, self.unit = group, group.stiffest, axis.workspace.stiffness_unit
        if not _at_rest(self.element):
            raise UsageError(f"certify needs a contact that holds a constant push; {self.element.name} gives way to it")
        self.limit, self.predicted = group.stability.limit.value, group.stability.stiffness_limit.stable or 0.0
        if not (self.limit > 0.0 and math.isfinite(self.predicted)):
            raise PlanError("certify needs a contact with a limit above 0; this scene has none on this bench")
        self.effort = min(axis.limits.effort, BEYOND_SHARE * axis.rated_effort)
        self.top, self.ended, self._is_confirmed = asked.share * self.predicted, "", False
        self.contacts: list[TappedContact] = []
        self.fit: ShaftFit | None = None
        self._session: Session | None = None

    def announced(self) -> Iterator[str]:
        """Yield what will move, how strongly and how stiffly."""
        effort, share = in_unit(self.effort, self.axis.workspace.effort_unit), self.effort / self.axis.rated_effort
        taps = "you tap the handle with a finger, and take the hand away" if self._asked.by_hand else "keep hands off"
        top = f"{in_unit(self.top, self.unit)} ({percent(self._asked.share)} of the predicted onset)"
        yield f"axis {self.axis.name}: the handle moves by itself, into the contact and back"
        yield f"at most {effort} ({percent(share)} of rated torque)"
        if self.top <= self.limit:
            yield f"up to {top}, which is below the limit: {taps}"
        else:
            yield f"up to the limit of {in_unit(self.limit, self.unit)}: {taps}"
            yield f"above it, up to {top}: nobody may touch the handle"

    def stiffnesses(self) -> Iterator[float]:
        """Yield each stiffness to tap, decided after the one before."""
        value = rounded_down(min(FIRST_STEP * min(self.limit, self.predicted), self.top), 3)
        allowed = self.plan.simulated
        while not self.ended:
            if value > self.limit and not allowed and not (allowed := agreed(self._above, self._question())):
                self.ended = "the limit, because going above it was not confirmed"
                return
            yield value
            told = math.inf if self.fit is None else self._asked.share * self._onset(self.fit.model)
            before, value = value, min(STEP * value, self.top, told)
            value = rounded_down(self.limit if LAST_STEP * before < self.limit < value else value, 3)
            if not self.ended and value < LAST_STEP * before:
                self.ended = f"{percent(self._asked.share)} of the onset, which no stiffness may exceed"

    def _question(self) -> str:
        return (
            f"about to go above the limit of {in_unit(self.limit, self.unit)}, up to {in_unit(self.top, self.unit)}: "
            f"the contact may begin to vibrate. At most {percent(BEYOND_SHARE)} of rated torque. Take all hands off "
            "the handle and keep them off.\nGo on?"
        )

    def _confirmed(self, question: str) -> bool:
        """Return whether torque may be enabled; a person is asked once."""
        self._is_confirmed = self._is_confirmed or agreed(self._confirm, question)
        return self._is_confirmed

    def tap(self, stiffness: float) -> None:
        """Tap the contact at a stiffness in a run of its own, and keep what it told."""
        stiff = with_parameters(self.element, {"stiffness": stiffness})
        if (law := self._law(stiff, stiffness)) is None:
            return
        record = self._conducted(law, stiff, beyond=stiffness > self.limit)
        if law.failure == GAVE_WAY and self.contacts:  # the less stiff ones hold
            self.ended = f"{law.failure}, at {in_unit(stiffness, self.unit)}"
            return
        if law.failure and not law.grew:
            raise SafetyTripError(f"{law.failure}; torque is off")
        self.contacts.append(TappedContact(stiffness, law.growth, law.by_hand, record))
        if law.grew:
            self.ended = f"growth: at {in_unit(stiffness, self.unit)} {law.failure}"
        pulses = [each.record for each in self.contacts if not each.by_hand]
        with suppress(ValueError):  # too few samples, or nothing moved: these taps tell no shaft
            records = [*pulses[:1], *pulses[1:][1 - FITTED :]]
            found = fit_shaft(records, self.fit.model if self.fit else None)
            if self.fit and found.residual > WELL_FITTED:  # from the fit before, another minimum may come first
                found = min(found, fit_shaft(records), key=lambda each: each.residual)
            self.fit = found

    def _law(self, stiff: AnyElement, stiffness: float) -> Tapping | None:
        """Return the law of the taps; None where a swing would have too few counts or torque steps.

        A stiffer contact may have enough of them if the travel limits the press.
        """
        axis, limits, plant = self.axis, self.axis.limits, self.group.members[0].plant
        low, high = limits.position or (-math.inf, math.inf)
        side = -1.0 if getattr(stiff, "side", "positive") == "negative" else 1.0
        surface, soft = _surface(stiff, side), _at_rest(stiff)
        room = ROOM_SHARE * (high - surface if side > 0.0 else surface - low) * stiffness
        press = min(PRESS_SHARE * self.effort, room)
        if isinstance(stiff, Varying) and max(map(abs, stiff.local(-math.inf, math.inf).force)) < press:
            text = in_unit(press, axis.workspace.effort_unit)
            raise UsageError(f"certify needs a contact that holds a push of {text}; {stiff.name} gives way to it")
        least = max(FIRST_COUNTS * axis.resolution, FIRST_STEPS * axis.effort_unit / stiffness)
        if press / stiffness < 1.5 * least:
            self.ended = FEW if press < room else ""
            return None
        inside, period = INSIDE * (high - low) if limits.position else 0.0, self.plan.period
        bounds = Bounds(
            period, axis.resolution, low + inside, high - inside, limits.speed, self.effort, limits.acceleration
        )
        return Tapping(
            bounds, plant.mass, plant.coulomb, axis.delay.total + period, surface=surface, press=side * press,
            stiffness=soft, least=least, by_hand=self._asked.by_hand and stiffness <= self.limit,
        )  # fmt: skip

    def _conducted(self, law: Tapping, stiff: AnyElement, *, beyond: bool) -> ShaftRecord:
        """Conduct the taps in a run, and return the record from the press on."""
        task, name = self._asked.task, self.axis.name
        rig = load_rig(task.rig, task.profiles) if isinstance(task.rig, str | Path) else task.rig or self.plan.rig
        limits = replace(rig.axis[name].limits, effort=self.effort)
        rig = replace(rig, axis={**rig.axis, name: replace(rig.axis[name], limits=limits)})
        varied = [stiff if each is self.element else each for each in self.plan.scene.elements]
        scene = replace(self.plan.scene, elements=(*varied, MeasuringLaw(name, law, self.effort, "taps")))
        task = replace(task, scene=scene, rig=rig, settings=None, axes=None)
        trial = Trial(
            duration=LONGEST, hand=FINGER if law.by_hand and self.plan.simulated else "none", fade_in=FADE_IN,
            seed=self._asked.seed, confirm=self._confirmed, instruct=self._instruct,
        )  # fmt: skip

        def watch(session: Session) -> bool:
            if session.cycle is not None and has_faded_in(session.cycle, name):
                law.advance(session.cycle.axes[name].state.position)
            return law.done

        session = self._session = conduct(*prepare_run(task, trial, beyond=beyond), watch)
        if not law.done:
            raise SafetyTripError("the taps were ended before the last one; torque is off")
        whole = shaft_record(self.axis, self.plan.period, session.kept, session.report.enabled_at_ns or 0)
        return whole.part(max(len(whole.positions) - law.periods, 0))

    # What the taps tell.

    def _onset(self, model: ShaftModel) -> float:
        """Return the onset of the scene on a shaft [N/m or N·m/rad]."""
        (member,), square = self.group.members, self.axis.rig.mechanism.ratio**2
        mass, damping = model.inertia / square, model.damping / square
        plant = replace(member.plant, mass=mass, damping=damping, torque_lag=model.lag)
        delay = min(max(model.delay, 0.0), LONGEST_DELAY * self.plan.period)
        group = replace(self.group, members=(replace(member, plant=plant, delay=delay, ranges=None),))
        return group.loop.limit(lambda stiffness: group.environment(stiffness=stiffness))

    def _told_onset(self) -> Estimate | None:
        """Return the onset with its interval.

        The ends of damping and delay are taken one by one, and their distances added as squares. Both estimates vary
        together, because the taps tell their difference best, so the interval is rather too wide.
        """
        if self.fit is None or self.fit.resonance:  # an elastic shaft has another onset than the model
            return None
        model, (damping, delay) = self.fit.model, map(self.fit.values.__getitem__, ("viscous_damping", "delay_and_lag"))
        value = self._onset(model)

        def away(end: ShaftModel) -> float:
            return value - self._onset(end)

        below, above = (
            math.hypot(away(replace(model, damping=b)), away(replace(model, delay=d - model.lag)))
            for b, d in ((damping.low, delay.high), (damping.high, delay.low))
        )
        return Estimate(value, max(value - below, 0.0), value + above, self.unit, damping.reason or delay.reason)

    def certificate(self) -> Certificate:
        """Return what was seen."""
        plan, session = self.plan, self._session
        drive = Identity() if plan.simulated or session is None else session.identities[self.axis.name]
        serial, firmware = (number and f"{number:#010x}" for number in (drive.serial, drive.revision))
        bench: dict[str, object] = {
            "rig": plan.rig.source or None, "drive": self.axis.profile.title, "serial": serial, "firmware": firmware,
            "bus": "simulated" if plan.simulated else self.axis.bus_name, "rate_hz": plan.rate,
            "basis": self.group.stability.limit.basis.value,
        }  # fmt: skip
        return Certificate(
            plan.scene.name, self.element.name, self.unit, self.limit, self.predicted, tuple(self.contacts),
            self._told_onset(), self.ended if self.contacts else FEW, bench,
            datetime.now().astimezone().isoformat(timespec="seconds"),
        )  # fmt: skip
