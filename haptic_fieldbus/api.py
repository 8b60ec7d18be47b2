"""The Python API: `plan` compiles and explains, `stability` judges, `response` simulates, `run` renders on a drive."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from haptic_fieldbus.axis_plan import AxisPlan, environment_of, stiffest_of
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import PlanError, UnstableSceneError
from haptic_fieldbus.judging import device_of, judge_scene
from haptic_fieldbus.margins import Stability, Verdict, suggest
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.open_loop import response as response
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.request import BusName, check_request
from haptic_fieldbus.result import Result, known_before
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.selection import DEFAULT_DRIVE, DEFAULT_RATE, Selection, Value, refuse_unknown, select
from haptic_fieldbus.sim.fault_file import load_faults
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.hand import hand_named

DEFAULT_DURATION = 10.0
DEFAULT_HAND = "push"


def plan(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    drive: str = DEFAULT_DRIVE,
    bus: str | None = None,
    node: int = 1,
    rate: float = DEFAULT_RATE,
    settings: Mapping[str, Value] | None = None,
    method: str | None = None,
    estimator: str | None = None,
) -> Plan:
    """Compile only: what would be mapped, left out and run each period; `rate` in Hz.

    `scene` is a name of the library, a file or a Scene; `rig` a file or a Rig, else the shipped bench. Raises
    DocumentError, UsageError or PlanError.
    """
    check_request(bus=bus or "sim", node=node, rate=rate)
    return select(
        scene,
        rig,
        drive=drive,
        bus=bus,
        node=node,
        rate=rate,
        settings=settings or {},
        method=method,
        estimator=estimator,
        complete=refuse_unknown,
    ).plan


def stability(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    drive: str = DEFAULT_DRIVE,
    bus: str | None = None,
    node: int = 1,
    rate: float = DEFAULT_RATE,
    settings: Mapping[str, Value] | None = None,
    method: str | None = None,
    estimator: str | None = None,
    mass: float | None = None,
    damping: float | None = None,
    coulomb: float | None = None,
    resolution: float | None = None,
    delay: float | None = None,
) -> Stability:
    """The limits of a scene before anything moves, of the axis with the smallest margin; selection as for `plan`.

    Any of mass [kg], damping [N·s/m], Coulomb friction [N], resolution (one encoder count) [m] and delay [s], or their
    rotary counterparts, replaces the bench: the device is exactly these, the others are 0, and torque is ideal. Raises
    what `plan` raises.
    """
    return judge_scene(
        scene,
        rig,
        drive=drive,
        bus=bus,
        node=node,
        rate=rate,
        settings=settings,
        method=method,
        estimator=estimator,
        device=device_of(mass=mass, damping=damping, coulomb=coulomb, resolution=resolution, delay=delay),
    ).stability


def _ask_the_drive(rig: Rig, bus: BusName) -> Rig:
    """Without a rig file the drive itself says its rated torque; read only, before anything is configured."""
    from haptic_fieldbus.session import read_rated_torques

    return rig if bus.simulated else read_rated_torques(rig)


def run(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    drive: str = DEFAULT_DRIVE,
    bus: str | None = None,
    node: int = 1,
    rate: float = DEFAULT_RATE,
    duration: float = DEFAULT_DURATION,
    hand: str = DEFAULT_HAND,
    settings: Mapping[str, Value] | None = None,
    method: str | None = None,
    estimator: str | None = None,
    seed: int = 0,
    faults: str | Path | Sequence[Fault] = (),
    record: str | Path | None = None,
    force: bool = False,
    confirm: Callable[[str], bool] | None = None,
    progress: Callable[[int, int], None] | None = None,
    announce: Callable[[Plan], None] | None = None,
) -> Result:
    """Render `scene` for `duration` [s] from *operation enabled*, at `rate` [Hz]; selection as for `plan`.

    On the simulated bus `hand`, `seed` and `faults` say what happens; on a real one nothing moves unless `confirm`
    answers True. Raises what `plan` raises, UnstableSceneError (unless `force`), BusError, DriveFaultError and
    SafetyTripError; torque is zero before any of them is raised, and their `result` is what was known by then.
    """
    recording = Path(record) if record is not None else None
    simulated_hand = hand_named(hand)
    known_faults = load_faults(faults) if isinstance(faults, str | Path) else tuple(faults)
    check_request(bus=bus or "sim", node=node, rate=rate, duration=duration, seed=seed, record=recording)
    try:
        selection = select(
            scene,
            rig,
            drive=drive,
            bus=bus,
            node=node,
            rate=rate,
            settings=settings or {},
            method=method,
            estimator=estimator,
            complete=_ask_the_drive if force else refuse_unknown,
        )
    except PlanError as error:
        error.result = Result(scene=str(scene), drive=drive, bus=bus or "sim", rate=rate)
        raise
    if not force:
        _check_stable(selection)
    if announce is not None:
        announce(selection.plan)
    from haptic_fieldbus.session import Request, render

    return render(Request(selection, duration, simulated_hand, seed, known_faults, recording, confirm, progress))


def _check_stable(selection: Selection) -> None:
    for axis in selection.plan.axes:
        if axis.stability is not None and axis.stability.verdict is Verdict.UNSTABLE:
            limit = axis.stability.stiffness_limit.stable
            refused = UnstableSceneError(_refusal(selection.plan, axis, axis.stability), limit=limit)
            refused.result = known_before(selection)
            raise refused


def _refusal(compiled: Plan, axis: AxisPlan, stability: Stability) -> str:
    """What is unstable, where the limit lies, and what would be stable."""
    per = f"{axis.workspace.effort_unit}/{axis.workspace.length_unit}"
    asked = "this scene" if stability.stiffness is None else f"{stability.stiffness:g} {per}"
    limit = stability.stiffness_limit.stable
    at = f"at {compiled.rate:g} Hz with {1e3 * axis.delay.total:.2f} ms of delay"
    limited = f"limit {limit:.4g} {per} {at}" if limit else f"no stiffness is stable {at}"
    hints = _hints(axis, compiled.period, stability)
    would = f"\nWould be stable: {' · or '.join(hints)}." if hints else ""
    return f"{asked} is unstable on this bench: {limited}.{would}"


def _hints(axis: AxisPlan, period: float, stability: Stability) -> list[str]:
    element = stiffest_of(axis)
    if element is None or stability.stiffness is None:
        return []
    has_damping = hasattr(element, "damping")

    def varied(stiffness: float, damping: float) -> StateSpace:
        changes = {"damping": damping} if has_damping else {}
        return environment_of(axis, period, stiffness=stiffness, **changes)

    damping = getattr(element, "damping", None)
    found = suggest(
        stability.plant, period, axis.delay.transport, varied, stiffness=stability.stiffness, damping=damping
    )
    hints = [] if found.stiffness is None else [f"--set {element.name}.stiffness={found.stiffness:g}"]
    if found.damping is not None and found.damping_limit is not None:
        hints.append(f"--set {element.name}.damping={found.damping:g} (limit {found.damping_limit:.4g})")
    return hints
