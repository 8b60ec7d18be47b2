"""Every simulated run of every test is judged: a test that breaks an invariant fails, whatever else it looks at.

A test whose run is wrong on purpose, or that looks at who calls whom, is marked `@pytest.mark.unwatched("why")`.
"""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from tests.invariants.attach import Findings, watched

MOST_TOLD = 5
"""Broken invariants that are told of one test."""


class Invariants:
    """Hooks of a process that runs tests."""

    def __init__(self) -> None:
        self._opened = ExitStack()
        self._findings: Findings | None = None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        # Not before the first test: what is imported until then would not be counted as covered.
        if self._findings is None:
            self._findings = self._opened.enter_context(watched())
        self._findings.watching = item.get_closest_marker("unwatched") is None
        return (yield)  # runs of fixtures are told by the first test that uses them

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        result = yield
        self._judge(item)
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(self) -> Iterator[None]:
        try:
            return (yield)
        finally:
            if self._findings is not None:  # of a test that has failed otherwise
                self._findings.broken.clear()

    def pytest_sessionfinish(self) -> None:
        self._opened.close()

    def _judge(self, item: pytest.Item) -> None:
        if self._findings is None:
            return
        self._findings.settle()
        broken, self._findings.broken = self._findings.broken, []
        if broken:
            lines = [f"{name}: {sentence}" for name, sentence in broken[:MOST_TOLD]]
            pytest.fail("\n".join(["an invariant of every run is broken:", *lines]), pytrace=False)
