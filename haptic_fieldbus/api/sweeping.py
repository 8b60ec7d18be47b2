"""Sweeps: many points of one scene, judged or run, into a folder that can be resumed.

A folder holds `manifest.json`, which has all inputs and their digest, and one Parquet file a chunk of points. A file is
written under another name, flushed to the disk and renamed, so a file that is there is whole. A sweep that was ended at
any moment goes on with the chunks that are missing when it is asked for again; with other inputs it is refused.
"""

import json
import math
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from inspect import getsource
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any
from weakref import finalize

import numpy as np

from haptic_fieldbus.api import Trial, progress_line
from haptic_fieldbus.api.arguments import check_arguments
from haptic_fieldbus.api.provenance import profile_texts, rig_text, scene_text, versions
from haptic_fieldbus.api.sweep_engines import (
    ENGINES,
    TYPES,
    Columns,
    Measure,
    Rows,
    SweepJob,
    Value,
    check_names,
    evaluate,
)
from haptic_fieldbus.defaults import DEFAULT_DURATION, DEFAULT_FADE_IN, DEFAULT_NODE, DEFAULT_SEED
from haptic_fieldbus.documents.own_parts import name_of
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import HapticFieldbusError, UsageError, require, wrong_kind
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.request import LARGEST_SEED, LONGEST, Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.recordings.provenance import digest
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.sim.hand import Hand

if TYPE_CHECKING:
    import pandas
    import pyarrow

    from haptic_fieldbus.numerics.estimators import Estimator
    from haptic_fieldbus.numerics.integrators import Integrator

# The points.

LARGEST_COUNT = 10**9
"""Largest number of points."""
MOST_CHUNKS_OF_FEW = 64
"""Number of chunks of a sweep of few points, so that several processes have work."""
LARGEST_CHUNK = {"verdict": 4096, "full": 8}
"""Largest number of points of a chunk by the engine: some seconds of work, which a killed sweep loses at most."""
Given = Mapping[str, Any] | Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class SweepPoints:
    """Points in their order: every product, a list, or a Latin hypercube."""

    kind: str
    values: Mapping[str, tuple[Any, ...]]
    """By the name of the parameter: its values, of a hypercube its least, its largest, and whether it is logarithmic.
    """
    count: int
    seed: int = 0

    @classmethod
    def of(cls, given: Any, sample: int | None, seed: int) -> "SweepPoints":
        """Return the points of a mapping (products, or with `sample` a hypercube) or of a list of mappings.

        Raises TypeError or UsageError for what is none.
        """
        if isinstance(given, Mapping):
            columns = {name: _values(name, values) for name, values in given.items()}
        elif isinstance(given, list | tuple) and all(isinstance(each, Mapping) for each in given):
            if any(set(each) != set(given[0]) for each in given):
                raise UsageError("points: expected the same parameters in every point of the list")
            columns = {name: _values(name, [each.get(name) for each in given]) for name in (given or [{}])[0]}
            if sample is not None:
                raise UsageError("sample: a list has its points already; expected a mapping of (least, largest)")
        else:
            raise wrong_kind(
                "points", 'a mapping such as {"wall.stiffness": [400.0, 800.0]}, or a list of points', given
            )
        if not columns or not all(columns.values()):
            raise UsageError("points: expected at least one parameter, each with at least one value")
        if sample is not None:
            return _hypercube(columns, sample, seed)
        if not isinstance(given, Mapping):
            return cls("list", columns, len(given))
        return cls("product", columns, _checked_count(math.prod(map(len, columns.values()))))

    def columns(self, first: int, last: int) -> dict[str, list[Value]]:
        """Return the values of the points from `first` to before `last`, by the name of the parameter."""
        if self.kind == "list":
            return {name: list(values[first:last]) for name, values in self.values.items()}
        if self.kind == "hypercube":
            return {name: self._drawn[name][first:last].tolist() for name in self.values}
        sizes = [len(values) for values in self.values.values()]
        places = np.unravel_index(np.arange(first, last), sizes)  # the last parameter changes fastest
        pairs = zip(self.values.items(), places, strict=True)
        return {name: [values[at] for at in place.tolist()] for (name, values), place in pairs}

    @cached_property
    def _drawn(self) -> dict[str, Any]:
        """Values of a hypercube: of each parameter one in each of `count` equal parts of its range, in any order."""
        found = {}
        for place, (name, (low, high, logarithmic)) in enumerate(self.values.items()):
            random = np.random.default_rng([self.seed, place])
            share = (random.permutation(self.count) + random.random(self.count)) / self.count
            found[name] = low * (high / low) ** share if logarithmic else low + share * (high - low)
        return found

    @cached_property
    def types(self) -> dict[str, str]:
        """Types of the columns of Arrow: whole numbers, numbers, truth values, or texts for everything else."""
        if self.kind == "hypercube":
            return dict.fromkeys(self.values, "float64")
        return {name: _type_of(values) for name, values in self.values.items()}


