"""Which lines of the package the tests of the pure rooms run: `python -m pytest -p tests.tracing --coverage FILE`.

Counting lines doubles the time of what is counted. So it is done where it proves something: while the pure half is
imported, and in the body of each test of a room of the pure half. A line is covered by a test of its own, not by a
simulation that happens to pass it.
"""

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from coverage import Coverage

from tests.coverage_gates import pure_modules, pure_rooms


def coverage_beside(file: Path) -> Coverage:
    """Of one process and the pure half alone; what all have counted is beside the report."""
    coverage = Coverage(data_file=str(file.with_name(".coverage")), data_suffix=True, source_pkgs=pure_modules())
    # A process that runs a part of the tests reaches a part of the modules; a warning would end it before it saves.
    coverage.set_option("run:disable_warnings", ["module-not-measured", "no-data-collected"])
    return coverage


class Tracing:
    """Hooks of a process that runs tests."""

    def __init__(self, file: Path) -> None:
        tests = Path(__file__).parent
        self._rooms = {tests / room for room in pure_rooms()}
        self._coverage = coverage_beside(file)
        self._coverage.start()
        import_pure_half()
        self._coverage.stop()

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        if self._rooms.isdisjoint(item.path.parents):
            return (yield)
        self._coverage.start()
        try:
            return (yield)
        finally:
            self._coverage.stop()

    def pytest_sessionfinish(self) -> None:
        self._coverage.save()


class Report:
    """Hooks of the process that is last to finish."""

    def __init__(self, file: Path) -> None:
        self._file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        for old in file.parent.glob(".coverage*"):
            old.unlink()

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        coverage = coverage_beside(self._file)
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
