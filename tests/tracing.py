"""Which lines of the package the tests of the pure rooms run: `python -m pytest -p tests.tracing --coverage FILE`.

A line is covered by a test of its own, not by a simulation that happens to pass it. So tests of the rooms of the pure
half come first, and what later tests run is not counted, nor what runs while tests are collected. Slipcover counts:
it takes each of its probes out of the code when a line was seen, so that a loop costs no more than without it.
"""

import gc
import json
import pkgutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType

import pytest
from _pytest.assertion.rewrite import AssertionRewritingHook
from slipcover.importer import FileMatcher, ImportManager
from slipcover.slipcover import Slipcover, findlinestarts, merge_coverage

from tests.coverage_gates import PROJECT, pure_modules, pure_rooms

NOT_CODE = r"^\s*(def .*: )?\.\.\.$"
"""The body of a Protocol's method."""
BRANCHES = 1 << 15
"""Larger numbers of lines are slipcover's marks of branches."""
MISSES = 1000
"""So often a probe of a line that was seen already is passed before it is taken out, which takes a while."""


class Counter(Slipcover):  # type: ignore[misc]
    """Lines that a module runs when it is imported, and lines and branches that its functions run after `begin`."""

    def __init__(self) -> None:
        super().__init__(branch=True, d_miss_threshold=MISSES, exclude_also=[NOT_CODE])
        self._begun = False

    def instrument(self, co: CodeType, parent: CodeType | None = None) -> CodeType:
        if self._begun:
            probed: CodeType = super().instrument(co, parent)
            return probed
        lines = {line for _, line in findlinestarts(co) if 0 < line < BRANCHES}
        self.code_lines[co.co_filename] |= lines
        self.all_seen[co.co_filename] |= lines
        return co

    def begin(self) -> None:
        """Put probes into all functions of the imported modules."""
        self._begun = True
        files = {module.__file__ for module in self.modules}
        for function in [each for each in gc.get_objects() if type(each) is FunctionType]:
            if function.__code__.co_filename in files:
                super().instrument(function)


class Tracing:
    """Hooks of a process that runs tests."""

    def __init__(self, file: Path) -> None:
        tests = Path(__file__).parent
        self._file = file
        self._rooms = {tests / room for room in pure_rooms()}
        self._counter = Counter()
        self._ended = False
        places = [PROJECT / module.replace(".", "/") for module in pure_modules()]
        sources = [place if place.is_dir() else place.with_suffix(".py") for place in places]
        with not_rewritten(), ImportManager(self._counter, FileMatcher(sources=sources)):
            import_pure_half()

    def _pure(self, item: pytest.Item) -> bool:
        return not self._rooms.isdisjoint(item.path.parents)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=lambda item: not self._pure(item))

    def pytest_collection_finish(self) -> None:
        self._counter.begin()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> None:
        if not self._pure(item):
            self._end()
        elif self._ended:
            pytest.exit(f"{item.nodeid} runs after tests of other rooms, so that its lines would not be counted", 3)

    def pytest_sessionfinish(self) -> None:
        self._end()

    def _end(self) -> None:
        if not self._ended:
            counted = self._counter.get_coverage()
            self._file.with_name(f".coverage.{id(self)}").write_text(json.dumps(counted))
            self._ended = True


class Report:
    """Hooks of the process that is last to finish."""

    def __init__(self, file: Path) -> None:
        self._file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        for old in self._parts():
            old.unlink()

    def _parts(self) -> list[Path]:
        return list(self._file.parent.glob(".coverage.*"))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        parts = [json.loads(part.read_text()) for part in self._parts()]
        for other in parts[1:]:
            merge_coverage(parts[0], other)
        self._file.write_text(json.dumps(parts[0] if parts else {"files": {}}))


@contextmanager
def not_rewritten() -> Iterator[None]:
    """Import without pytest's rewriting of assertions, which the package's own modules have none of."""
    hooks = [finder for finder in sys.meta_path if isinstance(finder, AssertionRewritingHook)]
    for hook in hooks:
        sys.meta_path.remove(hook)
    yield
    sys.meta_path[:0] = hooks


def import_pure_half() -> None:
    for name in pure_modules():
        for found in pkgutil.walk_packages(getattr(import_module(name), "__path__", []), f"{name}."):
            import_module(found.name)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("lanes").addoption("--coverage", type=Path, required=True, help="count lines, and write them here")


def pytest_configure(config: pytest.Config) -> None:
    file: Path = config.rootpath / config.getoption("coverage")
    # Otherwise large groups come first, which are not of the pure rooms.
    config.option.loadscopereorder = False
    worker = hasattr(config, "workerinput")
    if not worker:
        config.pluginmanager.register(Report(file))
    if worker or not config.getoption("numprocesses", None):
        config.pluginmanager.register(Tracing(file))
