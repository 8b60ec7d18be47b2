"""The Python API: `plan`, `stability`, `response`, `run`; and the sites of a run.

`plan` compiles and explains, `stability` gives the limits, `response` simulates the open loop without a drive, and
`run` renders on a drive.
"""

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.api.arguments import asked_of
from haptic_fieldbus.api.open_loop import response as response
from haptic_fieldbus.api.stability_limits import Device, judge_scene
from haptic_fieldbus.assessing.result import Result, known_before
from haptic_fieldbus.defaults import (
    DEFAULT_BUS,
    DEFAULT_DURATION,
    DEFAULT_FADE_IN,
    DEFAULT_HAND,
    DEFAULT_NODE,
    DEFAULT_SEED,
)
from haptic_fieldbus.documents.own_parts import OwnName, name_of
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.planning.energy import with_energy_limits
from haptic_fieldbus.planning.limits import BEYOND_SHARE
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit, check_stable
from haptic_fieldbus.planning.request import Task, check_fade_in, check_request
from haptic_fieldbus.planning.selection import Selection, load, parsed, plan_task, select
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.recordings.provenance import Conditions, Provenance
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.sim.faults import Fault, checked_faults, load_faults
from haptic_fieldbus.sim.hand import Hand, hand_named

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.numerics.estimators import Estimator
    from haptic_fieldbus.numerics.integrators import Integrator
    from haptic_fieldbus.running.changes import Changes, Scheduled
    from haptic_fieldbus.running.leading import Leading
    from haptic_fieldbus.running.live import Live
    from haptic_fieldbus.running.session import Session, Site


DRAWING = "haptic_fieldbus.report.plot:draw_run"
"""Function that draws a result, as a text: the room stands above this one, and a run does without it."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The conditions of a run."""

    duration: float = DEFAULT_DURATION
    """Time from *operation enabled* on [s]."""
    hand: str | None = None
    """Simulated hand: push, tap, sine, guide, shake, release, none, or a `Hand` of your own; None: the hand of the
    scene, otherwise push."""
    fade_in: float = DEFAULT_FADE_IN
    """Time from *operation enabled* to the full limit of the force [s]."""
    seed: int = DEFAULT_SEED
    """Seed of all random numbers of the simulation."""
    faults: str | Path | Sequence[Fault] | None = None
    """Faults of the simulated bench (`haptic_fieldbus.sim.faults`), the file that lists them, or `random@SEED`."""
    record: str | Path | None = None
    """File for the record; the suffix selects the format: frames (.log, .blf) or one row per period (.csv, .mcap)."""
    force: bool = False
    """Run even if the scene is above its limit or its bench is unknown, on a real bus with at most 5 % of rated
    torque."""
    changes: "Changes | Sequence[Scheduled] | None" = None
    """New settings for the running scene at seconds from *operation enabled*."""
    prove: bool = False
    """Test the drive watchdogs at zero torque before the run, even if they are simulated or were proved before."""
    confirm: Callable[[str], bool] | None = None
    """Called with a question before a real drive is enabled; the run goes on when it returns True."""
    instruct: Callable[[str], None] | None = None
    """Called with an instruction for the person at the handle before a real drive is enabled; None: no person is
    present."""
    progress: Callable[[int, int], None] | bool | None = None
    """Called with the number of finished periods and the number of all periods; True: one line on standard error, in a
    terminal or a notebook, unless the drive is real."""
    announce: Callable[[Plan], None] | None = None
    """Called with the plan before any bus is opened."""
    anonymous: bool = False
    """Leave host, user and paths out of the provenance."""
    live: "Live | None" = None
    """View of the run while it goes on; in virtual time, the run then follows real time."""


def plan(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    rate: float | None = None,
    settings: Mapping[str, Setting] | None = None,
    method: "str | Integrator | None" = None,
    estimator: "str | Estimator | None" = None,
    drive: str | None = None,
    bus: str | None = None,
    node: int = DEFAULT_NODE,
    axes: Mapping[str, str] | None = None,
    zero: str | None = None,
    profiles: str | Path | None = None,
) -> Plan:
    """Compile a scene and return the plan: the signals mapped and left out, and the steps of each period.

    `scene` is a name of the library, a file or a Scene; `rig` is a file or a Rig, or None for the shipped bench; `rate`
    is in Hz. Raises DocumentError, UsageError or PlanError.
    """
    return plan_task(asked_of("plan", locals(), Task))