def _type_of(values: Iterable[Value]) -> str:
    kinds = {type(value) for value in values}
    names = {frozenset({bool}): "bool", frozenset({int}): "int64", frozenset({float}): "float64"}
    return names.get(frozenset(kinds)) or ("float64" if kinds == {int, float} else "string")


def _values(name: str, given: Any) -> tuple[Value, ...]:
    """Return the values of a parameter as plain numbers, texts, True and False; raises TypeError for others."""
    if not isinstance(name, str) or not name:
        raise wrong_kind("points", "the name of a parameter, such as wall.stiffness", name)
    if isinstance(given, str | bytes | Mapping) or not isinstance(given, Iterable):
        raise wrong_kind(f"points: {name}", "a list of values", given)
    plain = tuple(each.item() if hasattr(each, "item") else each for each in given)
    for each in plain:
        if not isinstance(each, int | float | str):
            raise wrong_kind(f"points: {name}", "a number, a text, True or False", each)
    return plain


def _hypercube(columns: Mapping[str, tuple[Any, ...]], sample: int, seed: int) -> SweepPoints:
    ranges = {}
    for name, values in columns.items():
        low, high, *how = values if len(values) > 1 else (values[0], None)
        numbers = all(type(each) in (int, float) and math.isfinite(each) for each in (low, high))
        if not numbers or not low < high or how not in ([], ["log"]) or (how and low <= 0.0):
            raise UsageError(
                f'{name}: expected (least, largest) or (least, largest, "log"), in rising order, "log" above 0'
            )
        ranges[name] = (float(low), float(high), bool(how))
    return SweepPoints("hypercube", ranges, _checked_count(sample), seed)


def _checked_count(count: int) -> int:
    if not 0 < count <= LARGEST_COUNT:
        raise UsageError(f"{count} points: expected 1 to {LARGEST_COUNT}")
    return count


# The folder.

MANIFEST = "manifest.json"
METADATA = b"haptic_fieldbus.sweep"
"""Key of the metadata of each Parquet file, whose value is the digest of the inputs."""


