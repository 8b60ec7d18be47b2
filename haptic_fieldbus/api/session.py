"""A session: `run` cut open, with the caller between two periods.

The drives are opened, asked, proved, enabled and stopped as by `run`, and only inside the `with` block. However the
block is left, torque is zero before the next statement. In virtual time the caller may stop between two periods for as
long as it likes. On a real bus it has the rest of the period; a caller that takes longer makes the loop late, and a
late loop skips periods and trips as any other. The error and the warnings of the result say how long it took.
"""

import math
import os
import pickle
import sys
from collections import namedtuple
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from threading import current_thread, get_native_id
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self
from weakref import finalize

from haptic_fieldbus.api import Trial, prepare_run
from haptic_fieldbus.api.arguments import KINDS, asked_of, check_values
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.defaults import DEFAULT_FADE_IN, DEFAULT_NODE, DEFAULT_SEED
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.drive.rig import LinearMechanism, Rig
from haptic_fieldbus.errors import UnstableSceneError, UsageError, wrong_kind
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.limits import HOLDING_SHARE
from haptic_fieldbus.planning.live_changes import Change
from haptic_fieldbus.planning.request import LONGEST, Task
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.running.changes import Changes, Scheduled
from haptic_fieldbus.running.loop import Caller, Steps, finished
from haptic_fieldbus.running.session import Session
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.element import Law
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.registry import FIXED
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Signal, Workspace
from haptic_fieldbus.sim.faults import Fault

if TYPE_CHECKING:
    from haptic_fieldbus.numerics.estimators import Estimator
    from haptic_fieldbus.numerics.integrators import Integrator
    from haptic_fieldbus.running.rights import WorkAside
    from haptic_fieldbus.sim.hand import Hand

# A force of the caller in the place of a scene.

EFFORT = "effort"
"""Name of the scene and of its element."""
SIGNALS = {
    "position": (Signal.POSITION, 1.0),
    "velocity": (Signal.VELOCITY, 1.0),
    "torque": (Signal.TORQUE_ACTUAL, 1.0),
    "time": (Signal.ELAPSED_NS, 1e-9),
}
"""Names under which a function gets the signals, and the factor to SI."""
EffortLaw = Callable[[Any], float | None]
"""Feedback with the needed names as attributes → force [N] or torque [N·m] on the handle; None is no force."""


@dataclass(frozen=True)
class OwnEffort:
    """A function of the caller as an element of a scene; it is judged by the stiffness and damping that it declares."""

    axis: str
    law: EffortLaw = field(metadata={FIXED: True})
    names: tuple[str, ...] = field(metadata={FIXED: True})
    stiffness: float = 0.0
    damping: float = 0.0
    name: str = EFFORT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return tuple(SIGNALS[name][0] for name in self.names)

    def begin(self, period: float) -> Law:
        """Return the function of the signals; what it remembers is its own."""
        own = self.law
        feedback: Any = namedtuple("Feedback", self.names)  # type: ignore[misc]
        factors = [SIGNALS[name][1] for name in self.names]

        def law(*values: float) -> float:
            force = own(feedback(*[value * factor for value, factor in zip(values, factors, strict=True)]))
            return 0.0 if force is None else float(force)

        return law

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, -self.damping]])

    def __deepcopy__(self, memo: object) -> "OwnEffort":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Send the function along with a result; another one where it cannot be sent, such as a lambda."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        try:
            pickle.dumps(self.law)
        except Exception:  # a foreign object may raise anything
            values["law"] = _not_sent
        return OwnEffort, tuple(values.values())


def _not_sent(feedback: Any) -> float:
    raise UsageError("the function of this effort stayed in its process: it is no function of a module")


def effort_scene(
    effort: EffortLaw, needs: Sequence[str], rig: str | Path | Rig | None, profiles: str | Path | None,
    stiffness: float | None, damping: float | None,
) -> Scene:  # fmt: skip
    """Return the scene of one axis whose force is a function; raises TypeError or UsageError."""
    known = isinstance(needs, Collection) and all(each in [*SIGNALS] for each in needs)
    if not known or not needs or len({*needs}) < len(needs):
        raise wrong_kind("session() needs", f"some of {', '.join(SIGNALS)}, each once", needs)
    is_number = KINDS["damping"][1]
    for name, value in (("stiffness", stiffness), ("damping", damping)):
        if value is not None and not (is_number(value) and 0.0 <= value < math.inf):
            raise wrong_kind(f"session() {name}", "a number of 0 or more", value)
    found = load_rig(rig, profiles) if isinstance(rig, str | Path) else rig
    axis, *others = ["handle"] if found is None else found.axis
    if others:
        raise UsageError(f"effort= renders one axis; the rig has {', '.join((axis, *others))}")
    linear = found is None or isinstance(found.axis[axis].mechanism, LinearMechanism)
    element = OwnEffort(axis, effort, tuple(needs), stiffness or 0.0, damping or 0.0)
    space = SceneAxis(axis, Workspace.LINEAR if linear else Workspace.ROTARY)
    return Scene(EFFORT, "A function of the caller", (space,), (element,))