def stability(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    rate: float | None = None,
    settings: Mapping[str, Setting] | None = None,
    method: "str | Integrator | None" = None,
    estimator: "str | Estimator | None" = None,
    drive: str | None = None,
    bus: str | None = None,
    node: int = DEFAULT_NODE,
    axes: Mapping[str, str] | None = None,
    zero: str | None = None,
    profiles: str | Path | None = None,
    mass: float | None = None,
    damping: float | None = None,
    coulomb: float | None = None,
    resolution: float | None = None,
    delay: float | None = None,
) -> Stability:
    """Return the limits of a scene on its bench, for the axis with the smallest margin. The bench is selected as for
    `plan`.

    If mass [kg], damping [N·s/m], Coulomb friction [N], resolution (one encoder count) [m] or delay [s] (or a rotary
    counterpart) is given, a device with exactly these values and ideal torque replaces the bench. The mass is then
    required; omitted values are 0. Raises the same errors as `plan`.
    """
    return judge_scene(*asked_of("stability", locals(), Task, Device)).stability


def run(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    rate: float | None = None,
    settings: Mapping[str, Setting] | None = None,
    method: "str | Integrator | None" = None,
    estimator: "str | Estimator | None" = None,
    drive: str | None = None,
    bus: str | None = None,
    node: int = DEFAULT_NODE,
    axes: Mapping[str, str] | None = None,
    zero: str | None = None,
    profiles: str | Path | None = None,
    duration: float = DEFAULT_DURATION,
    hand: str | Hand | None = None,
    fade_in: float = DEFAULT_FADE_IN,
    seed: int = DEFAULT_SEED,
    faults: str | Path | Sequence[Fault] | None = None,
    record: str | Path | None = None,
    force: bool = False,
    changes: "Changes | Sequence[Scheduled] | None" = None,
    prove: bool = False,
    confirm: Callable[[str], bool] | None = None,
    instruct: Callable[[str], None] | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    announce: Callable[[Plan], None] | None = None,
    anonymous: bool = False,
    live: "Live | None" = None,
) -> Result:
    """Render `scene` for `duration` [s] from *operation enabled*, at `rate` [Hz], and return the result.

    The bench is selected as for `plan`. On simulated buses `hand` (default: the hand of the scene), `seed` and `faults`
    set the conditions. On a real bus nothing moves unless `confirm` returns True. `changes` are new settings for the
    running scene at seconds from *operation enabled*, [(2.0, {"wall.stiffness": 800.0})], or a `Changes` that other
    threads use. `live` shows the run while it goes on. Raises the same errors as `plan`, UnstableSceneError (unless
    `force`), BusError, DriveFaultError and SafetyTripError. Torque is zero before any of them is raised; their `result`
    holds the results known at the error. Ctrl-C, SIGTERM and SIGHUP end a run early and are no errors: `stopped` of the
    result names the signal.
    """
    return run_task(*asked_of("run", locals(), Task, Trial))


@own_faults()
def run_task(task: Task, trial: Trial, repeats: Provenance | None = None) -> Result:
    """Render a task under the conditions of a trial and return the result, as `run` does.

    `repeats` is the provenance of the run that the task repeats; its texts come from there.
    """
    session, place = prepare_run(task, trial, repeats)
    session.looks_back = repeats is None and isinstance(task.rig, str | Path)
    return session.render(place)


