"""Sweeps: many points of one scene, judged or run by many processes, into a folder that can be resumed.

The process that asked hands chunks of points to an executor and writes the rows that come back.
"""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any
from weakref import finalize

from haptic_fieldbus.api import Trial, progress_line
from haptic_fieldbus.api.arguments import asked_of
from haptic_fieldbus.api.provenance import text_of_rig, text_of_scene, texts_of_profiles, versions
from haptic_fieldbus.api.sweep_engines import ENGINES, Measure, SweepJob, evaluate
from haptic_fieldbus.api.sweep_folder import Given, Rows, Sweep, SweepFolder, SweepPoints
from haptic_fieldbus.defaults import (
    DEFAULT_DURATION,
    DEFAULT_ENGINE,
    DEFAULT_FADE_IN,
    DEFAULT_HAND,
    DEFAULT_NODE,
    DEFAULT_SEED,
    DEFAULT_STEPS,
)
from haptic_fieldbus.documents.own_parts import OwnName, content_digest
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import HapticFieldbusError, UsageError, raise_all, require
from haptic_fieldbus.planning.request import LONGEST, Task, check_fade_in, check_request
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.running.ending import SIGNALS, EndSignals, ended_by_signals
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.sim.hand import Hand, hand_named

if TYPE_CHECKING:
    from haptic_fieldbus.numerics.estimators import Estimator
    from haptic_fieldbus.numerics.integrators import Integrator

# The work.

MOST_CHUNKS_OF_FEW = {"verdict": 64, "loop": 4, "full": 64}
"""Number of chunks of a sweep of few points, so that several processes have work; loops are quicker side by side."""
LARGEST_CHUNK = {"verdict": 4096, "loop": 1024, "full": 8}
"""Largest number of points of a chunk by the engine: some seconds of work, which a killed sweep loses at most."""
CONNECTING = 10.0
"""Time in which a scheduler must answer [s]."""
AHEAD = 32
"""Chunks that an executor of somebody else holds at once."""
FORKS = sys.platform == "linux"
"""Whether processes begin as copies; others import the script that called once more."""
LOOK_EVERY = 0.5
"""Time between two looks for a signal, and of a process for the one that began it [s]."""


