"""The Python API: `plan`, `stability`, `response`, `run`; and the sites of a run.

`plan` compiles and explains, `stability` judges, `response` simulates without a drive, `run` renders on one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_fieldbus.api.arguments import arguments_of
from haptic_fieldbus.api.judging import Inquiry, judge_scene
from haptic_fieldbus.api.open_loop import response as response
from haptic_fieldbus.assessing.result import Result, known_before
from haptic_fieldbus.defaults import DEFAULT_BUS, DEFAULT_DURATION, DEFAULT_HAND, DEFAULT_SEED
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.planning.request import check_request
from haptic_fieldbus.planning.selection import Selection, check_known, compiled, load, select
from haptic_fieldbus.planning.task import Task
from haptic_fieldbus.sim.faults import Fault, load_faults
from haptic_fieldbus.sim.hand import hand_named

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.running.changes import Changes, Scheduled


@dataclass(frozen=True, kw_only=True)
class Trial(Task):
    """A task to run, and what happens meanwhile."""

    duration: float = DEFAULT_DURATION
    """From *operation enabled* on [s]."""
    hand: str | None = None
    """What the simulated hand does: push, tap, sine, guide, release or none; None is that of the scene, or push."""
    seed: int = DEFAULT_SEED
    """Of all that is random in the simulation."""
    faults: str | Path | Sequence[Fault] = ()
    """Of the simulated drives and links (`haptic_fieldbus.sim.faults`), or the file that lists them."""
    record: str | Path | None = None
    """File for frames or rows, by its suffix."""
    force: bool = False
    """Go on although the loop would be unstable, or its bench is unknown."""
    changes: "Changes | Sequence[Scheduled]" = ()
    """New settings for the running scene at seconds from *operation enabled*."""
    confirm: Callable[[str], bool] | None = None
    """Asked before a real drive is enabled."""
    progress: Callable[[int, int], None] | None = None
    """Told how many periods of how many are done."""
    announce: Callable[[Plan], None] | None = None
    """Told the plan before anything is opened."""


@arguments_of(Task)
def plan(task: Task) -> Plan:
    """Compile only: what would be mapped, left out and run each period; `rate` in Hz.

    `scene` is a name of the library, a file or a Scene; `rig` a file or a Rig, else the shipped bench. Raises
    DocumentError, UsageError or PlanError.
    """
    check_request(bus=task.bus or DEFAULT_BUS, node=task.node, rate=task.rate)
    return select(task).plan


@arguments_of(Inquiry)
def stability(inquiry: Inquiry) -> Stability:
    """The limits of a scene before anything moves, of the axis with the smallest margin; selection as for `plan`.

    Any of mass [kg], damping [N·s/m], Coulomb friction [N], resolution (one encoder count) [m] and delay [s], or their
    rotary counterparts, replaces the bench: the device is exactly these, the others are 0, and torque is ideal. Raises
    what `plan` raises.
    """
    return judge_scene(inquiry).stability


@arguments_of(Trial)
def run(trial: Trial) -> Result:
    """Render `scene` for `duration` [s] from *operation enabled*, at `rate` [Hz]; selection as for `plan`.

    On the simulated bus `hand` (that of the scene unless given), `seed` and `faults` say what happens; on a real one
    nothing moves unless `confirm` answers True. `changes` are new settings for the running scene at seconds from
    *operation enabled*, [(2.0, {"wall.stiffness": 800.0})], or `Changes`, which other threads can ask. Raises what
    `plan` raises, UnstableSceneError (unless `force`), BusError, DriveFaultError and
    SafetyTripError; torque is zero before any of them is raised, and their `result` is what was known by then.
    """
    recording = Path(trial.record) if trial.record is not None else None
    hand = hand_named(DEFAULT_HAND if trial.hand is None else trial.hand)
    faults = load_faults(trial.faults) if isinstance(trial.faults, str | Path) else tuple(trial.faults)
    bus = trial.bus or DEFAULT_BUS
    check_request(bus=bus, node=trial.node, rate=trial.rate, duration=trial.duration, seed=trial.seed, record=recording)
    try:
        selection = _selected(trial)
    except PlanError as error:
        error.result = Result(scene=str(trial.scene), drive=trial.drive, bus=bus, rate=trial.rate)
        raise
    changes = _checked(selection, trial)
    if trial.announce is not None:
        trial.announce(selection.plan)
    if trial.hand is None:
        hand = hand_named(selection.plan.scene.hand or DEFAULT_HAND)
    from haptic_fieldbus.api.sites import Conditions, site_of
    from haptic_fieldbus.running.session import Request, render

    return render(
        Request(selection, trial.duration, recording, trial.confirm, trial.progress, changes),
        site_of(selection.plan, recording, Conditions(hand, trial.seed, faults)),
    )


def _selected(trial: Trial) -> Selection:
    """With `force` a bench may be unknown; a real drive then says its own rated torque, before it is configured."""
    loaded = load(trial)
    if not trial.force:
        check_known(loaded)
    elif not loaded.bus.simulated:
        from haptic_fieldbus.api.sites import ask_rated_torques

        loaded = replace(loaded, rig=ask_rated_torques(loaded.rig))
    return compiled(loaded)


def _checked(selection: Selection, trial: Trial) -> "Changes | None":
    """Refuse an unstable loop, then check the changes at a time; None, and nothing imported, where there are none."""
    try:
        if not trial.force:
            check_stable(selection.plan)
        if isinstance(trial.changes, Sequence) and not trial.changes:
            return None
        from haptic_fieldbus.running.changes import Changes

        wanted = trial.changes if isinstance(trial.changes, Changes) else Changes(trial.changes)
        wanted.check(selection.plan, trial.duration, force=trial.force)
        return wanted
    except PlanError as refused:
        refused.result = known_before(selection)
        raise