def prepare_run(
    task: Task, trial: Trial, repeats: Provenance | None = None, share: float = math.inf, *, beyond: bool = False
) -> "tuple[Session, AbstractContextManager[Site]]":
    """Check a task and its trial, and return the run and its place, of which nothing is opened yet.

    The effort of each axis is at most `share` of its rated effort. With `beyond`, which `certify` alone uses, the scene
    may be above its limit, and the share is at most `BEYOND_SHARE`.
    """
    share = min(share, BEYOND_SHARE) if beyond else share
    recording = Path(trial.record) if trial.record is not None else None
    hand = hand_named(DEFAULT_HAND if trial.hand is None else trial.hand)
    bus = task.bus or DEFAULT_BUS
    name = check_request(
        bus=bus, node=task.node, rate=task.rate, duration=trial.duration, seed=trial.seed, record=recording
    )
    check_fade_in(trial.fade_in)
    try:
        selection = _selected(task, trial)
        if trial.force and not selection.bus.simulated and any(above_limit(selection.plan)):
            selection = replace(selection, forced=True)
        plan = _capped(selection.plan.fading_in(trial.fade_in), share)
    except (PlanError, KeyboardInterrupt) as error:
        # No plan exists yet, so the result holds the request alone.
        drive, rate = task.drive or protocol_named(name.section.protocol).default_drive, task.rate or math.nan
        vars(error)["result"] = Result(scene=str(task.scene), drive=drive, bus=bus, rate=rate)
        raise
    given = [name for name in ("hand", "faults") if (value := getattr(trial, name)) and value != "none"]
    if given and not plan.simulated:
        raise UsageError(
            f"{' and '.join(given)}: only for a simulated bench, and {selection.bus.text} is a real bus; give it to "
            "`haptic-fieldbus simulate`, or add --bus sim"
        )
    try:
        changes = _checked(plan, trial, beyond=beyond)
    except PlanError as refused:
        refused.result = known_before(plan, selection.bus.text)
        raise
    if trial.announce is not None:
        trial.announce(plan)
    if trial.hand is None:
        hand = hand_named(plan.scene.hand or DEFAULT_HAND)
    faults = faults_for(trial.faults, trial.duration, plan)
    from haptic_fieldbus.api.provenance import provenance_of
    from haptic_fieldbus.api.site import site_of
    from haptic_fieldbus.running.session import Session

    held = "none" if hand is None else name_of(hand) if isinstance(trial.hand, OwnName) else hand.name
    on_bus = repeats.bus if repeats and repeats.simulated else selection.bus.text
    provenance = provenance_of(
        plan, task, _conditions(plan, task, trial, changes, held), faults, on_bus,
        anonymous=trial.anonymous, repeats=repeats,
    )  # fmt: skip
    session = Session(
        plan, on_bus, trial.duration, record=recording, changes=changes, prove=trial.prove,
        confirm=trial.confirm, instruct=trial.instruct, progress=_shown(trial.progress, plan),
        provenance=provenance, drawing=DRAWING, live=trial.live, led=_led(plan, trial, held, repeats),
    )  # fmt: skip
    return session, site_of(plan, recording, hand, trial.seed, faults, None if trial.live is None else trial.live.time)


def _led(
    plan: Plan, trial: Trial, hand: str, repeats: Provenance | None
) -> "Callable[[Mapping[str, Any]], Leading] | None":
    """Return what leads the handles of a simulation by the commands of a page or of a record; None: nobody leads."""
    recorded = (repeats.conditions.led if repeats else None) or ()
    if not plan.simulated or (trial.live is None and not recorded):
        return None
    from haptic_fieldbus.running.leading import Leading
    from haptic_fieldbus.sim.mechanics.pointer import PointedHandle

    def leading(worlds: Mapping[str, Any]) -> Leading:
        axes = [axis for axis in plan.axes if axis.rig.bus in worlds]
        bodies = {axis.name: worlds[axis.rig.bus].body(axis.node) for axis in axes}
        handles = {axis.name: PointedHandle(bodies[axis.name], axis.rig.mechanism) for axis in axes}
        return Leading(handles, recorded, hand)

    return leading


def _capped(plan: Plan, share: float) -> Plan:
    """Return the plan with efforts of at most this share of the rated ones."""
    if share == math.inf:
        return plan
    axes = [
        replace(axis, limits=axis.limits.lowered(share * axis.rated_effort, axis.effort_unit)) for axis in plan.axes
    ]
    return replace(plan, axes=with_energy_limits(axes, plan.scene.couplings))


def _conditions(plan: Plan, task: Task, trial: Trial, changes: "Changes | None", hand: str) -> Conditions:
    """Return the conditions of a run as its provenance has them."""
    scheduled = () if changes is None else changes.scheduled
    return Conditions(
        rate=plan.rate, duration=float(trial.duration), hand=hand, fade_in=float(trial.fade_in), seed=int(trial.seed),
        force=trial.force, prove=trial.prove, method=task.method, estimator=task.estimator,
        changes=tuple((float(time), parsed(settings)) for time, settings in scheduled),
        ramp=None if changes is None else changes.ramp,
        in_place_of_real=tuple(name for name, section in plan.rig.bus.items() if section.stands_for_real),
    )  # fmt: skip


