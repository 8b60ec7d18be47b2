"""Points of a sweep, and the folder of its rows.

A folder holds `manifest.json`, which has all inputs and their digest, and one Parquet file a chunk of points. A file is
written under another name, flushed to the disk and renamed, so a file that is there is whole. A sweep that was ended at
any moment goes on with the chunks that are missing when it is asked for again; with other inputs it is refused.
"""

import json
import math
import os
import platform
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set, Sized
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_fieldbus.api.arguments import KINDS
from haptic_fieldbus.documents.edits import sync_folder
from haptic_fieldbus.documents.safe_read import check_regular
from haptic_fieldbus.errors import UsageError, require, wrong_kind
from haptic_fieldbus.planning.selection import python_value
from haptic_fieldbus.recordings.provenance import digest, replacing

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure

Value = float | int | str | bool
Columns = Mapping[str, Sequence[Value]]
"""Values of some points by the name of the parameter."""
Rows = dict[str, list[Any]]
"""Figures of these points by their name; None for one that a point does not have."""
OUTCOMES = ("done", "refused", "tripped")
"""Outcomes of a point."""
TEXTS = ("outcome", "message", "verdict", "trip")
NUMBERS = (
    "growth", "damping_share", "peak", "last", "error_rms", "error_max", "error_in_contact", "energy_generated_j",
    "trip_time_s",
)  # fmt: skip
TYPES = dict.fromkeys(TEXTS, "string") | dict.fromkeys(NUMBERS, "float64")
"""Types of the columns of known figures, which hold where a chunk has none of them."""


# The points.

LARGEST_COUNT = 10**9
"""Largest number of points."""
LONGEST_LIST = 10**7
"""Largest number of values of one parameter; more belong into a hypercube."""
LARGEST_WHOLE = 2**63 - 1
"""Largest whole number of a column."""
EXPECTED = {name: KINDS[name] for name in ("rate", "method", "estimator", "hand", "seed", "duration", "fade_in")}
"""Expected kinds of the values of the parameters that are arguments of `run`."""
Given = Mapping[str, Any] | Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class SweepPoints:
    """Points in their order: every product, a list, or a Latin hypercube."""

    kind: str
    values: Mapping[str, tuple[Any, ...]]
    """By the name of the parameter: its values, of a hypercube its least, its largest, and whether it is logarithmic.
    """
    count: int
    seed: int
    whole: frozenset[str] = frozenset()
    """Parameters that are whole numbers; a hypercube between whole numbers draws such ones of them."""

    def __post_init__(self) -> None:
        if not 0 < self.count <= LARGEST_COUNT:
            raise UsageError(f"{self.count} points: expected 1 to {LARGEST_COUNT}")

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
            columns = {name: _values(name, [each[name] for each in given]) for name in (given or [{}])[0]}
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
            return cls("list", columns, len(given), seed)
        return cls("product", columns, math.prod(map(len, columns.values())), seed)

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
            end = high + 1 if self._draws_whole(name) else high
            drawn = low * (end / low) ** share if logarithmic else low + share * (end - low)
            found[name] = drawn if end == high else np.minimum(np.floor(drawn), high).astype(np.int64)
        return found

    def _draws_whole(self, name: str) -> bool:
        return name in self.whole and all(type(end) is int for end in self.values[name][:2])

    @property
    def varied_numbers(self) -> tuple[str, ...]:
        """Parameters with several values, all of them numbers: those that a picture has axes of."""
        numbers = [name for name, kind in self.types.items() if kind in ("int64", "double", "float64")]
        return tuple(name for name in numbers if self.count > 1 and len({*self.values[name]}) > 1)

    @cached_property
    def types(self) -> dict[str, str]:
        """Types of the columns of Arrow: whole numbers, numbers, truth values, or texts for everything else."""
        if self.kind == "hypercube":
            return {name: "int64" if self._draws_whole(name) else "float64" for name in self.values}
        return {name: str(column_of(values).type) for name, values in self.values.items()}


