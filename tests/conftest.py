"""Lanes, and how hard hypothesis tries: `pytest --lane quick`, `pytest --lane thorough --part 2/4`."""

import gc
import os
import signal
import tempfile
from collections import Counter

import pytest
from hypothesis import HealthCheck, settings
from xdist.remote import Producer
from xdist.scheduler import LoadGroupScheduling

from tests import telling
from tests.coverage_gates import pure_rooms
from tests.invariants.plugin import Invariants
from tests.lanes import VENDOR_FILES, Lane, Part, slow_markers, vendor_files
from tests.vcan import plugin as vcan

# The folder of whoever runs the tests is no part of them. Nothing of the package is imported here: what is imported
# before `tests.tracing` begins would not be counted as covered.
os.environ.pop("HAPTIC_FIELDBUS_PROFILES", None)
STATE = tempfile.TemporaryDirectory(prefix="haptic-fieldbus-state-")
os.environ["XDG_STATE_HOME"] = STATE.name
PURE_ROOMS = pure_rooms()

# No example is judged by how long it takes: a busy machine is no fault of a test.
settings.register_profile("thorough", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# The same examples each time: which lines are covered must not be a matter of luck.
settings.register_profile("quick", settings.get_profile("thorough"), max_examples=15, derandomize=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("lanes")
    group.addoption("--lane", choices=[lane.value for lane in Lane], default=Lane.ALL.value, help="which tests to run")
    vcan.pytest_addoption(parser)
    group.addoption("--part", type=Part.read, default="0/1", help="K/N: the K-th of N shares of the lane, from 0")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    telling.pytest_terminal_summary(terminalreporter)


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("lane") == Lane.VENDOR.value and not vendor_files():
        raise pytest.UsageError(f"no vendors' files: set {VENDOR_FILES} to a folder with EDS or DCF files of vendors")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell leaves it for what runs in the background
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.pluginmanager.register(Invariants())
    config.option.loadscopereorder = False  # xdist begins with the files that have the most tests
    vcan.pytest_configure(config)
    settings.load_profile("quick" if config.getoption("lane") == Lane.QUICK.value else "thorough")


@pytest.hookimpl(tryfirst=True)  # later, xdist adds the names of groups to the node-IDs
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    lane, part = Lane(config.getoption("lane")), config.getoption("part")
    slow = slow_markers(items)
    taken = [item for item in items if lane.takes(item, slow.get(item)) and part.takes(item)]
    config.hook.pytest_deselected(items=list(set(items) - set(taken)))
    items[:] = few_first(taken)


def few_first(items: list[pytest.Item]) -> list[pytest.Item]:
    """Files with the fewest tests first: the longest tests stand in these, and none is to begin as all others end."""
    tests = Counter(item.path for item in items)
    return sorted(items, key=lambda item: tests[item.path])


def pytest_collection_finish() -> None:
    """Leave ten thousand collected tests out of collections of garbage: with them one takes a third of a second."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadGroupScheduling:
    """One worker runs all tests of a file, so that what they share is made once; those of a group stay together too."""
    return FileScheduling(config, log)


class FileScheduling(LoadGroupScheduling):  # type: ignore[misc]
    def _split_scope(self, nodeid: str) -> str:
        scope: str = super()._split_scope(nodeid)
        if "::" in scope:  # the whole node-ID, of a test without a group
            return scope.partition("::")[0]
        # A test of several groups belongs to all of them, for xdist; one guest kernel is for all of its tests.
        if vcan.GROUP in scope.split("_"):
            return vcan.GROUP
        # Those of the pure rooms come first: what runs after others is not counted as covered.
        return f"{scope}, pure" if nodeid.split("/")[1] in PURE_ROOMS else scope