def _shown(progress: Callable[[int, int], None] | bool | None, plan: Plan) -> Callable[[int, int], None] | None:
    """Return the function that is told of progress; True is a line on standard error, which a real drive waits for."""
    if not isinstance(progress, bool):
        return progress
    return progress_line() if progress and plan.simulated else None


def progress_line() -> Callable[[int, int], None]:
    """Return a function that writes the share that is done, and the time left, in one line on standard error."""
    began, first = monotonic(), list[int]()

    def show(done: int, total: int) -> None:
        first[:] = first or [done]
        left = (monotonic() - began) * (total - done) / max(done - first[0], 1)
        sys.stderr.write(f"\r{done / total:4.0%}, {left:.0f} s left {chr(10) if done >= total else ''}")
        sys.stderr.flush()

    return show


def repeat(
    source: str | Path | Provenance,
    *,
    record: str | Path | None = None,
    hand: str | Hand | None = None,
    method: "str | Integrator | None" = None,
    estimator: "str | Estimator | None" = None,
) -> Result:
    """Repeat the run of a recording, a picture or a JSON object in simulation, and return the result.

    The frames and rows are those of the recorded run when the versions are the same; the warnings of the result name
    those that differ. A hand, method or estimator that was an object of Python is given again, as a recording has its
    name alone. Raises UsageError when the source has no provenance, and the errors of `run`.
    """
    from haptic_fieldbus.recordings.reading import check_apart, read_provenance

    found = source if isinstance(source, Provenance) else read_provenance(source)
    if not isinstance(source, Provenance):
        check_apart(source, record)
    given = {"hand": hand, "method": method, "estimator": estimator}
    parts = {name: name_of(part) for name, part in given.items() if part is not None}
    return repeat_run(replace(found, conditions=replace(found.conditions, **parts)), Trial(record=record))


def repeat_run(provenance: Provenance, trial: Trial) -> Result:
    """Repeat a recorded run; of the trial, what does not act on frames and rows is taken."""
    from haptic_fieldbus.api.provenance import differences_of, repeated

    with repeated(provenance) as (task, conditions):
        result = run_task(task, replace(trial, **conditions), provenance)
    return replace(result, warnings=(*differences_of(provenance), *result.warnings))


def faults_for(source: str | Path | Iterable[Fault] | None, duration: float, plan: Plan) -> tuple[Fault, ...]:
    """Return the faults of a run; those of a seed fall between enabling and the end, and are such as its buses have.

    Raises FaultFileError or UsageError.
    """
    if not isinstance(source, str | Path):
        return checked_faults(source or ())
    from haptic_fieldbus.sim.faults.drawing import drawn, seed_of

    seed = seed_of(str(source))
    if seed is None:
        return load_faults(source)
    from haptic_fieldbus.api.site import kinds_on

    return drawn(seed, duration, kinds_on(plan))


def _selected(task: Task, trial: Trial) -> Selection:
    """Return the selection; with `force` the bench may be unknown, and real drives give their rated torque.

    A real drive with a profile of no particular drive is asked for what it has.
    """
    found = load(task) if trial.force else select(task)
    # With `prove` no earlier outcome counts, for a guard or against it.
    rig = found.rig.unproved() if trial.prove else found.rig
    profiles = found.profiles
    if not found.bus.simulated:
        from haptic_fieldbus.api.site import ask_rated_torques, fit_profiles

        rig, profiles = fit_profiles(ask_rated_torques(rig) if trial.force else rig)
    return replace(found, rig=rig, profiles=profiles)


def _checked(plan: Plan, trial: Trial, *, beyond: bool) -> "Changes | None":
    """Refuse an unstable loop unless it may be `beyond`; return the checked changes, None when there are none."""
    if not (trial.force or beyond):
        check_stable(plan)
    if not trial.changes and trial.live is None:
        # Nothing more is imported for a run in which nothing changes.
        return None
    from haptic_fieldbus.running.changes import Changes

    wanted = trial.changes if isinstance(trial.changes, Changes) else Changes(trial.changes or ())
    wanted.check(plan, trial.duration, force=trial.force)
    if trial.live is not None:
        trial.live.changes = wanted
    return wanted