def _begin_worker(parent: int) -> None:
    """Leave Ctrl-C to the process that began this one, and end when that is gone: nobody else would end it."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_DFL if each == signal.SIGTERM else signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            sleep(LOOK_EVERY)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _Here(Executor):
    """Does the work at once in this process; a signal interrupts it, except a run, which sees the note by itself."""

    def __init__(self, ending: EndSignals, engine: str) -> None:
        self._ending, self._runs = ending, engine == "full"

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        found: Future[Any] = Future()
        try:
            if not self._runs:
                self._ending.resume()
            found.set_result(fn(*args, **kwargs))
        finally:
            self._ending.hold()
        return found


@contextmanager
def _workers(count: int) -> Iterator[Executor]:
    """Yield an executor of so many processes, none of which outlives the block."""
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("fork" if FORKS else None)
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin_worker, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        # Of a chunk that nobody waits for, the end may be minutes away.
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _computed(
    executor: Executor, job: SweepJob, folder: SweepFolder, chunks: Iterable[int], ahead: int, ending: EndSignals, *,
    lent: bool,
) -> Iterator[tuple[int, Rows]]:  # fmt: skip
    """Yield the rows of chunks as they are done, with at most `ahead` of them under way.

    Raises KeyboardInterrupt after a signal. It is looked for here, because an exception that a signal raises is lost
    where Python takes none: in a `__del__`, a callback of a weak reference, or a hook of `fork`.
    """
    under_way: dict[Future[Rows], int] = {}
    rest = iter(chunks)
    try:
        while True:
            for chunk in rest:
                points = folder.points.columns(*folder.bounds(chunk))
                under_way[executor.submit(evaluate, job, points)] = chunk
                if len(under_way) >= ahead:
                    break
            if not under_way:
                return
            for done in wait(under_way, LOOK_EVERY, FIRST_COMPLETED).done:
                yield under_way.pop(done), done.result()
            if ending.signal is not None:
                raise KeyboardInterrupt
    except BrokenProcessPool as error:
        ending.resume()  # whoever ended all processes of a group has ended the sweep
        unguarded = "" if FORKS else ', or the script lacks `if __name__ == "__main__":` before the sweep'
        raise HapticFieldbusError(
            f"a process of the sweep was ended from outside, perhaps for lack of memory{unguarded}; ask again with "
            f"{folder.path} to go on"
        ) from error
    finally:
        if lent:  # own processes are ended, and a pool that loses them must not meet a cancelled future (CPython 3.11)
            for each in under_way:
                each.cancel()


LEAST_STEPS, MOST_STEPS = 8, 10**8
"""Periods of a simulated loop: at least two of each quarter."""


@dataclass(frozen=True, kw_only=True)
class SweepRequest:
    """How a sweep is made."""

    engine: str = DEFAULT_ENGINE
    out: str | Path | None = None
    sample: int | None = None
    measure: Measure | None = None
    steps: int = DEFAULT_STEPS
    chunk: int | None = None
    workers: int | None = None
    executor: Executor | None = None
    scheduler: str | None = None
    progress: Callable[[int, int], None] | bool | None = None

    def check(self) -> None:
        """Raise UsageError for what cannot be."""
        require("pyarrow", "data")
        faults = [
            f"{name} {value}: expected a whole number from 1 up"
            for name, value in (("sample", self.sample), ("chunk", self.chunk), ("workers", self.workers))
            if value is not None and value < 1
        ]
        if not LEAST_STEPS <= self.steps <= MOST_STEPS:
            faults.append(f"steps {self.steps}: expected {LEAST_STEPS} to {MOST_STEPS} periods of a loop")
        if self.engine not in ENGINES:
            faults.append(f'engine "{self.engine}": expected {", ".join(ENGINES)}')
        if sum(each is not None for each in (self.workers, self.executor, self.scheduler)) > 1:
            faults.append("workers, executor, scheduler: expected one of them")
        if self.measure is not None and self.engine != "full":
            faults.append("measure: only runs of the engine full have a result to measure")
        raise_all(faults)


def sweep(
    scene: str | Path | Scene,
    points: Given,
    rig: str | Path | Rig | None = None,
    *,
    engine: str = DEFAULT_ENGINE,
    out: str | Path | None = None,
    sample: int | None = None,
    measure: Measure | None = None,
    steps: int = DEFAULT_STEPS,
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
    force: bool = False,
    chunk: int | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
) -> Sweep:
    """Judge or run a scene at many points, and return the rows.

    `points` maps parameters to their values, of which every product is a point; with `sample` to (least, largest) or
    (least, largest, "log"), of which a Latin hypercube of so many points is drawn by `seed` (whole numbers where the
    parameter and both ends are such); or it is a list of points. Parameters are element.parameter, rig.axis.key, rate,
    method and estimator, and for the engine `full` hand, seed, duration and fade_in. The engine `verdict` judges the
    loop; `loop` simulates `steps` periods after a flick in sustained contact; `full` runs it in simulation, with
    `force` above its limit too, and `measure` maps the result of a run to figures. Rows go to the folder `out`, by
    chunks of `chunk` points; the same call goes on with a folder that is not complete. The work is done by `workers`
    processes (one a processor), by any `executor`, or by the Dask cluster whose `scheduler` has this address. Refusals
    and trips are rows. Raises TypeError, DocumentError or UsageError for what no point could have, UsageError for a
    folder with other inputs, and KeyboardInterrupt after Ctrl-C, SIGTERM or SIGHUP.
    """
    task, trial, asked = asked_of("sweep", locals(), Task, Trial, SweepRequest)
    asked.check()
    trial = replace(trial, progress=None)  # it is told of points, not of the periods of each run
    return sweep_task(task, trial, SweepPoints.of(points, sample, seed), asked)


@own_faults()
def sweep_task(task: Task, trial: Trial, points: SweepPoints, asked: SweepRequest) -> Sweep:
    """Sweep the points of a task, as `sweep` does."""
    job, inputs = _prepared(task, trial, points, asked)
    points = replace(points, whole=job.whole_parameters(points.values))
    if asked.out is not None:
        return _swept(Path(asked.out), job, inputs, points, asked)
    with ExitStack() as kept:
        folder = kept.enter_context(TemporaryDirectory(prefix="haptic-fieldbus-", ignore_cleanup_errors=True))
        found = _swept(Path(folder), job, inputs, points, asked)
        finalize(found, kept.pop_all().close)  # it lasts as long as the rows may be asked for
    return found


def _swept(path: Path, job: SweepJob, inputs: dict[str, Any], points: SweepPoints, asked: SweepRequest) -> Sweep:
    """Compute the chunks that the folder does not have."""
    began = monotonic()
    chunk = asked.chunk or min(LARGEST_CHUNK[asked.engine], -(-points.count // MOST_CHUNKS_OF_FEW[asked.engine]))
    names = tuple(points.values)
    told: Any = {"units": job.units_of_parameters(names), "shipped_bench": job.is_shipped_bench(names)}
    folder = SweepFolder.begun(path, points, chunk, inputs | {"chunk": chunk}, told)
    missing = [each for each in folder.chunks if not (folder.file(each).exists() and folder.is_whole(each))]
    left = sum(last - first for first, last in map(folder.bounds, missing))
    if asked.scheduler is not None or (asked.executor is None and asked.workers != 1):
        _check_sendable(job)
    steps = left * asked.steps if asked.engine == "loop" else 0
    tell = progress_line() if asked.progress is True else asked.progress or (lambda done, total: None)
    done = points.count - left
    tell(done, points.count)
    count = min(asked.workers or os.cpu_count() or 1, max(len(missing), 1))
    lent = asked.executor is not None or asked.scheduler is not None
    with ended_by_signals() as ending:
        ending.hold()
        ahead = AHEAD if lent else 2 * count if count > 1 else 1
        with _executor(asked, count, ending) as executor:
            for each, rows in _computed(executor, job, folder, missing, ahead, ending, lent=lent):
                folder.write(each, rows)
                done += len(rows["outcome"])
                tell(done, points.count)
        ending.resume()
    return Sweep(path, asked.engine, points.count, names, True, monotonic() - began, left, steps, **told)


def _executor(asked: SweepRequest, count: int, ending: EndSignals) -> AbstractContextManager[Executor]:
    """Return the executor that was asked for; else so many processes."""
    if asked.scheduler is not None:
        return _cluster(asked.scheduler)
    if asked.executor is None and count > 1:
        return _workers(count)
    return nullcontext(asked.executor or _Here(ending, asked.engine))


def _check_sendable(job: SweepJob) -> None:
    """Raise UsageError for a job that no other process can have."""
    try:
        pickle.dumps(job)
    except Exception as error:  # a foreign object may raise anything
        part = "measure" if job.measure is not None else "scene"
        raise UsageError(
            f"{part}: cannot be sent to another process ({error}); "
            "expected a function or class of a module, or workers=1"
        ) from None


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    """Yield an executor of the Dask cluster with this address; raises UsageError when no scheduler answers there."""
    require("distributed", "cluster")
    from distributed import Client, KilledWorker

    try:
        client = Client(address, timeout=CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"scheduler {address}: no Dask scheduler answers ({error}); expected such as tcp://host:8786"
        ) from None
    with client:
        try:
            yield client.get_executor()
        except (KilledWorker, CancelledError) as error:
            raise HapticFieldbusError(
                f"scheduler {address}: the cluster lost its work ({error}); ask again with the same folder to go on"
            ) from error


def _prepared(task: Task, trial: Trial, points: SweepPoints, asked: SweepRequest) -> tuple[SweepJob, dict[str, Any]]:
    """Return what all points have in common, and the inputs from which every row follows."""
    found = load(task)
    if asked.engine == "full" and not found.bus.simulated:
        raise UsageError(f"bus {found.bus.text}: a sweep runs simulated drives alone; expected sim")
    check_request(rate=task.rate, seed=trial.seed, duration=trial.duration if asked.engine == "full" else LONGEST)
    check_fade_in(trial.fade_in)
    hand_named(trial.hand or DEFAULT_HAND)
    if twice := sorted({*points.values} & {*(task.settings or {})}):
        raise UsageError(f"{', '.join(twice)}: given both as a setting and as points; expected one of them")
    part = {} if found.part is None else {found.part: dict(task.settings or {})[found.part]}
    own = replace(task, settings=part, drive=None, bus=None, node=DEFAULT_NODE, zero=None)
    job = SweepJob(asked.engine, own, found.scene, found.rig, trial, asked.steps, asked.measure)
    job.check_names(points.values)
    files = texts_of_profiles(found.rig, task)
    scene = text_of_scene(found.scene)
    inputs = {
        "engine": asked.engine,
        "points": {"kind": points.kind, "values": points.values, "count": points.count},
        "scene": content_digest(found.scene) if scene is None else scene.text,
        "settings": part,
        "rig": text_of_rig(found.rig, files).text,
        "profiles": {each.name: each.sha256 for each in files.values()},
        "rendering": {
            "rate": task.rate, "method": _told(task.method), "estimator": _told(task.estimator), "axes": task.axes,
        },
        "seed": trial.seed,
        "run": None
        if asked.engine != "full"
        else {name: _told(getattr(trial, name)) for name in ("duration", "hand", "fade_in", "force")},
        "steps": asked.steps if asked.engine == "loop" else None,
        "measure": None if asked.measure is None else content_digest(asked.measure),
        "version": versions().get("haptic-fieldbus"),
    }  # fmt: skip
    return job, inputs


def _told(value: Any) -> Any:
    """Return an input for the manifest: of an object of Python its name and digest."""
    return f"{value} {content_digest(value.part)}" if isinstance(value, OwnName) else value
