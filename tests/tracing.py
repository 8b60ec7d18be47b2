"""Which lines of the package the tests of the pure rooms run: `python -m pytest -p tests.tracing --coverage FILE`.

Counting lines doubles the time of what is counted. So it is done where it proves something: while the pure half is
imported, and in the body of tests of the rooms of the pure half. Of the rooms whose tests render or judge for long the
first case of each test counts, for its own room; of the others every test, for the whole pure half. A line is covered
by a test of its own, not by a simulation that happens to pass it.
"""

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from coverage import Coverage

from tests.coverage_gates import pure_modules, pure_rooms

LONG_ROOMS = {"margins", "scenes", "sim"}


def coverage_beside(file: Path, modules: list[str]) -> Coverage:
    """Of one process and these modules alone; what all have counted is beside the report."""
    coverage = Coverage(data_file=str(file.with_name(".coverage")), data_suffix=True, source_pkgs=modules)
    # A process runs some of the files, so that it reaches some modules only; a warning would end it before it saves.
    coverage.set_option("run:disable_warnings", ["module-not-measured", "no-data-collected"])
    return coverage


def counted_in(room: str) -> list[str]:
    """The modules whose lines the tests of a room count."""
    return [name for name in pure_modules() if room not in LONG_ROOMS or name.split(".")[1] == room]


class Tracing:
    """Hooks of a process that runs tests."""

    def __init__(self, file: Path) -> None:
        tests = Path(__file__).parent
        self._file, self._rooms = file, {tests / room: room for room in pure_rooms()}
        imports = coverage_beside(file, pure_modules())
        self._counted = {"": imports}
        """By room; without a name what is run while the pure half is imported."""
        self._seen = set[str]()
        """Tests of which a case has counted."""
        imports.start()
        import_pure_half()
        imports.stop()

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        room = next((self._rooms[path] for path in item.path.parents if path in self._rooms), None)
        if room is None or not self._counts(item, room):
            return (yield)
        if room not in self._counted:
            self._counted[room] = coverage_beside(self._file, counted_in(room))
        coverage = self._counted[room]
        coverage.start()
        try:
            return (yield)
        finally:
            coverage.stop()

    def _counts(self, item: pytest.Item, room: str) -> bool:
        test = item.nodeid.partition("[")[0]
        is_first = test not in self._seen
        self._seen.add(test)
        return is_first or room not in LONG_ROOMS

    def pytest_sessionfinish(self) -> None:
        for coverage in self._counted.values():
            coverage.save()


class Report:
    """Hooks of the process that is last to finish."""

    def __init__(self, file: Path) -> None:
        self._file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        for old in file.parent.glob(".coverage*"):
            old.unlink()

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        coverage = coverage_beside(self._file, pure_modules())
        coverage.combine([str(self._file.parent)])
        coverage.json_report(outfile=str(self._file))


def import_pure_half() -> None:
    for name in pure_modules():
        for found in pkgutil.walk_packages(getattr(import_module(name), "__path__", []), f"{name}."):
            import_module(found.name)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("lanes").addoption("--coverage", type=Path, required=True, help="count lines, and write them here")


def pytest_configure(config: pytest.Config) -> None:
    file: Path = config.rootpath / config.getoption("coverage")
    worker = hasattr(config, "workerinput")
    if not worker:
        config.pluginmanager.register(Report(file))
    if worker or not config.getoption("numprocesses", None):
        config.pluginmanager.register(Tracing(file))
