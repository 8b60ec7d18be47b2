"""Some tests against one tree, until the first fails.

As a plugin of pytest (`-p tests.mutation.trial`) it runs the tests that a file names, in the order of that file, and
ends the process when one of them takes longer than it may: a change that makes a program hang is noticed.
"""

import faulthandler
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

ORDER = "MUTATION_ORDER"
"""Environment of a trial: the file that names the tests, and how long each may take [s]."""
LIMIT, FACTOR = 30.0, 20.0
"""A test may take so long [s], and so many times of what it took when it was traced."""


@dataclass(frozen=True)
class Failure:
    """The first test that failed; None when the tests could not even be collected."""

    test: str | None
    hung: bool


def first_failure(tree: Path, lane: str, tests: dict[str, float], environment: dict[str, str]) -> Failure | None:
    """Run tests, of which is known how long they take [s], in a tree; None when all of them pass."""
    order = tree.with_name(f"{tree.name}.json")
    running, hung = (order.with_suffix(suffix) for suffix in (".running", ".hung"))
    order.write_text(json.dumps({test: LIMIT + FACTOR * seconds for test, seconds in tests.items()}))
    running.write_text("")
    hung.write_text("")
    command = [sys.executable, "-m", "pytest", "-p", "tests.mutation.trial", "-p", "no:cacheprovider", "-x", "-q"]
    command += ["--lane", lane, *dict.fromkeys(test.partition("::")[0] for test in tests)]
    with order.with_suffix(".log").open("w") as log:
        process = subprocess.Popen(
            command,
            cwd=tree,
            env=environment | {ORDER: str(order)},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        status = process.wait()
    with suppress(ProcessLookupError):  # what a killed test has left running
        os.killpg(process.pid, signal.SIGKILL)
    return None if status == 0 else Failure(running.read_text() or None, bool(hung.read_text()))


class Trial:
    """Hooks of one trial."""

    def __init__(self, order: Path) -> None:
        self.limits: dict[str, float] = json.loads(order.read_text())
        self.running = order.with_suffix(".running")
        self.hung = order.with_suffix(".hung").open("w")
        faulthandler.dump_traceback_later(4 * LIMIT, exit=True, file=self.hung)  # until the first test begins

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        places = {test: place for place, test in enumerate(self.limits)}
        items[:] = sorted((item for item in items if item.nodeid in places), key=lambda item: places[item.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.running.write_text(item.nodeid)
        faulthandler.dump_traceback_later(self.limits[item.nodeid], exit=True, file=self.hung)
        return (yield)

    def pytest_sessionfinish(self) -> None:
        faulthandler.dump_traceback_later(LIMIT, exit=True, file=self.hung)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Trial(Path(os.environ[ORDER])))