def _write_json(content: Mapping[str, Any], path: Path) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file under another name, flush it to the disk and rename it."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    write(new)
    for place in (new, path.parent):
        if place is not new:
            new.replace(path)
        handle = os.open(place, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@dataclass(frozen=True)
class SweepFolder:
    """A folder with a manifest and chunks of rows."""

    path: Path
    points: SweepPoints
    chunk: int
    digest: str

    @classmethod
    def begun(cls, path: Path, points: SweepPoints, chunk: int, inputs: Mapping[str, Any]) -> "SweepFolder":
        """Begin a folder, or take up one with the same inputs; raises UsageError for one with others."""
        text = json.dumps(inputs, sort_keys=True)
        found = cls(path, points, chunk, digest(text))
        manifest = path / MANIFEST
        if manifest.exists():
            known = _manifest(path)
            if known["digest"] != found.digest:
                names = (*inputs, *known["inputs"])
                now = json.loads(text)
                other = [name for name in dict.fromkeys(names) if known["inputs"].get(name) != now.get(name)]
                raise UsageError(
                    f"{path}: holds a sweep with other inputs ({', '.join(other)}); expected another folder"
                )
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise UsageError(f"{path}: exists and is no folder of a sweep; expected a new or an empty folder")
        else:
            path.mkdir(parents=True, exist_ok=True)
            content = {
                "schema": 1, "digest": found.digest, "points": points.count, "chunk": chunk,
                "names": list(points.values), "inputs": json.loads(text),
            }  # fmt: skip
            _write_whole(manifest, partial(_write_json, content))
        for left in path.glob("*.new"):  # of a sweep that was killed while it wrote
            left.unlink(missing_ok=True)
        return found

    @property
    def chunks(self) -> range:
        return range(-(-self.points.count // self.chunk))

    def bounds(self, chunk: int) -> tuple[int, int]:
        """Return the first point of a chunk, and the first one after it."""
        return chunk * self.chunk, min((chunk + 1) * self.chunk, self.points.count)

    def file(self, chunk: int) -> Path:
        return self.path / f"chunk-{chunk:06d}.parquet"

    def is_whole(self, chunk: int) -> bool:
        """Return whether the rows of a chunk are there; a file that cannot be read is computed again."""
        import pyarrow
        from pyarrow import parquet

        first, last = self.bounds(chunk)
        try:
            found = parquet.read_metadata(self.file(chunk))
        except (OSError, pyarrow.ArrowInvalid):
            return False
        return bool(found.num_rows == last - first and (found.metadata or {}).get(METADATA) == self.digest.encode())

    def write(self, chunk: int, columns: Columns, rows: Rows) -> None:
        """Write the rows of a chunk."""
        import pyarrow
        from pyarrow import parquet

        arrays, types = {}, {**self.points.types, **TYPES}
        for name, values in {**columns, **rows}.items():
            plain = [each.item() if hasattr(each, "item") else each for each in values]
            known = {type(each) for each in plain} - {type(None)}
            wanted = types.get(name) or (
                "float64" if known <= {int, float} else "bool" if known == {bool} else "string"
            )
            texts = plain if wanted != "string" else [each if each is None else str(each) for each in plain]
            arrays[name] = pyarrow.array(texts, type=getattr(pyarrow, wanted if wanted != "bool" else "bool_")())
        table = pyarrow.table(arrays).replace_schema_metadata({METADATA: self.digest})
        _write_whole(self.file(chunk), lambda new: parquet.write_table(table, new))


def _manifest(path: Path) -> dict[str, Any]:
    """Return the content of a manifest; raises UsageError for a folder without one."""
    try:
        found = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
        return {key: found[key] for key in ("digest", "points", "chunk", "names", "inputs")}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path}: no {MANIFEST} of a sweep ({type(error).__name__})") from None


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep: its folder, and what its rows tell."""

    path: Path
    engine: str
    points: int
    names: tuple[str, ...]
    """Parameters that are varied."""
    complete: bool
    """Whether the rows of all points are there."""
    wall_s: float | None = None
    """Time that this call took [s]; None for a folder that was only read."""
    computed: int = 0
    """Points that this call computed; the others were there."""

    @classmethod
    def read(cls, path: str | Path) -> "Sweep":
        """Return the sweep of a folder, complete or not; raises UsageError when it is none."""
        found = _manifest(Path(path))
        count = -(-found["points"] // found["chunk"])
        whole = len([*Path(path).glob("chunk-*.parquet")]) == count
        return cls(Path(path), found["inputs"]["engine"], found["points"], tuple(found["names"]), whole)

    def tables(self, columns: Sequence[str] | None = None) -> "Iterator[pyarrow.Table]":
        """Yield the rows of each chunk in their order, so that no more than one is held."""
        require("pyarrow", "data")
        from pyarrow import parquet

        for file in sorted(self.path.glob("chunk-*.parquet")):
            with parquet.ParquetFile(file) as opened:
                known = opened.schema_arrow.names
                yield opened.read(columns=None if columns is None else [name for name in columns if name in known])

    def to_arrow(self, columns: Sequence[str] | None = None) -> "pyarrow.Table":
        """Return all rows as one table of Arrow; raises UsageError without pyarrow."""
        tables = list(self.tables(columns))
        import pyarrow

        return pyarrow.concat_tables(tables, promote_options="permissive")

    def to_frame(self) -> "pandas.DataFrame":
        """Return all rows as a frame of pandas; raises UsageError without pandas."""
        require("pandas", "data")
        return self.to_arrow().to_pandas()

    @cached_property
    def stable_fraction(self) -> float | None:
        """Share of the judged points that are not unstable, of runs the share that did not trip; None without any."""
        good = total = 0
        for table in self.tables(["outcome", "verdict", "grew"]):
            found = table.to_pydict()
            for at, outcome in enumerate(found["outcome"]):
                verdict = found.get("verdict", [None] * len(table))[at] if self.engine == "verdict" else None
                grew = found.get("grew", [False] * len(table))[at]
                total += outcome != "refused"
                good += outcome == "done" and verdict != "unstable" and not grew
        return good / total if total else None


# The work.

AHEAD = 32
"""Chunks that an executor of somebody else holds at once."""
LOOK_EVERY = 0.5
"""Time between two looks of a process for the one that began it [s]."""


def _begin_worker(parent: int) -> None:
    """Leave Ctrl-C to the process that began this one, and end when that is gone: nobody else would end it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            sleep(LOOK_EVERY)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _Here(Executor):
    """Does the work at once in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        found: Future[Any] = Future()
        found.set_result(fn(*args, **kwargs))
        return found


@contextmanager
def _workers(count: int) -> Iterator[Executor]:
    """Yield an executor of so many processes, none of which outlives the block."""
    if count == 1:
        yield _Here()
        return
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else None)
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
    executor: Executor, ahead: int, job: SweepJob, folder: SweepFolder, chunks: Iterable[int]
) -> Iterator[tuple[int, Columns, Rows]]:
    """Yield the rows of chunks as they are done, with at most `ahead` of them under way."""
    under_way: dict[Future[Rows], tuple[int, Columns]] = {}
    rest = iter(chunks)
    try:
        while True:
            for chunk in rest:
                points = folder.points.columns(*folder.bounds(chunk))
                under_way[executor.submit(evaluate, job, points)] = chunk, points
                if len(under_way) >= ahead:
                    break
            if not under_way:
                return
            for done in wait(under_way, return_when=FIRST_COMPLETED).done:
                chunk, columns = under_way.pop(done)
                yield chunk, columns, done.result()
    except BrokenProcessPool as error:
        raise HapticFieldbusError(
            f"a process of the sweep was ended from outside, perhaps for lack of memory; ask again with {folder.path} "
            "to go on"
        ) from error
    finally:
        for each in under_way:
            each.cancel()


@dataclass(frozen=True, kw_only=True)
class SweepRequest:
    """How a sweep is made."""

    engine: str = "verdict"
    out: str | Path | None = None
    sample: int | None = None
    measure: Measure | None = None
    chunk: int | None = None
    workers: int | None = None
    executor: Executor | None = None
    progress: Callable[[int, int], None] | bool | None = None

    def check(self) -> None:
        """Raise TypeError or UsageError for what cannot be."""
        check_arguments("sweep", self)
        require("pyarrow", "data")
        faults = [
            f"{name} {value}: expected a whole number from 1 up"
            for name, value in (("sample", self.sample), ("chunk", self.chunk), ("workers", self.workers))
            if value is not None and value < 1
        ]
        if self.engine not in ENGINES:
            faults.append(f'engine "{self.engine}": expected {", ".join(ENGINES)}')
        if self.measure is not None and self.engine != "full":
            faults.append("measure: only runs of the engine full have a result to measure")
        if faults:
            raise UsageError("\n".join(faults))


def sweep(
    scene: str | Path | Scene,
    points: Given,
    rig: str | Path | Rig | None = None,
    *,
    engine: str = "verdict",
    out: str | Path | None = None,
    sample: int | None = None,
    measure: Measure | None = None,
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
    progress: Callable[[int, int], None] | bool | None = None,
) -> Sweep:
    """Judge or run a scene at many points, and return the rows.

    `points` maps parameters to their values, of which every product is a point; with `sample` to (least, largest) or
    (least, largest, "log"), of which a Latin hypercube of so many points is drawn by `seed`; or it is a list of points.
    Parameters are element.parameter, rig.axis.key, rate, method and estimator, and for the engine `full` hand, seed,
    duration and fade_in. The engine `verdict` judges the loop; `full` runs it in simulation, with `force` above its
    limit too, and `measure` maps the result of a run to figures. Rows go to the folder `out`, by chunks of `chunk`
    points; the same call goes on with a folder that is not complete. The work is done by `workers` processes (one a
    processor), or by any `executor`. Refusals and trips are rows. Raises TypeError, DocumentError or UsageError for
    what no point could have, and UsageError for a folder with other inputs.
    """
    asked = SweepRequest(
        engine=engine, out=out, sample=sample, measure=measure, chunk=chunk, workers=workers, executor=executor,
        progress=progress,
    )  # fmt: skip
    task = Task(
        scene, rig, rate=rate, settings=settings, method=name_of(method), estimator=name_of(estimator),
        drive=drive, bus=bus, node=node, axes=axes, zero=zero, profiles=profiles,
    )  # fmt: skip
    trial = Trial(duration=duration, hand=name_of(hand), fade_in=fade_in, seed=seed, force=force)
    check_arguments("sweep", task, trial)
    asked.check()
    return sweep_task(task, trial, SweepPoints.of(points, sample, seed), asked)


@own_faults()
def sweep_task(task: Task, trial: Trial, points: SweepPoints, asked: SweepRequest) -> Sweep:
    """Sweep the points of a task, as `sweep` does."""
    job, inputs = _prepared(task, trial, points, asked)
    if asked.out is not None:
        return _swept(Path(asked.out), job, inputs, points, asked)
    path = Path(mkdtemp(prefix="haptic-fieldbus-"))
    try:
        found = _swept(path, job, inputs, points, asked)
    except BaseException:
        rmtree(path)
        raise
    finalize(found, rmtree, path, ignore_errors=True)  # it lasts as long as the rows may be asked for
    return found


def _swept(path: Path, job: SweepJob, inputs: dict[str, Any], points: SweepPoints, asked: SweepRequest) -> Sweep:
    """Compute the chunks that the folder does not have."""
    began = monotonic()
    chunk = asked.chunk or min(LARGEST_CHUNK[asked.engine], -(-points.count // MOST_CHUNKS_OF_FEW))
    folder = SweepFolder.begun(path, points, chunk, inputs | {"chunk": chunk})
    job = replace(job, digest=folder.digest)
    missing = [each for each in folder.chunks if not (folder.file(each).exists() and folder.is_whole(each))]
    left = sum(last - first for first, last in map(folder.bounds, missing))
    tell = progress_line() if asked.progress is True else asked.progress or (lambda done, total: None)
    done = points.count - left
    tell(done, points.count)
    count = min(asked.workers or os.cpu_count() or 1, max(len(missing), 1))
    with _workers(count) if asked.executor is None else _lent(asked.executor) as executor:
        ahead = AHEAD if asked.executor is not None else 2 * count if count > 1 else 1
        for each, columns, rows in _computed(executor, ahead, job, folder, missing):
            folder.write(each, columns, rows)
            done += len(next(iter(columns.values())))
            tell(done, points.count)
    return Sweep(path, asked.engine, points.count, tuple(points.values), True, monotonic() - began, left)


@contextmanager
def _lent(executor: Executor) -> Iterator[Executor]:
    """Yield an executor of somebody else, who ends it."""
    yield executor


def _prepared(task: Task, trial: Trial, points: SweepPoints, asked: SweepRequest) -> tuple[SweepJob, dict[str, Any]]:
    """Return what all points have in common, and the inputs from which every row follows."""
    found = load(task)
    if asked.engine == "full" and not found.bus.simulated:
        raise UsageError(f"bus {found.bus.text}: a sweep runs simulated drives alone; expected sim")
    if asked.engine == "full" and not 0.0 < trial.duration <= LONGEST:
        raise UsageError(f"duration {exactly(trial.duration)}: expected a time above 0 s, at most {exactly(LONGEST)} s")
    if not 0 <= trial.seed <= LARGEST_SEED:
        raise UsageError(f"seed {trial.seed}: expected a whole number from 0 to {LARGEST_SEED}")
    part = {} if found.part is None else {found.part: dict(task.settings or {})[found.part]}
    own = replace(
        task, scene=found.scene, rig=found.rig, settings=part, drive=None, bus=None, node=DEFAULT_NODE, zero=None
    )
    job = SweepJob(asked.engine, own, trial, "", asked.measure)
    check_names(list(points.values), job)
    files = profile_texts(found.rig, task)
    scene = scene_text(found.scene)
    inputs = {
        "engine": asked.engine,
        "points": {"kind": points.kind, "values": points.values, "count": points.count},
        "scene": repr(found.scene) if scene is None else scene.text,
        "settings": part,
        "rig": rig_text(found.rig, files).text,
        "profiles": {each.name: each.sha256 for each in files.values()},
        "rendering": {"rate": task.rate, "method": task.method, "estimator": task.estimator, "axes": task.axes},
        "seed": trial.seed,
        "run": None
        if asked.engine != "full"
        else {name: getattr(trial, name) for name in ("duration", "hand", "fade_in", "force")},
        "measure": None if asked.measure is None else _source_of(asked.measure),
        "version": versions().get("haptic-fieldbus"),
    }
    return job, inputs


def _source_of(measure: Measure) -> str:
    """Return the digest of the text of a function; its name where the text cannot be had."""
    try:
        return digest(getsource(measure))
    except (OSError, TypeError):
        return getattr(measure, "__qualname__", type(measure).__qualname__)
