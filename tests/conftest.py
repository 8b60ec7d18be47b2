"""Lanes, and how hard hypothesis tries: `pytest --lane quick`, `pytest --lane thorough --part 2/4`."""

import os
import pkgutil
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

from haptic_fieldbus.protocols.folders import VARIABLE
from tests.coverage_gates import pure_modules, pure_rooms
from tests.lanes import Lane, Part, slow_markers

# Of whoever runs the tests, and no part of them.
os.environ.pop(VARIABLE, None)

settings.register_profile("thorough", settings.get_profile("default"))
# The same examples each time: which lines are covered must not be a matter of luck.
settings.register_profile("quick", settings.get_profile("default"), max_examples=15, derandomize=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("lanes")
    group.addoption("--lane", choices=[lane.value for lane in Lane], default=Lane.ALL.value, help="which tests to run")
    group.addoption("--part", type=Part.read, default="0/1", help="K/N: the K-th of N shares of the lane, from 0")


def pytest_configure(config: pytest.Config) -> None:
    settings.load_profile("quick" if config.getoption("lane") == Lane.QUICK.value else "thorough")


@pytest.hookimpl(tryfirst=True)  # later, xdist adds the names of groups to the node-IDs
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    lane, part = Lane(config.getoption("lane")), config.getoption("part")
    slow = slow_markers(items)
    taken = [item for item in items if lane.takes(item, slow.get(item)) and part.takes(item)]
    config.hook.pytest_deselected(items=list(set(items) - set(taken)))
    items[:] = taken
    if config.getoption("cov_source"):
        _trace_pure_rooms(items)


def _trace_pure_rooms(items: list[pytest.Item]) -> None:
    """Count lines in tests of the pure half only: tracing doubles the time of the others and proves nothing there.

    The pure half is imported here, while lines are counted: the first to use a module may be a test that is not traced.
    """
    for name in pure_modules():
        for found in pkgutil.walk_packages(getattr(import_module(name), "__path__", []), f"{name}."):
            import_module(found.name)
    traced = {str(Path(__file__).parent / room) for room in pure_rooms()}
    for item in items:
        if traced.isdisjoint(map(str, item.path.parents)):
            item.add_marker(pytest.mark.no_cover)
