"""The Python API: `plan` compiles and explains, `stability` judges, `response` simulates, `run` renders on a drive."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.judging import device_of, judge_scene
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.open_loop import response as response
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.refusal import check_stable
from haptic_fieldbus.request import BusName, check_request
from haptic_fieldbus.result import Result, known_before
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.selection import DEFAULT_DRIVE, DEFAULT_RATE, Selection, Value, refuse_unknown, select
from haptic_fieldbus.sim.fault_file import load_faults
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.hand import hand_named

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.changes import Changes, Scheduled

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
    hand: str | None = None,
    settings: Mapping[str, Value] | None = None,
    method: str | None = None,
    estimator: str | None = None,
    seed: int = 0,
    faults: str | Path | Sequence[Fault] = (),
    record: str | Path | None = None,
    force: bool = False,
    changes: "Changes | Sequence[Scheduled]" = (),
    confirm: Callable[[str], bool] | None = None,
    progress: Callable[[int, int], None] | None = None,
    announce: Callable[[Plan], None] | None = None,
) -> Result:
    """Render `scene` for `duration` [s] from *operation enabled*, at `rate` [Hz]; selection as for `plan`.

    On the simulated bus `hand` (that of the scene unless given), `seed` and `faults` say what happens; on a real one
    nothing moves unless `confirm` answers True. `changes` are new settings for the running scene at seconds from
    *operation enabled*, [(2.0, {"wall.stiffness": 800.0})], or `Changes`, which other threads can ask. Raises what
    `plan` raises, UnstableSceneError (unless `force`), BusError, DriveFaultError and
    SafetyTripError; torque is zero before any of them is raised, and their `result` is what was known by then.
    """
    recording = Path(record) if record is not None else None
    given_hand = hand_named(hand) if hand is not None else None
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
    wanted = _checked(selection, changes, duration, force)
    if announce is not None:
        announce(selection.plan)
    simulated_hand = given_hand if hand is not None else hand_named(selection.plan.scene.hand or DEFAULT_HAND)
    from haptic_fieldbus.session import Request, render

    return render(
        Request(selection, duration, simulated_hand, seed, known_faults, recording, confirm, progress, wanted)
    )


def _checked(
    selection: Selection, changes: "Changes | Sequence[Scheduled]", duration: float, force: bool
) -> "Changes | None":
    """The changes, those at a time checked; None, and nothing imported, where there are none."""
    try:
        if not force:
            check_stable(selection.plan)
        if isinstance(changes, Sequence) and not changes:
            return None
        from haptic_fieldbus.changes import Changes

        wanted = changes if isinstance(changes, Changes) else Changes(changes)
        wanted.check(selection.plan, duration, force=force)
        return wanted
    except PlanError as refused:
        refused.result = known_before(selection)
        raise
