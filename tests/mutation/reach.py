"""Which tests reach which lines of some rooms: one run of a lane, traced, kept in a folder.

As a plugin of pytest (`-p tests.mutation.reach`) it names each line that is run by the test that runs it, or by the
fixture, when several tests share it. Processes that a test starts count as its own.
"""

import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import grimp
import pytest
from coverage import Coverage, CoverageData
from coverage.exceptions import DataError

from tests.mutation.mutants import Mutant

PROJECT = Path(__file__).resolve().parents[2]
FOLDER, NAME = "MUTATION_REACH", "MUTATION_TEST"
"""Environment of the traced run: where to write, and which test runs at the moment."""
# Without `sigterm`: its handler would stay in place of ours, which take a signal from the default handlers alone, and
# a test that sends SIGTERM would end its worker.
SETTINGS = """[run]
data_file = {folder}/lines
parallel = true
include = {include}
context = ${{MUTATION_TEST-}}
"""


@dataclass(frozen=True)
class Reach:
    """Observations of one lane."""

    lane: str
    lines: CoverageData
    tests: dict[str, tuple[float, bool, list[str]]]
    """Of each test how long it took [s], whether it passed, and the fixtures that it uses."""

    def seconds(self, test: str) -> float:
        return self.tests[test][0]

    def of(self, mutant: Mutant) -> set[str]:
        """Tests that passed and reach a mutant.

        A line that is run at import counts as reached by each test that reaches the module or one that imports it,
        and by the tests of their rooms. A constant that functions read is reached by the tests that run these lines,
        and by all tests of a room that reads it and was not traced.
        """
        read = uses(mutant) if mutant.constant else {}
        if read:
            lines = [(file, line) for file, places in read.items() for line in places]
            untraced = tuple(f"tests/{file.split('/')[1]}/" for file in read if not self._paths(file))
            found = self._named({name for file, line in lines for name in self._contexts(file, line, line)})
            return found | {test for test in self._passed() if test.startswith(untraced)}
        if not mutant.at_import:
            return self._named(self._contexts(mutant.file, mutant.first, mutant.last))
        name = mutant.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        modules = {name, *grimp.build_graph("haptic_fieldbus").find_modules_that_directly_import(name)}
        found = {context for module in modules for context in self._contexts(module.replace(".", "/"), 0, sys.maxsize)}
        rooms = tuple(f"tests/{module.split('.')[1]}/" for module in modules if "." in module)
        return self._named(found) | {test for test in self._passed() if test.startswith(rooms)}

    def _passed(self) -> Iterator[str]:
        return (test for test, (_, passed, _) in self.tests.items() if passed)

    def _contexts(self, file: str, first: int, last: int) -> set[str]:
        """Names beside lines of one file, wherever it was installed."""
        found: set[str] = set()
        for path in self._paths(file):
            for line, contexts in self.lines.contexts_by_lineno(path).items():
                found.update(contexts if first <= line <= last else ())
        return found

    def _paths(self, file: str) -> list[str]:
        """Where a file was traced; nowhere in a room that was not looked at."""
        named = file.removesuffix(".py").removesuffix("/__init__")
        bare = {path: path.removesuffix(".py").removesuffix("/__init__") for path in self.lines.measured_files()}
        return [path for path, name in bare.items() if name.endswith("/" + named)]

    def _named(self, contexts: set[str]) -> set[str]:
        shared = [context.split("\t") for context in contexts if "\t" in context]
        return {
            test
            for test in self._passed()
            if test in contexts or any(test.startswith(base) and name in self.tests[test][2] for base, name in shared)
        }


def uses(mutant: Mutant) -> dict[str, set[int]]:
    """Of each file the lines inside of functions that read a constant, in its own module or where it is imported."""
    module = mutant.file.removesuffix(".py").replace("/", ".")
    found: dict[str, set[int]] = {}
    for path in sorted((PROJECT / "haptic_fieldbus").glob("**/*.py")):
        file, tree = path.relative_to(PROJECT).as_posix(), ast.parse(path.read_bytes())
        if file == mutant.file or _imports(tree, module, mutant.constant):
            functions = (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef))
            names = (name for each in functions for statement in each.body for name in ast.walk(statement))
            lines = {name.lineno for name in names if isinstance(name, ast.Name) and name.id == mutant.constant}
            if lines:
                found[file] = lines
    return found


def _imports(tree: ast.Module, module: str, name: str) -> bool:
    froms = (each for each in ast.walk(tree) if isinstance(each, ast.ImportFrom) and each.module == module)
    return any(alias.name == name for each in froms for alias in each.names)


def traced(tree: Path, folder: Path, lane: str, rooms: tuple[str, ...], environment: dict[str, str]) -> Reach:
    """Code that one lane reaches: from the folder, or else by a run, which takes minutes."""
    kept = folder / lane
    if not (kept / "all").exists():
        kept.mkdir(parents=True, exist_ok=True)
        include = ", ".join(f"*/haptic_fieldbus/{room}/*" for room in rooms)
        (kept / "settings").write_text(SETTINGS.format(folder=kept, include=include))
        command = [sys.executable, "-m", "pytest", "-p", "tests.mutation.reach", "-p", "no:cacheprovider"]
        command += ["-n", "2", "--dist", "loadgroup", "--lane", lane, "-q"]
        subprocess.run(command, cwd=tree, env=environment | {FOLDER: str(kept)}, check=False)
        together = CoverageData(str(kept / "building"))
        for path in kept.glob("lines.*"):
            with suppress(DataError):  # of a process that a test killed while it wrote
                part = CoverageData(str(path))
                part.read()
                together.update(part)
        together.close()
        (kept / "building").rename(kept / "all")
    lines = CoverageData(str(kept / "all"))
    lines.read()
    tests = {test: tuple(seen) for path in kept.glob("tests.*") for test, seen in json.loads(path.read_text()).items()}
    return Reach(lane, lines, tests)


class Tracer:
    """Hooks of one worker."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.coverage = Coverage(config_file=str(folder / "settings"))
        self.tests: dict[str, tuple[float, bool, list[str]]] = {}
        self.failed: set[str] = set()
        self.running = ""
        self.coverage.start()
        os.environ["COVERAGE_PROCESS_START"] = str(folder / "settings")  # for the processes that tests start

    def name(self, context: str) -> None:
        os.environ[NAME] = context
        self.coverage.switch_context(context)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        group = item.get_closest_marker("xdist_group")
        self.running = item.nodeid if group is None else item.nodeid.removesuffix(f"@{group.args[0]}")
        _forget()
        self.name(self.running)
        begin = perf_counter()
        done = yield
        fixtures = list(getattr(item, "fixturenames", []))
        self.tests[self.running] = perf_counter() - begin, item.nodeid not in self.failed, fixtures
        return done

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: "pytest.FixtureDef[object]") -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        self.name(f"{fixturedef.baseid}\t{fixturedef.argname}")
        try:
            return (yield)
        finally:
            self.name(self.running)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        self.coverage.save()
        (self.folder / f"tests.{os.getpid()}").write_text(json.dumps(self.tests))


def _forget() -> None:
    """State that helpers of tests keep for the next test: each shall reach what it needs by itself."""
    for name in [name for name in sys.modules if name.startswith("tests.")]:
        for value in vars(sys.modules[name]).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):
        config.pluginmanager.register(Tracer(Path(os.environ[FOLDER])))