# What the caller sees of a period.


class AxisView(NamedTuple):
    """One axis in one period, in its workspace [m or rad, N or N·m]."""

    position: float
    velocity: float | None
    """Velocity as the scene gets it [m/s or rad/s]; None where the scene needs none."""
    effort: float
    """Effort that the scene asked for."""
    given: float
    """Effort that was sent to the drive, after limits, fading and rounding."""
    drive: PowerState
    """Power state of the drive."""


class SessionState(NamedTuple):
    """One period of a session, after its set-points were sent. `position` and the like are those of the only axis."""

    time: float
    """Time from *operation enabled* to the feedback of this period [s]."""
    lateness: float
    """Time by which the period began late [s]; 0 in virtual time."""
    axes: Mapping[str, AxisView]

    @property
    def axis(self) -> AxisView:
        """The only axis; raises UsageError where there are several."""
        only, *others = self.axes.values()
        if others:
            raise UsageError(f"the session has several axes; name one, as in state.axes[{min(self.axes)!r}]")
        return only

    @property
    def position(self) -> float:
        return self.axis.position

    @property
    def velocity(self) -> float | None:
        return self.axis.velocity

    @property
    def effort(self) -> float:
        return self.axis.effort

    @property
    def given(self) -> float:
        return self.axis.given

    @property
    def drive(self) -> PowerState:
        return self.axis.drive


def _viewer(run: Session, caller: Caller) -> Callable[[], SessionState]:
    """Return a function that looks at the present period; raises StopIteration for a run that never enabled."""
    cycle, report, new = run.cycle, run.report, tuple.__new__  # which is quicker than the class itself
    if cycle is None or report.enabled_at_ns is None:
        raise StopIteration
    begin = report.enabled_at_ns
    sights = [
        (axis.name, at.state, at.sensed if Signal.VELOCITY in axis.needs else None, axis.effort_unit)
        for axis, at in zip(run.plan.axes, cycle.axes.values(), strict=True)
    ]

    def look() -> SessionState:
        axes = {}
        for name, state, sensed, unit in sights:
            speed = None if sensed is None else sensed.velocity
            axes[name] = new(AxisView, (state.position, speed, state.force, state.target * unit, state.power))
        return new(SessionState, ((cycle.t_ns - begin) * 1e-9, caller.late_ns * 1e-9, axes))

    return look


def _leave(steps: Steps[Result], process: int) -> None:
    """End a run whose session nobody has left, torque-free, at the latest while the interpreter can still end it."""
    if os.getpid() == process:  # a fork must not end the run of its parent
        with suppress(ValueError):  # another thread is in the run
            steps.close()