def column_of(values: Iterable[Any], kind: str | None = None) -> "pyarrow.Array":
    """Return values as a column of Arrow, of the type that fits all; texts where none does.

    Without any value it has a type that fits each one that another chunk has there.
    """
    import pyarrow

    known = [*map(python_value, values)]
    kinds = {type(each) for each in known} - {type(None)}
    if kind != "string" and (bool not in kinds or kinds == {bool}):  # to Arrow, True beside a number is 1
        with suppress(pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
            return pyarrow.array(known, type=kind)
    return pyarrow.array([each if each is None else str(each) for each in known], type="string")


def is_value(value: object) -> bool:
    """Return whether a column can hold a value: a number, a text, True or False."""
    return isinstance(value, float | str) or (isinstance(value, int) and abs(value) <= LARGEST_WHOLE)


def _values(name: str, given: Any) -> tuple[Value, ...]:
    """Return the values of a parameter as plain numbers, texts, True and False; raises TypeError for others."""
    if not isinstance(name, str) or not name:
        raise wrong_kind("points", "the name of a parameter, such as wall.stiffness", name)
    # The order of a set is another one in each process, so its points could not be gone on with.
    if isinstance(given, str | bytes | Mapping | Set) or not isinstance(given, Iterable):
        raise wrong_kind(f"points: {name}", "a list of values", given)
    if isinstance(given, Sized) and len(given) > LONGEST_LIST:
        raise UsageError(f"points: {name}: {len(given)} values; expected at most {LONGEST_LIST}")
    found = tuple(map(python_value, given))
    for each in found:
        if not is_value(each):
            raise wrong_kind(f"points: {name}", "a number, a text, True or False", each)
        if name in EXPECTED and not EXPECTED[name][1](each):
            raise wrong_kind(f"points: {name}", EXPECTED[name][0], each)
    return found


def _hypercube(columns: Mapping[str, tuple[Any, ...]], sample: int, seed: int) -> SweepPoints:
    ranges = {}
    for name, values in columns.items():
        low, high, *how = values if len(values) > 1 else (values[0], None)
        numbers = all(type(each) in (int, float) and math.isfinite(each) for each in (low, high))
        if not numbers or not low < high or how not in ([], ["log"]) or (how and low <= 0.0):
            raise UsageError(
                f'{name}: expected (least, largest) or (least, largest, "log"), in rising order, "log" above 0'
            )
        ranges[name] = (low, high, bool(how))
    return SweepPoints("hypercube", ranges, sample, seed)


# The folder.

MANIFEST = "manifest.json"
METADATA = b"haptic_fieldbus.sweep"
"""Key of the metadata of each Parquet file, whose value is the digest of the inputs."""


HOST = re.sub(r"\W", "-", platform.node())
"""Name of this computer or container in the name of a file: another one may have a process of the same number."""
_LEFT = re.compile(rf"(?:{re.escape(MANIFEST)}|chunk-\d+\.parquet)\.(\d+)-{HOST}-\w+\.new")
"""Name of a file that a process of this computer writes, with the number of the process."""


def _is_alive(process: str) -> bool:
    """Return whether a process with this number is there."""
    try:
        os.kill(int(process), 0)
    except (ValueError, OSError) as error:
        return isinstance(error, PermissionError)  # it is another user's
    return True


def _write_whole(path: Path, write: Callable[[Path], object], *, only_new: bool = False) -> None:
    """Write a file under another name, flush it to the disk and rename it.

    Makes its folder if there is none. Raises UsageError where nothing can be written, such as on a full disk, and
    FileExistsError for a file that is there but must be `only_new`.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path, f".{os.getpid()}-{HOST}-{token_hex(4)}.new") as new:
            write(new)
            with new.open("rb") as written:
                os.fsync(written.fileno())
            if only_new:
                with suppress(OSError):  # it is there, or the file system knows no second names
                    os.link(new, path)
                if path.exists() and not path.samefile(new):
                    raise FileExistsError
        sync_folder(path.parent)
    except FileExistsError:
        raise
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class SweepFolder:
    """A folder with a manifest and chunks of rows."""

    path: Path
    points: SweepPoints
    chunk: int
    manifest: Mapping[str, Any]

    @classmethod
    def begun(
        cls, path: Path, points: SweepPoints, chunk: int, inputs: Mapping[str, Any], told: Mapping[str, Any]
    ) -> "SweepFolder":
        """Begin a folder, or take up one with the same inputs; raises UsageError for one with others.

        `told` are the keys of the manifest for pictures: `units` and `shipped_bench`.
        """
        text = json.dumps(inputs, sort_keys=True)
        content = {
            "schema": 1, "digest": digest(text), "points": points.count, "chunk": chunk, "names": list(points.values),
            **told, "inputs": json.loads(text),
        }  # fmt: skip
        found, manifest = cls(path, points, chunk, content), path / MANIFEST
        # Looked at before the manifest: what another sweep begins meanwhile is not strange.
        strange = path.exists() and (not path.is_dir() or {*path.iterdir()} - {*path.glob(f"{MANIFEST}.*.new")})
        if manifest.exists():
            known = cls.known(path)
            if known.digest != found.digest:
                now, before = content["inputs"], known.manifest["inputs"]
                other = [name for name in {**inputs, **before} if before.get(name) != now.get(name)]
                raise UsageError(
                    f"{path}: holds a sweep with other inputs ({', '.join(other)}); expected another folder"
                )
        elif strange:
            raise UsageError(f"{path}: exists and is no folder of a sweep; expected a new or an empty folder")
        else:
            octets = json.dumps(content, indent=1).encode() + b"\n"
            try:
                _write_whole(manifest, lambda new: new.write_bytes(octets), only_new=True)
            except FileExistsError:  # another sweep began meanwhile
                return cls.begun(path, points, chunk, inputs, told)
        for left in path.glob("*.new"):  # of a sweep that was killed while it wrote, not of one that still writes
            if (named := _LEFT.fullmatch(left.name)) and not _is_alive(named[1]):
                with suppress(OSError):  # in a folder that may only be read
                    left.unlink()
        return found

    @classmethod
    def known(cls, path: Path) -> "SweepFolder":
        """Return a folder as its manifest tells; raises UsageError for one without a manifest, or a damaged one."""
        try:
            check_regular(path / MANIFEST)
            told = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
            asked, inputs = told["inputs"]["points"], told["inputs"]
            values = {name: asked["values"][name] for name in told["names"]}
            points = SweepPoints(asked["kind"], values, told["points"], inputs["seed"])
            known = {"shipped_bench": False, **told, "units": dict(told["units"])}
            whole = all(type(told[key]) is int and told[key] > 0 for key in ("points", "chunk"))
            if not whole or not isinstance(told["digest"], str) or not isinstance(inputs["engine"], str):
                raise ValueError
            return cls(path, points, told["chunk"], known)
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise UsageError(f"{path}: no {MANIFEST} of a sweep ({type(error).__name__})") from None

    @property
    def digest(self) -> str:
        """Digest of all inputs."""
        return str(self.manifest["digest"])

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

    def write(self, chunk: int, rows: Rows) -> None:
        """Write the rows of a chunk."""
        import pyarrow
        from pyarrow import parquet

        types, columns = {**self.points.types, **TYPES}, {**self.points.columns(*self.bounds(chunk)), **rows}
        arrays = {name: column_of(values, types.get(name)) for name, values in columns.items()}
        table = pyarrow.table(arrays, metadata={METADATA: self.digest})
        _write_whole(self.file(chunk), lambda new: parquet.write_table(table, new))


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
    loop_steps: int = 0
    """Steps of simulated loops in this call."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of the varied parameters and of the figures that have one."""
    shipped_bench: bool = False
    """Whether all points are on the shipped bench, whose values are exact."""

    @classmethod
    def read(cls, path: str | Path) -> "Sweep":
        """Return the sweep of a folder, complete or not; raises UsageError when it is none, and without pyarrow."""
        require("pyarrow", "data")
        folder = SweepFolder.known(Path(path))
        told = {key: folder.manifest[key] for key in ("units", "shipped_bench")}
        names, whole = tuple(folder.points.values), all(map(folder.is_whole, folder.chunks))
        return cls(folder.path, folder.manifest["inputs"]["engine"], folder.points.count, names, whole, **told)

    def tables(self, columns: Sequence[str] | None = None) -> "Iterator[pyarrow.Table]":
        """Yield the rows of each chunk in their order, so that no more than one is held.

        Raises UsageError for a file whose end is whole and whose rows cannot be read, and without pyarrow.
        """
        require("pyarrow", "data")
        import pyarrow
        from pyarrow import parquet

        folder = SweepFolder.known(self.path)
        for chunk in filter(folder.is_whole, folder.chunks):
            file = folder.file(chunk)
            try:
                with parquet.ParquetFile(file) as opened:
                    known = opened.schema_arrow.names
                    table = opened.read(
                        columns=None if columns is None else [name for name in columns if name in known]
                    )
            except (OSError, pyarrow.ArrowException) as error:
                words = " ".join(str(error).split())
                raise UsageError(f"{file}: damaged ({words}); delete it, and repeat the sweep") from error
            yield table

    def to_arrow(self, columns: Sequence[str] | None = None) -> "pyarrow.Table":
        """Return all rows as one table of Arrow, empty before the first chunk; raises UsageError without pyarrow."""
        tables = list(self.tables(columns))
        import pyarrow

        if not tables:
            types = SweepFolder.known(self.path).points.types | {name: TYPES[name] for name in ("outcome", "message")}
            return pyarrow.schema([each for each in types.items() if each[0] in (columns or types)]).empty_table()
        # A figure of a measure may be a number at one point and a text at another.
        kinds: defaultdict[str, set[str]] = defaultdict(set)
        for each in (each for table in tables for each in table.schema):
            kinds[each.name].add(str(each.type))
        texts = {name for name, found in kinds.items() if len(found - {"null"}) > 1 and found & {"string", "bool"}}
        for place, table in enumerate(tables):
            fields = [each.with_type(pyarrow.string()) if each.name in texts else each for each in table.schema]
            tables[place] = table.cast(pyarrow.schema(fields, table.schema.metadata))
        return pyarrow.concat_tables(tables, promote_options="permissive")

    def to_frame(self) -> "pandas.DataFrame":
        """Return all rows as a frame of pandas; raises UsageError without pandas."""
        require("pandas", "data")
        return self.to_arrow().to_pandas()

    def plot(self, column: str | None = None) -> "Figure":
        """Return a map over the first two varied parameters, or lines over one; raises UsageError without matplotlib.

        Without a `column` it is the verdict, of runs the error, else the outcome.
        """
        require("matplotlib", "plot")
        # The room of pictures stands above this one, and a sweep does without it.
        figure: Figure = import_module("..report.analysis_plots", __package__).draw_sweep(self, column)
        return figure

    @cached_property
    def _kinds(self) -> Counter[tuple[str, Any]]:
        """Number of points by outcome, and by verdict or by whether the motion of the loop grew."""
        names, found = ["outcome", {"verdict": "verdict", "loop": "grew"}.get(self.engine, "message")], Counter[Any]()
        for table in self.tables(names):
            found.update(zip(*(table[name].to_pylist() for name in names), strict=True))
        return found

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of points by their outcome."""
        return {name: sum(self._kinds[kind] for kind in self._kinds if kind[0] == name) for name in OUTCOMES}

    @property
    def stable_fraction(self) -> float | None:
        """Share of the points that were not refused and are stable, with a limit cycle or without; of runs, that did
        not trip. None without any."""
        return self._share(lambda kind: kind not in ("unstable", True))

    @property
    def limit_cycle_fraction(self) -> float | None:
        """Share of the points that were not refused and are stable with a limit cycle. None without any."""
        return self._share(lambda kind: kind == "limit-cycle")

    def _share(self, counts: Callable[[Any], bool]) -> float | None:
        judged = {kind: count for kind, count in self._kinds.items() if kind[0] != "refused"}
        total = sum(judged.values())
        return sum(judged[kind] for kind in judged if kind[0] == "done" and counts(kind[1])) / total if total else None

    @property
    def loop_steps_per_s(self) -> float | None:
        """Steps of simulated loops a second in this call; None for other engines."""
        return self.loop_steps / self.wall_s if self.loop_steps and self.wall_s else None