class LiveSession:
    """A run that the caller steps through: `with session(...) as live: for state in live: ...`.

    `result` is the result once the block is left, as `run` returns it; it stays None when the run failed.
    """

    def __init__(self, task: Task, trial: Trial, share: float = math.inf) -> None:
        self._task, self._share = task, share
        self._changes = trial.changes if isinstance(trial.changes, Changes) else Changes(trial.changes or ())
        self._trial = replace(trial, changes=self._changes)
        self._caller = Caller(LiveSession.__exit__.__code__)
        self._run: Session | None = None
        self._thread = 0
        """System number of the thread that entered the block, which no fork has: signals and rights of the run are its
        own."""
        self._steps: Steps[Result] | None = None
        self._judged: list[Future[Change]] = []
        self._judging: ThreadPoolExecutor | None = None
        """The thread that judges changes; None: that of the caller does."""
        self._aside: WorkAside | None = None
        self._look: Callable[[], SessionState] | None = None
        self.result: Result | None = None

    @own_faults()
    def __enter__(self) -> Self:
        """Check all that is asked for, open the buses, inspect the drives and ask; nothing is written to a drive yet.

        Raises what `run` raises.
        """
        if self._run is not None:
            raise UsageError("this session has been used; make a new one")
        self._thread = get_native_id()
        try:
            self._run, place = prepare_run(self._task, self._trial, share=self._share)
        except UnstableSceneError as error:
            if isinstance(self._task.scene, Scene) and isinstance(self._task.scene.elements[0], OwnEffort):
                error.args = (str(error).replace(f"--set {EFFORT}.", ""),)  # it has arguments, no parameters
            raise
        self._steps = self._run.steps(place, self._caller)
        finalize(self, _leave, self._steps, os.getpid())
        if self._run.plan.simulated:
            self._advance()
            return self
        # The thread that judges begins before the loop takes one processor, and has rights below those of the loop.
        from haptic_fieldbus.running.rights import WorkAside, make_as_urgent

        self._aside, self._judging = WorkAside(), ThreadPoolExecutor(1, "haptic-fieldbus-judging")
        thread = self._judging.submit(current_thread).result()
        self._advance()
        make_as_urgent([thread])
        return self

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> SessionState:
        """Go on to the end of the next period in operation enabled, and return its state.

        The first call proves the drive watchdogs that are due, configures the drives and enables them. Raises what
        `run` raises; torque is zero then.
        """
        if self._run is None:
            raise UsageError("a session is stepped inside its block: with session(...) as live")
        while self._judged and self._judged[0].done():
            self._judged.pop(0).result()
        if self._steps is None or self._caller.stopping or not self._advance():
            raise StopIteration
        if self._look is None:
            self._look = _viewer(self._run, self._caller)
        return self._look()

    def _advance(self) -> bool:
        """Go on to the next pause; return whether there was one. The run is over otherwise, and when it raises."""
        if get_native_id() != self._thread:  # nor by a process that was forked from it
            raise UsageError("a session is stepped by the thread that entered its block")
        try:
            next(self._steps)  # type: ignore[arg-type]
        except StopIteration as end:
            self._steps, self.result = None, end.value
            return False
        return True

    def set(self, name: str, value: Setting) -> "Future[Change]":
        """Change a parameter of the running scene, such as `set("wall.stiffness", 800.0)`, as `Changes.request` does.

        In virtual time the change is judged at once, and refused by what `Changes.request` raises. On a real bus
        another thread judges it, since that takes longer than a period: what it raises is raised by the next period.
        """
        if not isinstance(name, str):
            raise wrong_kind("set() name", "a name such as wall.stiffness", name)
        if self._run is None or self._steps is None:
            raise UsageError("a session is changed inside its block, while it runs")
        if self._judging is None or self._aside is None:
            done: Future[Change] = Future()
            done.set_result(self._changes.request({name: value}))
            return done
        self._judged.append(self._judging.submit(self._aside.do, partial(self._changes.request, {name: value})))
        return self._judged[-1]

    def stop(self) -> None:
        """End the session after the present period: torque is zero when the block is left."""
        self._caller.stopping = True

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> bool:
        """End the run as `run` does, torque-free, and keep its result; Ctrl-C is no error, as in `run`."""
        self.stop()
        if self._judging is not None:
            self._judging.shutdown(wait=False, cancel_futures=True)
        steps = self._steps
        if steps is None:
            return False
        try:
            if isinstance(error, StopIteration):  # no generator passes one on
                return False
            if error is None or isinstance(error, GeneratorExit):
                self.result = finished(steps)
                return False
            steps.throw(error)
        except StopIteration as end:  # a signal, after which the run has a result
            self.result = end.value
        except BaseException as raised:
            if raised is not error:
                raise
        finally:
            self._steps = None
            steps.close()  # another signal came meanwhile
        return isinstance(error, KeyboardInterrupt) and self.result is not None


def session(
    scene: str | Path | Scene | None = None,
    rig: str | Path | Rig | None = None,
    *,
    effort: EffortLaw | None = None,
    needs: Sequence[str] = ("position",),
    stiffness: float | None = None,
    damping: float | None = None,
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
    duration: float = LONGEST,
    hand: "str | Hand | None" = None,
    fade_in: float = DEFAULT_FADE_IN,
    seed: int = DEFAULT_SEED,
    faults: str | Path | Sequence[Fault] | None = None,
    record: str | Path | None = None,
    force: bool = False,
    changes: Changes | Sequence[Scheduled] | None = None,
    prove: bool = False,
    yes: bool = False,
    confirm: Callable[[str], bool] | None = None,
    instruct: Callable[[str], None] | None = None,
    anonymous: bool = False,
) -> LiveSession:
    """Return a session over a scene, or over a function of your own: `with session("wall") as live: for state in live`.

    The arguments are those of `run`; without a duration it goes on until the block is left. `yes=True` enables a real
    drive without a question. `effort` takes the place of the scene: a function of the feedback, whose attributes are
    those of `needs` (position, velocity, torque, time), that returns the force [N] or torque [N·m] on the handle, or
    None for none. It is judged by the `stiffness` [N/m or N·m/rad] and `damping` that it declares; one that declares
    neither gets at most 5 % of the rated torque. All limits and trips of a run apply to it.
    """
    if (scene is None) == (effort is None):
        raise UsageError("session() takes either a scene or effort=")
    if scene is not None and (stiffness is not None or damping is not None or needs != ("position",)):
        raise UsageError("session() stiffness, damping, needs: only with effort=; use settings= for those of a scene")
    given = {"yes": yes, "effort": effort, "rig": rig}
    check_values("session", ((name, value) for name, value in given.items() if value is not None))
    share = math.inf
    if effort is not None:
        scene = effort_scene(effort, needs, rig, profiles, stiffness, damping)
        share = HOLDING_SHARE if stiffness is None and damping is None else math.inf
    confirm = confirm or (_told if yes else None)
    task, trial = asked_of("session", locals(), Task, Trial)
    return LiveSession(task, trial, share)


def _told(question: str) -> bool:
    """Print the question that `yes=True` answers, since it says what is about to happen."""
    print(question, file=sys.stderr)
    return True
